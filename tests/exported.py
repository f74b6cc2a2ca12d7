"""Exported native models: accelerations from the engine alone, in a process without our code, against the adapter.

``python tests/exported.py ENGINE [CASE ...]`` writes a table of cases (default: all shipped ones), each at its initial
state and at a random state, to standard output. The number of exported cases and the largest difference go to standard
error. Exit code 1 if a difference exceeds 1e-12, or if no case is written.
"""

from __future__ import annotations

import argparse
import atexit
import functools
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from consilience.case import load_case, shipped_cases
from consilience.cli.native_files import native_files, write_native
from consilience.engine import Question, load_engine
from consilience.errors import ConsilienceError

ALONE = """
import contextlib, importlib, io, json, os, re, runpy, sys, traceback, warnings
sys.modules["consilience"] = None
for path in map(str.strip, sys.stdin):
    for name in re.findall(r"^import ([\\w.]+)", open(path).read(), re.MULTILINE):
        importlib.import_module(name)
    with warnings.catch_warnings(action="ignore"):
        child = os.fork()
    if child:
        status = os.waitpid(child, 0)[1]
        if status:
            print(json.dumps(["", f"it died: status {status}"]), flush=True)
        continue
    told, error = io.StringIO(), ""
    try:
        with contextlib.redirect_stdout(told):
            runpy.run_path(path, run_name="__main__")
    except BaseException:
        error = traceback.format_exc()
    print(json.dumps([told.getvalue(), error]), flush=True)
    os._exit(0)
"""
"""Runs scripts, one path a line, where our package cannot be imported: each in a process of its own, after imports."""

BAR = 1e-12
"""Largest relative difference of accelerations."""


@functools.cache
def _alone():
    """Start the process that runs the scripts: to import an engine takes longer than a script."""
    command = [sys.executable, "-W", "error", "-c", ALONE]
    started = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(started.communicate)
    return started


def run_alone(folder):
    """Run the script of a native model without our code; return the results that the script prints."""
    process = _alone()
    process.stdin.write(f"{folder / 'run.py'}\n")
    process.stdin.flush()
    told, error = json.loads(process.stdout.readline())
    assert not error, error[-2000:]
    return json.loads(told)


def difference(case, engine_name, state, folder):
    """Largest difference of accelerations between exported model and adapter, relative to the largest acceleration."""
    write_native(native_files(case, engine_name, state), folder)
    told = run_alone(folder)
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
