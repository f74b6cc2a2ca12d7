"""Judge a case: compare all runs of the engines with those of the reference.

The answers of the reference are sorted first: the best one is the reference of the others, which bound its uncertainty;
its motions from displaced states give the horizon. The questions are judged in the order of the table, so that the
judge of a motion knows in which questions without integration the engine differs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from numpy.linalg import LinAlgError

from consilience.case import Case
from consilience.compare.horizon import growth
from consilience.compare.instant import SOFTENED
from consilience.compare.other_methods import reconsidered
from consilience.compare.power import sensitivities
from consilience.compare.published import against_published, dispute
from consilience.compare.reference_motion import ReferenceMotion
from consilience.compare.result import CoarserLevel, Comparison, Quantity, Verdict
from consilience.compare.rules import CONVERGENCE, rate_text
from consilience.compare.trajectory import spread_over_time
from consilience.engine import Profile, Question, Run, Status, load_named
from consilience.engine.failures import AT_A_STATE, failure_class
from consilience.errors import ConsilienceError
from consilience.mechanism import is_singular, singular_pose

FAULTS_OF_A_CASE = (ConsilienceError, ArithmeticError, LinAlgError)
"""What the numbers of one case can raise in the harness; the other cases have their answers nevertheless."""

REFERENCE = "reference"

DISPLACED_START = "displaced start"
"""Part of the names of the reference's motions from displaced states."""


class Judge(Protocol):
    """Judge of one question of one case, see `judges.QuestionJudge`."""

    def compare(self, levels: Sequence[Run], softer: Sequence[Run]) -> Comparison:
        """Compare the answers of an engine by one method with the reference."""
        ...

    def coarser(self, runs: Sequence[Run]) -> tuple[CoarserLevel, ...]:
        """Compare motions at longer steps than those of the levels with the reference, without judging them."""
        ...


def judge_case(case: Case, runs: Sequence[Run]) -> list[Comparison]:
    """Compare all runs of a case with the reference, question by question."""
    found: list[Comparison] = []
    for question in Question:
        groups: dict[tuple[str, str], list[Run]] = {}
        for run in runs:
            if run.question is question and not _auxiliary(run):
                groups.setdefault((run.engine, run.method.name if run.method else ""), []).append(run)
        references = _references(runs, question)
        judged: list[Comparison] = []
        try:
            judge = question_judge(case, runs, question, found) if groups else None
            for group in groups.values():
                if judge is None or group[0] is not references[0]:  # the best reference is not compared with itself
                    judged.append(judge_method(case, judge, group))
        except FAULTS_OF_A_CASE as error:
            judged = [_unjudged(_without_answer(case, group), error) for group in groups.values()]
        found += judged
        if question is Question.INSTANT:
            found = reconsidered(found)
    return found


def question_judge(
    case: Case, runs: Sequence[Run], question: Question, before: Sequence[Comparison] = ()
) -> Judge | None:
    """Return the judge of a question, by the runs of the reference; None without an answer of the reference.

    Parameters
    ----------
    case : Case
    runs : sequence of Run
    question : Question
    before : sequence of Comparison
        Comparisons of the earlier questions.
    """
    references = _references(runs, question)
    return load_named(question.judge)(case, references, tuple(before)) if references else None


def judge_method(case: Case, judge: Judge | None, runs: Sequence[Run]) -> Comparison:
    """Compare the runs of one engine by one method: levels, the finest with other softness, other steps."""
    coarser = [r for r in runs if r.level < 0]
    if coarser and judge is not None:
        judged = judge_method(case, judge, [r for r in runs if r.level >= 0])
        return replace(judged, coarser=judge.coarser(coarser))
    coprime = [r for r in runs if r.coprime and r.answer is not None]
    levels, softer = ladder_of(case, [r for r in runs if not r.coprime])
    if judge is None or any(run.status is not Status.ANSWERED for run in levels):
        return _without_answer(case, levels)
    died = next((run for run in softer if run.status is not Status.ANSWERED), None)
    if died is None:
        return judge.compare([*levels, *coprime], softer)
    return _softness_unknown(judge.compare([*levels, *coprime], []), died)


