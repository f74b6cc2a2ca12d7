"""Engines in worker processes: one each, kept alive, with limits; whatever goes wrong in one is one failed run.

A worker speaks the protocol of `docs/workers.md`. A mechanism is sent once and remembered by its key, so that an
adapter finds the translation it has made for it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from queue import SimpleQueue
from types import TracebackType
from typing import Protocol, TypeVar

from consilience.engine.answers import EngineInfo
from consilience.engine.protocol import Engine, load_engine
from consilience.engine.worker import codec
from consilience.engine.worker.environments import NoEnvironment, launch_of
from consilience.engine.worker.messages import Held, job, loading, replayable_job
from consilience.engine.worker.process import Fault, Launch, Process
from consilience.engine.worker.requests import Plan, Raised, Request, attempt, perform, raised
from consilience.engine.worker.wire import Frame, ProtocolError

__all__ = [
    "MEMORY",
    "EngineHandle",
    "InProcessEngine",
    "Plan",
    "Reply",
    "Request",
    "Worker",
    "WorkerHandle",
    "in_parallel",
    "replayable_job",
]

_T = TypeVar("_T")

_LOG = logging.getLogger(__name__)

MEMORY = 4 * 2**30
"""Resident memory in bytes that an engine may use, unless told."""

STARTING = 120.0
"""Time in s that an engine has to start, or the limit of its jobs if that is longer."""


@dataclass(frozen=True, eq=False)
class Reply:
    """What came back from a worker.

    Attributes
    ----------
    value : object
        An EngineInfo, a Plan, a Survey or an Answer from a sound engine; anything that can be sent from another.
    returned : bool
        Whether the engine returned; if not, `value` is None and `reason` says why.
    reason : str
        Why it failed.
    cpu : float, s
    log : str
        End of what the engine printed during the job.
    job : bytes
        Where it failed, the job as it was sent: ``python -m consilience.engine.worker FILE`` does it again.
    """

    value: object
    returned: bool
    reason: str = ""
    cpu: float = 0.0
    log: str = ""
    job: bytes = b""


class EngineHandle(Protocol):
    """Something that does an engine's jobs, wherever the engine is."""

    engine: str

    def ask(self, request: Request) -> Reply:
        """Do a job and wait for it."""
        ...


class WorkerHandle(EngineHandle, Protocol):
    """The same, to be ended from another thread."""

    def cancel(self) -> None:
        """Give up the job in flight and every later one: whoever waits gets a failed reply."""
        ...

    def stop(self) -> None:
        """The same, and leave no process."""
        ...


_STOPPED = Reply(None, False, "stopped before it answered")


