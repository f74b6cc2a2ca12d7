"""Server in a worker process: one engine that answers jobs over a socket. Imports NumPy and the standard library.

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
from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np

from consilience.engine.answers import Method
from consilience.engine.protocol import Engine, load_engine
from consilience.engine.questions import Question
from consilience.engine.worker import codec, wire
from consilience.engine.worker.requests import Request, perform, raised, unpack_states
from consilience.engine.worker.wire import Incoming, Message, MessageHeader, ProtocolError
from consilience.mechanism import Mechanism

_T = TypeVar("_T")

_HIGH = 200
"""Lowest number of the descriptors that the protocol uses."""

_CHUNK = 2**16
"""Number of bytes that are read at a time."""

_PR_SET_CHILD_SUBREAPER = 36
"""Linux: descendants whose parent has gone become children of this process."""


class Server:
    """One engine, with the mechanisms and methods that the worker keeps for it."""

    def __init__(self) -> None:
        self.engine: Engine | None = None
        self.kept: dict[str, Mechanism | Method] = {}
        self._requests: dict[MessageHeader, Request] = {}
        self._headers: dict[tuple[Any, ...], bytes] = {}

    def handle(self, message: Message) -> bytes | None:
        """Obey one message; return the frame of the reply, or None where the protocol has none.

        Raises
        ------
        ProtocolError
            If runner and worker do not fit one another.
        """
        if message.header in self._requests:
            return self._reply(message, self._request, self._perform)
        entries = message.header.entries
        kind = entries.get("kind")
        _check_entries(kind, entries)
        if kind == "load":
            return self._reply(message, lambda _: entries["engine"], self._load)
        if kind == "job":
            return self._reply(message, self._request, self._perform)
        self._requests.clear()  # a key may mean another value from here on
        if kind == "forget":
            self.kept.pop(entries["key"], None)
            return None
        value = codec.value_of(message.header, message.arrays)
        if not isinstance(value, Mechanism | Method):
            raise ProtocolError(f"a {type(value).__name__} is neither mechanism nor method")
        self.kept[entries["key"]] = _frozen(value)
        return None

    def _load(self, name: str) -> None:
        self.engine = load_engine(name)

    def _request(self, message: Message) -> Request:
        """Return the request of a job: that of its header, with its states, times and parameters."""
        header, arrays = message.header, message.arrays
        request = self._requests.get(header)
        if request is None:
            request = self._request_of_header(header.entries, len(arrays))
            _remember(self._requests, header, request)
        if not arrays and "parameters" not in header.entries:
            return request
        states, times = _counts(header.entries)
        try:
            given = unpack_states(arrays[0]) if states else ()
        except ValueError as error:
            raise ProtocolError(f"the job is no request: {error}") from None
        grid = arrays[states] if times else None
        more = codec.value_of(header, arrays[states + times :], "parameters") if "parameters" in header.entries else {}
        return replace(request, states=given, times=grid, parameters=more)

    def _request_of_header(self, entries: dict[str, Any], arrays: int) -> Request:
        """Return the request of a job without states, times and parameters."""
        mechanism, method = self._kept(entries["mechanism"], Mechanism), self._kept(entries["method"], Method)
        more = arrays - sum(_counts(entries))
        if more < 0 or (more and "parameters" not in entries):
            raise ProtocolError(f"the job has {arrays} arrays, and says otherwise")
        try:
            question = None if entries["question"] is None else Question(entries["question"])
            survey = tuple(map(Question, entries["survey"]))
        except ValueError as error:
            raise ProtocolError(f"the job is no request: {error}") from None
        return Request(mechanism, question, method, step=entries["step"], survey=survey)

    def _kept(self, key: str | None, kind: type[_T]) -> _T | None:
        """Return the value that was sent under a key."""
        if key is None:
            return None
        value = self.kept.get(key)
        if not isinstance(value, kind):
            raise ProtocolError(f"the job refers to a {kind.__name__} that was not sent")
        return value

    def _perform(self, request: Request) -> object:
        assert self.engine is not None
        return perform(self.engine, request)

    def _reply(self, message: Message, read: Callable[[Message], _T], action: Callable[[_T], object]) -> bytes:
        """Return the reply to a message: the value of an action or why there is none, and the action's CPU time."""
        start, spent = None, 0.0
        try:
            given = read(message)
            start = time.process_time()
            answer = action(given)
            spent = time.process_time() - start
            return self._packed(answer, message.job, spent)
        except Exception as error:  # noqa: BLE001 - whatever an engine or its adapter raises is evidence about that engine
            if start is not None:
                spent = time.process_time() - start
            reason = str(error) if isinstance(error, ProtocolError) else raised(error)
            return wire.pack(_reply_entries(reason, _left_behind(), None), job=message.job, cpu=spent)

    def _packed(self, answer: object, number: int, spent: float) -> bytes:
        """Return the reply with a value; the header is reused for answers of the same outline."""
        outline, arrays = codec.outlined(answer)
        strays = _left_behind()
        header = None if outline is None or strays else self._headers.get(outline)
        if header is None:
            tree, arrays = codec.encode(answer)
            listed = [(array.dtype, array.shape) for array in arrays]
            header = wire.pack_header(_reply_entries("", strays, tree), listed)
            if outline is not None and not strays:
                _remember(self._headers, outline, header)
        return wire.pack_frame(header, [array.tobytes() for array in arrays], number, spent)


