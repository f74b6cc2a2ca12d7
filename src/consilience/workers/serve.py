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
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from consilience.engine import Engine, load_engine
from consilience.mechanism import Mechanism
from consilience.spatial import Array
from consilience.workers import codec, frames
from consilience.workers.frames import Header, ProtocolError
from consilience.workers.jobs import Request, perform, raised

_HIGH = 200
"""Least number of the descriptor that the protocol uses."""

_F_SETSIG, _PR_SET_CHILD_SUBREAPER = 10, 36
"""Linux: the signal that a descriptor raises; descendants whose parent has gone become children of this process."""


class Server:
    """One engine and the mechanisms it has been sent."""

    def __init__(self) -> None:
        self.engine: Engine | None = None
        self.mechanisms: dict[str, Mechanism] = {}

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
            return self._replied(header, lambda: self._load(header["engine"]))
        if kind == "mechanism":
            mechanism = codec.decode(header["value"], arrays)
            if not isinstance(mechanism, Mechanism):
                raise ProtocolError(f"a {type(mechanism).__name__} is no mechanism")
            self.mechanisms[header["key"]] = _frozen(mechanism)
            return None
        if kind == "forget":
            self.mechanisms.pop(header["key"], None)
            return None
        return self._replied(header, lambda: self._perform(header, arrays))

    def _load(self, name: str) -> None:
        self.engine = load_engine(name)

    def _perform(self, header: Header, arrays: Sequence[Array]) -> object:
        request = codec.decode(header["value"], arrays)
        if not isinstance(request, Request) or header["mechanism"] not in (None, *self.mechanisms):
            raise ProtocolError("the job is no request, or about a mechanism that was not sent")
        if header["mechanism"] is not None:
            request = replace(request, mechanism=self.mechanisms[header["mechanism"]])
        assert self.engine is not None
        return perform(self.engine, request)

    def _replied(self, header: Header, action: Any) -> bytes:
        """Reply to a frame: the value, or in words why there is none, and the CPU time."""
        start = time.process_time()
        reply: Header = {"kind": "reply", "job": header["job"], "reason": "", "value": None}
        try:
            answer = action()
            reply |= {"cpu": time.process_time() - start, "strays": _left_behind()}
            value, arrays = codec.encode(answer)
            return frames.pack(reply | {"value": value}, arrays)
        except Exception as error:  # noqa: BLE001 - whatever an engine or its adapter raises is evidence about that engine
            reply |= {"cpu": time.process_time() - start, "strays": _left_behind()}
            return frames.pack(reply | {"reason": str(error) if isinstance(error, ProtocolError) else raised(error)})


_ENTRIES: dict[str, dict[str, Any]] = {
    "load": {"job": int, "engine": str},
    "mechanism": {"key": str, "value": object},
    "forget": {"key": str},
    "job": {"job": int, "mechanism": str | None, "value": object},
}
"""By the kind of a frame: its other entries and their types."""


def _check_entries(kind: object, header: Header) -> None:
    entries = _ENTRIES.get(kind) if isinstance(kind, str) else None
    if entries is None:
        raise ProtocolError(f"no frame is of the kind {str(kind)[:80]!r}")
    for name, expected in entries.items():
        if name not in header or not isinstance(header[name], expected):
            raise ProtocolError(f"a frame of the kind {kind!r} has no {name!r} of the right type")


def _frozen(mechanism: Mechanism) -> Mechanism:
    """Make every array read-only, as the runner has it: a mechanism that is remembered must not change."""
    stack: list[Any] = [mechanism]
    while stack:
        value = stack.pop()
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        elif isinstance(value, tuple):
            stack += value
        elif type(value) in codec.CLASSES.values():
            stack += vars(value).values()
    return mechanism


# ---------------------------------------------------------------- the process


class Stream(Protocol):
    """Where frames come from."""

    def recv_into(self, buffer: memoryview, /) -> int:
        """Fill the buffer, or a part of it; 0 at the end."""
        ...


def read_frame(stream: Stream) -> tuple[Header, list[Array]] | None:
    """Wait for the next frame; None at the end of the stream."""
    prefix = _exactly(stream, frames.PREFIX.size)
    if prefix is None:
        return None
    n_header, n_body = frames.sizes(bytes(prefix))
    header, body = _exactly(stream, n_header), _exactly(stream, n_body)
    return None if header is None or body is None else frames.unpack(header, body)


def _exactly(stream: Stream, count: int) -> bytearray | None:
    found = bytearray(count)
    view, have = memoryview(found), 0
    while have < count:
        more = stream.recv_into(view[have:])
        if more == 0:
            return None
        have += more
    return found


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
        while (frame := read_frame(runner)) is not None:
            reply = server.handle(*frame)
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
        # nobody writes to the lifeline: that it is ready means that the runner has gone
        high = fcntl.fcntl(lifeline, fcntl.F_DUPFD_CLOEXEC, _HIGH)
        os.close(lifeline)
        fcntl.fcntl(high, fcntl.F_SETOWN, -os.getpgrp())
        fcntl.fcntl(high, _F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(high, fcntl.F_SETFL, fcntl.fcntl(high, fcntl.F_GETFL) | os.O_ASYNC)
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


class _Bytes:
    """Frames from memory."""

    def __init__(self, data: bytes) -> None:
        self._left = memoryview(data)

    def recv_into(self, buffer: memoryview, /) -> int:
        count = min(len(buffer), len(self._left))
        buffer[:count] = self._left[:count]
        self._left = self._left[count:]
        return count


def replay(data: bytes) -> str:
    """Obey frames in this process, without limits: where a debugger can look; the last reply in words."""
    stream, server, last = _Bytes(data), Server(), "there was no job in the file"
    while (frame := read_frame(stream)) is not None:
        reply = server.handle(*frame)
        if reply is not None:
            header, arrays = read_frame(_Bytes(reply)) or ({}, [])
            last = header["reason"] or str(codec.decode(header["value"], arrays))
    return last