@dataclass
class Worker:
    """One engine in a process of its own.

    Parameters
    ----------
    engine : str
        Name of an installed engine, ``NAME``, ``NAME:VARIANT`` or ``NAME@VERSION``.
    limit : float, s
        Time limit of a job; starting the engine does not count.
    memory : int, bytes
        Resident memory the process may use.
    """

    engine: str
    limit: float = 60.0
    memory: int = MEMORY
    _jobs: SimpleQueue[tuple[Request, Future[Reply]] | None] = field(init=False, default_factory=SimpleQueue)
    _thread: threading.Thread = field(init=False)
    _turn: threading.Lock = field(init=False, default_factory=threading.Lock)
    _launch: Launch | None = field(init=False, default=None)
    _process: Process | None = field(init=False, default=None)
    _mechanisms: Held = field(init=False, default_factory=Held)
    _methods: Held = field(init=False, default_factory=Held)
    _number: int = field(init=False, default=0)
    _cancelled: bool = field(init=False, default=False)
    _door: threading.Lock = field(init=False, default_factory=threading.Lock)

    def __post_init__(self) -> None:
        # a daemon: a runner that ends in whatever way does not wait for an engine, and the engine dies with it
        self._thread = threading.Thread(target=self._work, name=f"worker of {self.engine}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Kill the process, from any thread, once or more often; whoever waits gets a failed reply."""
        self.cancel()
        self._jobs.put(None)
        self._thread.join()

    def cancel(self) -> None:
        """Give up the job in flight and every later one, from any thread: whoever waits gets a failed reply."""
        with self._door:  # nothing is queued from here on
            self._cancelled = True

    @property
    def cancelled(self) -> bool:
        """Whether nothing will be answered any more."""
        return self._cancelled

    def submit(self, request: Request) -> Future[Reply]:
        """Queue a job; give the future to `reply`."""
        future: Future[Reply] = Future()
        with self._door:
            if not self._cancelled:
                self._jobs.put((request, future))
                return future
        future.set_result(_STOPPED)
        return future

    def reply(self, future: Future[Reply]) -> Reply:
        """Wait for a job; whatever went wrong in the engine is a value, not an exception."""
        try:
            return future.result()
        except CancelledError:
            return _STOPPED

    def ask(self, request: Request) -> Reply:
        """Queue a job and wait for it."""
        # with nothing before it, it is done in this thread: two changes of thread take as long as all the rest
        if self._jobs.empty() and self._turn.acquire(blocking=False):
            try:
                return _STOPPED if self._cancelled else self._answer(request)
            finally:
                self._turn.release()
        return self.reply(self.submit(request))

    # ------------------------------------------------------------ in the thread

    def _work(self) -> None:
        """Do job after job until told to stop; no process outlives the last one."""
        while (job := self._jobs.get()) is not None:
            request, future = job
            if future.set_running_or_notify_cancel():
                try:
                    with self._turn:
                        reply = _STOPPED if self._cancelled else self._answer(request)
                except BaseException as error:  # an error of ours: whoever waits must see it
                    future.set_exception(error)
                    raise
                future.set_result(reply)
        with self._turn:
            self._end()

    def _answer(self, request: Request) -> Reply:
        """Reply to one job."""
        if not _LOG.isEnabledFor(logging.INFO):
            return self._attempt(request)
        start = time.perf_counter()
        reply = self._attempt(request)
        spent, what = time.perf_counter() - start, _named(request)
        if reply.returned:
            _LOG.debug("%s: %s: %.3f s, of them %.3f s CPU time of the engine", self.engine, what, spent, reply.cpu)
        else:
            _LOG.info("%s: %s: failed after %.3f s: %s", self.engine, what, spent, reply.reason)
        return reply

    def _attempt(self, request: Request) -> Reply:
        """Reply to one job; afterwards there is a worker that can be asked again, or none."""
        try:
            if self._process is not None and not self._process.quiet():
                self._end()
            if self._process is None:
                self._start()
            reply = self._exchanged(self._frames(request), self.limit)
            value = codec.value_of(reply.form, reply.arrays)
        except _NotStarted as failed:
            return Reply(None, False, str(failed), log=self._end())
        except Fault as fault:
            return Reply(None, False, str(fault), log=self._end(), job=replayable_job(self.engine, request))
        except ProtocolError as error:
            return Reply(None, False, f"the message cannot be read: {error}", log=self._printed())
        log, reason = self._printed(), reply.form.told["reason"]
        if reason:
            return Reply(None, False, reason, reply.cpu, log, replayable_job(self.engine, request))
        return Reply(self._labelled(value), True, cpu=reply.cpu, log=log)

    def _start(self) -> None:
        """Start a process and load the engine.

        Raises
        ------
        _NotStarted
        """
        self._mechanisms, self._methods = Held(), Held()
        start = time.perf_counter()
        limit = max(self.limit, STARTING)
        try:
            if self._launch is None:
                self._launch = launch_of(self.engine, lambda: self._cancelled)
            self._process = Process(self._launch, self.memory)
            hello = self._process.exchange(b"", limit, lambda: self._cancelled).form.told
            if hello.get("kind") != "hello":
                raise _NotStarted("the worker does not say hello")
            loaded = self._exchanged(self._load(), limit).form.told
        except (NoEnvironment, OSError) as error:
            raise _NotStarted(str(error)) from None
        except (Fault, ProtocolError) as fault:
            raise _NotStarted(f"while it started, {fault}") from None
        if loaded["reason"]:
            raise _NotStarted(loaded["reason"])
        _LOG.info("%s: started as process %d in %.2f s", self.engine, hello["pid"], time.perf_counter() - start)

    def _exchanged(self, data: bytes, limit: float) -> Frame:
        """Send what ends in a job, and wait for the reply to it.

        Raises
        ------
        Fault
        """
        assert self._process is not None
        reply = self._process.exchange(data, limit, lambda: self._cancelled)
        if not _sound(reply):
            raise Fault(f"garbage on the wire: {str(reply.form.told)[:200]} is no reply")
        if reply.job != self._number:
            raise Fault(f"it answered job {reply.job}, not job {self._number}")
        if self._process.more:
            raise Fault("it sent more than its answer")
        if reply.form.told["strays"]:
            raise Fault("it left a process behind that goes on")
        return reply

    # ------------------------------------------------------------ frames

    def _load(self) -> bytes:
        self._number += 1
        return loading(self.engine, self._number)

    def _frames(self, request: Request) -> bytes:
        """What the process has to be sent for a job: what it does not hold of mechanism and method, and the job."""
        mechanism, first = self._mechanisms.need(request.mechanism)
        method, second = self._methods.need(request.method)
        self._number += 1
        return first + second + job(request, mechanism, method, self._number)

    # ------------------------------------------------------------ the process

    def _labelled(self, value: object) -> object:
        """The value; what an engine of another environment says about itself, with that environment."""
        if isinstance(value, EngineInfo) and self._launch is not None and self._launch.remarks:
            return replace(value, remarks="; ".join(filter(None, [value.remarks, self._launch.remarks])))
        return value

    def _printed(self) -> str:
        return "" if self._process is None else self._process.printed()

    def _end(self) -> str:
        """Kill the process, if there is one; its last words."""
        process, self._process = self._process, None
        return "" if process is None else process.end()


class InProcessEngine:
    """An engine in this process: no start-up, but no shield and no limits either.

    Parameters
    ----------
    engine : str
        Name of an installed engine.
    """

    def __init__(self, engine: str) -> None:
        self.engine = engine
        self._engine: Engine | None = None

    def ask(self, request: Request) -> Reply:
        """Do a job."""
        start = time.process_time()
        value = attempt(self._perform, request)
        if isinstance(value, Raised):
            return Reply(None, False, raised(value.error), time.process_time() - start)
        return Reply(value, True, cpu=time.process_time() - start)

    def _perform(self, request: Request) -> object:
        self._engine = self._engine or load_engine(self.engine)
        return perform(self._engine, request)


class _NotStarted(Exception):
    """There is no engine to ask."""


def _named(request: Request) -> str:
    """What a job asks, for the log."""
    name = request.mechanism.name if request.mechanism is not None else ""
    method = request.method.name if request.method is not None else ""
    step = f"{request.step:g}" if request.step else ""
    return ", ".join(filter(None, [name, *request.survey, request.question or "", method, step])) or "who it is"


def _sound(frame: Frame) -> bool:
    """Whether a frame is a reply."""
    told = frame.form.told
    return (
        told.keys() == _REPLY
        and told["kind"] == "reply"
        and type(told["reason"]) is str
        and type(told["strays"]) is bool
    )


_REPLY = {"kind", "reason", "strays", "value"}


def in_parallel(work: Callable[[Worker], _T], workers: Sequence[Worker], jobs: int) -> list[_T]:
    """Let every worker do its work, `jobs` at a time; whatever stops one stops all, and none outlives this.

    Parameters
    ----------
    work : callable
        Called with a worker, in a thread.

    Returns
    -------
    list
        What it returned, in the order of the workers.
    """
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
