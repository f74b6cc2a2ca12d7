"""Kill a suite at random instants and resume it, again and again: nothing finished is done twice, nothing is lost.

    python tests/harness/kills.py --kills 200

Each round starts a suite in an empty folder, kills the runner, one of its workers, or both, after a random time, and
lets the same command finish. The database refuses an answer it has already, so that a finished job that is done again
ends the command with an error; the report must say what that of an undisturbed suite says.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

CASES = ("double_pendulum", "four_bar", "slider_crank", "furuta_pendulum")
ENGINES = ("pinocchio", "mujoco")

_NO_REPEATS = """CREATE TRIGGER once BEFORE INSERT ON answers
WHEN EXISTS (SELECT 1 FROM answers WHERE key = NEW.key) BEGIN SELECT RAISE(ABORT, 'answered twice'); END"""

TIMED = ("cpu", "log", "written", "elapsed")
"""What two runs of the same suite may differ in."""


def start(folder: Path) -> subprocess.Popen[bytes]:
    """The suite, at work."""
    engines = [word for name in ENGINES for word in ("-e", name)]
    command = [sys.executable, "-c", "from consilience.cli import main; main()", "run", *CASES, *engines]
    options = ["--quick", "-o", str(folder)]
    return subprocess.Popen([*command, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def refuse_repeats(folder: Path) -> None:
    """Let the database refuse what it has already."""
    from consilience.store import FILE, Store

    Store(folder).close()
    with sqlite3.connect(folder / FILE) as connection:
        connection.execute(_NO_REPEATS)


def finish(folder: Path) -> None:
    """Let the suite end.

    Raises
    ------
    RuntimeError
        If it reports an error.
    """
    process = start(folder)
    _, errors = process.communicate(timeout=600)
    if process.returncode not in (0, 1, 3):
        raise RuntimeError(f"exit code {process.returncode}: {errors.decode(errors='replace')[-2000:]}")


def timeless(value: object) -> object:
    """A record without times."""
    if isinstance(value, dict):
        return {name: timeless(item) for name, item in value.items() if name not in TIMED}
    return [timeless(item) for item in value] if isinstance(value, list) else value


def report(folder: Path) -> list[object]:
    """Records of a report without times."""
    lines = (folder / "report.jsonl").read_text(encoding="utf-8").splitlines()
    return [timeless(json.loads(line)) for line in lines]


def answers(folder: Path) -> int:
    """How many answers are kept."""
    from consilience.store import FILE

    with sqlite3.connect(folder / FILE) as connection:
        return int(connection.execute("SELECT COUNT(*) FROM answers").fetchone()[0])


def disturb(folder: Path, delay: float, target: str) -> None:
    """Start the suite and kill a part of it after a while."""
    process = start(folder)
    time.sleep(delay)
    if process.poll() is None:
        workers = psutil.Process(process.pid).children(recursive=True)
        if target != "worker":
            process.send_signal(signal.SIGKILL)
        if target != "runner" and workers:
            random.choice(workers).kill()
    process.communicate(timeout=600)


def campaign(kills: int, seed: int, room: Path) -> list[str]:
    """What went wrong, in words; nothing if all is well."""
    random.seed(seed)
    whole = room / "whole"
    begun = time.monotonic()
    refuse_repeats(whole)
    finish(whole)
    span, expected, jobs = time.monotonic() - begun, report(whole), answers(whole)
    wrong = []
    for n in range(kills):
        folder, target = room / str(n), random.choice(("runner", "worker", "both"))
        refuse_repeats(folder)
        disturb(folder, random.uniform(0.0, 1.1 * span), target)
        kept = answers(folder)
        try:
            finish(folder)
        except RuntimeError as error:
            wrong.append(f"kill {n} ({target}): {error}")
            continue
        if answers(folder) != jobs or report(folder) != expected:
            wrong.append(f"kill {n} ({target}): another report, {answers(folder)} answers in place of {jobs}")
        print(f"kill {n}: {target}, {kept} of {jobs} answers were kept", flush=True)
    return wrong


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--kills", type=int, default=200)
    options.add_argument("--seed", type=int, default=0)
    chosen = options.parse_args()
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[variable] = "1"
    with tempfile.TemporaryDirectory() as room:
        found = campaign(chosen.kills, chosen.seed, Path(room))
    for line in found:
        print(line)
    print(f"{chosen.kills} kills, {len(found)} wrong")
    raise SystemExit(bool(found))
