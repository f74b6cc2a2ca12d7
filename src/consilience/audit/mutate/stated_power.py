"""Stated power against planted errors: an engine gets the mechanism with one parameter off, and is judged as in a run.

Every answer that a run passes over states the smallest error of each kind of parameter that it would have noticed
(docs/verdicts.md). At three times that error the verdict must be one that a run does not pass over, at 0.3 times one
that it does. The mechanism is changed on its way to the adapter; the reference is that of the unchanged one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from consilience.case import Case
from consilience.compare import Comparison, Power, Verdict, grouped, markdown_table
from consilience.compare.judge import REFERENCE, judge_method, question_judge, reference_motion
from consilience.compare.power import MEASURED
from consilience.engine import Method, Profile, Question, Run
from consilience.engine.worker.client import EngineHandle, InProcessEngine, Reply, Worker
from consilience.engine.worker.requests import Request
from consilience.mechanism import PhysicalParameter, physical_parameters
from consilience.suite.engine_runs import EngineCase, ask_case, levels_of, open_plan

FACTORS = (3.0, 0.3)
"""Sizes of planted errors over the stated one."""

RIGHT = 0.95
"""Least share of planted errors that must be caught, or passed, as stated."""

PASSED = (Verdict.AGREES, Verdict.DISCRETISATION, Verdict.REGULARISATION)
"""Verdicts that a run passes over."""


@dataclass(frozen=True)
class PowerTrial:
    """One planted error.

    Attributes
    ----------
    stated : Power
        Smallest error that would have been noticed, as the comparison of the correct engine states it.
    factor : float
        Size of the planted error over the stated one.
    verdict : Verdict
    rule, why : str
        Of the verdict.
    """

    case: str
    engine: str
    question: Question
    method: str
    stated: Power
    factor: float
    verdict: Verdict
    rule: str
    why: str

    @property
    def right(self) -> bool:
        """Whether an error larger than the stated one is caught, and a smaller one passed."""
        return (self.verdict not in PASSED) == (self.factor > 1.0)


@dataclass(eq=False)
class PlantedEngine:
    """An engine that gets every mechanism with one parameter off."""

    handle: EngineHandle
    parameter: PhysicalParameter
    size: float
    engine: str

    def ask(self, request: Request) -> Reply:
        """Let the engine do the changed job."""
        if request.mechanism is None:
            return self.handle.ask(request)
        changed = self.parameter.perturbed(request.mechanism, request.states, self.size)
        if changed is None:
            return Reply(None, False, "the mechanism with the error cannot be assembled")
        return self.handle.ask(replace(request, mechanism=changed[0], states=changed[1]))


@dataclass(frozen=True, eq=False)
class JudgedEngine:
    """An engine and the answers of the reference about one case."""

    asked: EngineCase
    references: Sequence[Run]
    before: Sequence[Comparison] = ()  # of the earlier questions

    def compared(self, question: Question, method: Method, planted: PlantedEngine | None = None) -> Comparison | None:
        """Ask by a method as a suite does, with or without an error, and compare; None without a reference."""
        case = self.asked.case
        judge = question_judge(case, self.references, question, self.before)
        if judge is None:
            return None
        asked = self.asked if planted is None else replace(self.asked, worker=planted)
        return judge_method(case, judge, list(asked.ladder(question, method, levels_of(case, question, method))))


def trials(
    cases: Sequence[Case], engine: str, questions: Sequence[Question] = MEASURED, limit: float = 180.0
) -> Iterator[PowerTrial]:
    """Yield the trials of one engine on the cases: all matched methods, all parameters that it states.

    Parameters
    ----------
    cases : sequence of Case
    engine : str
    questions : sequence of Question
    limit : float, s
        Time limit of one answer.
    """
    reference = InProcessEngine(REFERENCE)
    with Worker(engine, limit) as worker:
        for case in cases:
            runs = list(ask_case(reference, case, questions))
            plan = open_plan(worker, case)
            if isinstance(plan, str):
                continue
            asked = EngineCase(worker, case, plan, reference_motion=reference_motion(case, runs))
            judged = JudgedEngine(asked, runs)
            parameters = {p.of: p for p in physical_parameters(case.mechanism, case.initial_state)}
            for question in questions:
                for method in plan.methods.get(question, ()):
                    if method.profile is Profile.MATCHED:
                        yield from _trials(judged, question, method, parameters)


def _trials(
    judged: JudgedEngine, question: Question, method: Method, parameters: dict[str, PhysicalParameter]
) -> Iterator[PowerTrial]:
    """Yield the trials of one method; none where the correct engine is not passed over."""
    stated = judged.compared(question, method)
    if stated is None or stated.verdict not in PASSED:
        return
    for power in stated.power:
        for factor in FACTORS if not power.missed else ():
            yield planted_trial(judged, question, method, power, parameters[power.of], factor)


def planted_trial(
    judged: JudgedEngine, question: Question, method: Method, power: Power, parameter: PhysicalParameter, factor: float
) -> PowerTrial:
    """Return the trial of an error of some times the stated size in a parameter.

    Parameters
    ----------
    judged : JudgedEngine
    question, method : Question, Method
        What the engine is asked, and how.
    power : Power
        Stated size of the least error that would have been noticed.
    parameter : PhysicalParameter
        Parameter that `power` is about.
    factor : float
        Planted error over the stated size.
    """
    worker = judged.asked.worker
    found = judged.compared(question, method, PlantedEngine(worker, parameter, factor * power.limit, worker.engine))
    assert found is not None
    return PowerTrial(
        *(found.case, worker.engine, question, method.name, power, factor), *(found.verdict, found.rule, found.why)
    )


def share(found: Sequence[PowerTrial]) -> float:
    """Return the share of planted errors that are caught, or passed, as stated."""
    return sum(t.right for t in found) / len(found)


def exit_code(found: Sequence[PowerTrial]) -> int:
    """Return 0 if enough trials are right, 1 if not, 3 without any trial."""
    if not found:
        return 3
    return 0 if share(found) >= RIGHT else 1


def table(found: Sequence[PowerTrial]) -> str:
    """Return Markdown: shares by engine and question, and the trials that are not right."""
    groups = grouped(found, lambda t: (t.engine, str(t.question)))
    rows = [
        (*key, len(group), f"{100.0 * share(group):.1f} %")
        for key, group in [*groups.items(), *([(("all", ""), list(found))] if found else [])]
    ]
    wrong = [
        (
            *(t.case, t.engine, str(t.question), t.method, t.stated.of),
            *(f"{t.stated.limit:.2g}", f"{t.factor:g}", str(t.verdict), t.why),
        )
        for t in found
        if not t.right
    ]
    heads = ("case", "engine", "question", "method", "error", "stated", "times", "verdict", "why")
    return "\n".join(
        [
            *markdown_table(("engine", "question", "planted errors", "as stated"), rows, "llrr"),
            *(["", *markdown_table(heads, wrong, "lllllrrll")] if wrong else []),
            "",
        ]
    )
