"""Jobs on a Dask cluster: each Dask worker keeps engines alive, in the same processes with the same limits as here.

An engine that crashes takes its own process down, not the Dask worker: the failed run has the same evidence as on one
machine. When a Dask worker itself dies, the scheduler gives its tasks to another; ``distributed`` does that, three
times a task unless told otherwise.
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
"""How long to wait for the scheduler."""

AHEAD = 2
"""Tasks under way for each thread of the cluster: one at work, one waiting."""


class ClusterError(ConsilienceError):
    """The cluster cannot be used, or not any more."""


class Kept(Protocol):
    """What a Dask worker keeps from one task to the next."""

    def stop(self) -> None:
        """End it; nothing of it is left."""
        ...


@dataclass(frozen=True)
class Engines:
    """Engines with their limits, and a digest of the code that asks them."""

    names: tuple[str, ...]
    limit: float
    memory: int
    code: str


class Pool(distributed.WorkerPlugin):  # type: ignore[misc]
    """What the tasks of one run keep on one Dask worker; it ends with the run, or with the Dask worker.

    Parameters
    ----------
    name : str
        Of the run.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def setup(self, worker: distributed.Worker) -> None:
        """Begin; called on each Dask worker, those that join later, too."""
        self._address = worker.address
        self._idle: dict[Engines, list[Kept]] = defaultdict(list)
        self._all: list[Kept] = []
        self._lock = threading.Lock()

    def teardown(self, worker: distributed.Worker) -> None:
        """End what was kept, in use or not."""
        with self._lock:
            kept, self._all = self._all, []
        for one in kept:
            one.stop()

    def use(self, engines: Engines, make: Callable[[], Kept], work: Callable[[Any], _Item]) -> _Item:
        """Do work with what is kept for these engines and idle, or with a new one.

        Raises
        ------
        ClusterError
            If the code here is not the runner's.
        """
        if code_of(engines.names) != engines.code:
            raise ClusterError(f"the Dask worker {self._address} has another version of Consilience than this machine")
        with self._lock:
            idle = self._idle[engines]
            one = idle.pop() if idle else None
            if one is None:
                one = make()
                self._all.append(one)
        try:
            return work(one)
        finally:
            with self._lock:
                self._idle[engines].append(one)


def pool(name: str) -> Pool:
    """The pool of a run, inside a task."""
    found: Pool = distributed.get_worker().plugins[name]
    return found


class Cluster:
    """A connection to a scheduler, until the end of a ``with``.

    Parameters
    ----------
    address : str
        Of the scheduler, for example ``tcp://10.0.0.1:8786``.

    Raises
    ------
    ClusterError
        If nobody answers there, or it has no workers.
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
        """Stand for an engine on whatever machine is free."""
        return Remote(self, engines(engine, limit=limit, memory=memory))

    def engines(self, names: Sequence[str], limit: float) -> Engines:
        """Engines for tasks that ask several, as this machine knows them."""
        return engines(*names, limit=limit)

    def submit(self, task: Callable[..., _T], *values: object) -> distributed.Future:
        """Queue a task: a function whose first argument is the name of the pool."""
        return self.client.submit(task, self.name, *values, pure=False)

    def each(self, task: Callable[..., _T], items: Sequence[_Item], *values: object) -> Iterator[_T]:
        """What a task gives for each item, in their order; some more are under way.

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


def engines(*names: str, limit: float, memory: int = MEMORY) -> Engines:
    """Engines as this machine knows them."""
    return Engines(names, limit, memory, code_of(names))


class Remote:
    """An engine somewhere on the cluster; many may ask it at the same time.

    Parameters
    ----------
    cluster : Cluster
    asked : Engines
        One engine; limits are those of a `Worker`, each on its machine.
    """

    def __init__(self, cluster: Cluster, asked: Engines) -> None:
        (self.engine,) = asked.names
        self._cluster, self._asked = cluster, asked
        self._info: EngineInfo | None = None
        self._waiting: set[distributed.Future] = set()
        self._cancelled = False
        self._lock = threading.Lock()

    def ask(self, request: Request) -> Reply:
        """Wait for a job; whatever went wrong in the engine is a value, not an exception.

        Raises
        ------
        ClusterError
            If the cluster was lost, or its machines differ.
        """
        with self._lock:
            if self._cancelled:
                return _STOPPED
            future = self._cluster.submit(_answer, self._asked, request, self._info)
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
        """Give up all jobs, from any thread: whoever waits gets a failed reply."""
        with self._lock:
            self._cancelled = True
            for future in self._waiting:
                future.cancel()

    def stop(self) -> None:
        """Give up all jobs; the engines end with the connection."""
        self.cancel()


_STOPPED = Reply(None, False, "stopped before it answered")
_LOST = "the connection to the scheduler was lost"


def _answer(name: str, asked: Engines, request: Request, expected: EngineInfo | None) -> Reply:
    """Let an engine of this Dask worker do a job."""

    def work(worker: _Introduced) -> Reply:
        if expected is not None and worker.info not in (None, expected):
            raise ClusterError(f"machines of the cluster differ: {worker.info}, and {expected}")
        return worker.ask(request)

    return pool(name).use(asked, lambda: _Introduced(asked.names[0], asked.limit, asked.memory), work)


class _Introduced(Worker):
    """A worker that has said what it is."""

    def __post_init__(self) -> None:
        super().__post_init__()
        found = self.ask(Request()).value
        self.info = found if isinstance(found, EngineInfo) else None
