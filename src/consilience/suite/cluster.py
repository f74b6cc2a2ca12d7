"""Jobs on a Dask cluster: each Dask worker keeps engines in processes of their own, with the usual limits.

A crash of an engine ends its own process, not the Dask worker: the failed run has the same evidence as on one machine.
If a Dask worker dies, the scheduler of ``distributed`` gives its tasks to another, by default up to three times.
"""

from __future__ import annotations

import logging
import threading
import uuid
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import distributed

from consilience.engine import EngineInfo
from consilience.engine.worker.client import MEMORY, Reply, Request, Worker
from consilience.errors import ConsilienceError
from consilience.suite.store import code_of

_T = TypeVar("_T")
_Item = TypeVar("_Item")

_LOG = logging.getLogger(__name__)

PATIENCE = "30s"
"""Time limit for the connection to the scheduler."""

AHEAD = 2
"""Submitted tasks for each thread of the cluster: one running, one waiting."""


class ClusterError(ConsilienceError):
    """The cluster cannot be reached, was lost, or has machines that differ."""


class TaskCache(Protocol):
    """Object that a Dask worker keeps from one task to the next."""

    def stop(self) -> None:
        """Release all resources."""


@dataclass(frozen=True)
class Engines:
    """Engines with their limits, and a digest of the sources that ask them."""

    names: tuple[str, ...]
    limit: float
    memory: int
    code: str


class Pool(distributed.WorkerPlugin):  # type: ignore[misc]
    """Objects that the tasks of one run keep on one Dask worker, until either ends.

    Parameters
    ----------
    name : str
        Name of the run.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def setup(self, worker: distributed.Worker) -> None:
        """Initialise; called on each Dask worker, also on those that join later."""
        self._address = worker.address
        self._idle: dict[Engines, list[TaskCache]] = defaultdict(list)
        self._all: list[TaskCache] = []
        self._lock = threading.Lock()

    def teardown(self, worker: distributed.Worker) -> None:
        """Stop all kept objects, in use or not."""
        with self._lock:
            kept, self._all = self._all, []
        for one in kept:
            one.stop()

    def use(self, engines: Engines, make: Callable[[], TaskCache], work: Callable[[Any], _Item]) -> _Item:
        """Call a function with an idle object of these engines, or with a new one.

        Raises
        ------
        ClusterError
            If the sources of this machine differ from the runner's.
        """
        if code_of(engines.names) != engines.code:
            raise ClusterError(f"the Dask worker {self._address} has another version of Consilience than this machine")
        with self._lock:
            if not self._idle[engines]:
                self._all.append(make())
                self._idle[engines].append(self._all[-1])
            one = self._idle[engines].pop()
        try:
            return work(one)
        finally:
            with self._lock:
                self._idle[engines].append(one)


def pool(name: str) -> Pool:
    """Return the pool of a run; called in a task."""
    return distributed.get_worker().plugins[name]


class Cluster:
    """Connection to a scheduler, closed at the end of a ``with`` block.

    Parameters
    ----------
    address : str
        Address of the scheduler, for example ``tcp://10.0.0.1:8786``.

    Raises
    ------
    ClusterError
        If no scheduler answers, or it has no workers.
    """

    def __init__(self, address: str) -> None:
        try:
            self.client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterError(f"scheduler '{address}': {error}") from None
        self.name = f"consilience-{uuid.uuid4().hex[:12]}"
        self.threads = sum(self.client.nthreads().values())
        self.tasks = AHEAD * self.threads
        if not self.threads:
            self.client.close()
            raise ClusterError(f"scheduler '{address}': it has no workers; start some with 'dask worker {address}'")
        self.client.register_plugin(Pool(self.name))
        _LOG.info("scheduler %s: %d threads on %d workers", address, self.threads, len(self.client.nthreads()))

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        if self.client.status == "running":
            self.client.unregister_worker_plugin(self.name)
        self.client.close()

    def worker(self, engine: str, limit: float, memory: int) -> Remote:
        """Return a handle of an engine that runs on any free machine."""
        return Remote(self, self.engines([engine], limit, memory))

    def engines(self, names: Sequence[str], limit: float, memory: int = MEMORY) -> Engines:
        """Return engines with their limits (s, bytes) and the digest of this machine's sources."""
        return Engines(tuple(names), limit, memory, code_of(names))

    def submit(self, task: Callable[..., _T], *values: object) -> distributed.Future:
        """Queue a task: a function whose first argument is the name of the pool."""
        return self.client.submit(task, self.name, *values, pure=False)

    def each(self, task: Callable[..., _T], items: Sequence[_Item], *values: object) -> Iterator[_T]:
        """Run a task for each item, and yield the results in order; some further tasks run ahead.

        Raises
        ------
        ClusterError
            If the cluster was lost, or an item has killed every Dask worker that tried it.
        """
        waiting: list[tuple[_Item, distributed.Future]] = []
        left = list(reversed(items))
        try:
            while left or waiting:
                while left and len(waiting) < self.tasks:
                    item = left.pop()
                    waiting.append((item, self.submit(task, item, *values)))
                item, future = waiting.pop(0)
                try:
                    yield future.result()
                except distributed.KilledWorker as error:
                    raise ClusterError(f"{item}: {error}") from None
                except CancelledError:
                    raise ClusterError(_LOST) from None
        finally:
            for _, future in waiting:
                future.cancel()


