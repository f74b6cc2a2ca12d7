"""Plan and execute many runs: every case, engine, question, method and level; then compare.

Each engine has its own worker, and does one job at a time; `jobs` engines work at once, each on the first case it has
not done. On a cluster an engine works on many cases at once, wherever there is room. The reference is asked first: what
is decided by a few levels of an engine needs no more of them. A case is judged as soon as all engines are through with
it, while they go on with the next ones.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from queue import SimpleQueue
from threading import Condition, Lock
from typing import TYPE_CHECKING

from consilience.case import Case
from consilience.compare import Comparison, Yardstick
from consilience.compare.judge import REFERENCE, judge_case, yardstick
from consilience.engine import EngineInfo, Question, Run, Status, TrajectoryAnswer
from consilience.engine.worker.client import MEMORY, EngineHandle, InProcessEngine, Request, Worker, WorkerHandle
from consilience.errors import ConsilienceError
from consilience.suite.engine_runs import FULL, EngineCase, Thoroughness, ask_case, open_plan
from consilience.suite.store import Store
from consilience.suite.warm_up import compiled, compiled_beside

_LOG = logging.getLogger(__name__)

if TYPE_CHECKING:
    from consilience.suite.cluster import Cluster

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
    effort: Thoroughness = FULL


AHEAD = 2
"""Cases that the reference is ahead of the engines, if it can be."""


class _Schedule:
    """Who does what next: of the idle engines the one that is furthest behind takes its next case.

    So cases are complete one after the other, and no engine is left with a long list at the end. The first engine has
    to be through with a case before others take it, and goes ahead of them.
    """

    def __init__(self, engines: Sequence[str], cases: int, together: int) -> None:
        self._next = dict.fromkeys(engines, 0)
        self._first, self._through = engines[0], [False] * cases
        self._cases, self._together = cases, together
        self._busy: Counter[str] = Counter()
        self._changed = Condition()
        self._open = True

    def take(self) -> tuple[str, int] | None:
        """An engine and the number of a case; waits while all engines with work left are busy; None at the end."""
        with self._changed:
            while self._open:
                left = [name for name, case in self._next.items() if case < self._cases]
                if not left:
                    return None
                idle = [name for name in left if self._busy[name] < self._together and self._ready(name)]
                if idle:
                    name = min(idle, key=lambda engine: self._next[engine] - AHEAD * (engine == self._first))
                    self._busy[name] += 1
                    self._next[name] += 1
                    return name, self._next[name] - 1
                self._changed.wait()
            return None

    def _ready(self, engine: str) -> bool:
        return engine == self._first or self._through[self._next[engine]]

    def done(self, engine: str, case: int, dead: bool = False) -> None:
        """The engine is idle again; a dead one gets nothing more."""
        with self._changed:
            self._busy[engine] -= 1
            if dead:
                self._next[engine] = self._cases
            if engine == self._first:
                self._through = [True] * self._cases if dead else self._through
                self._through[case] = True
            self._changed.notify_all()

    def close(self) -> None:
        """Give out nothing more."""
        with self._changed:
            self._open = False
            self._changed.notify_all()


class _Suite:
    """A suite at work: what threads share."""

    def __init__(
        self,
        results: Results,
        workers: Mapping[str, WorkerHandle],
        effort: Thoroughness,
        store: Store | None,
        together: int,
    ) -> None:
        self.results, self.workers, self.effort, self.store = results, workers, effort, store
        self.schedule = _Schedule(list(workers), len(results.cases), together)
        self.finished: SimpleQueue[tuple[str, int, list[Run]] | None] = SimpleQueue()
        self._doors = {name: Lock() for name in workers}
        self._yards: dict[int, Yardstick | None] = {}

    def work(self) -> None:
        """Do jobs until there are none."""
        try:
            while (job := self.schedule.take()) is not None:
                name, number = job
                _LOG.info("%s: takes %s", name, self.results.cases[number].name)
                alive = self._introduced(name)
                runs = self._ask(name, number) if alive else []
                self.schedule.done(name, number, dead=not alive)
                self.finished.put((name, number, runs))
        finally:
            self.schedule.close()
            self.finished.put(None)

    def _introduced(self, name: str) -> bool:
        """Whether an engine has started and said who it is."""
        with self._doors[name]:  # once, however many ask for it
            if name in self.results.missing:
                return False
            if name not in self.results.engines:
                reply = self.workers[name].ask(Request())
                if not isinstance(reply.value, EngineInfo):
                    what = f"info() gave a {type(reply.value).__name__}, not an EngineInfo"
                    self.results.missing[name] = reply.reason or what
                    return False
                self.results.engines[name] = reply.value
        return True

    def _ask(self, name: str, number: int) -> list[Run]:
        results, worker = self.results, self.workers[name]
        case, info = results.cases[number], results.engines[name]
        yard = self._yards.get(number)
        runs = list(ask_case(worker, case, results.questions, self.effort, self.store, info, yard))
        if name == REFERENCE and self.effort.closer:
            self._yards[number] = yardstick(case, runs)
        return runs


def run_suite(
    cases: Sequence[Case],
    engines: Sequence[str],
    questions: Sequence[Question] = tuple(Question),
    jobs: int = 2,
    limit: float = 180.0,
    progress: Progress | None = None,
    effort: Thoroughness = FULL,
    store: Store | None = None,
    memory: int = MEMORY,
    cluster: Cluster | None = None,
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
    store : Store, optional
        Answers that are there already are not asked for; new ones are kept.
    memory : int, bytes
        Resident memory that an engine may use.
    cluster : Cluster, optional
        Where the engines are; as many work at a time as it has threads.
    """
    cases = [effort.case(case) for case in cases]
    names = [REFERENCE, *(name for name in engines if name != REFERENCE)]
    for case in cases:
        # assembled here, before any worker starts: a case that cannot be assembled is bad input, not a failed run
        _ = case.states if Question.INSTANT in questions else case.initial_state
    results = Results(cases, list(questions), effort=effort)
    found: dict[tuple[str, int], list[Run]] = {}
    judged: dict[int, list[Comparison]] = {}
    together = 1 if cluster is None else len(cases)
    jobs = min(jobs, len(names)) if cluster is None else min(cluster.tasks, len(names) * len(cases))
    cold = jobs > 1 and cluster is None and Question.TRAJECTORY in questions and not compiled()
    with (
        compiled_beside(cases, limit, memory) if cold else nullcontext(),
        _workers(names, limit, memory, cluster) as workers,
        closing(_in_parallel(_Suite(results, workers, effort, store, together), jobs)) as done,
    ):
        for name, number, runs in done:
            found[name, number] = runs
            if progress is not None:
                progress(name, cases[number].name)
            if all((other, number) in found or other in results.missing for other in names):
                judged[number] = _judged(cases[number], names, number, found)
                _LOG.info("%s: judged", cases[number].name)
    for number, case in enumerate(cases):
        results.comparisons += judged[number] if number in judged else _judged(case, names, number, found)
    results.runs = [run for name in names for n in range(len(cases)) for run in found.get((name, n), [])]
    results.engines = {name: results.engines[name] for name in names if name in results.engines}
    return results


