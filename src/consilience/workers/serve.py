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
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, Protocol, TypeVar

import numpy as np

from consilience.engine import Engine, load_engine
from consilience.mechanism import Mechanism
from consilience.run import Method, Question
from consilience.spatial import Array
from consilience.workers import codec, frames
from consilience.workers.frames import Header, Incoming, ProtocolError
from consilience.workers.jobs import Request, perform, raised, states_of

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

    def handle(self, header: Header, arrays: Sequence[Array]) -> bytes | None:
        """Obey one frame: the reply, packed, or None where none is expected.

        Raises
        ------
        ProtocolError
            If the frame is none of ours: runner and worker do not fit one another.
        """
        kind = header.get("kind")
        _check_entries(kind, header)
        if kind == "load":
            return self._replied(header, lambda: header["engine"], self._load)
        if kind == "keep":
            value = codec.decode(header["value"], arrays)
            if not isinstance(value, Mechanism | Method):
                raise ProtocolError(f"a {type(value).__name__} is neither mechanism nor method")
            self.kept[header["key"]] = _frozen(value)
            return None
        if kind == "forget":
            self.kept.pop(header["key"], None)
            return None
        return self._replied(header, lambda: self._request(header, arrays), self._perform)

    def _load(self, name: str) -> None:
        self.engine = load_engine(name)

    def _request(self, header: Header, arrays: Sequence[Array]) -> Request:
        mechanism, method = self._held(header["mechanism"], Mechanism), self._held(header["method"], Method)
        states, times = header["states"] == 1, header["times"] == 1
        if len(arrays) != states + times:
            raise ProtocolError(f"the job has {len(arrays)} arrays, and says otherwise")
        try:
            question = None if header["question"] is None else Question(header["question"])
            survey = tuple(map(Question, header["survey"]))
            given = states_of(arrays[0]) if states else ()
        except ValueError as error:
            raise ProtocolError(f"the job is no request: {error}") from None
        return Request(mechanism, question, method, given, arrays[-1] if times else None, header["step"], survey)

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

    def _replied(self, header: Header, given: Callable[[], _T], action: Callable[[_T], object]) -> bytes:
        """Reply to a frame: the value, or in words why there is none, and the CPU time of the action."""
        start = time.process_time()
        reply: Header = {"kind": "reply", "job": header["job"], "reason": "", "value": None}
        try:
            read = given()
            start = time.process_time()
            answer = action(read)
            reply |= {"cpu": time.process_time() - start, "strays": _left_behind()}
            value, arrays = codec.encode(answer)
            return frames.pack(reply | {"value": value}, arrays)
        except Exception as error:  # noqa: BLE001 - whatever an engine or its adapter raises is evidence about that engine
            reply |= {"cpu": time.process_time() - start, "strays": _left_behind()}
            return frames.pack(reply | {"reason": str(error) if isinstance(error, ProtocolError) else raised(error)})


_ENTRIES: dict[str, dict[str, Any]] = {
    "load": {"job": int, "engine": str},
    "keep": {"key": str, "value": object},
    "forget": {"key": str},
    "job": {
        **{"job": int, "mechanism": str | None, "method": str | None, "question": str | None},
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


def read_frames(stream: Stream) -> Iterator[tuple[Header, list[Array]]]:
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


def serve(channel: int, lifeline: int) -> None:
    """Answer until the runner closes the channel or dies."""
    _settle(lifeline)
    high = fcntl.fcntl(channel, fcntl.F_DUPFD_CLOEXEC, _HIGH)
    os.close(channel)
    server, libc = Server(), ctypes.CDLL(None)
    with socket.socket(fileno=high) as runner:
        runner.sendall(
            frames.pack(
                {"kind": "hello", "pid": os.getpid(), "python": platform.python_version(), "numpy": np.__version__}
            )
        )
        for header, arrays in read_frames(runner):
            reply = server.handle(header, arrays)
            if reply is not None:
                _flush(libc)
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


def _flush(libc: ctypes.CDLL) -> None:
    """What the engine printed belongs to this job, not to the next."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # an engine may have closed its own
            stream.flush()
    libc.fflush(None)


def _left_behind() -> bool:
    """Whether a process that the engine started still runs; those that have ended are buried."""
    with suppress(ChildProcessError):  # there is none
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
        return True
    return False


def replay(data: bytes) -> str:
    """Obey frames in this process, without limits: where a debugger can look; the last reply in words."""
    server, last = Server(), "there was no job in the file"
    for frame in read_frames(_Bytes(data)):
        for header, arrays in read_frames(_Bytes(server.handle(*frame) or b"")):
            last = header["reason"] or str(codec.decode(header["value"], arrays))
    return last


class _Bytes:
    """Frames from memory."""

    def __init__(self, data: bytes) -> None:
        self._left = data

    def recv(self, count: int) -> bytes:
        found, self._left = self._left[:count], self._left[count:]
        return found
