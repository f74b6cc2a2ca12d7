"""The worker side: one engine, asked over a socket, in whatever environment it lives in. NumPy alone.

The socket is moved to a high descriptor that programs started by the engine do not inherit; standard output belongs to
the engine. On Linux the whole process group dies with the runner, even while native code keeps Python from running.
"""

from __future__ import annotations

import ctypes
import faulthandler
import fcntl
import os
import platform
import resource
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol, TypeVar

import numpy as np

from consilience.engine.answers import Method, Question
from consilience.engine.protocol import Engine, load_engine
from consilience.engine.worker import codec, wire
from consilience.engine.worker.requests import Request, perform, raised, states_of
from consilience.engine.worker.wire import Form, Frame, Header, Incoming, ProtocolError
from consilience.mechanism import Mechanism

_T = TypeVar("_T")

_HIGH = 200
"""Least number of the descriptor that the protocol uses."""

_CHUNK = 2**16
"""Bytes that are read at a time."""

_PR_SET_CHILD_SUBREAPER = 36
"""Linux: descendants whose parent has gone become children of this process."""


class Server:
    """One engine, and the mechanisms and methods it has been sent to keep."""

    def __init__(self) -> None:
        self.engine: Engine | None = None
        self.kept: dict[str, Mechanism | Method] = {}
        self._asked: dict[Form, Request] = {}
        self._headers: dict[tuple[Any, ...], bytes] = {}

    def handle(self, frame: Frame) -> bytes | None:
        """Obey one frame: the reply, packed, or None where none is expected.

        Raises
        ------
        ProtocolError
            If the frame is none of ours: runner and worker do not fit one another.
        """
        if frame.form in self._asked:
            return self._replied(frame, self._request, self._perform)
        told = frame.form.told
        kind = told.get("kind")
        _check_entries(kind, told)
        if kind == "load":
            return self._replied(frame, lambda _: told["engine"], self._load)
        if kind == "job":
            return self._replied(frame, self._request, self._perform)
        self._asked.clear()  # what a key means changes
        if kind == "forget":
            self.kept.pop(told["key"], None)
            return None
        value = codec.value_of(frame.form, frame.arrays)
        if not isinstance(value, Mechanism | Method):
            raise ProtocolError(f"a {type(value).__name__} is neither mechanism nor method")
        self.kept[told["key"]] = _frozen(value)
        return None

    def _load(self, name: str) -> None:
        self.engine = load_engine(name)

    def _request(self, frame: Frame) -> Request:
        """What a job asks: what its form says, and its states and times."""
        asked = self._asked.get(frame.form)
        if asked is None:
            asked = self._form_of_request(frame.form.told, len(frame.arrays))
            _remember(self._asked, frame.form, asked)
        if not frame.arrays:
            return asked
        states, times = frame.form.told["states"] == 1, frame.form.told["times"] == 1
        try:
            given = states_of(frame.arrays[0]) if states else ()
        except ValueError as error:
            raise ProtocolError(f"the job is no request: {error}") from None
        grid = frame.arrays[-1] if times else None
        return Request(asked.mechanism, asked.question, asked.method, given, grid, asked.step, asked.survey)

    def _form_of_request(self, told: Header, arrays: int) -> Request:
        """A job without its states and times."""
        mechanism, method = self._held(told["mechanism"], Mechanism), self._held(told["method"], Method)
        if arrays != (told["states"] == 1) + (told["times"] == 1):
            raise ProtocolError(f"the job has {arrays} arrays, and says otherwise")
        try:
            question = None if told["question"] is None else Question(told["question"])
            survey = tuple(map(Question, told["survey"]))
        except ValueError as error:
            raise ProtocolError(f"the job is no request: {error}") from None
        return Request(mechanism, question, method, step=told["step"], survey=survey)

    def _held(self, key: str | None, kind: type[_T]) -> _T | None:
        """What was sent under a key."""
        if key is None:
            return None
        value = self.kept.get(key)
        if not isinstance(value, kind):
            raise ProtocolError(f"the job refers to a {kind.__name__} that was not sent")
        return value

    def _perform(self, request: Request) -> object:
        assert self.engine is not None
        return perform(self.engine, request)

    def _replied(self, frame: Frame, given: Callable[[Frame], _T], action: Callable[[_T], object]) -> bytes:
        """Reply to a frame: the value, or in words why there is none, and the CPU time of the action."""
        start, spent = None, 0.0
        try:
            read = given(frame)
            start = time.process_time()
            answer = action(read)
            spent = time.process_time() - start
            return self._packed(answer, frame.job, spent)
        except Exception as error:  # noqa: BLE001 - whatever an engine or its adapter raises is evidence about that engine
            if start is not None:
                spent = time.process_time() - start
            reason = str(error) if isinstance(error, ProtocolError) else raised(error)
            return wire.pack(_told(reason, _left_behind(), None), job=frame.job, cpu=spent)

    def _packed(self, answer: object, number: int, spent: float) -> bytes:
        """Reply with a value; its header is not written again for an answer like an earlier one."""
        outline, arrays = codec.outlined(answer)
        strays = _left_behind()
        header = None if outline is None or strays else self._headers.get(outline)
        if header is None:
            tree, arrays = codec.encode(answer)
            header = wire.written(_told("", strays, tree), [(array.dtype, array.shape) for array in arrays])
            if outline is not None and not strays:
                _remember(self._headers, outline, header)
        return wire.framed(header, [array.tobytes() for array in arrays], number, spent)


