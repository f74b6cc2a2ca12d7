"""``consilience doctor``: obstacles to a run on this machine, each with its remedy."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import psutil
import typer

from consilience.case import load_case
from consilience.cli.options import EngineNames, Form, JobLimit, OutputFormat, chosen_engines
from consilience.cli.terminal import err
from consilience.compare import Verdict
from consilience.engine import (
    Profile,
    Question,
    engine_distribution,
    installed,
    lacks_engine,
    pip_requirement,
    split_name,
)
from consilience.engine.worker.environments import cache_directory
from consilience.reference.kernel.cache import kernels_folder
from consilience.report.record import exit_code
from consilience.report.statement import WRITERS, Statement
from consilience.suite import Resources, Results, run_suite

GIBI = 2**30


@dataclass(frozen=True)
class Diagnosis:
    """Finding about a part of this machine or about an engine.

    Attributes
    ----------
    what : str
    state : str
        ``well``; ``note``: a run works, with a loss; ``ill``: something does not work.
    found : str
    remedy : str
        Action to take, in a line; empty where all is well.
    """

    what: str
    state: str
    found: str
    remedy: str = ""


CURES: tuple[tuple[str, str], ...] = (
    (r"No module named '(?P<module>[\w.]+)'", "pip install '{wanted}' (its module {module} is not there)"),
    (r"ImportError|undefined symbol|cannot open shared object|GLIBC", "pip install --force-reinstall '{wanted}'"),
    (r"no answer within", "give it more time: consilience doctor --limit 1800; something else may hold the processor"),
    (r"out of memory|MemoryError", "close other programs: a worker may have 4 GiB"),
    (
        r"signal SIG\w+",
        "see where it dies: python -X faulthandler -c 'import {module_of_engine}'; then reinstall {wanted}",
    ),
    (
        r"no such version|is no version|No matching distribution",
        "name a version that the package index has, and check the network",
    ),
    (r"AttributeError|TypeError", "the adapter was written for another version: pip install '{wanted}'"),
)
"""Patterns in the reason of a failed start, each with its remedy; the first pattern that matches counts."""


def cure(reason: str, wanted: str, module: str) -> str:
    """Choose the remedy for an engine that does not start.

    Parameters
    ----------
    reason : str
        Message of the worker of the engine.
    wanted : str
        Distribution with its version, as an argument of pip.
    module : str
        Module of the engine, to be imported in a trial.
    """
    for pattern, text in CURES:
        if found := re.search(pattern, reason):
            return text.format(**{"wanted": wanted, "module_of_engine": module, **found.groupdict()})
    return f"read the reason; then pip install --force-reinstall '{wanted}'"


def pinned() -> dict[str, str]:
    """Return the version that Consilience pins, by distribution."""
    found = (re.match(r"([\w.-]+)\s*==\s*([\w.]+)", text) for text in requires("consilience") or ())
    return {match[1].lower(): match[2] for match in found if match}


def of_engine(engine: str, results: Results) -> Diagnosis:
    """Diagnose an engine: does not start, differs from the reference, is of an untested version, or agrees."""
    name, _, asked = split_name(engine)
    point = installed()[name]
    distribution = engine_distribution(point) or point.module.partition(".")[0]
    tested = pinned().get(distribution.lower(), "")
    wanted = f"{distribution}=={asked or tested}" if asked or tested else distribution
    if engine in results.missing:
        reason = " ".join(results.missing[engine].split())
        if not asked and lacks_engine(point):
            wanted = pip_requirement(point)
        return Diagnosis(engine, "ill", f"does not start: {reason}", cure(reason, wanted, distribution))
    own = [c for c in results.comparisons if c.engine == engine and c.profile is Profile.MATCHED]
    bad = [c for c in own if c.verdict not in (Verdict.AGREES, Verdict.UNSUPPORTED)]
    here = results.engines[engine].version
    if bad:
        text = "; ".join(f"{c.question}, {c.method}: {c.verdict}: {c.why}" for c in bad)
        remedy = f"pip install '{wanted}', the version that is tested" if tested not in ("", here) else ""
        return Diagnosis(engine, "ill", f"{here}: {text}", remedy or f"consilience run double_pendulum -e {engine}")
    installed_here = _version_of(distribution)
    if tested and not asked and installed_here not in ("", tested):
        text = f"{here}: agrees with the reference; tested with {tested}"
        return Diagnosis(engine, "note", text, f"pip install '{wanted}', or ask for both: -e {engine}@{tested}")
    return Diagnosis(engine, "well", f"{here}: agrees with the reference")


def _version_of(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


def writable(folder: Path) -> bool:
    """Whether files can be created in a folder, or in its nearest parent that exists."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _noted(what: str, found: str, remedy: str = "") -> Diagnosis:
    """Make the diagnosis of a part of this machine: a note if there is a remedy, else all is well."""
    return Diagnosis(what, "note" if remedy else "well", found, remedy)


