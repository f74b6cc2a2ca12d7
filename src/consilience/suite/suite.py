"""Execution of a suite: runs of all cases, engines, questions, methods and levels, and their comparison.

Each engine has a worker of its own and does one job at a time; `jobs` engines work at the same time, each on its first
open case. On a cluster an engine works on many cases at the same time. The reference is asked first, because with its
motion a few levels of an engine often decide the verdict. A case is judged when all engines have answered, while they
work on the next cases.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import Condition, Lock
from typing import TYPE_CHECKING, NamedTuple

from consilience.case import Case
from consilience.compare import Comparison, ReferenceMotion
from consilience.compare.judge import REFERENCE, judge_case, reference_motion, under_other_law
from consilience.engine import EngineInfo, Profile, Question, Run, Status, TrajectoryAnswer
from consilience.engine.worker.client import MEMORY, InProcessEngine, Request, Worker, WorkerHandle
from consilience.errors import ConsilienceError, InvalidInput, require
from consilience.suite.dense import densely_sampled, finest_motion
from consilience.suite.engine_runs import ask_case
from consilience.suite.other_laws import runs_under_other_laws
from consilience.suite.store import Store
from consilience.suite.thoroughness import FULL, Thoroughness
from consilience.suite.warm_up import compiled, compiled_beside

_LOG = logging.getLogger(__name__)

if TYPE_CHECKING:
    from consilience.suite.cluster import Cluster

Progress = Callable[[str, str], None]
"""Function that is called with the names of an engine and of the case that it has finished."""


class EngineFailure(ConsilienceError):
    """An engine gave no answer."""


@dataclass(repr=False)
class Results:
    """Runs and comparisons of a suite, with the engines that started and those that did not."""

    cases: list[Case]
    questions: list[Question]
    engines: dict[str, EngineInfo] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    runs: list[Run] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    thoroughness: Thoroughness = FULL
    dense: dict[str, TrajectoryAnswer] = field(default_factory=dict)
    """Motions of the reference by case, at samples close enough to draw."""

    def __repr__(self) -> str:
        counts = Counter(str(c.verdict) for c in self.comparisons)
        told = "".join(f", {n} {verdict}" for verdict, n in counts.items())
        return f"Results of {len(self.cases)} cases on {', '.join(self.engines)}: {len(self.comparisons)} answers{told}"


AHEAD = 2
"""Number of cases by which the reference goes ahead of the engines, if possible."""


class _Schedule:
    """Order of the work: the idle engine with the fewest finished cases takes its next case.

    So cases are completed one after the other, and no engine has many left at the end. The first engine goes ahead: the
    others take a case only when the first engine has finished it.
    """

    def __init__(self, engines: Sequence[str], cases: int, together: int) -> None:
        self._next = dict.fromkeys(engines, 0)
        self._first, self._through = engines[0], [False] * cases
        self._cases, self._together = cases, together
        self._busy: Counter[str] = Counter()
        self._changed = Condition()
        self._open = True

    def take(self) -> tuple[str, int] | None:
        """Return an engine and the number of its next case; wait while there is none; None at the end."""
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
        """Mark an engine as idle again; a dead engine gets no more cases."""
        with self._changed:
            self._busy[engine] -= 1
            if dead:
                self._next[engine] = self._cases
            if engine == self._first:
                self._through = [True] * self._cases if dead else self._through
                self._through[case] = True
            self._changed.notify_all()

    def close(self) -> None:
        """Give out no more cases."""
        with self._changed:
            self._open = False
            self._changed.notify_all()


class _Suite:
    """State of a running suite that its threads share."""

    def __init__(
        self,
        results: Results,
        workers: Mapping[str, WorkerHandle],
        thoroughness: Thoroughness,
        store: Store | None,
        together: int,
    ) -> None:
        self.results, self.workers, self.thoroughness, self.store = results, workers, thoroughness, store
        self.schedule = _Schedule(list(workers), len(results.cases), together)
        self.finished: SimpleQueue[tuple[str, int, list[Run]] | None] = SimpleQueue()
        self._doors = {name: Lock() for name in workers}
        self._reference_motions: dict[int, ReferenceMotion | None] = {}

    def work(self) -> None:
        """Do jobs until none are left."""
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
        """Whether an engine has started and described itself."""
        with self._doors[name]:  # one thread asks, the others wait for the result
            if name in self.results.missing:
                return False
            if name not in self.results.engines:
                info = self.workers[name].ask(Request()).info
                if isinstance(info, str):
                    self.results.missing[name] = info
                    return False
                self.results.engines[name] = info
        return True

    def _ask(self, name: str, number: int) -> list[Run]:
        """Ask an engine about a case; of the reference, keep the motion that judges further levels of the engines."""
        results, worker = self.results, self.workers[name]
        case, info = results.cases[number], results.engines[name]
        motion = self._reference_motions.get(number)
        runs = list(ask_case(worker, case, results.questions, self.thoroughness, self.store, info, motion))
        if name != REFERENCE and REFERENCE in self.workers:
            runs += runs_under_other_laws(self.workers[REFERENCE], case, runs, self.store)
        if name == REFERENCE and Question.TRAJECTORY in results.questions:
            self._reference_motions[number] = reference_motion(case, runs)
        if name == REFERENCE and any(run.question == Question.TRAJECTORY and run.answer is not None for run in runs):
            dense = finest_motion(worker, densely_sampled(case), store=self.store, info=info).answer
            results.dense |= {} if dense is None else {case.name: dense}
        return runs


def _refuse_single(**given: tuple[object, type]) -> None:
    """Refuse one case, name or question where a sequence of them is needed, and entries of another type.

    Raises
    ------
    InvalidInput
    """
    for what, (value, kind) in given.items():
        remedy = f"Give a sequence of {kind.__name__}."
        if isinstance(value, str | Case):
            raise InvalidInput(what, f"it is one {type(value).__name__}, not a sequence", remedy)
        require(value, Sequence, what, remedy)
        for one in value if isinstance(value, Sequence) else ():
            require(one, kind, what, remedy)


def _refuse_alike(cases: Sequence[Case]) -> None:
    """Refuse cases of one name, whose answers a report could not tell apart.

    Raises
    ------
    InvalidInput
    """
    for name, count in Counter(case.name for case in cases).items():
        if count > 1:
            remedy = "Give each a name of its own: that of its drawing or mechanism, or of its file."
            raise InvalidInput(f"case '{name}'", f"{count} cases have this name", remedy)


class Resources(NamedTuple):
    """What the engines of a suite may use.

    Attributes
    ----------
    jobs : int
        Number of engines that work at the same time.
    limit : float, s
        Time limit of one job.
    memory : int, bytes
        Limit of the resident memory of an engine.
    cluster : Cluster, optional
        Cluster on which the engines run, as many at the same time as it has threads.
    """

    jobs: int = 2
    limit: float = 180.0
    memory: int = MEMORY
    cluster: Cluster | None = None


RESOURCES = Resources()


def run_suite(
    cases: Sequence[Case],
    engines: Sequence[str],
    questions: Sequence[Question] = tuple(Question),
    resources: Resources = RESOURCES,
    progress: Progress | None = None,
    thoroughness: Thoroughness = FULL,
    store: Store | None = None,
) -> Results:
    """Ask all engines all questions about all cases, and compare the answers with the reference.

    Parameters
    ----------
    cases : sequence of Case
    engines : sequence of str
        Names of installed engines; the reference is always asked.
    questions : sequence of Question
    resources : Resources
    progress : callable, optional
    thoroughness : Thoroughness
    store : Store, optional
        Store of answers, which are not asked for again.
    """
    limit, memory, cluster = resources.limit, resources.memory, resources.cluster
    _refuse_single(cases=(cases, Case), engines=(engines, str), questions=(questions, Question))
    _refuse_alike(cases)
    cases = [thoroughness.case(case) for case in cases]
    names = [REFERENCE, *(name for name in engines if name != REFERENCE)]
    results = Results(cases, list(questions), thoroughness=thoroughness)
    found: dict[tuple[str, int], list[Run]] = {}
    judged: dict[int, list[Comparison]] = {}
    together = 1 if cluster is None else len(cases)
    jobs = min(resources.jobs, len(names)) if cluster is None else min(cluster.tasks, len(names) * len(cases))
    cold = jobs > 1 and cluster is None and any(q.over_time for q in questions) and not compiled()
    with (
        compiled_beside([case for case in cases if not case.unassembled], limit, memory) if cold else nullcontext(),
        _workers(names, limit, memory, cluster) as workers,
        closing(_in_parallel(_Suite(results, workers, thoroughness, store, together), jobs)) as done,
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
    # the use of the others is the power of comparisons, their cause, and the time of few digits
    results.runs = [r for r in results.runs if r.perturbation is None and r.level >= 0 and not under_other_law(r)]
    results.runs = [r for r in results.runs if not r.coprime]
    results.engines = {name: results.engines[name] for name in names if name in results.engines}
    return results


def _judged(case: Case, names: Sequence[str], number: int, found: dict[tuple[str, int], list[Run]]) -> list[Comparison]:
    return judge_case(case, [run for name in names for run in found.get((name, number), [])])


@contextmanager
def _workers(
    names: Sequence[str], limit: float, memory: int, cluster: Cluster | None
) -> Iterator[Mapping[str, WorkerHandle]]:
    """Start a worker for each engine; stop all at the end of the block."""
    make = Worker if cluster is None else cluster.worker
    workers: dict[str, WorkerHandle] = {name: make(name, limit, memory) for name in names}
    try:
        yield workers
    finally:
        for worker in workers.values():
            worker.stop()


def _in_parallel(suite: _Suite, jobs: int) -> Generator[tuple[str, int, list[Run]]]:
    """Yield the results of the threads as they finish; an error of the harness in one thread ends all."""
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
    except BaseException:  # Ctrl-C, here or in the consumer of the results, among others: stop all engines
        suite.schedule.close()
        for worker in suite.workers.values():
            worker.cancel()
        raise
    finally:
        pool.shutdown(wait=True)


def simulate_case(
    case: Case, engine: str, limit: float, method: str | None = None, profile: Profile = Profile.MATCHED
) -> tuple[TrajectoryAnswer, str]:
    """Return the trajectory of a case by a method of an engine at its finest level, and the name of the method.

    Parameters
    ----------
    case : Case
    engine : str
    limit : float, s
        Time limit.
    method : str, optional
        Name of a method; default: the first one of the profile.
    profile : Profile
        Settings of the method.

    Raises
    ------
    EngineFailure
        If the engine does not answer, with the reason.
    InvalidInput
        If the engine has no such method for the case.
    """
    if engine.partition(":")[0] == REFERENCE:
        # no process of its own, which would take time to start
        run = finest_motion(InProcessEngine(engine), case, method, profile)
    else:
        with Worker(engine, limit) as worker:
            run = finest_motion(worker, case, method, profile)
    if run.status is Status.ANSWERED and run.method is not None:
        kind = "step" if run.method.substeps else "tolerance"
        return run.answer, f"{run.method.name}, {kind} {run.step:g}"
    raise EngineFailure(f"engine '{engine}', case '{case.name}': {run.status}: {run.reason}")
