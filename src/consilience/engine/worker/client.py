"""Client of worker processes: one process an engine, kept alive under limits; any fault in it is one failed run.

The protocol is in docs/workers.md. A mechanism is sent once and kept in the worker by its key, so that an adapter can
reuse its translation.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from queue import SimpleQueue
from types import TracebackType
from typing import Protocol, TypeVar

from consilience.engine.answers import EngineInfo
from consilience.engine.protocol import Engine, load_engine
from consilience.engine.worker import codec
from consilience.engine.worker.environments import NoEnvironment, launch_of
from consilience.engine.worker.messages import RecentlySent, job, loading, replayable_job
from consilience.engine.worker.process import Fault, Launch, Process
from consilience.engine.worker.requests import Raised, Request, attempt, perform, raised
from consilience.engine.worker.wire import Message, ProtocolError

__all__ = [
    "MEMORY",
    "EngineHandle",
    "InProcessEngine",
    "Reply",
    "Request",
    "Worker",
    "WorkerHandle",
    "in_parallel",
    "replayable_job",
    "with_each",
]

_S = TypeVar("_S")
_T = TypeVar("_T")

_LOG = logging.getLogger(__name__)

MEMORY = 4 * 2**30
"""Default limit of the resident memory of an engine in bytes."""

STARTING = 120.0
"""Time limit in s for the start of an engine, unless the limit of its jobs is longer."""


@dataclass(frozen=True, eq=False)
class Reply:
    """Reply of a worker to a job.

    Attributes
    ----------
    value : object
        An EngineInfo, a Plan, an AnswerSet, an Answer, or an Unsupported in its place; an unsound engine may send any
        other value.
    returned : bool
        Whether the engine returned a value; if not, `value` is None.
    reason : str
        Why the job failed.
    cpu : float, s
    log : str
        End of the output of the engine during the job.
    job : bytes
        Frames of a failed job: ``python -m consilience.engine.worker FILE`` repeats the job.
    """

    value: object
    returned: bool
    reason: str = ""
    cpu: float = 0.0
    log: str = ""
    job: bytes = b""

    @property
    def info(self) -> EngineInfo | str:
        """Description of the engine in the reply to an empty request, or why there is none."""
        if isinstance(self.value, EngineInfo):
            return self.value
        return self.reason or f"info() gave a {type(self.value).__name__}, not an EngineInfo"


class EngineHandle(Protocol):
    """Access to an engine in this process, in a worker, or on a cluster."""

    engine: str

    def ask(self, request: Request) -> Reply:
        """Let the engine do a job, and wait for the reply."""
        ...


class WorkerHandle(EngineHandle, Protocol):
    """Access to an engine that another thread can end."""

    def cancel(self) -> None:
        """Give up the running job and all later ones: each gets a failed reply."""
        ...

    def stop(self) -> None:
        """Give up all jobs, and end the process."""
        ...


_STOPPED = Reply(None, False, "stopped before it answered")


@dataclass
class Worker:
    """Engine in a process of its own.

    Parameters
    ----------
    engine : str
        Name of an installed engine, ``NAME``, ``NAME:VARIANT`` or ``NAME@VERSION``.
    limit : float, s
        Time limit of a job, without the start of the engine.
    memory : int, bytes
        Limit of the resident memory of the process.
    """

    engine: str
    limit: float = 60.0
    memory: int = MEMORY
    _jobs: SimpleQueue[tuple[Request, Future[Reply]] | None] = field(init=False, default_factory=SimpleQueue)
    _thread: threading.Thread = field(init=False)
    _turn: threading.Lock = field(init=False, default_factory=threading.Lock)
    _launch: Launch | None = field(init=False, default=None)
    _process: Process | None = field(init=False, default=None)
    _mechanisms: RecentlySent = field(init=False, default_factory=RecentlySent)
    _methods: RecentlySent = field(init=False, default_factory=RecentlySent)
    _number: int = field(init=False, default=0)
    _cancelled: bool = field(init=False, default=False)
    _door: threading.Lock = field(init=False, default_factory=threading.Lock)

    def __post_init__(self) -> None:
        # a daemon thread: a runner that ends does not wait for an engine, which dies with the runner
        self._thread = threading.Thread(target=self._work, name=f"worker of {self.engine}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Kill the process; waiting jobs get a failed reply. Any thread may call this, more than once."""
        self.cancel()
        self._jobs.put(None)
        self._thread.join()

    def cancel(self) -> None:
        """Give up the running job and all later ones, which get a failed reply. Any thread may call this."""
        with self._door:  # no job is queued from here on
            self._cancelled = True

    @property
    def cancelled(self) -> bool:
        """Whether `cancel` was called: no job will be answered."""
        return self._cancelled

    def submit(self, request: Request) -> Future[Reply]:
        """Queue a job; `reply` waits for the returned future."""
        future: Future[Reply] = Future()
        with self._door:
            if not self._cancelled:
                self._jobs.put((request, future))
                return future
        future.set_result(_STOPPED)
        return future

    def reply(self, future: Future[Reply]) -> Reply:
        """Wait for a job; a fault of the engine is a failed reply, not an exception."""
        try:
            return future.result()
        except CancelledError:
            return _STOPPED

    def ask(self, request: Request) -> Reply:
        """Queue a job and wait for it."""
        # without jobs in the queue this thread does the job: two changes of thread take as long as the rest of a job
        if self._jobs.empty() and self._turn.acquire(blocking=False):
            try:
                return _STOPPED if self._cancelled else self._answer(request)
            finally:
                self._turn.release()
        return self.reply(self.submit(request))

    # ------------------------------------------------------------ in the thread

    def _work(self) -> None:
        """Do the queued jobs until `stop`, then end the process."""
        while (job := self._jobs.get()) is not None:
            request, future = job
            if future.set_running_or_notify_cancel():
                try:
                    with self._turn:
                        reply = _STOPPED if self._cancelled else self._answer(request)
                except BaseException as error:  # an error of the harness: the waiting thread must see it
                    future.set_exception(error)
                    raise
                future.set_result(reply)
        with self._turn:
            self._end()

    def _answer(self, request: Request) -> Reply:
        """Do one job, and log it."""
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
        """Do one job; afterwards the process is sound, or there is none."""
        try:
            if self._process is not None and not self._process.quiet():
                self._end()
            if self._process is None:
                self._start()
            reply = self._exchanged(self._frames(request), self.limit)
            value = codec.value_of(reply.header, reply.arrays)
        except _NotStarted as failed:
            return Reply(None, False, str(failed), log=self._end())
        except Fault as fault:
            return Reply(None, False, str(fault), log=self._end(), job=replayable_job(self.engine, request))
        except ProtocolError as error:
            return Reply(None, False, f"the message cannot be read: {error}", log=self._printed())
        log, reason = self._printed(), reply.header.entries["reason"]
        if reason:
            return Reply(None, False, reason, reply.cpu, log, replayable_job(self.engine, request))
        return Reply(self._labelled(value), True, cpu=reply.cpu, log=log)

    def _start(self) -> None:
        """Start a process and load the engine.

        Raises
        ------
        _NotStarted
        """
        self._mechanisms, self._methods = RecentlySent(), RecentlySent()
        start = time.perf_counter()
        limit = max(self.limit, STARTING)
        try:
            if self._launch is None:
                self._launch = launch_of(self.engine, lambda: self._cancelled)
            self._process = Process(self._launch, self.memory)
            hello = self._process.exchange(b"", limit, lambda: self._cancelled).header.entries
            if hello.get("kind") != "hello":
                raise _NotStarted("the worker does not say hello")
            loaded = self._exchanged(self._load(), limit).header.entries
        except (NoEnvironment, OSError) as error:
            raise _NotStarted(str(error)) from None
        except (Fault, ProtocolError) as fault:
            raise _NotStarted(f"while it started, {fault}") from None
        if loaded["reason"]:
            raise _NotStarted(loaded["reason"])
        _LOG.info("%s: started as process %d in %.2f s", self.engine, hello["pid"], time.perf_counter() - start)

    def _exchanged(self, data: bytes, limit: float) -> Message:
        """Send frames of which the last is a job, and wait for the reply.

        Raises
        ------
        Fault
        """
        assert self._process is not None
        reply = self._process.exchange(data, limit, lambda: self._cancelled)
        if not _sound(reply):
            raise Fault(f"garbage on the wire: {str(reply.header.entries)[:200]} is no reply")
        if reply.job != self._number:
            raise Fault(f"it answered job {reply.job}, not job {self._number}")
        if self._process.more:
            raise Fault("it sent more than its answer")
        if reply.header.entries["strays"]:
            raise Fault("it left a process behind that goes on")
        return reply

    # ------------------------------------------------------------ frames

    def _load(self) -> bytes:
        self._number += 1
        return loading(self.engine, self._number)

    def _frames(self, request: Request) -> bytes:
        """Return the frames of a job, after those of a mechanism and a method that the worker does not keep yet."""
        mechanism, first = self._mechanisms.need(request.mechanism)
        method, second = self._methods.need(request.method)
        self._number += 1
        return first + second + job(request, mechanism, method, self._number)

    # ------------------------------------------------------------ the process

    def _labelled(self, value: object) -> object:
        """Return a value; to the `EngineInfo` from an environment of its own, add that environment."""
        if isinstance(value, EngineInfo) and self._launch is not None and self._launch.remarks:
            return replace(value, remarks="; ".join(filter(None, [value.remarks, self._launch.remarks])))
        return value

    def _printed(self) -> str:
        return "" if self._process is None else self._process.printed()

    def _end(self) -> str:
        """Kill the process, if there is one; return the end of its output."""
        process, self._process = self._process, None
        return "" if process is None else process.end()