_REMEMBERED = 256
"""Forms of jobs that a worker holds at a time, and headers of replies."""


def _remember(table: dict[Any, Any], key: object, value: object) -> None:
    if len(table) >= _REMEMBERED:
        table.clear()
    table[key] = value


def _told(reason: str, strays: bool, tree: object) -> Header:
    return {"kind": "reply", "reason": reason, "strays": strays, "value": tree}


_ENTRIES: dict[str, dict[str, Any]] = {
    "load": {"engine": str},
    "keep": {"key": str, "value": object},
    "forget": {"key": str},
    "job": {
        **{"mechanism": str | None, "method": str | None, "question": str | None},
        **{"survey": list, "step": float, "states": int, "times": int},
    },
}
"""By the kind of a frame: its other entries and their types."""


def _check_entries(kind: object, header: Header) -> None:
    entries = _ENTRIES.get(kind) if isinstance(kind, str) else None
    if entries is None:
        raise ProtocolError(f"no frame is of the kind {str(kind)[:80]!r}")
    for name, expected in entries.items():
        if name not in header or not isinstance(header[name], expected):
            raise ProtocolError(f"a frame of the kind {kind!r} has no {name!r} of the right type")


def _frozen(kept: Mechanism | Method) -> Mechanism | Method:
    """Make every array read-only, as the runner has it: a mechanism that is remembered must not change."""
    stack: list[Any] = [kept]
    while stack:
        value = stack.pop()
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        elif isinstance(value, tuple):
            stack += value
        elif type(value) in codec.CLASSES.values():
            stack += vars(value).values()
    return kept


# ---------------------------------------------------------------- the process


class Stream(Protocol):
    """Where frames come from."""

    def recv(self, count: int, /) -> bytes:
        """Some bytes, at most so many; none at the end."""
        ...


def read_frames(stream: Stream) -> Iterator[Frame]:
    """Frames as they come, up to the end of the stream.

    Raises
    ------
    ProtocolError
    """
    coming = Incoming()
    while chunk := stream.recv(_CHUNK):
        ready = coming.add(chunk)
        while ready:
            yield coming.take()
            ready = coming.add(b"")


class _Waiting:
    """Frames from a socket, waited for by `poll` for data alone.

    Who waits in `recv` is woken once more when the other end has read an answer and there is room again: a change of
    processes and an interrupt of the runner's core in each job.
    """

    def __init__(self, stream: socket.socket) -> None:
        self._stream, self._poll = stream, select.poll()
        self._poll.register(stream, select.POLLIN)

    def recv(self, count: int) -> bytes:
        self._poll.poll()
        return self._stream.recv(count)


def serve(channel: int, lifeline: int) -> None:
    """Answer until the runner closes the channel or dies."""
    _settle(lifeline)
    high = fcntl.fcntl(channel, fcntl.F_DUPFD_CLOEXEC, _HIGH)
    os.close(channel)
    server, flush = Server(), ctypes.CDLL(None).fflush
    with socket.socket(fileno=high) as runner:
        runner.sendall(
            wire.pack(
                {"kind": "hello", "pid": os.getpid(), "python": platform.python_version(), "numpy": np.__version__}
            )
        )
        for frame in read_frames(_Waiting(runner)):
            reply = server.handle(frame)
            if reply is not None:
                _flush(flush)
                runner.sendall(reply)


def _settle(lifeline: int) -> None:
    """Die with the runner, keep Ctrl-C for the runner, leave no core file, say where a crash was."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.enable(sys.stderr, all_threads=False)
    faulthandler.register(signal.SIGUSR1, sys.stderr, all_threads=False)
    if sys.platform == "linux":
        # nobody writes to the lifeline: while it is open, its signal ends this process group with the runner
        fcntl.fcntl(lifeline, fcntl.F_DUPFD_CLOEXEC, _HIGH)
        os.close(lifeline)
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _flush(all_of_c: Callable[[None], object]) -> None:
    """What the engine printed belongs to this job, not to the next."""
    for stream in (sys.stdout, sys.stderr):
        try:  # noqa: SIM105 - here and below, a context manager takes several times as long as what it wraps
            stream.flush()
        except (OSError, ValueError):  # an engine may have closed its own
            pass
    all_of_c(None)


def _left_behind() -> bool:
    """Whether a process that the engine started still runs; those that have ended are buried."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:  # there is none
        return False
    return True


def replay(data: bytes) -> str:
    """Obey frames in this process, without limits: where a debugger can look; the last reply in words."""
    server, last = Server(), "there was no job in the file"
    for frame in read_frames(_Bytes(data)):
        for reply in read_frames(_Bytes(server.handle(frame) or b"")):
            last = reply.form.told["reason"] or str(codec.value_of(reply.form, reply.arrays))
    return last


class _Bytes:
    """Frames from memory."""

    def __init__(self, data: bytes) -> None:
        self._left = data

    def recv(self, count: int) -> bytes:
        found, self._left = self._left[:count], self._left[count:]
        return found