class Remote:
    """Handle of an engine on the cluster; several threads may ask at the same time.

    Parameters
    ----------
    cluster : Cluster
    engines : Engines
        One engine; its limits are those of a `Worker` on each machine.
    """

    def __init__(self, cluster: Cluster, engines: Engines) -> None:
        (self.engine,) = engines.names
        self._cluster, self._engines = cluster, engines
        self._info: EngineInfo | None = None
        self._waiting: set[distributed.Future] = set()
        self._cancelled = False
        self._lock = threading.Lock()

    def ask(self, request: Request) -> Reply:
        """Do a job and wait for it; a fault of the engine is a failed reply, not an exception.

        Raises
        ------
        ClusterError
            If the cluster was lost, or its machines differ.
        """
        with self._lock:
            if self._cancelled:
                return _STOPPED
            future = self._cluster.submit(_answer, self._engines, request, self._info)
            self._waiting.add(future)
        try:
            reply: Reply = future.result()
        except distributed.KilledWorker as error:
            return Reply(None, False, f"the Dask workers that did it died: {error}")
        except CancelledError:
            if self._cancelled:
                return _STOPPED
            raise ClusterError(_LOST) from None
        finally:
            with self._lock:
                self._waiting.discard(future)
        if isinstance(reply.value, EngineInfo):
            self._info = reply.value
        return reply

    def cancel(self) -> None:
        """Give up all jobs, which get a failed reply. Any thread may call this."""
        with self._lock:
            self._cancelled = True
            for future in self._waiting:
                future.cancel()

    def stop(self) -> None:
        """Give up all jobs; the processes of the engines end with the connection."""
        self.cancel()


_STOPPED = Reply(None, False, "stopped before it answered")
_LOST = "the connection to the scheduler was lost"


def _answer(name: str, engines: Engines, request: Request, expected: EngineInfo | None) -> Reply:
    """Let an engine on this Dask worker do a job."""

    def work(worker: _Introduced) -> Reply:
        if expected is not None and worker.info not in (None, expected):
            raise ClusterError(f"machines of the cluster differ: {worker.info}, and {expected}")
        return worker.ask(request)

    return pool(name).use(engines, lambda: _Introduced(engines.names[0], engines.limit, engines.memory), work)


class _Introduced(Worker):
    """A worker with the description of its engine."""

    def __post_init__(self) -> None:
        super().__post_init__()
        found = self.ask(Request()).value
        self.info = found if isinstance(found, EngineInfo) else None
