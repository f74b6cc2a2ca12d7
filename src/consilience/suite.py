"""Plan and execute many runs: every case, engine, question, method and level; then compare.

Each engine works through its own list in its own worker; `jobs` of them at a time. A job that fails is one failed
run, and the list goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TypeVar

from consilience.assembly import displaced_states
from consilience.case import Case
from consilience.compare import Comparison
from consilience.compare.horizon import PERTURBATION
from consilience.compare.softness import SCALES
from consilience.compare.uncertainty import needs_another_level
from consilience.errors import ConsilienceError
from consilience.judge import DISPLACED_START, REFERENCE, judge_case
from consilience.mechanism import State
from consilience.run import (
    EngineInfo,
    InstantAnswer,
    Method,
    ModelAnswer,
    Question,
    Run,
    Status,
    TrajectoryAnswer,
    defects,
)
from consilience.worker import Plan, Request, Worker

MOST_LEVELS = 6
LEVEL_BUDGET = 5.0
"""Levels of a ladder at most, and CPU time in s that one more of them may take."""

DISPLACED = 3
"""Displaced motions of the reference: one would miss growth in directions it does not have."""


@dataclass(frozen=True)
class Effort:
    """How thoroughly a suite asks.

    Attributes
    ----------
    methods, reference_methods : int or None
        Ways of an engine to answer a question, and of the reference, the headline first; None: all.
    states : int or None
        States of the question `instant` at most.
    samples : int or None
        Sample intervals of a motion at most.
    closer : bool
        Whether to go on where three levels leave doubt: more levels, other softness, displaced initial states.
    """

    methods: int | None = None
    reference_methods: int | None = None
    states: int | None = None
    samples: int | None = None
    closer: bool = True

    def case(self, case: Case) -> Case:
        """What is asked of a case."""
        if self.states is not None:
            case = replace(case, instants=min(case.instants, self.states))
        if self.samples is not None and len(case.times) > self.samples + 1:
            case = case.with_span(self.samples * case.sample, None)
        return case

    def some(self, methods: Sequence[Method], engine: str) -> Sequence[Method]:
        """Methods that are asked."""
        return methods[: self.reference_methods if engine == REFERENCE else self.methods]


FULL = Effort()

QUICK = Effort(methods=1, reference_methods=2, states=3, samples=5, closer=False)
"""The first quarter of a second or so by the headline of each engine alone: enough to see that something is wrong."""

_T = TypeVar("_T")

Progress = Callable[[str, str], None]
"""Called with the engine and what it has just finished."""


class EngineFailure(ConsilienceError):
    """An engine that was asked for one answer gave none."""


@dataclass
class Results:
    """Everything a suite found out."""

    cases: list[Case]
    questions: list[Question]
    engines: dict[str, EngineInfo] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    runs: list[Run] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)


def run_suite(
    cases: Sequence[Case],
    engines: Sequence[str],
    questions: Sequence[Question] = tuple(Question),
    jobs: int = 2,
    limit: float = 180.0,
    progress: Progress | None = None,
    effort: Effort = FULL,
) -> Results:
    """Ask every engine every question of every case, and compare with the reference.

    Parameters
    ----------
    engines : sequence of str
        The reference is always asked, whether it is named or not.
    jobs : int
        Number of engines that work at a time.
    limit : float, s
        Time limit of one job.
    effort : Effort
    """
    cases = [effort.case(case) for case in cases]
    names = [REFERENCE, *(name for name in engines if name != REFERENCE)]
    results = Results(cases, list(questions))
    for case in cases:
        # assembled here, before any worker starts: a case that cannot be assembled is bad input, not a failed run
        _ = case.states if Question.INSTANT in questions else case.initial_state

    def work(worker: Worker) -> tuple[EngineInfo | str, list[Run]]:
        with worker:  # its process ends with its own list, not with the longest
            return _ask_everything(worker, cases, questions, effort, progress)

    for name, (info, found) in zip(names, _in_parallel(work, [Worker(n, limit) for n in names], jobs), strict=True):
        if isinstance(info, EngineInfo):
            results.engines[name] = info
            results.runs += found
        else:
            results.missing[name] = info
    for case in cases:
        results.comparisons += judge_case(case, [run for run in results.runs if run.case == case.name])
    return results


def _in_parallel(work: Callable[[Worker], _T], workers: Sequence[Worker], jobs: int) -> list[_T]:
    """Let every worker do its work, `jobs` at a time; whatever stops it stops all workers."""
    try:
        with ThreadPoolExecutor(max_workers=max(1, jobs)) as pool:
            try:
                return list(pool.map(work, workers))
            except BaseException:  # Ctrl-C above all: no engine may go on working for nobody
                pool.shutdown(wait=False, cancel_futures=True)
                for worker in workers:
                    worker.cancel()
                raise
    finally:
        for worker in workers:
            worker.stop()


def _ask_everything(
    worker: Worker, cases: Sequence[Case], questions: Sequence[Question], effort: Effort, progress: Progress | None
) -> tuple[EngineInfo | str, list[Run]]:
    """All runs of one engine, or why it does not start."""
    reply = worker.ask(Request())
    if not isinstance(reply.value, EngineInfo):
        return reply.reason or f"info() gave a {type(reply.value).__name__}, not an EngineInfo", []
    found: list[Run] = []
    for case in cases:
        if worker.cancelled:
            break
        found += _runs_of_case(worker, case, questions, effort)
        if progress is not None:
            progress(worker.engine, case.name)
    return reply.value, found


def _runs_of_case(
    worker: Worker, case: Case, questions: Sequence[Question], effort: Effort = FULL, finest: bool = False
) -> Iterator[Run]:
    """Runs of one case; with `finest` only the headline method at its finest level."""
    reply = worker.ask(Request(case.mechanism))
    plan = reply.value
    for question in questions:
        if not isinstance(plan, Plan):
            yield Run(
                case.name, worker.engine, question, None, 0, None, Status.FAILED, reason=reply.reason, log=reply.log
            )
        elif plan.unsupported[question]:
            reason = "; ".join(f"{u.feature}: {u.reason}" for u in plan.unsupported[question])
            yield Run(case.name, worker.engine, question, None, 0, None, Status.UNSUPPORTED, reason=reason)
        else:
            yield from _runs_of_question(worker, case, plan, question, effort, finest)


def _runs_of_question(
    worker: Worker, case: Case, plan: Plan, question: Question, effort: Effort, finest: bool
) -> Iterator[Run]:
    """Every method and level; a question without any is a failed run, so that it cannot vanish from the record."""

    def failed(method: Method | None, reason: str) -> Run:
        return Run(case.name, worker.engine, question, method, 0, None, Status.FAILED, reason=reason)

    methods = plan.methods[question][:1] if finest else effort.some(plan.methods[question], worker.engine)
    if not methods:
        yield failed(None, "the adapter supports the question and offers no method")
    for method in methods:
        levels = _levels(case, question, method)
        if not levels:
            yield failed(method, "the method names no substeps and no tolerances: no level to run")
        elif finest:
            yield _one_run(worker, case, plan, question, method, len(levels) - 1, levels[-1])
        else:
            yield from _ladder(worker, case, plan, question, method, levels, effort.closer)
    if worker.engine == REFERENCE and question is Question.TRAJECTORY and effort.closer and not finest:
        yield from _displaced_runs(worker, case, plan, methods[0])


def open_plan(worker: Worker, case: Case) -> Plan | str:
    """What an engine says about a case before it is asked, or why it says nothing."""
    reply = worker.ask(Request(case.mechanism))
    return reply.value if isinstance(reply.value, Plan) else reply.reason


def ask_ladder(
    worker: Worker, case: Case, plan: Plan, method: Method, steps: Sequence[float] | None = None
) -> Iterator[Run]:
    """Runs of a trajectory method at every level and at other softness; at the given steps alone, if any are given."""
    if steps is None:
        levels = _levels(case, Question.TRAJECTORY, method)
        yield from _ladder(worker, case, plan, Question.TRAJECTORY, method, levels, closer=True)
        return
    for level, step in enumerate(steps):
        yield _one_run(worker, case, plan, Question.TRAJECTORY, method, level, step)


def _ladder(
    worker: Worker,
    case: Case,
    plan: Plan,
    question: Question,
    method: Method,
    levels: list[float | None],
    closer: bool,
) -> Iterator[Run]:
    """Every level of a method; closer: finer ones until the observed order settles, the finest at other softness."""
    runs: list[Run] = []
    for level, step in enumerate(levels):
        runs.append(_one_run(worker, case, plan, question, method, level, step))
        yield runs[-1]
    if not closer:
        return
    while method.substeps and len(runs) < MOST_LEVELS and 2.0 * runs[-1].cpu < LEVEL_BUDGET:
        answers = [run.answer for run in runs if isinstance(run.answer, TrajectoryAnswer)]
        step = runs[-1].step
        if step is None or len(answers) < len(runs) or not needs_another_level(answers, method, [r.step for r in runs]):
            break
        runs.append(_one_run(worker, case, plan, question, method, len(runs), step / 2.0))
        yield runs[-1]
    if method.softness is not None and runs[-1].status is Status.ANSWERED:
        for scale in SCALES[method.profile]:
            softer = replace(method, softness=scale * method.softness)
            yield _one_run(worker, case, plan, question, softer, runs[-1].level, runs[-1].step)


def _displaced_runs(worker: Worker, case: Case, plan: Plan, method: Method) -> Iterator[Run]:
    """The reference from displaced initial states, for the horizon."""
    states = displaced_states(case.mechanism, case.initial_state, PERTURBATION, DISPLACED, case.seed)
    for n, state in enumerate(states):
        name = replace(method, name=f"{method.name}, {DISPLACED_START} {n + 1}", settings={"displaced": PERTURBATION})
        yield replace(
            _one_run(worker, case, plan, Question.TRAJECTORY, method, 0, method.tolerances[-2], state), method=name
        )


def _levels(case: Case, question: Question, method: Method) -> list[float | None]:
    if question is not Question.TRAJECTORY:
        return [None]
    return [case.sample / n for n in method.substeps] or list(method.tolerances)


def _one_run(
    worker: Worker,
    case: Case,
    plan: Plan,
    question: Question,
    method: Method,
    level: int,
    step: float | None,
    start: State | None = None,
) -> Run:
    states = case.states if question is Question.INSTANT else [start or case.initial_state]
    count = {Question.MODEL: 1, Question.INSTANT: len(states), Question.TRAJECTORY: len(case.times)}[question]
    reply = worker.ask(Request(case.mechanism, question, method, states, case.times, step or 0.0))
    reason = reply.reason
    if reply.returned:
        reason = "; ".join(defects(reply.value, question, case.mechanism, count))
    answered = isinstance(reply.value, ModelAnswer | InstantAnswer | TrajectoryAnswer) and not reason
    return Run(
        case=case.name,
        engine=worker.engine,
        question=question,
        method=method,
        level=level,
        step=step,
        status=Status.ANSWERED if answered else Status.FAILED,
        answer=reply.value if answered else None,  # type: ignore[arg-type]
        reason=reason,
        manifest=plan.manifest,
        cpu=reply.cpu,
        log=reply.log,
    )


def simulate_case(case: Case, engine: str, limit: float) -> tuple[TrajectoryAnswer, str]:
    """Trajectory of a case by an engine's first method at its finest level, and how it was made.

    Raises
    ------
    EngineFailure
        If the engine cannot or did not answer, with its reason.
    """
    with Worker(engine, limit) as worker:
        (run,) = _runs_of_case(worker, case, [Question.TRAJECTORY], finest=True)
    if isinstance(run.answer, TrajectoryAnswer) and run.method is not None:
        kind = "step" if run.method.substeps else "tolerance"
        return run.answer, f"{run.method.name}, {kind} {run.step:g}"
    raise EngineFailure(f"engine '{engine}', case '{case.name}': {run.status}: {run.reason}")