class InProcessEngine:
    """Engine in this process: it starts at once, without limits, and a crash ends this process.

    Parameters
    ----------
    engine : str
        Name of an installed engine, or any name for a given instance.
    instance : Engine, optional
        The engine itself; loaded by its name if absent.
    """

    def __init__(self, engine: str, instance: Engine | None = None) -> None:
        self.engine = engine
        self._engine = instance

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
    """The engine did not start."""


def _named(request: Request) -> str:
    """Describe a job for the log."""
    name = request.mechanism.name if request.mechanism is not None else ""
    method = request.method.name if request.method is not None else ""
    step = f"{request.step:g}" if request.step else ""
    return ", ".join(filter(None, [name, *request.survey, request.question or "", method, step])) or "who it is"


def _sound(message: Message) -> bool:
    """Whether a message is a reply."""
    entries = message.header.entries
    return (
        entries.keys() == _REPLY
        and entries["kind"] == "reply"
        and type(entries["reason"]) is str
        and type(entries["strays"]) is bool
    )


_REPLY = {"kind", "reason", "strays", "value"}


def with_each(work: Callable[[_S], _T], subjects: Sequence[_S], workers: Iterable[Worker], jobs: int) -> list[_T]:
    """Call a function with each subject, `jobs` at a time, in threads; an exception in one call cancels all workers."""
    with ThreadPoolExecutor(max_workers=max(1, jobs)) as pool:
        try:
            return list(pool.map(work, subjects))
        except BaseException:  # Ctrl-C above all: no engine may go on working
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.cancel()
            raise


def in_parallel(work: Callable[[Worker], _T], workers: Sequence[Worker], jobs: int) -> list[_T]:
    """Call a function with each worker as `with_each` does, and stop all workers at the end."""
    try:
        return with_each(work, workers, workers, jobs)
    finally:
        for worker in workers:
            worker.stop()
