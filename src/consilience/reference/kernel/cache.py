"""Folder of the compiled kernels, named after a digest of the sources that kernels are made of.

Numba compiles a kernel anew when the file of the kernel changes, but not when a kernel or a constant of another file
does. With a folder for each state of the sources, a kernel never runs with kernels of another state.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).parents[2]

_ROOMS = ("kernel", "bodies", "integrators", "steppers", "tree", "formulations", "states")

SOURCES = (
    *(f"reference/{room}/*.py" for room in _ROOMS),
    *(f"reference/contact/{name}.py" for name in ("pairs", "algebra", "derivative")),
    *(f"mechanism/{name}.py" for name in ("constraints", "elements")),
)
"""Patterns of the files that kernels are made of: their own, and those of the constants they take from elsewhere."""


@cache
def digest(package: Path) -> str:
    """Return the digest of the sources of all kernels of a package."""
    found = hashlib.sha256()
    for pattern in SOURCES:
        for file in sorted(package.glob(pattern)):
            found.update(f"{file.relative_to(package).as_posix()}\n".encode() + file.read_bytes())
    return found.hexdigest()[:16]


def kernels_folder() -> Path:
    """Return the folder of the compiled kernels, in NUMBA_CACHE_DIR or else beside this file; make nothing."""
    return _folder_in(os.environ.get("NUMBA_CACHE_DIR"))


@cache
def _folder_in(named: str | None) -> Path:
    return (Path(named) if named else Path(__file__).parent / "__pycache__") / f"kernels-{digest(_PACKAGE)}"


@contextmanager
def one_process(kernel: str) -> Iterator[None]:
    """Let one process at a time compile a kernel: another one that needs it waits, and finds it in the folder."""
    folder = kernels_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / f"{kernel}.lock").open("w")
    except OSError:  # Numba keeps kernels elsewhere where the folder cannot be written
        yield
        return
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@cache
def announce_compilation() -> None:
    """Log, once in a process, that kernels are to be compiled, where none of these sources are in the folder."""
    folder = kernels_folder()
    if os.environ.get("NUMBA_DISABLE_JIT", "0") == "0" and next(folder.rglob("*.nbi"), None) is None:
        what = "compiling the reference solver for this machine: a minute or two, the first time only; kept in %s"
        logging.getLogger("consilience").warning(what, folder)
