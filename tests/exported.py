"""Exported native models, run by the engine without our code, against the adapter.

Run it over all shipped cases::

    python tests/exported.py ENGINE [CASE...] > table.md
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from consilience.engine import load_engine
from consilience.errors import ConsilienceError
from consilience.library import load_case, shipped_cases
from consilience.native import native_files, write_native
from consilience.run import Question

ALONE = "import runpy, sys; sys.modules['consilience'] = None; runpy.run_path(sys.argv[1], run_name='__main__')"
"""Runs a script in a process in which our package cannot be imported."""


def run_alone(folder):
    """What the script of a native model prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", ALONE, str(folder / "run.py")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def difference(case, engine_name, state, folder):
    """Largest difference of accelerations of the exported model and of the adapter, relative to the largest."""
    write_native(native_files(case, engine_name, state), folder)
    told = run_alone(folder)
    engine = load_engine(engine_name)
    answer = engine.instant(case.mechanism, [state], engine.methods(case.mechanism, Question.INSTANT)[0])
    theirs = np.concatenate([answer.a_WB_W[0], answer.alpha_WB_W[0]], axis=1)
    ours = np.array([told[b.name]["a"] + told[b.name]["alpha"] for b in case.mechanism.bodies])
    return float(np.max(np.abs(ours - theirs)) / max(np.max(np.abs(theirs)), 1.0))


def main(engine_name, *names):
    print("| case | relative difference, initial state and a random one | or why not |\n|---|---|---|")
    for case in [load_case(name) for name in names] or shipped_cases():
        try:
            with tempfile.TemporaryDirectory() as place:
                found = [
                    difference(case, engine_name, state, Path(place) / str(n))
                    for n, state in enumerate(case.states[:2])
                ]
        except ConsilienceError as error:
            print(f"| {case.name} | | {error} |", flush=True)
            continue
        print(f"| {case.name} | {', '.join(f'{x:.1e}' for x in found)} | |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
