"""Whole processes: the command line, warm and with an empty cache of compiled kernels."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from tables import Table

COMMAND = "import sys; from consilience.cli.main import main; sys.exit(main())"
SIMULATE = ("simulate", "double-pendulum", "-e", "reference")
PROCESSES = {
    "python -c pass": (["-c", "pass"], "the floor"),
    "python -c 'import numpy'": (["-c", "import numpy"], "to compare"),
    "python -c 'import numpy, scipy.integrate, numba'": (["-c", "import numpy, scipy.integrate, numba"], "to compare"),
    "python, Numba made ready to load a kernel": (
        ["-c", "from numba.core.registry import cpu_target; cpu_target.target_context.refresh()"],
        "the floor of a compiled run",
    ),
    "consilience --help": (["-c", COMMAND, "--help"], "0.3 s"),
    f"consilience {' '.join(SIMULATE)}": (["-c", COMMAND, *SIMULATE], "1.5 s"),
}
ANNOUNCED = "compiling"


def _process(arguments: list[str], folder: Path, environment: Mapping[str, str]) -> tuple[float, float, str]:
    """Return wall time and CPU time in s, and the text on standard error."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stderr


def _quartiles(values: list[float]) -> str:
    low, median, high = np.percentile(values, (25, 50, 75))
    return f"{median:.2f} s ({low:.2f} to {high:.2f})"


def run(short: bool) -> Iterator[Table]:
    """Yield one table. Bytecode is kept in a separate folder, as in an installation."""
    columns = ("process", "wall time", "CPU time", "bar")
    table = Table("The command line as a whole process", "From the start of Python to its end.", columns)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
        for arguments, _ in PROCESSES.values():
            _process(arguments, folder, environment)
        spent: dict[str, list[tuple[float, float]]] = {process: [] for process in PROCESSES}
        for _ in range(5 if short else 9):
            for process, (arguments, _) in PROCESSES.items():
                spent[process].append(_process(arguments, folder, environment)[:2])
        for process, (_, bar) in PROCESSES.items():
            wall, cpu = (_quartiles(list(column)) for column in zip(*spent[process], strict=True))
            table.rows.append([process, wall, cpu, bar])
        if not short:
            environment["NUMBA_CACHE_DIR"] = str(folder / "kernels")
            wall, cpu, said = _process(["-c", COMMAND, *SIMULATE], folder, environment)
            words = "it says that it compiles" if ANNOUNCED in said else "it does not say that it compiles"
            table.rows.append([f"the same, first run ever; {words}", f"{wall:.1f} s", f"{cpu:.1f} s", "60 s"])
    yield table