def _python() -> Diagnosis:
    return _noted("Python", platform.python_version())


def _kernels() -> Diagnosis:
    folder, what = kernels_folder(), "compiled kernels"
    if not writable(folder):
        remedy = "export NUMBA_CACHE_DIR=$HOME/.cache/consilience-numba, or each process compiles for a minute or two"
        return _noted(what, f"{folder} cannot be written", remedy)
    if next(folder.rglob("*.nbi"), None) is None:
        remedy = "none: the first run compiles for a minute or two; `consilience simulate double_pendulum` does it now"
        return _noted(what, f"none yet in {folder}", remedy)
    return _noted(what, f"in {folder}")


def _processors() -> Diagnosis:
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return _noted("processors", f"{count}", "run with --jobs 1: engines then take their turns" * (count < 2))


def _memory() -> Diagnosis:
    free = psutil.virtual_memory().available / GIBI
    return _noted("memory", f"{free:.1f} GiB free", "close other programs, or run with --jobs 1" * (free < 2.0))


def _threads() -> Diagnosis:
    asked = os.environ.get("OMP_NUM_THREADS", "1")
    if asked == "1":
        return _noted("threads", "one for each engine")
    remedy = "unset OMP_NUM_THREADS: several threads change timings, and the last digits of some engines"
    return _noted("threads", f"OMP_NUM_THREADS={asked}", remedy)


def _versions_folder() -> Diagnosis:
    folder, what = cache_directory(), "cache for other versions"
    if writable(folder):
        return _noted(what, str(folder))
    remedy = "export XDG_CACHE_HOME to a folder of yours; only NAME@VERSION needs it"
    return _noted(what, f"{folder} cannot be written", remedy)


EXTRAS = {
    "matplotlib": "plot",
    "resvg_py": "plot",
    "casadi": "lagrange",
    "hypothesis": "fuzz",
    "pandas": "frames",
    "polars": "frames",
    "xarray": "frames",
}
"""Extra that installs an optional module."""


def _extras() -> Diagnosis:
    lacking = sorted({extra for module, extra in EXTRAS.items() if importlib.util.find_spec(module) is None})
    if lacking:
        return _noted("extras", f"not here: {', '.join(lacking)}", f"pip install 'consilience[{','.join(lacking)}]'")
    return _noted("extras", ", ".join(sorted(set(EXTRAS.values()))))


CHECKS: tuple[Callable[[], Diagnosis], ...] = (
    _python,
    _processors,
    _memory,
    _threads,
    _kernels,
    _versions_folder,
    _extras,
)
"""Diagnoses of this machine, before any engine starts."""


def doctor(engine: EngineNames = None, limit: JobLimit = 600.0, form: Form = OutputFormat.TEXT) -> None:
    """Diagnose this machine, start every engine and let it answer two questions; tell the remedy for what is ill.

    Exit code: 0 every engine agrees, 1 one differs, 3 one does not start. Notes do not count.
    """
    names = chosen_engines(engine)
    with err.status("starting engines; the reference compiles for a minute or two, the first time"):
        questions = Question.MODEL, Question.INSTANT
        results = run_suite([load_case("double_pendulum")], names, questions, Resources(limit=limit))
    found = [*(check() for check in CHECKS), *(of_engine(name, results) for name in names)]
    count = Counter(one.state for one in found)
    sentence = f"{count['ill']} ill, {count['note']} to note, {count['well']} well."
    rows = [(one.what, one.state, one.found, one.remedy) for one in found]
    table = ("what was looked at", ("what", "state", "found", "remedy"), rows)
    data = {"ill": count["ill"], "notes": count["note"], "diagnoses": [asdict(one) for one in found]}
    sys.stdout.write(WRITERS[form](Statement([sentence], [table], data)))
    raise typer.Exit(exit_code(results))
