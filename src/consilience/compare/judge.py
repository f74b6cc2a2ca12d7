"""All runs of a case in, all its comparisons out: what is compared with what.

The reference's own answers are sorted first: the best one is the yardstick, the others bound its uncertainty, those
from displaced states its horizon. Then `model`, `instant` and `trajectory` are judged in this order, so that a motion
knows what its engine already differs in before anything is integrated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from consilience.case import Case
from consilience.compare import (
    Comparison,
    Quantity,
    Verdict,
    Yardstick,
    compare_instant,
    compare_model,
    compare_trajectory,
    spread_over_time,
)
from consilience.compare.horizon import growth
from consilience.compare.instant import Instants
from consilience.compare.published import against_published, dispute, start_against_published
from consilience.engine import InstantAnswer, ModelAnswer, Profile, Question, Run, Status, TrajectoryAnswer
from consilience.mechanism import characteristic_length

REFERENCE = "reference"

DISPLACED_START = "displaced start"
"""In the names of the reference's motions from displaced states."""


def judge_case(case: Case, runs: Sequence[Run]) -> list[Comparison]:
    """Comparisons of a case, question by question."""
    references = _references(runs)
    found: list[Comparison] = []
    for question in Question:
        groups: dict[tuple[str, str], list[Run]] = {}
        for run in runs:
            if run.question is question and not _displaced(run):
                groups.setdefault((run.engine, run.method.name if run.method else ""), []).append(run)
        if groups:
            found += _Judge(case, question, references.get(question, []), found).judge(groups)
    return found


def yardstick(case: Case, runs: Sequence[Run]) -> Yardstick | None:
    """What motions of a case are measured with, from the runs of the reference; None if it did not answer."""
    references = _references(runs).get(Question.TRAJECTORY)
    return _yardstick(case, references)[0] if references else None


def _yardstick(case: Case, references: Sequence[Run]) -> tuple[Yardstick, tuple[Quantity, ...]]:
    """The best motion with what bounds it, and how it stands beside what is known of the case."""
    mechanism = case.mechanism
    motions = [r.answer for r in references if isinstance(r.answer, TrajectoryAnswer) and not _displaced(r)]
    displaced = [r.answer for r in references if isinstance(r.answer, TrajectoryAnswer) and _displaced(r)]
    spread = spread_over_time(mechanism, motions)
    known = against_published(mechanism, case.published, motions[0], spread)
    growing = growth(mechanism, motions[0], displaced)
    return Yardstick(motions[0], spread, case.digits, growing, dispute(known)), known


def _displaced(run: Run) -> bool:
    return run.engine == REFERENCE and run.method is not None and DISPLACED_START in run.method.name


def _softened(run: Run) -> bool:
    return run.method is not None and run.method.softness not in (None, 1.0)


