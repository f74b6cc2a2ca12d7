"""Kill a suite at random instants and resume it, repeatedly: no finished job is repeated, no answer is lost.

    python tests/harness/kills.py --kills 200

Each round starts a suite of 204 jobs in an empty folder, kills the runner, one of its workers, or both, and runs the
same command again to its end. The kill comes a random time after a random number of answers is kept: sometimes before
the first answer, sometimes after the last, while the report is written. The database refuses an answer that it already
has, so that a repeated job ends the command with an error. The report must equal that of an undisturbed suite, and no
process may be left.

Runners are forks of this process, which has imported everything: a new Python process would take as long as the suite.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import shutil
import signal
import sqlite3
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib import import_module
from multiprocessing.context import ForkProcess
from pathlib import Path

import psutil

from consilience.cli import main
from consilience.suite import Store
from consilience.suite.store import FILE

CASES = (
    *("single_revolute", "single_prismatic", "single_cylindrical", "single_universal", "single_spherical"),
    *("double_pendulum", "furuta_pendulum", "cart_pole", "simple_pendulum-small", "physical_pendulum-small"),
    *("steady_precession", "acrobot"),
)
ENGINES = ("pinocchio", "mujoco")
TARGETS = ("runner", "worker", "both")

_NO_REPEATS = """CREATE TRIGGER once BEFORE INSERT ON answers
WHEN EXISTS (SELECT 1 FROM answers WHERE key = NEW.key) BEGIN SELECT RAISE(ABORT, 'answered twice'); END"""

TIMED = ("cpu", "log", "written", "elapsed")
"""What two runs of the same suite may differ in."""


Suite = Sequence[str]
"""Arguments of `consilience run` that say what is asked."""

WHOLE = (*CASES, *(word for name in ENGINES for word in ("-e", name)), "--quick")


SHORT = ("single_revolute", "-e", "mujoco", "--quick", "-q", "model", "-q", "instant")


def start(suite: Suite, folder: Path) -> ForkProcess:
    """Start the suite in a forked process."""
    process = multiprocessing.get_context("fork").Process(target=_run, args=(suite, folder))
    process.start()
    return process


def _run(suite: Suite, folder: Path) -> None:
    os.setsid()
    for number, name in ((1, os.devnull), (2, str(folder / "complaints"))):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    sys.argv = ["consilience", "run", *suite, "-o", str(folder)]
    main.main()


def refuse_repeats(folder: Path) -> None:
    """Let the database refuse an answer that it already has."""
    Store(folder).close()
    with sqlite3.connect(folder / FILE) as connection:
        connection.execute(_NO_REPEATS)


def finish(suite: Suite, folder: Path) -> None:
    """Run the suite to its end.

    Raises
    ------
    RuntimeError
        The suite reported an error.
    """
    process = start(suite, folder)
    process.join(600)
    if process.exitcode not in (0, 1, 3):
        complaints = (folder / "complaints").read_text(errors="replace")
        raise RuntimeError(f"exit code {process.exitcode}: {complaints[-2000:]}")


def timeless(value: object) -> object:
    """Copy of a record without times."""
    if isinstance(value, dict):
        return {name: timeless(item) for name, item in value.items() if name not in TIMED}
    return [timeless(item) for item in value] if isinstance(value, list) else value


def report(folder: Path) -> list[object]:
    """Records of a report without times."""
    lines = (folder / "report.jsonl").read_text(encoding="utf-8").splitlines()
    return [timeless(json.loads(line)) for line in lines]


def answers(folder: Path) -> int:
    """Number of answers in the database."""
    with sqlite3.connect(folder / FILE) as connection:
        return int(connection.execute("SELECT COUNT(*) FROM answers").fetchone()[0])


def disturb(suite: Suite, folder: Path, after: int, delay: float, target: str, chance: float) -> list[psutil.Process]:
    """Start the suite and kill the target; return workers that outlived the runner.

    Parameters
    ----------
    after, delay : int and float, s
        The kill comes `delay` after the database holds `after` answers.
    target : str
        One of `TARGETS`.
    chance : float
        Chooses the worker, between 0 and 1.
    """
    process = start(suite, folder)
    assert process.pid is not None
    while process.is_alive() and answers(folder) < after:
        time.sleep(0.005)
    process.join(delay)
    workers = []
    if process.is_alive():
        workers = psutil.Process(process.pid).children(recursive=True)
        if target != "worker":
            os.kill(process.pid, signal.SIGKILL)
        if target != "runner" and workers:
            workers[int(chance * len(workers))].kill()
    process.join(600)
    return [worker for worker in psutil.wait_procs(workers, timeout=2.0)[1] if not _is_dead(worker)]


def _is_dead(process: psutil.Process) -> bool:
    """Whether a process has ended; a zombie counts, because only the system reaps orphans, at a time of its choice."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def campaign(suite: Suite, kills: int, seed: int, room: Path) -> list[str]:
    """Run the rounds; return a description of every violation."""
    choose = random.Random(seed)
    whole = room / "whole"
    begun = time.monotonic()
    refuse_repeats(whole)
    finish(suite, whole)
    expected, jobs = report(whole), answers(whole)
    print(f"the suite has {jobs} jobs and takes {time.monotonic() - begun:.1f} s", flush=True)
    wrong: list[str] = []

    def note(words: str) -> None:
        wrong.append(words)
        print(f"WRONG: {words}", flush=True)  # print at once: a campaign may be stopped

    for n in range(kills):
        folder, target = room / str(n), TARGETS[n % len(TARGETS)]
        refuse_repeats(folder)
        after = choose.randint(-jobs // 10, jobs + jobs // 10)  # < 0: engines start; > jobs: report
        delay = choose.uniform(0.0, 0.1 if 0 < after < jobs else 2.0)
        left = disturb(suite, folder, min(after, jobs), delay, target, choose.random())
        kept = answers(folder)
        try:
            finish(suite, folder)
        except RuntimeError as error:
            note(f"kill {n} ({target}): {error}")
            continue
        if left:
            note(f"kill {n} ({target}): {len(left)} processes were left")
        if answers(folder) != jobs or report(folder) != expected:
            note(f"kill {n} ({target}): another report, {answers(folder)} answers in place of {jobs}")
        print(f"kill {n}: {target}, {kept} of {jobs} answers were kept", flush=True)
        shutil.rmtree(folder)
    return wrong


if __name__ == "__main__":
    for module in ("suite", "report.pages", "report.record", "case.library"):  # import before the forks
        import_module(f"consilience.{module}")
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--kills", type=int, default=200)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--short", action="store_true", help="a suite of a few jobs")
    chosen = options.parse_args()
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[variable] = "1"
    with tempfile.TemporaryDirectory() as room:
        found = campaign(SHORT if chosen.short else WHOLE, chosen.kills, chosen.seed, Path(room))
    print(f"{chosen.kills} kills, {len(found)} wrong")
    raise SystemExit(bool(found))
