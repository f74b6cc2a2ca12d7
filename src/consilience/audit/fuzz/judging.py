"""Comparison of all answers about one mechanism: with the reference, and between the methods of one engine.

Bars are those of `compare.instants`; they grow with the condition of the equations at each state. Where the
formulations of the reference differ by more than the bar, that difference is the disagreement, and the engines are
unresolved.

Methods of one engine are compared with one another where their profiles are equal: two methods with default settings
solve the same problem, however soft. Against the reference, methods of the profile ``default`` are compared, and
never raise an alarm.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from consilience.audit.fuzz.workers import AnswerBatch
from consilience.case import Case
from consilience.compare import Comparison, Verdict, compare_instant, compare_model
from consilience.compare.instants import BARS, Bars, Instants
from consilience.compare.judge import REFERENCE
from consilience.compare.other_methods import SOLVER_RULE, reconsidered
from consilience.compare.rules import OTHER_LAWS
from consilience.engine import InstantAnswer, Method, ModelAnswer, Profile, Question, Unsupported, defects
from consilience.engine.worker.requests import MethodAnswer
from consilience.errors import NumericalFailure
from consilience.mechanism import characteristic_length

_DECLARED = {rule for rule, _, _ in OTHER_LAWS}
"""Rules of motions that are those of a law of contact which the method declares, and the reference solved as well."""

_MOST_OUTPUT = 300
"""Characters of an engine's output that are kept with a failure."""


