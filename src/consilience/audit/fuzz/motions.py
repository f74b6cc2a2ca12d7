"""Motions of mechanisms with contacts: the reference from event to event and by time stepping, then each engine.

The two formulations are compared as in `consilience.audit.formulations.contacts`; the engines are asked by their first
methods and judged as cells of a suite. Where the laws leave a motion open, or the formulations do not agree, engines
are unresolved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from consilience.audit.formulations.contacts import OPEN, REASONS, TOLERANCE, compare_motions, reason_of
from consilience.audit.fuzz.judging import JudgedComparison, kind_of
from consilience.audit.fuzz.workers import QUESTIONS
from consilience.case import Case
from consilience.compare import Comparison, Verdict
from consilience.compare.judge import REFERENCE, judge_case, reference_motion
from consilience.compare.result import digits_of
from consilience.engine import Method, Profile, Question, Route, Run, TrajectoryAnswer
from consilience.engine.worker.client import EngineHandle, Worker, with_each
from consilience.engine.worker.requests import Request
from consilience.errors import NumericalFailure
from consilience.mechanism import ContactLaw, State, characteristic_length
from consilience.reference.engine import TIME_STEPPING
from consilience.suite import Thoroughness, ask_case
from consilience.suite.other_laws import runs_under_other_laws, with_law

THREE_LEVELS = Thoroughness(methods=1, closer=False)
"""What is asked: motions by the first method of each engine, at its first levels; what they leave open stays so."""

_QUESTIONS = (*QUESTIONS, Question.TRAJECTORY)

_EVENTS = Method("from event to event", Route.REFERENCE)


def judge_motions(cases: Sequence[Case], engines: Mapping[str, Worker]) -> list[list[JudgedComparison]]:
    """Ask for the motions of all cases at the same time, and judge them; comparisons of the reference come first.

    Parameters
    ----------
    cases : sequence of Case
    engines : mapping of name to Worker
        The reference among them.
    """
    return with_each(lambda case: _of_case(case, engines), cases, engines.values(), len(cases))


def _of_case(case: Case, engines: Mapping[str, Worker]) -> list[JudgedComparison]:
    """Ask for the motion of a case, and judge it."""
    entries, mechanism = list[JudgedComparison](), case.mechanism
    if mechanism.contacts or mechanism.stops or mechanism.dry_frictions:
        entries.append(compare_formulations(case, engines[REFERENCE]))
        if entries[0].verdict is not Verdict.AGREES:
            why = f"the formulations of the reference do not agree: {entries[0].why}"
            return entries + [_entry(name, "", Verdict.UNRESOLVED, why) for name in engines if name != REFERENCE]
    compared = [one for one in judge_case(case, _runs(case, engines)) if one.question is Question.TRAJECTORY]
    return entries + [_judged(one) for one in compared]


def compare_formulations(case: Case, reference: EngineHandle) -> JudgedComparison:
    """Compare the motion of the reference from event to event with its motion by time stepping, by Moreau's impacts."""
    mechanism = with_law(case.mechanism, ContactLaw(impact_law="moreau"))

    def solve(state: State, steps: int) -> TrajectoryAnswer:
        """Ask for the motion from a state, by time stepping where there are steps."""
        method, step = (TIME_STEPPING, case.sample / steps) if steps else (_EVENTS, TOLERANCE)
        reply = reference.ask(Request(mechanism, Question.TRAJECTORY, method, [state], case.times, step))
        if isinstance(reply.value, TrajectoryAnswer):
            return reply.value
        raise NumericalFailure(reply.reason)

    found = compare_motions(case.seed, mechanism, case.initial_state, solve)
    if found.reason:
        verdict = Verdict.UNRESOLVED if found.reason in OPEN else Verdict.FAILED
        why = f"{REASONS[found.reason]}{': ' if found.message else ''}{found.message}"
        return _entry(REFERENCE, TIME_STEPPING.name, verdict, why, found.reason)
    verdict = Verdict.AGREES if found.agrees else Verdict.MODEL
    why = f"positions differ by {found.difference:.2g} m, band {found.band:.2g} m"
    digits = digits_of(found.difference / characteristic_length(mechanism))
    return _entry(REFERENCE, TIME_STEPPING.name, verdict, why, "" if found.agrees else "motion", digits)


def _runs(case: Case, engines: Mapping[str, EngineHandle]) -> list[Run]:
    """Ask all questions: what an engine loses at `model` or `instant` may explain its motion."""
    reference = engines[REFERENCE]
    runs = list(ask_case(reference, case, _QUESTIONS, THREE_LEVELS))
    motion = reference_motion(case, runs)
    for name, engine in engines.items():
        if name != REFERENCE:
            own = list(ask_case(engine, case, _QUESTIONS, THREE_LEVELS, reference_motion=motion))
            runs += [*own, *runs_under_other_laws(reference, case, own)]
    return runs


def _judged(one: Comparison) -> JudgedComparison:
    """Return a comparison of motions; a refusal of the reference that names what the laws leave open is no failure."""
    is_open = one.engine == REFERENCE and one.verdict is Verdict.FAILED and reason_of(one.why) in OPEN
    verdict = Verdict.UNRESOLVED if is_open else one.verdict
    quantity = one.rule or (kind_of(one.why) if verdict is Verdict.FAILED else "")
    return _entry(one.engine, one.method, verdict, one.why, quantity, one.digits, one.profile)


def _entry(
    engine: str,
    method: str,
    verdict: Verdict,
    why: str,
    quantity: str = "",
    digits: float | None = None,
    profile: Profile = Profile.MATCHED,
) -> JudgedComparison:
    """Return a comparison of motions with the reference.

    Parameters
    ----------
    engine, method : str
    verdict : Verdict
    why : str
    quantity : str
        Rule of the verdict, or what is missed.
    digits : float, optional
    profile : Profile
    """
    return JudgedComparison(engine, method, REFERENCE, Question.TRAJECTORY, profile, verdict, quantity, why, digits)