def ladder_of(case: Case, runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    """Return the levels of the last ladder of a method, coarse to fine, and the runs at other softness beside them."""
    levels = [r for r in runs if not _softened(r)]
    softer = [r for r in runs if _softened(r) and r.step == levels[-1].step]
    return stable_levels(case, levels), softer


def _softness_unknown(one: Comparison, died: Run) -> Comparison:
    """Return a comparison, unresolved if softness could explain its difference, since a run at other softness died."""
    missed = [q.name for q in one.quantities if not q.met]
    possible = one.rule in CONVERGENCE or (one.question is Question.INSTANT and SOFTENED.issuperset(missed))
    if one.verdict is not Verdict.MODEL or not possible:
        return one
    why = f"{one.why}; softness might explain it, but the run at other softness failed: {died.reason}"
    return replace(one, verdict=Verdict.UNRESOLVED, rule="softness unclear", why=why)


STABLE = 2.0
"""Largest product of step and rate at which explicit methods of order one are stable; those of order four to 2.8."""

JUMP = 3.0
"""Ratio of consecutive steps of levels above which a ladder begins anew."""


def stable_levels(case: Case, levels: Sequence[Run]) -> list[Run]:
    """Return the levels of the last ladder of a method, without coarse ones at whose steps no method need be stable.

    Where no step of a ladder is stable, or none resolves the fastest rate, a second ladder begins at finer steps.
    """
    method, levels = levels[0].method, list(levels)
    if method is None or not method.substeps:
        return levels
    steps = [run.step or 0.0 for run in levels]
    first = max((n for n in range(1, len(steps)) if steps[n - 1] > JUMP * steps[n]), default=0)
    last = levels[first:]
    failed = [n for n, run in enumerate(last) if run.answer is None]
    if not failed or failed[-1] == len(last) - 1 or not unstable(case, last[failed[-1]]):
        return last
    return last[failed[-1] + 1 :]


def unstable(case: Case, run: Run) -> bool:
    """Whether the step of a run is beyond stability for the fastest rate at the start of the case."""
    return run.step is not None and run.step * case.fastest_rate > STABLE


def _unjudged(comparison: Comparison, error: Exception) -> Comparison:
    """Return the comparison of a method without a verdict; what it failed by is more than why it cannot be judged."""
    is_answered = comparison.rule == "" and comparison.verdict is Verdict.UNRESOLVED
    return replace(comparison, why=f"it cannot be judged: {error}") if is_answered else comparison


def reference_motion(case: Case, runs: Sequence[Run]) -> ReferenceMotion | None:
    """Return the reference motion of a case from the runs of the reference; None without an answer."""
    references = _references(runs, Question.TRAJECTORY)
    try:
        return reference_motion_of(case, references)[0] if references else None
    except FAULTS_OF_A_CASE:  # the comparisons of the case say what it is
        return None


def reference_motion_of(case: Case, references: Sequence[Run]) -> tuple[ReferenceMotion, tuple[Quantity, ...]]:
    """Return the best motion with its uncertainty and horizon, and its differences to published values."""
    mechanism = case.mechanism
    motions = [run.answer for run in references if not _auxiliary(run)]
    displaced = [run.answer for run in references if _displaced(run)]
    spread = spread_over_time(mechanism, motions)
    known = against_published(mechanism, case.published, motions, spread)
    growing = growth(mechanism, motions[0], displaced)
    acting = sensitivities(mechanism, [r for r in references if not _displaced(r) and not under_other_law(r)])
    return ReferenceMotion(motions[0], spread, case.digits, growing, dispute(known), acting), known


def _displaced(run: Run) -> bool:
    return run.engine == REFERENCE and run.method is not None and DISPLACED_START in run.method.name


def under_other_law(run: Run) -> bool:
    """Whether a run of the reference is about the mechanism with a law of contact that is not the case's."""
    return run.engine == REFERENCE and run.method is not None and run.method.law is not None


def _auxiliary(run: Run) -> bool:
    """Whether a run of the reference is about another start or another mechanism, and is not judged itself."""
    return run.perturbation is not None or _displaced(run) or under_other_law(run)


def _softened(run: Run) -> bool:
    return run.method is not None and run.method.softness not in (None, 1.0)


def _references(runs: Sequence[Run], question: Question) -> list[Run]:
    """Return the answered runs of the reference: the best first, then those that bound its uncertainty and horizon.

    Then those about mechanisms with an error, for the power of comparisons, and those under other laws of contact; none
    without the best one.
    """
    given = [r for r in runs if r.engine == REFERENCE and r.question is question and r.status is Status.ANSWERED]
    answered = [r for r in given if r.perturbation is None and not under_other_law(r)]
    perturbed = [r for r in given if r.perturbation is not None]
    laws = [r for r in given if under_other_law(r)]
    if all(_displaced(r) for r in answered):
        return []
    headline = [r for r in answered if r.method == answered[0].method]
    others = [r for r in answered if r.method != answered[0].method]
    # the coarsest tolerance serves the work-precision plot alone and does not bound the uncertainty
    return [*headline[-1:], *headline[1:-1], *others, *perturbed, *laws]


_WITHOUT_ANSWER = {
    Status.ANSWERED: Verdict.UNRESOLVED,
    Status.UNSUPPORTED: Verdict.UNSUPPORTED,
    Status.FAILED: Verdict.FAILED,
}
"""Verdict of a group of runs without an answer, or (where all have answered) without a reference."""


def _without_answer(case: Case, group: Sequence[Run]) -> Comparison:
    """Return the comparison of a group without answers, or without a reference.

    A motion that fails at steps at which no method need be stable is unresolved; so are instants, and motions from
    there, that the reference does not answer at singular poses, instants of a mechanism that has no other state than
    such a pose, and motions from there at which an engine stops.
    """
    run = next((run for run in group if run.status is not Status.ANSWERED), group[0])
    stops = run.question.over_time and failure_class(run.reason) in AT_A_STATE
    stops = stops or (run.question.at_states and run.reason == case.undrawn != "")
    if run.question is not Question.MODEL and (run.engine == REFERENCE or run.status is Status.ANSWERED or stops):
        why = at_singular_pose(case, run.question)
        if why:
            why = f"{why}; {run.reason}" if stops else why
            return replace(_blank(run), verdict=Verdict.UNRESOLVED, rule="singular pose", why=why)
    if run.status is Status.FAILED and run.method is not None and run.method.substeps and unstable(case, run):
        text = rate_text(run.step or 0.0, case.fastest_rate)
        return replace(_blank(run), verdict=Verdict.UNRESOLVED, rule="unresolved rate", why=f"{text}; {run.reason}")
    return _blank(run)


def at_singular_pose(case: Case, question: Question = Question.INSTANT) -> str:
    """Say which state of a question is the first at a singular pose, and what it is; nothing if none is known."""
    if case.unassembled:  # the reason is that of the failed runs
        return ""
    states = case.states if question.at_states and not case.undrawn else [case.initial_state]
    for n, state in enumerate(states):
        if is_singular(case.mechanism, state):
            return f"state {n} is at a singular pose ({singular_pose(case.mechanism, state)}): accelerations are open"
    return ""


def _blank(run: Run) -> Comparison:
    """Return the comparison of a run without an answer, or without a reference."""
    return Comparison(
        case=run.case,
        engine=run.engine,
        question=run.question,
        method=run.method.name if run.method else "",
        route=run.method.route if run.method else None,
        profile=run.method.profile if run.method else Profile.MATCHED,
        verdict=_WITHOUT_ANSWER[run.status],
        why="the reference did not answer" if run.status is Status.ANSWERED else run.reason,
    )
