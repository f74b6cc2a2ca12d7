"""Fuzzing campaigns: mechanisms are drawn and judged in this process, while engines answer in theirs."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from consilience.audit.fuzz.judging import JudgedComparison, judge
from consilience.audit.fuzz.motions import judge_motions
from consilience.audit.fuzz.population import CONTACTS, Specimen, specimen
from consilience.audit.fuzz.workers import AnswerBatch, EngineStream
from consilience.case import Case
from consilience.compare.judge import REFERENCE
from consilience.engine import EngineInfo
from consilience.engine.worker.client import Reply, Request
from consilience.errors import ConsilienceError

if TYPE_CHECKING:
    from consilience.suite.cluster import Cluster, Engines

BLOCK = 8
"""Mechanisms drawn at a time."""

BLOCKS_AHEAD = 3
"""Blocks sent before the first is judged: engines differ in speed, and no engine should wait for the slowest."""

SHARD = 2 * BLOCK
"""Mechanisms of a task on a cluster."""

PendingReplies = dict[str, list[Future[Reply]]]
"""Futures by engine, one for each mechanism of a block."""


@dataclass(frozen=True, eq=False)
class JudgedMechanism:
    """A mechanism and all comparisons of answers about it."""

    specimen: Specimen
    entries: list[JudgedComparison]


@dataclass
class TimeSpent:
    """CPU time in this process and of each engine, and elapsed time, s."""

    drawing: float = 0.0
    judging: float = 0.0
    engines: dict[str, float] = field(default_factory=dict)
    elapsed: float = 0.0


@dataclass
class FuzzCampaign:
    """Results of a campaign.

    Attributes
    ----------
    missing : dict
        Engines that did not start, and the reasons.
    undrawn : dict
        Seeds whose mechanism could not be drawn, and the reasons.
    """

    engines: dict[str, EngineInfo] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    judged: list[JudgedMechanism] = field(default_factory=list)
    undrawn: dict[int, str] = field(default_factory=dict)
    spent: TimeSpent = field(default_factory=TimeSpent)


class EnginePanel:
    """Workers of the reference and of the engines, alive within a ``with`` block.

    Parameters
    ----------
    engines : sequence of str
        Names; the reference is added.
    limit : float, s
        Time limit of one request.
    """

    def __init__(self, engines: Sequence[str], limit: float) -> None:
        self.names = [REFERENCE, *(name for name in engines if name != REFERENCE)]
        self.limit = limit
        self.members: dict[str, EngineStream] = {}
        self.infos: dict[str, EngineInfo] = {}
        self.missing: dict[str, str] = {}
        self._stack = ExitStack()

    def __enter__(self) -> EnginePanel:
        with ExitStack() as starting:  # Ctrl-C while engines start must end all of them
            streams = {name: EngineStream(name, self.limit) for name in self.names}
            for stream in streams.values():
                starting.callback(stream.stop)
            waiting = {name: stream.submit(Request()) for name, stream in streams.items()}
            for name, future in waiting.items():
                info = streams[name].reply(future).info
                if isinstance(info, EngineInfo):
                    self.infos[name], self.members[name] = info, streams[name]
                else:
                    self.missing[name] = info
            self._stack = starting.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End all engines."""
        self._stack.close()

    def submit(self, cases: Sequence[Case], engines: Sequence[str] | None = None) -> PendingReplies:
        """Send the mechanisms of the cases to the given engines; by default to all engines."""
        return {name: self.members[name].submit_cases(cases) for name in engines or self.members}

    def collect(self, count: int, pending: PendingReplies) -> list[dict[str, AnswerBatch]]:
        """Wait for the replies about `count` mechanisms: answers by engine, for one mechanism after the other."""
        batches = {name: self.members[name].collect(futures) for name, futures in pending.items()}
        return [{name: found[n] for name, found in batches.items()} for n in range(count)]


