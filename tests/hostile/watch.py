"""Watch a process while it reads an input: files that it touches, programs that it starts, code that it runs, time."""

import os
import pkgutil
import signal
import sys
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path

import consilience
from hostile.mutations import MARK

LIMIT = 5.0
"""CPU time of one input at most, s."""

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

CHANGES = (
    *("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.chown"),
    *("shutil.rmtree", "shutil.move", "shutil.copyfile"),
)
"""Events whose first argument is the path that changes; of a rename both are looked at."""

NEVER = (
    *("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.spawn", "os.putenv", "os.chdir"),
    *("socket.connect", "socket.getaddrinfo", "socket.bind", "urllib.Request", "webbrowser.open"),
    *("pickle.find_class", "marshal.loads", "ctypes.dlopen", "code.__new__", "import"),
)


class Breach(Exception):
    """An input caused an action that no input may cause."""


class Hang(Exception):
    """Processing of an input took too long."""


_folder = None
_seen = []


def _inside(path):
    if isinstance(path, int):
        return True  # a file descriptor that is already open
    return Path(os.fsdecode(path)).resolve().is_relative_to(_folder)


def _installed(name):
    """Whether code comes from a file of the project or of a package, not from data."""
    return Path(name).is_absolute() and Path(name).exists() and not Path(name).is_relative_to(_folder)


def _look(event, arguments):
    if _folder is None:
        return
    bad = event in NEVER
    if event == "open":
        path, _, flags = arguments
        bad = (flags & WRITES and not _inside(path)) or MARK in str(path)
    elif event in CHANGES:
        bad = not all(_inside(path) for path in arguments[: 1 + (event in ("os.rename", "os.link"))])
    elif event == "compile":
        bad = not _installed(os.fsdecode(arguments[1]))
    elif event == "exec":
        bad = not _installed(arguments[0].co_filename)
    if bad:
        _seen.append(f"{event} {str(arguments)[:300]}")


@cache
def import_everything():
    """Import all modules of the project and their late imports, so that these are not attributed to an input."""
    for module in pkgutil.walk_packages(consilience.__path__, "consilience."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    for late in ("scipy.interpolate", "encodings.unicode_escape"):
        import_module(late)


_hooked = False


def _late(_number, _frame):
    raise Hang("it took too long")


@contextmanager
def watched(folder, limit=LIMIT):
    """Raise `Breach` for actions in this context that no input may cause, `Hang` after the time limit."""
    global _folder, _hooked  # noqa: PLW0603 (an audit hook stays until the process ends)
    if not _hooked:
        sys.addaudithook(_look)
        _hooked = True
    _seen.clear()
    before = signal.signal(signal.SIGVTALRM, _late)
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    _folder = Path(folder).resolve()
    try:
        yield
    finally:
        _folder = None
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)
    if _seen:
        raise Breach("; ".join(_seen))
