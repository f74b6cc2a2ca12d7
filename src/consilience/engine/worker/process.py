"""Runner's side of one worker process: start, exchange of frames under limits, output, end.

psutil reads the memory of the process and finds the processes that it leaves behind.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from consilience.engine.worker.wire import Incoming, Message, ProtocolError

_SLICE = 0.05
"""Time in s between two checks of a busy worker: its memory, whether it lives, whether the job was given up."""

LOG_LIMIT = 4000
MOST_OUTPUT = 64 * 2**20
"""Characters of the output of a job that are kept, and bytes of output beyond which the worker is stopped."""

_CHUNK = 2**16
_LAST_WORDS = 0.2
"""Time in s that a hanging worker has to print its stack, and a worker with a closed connection to die."""

_MARK = "CONSILIENCE_WORKER"
"""Environment variable by which the processes that a worker started are recognised."""


@dataclass(frozen=True)
class Launch:
    """How to start a worker: interpreter, folders for imports, and a remark that names the environment."""

    python: str
    path: tuple[str, ...]
    remarks: str = ""


class Fault(Exception):
    """The worker died, or broke the protocol or a limit; the process must be replaced."""


_F_SETSIG = 10
"""Linux: the signal that a descriptor raises."""


def _tie(lifeline: int, group: int) -> None:
    """Have the system kill a process group when the runner, the only holder of the other end of a pipe, has ended.

    The signal belongs to the open pipe, not to a process: the system raises it even while the worker starts or runs
    native code.
    """
    if sys.platform == "linux":
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, -group)
        fcntl.fcntl(lifeline, _F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)


class Process:
    """One worker process.

    Parameters
    ----------
    launch : Launch
    memory : int, bytes
        Limit of its resident memory.

    Attributes
    ----------
    more : bool
        Whether bytes arrived behind the last answer.
    """

    def __init__(self, launch: Launch, memory: int) -> None:
        self._memory = memory
        self._mark = secrets.token_hex(8)
        self._wire, theirs = socket.socketpair()
        lifeline, self._lifeline = os.pipe()
        self._output, printed = os.pipe()
        variables = os.environ | {"PYTHONPATH": os.pathsep.join(launch.path), _MARK: self._mark}
        try:
            self._process = subprocess.Popen(
                [launch.python, "-P", "-m", "consilience.engine.worker", str(theirs.fileno()), str(lifeline)],
                env=variables,
                stdin=subprocess.DEVNULL,
                stdout=printed,
                stderr=printed,
                pass_fds=(theirs.fileno(), lifeline),
                start_new_session=True,
            )
            _tie(lifeline, self._process.pid)
        except BaseException:
            self._close()
            raise
        finally:
            theirs.close()
            os.close(lifeline)
            os.close(printed)
        self._wire.setblocking(False)
        os.set_blocking(self._output, False)
        self._channel = self._wire.fileno()
        self._poll = select.poll()
        self._poll.register(self._output, select.POLLIN)
        self._poll.register(self._wire, select.POLLIN)
        self._sending, self.more = False, False
        self._log, self._printed, self._open = bytearray(), 0, True

    # ------------------------------------------------------------ frames

    def quiet(self) -> bool:
        """Whether no bytes have arrived without a job."""
        if self.more:
            return False
        return not dict(self._poll.poll(0)).get(self._channel, 0) & ~select.POLLOUT

    def exchange(self, data: bytes, limit: float, stopped: Callable[[], bool]) -> Message:
        """Send frames and wait for one frame.

        Parameters
        ----------
        data : bytes
            May be empty.
        limit : float, s
        stopped : callable
            Whether the job was given up.

        Raises
        ------
        Fault
            With the reason in words. The process may still live.
        """
        coming = Incoming()
        try:
            left = self._sent(memoryview(data))  # most jobs fit into the buffer of the socket
            now = time.monotonic()
            deadline, look = now + limit, now + _SLICE
            while True:
                self._expect(bool(left))
                ready = dict(self._poll.poll(1000.0 * max(0.0, min(look, deadline) - now)))
                if self._output in ready:  # first: output before an answer belongs to its job
                    self._listen()
                event = ready.get(self._channel, 0)
                if event & select.POLLOUT:
                    left = self._sent(left)
                if event & ~select.POLLOUT and self._received(coming):
                    found = coming.take()
                    self.more = len(coming) > 0
                    return found
                now = time.monotonic()
                if now >= min(look, deadline):
                    self._look(coming, stopped, now >= deadline, limit)
                    look = now + _SLICE
        except ConnectionError:
            raise self._gone(coming) from None
        except ProtocolError as error:
            raise Fault(str(error)) from None

    def _expect(self, sending: bool) -> None:
        """Poll for data, and for room in the socket while bytes are left to send."""
        if sending is not self._sending:
            self._poll.modify(self._wire, select.POLLIN | (select.POLLOUT if sending else 0))
            self._sending = sending

    def _received(self, coming: Incoming) -> bool:
        """Read the available bytes; return whether the frame is complete.

        Raises
        ------
        ConnectionError
            At the end of the stream.
        ProtocolError
            If the bytes are no frame.
        """
        try:
            while chunk := self._wire.recv(_CHUNK):
                if coming.add(chunk):
                    return True
        except BlockingIOError:
            return False
        raise ConnectionResetError

    def _sent(self, data: memoryview) -> memoryview:
        """Send as many bytes as the socket takes now; return the rest."""
        try:
            while data:
                data = data[self._wire.send(data) :]
        except BlockingIOError:
            pass
        return data

    def _look(self, coming: Incoming, stopped: Callable[[], bool], late: bool, limit: float) -> None:
        """Check that the worker lives, is within its memory and time, and that the job was not given up.

        Raises
        ------
        Fault
        """
        if stopped():
            raise Fault("stopped before it answered")
        if self._process.poll() is not None and self.quiet():  # a child may hold the connection open
            raise self._gone(coming)
        if (used := _resident_memory(self._process.pid)) > self._memory:
            raise Fault(f"out of memory: {used / 2**20:.0f} MiB, the limit is {self._memory / 2**20:.0f} MiB")
        if late:
            self._ask_where()
            raise Fault(f"no answer within {limit:g} s; the worker was stopped{_part(coming)}")

    def _gone(self, coming: Incoming) -> Fault:
        """Return why the other end is closed."""
        with suppress(subprocess.TimeoutExpired):
            code = self._process.wait(_LAST_WORDS)
            return Fault(f"the worker died: {_death(code)}{_part(coming)}")
        return Fault(f"the worker closed its connection and lived on{_part(coming)}")

    # ------------------------------------------------------------ output

    def _listen(self) -> None:
        """Read the available output.

        Raises
        ------
        Fault
            If there is too much output.
        """
        while True:
            try:
                chunk = os.read(self._output, _CHUNK)
            except BlockingIOError:
                return
            if not chunk:
                with suppress(KeyError):  # seen before
                    self._poll.unregister(self._output)
                return
            self._printed += len(chunk)
            self._log = (self._log + chunk)[-4 * LOG_LIMIT :]  # up to four bytes a character
            if self._printed > MOST_OUTPUT:
                raise Fault(f"it printed more than {MOST_OUTPUT // 2**20} MiB")
            if len(chunk) < _CHUNK:
                return

    def printed(self) -> str:
        """Return the end of the output that was read since the last call."""
        if not self._printed:
            return ""
        text = self._log.decode(errors="replace")[-LOG_LIMIT:]
        self._log, self._printed = bytearray(), 0
        return text

    def _ask_where(self) -> None:
        """Make a hanging worker print its Python stack."""
        with suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGUSR1)
        until = time.monotonic() + _LAST_WORDS
        before = self._printed
        while time.monotonic() < until and self._printed == before:
            time.sleep(_LAST_WORDS / 20)
            with suppress(Fault):
                self._listen()

    # ------------------------------------------------------------ the end

    def end(self) -> str:
        """Kill the process and all processes it started; return the end of its output."""
        if not self._open:
            return ""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._process.wait()
        _kill_marked(self._mark)
        with suppress(Fault, OSError):
            self._listen()
        self._close()
        return self.printed()

    def _close(self) -> None:
        self._open = False
        self._wire.close()
        os.close(self._lifeline)
        os.close(self._output)


def _resident_memory(pid: int) -> int:
    """Return the resident memory of a process in bytes, zero if it is gone."""
    import psutil  # noqa: PLC0415 - `simulate` starts no process

    with suppress(psutil.Error):
        return int(psutil.Process(pid).memory_info().rss)
    return 0


def _kill_marked(mark: str) -> None:
    """Kill the processes that carry the mark of a worker: children that have left the process group."""
    import psutil  # noqa: PLC0415

    for pid in psutil.pids():
        with suppress(psutil.Error, OSError):
            other = psutil.Process(pid)
            if other.environ().get(_MARK) == mark:
                other.kill()


def _part(coming: Incoming) -> str:
    """Describe the received part of an incomplete frame."""
    whole = f" of {coming.announced}" if coming.announced else ""
    return f", after {len(coming)}{whole} bytes of an answer" if len(coming) else ""


def _death(exitcode: int) -> str:
    if exitcode >= 0:
        return f"exit code {exitcode}"
    names = {s.value: s.name for s in signal.Signals}
    why = " (the system kills so when memory runs out)" if exitcode == -signal.SIGKILL else ""
    return f"signal {names.get(-exitcode, -exitcode)}{why}"
