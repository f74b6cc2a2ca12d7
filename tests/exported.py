"""Exported native models: accelerations from the engine alone, in a process without our code, against the adapter.

``python tests/exported.py ENGINE [CASE ...]`` writes a table of cases (default: all shipped ones), each at its initial
state and at a random state, to standard output. The number of exported cases and the largest difference go to standard
error. Exit code 1 if a difference exceeds 1e-12, or if no case is written.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from alone import run_alone
from consilience.case import load_case, shipped_cases
from consilience.cli.native_files import native_files, write_native
from consilience.engine import Question, load_engine
from consilience.errors import ConsilienceError

BAR = 1e-12
"""Largest relative difference of accelerations."""


def results(folder):
    """Run the script of a native model without our code; return the results that the script prints."""
    return json.loads(run_alone(folder / "run.py", "-W", "error"))


def difference(case, engine_name, state, folder):
    """Largest difference of accelerations between exported model and adapter, relative to the largest acceleration."""
    write_native(native_files(case, engine_name, state), folder)
    told = results(folder)
    engine = load_engine(engine_name)
    answer = engine.instant(case.mechanism, [state], engine.methods(case.mechanism, Question.INSTANT)[0])
    theirs = np.concatenate([answer.a_WB_W[0], answer.alpha_WB_W[0]], axis=1)
    ours = np.array([told[b.name]["a"] + told[b.name]["alpha"] for b in case.mechanism.bodies])
    return float(np.max(np.abs(ours - theirs)) / max(np.max(np.abs(theirs)), 1.0))


def main(arguments=None):
    """Compare cases; return the exit code, 1 if a difference is too large or none was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("engine", help="such as mujoco")
    parser.add_argument("cases", nargs="*", help="such as four_bar; default: all")
    chosen = parser.parse_args(arguments)
    try:
        load_engine(chosen.engine)
    except ConsilienceError as error:
        parser.error(str(error))
    print("| case | relative difference, initial state and a random one | or why not |\n|---|---|---|")
    cases = [load_case(name) for name in chosen.cases] or shipped_cases()
    worst = {}
    for case in cases:
        try:
            with tempfile.TemporaryDirectory() as place:
                found = [
                    difference(case, chosen.engine, state, Path(place) / str(n))
                    for n, state in enumerate(case.states[:2])
                ]
        except ConsilienceError as error:
            print(f"| {case.name} | | {error} |", flush=True)
            continue
        worst[case.name] = max(found)
        print(f"| {case.name} | {', '.join(f'{x:.1e}' for x in found)} | |", flush=True)
    name = max(worst, key=worst.__getitem__, default="")
    told = f"the largest difference is {worst[name]:.1e}, of {name}" if name else "nothing to compare"
    print(f"{len(worst)} of {len(cases)} cases written; {told}", file=sys.stderr)
    return int(not worst or not all(x <= BAR for x in worst.values()))


if __name__ == "__main__":
    sys.exit(main())
