"""Environments of workers: this one, or a virtual environment with one version of one engine.

An environment is built at its first use, by uv if installed and otherwise by venv and pip, and kept in the cache
directory of the user. It contains the packages of the adapter's ``worker-requirements.txt``, NumPy, and copies of the
adapter and of the worker side of Consilience: all versions of an engine are asked by the same adapter.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, version
from pathlib import Path
from typing import Any

from packaging.version import InvalidVersion, Version

from consilience.engine.installation import REQUIREMENTS, adapter_file
from consilience.engine.protocol import GROUP, installed, split_name
from consilience.engine.worker.process import Launch

SOURCES = Path(__file__).parents[2]

WORKER_SIDE = (
    *(SOURCES / "__init__.py", SOURCES / "errors.py", *sorted((SOURCES / "mechanism").rglob("*.py"))),
    *(f for f in sorted((SOURCES / "engine").rglob("*.py")) if f.stem not in ("client", "process", "environments")),
)
"""Files of Consilience that a worker and an adapter may import; they import NumPy alone."""

_VERSION = re.compile(r"[0-9][0-9A-Za-z.+!]*")

LONGEST = 1800.0
"""Time limit in s for building an environment."""

_PUBLISHED = re.compile(r"^Available versions: (?P<versions>.+)$", re.MULTILINE)


class NoEnvironment(Exception):
    """An environment cannot be built; the message says why."""


def local_name(engine: str) -> str:
    """Return the name of an engine in the worker that has its version: ``NAME`` for ``NAME@VERSION``."""
    return engine.partition("@")[0]


def cache_directory() -> Path:
    """Return the folder for environments: ``$XDG_CACHE_HOME/consilience``, usually ``~/.cache/consilience``."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "consilience"


def launch_of(engine: str, stopped: Callable[[], bool]) -> Launch:
    """Return how to start the worker of an engine; build its environment if there is none yet.

    Parameters
    ----------
    engine : str
        ``NAME[:VARIANT][@VERSION]``; without a version the worker runs in this environment.
    stopped : callable
        Whether the job was given up.

    Raises
    ------
    NoEnvironment
        If there is no such version, no network, or no adapter that runs in an environment of its own.
    """
    base, _, asked = split_name(engine)
    if not asked:
        return Launch(sys.executable, tuple(folder or os.getcwd() for folder in sys.path))
    point = _point(engine, base)
    package = _package(engine, point)
    needs = _requirements(engine, package, asked)
    python, packages = _environment(f"{base}-{asked}", needs, stopped)
    about = ", ".join(f"{name} {number}" for name, number in packages.items())
    return Launch(str(python), (str(_sources(point, package)),), f"own environment: {about}")


def published_versions(engine: str, first: str, last: str) -> list[str]:
    """List the versions of an engine that pip finds for this Python, oldest first, from `first` to `last` inclusive.

    Parameters
    ----------
    engine : str
        Name without a version.
    first, last : str
        Versions in the sense of PEP 440: ``4.0`` is 4.0.0, and 4.0.1 is later.

    Raises
    ------
    NoEnvironment
        If the bounds are no versions, pip is missing, or it finds no version between them.
    """
    try:
        lowest, highest = Version(first), Version(last)
    except InvalidVersion as error:
        raise NoEnvironment(f"engine '{engine}': {error}; write a range such as 3.3..4.0") from None
    package = _package(engine, _point(engine, split_name(engine)[0]))
    distribution, *_ = (package / REQUIREMENTS).read_text(encoding="utf-8").split()
    command = [sys.executable, "-m", "pip", "index", "versions", "--disable-pip-version-check", distribution]
    try:
        listed = _PUBLISHED.search(_run(distribution, command, lambda: False))
    except NoEnvironment as error:
        reason = str(error).partition(": ")[2]
        raise NoEnvironment(f"engine '{engine}': pip cannot list its versions: {reason}") from None
    found = sorted(map(Version, listed["versions"].split(", ") if listed else ()))
    chosen = [str(version) for version in found if lowest <= version <= highest]
    if not chosen:
        known = f"{found[0]} to {found[-1]}" if found else "none"
        raise NoEnvironment(f"engine '{engine}': pip finds no version from {first} to {last}; it finds {known}")
    return chosen


# ---------------------------------------------------------------- contents of an environment


def _point(engine: str, base: str) -> EntryPoint:
    """Entry point of an installed adapter."""
    known = installed()
    if base not in known:
        raise NoEnvironment(f"engine '{engine}': {base} is not installed; installed engines: {', '.join(known)}")
    return known[base]


def _package(engine: str, point: EntryPoint) -> Path:
    """Folder of an adapter that can live elsewhere; nothing is imported."""
    path = adapter_file(point, REQUIREMENTS)
    if path is None:
        raise NoEnvironment(f"engine '{engine}': its adapter has no {REQUIREMENTS}: it comes in one version only")
    return path.parent


