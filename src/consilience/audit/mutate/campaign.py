"""Campaigns of mutants: each mutant is planted and judged, and the correct adapters are judged for false alarms.

A mutant of a magnitude in a host is one task. The mutant is judged on every mechanism that has what the error acts on,
that the host can represent, and on which the host without the error agrees with the reference. On these mechanisms any
difference is due to the mutant. A mechanism catches the mutant if any answer gets a verdict that a run does not pass
over (not in `judge.GREEN`).

Tasks run in worker processes. A task that crashes or exceeds the time limit is repeated, first without the error; it
counts as caught if the error alone makes it fail again.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future, TimeoutError
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from pebble import ProcessExpired, ProcessPool

from consilience.audit.mutate.judge import GREEN, PASSED, verdicts
from consilience.audit.mutate.mutants import CONTACTS, Mutant
from consilience.audit.mutate.mutated import SeamError
from consilience.audit.mutate.subjects import (
    CONTACT_CASES,
    CONTACT_MOTIONS,
    MutationSubject,
    random_subject,
    shipped_subject,
)
from consilience.audit.mutate.synthetic import host as new_host
from consilience.audit.mutate.table import MUTANTS
from consilience.compare import Comparison, Verdict
from consilience.engine import Engine, Question

SubjectKey = str | int
"""Name of a shipped case, or seed of a random mechanism."""

_BATCH = 10
"""Mechanisms on which correct adapters are judged in one task."""

_EXAMPLE = 160
"""Characters kept of an example."""


def subject_of(key: SubjectKey) -> MutationSubject:
    """Return the subject of a key; each process keeps its subjects."""
    found = shipped_subject(key) if isinstance(key, str) else random_subject(key)
    assert found is not None
    return found


@dataclass(frozen=True)
class MutationTask:
    """One mutant in one host at one magnitude; `until_caught` ends it at the first mechanism that catches it."""

    mutant: str
    host: str
    magnitude: float
    subjects: tuple[SubjectKey, ...]
    until_caught: bool = False


@dataclass
class TaskOutcome:
    """Result of a task.

    Attributes
    ----------
    mutant, host : str
    magnitude : float
    judged, caught : int
        Number of mechanisms on which the mutant was judged, and of those on which it was caught.
    unchanged : int
        Number of mechanisms on which all differences are equal to those without the error.
    by : Counter
        Number of mechanisms by what caught the mutant: question and quantity, or question and verdict.
    largest_missed : float
        Largest difference over bar on a mechanism on which the mutant was not caught.
    example : str
        Words of one verdict that caught the mutant.
    broken : str
        Why there is no result: the worker died or exceeded the time limit, with the error alone; it counts as caught.
    unusable : str
        Why the mutant cannot be judged: it does not fit the adapter, or there is no result without the error either.
    """

    mutant: str
    host: str
    magnitude: float
    judged: int = 0
    caught: int = 0
    unchanged: int = 0
    by: Counter[str] = field(default_factory=Counter)
    largest_missed: float = 0.0
    example: str = ""
    broken: str = ""
    unusable: str = ""

    @property
    def noticed(self) -> bool:
        """Whether the mutant was caught on any mechanism."""
        return self.caught > 0 or bool(self.broken)


@dataclass
class Alarm:
    """A verdict on a correct adapter that a run does not pass over."""

    host: str
    subject: str
    question: str
    method: str
    verdict: str
    why: str


@dataclass
class MutationCampaign:
    """Results of a campaign.

    Attributes
    ----------
    outcomes : list of TaskOutcome
    alarms : list of Alarm
    judged : Counter
        Number of random mechanisms on which each correct adapter was judged at `instant`: those that it can represent.
    mechanisms : int
        Number of random mechanisms for the correct adapters.
    engines : dict
        Name and version by adapter.
    missing : dict
        Adapters that did not start, and the reasons.
    elapsed : float, s
    """

    outcomes: list[TaskOutcome] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)
    judged: Counter[str] = field(default_factory=Counter)
    mechanisms: int = 0
    engines: dict[str, str] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    elapsed: float = 0.0


# ---------------------------------------------------------------- in the worker


@lru_cache(maxsize=16)
def _correct(name: str) -> Engine:
    return new_host(name)


@lru_cache(maxsize=4096)
def _baseline(name: str, key: SubjectKey, question: Question, methods: str) -> tuple[Comparison, ...]:
    """Return the comparisons of the host without an error."""
    return tuple(verdicts(_correct(name), subject_of(key), question, methods))


def _red(found: Sequence[Comparison], before: Sequence[Comparison] = ()) -> list[Comparison]:
    """Return the comparisons that a run does not pass over, and that the host without the error does not get either."""
    known = {(c.question, c.method): c.verdict for c in before}
    return [c for c in found if c.verdict not in GREEN and c.verdict is not known.get((c.question, c.method))]


def _numbers(found: Sequence[Comparison]) -> dict[str, tuple[float, ...]]:
    """Return all differences by question and method, to tell whether a mutant changes any number."""
    return {
        f"{c.question} {c.method}": (*(q.difference for q in c.quantities), *(level.largest for level in c.levels))
        for c in found
    }


def _names(found: Sequence[Comparison]) -> set[str]:
    """Return what caught a mutant: questions with quantities, or with verdicts."""
    names: set[str] = set()
    for c in found:
        if c.verdict is Verdict.FAILED:
            names.add(f"{c.question}: failed")
        elif c.quantities:
            names.update(f"{c.question}: {q.name}" for q in c.quantities if not q.met)
        else:
            names.add(f"{c.question}: {c.verdict}")
    return names


def _before(mutant: Mutant, name: str, key: SubjectKey) -> list[Comparison]:
    """Return the comparisons without the error that a run passes over; of contacts many engines are soft.

    None if the mutant cannot be judged on the mechanism: if no method answers its question rightly.
    """
    if not mutant.precondition(subject_of(key)):
        return []
    before = [c for question in mutant.questions for c in _baseline(name, key, question, mutant.methods)]
    right = [c for c in before if c.verdict in PASSED]
    return right if any(c.question is mutant.question for c in right) else []


def _judge(mutant: Mutant, engine: Engine, key: SubjectKey, before: Sequence[Comparison], outcome: TaskOutcome) -> None:
    """Judge a mutant on one mechanism.

    Parameters
    ----------
    mutant : Mutant
    engine : Engine
        The engine with the error.
    key : str or int
        Key of the mechanism.
    before : sequence of Comparison
        Comparisons without the error.
    outcome : TaskOutcome
        The result is added to this outcome.
    """
    subject = subject_of(key)
    right = {(c.question, c.method) for c in before}
    found = [
        c
        for question in mutant.questions
        for c in verdicts(engine, subject, question, mutant.methods)
        if not c.method or (question, c.method) in right
    ]
    outcome.judged += 1
    red = _red(found, before)
    if red:
        outcome.caught += 1
        outcome.by.update(_names(red))
        outcome.example = outcome.example or f"{subject.name}: {red[0].why}"[:_EXAMPLE]
    elif _numbers(found) == _numbers(before):
        outcome.unchanged += 1
    else:
        ratios = [q.difference / q.bar for c in found for q in c.quantities if q.bar > 0.0]
        outcome.largest_missed = max([outcome.largest_missed, *ratios])


def unplanted(task: MutationTask) -> dict[SubjectKey, list[Comparison]]:
    """Judge the host of a task without the error; return the comparisons by mechanism."""
    return {key: _before(MUTANTS[task.mutant], task.host, key) for key in task.subjects}


def perform(task: MutationTask) -> TaskOutcome:
    """Judge one mutant of one magnitude in one host, in this process."""
    mutant, host = MUTANTS[task.mutant], new_host(task.host)
    outcome = TaskOutcome(task.mutant, task.host, task.magnitude)
    try:
        for key in task.subjects:
            before = _before(mutant, task.host, key)  # first: an error in a module acts on every engine here
            if before:
                with mutant.plant(host, task.magnitude) as engine:
                    _judge(mutant, engine, key, before, outcome)
            if task.until_caught and outcome.noticed:
                break
    except SeamError as error:
        outcome = TaskOutcome(task.mutant, task.host, task.magnitude)
        outcome.unusable = f"the mutant does not fit the adapter: {error}"
    return outcome


def alarms_of(names: Sequence[str], keys: Sequence[SubjectKey]) -> tuple[Counter[str], list[Alarm]]:
    """Judge correct adapters; return the number of mechanisms of each, and every verdict not in `GREEN`."""
    judged: Counter[str] = Counter()
    found = []
    for key in keys:
        subject = subject_of(key)
        for name in names:
            engine = _correct(name)
            given = [c for question in (Question.MODEL, Question.INSTANT) for c in verdicts(engine, subject, question)]
            judged[name] += any(c.question is Question.INSTANT for c in given)
            for c in _red(given):
                found.append(Alarm(name, subject.name, str(c.question), c.method, str(c.verdict), c.why))
    return judged, found


def _version(name: str) -> str:
    info = new_host(name).info()
    return f"{info.name} {info.version}"


def _quiet() -> None:
    """Discard the output of engines in a worker; verdicts state their reasons."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    os.dup2(sink, 2)