_REMEMBERED = 256
"""Number of requests, and of headers of replies, that a worker keeps."""


def _remember(table: dict[Any, Any], key: object, value: object) -> None:
    if len(table) >= _REMEMBERED:
        table.clear()
    table[key] = value


def _counts(entries: dict[str, Any]) -> tuple[bool, bool]:
    """Return whether a job has an array of states, and one of times."""
    return entries["states"] == 1, entries["times"] == 1


def _reply_entries(reason: str, strays: bool, tree: object) -> dict[str, Any]:
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
"""Required entries of each kind of message, and their types."""


def _check_entries(kind: object, entries: dict[str, Any]) -> None:
    required = _ENTRIES.get(kind) if isinstance(kind, str) else None
    if required is None:
        raise ProtocolError(f"no frame is of the kind {str(kind)[:80]!r}")
    for name, expected in required.items():
        if name not in entries or not isinstance(entries[name], expected):
            raise ProtocolError(f"a frame of the kind {kind!r} has no {name!r} of the right type")


def _frozen(kept: Mechanism | Method) -> Mechanism | Method:
    """Make all arrays of a value read-only, as they are in the runner: adapters cache by the kept mechanism."""
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
    """Source of frames."""

    def recv(self, count: int, /) -> bytes:
        """Return at most so many bytes; none at the end."""
        ...


def read_frames(stream: Stream) -> Iterator[Message]:
    """Read frames as they arrive, up to the end of the stream.

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
    """Socket on which `poll` waits for data alone.

    A process that waits in `recv` also wakes when the other end has read an answer and the buffer has room again, which
    costs a context switch and an interrupt of the runner's core in each job.
    """

    def __init__(self, stream: socket.socket) -> None:
        self._stream, self._poll = stream, select.poll()
        self._poll.register(stream, select.POLLIN)

    def recv(self, count: int) -> bytes:
        self._poll.poll()
        return self._stream.recv(count)


def serve(channel: int, lifeline: int) -> None:
    """Answer jobs until the runner closes the channel or dies."""
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
        for message in read_frames(_Waiting(runner)):
            reply = server.handle(message)
            if reply is not None:
                _flush(flush)
                runner.sendall(reply)


def _settle(lifeline: int) -> None:
    """Prepare the process: die with the runner, ignore Ctrl-C, write no core file, print the stack of a crash."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.enable(sys.stderr, all_threads=False)
    faulthandler.register(signal.SIGUSR1, sys.stderr, all_threads=False)
    if sys.platform == "linux":
        # no process writes to the lifeline: its signal ends this process group when the runner dies
        fcntl.fcntl(lifeline, fcntl.F_DUPFD_CLOEXEC, _HIGH)
        os.close(lifeline)
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _flush(all_of_c: Callable[[None], object]) -> None:
    """Flush the output of the engine, so that all of it belongs to this job."""
    for stream in (sys.stdout, sys.stderr):
        try:  # noqa: SIM105 - here and below, a context manager takes several times as long as what it wraps
            stream.flush()
        except (OSError, ValueError):  # an engine may have closed its own
            pass
    all_of_c(None)


def _left_behind() -> bool:
    """Whether a process that the engine started still runs; processes that have ended are reaped."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:  # there is none
        return False
    return True


def replay(data: bytes) -> str:
    """Obey the frames of a job in this process, for a debugger, without limits; return the last reply as text."""
    server, last = Server(), "there was no job in the file"
    for message in read_frames(_Bytes(data)):
        for reply in read_frames(_Bytes(server.handle(message) or b"")):
            value = codec.value_of(reply.header, reply.arrays)
            last = reply.header.entries["reason"] or str(getattr(value, "__dict__", value))  # all numbers of an answer
    return last


class _Bytes:
    """Stream of bytes in memory."""

    def __init__(self, data: bytes) -> None:
        self._left = data

    def recv(self, count: int) -> bytes:
        found, self._left = self._left[:count], self._left[count:]
        return found
