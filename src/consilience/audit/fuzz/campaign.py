"""Many mechanisms on all engines: drawn and judged here, while the engines work on the next ones in their processes."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from consilience.audit.fuzz.judging import Entry, judge
from consilience.audit.fuzz.population import Specimen, specimen
from consilience.audit.fuzz.workers import Panelist, Sheet, Task
from consilience.compare.judge import REFERENCE
from consilience.engine import EngineInfo
from consilience.engine.worker.client import Reply, Request
from consilience.errors import ConsilienceError

if TYPE_CHECKING:
    from consilience.suite.cluster import Cluster, Engines

MESSAGE = 8
"""Mechanisms that are drawn at a time."""

AHEAD = 3
"""Times that, under way: engines differ in speed, and none should wait for the slowest."""

Answers = list[Future[Reply]]
"""Of one engine to some mechanisms, in their order."""

Progress = Callable[[int], None]
"""Called with the number of mechanisms judged so far."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A mechanism and all entries about it."""

    specimen: Specimen
    entries: list[Entry]


@dataclass
class Spent:
    """Where the time went, s: CPU time in this process and of each engine, and the clock."""

    drawing: float = 0.0
    judging: float = 0.0
    engines: dict[str, float] = field(default_factory=dict)
    elapsed: float = 0.0


@dataclass
class Campaign:
    """All a fuzz found out."""

    engines: dict[str, EngineInfo] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    judged: list[Judged] = field(default_factory=list)
    undrawn: dict[int, str] = field(default_factory=dict)
    """Seeds whose mechanism could not be drawn, and why."""

    spent: Spent = field(default_factory=Spent)


class Panel:
    """The reference and the engines, alive until the end of a ``with``.

    Parameters
    ----------
    engines : sequence of str
        The reference is always there.
    limit : float, s
        Time limit of a message.
    """

    def __init__(self, engines: Sequence[str], limit: float) -> None:
        self.names = [REFERENCE, *(name for name in engines if name != REFERENCE)]
        self.limit = limit
        self.members: dict[str, Panelist] = {}
        self.infos: dict[str, EngineInfo] = {}
        self.missing: dict[str, str] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Panel:
        with ExitStack() as starting:  # after Ctrl-C above all: no engine may go on living for nobody
            self._start(starting)
            self._stack = starting.pop_all()
        return self

    def _start(self, starting: ExitStack) -> None:
        members = {name: Panelist(name, self.limit) for name in self.names}
        for member in members.values():
            starting.callback(member.stop)
        waiting = {name: member.submit(Request()) for name, member in members.items()}
        for name, future in waiting.items():
            reply = members[name].reply(future)
            if isinstance(reply.value, EngineInfo):
                self.infos[name], self.members[name] = reply.value, members[name]
            else:
                self.missing[name] = reply.reason or f"info() gave a {type(reply.value).__name__}, not an EngineInfo"

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End all engines."""
        self._stack.close()

    def submit(self, tasks: Sequence[Task], engines: Sequence[str] | None = None) -> dict[str, Answers]:
        """Send a message to the engines, or to some of them."""
        return {name: self.members[name].submit_many(tasks) for name in engines or self.members}

    def collect(self, tasks: Sequence[Task], futures: dict[str, Answers]) -> list[dict[str, Sheet]]:
        """Wait for the answers to a message: sheets by engine, a mechanism after the other."""
        sheets = {name: self.members[name].sheets(found) for name, found in futures.items()}
        return [{name: found[n] for name, found in sheets.items()} for n in range(len(tasks))]


def run_campaign(panel: Panel, seeds: Sequence[int], progress: Progress | None = None) -> Campaign:
    """Ask the panel about the mechanisms of the seeds, and judge.

    Raises
    ------
    ConsilienceError
        If the reference does not start.
    """
    if REFERENCE in panel.missing:
        raise ConsilienceError(f"engine '{REFERENCE}' does not start: {panel.missing[REFERENCE]}")
    campaign = Campaign(panel.infos, panel.missing)
    campaign.spent.engines = dict.fromkeys(panel.members, 0.0)
    start = time.perf_counter()
    under_way: deque[tuple[list[Specimen], list[Task], dict[str, Answers]]] = deque()
    for specimens in _messages(seeds, campaign):
        tasks = [Task(s.case.mechanism, s.case.states) for s in specimens]
        under_way.append((specimens, tasks, panel.submit(tasks)))
        if len(under_way) > AHEAD:
            _judge_message(panel, campaign, *under_way.popleft(), progress)
    while under_way:
        _judge_message(panel, campaign, *under_way.popleft(), progress)
    campaign.spent.elapsed = time.perf_counter() - start
    return campaign


SHARD = 2 * MESSAGE
"""Mechanisms that a machine of a cluster draws, asks about and judges before it sends what it found."""


def run_on_cluster(
    cluster: Cluster, asked: Engines, seeds: Sequence[int], progress: Progress | None = None
) -> Campaign:
    """Draw, ask and judge on a cluster: the same as `run_campaign` finds.

    Raises
    ------
    ConsilienceError
        If the reference does not start, the machines differ, or the cluster is lost.
    """
    whole = Campaign()
    start = time.perf_counter()
    for part in cluster.each(_shard, [seeds[n : n + SHARD] for n in range(0, len(seeds), SHARD)], asked):
        if not whole.engines:
            whole.engines, whole.missing = part.engines, part.missing
            whole.spent.engines = dict.fromkeys(part.engines, 0.0)
        if (part.engines, part.missing) != (whole.engines, whole.missing):
            raise ConsilienceError(f"machines of the cluster differ: {part.engines}, {part.missing}")
        whole.judged += part.judged
        whole.undrawn |= part.undrawn
        whole.spent.drawing += part.spent.drawing
        whole.spent.judging += part.spent.judging
        for name, cpu in part.spent.engines.items():
            whole.spent.engines[name] += cpu
        if progress is not None:
            progress(len(whole.judged))
    whole.spent.elapsed = time.perf_counter() - start
    return whole


def _shard(name: str, seeds: Sequence[int], asked: Engines) -> Campaign:
    """A part of a campaign, on a Dask worker."""
    from consilience.suite.cluster import pool  # noqa: PLC0415 - an extra: only a cluster needs it

    return pool(name).use(
        asked, lambda: Panel(asked.names, asked.limit).__enter__(), lambda panel: run_campaign(panel, seeds)
    )


def _messages(seeds: Sequence[int], campaign: Campaign) -> Iterator[list[Specimen]]:
    """Specimens with their states, some at a time."""
    for first in range(0, len(seeds), MESSAGE):
        start, drawn = time.process_time(), []
        for seed in seeds[first : first + MESSAGE]:
            try:
                drawn.append(specimen(seed))
                _ = drawn[-1].case.states
            except ConsilienceError as error:
                campaign.undrawn[seed] = str(error)
        campaign.spent.drawing += time.process_time() - start
        yield [s for s in drawn if s.seed not in campaign.undrawn]


def _judge_message(
    panel: Panel,
    campaign: Campaign,
    specimens: list[Specimen],
    tasks: list[Task],
    futures: dict[str, Answers],
    progress: Progress | None,
) -> None:
    answers = panel.collect(tasks, futures)
    start = time.process_time()
    for drawn, sheets in zip(specimens, answers, strict=True):
        campaign.judged.append(Judged(drawn, judge(drawn.case, sheets)))
        for name, sheet in sheets.items():
            campaign.spent.engines[name] += sheet.cpu
    campaign.spent.judging += time.process_time() - start
    if progress is not None:
        progress(len(campaign.judged))