# ---------------------------------------------------------------- in the runner


def tasks_of(
    mutants: Sequence[Mutant], hosts: Sequence[str], instants: Sequence[SubjectKey], motions: Sequence[SubjectKey]
) -> list[MutationTask]:
    """Return the tasks of a campaign, one for each mutant, host and magnitude.

    Mutants of the question `trajectory` are judged on the subjects `motions`, all others on `instants`; mutants of
    contacts on cases with contacts.
    """

    def subjects(mutant: Mutant) -> Sequence[SubjectKey]:
        over_time = mutant.question is Question.TRAJECTORY
        if mutant.trap == CONTACTS:
            return CONTACT_MOTIONS if over_time else CONTACT_CASES
        return motions if over_time else instants

    return [
        MutationTask(m.name, host, magnitude, tuple(subjects(m)))
        for m in mutants
        for host in m.hosts
        if host in hosts
        for magnitude in m.magnitudes
    ]


def _result(future: Future[Any]) -> tuple[Any, str]:
    """Return the value of a job, or None and the reason."""
    error = future.exception()  # any exception of the worker is evidence about this one task
    if error is None:
        return future.result(), ""
    if isinstance(error, TimeoutError):
        return None, "no answer within the time limit"
    if isinstance(error, ProcessExpired):
        return None, f"the worker died: exit code {error.exitcode}"
    return None, f"{type(error).__name__}: {error}"


