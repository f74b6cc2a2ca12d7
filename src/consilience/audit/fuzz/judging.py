"""What all engines said about one mechanism, compared: with the reference, and one way of an engine with another.

Bars are those of `compare.instant`, which grow with the condition of the equations at each state. Where the
formulations of the reference differ by more, it is no yardstick: its own difference is the disagreement, and the
engines are unresolved.

Ways of one engine are compared where they have the same profile, ``default`` with ``default``, too: they solve the same
problem, soft as it may be. With the reference those of the profile ``default`` are compared and not judged.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from consilience.audit.fuzz.workers import MethodAnswer, Sheet
from consilience.case import Case
from consilience.compare import Verdict, compare_instant, compare_model
from consilience.compare.instant import BARS, Bars, Instants
from consilience.compare.judge import REFERENCE
from consilience.engine import InstantAnswer, Method, ModelAnswer, Profile, Question, defects
from consilience.mechanism import characteristic_length

_LAST_WORDS = 300
"""Characters of what an engine printed that go with a failure."""


@dataclass(frozen=True)
class Entry:
    """One comparison, or why there is none.

    Attributes
    ----------
    engine, method : str
    against : str
        The reference, or another method of the engine.
    question : Question
    profile : Profile
    verdict : Verdict
    quantity : str
        The first quantity that misses its bar; of a failure the kind of it.
    why : str
    digits : float or None
    excess : float
        Largest difference over its bar.
    """

    engine: str
    method: str
    against: str
    question: Question
    profile: Profile
    verdict: Verdict
    quantity: str = ""
    why: str = ""
    digits: float | None = None
    excess: float = 0.0

    @property
    def alarm(self) -> bool:
        """Whether it must be looked into: nobody claims that the defaults of an engine are accurate."""
        claimed = self.profile is Profile.MATCHED or self.against != REFERENCE
        return claimed and self.verdict in (Verdict.MODEL, Verdict.FAILED)

    @property
    def signature(self) -> tuple[str, ...]:
        """What is the same of two entries that show the same."""
        return (self.engine, self.method, self.against, str(self.question), str(self.verdict), self.quantity)


def judge(case: Case, sheets: Mapping[str, Sheet]) -> list[Entry]:
    """Entries of one mechanism, the reference's first.

    Parameters
    ----------
    sheets : mapping of engine to Sheet
        Of the reference, too.
    """
    return list(_Judge(case, sheets[REFERENCE]).entries(sheets))


class _Judge:
    def __init__(self, case: Case, reference: Sheet) -> None:
        self.case = case
        mechanism, states = case.mechanism, case.states
        self.instants = Instants.of(mechanism, states)
        self.length = max(float(np.max(np.abs(case.initial_state.p_WB))), characteristic_length(mechanism))
        self.yard: dict[Question, MethodAnswer] = {}
        for said in reference.said:
            if not self._defect(said):
                self.yard.setdefault(said.question, said)
        self.uncertain: set[Question] = set()

    def entries(self, sheets: Mapping[str, Sheet]) -> Iterator[Entry]:
        """All comparisons, those of the reference with itself first: where it is uncertain, engines are unresolved."""
        for engine in (REFERENCE, *(name for name in sheets if name != REFERENCE)):
            found = list(self._of_engine(engine, sheets[engine]))
            if engine == REFERENCE:
                self.uncertain = {entry.question for entry in found if entry.verdict is Verdict.MODEL}
            yield from found

    def _of_engine(self, engine: str, sheet: Sheet) -> Iterator[Entry]:
        for refusal in sheet.unsupported:
            yield Entry(
                engine, "", REFERENCE, Question.INSTANT, Profile.MATCHED, Verdict.UNSUPPORTED, why=refusal.reason
            )
        sound: list[MethodAnswer] = []
        for said in sheet.said:
            defect = self._defect(said)
            if defect:
                printed = sheet.log.strip()[-_LAST_WORDS:] if said.method is None else ""
                why = f"{defect}; it printed: {printed}" if printed else defect
                yield self._entry(engine, said, REFERENCE, Verdict.FAILED, _kind(defect), why)
                continue
            sound.append(said)
            if engine != REFERENCE:
                yield self._against_reference(engine, said)
        for one, other in combinations(sound, 2):
            if one.question is other.question and _profile(one) is _profile(other):
                yield self._against_one_another(engine, one, other)

    def _defect(self, said: MethodAnswer) -> str:
        """Why there is no sound answer; empty if there is."""
        if said.reason or said.method is None:
            return said.reason or "it named no method"
        count = 1 if said.question is Question.MODEL else len(self.case.states)
        return "; ".join(defects(said.answer, said.question, self.case.mechanism, count))

    def _against_reference(self, engine: str, said: MethodAnswer) -> Entry:
        yard = self.yard.get(said.question)
        if yard is None or said.question in self.uncertain:
            why = "the reference did not answer" if yard is None else "the reference differs from itself"
            return self._entry(engine, said, REFERENCE, Verdict.UNRESOLVED, "", why)
        return self._compared(engine, said, yard, REFERENCE)

    def _against_one_another(self, engine: str, one: MethodAnswer, other: MethodAnswer) -> Entry:
        """The more lenient bars are those of the pair."""
        assert one.method is not None
        assert other.method is not None
        if _bars(other.method).acceleration > _bars(one.method).acceleration:
            one, other = other, one
        assert other.method is not None
        return self._compared(engine, one, other, other.method.name)

    def _compared(self, engine: str, said: MethodAnswer, yard: MethodAnswer, against: str) -> Entry:
        found, expected = said.answer, yard.answer
        assert said.method is not None
        if isinstance(found, ModelAnswer) and isinstance(expected, ModelAnswer):
            comparison = compare_model(self.case.name, engine, said.method, found, expected, self.length)
        else:
            assert isinstance(found, InstantAnswer)
            assert isinstance(expected, InstantAnswer)
            if expected.force_F is None:  # of two ways that are compared, this one has no reactions
                found = replace(found, force_F=None, torque_F=None)
            comparison = compare_instant(self.case.name, engine, said.method, found, expected, self.instants)
        missed = next((q.name for q in comparison.quantities if not q.met), "")
        excess = max((q.difference / q.bar if q.bar else q.difference) for q in comparison.quantities)
        return replace(
            self._entry(engine, said, against, comparison.verdict, missed, comparison.why),
            digits=comparison.digits,
            excess=float(excess),
        )

    def _entry(self, engine: str, said: MethodAnswer, against: str, verdict: Verdict, quantity: str, why: str) -> Entry:
        name = said.method.name if said.method else ""
        return Entry(engine, name, against, said.question, _profile(said), verdict, quantity, why)


def _profile(said: MethodAnswer) -> Profile:
    return said.method.profile if said.method else Profile.MATCHED


def _bars(method: Method) -> Bars:
    return BARS.get(method.route, Bars())


def _kind(defect: str) -> str:
    """What is the same of two failures of one cause: the words before the first number or name."""
    return re.split(r"[:'0-9]", defect, maxsplit=1)[0].strip()


def alarms(entries: Sequence[Entry]) -> list[Entry]:
    """Entries of one mechanism that must be looked into: of two ways that differ, only where the reference tells none.

    A way that differs from the reference differs from the engine's other ways, too, which says nothing more.
    """
    told = {(e.engine, e.method, e.question) for e in entries if e.alarm and e.against == REFERENCE}
    return [
        e
        for e in entries
        if e.alarm
        and (e.against == REFERENCE or not told & {(e.engine, way, e.question) for way in (e.method, e.against)})
    ]
