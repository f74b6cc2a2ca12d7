"""Overhead of the harness: CPU time of a suite beyond the time that the engines spend on their answers.

    python tests/benchmarks overhead
    python tests/benchmarks/overhead.py [--tag TAG] [CASE]...

The second form takes the cases of a tag, or the named cases.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from tables import Table

from consilience.case import Case, load_case, load_cases, shipped_cases
from consilience.engine import installed
from consilience.engine.worker.client import Reply, Request, Worker
from consilience.suite import Resources, run_suite
from consilience.suite.suite import REFERENCE

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


@dataclass
class Asked:
    """Jobs of workers: number, CPU time in s of the engines, and CPU time of runner and workers without the engines."""

    jobs: int = 0
    engines: float = 0.0
    between: float = 0.0


def _cpu(*who: int) -> float:
    return sum(usage.ru_utime + usage.ru_stime for usage in map(resource.getrusage, who))


@contextmanager
def _asked() -> Iterator[Asked]:
    """Count the jobs of workers that run in this context; all workers must have ended at its end."""
    found, ask, before = Asked(), Worker.ask, _cpu(resource.RUSAGE_CHILDREN)

    def counted(worker: Worker, request: Request) -> Reply:
        start = time.thread_time()
        reply = ask(worker, request)
        found.between += time.thread_time() - start
        found.engines += reply.cpu
        found.jobs += 1
        return reply

    Worker.ask = counted  # type: ignore[method-assign]
    try:
        yield found
    finally:
        Worker.ask = ask  # type: ignore[method-assign]
        found.between += _cpu(resource.RUSAGE_CHILDREN) - before - found.engines


def _started(engines: Sequence[str]) -> Asked:
    """Return the cost of starting all engines and asking for their names."""
    with _asked() as found:
        for engine in engines:
            with Worker(engine) as worker:
                worker.ask(Request())
    return found


def measured(cases: Sequence[Case]) -> Table:
    """Return the table of one suite."""
    both, names = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN), list(installed())
    start = _started([REFERENCE, *(name for name in names if name != REFERENCE)])
    began, before = time.perf_counter(), _cpu(*both)
    with _asked() as asked:
        results = run_suite(cases, names, resources=Resources(1, 600.0))
    wall, cpu = time.perf_counter() - began, _cpu(*both) - before
    own: dict[str, float] = defaultdict(float)
    for one in results.runs:
        own[one.engine] += one.cpu
    engines, between = sum(own.values()), asked.between - start.between
    about = f"Bar: 25 %. {len(cases)} cases, {len(results.runs)} runs, one worker at a time. The engines' time is what "
    about += "their workers spend on the answers; the rest is starting workers, importing engines, sending, comparing. "
    about += (
        f"Isolation is all CPU time of both sides of the wire in {asked.jobs} jobs less the engines'. Its bar is 5 %."
    )
    table = Table("What the harness adds", about, ("what", "time", "on top of the engines", "of the suite's CPU"))
    table.rows += [[f"{engine}: answers", f"{spent:.2f} s", "", ""] for engine, spent in own.items()]
    table.rows += [
        ["all engines: answers, CPU", f"{engines:.2f} s", "", _share(engines, cpu)],
        ["the whole suite, CPU of all processes", f"{cpu:.2f} s", _share(cpu - engines, engines), ""],
        ["the whole suite, wall time", f"{wall:.2f} s", _share(wall - engines, engines), ""],
        ["starting workers and engines, CPU", f"{start.between:.2f} s", "", _share(start.between, cpu)],
        [f"isolation of {asked.jobs} jobs, CPU", f"{between:.2f} s", "", _share(between, cpu)],
    ]
    return table


def _share(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.1f} %"


def run(short: bool) -> Iterator[Table]:
    """Yield the table of the page."""
    yield measured([load_case(name) for name in (SHORT if short else CASES)])


def main() -> None:
    """Print the table for the cases of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="CASE")
    parser.add_argument("--tag", help="cases of this tag")
    chosen = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"  # for the workers
    cases = [case for name in chosen.names for case in load_cases(name)]
    cases += [case for case in shipped_cases() if chosen.tag in case.tags]
    print(measured(cases or [load_case(name) for name in CASES]).markdown())


if __name__ == "__main__":
    main()