def repeated(pool: ProcessPool, task: MutationTask, limit: float) -> TaskOutcome:
    """Repeat a task that gave no result, first without the error, which is blamed only for what it does twice.

    Parameters
    ----------
    pool : ProcessPool
    task : MutationTask
    limit : float, s
        Time limit of each of the two jobs.
    """
    outcome = TaskOutcome(task.mutant, task.host, task.magnitude)
    _, reason = _result(pool.schedule(unplanted, args=(task,), timeout=limit))
    if reason:
        outcome.unusable = f"without the error, too: {reason}"
        return outcome
    found, outcome.broken = _result(pool.schedule(perform, args=(task,), timeout=limit))
    return found or outcome


def run_campaign(
    tasks: Sequence[MutationTask],
    hosts: Sequence[str],
    alarms: Sequence[SubjectKey] = (),
    jobs: int = 2,
    limit: float = 120.0,
    progress: Callable[[MutationCampaign], None] = lambda _: None,
) -> MutationCampaign:
    """Perform all tasks, and judge the correct adapters on the mechanisms `alarms`.

    Parameters
    ----------
    tasks : sequence of MutationTask
    hosts : sequence of str
        Correct adapters to be judged.
    alarms : sequence of str or int
        Keys of the mechanisms for the correct adapters.
    jobs : int
        Number of worker processes.
    limit : float, s
        Time limit of a task.
    progress : callable, optional
        Called with the results so far, after each task and each batch of mechanisms for the correct adapters.
    """
    start = time.perf_counter()
    campaign = MutationCampaign(mechanisms=len(alarms))
    batches = [tuple(alarms[n : n + _BATCH]) for n in range(0, len(alarms), _BATCH)]
    context = multiprocessing.get_context("spawn")
    with ProcessPool(max_workers=jobs, context=context, initializer=_quiet) as pool:
        versions = {name: pool.schedule(_version, args=(name,), timeout=limit) for name in hosts}
        judged = [(batch, pool.schedule(alarms_of, args=(tuple(hosts), batch), timeout=limit)) for batch in batches]
        planted = [(task, pool.schedule(perform, args=(task,), timeout=limit)) for task in tasks]
        for name, future in versions.items():
            version, reason = _result(future)
            (campaign.missing if reason else campaign.engines)[name] = reason or version
        for batch, future in judged:
            value, reason = _result(future)
            lost = [Alarm("any", f"{len(batch)} mechanisms", "", "", str(Verdict.FAILED), reason)]
            counts, found = value or (Counter[str](), lost)
            campaign.judged.update(counts)
            campaign.alarms += found
            progress(campaign)
        for task, future in planted:
            outcome, reason = _result(future)
            campaign.outcomes.append(repeated(pool, task, limit) if reason else outcome)
            progress(campaign)
    campaign.elapsed = time.perf_counter() - start
    return campaign
