"""Run the benchmarks: ``python tests/benchmarks [--short] [--output FILE] [NAME...]``."""

from __future__ import annotations

import argparse
import os
import sys
import time
from functools import partial
from importlib import import_module
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # libraries read the variable when they are imported

BENCHMARKS = ("accuracy", "limit", "evaluation", "compiled_cpp", "growth", "anatomy", "trajectories", "processes")
BENCHMARKS += ("overhead", "studies", "contact")
"""Modules of this folder, each with ``run(short)``, which yields tables; or one of `scripts.SCRIPTS`."""

FOLDER = Path(__file__).parent
sys.path.append(str(FOLDER.parent))  # for modules of the oracles


def main() -> int:
    """Run the chosen benchmarks; print each table when it is finished, and write its part of the page."""
    known = [name for name in BENCHMARKS if (FOLDER / f"{name}.py").exists()]
    parser = argparse.ArgumentParser(prog="python tests/benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(known)}; default: all")
    parser.add_argument("--short", action="store_true", help="few cases and rounds: to see that it works")
    written = "Markdown file, in which only what ran is replaced; default: docs/benchmarks.md for the whole long set"
    parser.add_argument("--output", type=Path, help=written)
    parser.add_argument("--case", action="append", default=[], help="of contact: the named one alone, printed alone")
    chosen = parser.parse_args()
    if chosen.case and (chosen.names != ["contact"] or chosen.output or chosen.short):
        parser.error("--case goes with the benchmark contact alone, without --output and --short")
    for name in chosen.names:
        if name not in known:
            parser.error(f"no benchmark '{name}': there are {', '.join(known)}")
    from scripts import SCRIPTS, run
    from tables import block, page

    output = chosen.output
    if output is None and not chosen.names and not chosen.short:
        output = FOLDER.parents[1] / "docs" / "benchmarks.md"
    for name in chosen.names or known:
        start, tables = time.perf_counter(), []
        tables_of = partial(run, name) if name in SCRIPTS else import_module(name).run
        if chosen.case:
            tables_of = partial(tables_of, names=chosen.case)
        for table in tables_of(chosen.short):
            print(table.markdown(), flush=True)
            tables.append(table)
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr, flush=True)
        if output is not None and tables:  # after each benchmark, so that an interrupted run keeps its results
            old = output.read_text(encoding="utf-8") if output.exists() else ""
            output.write_text(page({name: block(name, tables, chosen.short)}, BENCHMARKS, old), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