def run_campaign(
    panel: EnginePanel, seeds: Sequence[int], progress: Callable[[int], None] | None = None, contacts: bool = False
) -> FuzzCampaign:
    """Ask the panel about the mechanisms of the seeds, and judge the answers.

    Parameters
    ----------
    panel : EnginePanel
    seeds : sequence of int
    progress : callable, optional
        Called with the number of mechanisms judged.
    contacts : bool
        Draw mechanisms with contacts.

    Raises
    ------
    ConsilienceError
        If the reference does not start.
    """
    if REFERENCE in panel.missing:
        raise ConsilienceError(f"engine '{REFERENCE}' does not start: {panel.missing[REFERENCE]}")
    campaign = FuzzCampaign(panel.infos, panel.missing)
    before = {name: member.spent for name, member in panel.members.items()}
    start = time.perf_counter()
    under_way: deque[tuple[list[Specimen], PendingReplies]] = deque()

    def judge_first() -> None:
        _judge_block(panel, campaign, *under_way.popleft())
        if progress is not None:
            progress(len(campaign.judged))

    for block in _blocks(seeds, contacts, campaign):
        under_way.append((block, panel.submit([one.case for one in block])))
        if len(under_way) > BLOCKS_AHEAD:
            judge_first()
    while under_way:
        judge_first()
    campaign.spent.elapsed = time.perf_counter() - start
    campaign.spent.engines = {name: member.spent - before[name] for name, member in panel.members.items()}
    return campaign


def _blocks(seeds: Sequence[int], contacts: bool, campaign: FuzzCampaign) -> Iterator[list[Specimen]]:
    """Draw mechanisms with their states, a block at a time."""
    for first in range(0, len(seeds), BLOCK):
        start, drawn = time.process_time(), []
        for seed in seeds[first : first + BLOCK]:
            try:
                one = specimen(seed, contacts)
                _ = one.case.states
                drawn.append(one)
            except ConsilienceError as error:
                campaign.undrawn[seed] = str(error)
        campaign.spent.drawing += time.process_time() - start
        yield drawn


def _judge_block(panel: EnginePanel, campaign: FuzzCampaign, block: list[Specimen], pending: PendingReplies) -> None:
    """Wait for the answers about a block of mechanisms, and judge them."""
    answers = panel.collect(len(block), pending)
    start = time.process_time()
    entries = [judge(drawn.case, batches) for drawn, batches in zip(block, answers, strict=True)]
    if any(drawn.sort == CONTACTS for drawn in block):
        motions = judge_motions([drawn.case for drawn in block], panel.members)
        entries = [first + then for first, then in zip(entries, motions, strict=True)]
    campaign.judged += map(JudgedMechanism, block, entries)
    campaign.spent.judging += time.process_time() - start


def run_on_cluster(
    cluster: Cluster,
    engines: Engines,
    seeds: Sequence[int],
    progress: Callable[[int], None] | None = None,
    contacts: bool = False,
) -> FuzzCampaign:
    """Draw, ask and judge on a cluster, with the same results as `run_campaign`.

    Parameters
    ----------
    cluster : Cluster
    engines, seeds, progress, contacts : see `run_campaign`

    Raises
    ------
    ConsilienceError
        If the reference does not start, the machines differ, or the cluster is lost.
    """
    whole = FuzzCampaign()
    start = time.perf_counter()
    shards = [seeds[n : n + SHARD] for n in range(0, len(seeds), SHARD)]
    for part in cluster.each(_shard, shards, engines, contacts):
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


def _shard(name: str, seeds: Sequence[int], engines: Engines, contacts: bool) -> FuzzCampaign:
    """Run a part of a campaign on a Dask worker."""
    from consilience.suite.cluster import pool  # noqa: PLC0415 - an extra: only a cluster needs it

    return pool(name).use(
        engines,
        lambda: EnginePanel(engines.names, engines.limit).__enter__(),
        lambda panel: run_campaign(panel, seeds, contacts=contacts),
    )