def _judged(case: Case, names: Sequence[str], number: int, found: dict[tuple[str, int], list[Run]]) -> list[Comparison]:
    return judge_case(case, [run for name in names for run in found.get((name, number), [])])


@contextmanager
def _workers(
    names: Sequence[str], limit: float, memory: int, cluster: Cluster | None
) -> Iterator[Mapping[str, WorkerHandle]]:
    """A worker for each engine; none outlives the suite."""
    make = Worker if cluster is None else cluster.worker
    workers: dict[str, WorkerHandle] = {name: make(name, limit, memory) for name in names}
    try:
        yield workers
    finally:
        for worker in workers.values():
            worker.stop()


def _in_parallel(suite: _Suite, jobs: int) -> Generator[tuple[str, int, list[Run]]]:
    """What threads finish, as they finish it; an error of ours in one of them ends all."""
    count = max(1, jobs)
    pool = ThreadPoolExecutor(max_workers=count)
    futures: list[Future[None]] = [pool.submit(suite.work) for _ in range(count)]
    try:
        working = count
        while working:
            finished = suite.finished.get()
            if finished is None:
                working -= 1
            else:
                yield finished
        for future in futures:
            future.result()
    except BaseException:  # Ctrl-C above all, here or in whoever takes the results: no engine works for nobody
        suite.schedule.close()
        for worker in suite.workers.values():
            worker.cancel()
        raise
    finally:
        pool.shutdown(wait=True)


def simulate_case(case: Case, engine: str, limit: float) -> tuple[TrajectoryAnswer, str]:
    """Trajectory of a case by an engine's first method at its finest level, and how it was made.

    Raises
    ------
    EngineFailure
        If the engine cannot or did not answer, with its reason.
    """
    if engine.partition(":")[0] == REFERENCE:
        run = _finest(InProcessEngine(engine), case)  # ours: no shield is worth the time to start another process
    else:
        with Worker(engine, limit) as worker:
            run = _finest(worker, case)
    if isinstance(run.answer, TrajectoryAnswer) and run.method is not None:
        kind = "step" if run.method.substeps else "tolerance"
        return run.answer, f"{run.method.name}, {kind} {run.step:g}"
    raise EngineFailure(f"engine '{engine}', case '{case.name}': {run.status}: {run.reason}")


def _finest(worker: EngineHandle, case: Case) -> Run:
    plan = open_plan(worker, case)
    failed = Run(case.name, worker.engine, Question.TRAJECTORY, None, 0, None, Status.FAILED)
    if isinstance(plan, str):
        return replace(failed, reason=plan)
    if plan.unsupported[Question.TRAJECTORY]:
        return next(EngineCase(worker, case, plan).question(Question.TRAJECTORY))
    return EngineCase(worker, case, plan).finest(Question.TRAJECTORY)