@dataclass(frozen=True)
class JudgedComparison:
    """A comparison of two answers, or the reason why there is none.

    Attributes
    ----------
    engine, method : str
    against : str
        The reference, or another method of the engine.
    question : Question
    profile : Profile
    verdict : Verdict
    quantity : str
        First quantity that misses its bar; of a motion the rule of the verdict; of a failure its kind.
    why : str
    digits : float or None
    excess : float
        Largest ratio of difference to bar.
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
        """Whether the comparison is a disagreement.

        Default settings claim no accuracy against the reference, and a law of contact that a method declares is known.
        """
        claimed = self.profile is Profile.MATCHED or self.against != REFERENCE
        return claimed and self.verdict in (Verdict.MODEL, Verdict.FAILED) and self.quantity not in _DECLARED

    @property
    def signature(self) -> tuple[str, ...]:
        """Fields that are equal for two comparisons that show the same disagreement."""
        return (self.engine, self.method, self.against, str(self.question), str(self.verdict), self.quantity)


def judge(case: Case, batches: Mapping[str, AnswerBatch]) -> list[JudgedComparison]:
    """Compare all answers about the mechanism of a case; comparisons of the reference come first.

    Parameters
    ----------
    case : Case
    batches : mapping of engine to AnswerBatch
        Answers by engine, the reference included.
    """
    return list(_MechanismJudge(case, batches[REFERENCE]).comparisons(batches))


class _MechanismJudge:
    """Comparison of the answers about one mechanism with the first sound answers of the reference."""

    def __init__(self, case: Case, reference: AnswerBatch) -> None:
        self.case = case
        self.instants = Instants.of(case.mechanism, case.states)
        self.length = max(float(np.max(np.abs(case.initial_state.p_WB))), characteristic_length(case.mechanism))
        self.reference: dict[Question, MethodAnswer] = {}
        for answer in reference.answers:
            if not self._defect(answer):
                self.reference.setdefault(answer.question, answer)
        self.open = {answer.question for answer in reference.answers if _leaves_open(self._defect(answer))}
        self.uncertain: set[Question] = set()
        self.inexact: set[str] = set()

    def comparisons(self, batches: Mapping[str, AnswerBatch]) -> Iterator[JudgedComparison]:
        """Compare the reference with itself first: engines are unresolved where the reference is uncertain."""
        for engine in (REFERENCE, *(name for name in batches if name != REFERENCE)):
            found = list(self._of_engine(engine, batches[engine]))
            if engine == REFERENCE:
                self.uncertain = {one.question for one in found if one.verdict is Verdict.MODEL}
            yield from found

    def _of_engine(self, engine: str, batch: AnswerBatch) -> Iterator[JudgedComparison]:
        nothing = MethodAnswer(Question.INSTANT, None, None)
        for refusal in batch.unsupported:
            yield self._judged(engine, nothing, REFERENCE, Verdict.UNSUPPORTED, "", refusal.reason)
        sound: list[MethodAnswer] = []
        for answer in batch.answers:
            if isinstance(answer.answer, Unsupported):
                yield self._judged(engine, answer, REFERENCE, Verdict.UNSUPPORTED, "", str(answer.answer))
                continue
            defect = self._defect(answer)
            if defect:
                if answer.question in self.open and answer.method is not None:  # by the laws, for every engine
                    yield self._judged(engine, answer, REFERENCE, Verdict.UNRESOLVED, "", defect)
                    continue
                printed = batch.log.strip()[-_MOST_OUTPUT:] if answer.method is None else ""
                why = f"{defect}; it printed: {printed}" if printed else defect
                yield self._judged(engine, answer, REFERENCE, Verdict.FAILED, kind_of(defect), why)
                continue
            sound.append(answer)
        if engine != REFERENCE:
            yield from self._against_reference(engine, sound)
        for one, other in combinations(sound, 2):
            if one.question is other.question and _profile(one) is _profile(other):
                pair = self._against_one_another(engine, one, other)
                # what a solver loses against the reference, it loses against the engine's own terms
                inexact = pair.verdict is Verdict.MODEL and {_name(one), _name(other)} & self.inexact
                yield replace(pair, verdict=Verdict.UNRESOLVED) if inexact else pair

    def _defect(self, answer: MethodAnswer) -> str:
        """Say why an answer is not sound; empty for a sound answer."""
        if answer.reason or answer.method is None:
            return answer.reason or "it named no method"
        count = answer.question.sample_count(len(self.case.states))
        return "; ".join(defects(answer.answer, answer.question, self.case.mechanism, count))

    def _against_reference(self, engine: str, answers: Sequence[MethodAnswer]) -> Iterator[JudgedComparison]:
        """Compare all methods of an engine, whose own terms tell a solver from a model."""
        certain = [a for a in answers if a.question in self.reference and a.question not in self.uncertain]
        for answer in answers:
            if answer not in certain:
                unknown = answer.question not in self.reference
                why = "the reference did not answer" if unknown else "the reference differs from itself"
                yield self._judged(engine, answer, REFERENCE, Verdict.UNRESOLVED, "", why)
        found = reconsidered([self._comparison(engine, a, self.reference[a.question]) for a in certain])
        self.inexact = {c.method for c in found if c.rule == SOLVER_RULE}
        for answer, comparison in zip(certain, found, strict=True):
            yield self._judged_by(engine, answer, comparison, REFERENCE)

    def _against_one_another(self, engine: str, one: MethodAnswer, other: MethodAnswer) -> JudgedComparison:
        """Compare two methods of an engine by the more lenient bars of the two."""
        lenient, strict = sorted((one, other), key=_acceleration_bar, reverse=True)
        return self._compared(engine, lenient, strict, _name(strict))

    def _compared(self, engine: str, answer: MethodAnswer, other: MethodAnswer, against: str) -> JudgedComparison:
        return self._judged_by(engine, answer, self._comparison(engine, answer, other), against)

    def _comparison(self, engine: str, answer: MethodAnswer, other: MethodAnswer) -> Comparison:
        found: Comparison = _COMPARISONS[answer.question](self, engine, answer.method, answer.answer, other.answer)
        return found

    def _judged_by(self, engine: str, answer: MethodAnswer, found: Comparison, against: str) -> JudgedComparison:
        missed = next((q.name for q in found.quantities if not q.met), "")
        excess = max((q.difference / q.bar if q.bar else q.difference) for q in found.quantities)
        judged = self._judged(engine, answer, against, found.verdict, missed, found.why)
        return replace(judged, digits=found.digits, excess=float(excess))

    def model(self, engine: str, method: Method, found: ModelAnswer, expected: ModelAnswer) -> Comparison:
        """Compare mass properties and degrees of freedom."""
        return compare_model(self.case.name, engine, method, found, expected, self.length)

    def instant(self, engine: str, method: Method, found: InstantAnswer, expected: InstantAnswer) -> Comparison:
        """Compare accelerations and energies, and reactions where both methods give them."""
        if expected.force_F is None:
            found = replace(found, force_F=None, torque_F=None)
        instants = replace(self.instants, answers=2) if engine == REFERENCE else self.instants
        return compare_instant(self.case.name, engine, method, found, expected, instants)

    def _judged(
        self, engine: str, answer: MethodAnswer, against: str, verdict: Verdict, quantity: str, why: str
    ) -> JudgedComparison:
        """Return a comparison with the fields of an answer.

        Parameters
        ----------
        engine : str
        answer : MethodAnswer
        against : str
            The reference, or another method of the engine.
        verdict : Verdict
        quantity : str
            First quantity that misses its bar; of a failure its kind.
        why : str
        """
        profile = _profile(answer)
        return JudgedComparison(engine, _name(answer), against, answer.question, profile, verdict, quantity, why)


_COMPARISONS: dict[Question, Callable[..., Comparison]] = {
    Question.MODEL: _MechanismJudge.model,
    Question.INSTANT: _MechanismJudge.instant,
}
"""Comparison of two answers to each question of a campaign."""


def _profile(answer: MethodAnswer) -> Profile:
    return answer.method.profile if answer.method else Profile.MATCHED


def _name(answer: MethodAnswer) -> str:
    return answer.method.name if answer.method else ""


def _acceleration_bar(answer: MethodAnswer) -> float:
    bars = BARS.get(answer.method.route) if answer.method else None
    return (bars or Bars()).acceleration


def _leaves_open(defect: str) -> bool:
    """Tell whether the reference says that the laws of contact have no solution, or several."""
    return defect.startswith(f"{NumericalFailure.__name__}: ") and "contact" in defect


def kind_of(defect: str) -> str:
    """Return the kind of a failure: the words before the first number or name."""
    return re.split(r"[:'0-9]", defect, maxsplit=1)[0].strip()


def alarms(entries: Sequence[JudgedComparison]) -> list[JudgedComparison]:
    """Choose the disagreements about one mechanism.

    A method that differs from the reference also differs from the engine's other methods: that adds nothing, so a
    pair of methods is an alarm only where neither has an alarm against the reference.
    """
    told = {(e.engine, e.method, e.question) for e in entries if e.alarm and e.against == REFERENCE}
    return [
        e
        for e in entries
        if e.alarm
        and (e.against == REFERENCE or not told & {(e.engine, name, e.question) for name in (e.method, e.against)})
    ]
