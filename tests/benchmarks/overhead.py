"""What the harness adds: a suite of cases against the time that the engines spend on their answers."""

from __future__ import annotations

import resource
import time
from collections import defaultdict
from collections.abc import Iterator

from tables import Table

from consilience.engine import installed
from consilience.library import load_case
from consilience.suite import run_suite

SHORT = ("double_pendulum", "four_bar")
CASES = (
    *SHORT,
    "spatial_pendulum",
    "slider_crank",
    "rssr_four_bar",
    "seven_axis_arm",
    "stewart_platform",
    "furuta_pendulum",
    "hookes_joint_free",
    "excavator_arm",
    "andrews-ivp",
    "bricard",
)


def _cpu() -> float:
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


def run(short: bool) -> Iterator[Table]:
    """One table, of one suite: its parts are the many measurements."""
    cases = [load_case(name) for name in (SHORT if short else CASES)]
    start, before = time.perf_counter(), _cpu()
    results = run_suite(cases, list(installed()), jobs=1, limit=600.0)
    wall, cpu = time.perf_counter() - start, _cpu() - before
    own: dict[str, float] = defaultdict(float)
    for one in results.runs:
        own[one.engine] += one.cpu
    engines = sum(own.values())
    about = f"Bar: 25 %. {len(cases)} cases, {len(results.runs)} runs, one worker at a time. The engines' time is what "
    about += "their workers spend on the answers; the rest is starting workers, importing engines, sending, comparing."
    columns = ("what", "time", "on top of the engines")
    table = Table("What the harness adds", about, columns)
    table.rows += [[f"{engine}: answers", f"{spent:.2f} s", ""] for engine, spent in own.items()]
    table.rows.append(["all engines: answers, CPU", f"{engines:.2f} s", ""])
    table.rows.append(
        ["the whole suite, CPU of all processes", f"{cpu:.2f} s", f"{100.0 * (cpu / engines - 1.0):.0f} %"]
    )
    table.rows.append(["the whole suite, wall time", f"{wall:.2f} s", f"{100.0 * (wall / engines - 1.0):.0f} %"])
    yield table