def _requirements(engine: str, package: Path, asked: str) -> list[str]:
    if not _VERSION.fullmatch(asked):
        raise NoEnvironment(f"engine '{engine}': '{asked}' is no version; write one such as 3.3.7")
    first, *others = (package / REQUIREMENTS).read_text(encoding="utf-8").split()
    return [f"{first}=={asked}", *others, "numpy"]


def _sources(point: EntryPoint, package: Path) -> Path:
    """Return a folder with copies of the worker side and of the adapter, named by a digest of their content."""
    files = {str(Path("consilience") / file.relative_to(SOURCES)): file for file in WORKER_SIDE}
    files |= {str(Path(package.name) / f.relative_to(package)): f for f in sorted(package.rglob("*.py"))}
    contents = {name: file.read_bytes() for name, file in files.items()} | _metadata(point)
    digest = hashlib.sha256(json.dumps([[n, c.hex()] for n, c in sorted(contents.items())]).encode()).hexdigest()
    folder = cache_directory() / "sources" / digest[:20]
    if not folder.is_dir():
        draft = folder.with_name(f"{folder.name}.{os.getpid()}.{time.monotonic_ns()}")
        for name, content in contents.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            (draft / name).write_bytes(content)
        try:
            draft.rename(folder)
        except OSError:  # another runner was faster
            shutil.rmtree(draft)
    return folder


def _metadata(point: EntryPoint) -> dict[str, bytes]:
    """Return the metadata files that make the copies a distribution with an entry point."""
    number = version("consilience")
    folder = f"consilience-{number}.dist-info"
    return {
        f"{folder}/METADATA": f"Metadata-Version: 2.1\nName: consilience\nVersion: {number}\n".encode(),
        f"{folder}/entry_points.txt": f"[{GROUP}]\n{point.name} = {point.value}\n".encode(),
    }


# ---------------------------------------------------------------- building an environment


def _environment(name: str, needs: list[str], stopped: Callable[[], bool]) -> tuple[Path, dict[str, str]]:
    """Return the interpreter of an environment, and the versions of its packages; build it if it is incomplete."""
    tag = hashlib.sha256(
        "\n".join([sys.base_prefix, sysconfig.get_platform(), sys.version, *needs]).encode()
    ).hexdigest()
    folder = cache_directory() / "environments" / f"{name}-{tag[:12]}"
    record, python = folder / "consilience.json", folder / "bin" / "python"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _locked(folder.with_suffix(".lock"), stopped):
        if not record.is_file():  # an earlier build did not finish
            shutil.rmtree(folder, ignore_errors=True)
            try:
                _build(name, folder, python, needs, stopped)
                packages = json.loads(_run(name, [str(python), "-c", _LIST], stopped))
                record.write_text(json.dumps({"needs": needs, "packages": packages}), encoding="utf-8")
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        content: dict[str, Any] = json.loads(record.read_text(encoding="utf-8"))
    return python, content["packages"]


_LIST = (
    "import importlib.metadata as m, json, platform;"
    "print(json.dumps({'Python': platform.python_version()}"
    " | {d.name: d.version for d in sorted(m.distributions(), key=lambda d: d.name.lower())"
    " if d.name not in ('pip', 'setuptools')}))"
)


def _build(name: str, folder: Path, python: Path, needs: list[str], stopped: Callable[[], bool]) -> None:
    uv = shutil.which("uv")
    if uv is not None:
        _run(name, [uv, "venv", "--quiet", "--python", sys.executable, str(folder)], stopped)
        _run(name, [uv, "pip", "install", "--quiet", "--python", str(python), *needs], stopped)
        return
    ours = (
        importlib.util.find_spec("pip") is not None
    )  # then the environment needs no pip, which takes longest to build
    _run(name, [sys.executable, "-m", "venv", *(["--without-pip"] if ours else []), str(folder)], stopped)
    pip = [sys.executable, "-m", "pip", "--python", str(python)] if ours else [str(python), "-m", "pip"]
    _run(name, [*pip, "install", "--quiet", "--disable-pip-version-check", *needs], stopped)


def _run(name: str, command: list[str], stopped: Callable[[], bool]) -> str:
    """Return the output of a command; kill it when the job was given up.

    Raises
    ------
    NoEnvironment
        With the lines of its error output that name an error.
    """
    variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    until = time.monotonic() + LONGEST
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=variables
    ) as process:
        while True:
            try:
                said, complaints = process.communicate(timeout=0.1)
                break
            except subprocess.TimeoutExpired:
                if stopped() or time.monotonic() > until:
                    process.kill()
                    raise NoEnvironment(f"the environment of {name} was not built: it was stopped") from None
    if process.returncode:
        lines = [line for line in complaints.splitlines() if line.strip()]
        telling = [line for line in lines if "error" in line.lower() or "×" in line] or lines[-3:]
        raise NoEnvironment(f"the environment of {name} cannot be built: {' '.join(telling)[-1000:]}")
    return said


@contextmanager
def _locked(file: Path, stopped: Callable[[], bool]) -> Iterator[None]:
    """Hold a lock on a file, which the system releases if the process dies."""
    with file.open("w") as handle:
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if stopped():
                    raise NoEnvironment("stopped before its environment was built") from None
                time.sleep(0.1)
        yield
