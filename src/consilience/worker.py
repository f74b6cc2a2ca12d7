"""Engines in worker processes: one each, kept alive, with a time limit; a crash or a hang is one failed run.

Pebble does the process control: it kills a worker that passes its time limit, notices one that dies, and starts the
next. What an engine prints goes to a file, never to the caller's terminal, and comes back with the run.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import CancelledError, Future, TimeoutError
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from pebble import ProcessExpired, ProcessPool

from consilience.engine import Engine, load_engine
from consilience.mechanism import Mechanism, State
from consilience.run import Manifest, Method, Question, Unsupported
from consilience.spatial import Array

_LOG_LIMIT = 4000


@dataclass(frozen=True, eq=False)
class Request:
    """One job of a worker. Without a question: describe yourself and, given a mechanism, plan."""

    mechanism: Mechanism | None = None
    question: Question | None = None
    method: Method | None = None
    states: Sequence[State] = ()
    times: Array | None = None
    step: float = 0.0


@dataclass(frozen=True)
class Plan:
    """What an engine says about a mechanism before it is asked anything."""

    unsupported: dict[Question, tuple[Unsupported, ...]]
    methods: dict[Question, tuple[Method, ...]]
    manifest: Manifest


@dataclass(frozen=True, eq=False)
class Reply:
    """What came back from a worker.

    Attributes
    ----------
    value : object
        An EngineInfo, a Plan or an Answer from a sound engine; anything from another.
    returned : bool
        Whether the engine returned; if not, `value` is None and `reason` says why.
    reason : str
        Why it failed.
    cpu : float, s
    log : str
        End of what the engine printed during the job.
    """

    value: object
    returned: bool
    reason: str = ""
    cpu: float = 0.0
    log: str = ""


_engines: dict[str, Engine] = {}


def _redirect(path: str) -> None:
    """Send whatever the engine prints, at any level, to a file. Runs first in the worker."""
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(fd, 1)
    os.dup2(fd, 2)
    # Ctrl-C is the runner's business: it stops the workers itself
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _plan(engine: Engine, mechanism: Mechanism) -> Plan:
    unsupported = {q: engine.unsupported(mechanism, q) for q in Question}
    can = [q for q in Question if not unsupported[q]]
    return Plan(
        unsupported,
        {q: engine.methods(mechanism, q) for q in can},
        engine.manifest(mechanism) if can else Manifest(),
    )


def _answer(engine: Engine, request: Request) -> Any:
    if request.mechanism is None:
        return engine.info()
    if request.question is None or request.method is None:
        return _plan(engine, request.mechanism)
    if request.question is Question.MODEL:
        return engine.model(request.mechanism, request.states[0], request.method)
    if request.question is Question.INSTANT:
        return engine.instant(request.mechanism, request.states, request.method)
    assert request.times is not None
    return engine.trajectory(request.mechanism, request.states[0], request.times, request.method, request.step)


def _serve(name: str, request: Request) -> tuple[bytes | None, str, float]:
    """Run one job in the worker: the pickled value, or why there is none, and the CPU time.

    Values and exceptions of an adapter may not survive the way to the runner (an exception with two arguments, a
    lambda): they are turned into bytes or text here, where a failure to do so is still one failed job.
    """
    start = time.process_time()
    try:
        if name not in _engines:
            _engines[name] = load_engine(name)
        start = time.process_time()
        value = _answer(_engines[name], request)
        return pickle.dumps(value), "", time.process_time() - start
    except Exception as error:  # noqa: BLE001 - whatever an engine or its adapter raises is evidence about that engine
        return None, f"{type(error).__name__}: {error}", time.process_time() - start


@dataclass
class Worker:
    """One engine in a process of its own.

    Parameters
    ----------
    engine : str
        Name of an installed engine.
    limit : float, s
        Time limit of a job; the first one includes importing the engine.
    """

    engine: str
    limit: float = 60.0
    _log: Path = field(init=False)
    _pool: Any = field(init=False)
    _pending: Future[Any] | None = field(init=False, default=None)
    _cancelled: bool = field(init=False, default=False)
    _stopped: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        handle, path = tempfile.mkstemp(prefix=f"consilience-{self.engine}-", suffix=".log")
        os.close(handle)
        self._log = Path(path)
        self._pool = ProcessPool(
            max_workers=1,
            context=multiprocessing.get_context("spawn"),
            initializer=_redirect,
            initargs=(path,),
        )

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Kill the process and remove its log; once is enough. Not while another thread waits: `cancel` first."""
        if not self._stopped:
            self._stopped = True
            self._pool.stop()
            self._pool.join()
            self._log.unlink(missing_ok=True)

    def cancel(self) -> None:
        """Give up the job in flight and every later one, from any thread: whoever waits gets a failed reply."""
        self._cancelled = True
        if self._pending is not None:
            self._pending.cancel()

    @property
    def cancelled(self) -> bool:
        """Whether nothing will be answered any more."""
        return self._cancelled

    def submit(self, request: Request) -> Future[Any]:
        """Queue a job; give the future to `reply`."""
        future: Future[Any] = self._pool.schedule(_serve, args=(self.engine, request), timeout=self.limit)
        self._pending = future
        if self._cancelled:
            future.cancel()
        return future

    def reply(self, future: Future[Any]) -> Reply:
        """Wait for a job; whatever went wrong in the engine is a value, not an exception."""
        try:
            value, reason, cpu = future.result()
            if value is not None:
                return Reply(pickle.loads(value), True, cpu=cpu, log=self._printed())
        except TimeoutError:
            reason = f"no answer within {self.limit:g} s; the worker was stopped"
        except CancelledError:
            reason = "stopped before it answered"
        except ProcessExpired as error:
            reason = f"the worker died: {_death(error.exitcode)}"
        except Exception as error:  # noqa: BLE001 - what an answer does while it is read is evidence about its engine
            reason = f"the answer cannot be read: {type(error).__name__}: {error}"
        return Reply(None, False, reason, log=self._printed())

    def ask(self, request: Request) -> Reply:
        """Queue a job and wait for it."""
        return self.reply(self.submit(request))

    def _printed(self) -> str:
        """End of the log since the last job, which is then cut off."""
        text = self._log.read_text(errors="replace") if self._log.exists() else ""
        if text:
            os.truncate(self._log, 0)
        return text[-_LOG_LIMIT:]


def _death(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        return f"signal {signal.Signals(-exitcode).name}"
    return f"exit code {exitcode}"