class _Judge:
    """One question of one case."""

    def __init__(self, case: Case, question: Question, references: list[Run], before: Sequence[Comparison]) -> None:
        self.case, self.question, self.references, self.before = case, question, references, before
        start = case.initial_state
        self.length = max(float(np.max(np.abs(start.p_WB))), characteristic_length(case.mechanism))
        self.instants = Instants.of(case.mechanism, case.states) if question is Question.INSTANT else None
        self.known: tuple[Quantity, ...] = ()
        self.yard: Yardstick | None = None
        if question is Question.TRAJECTORY and references:
            self.yard, self.known = _yardstick(case, references)
        if self.instants is not None and references and isinstance(references[0].answer, InstantAnswer):
            self.known = start_against_published(case.mechanism, case.published, references[0].answer, self.instants)

    def judge(self, groups: dict[tuple[str, str], list[Run]]) -> Iterator[Comparison]:
        """Every engine and method against the reference, which is not compared with itself."""
        for (engine, _), group in groups.items():
            levels = [run for run in group if not _softened(run)]
            if not self.references or any(run.status is not Status.ANSWERED for run in levels):
                yield _without_answer(levels)
                continue
            best = self.references[0]
            if engine == REFERENCE and group[0] is best and self.question is not Question.TRAJECTORY:
                continue
            yield self._compare(group)

    def _compare(self, group: list[Run]) -> Comparison:
        case, first, reference = self.case, group[0], self.references[0].answer
        own = [run for run in group if not _softened(run)]
        softer = [run for run in group if _softened(run)]
        if any(run.status is not Status.ANSWERED for run in softer):
            softer = []  # the levels stand on their own; the record keeps the probe that failed
        assert first.method is not None
        answer = own[-1].answer
        if isinstance(answer, ModelAnswer) and isinstance(reference, ModelAnswer):
            return compare_model(case.name, first.engine, first.method, answer, reference, self.length)
        if isinstance(answer, InstantAnswer) and isinstance(reference, InstantAnswer):
            assert self.instants is not None
            soft = [run.answer for run in softer if isinstance(run.answer, InstantAnswer)]
            compared = compare_instant(case.name, first.engine, first.method, answer, reference, self.instants, soft)
            return self._beside_known(compared)
        assert self.yard is not None
        own = [run for run in own if run is not self.references[0]]
        compared = compare_trajectory(case.mechanism, own, self.yard, softer, self._earlier(first))
        return replace(compared, quantities=self.known) if self.references[0] in group else compared

    def _beside_known(self, compared: Comparison) -> Comparison:
        """An instant beside what is known of it: the reference shows it, and no engine fails where it is disputed."""
        if compared.engine == REFERENCE:
            compared = replace(compared, quantities=(*compared.quantities, *self.known))
        disputed = dispute(self.known)
        if not disputed:
            return compared
        why = f"the reference is disputed: {disputed}"
        return replace(compared, verdict=Verdict.UNRESOLVED, rule="disputed reference", why=why)

    def _earlier(self, run: Run) -> str:
        """What the engine differs in at `model`, or by all its methods of that profile at `instant`."""
        assert run.method is not None
        own = [c for c in self.before if c.engine == run.engine]
        model = [c for c in own if c.question is Question.MODEL and c.verdict is Verdict.MODEL]
        if model:
            return f"model: {model[0].why}"
        same = [c for c in own if c.question is Question.INSTANT and c.profile is run.method.profile]
        same = same or [c for c in own if c.question is Question.INSTANT and c.profile is Profile.MATCHED]
        if same and all(c.verdict is Verdict.MODEL for c in same):
            return f"instant: {same[0].why}"
        return ""


def _references(runs: Sequence[Run]) -> dict[Question, list[Run]]:
    """Answered reference runs per question: the best first, then those that bound its uncertainty and its horizon."""
    found: dict[Question, list[Run]] = {}
    for question in Question:
        answered = [r for r in runs if r.engine == REFERENCE and r.question is question and r.status is Status.ANSWERED]
        if not answered:
            continue
        headline = [r for r in answered if r.method == answered[0].method]
        others = [r for r in answered if r.method != answered[0].method]
        # the coarsest tolerance is there for work-precision; the uncertainty is that of the finer ones
        found[question] = [headline[-1], *headline[1:-1], *others]
    return found


def _without_answer(group: Sequence[Run]) -> Comparison:
    """Verdict of a group that cannot be compared."""
    bad = next((run for run in group if run.status is not Status.ANSWERED), None)
    run = bad or group[0]
    verdict = Verdict.UNSUPPORTED if run.status is Status.UNSUPPORTED else Verdict.FAILED
    if bad is None:
        verdict = Verdict.UNRESOLVED
    return Comparison(
        case=run.case,
        engine=run.engine,
        question=run.question,
        method=run.method.name if run.method else "",
        route=run.method.route if run.method else None,
        profile=run.method.profile if run.method else Profile.MATCHED,
        verdict=verdict,
        why=run.reason if bad else "the reference did not answer",
    )
