"""Kill a suite at random instants and resume it, repeatedly: no answer is lost, none is asked for again.

    python tests/harness/kills.py --kills 200

Each round starts the command `consilience run` in an empty folder as a process of its own, kills the runner, one of
its workers, or both, and runs the same command again to its end. Most kills come between the first and the last
answer, some while engines start, some while the report is written. A round counts if the process that was to be killed
was alive and died of the signal; at least three of four kills must come between the first answer and the last. Rows of
the database that were there at the kill must be there, byte for byte, after it and at the end: a row holds the CPU
time of its answer, so that an answer that was asked for again is another row. The database refuses an answer that it
already has. The report must equal that of an undisturbed suite, and no process may be left.

``--runner`` names another command in place of `consilience`: `planted.py` has one that loses what it knows.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shlex
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from consilience.suite import Store
from consilience.suite.store import FILE

CASES = (
    *("single_revolute", "single_prismatic", "single_cylindrical", "single_universal", "single_spherical"),
    *("double_pendulum", "furuta_pendulum", "cart_pole", "simple_pendulum-small", "physical_pendulum-small"),
    *("steady_precession", "acrobot"),
)
WHOLE = (*CASES, "-e", "pinocchio", "-e", "mujoco", "--quick")
SHORT = ("single_revolute", "double_pendulum", "-e", "mujoco", "--quick", "-q", "model", "-q", "instant")
"""Arguments of `consilience run` that say what is asked."""

RUNNER = (sys.executable, "-c", "from consilience.cli.main import main; main()")

TARGETS = ("runner", "worker", "both")

BETWEEN = 0.75
"""Share of the kills that must come between the first and the last answer."""

MOST_ROUNDS = 3
"""Rounds for each kill at most: a round whose target has ended before the signal is no kill."""

_NO_REPEATS = """CREATE TRIGGER once BEFORE INSERT ON answers
WHEN EXISTS (SELECT 1 FROM answers WHERE key = NEW.key) BEGIN SELECT RAISE(ABORT, 'answered twice'); END"""

TIMED = ("cpu", "log", "written", "elapsed")
"""What two runs of the same suite may differ in."""


@dataclass(frozen=True)
class Suite:
    """A command that runs a suite: the words of the program and the arguments that say what is asked."""

    arguments: Sequence[str]
    runner: Sequence[str] = RUNNER

    def start(self, folder: Path) -> subprocess.Popen[bytes]:
        """Start the command in a process of its own, with a session of its own."""
        command = [*self.runner, "run", *self.arguments, "-o", str(folder)]
        with (folder / "complaints").open("wb") as complaints:
            return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=complaints, start_new_session=True)

    def finish(self, folder: Path) -> str:
        """Run the suite to its end; return its error, if it reported one."""
        code = self.start(folder).wait(600)
        if code in (0, 1, 3):
            return ""
        return f"exit code {code}: {(folder / 'complaints').read_text(errors='replace')[-2000:]}"


def refuse_repeats(folder: Path) -> None:
    """Let the database refuse an answer that it already has."""
    Store(folder).close()
    with sqlite3.connect(folder / FILE) as connection:
        connection.execute(_NO_REPEATS)


def timeless(value: object) -> object:
    """Copy of a record without times."""
    if isinstance(value, dict):
        return {name: timeless(item) for name, item in value.items() if name not in TIMED}
    return [timeless(item) for item in value] if isinstance(value, list) else value


def report(folder: Path) -> list[object]:
    """Records of a report without times."""
    lines = (folder / "report.jsonl").read_text(encoding="utf-8").splitlines()
    return [timeless(json.loads(line)) for line in lines]


def rows(connection: sqlite3.Connection) -> dict[str, str]:
    """Digest of each row of the database, by key."""
    found = connection.execute("SELECT key, about, arrays FROM answers").fetchall()
    return {key: hashlib.sha256(about.encode() + arrays).hexdigest() for key, about, arrays in found}


def kept(folder: Path) -> dict[str, str]:
    """Rows of the database in a copy of its files, so that the runner itself recovers the originals."""
    with tempfile.TemporaryDirectory() as copy:
        for file in folder.glob(f"{FILE}*"):
            if not file.name.endswith("-shm"):
                shutil.copy(file, copy)
        connection = sqlite3.connect(Path(copy) / FILE)
        try:
            return rows(connection)
        finally:
            connection.close()


@dataclass(frozen=True)
class Kill:
    """A time and a target: `delay` s after the database holds `after` answers; `chance` chooses the worker."""

    target: str
    after: int
    delay: float
    chance: float


@dataclass(frozen=True)
class Disturbed:
    """What a kill left: whether it happened, the rows seen at that time, processes that outlived the runner."""

    killed: bool
    seen: Mapping[str, str]
    left: Sequence[psutil.Process]


def disturb(suite: Suite, folder: Path, kill: Kill) -> Disturbed:
    """Start the suite and kill the target."""
    process = suite.start(folder)
    connection = sqlite3.connect(folder / FILE)
    while process.poll() is None and connection.execute("SELECT COUNT(*) FROM answers").fetchone()[0] < kill.after:
        time.sleep(0.002)
    time.sleep(kill.delay)
    # listing processes takes longer than a short suite: it comes before the last look at the database
    workers = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
    victim = workers[int(kill.chance * len(workers))] if workers and kill.target != "runner" else None
    seen = rows(connection)
    killed = process.poll() is None and (kill.target == "runner" or victim is not None)
    if killed and kill.target != "worker":
        os.kill(process.pid, signal.SIGKILL)
    if killed and victim is not None:
        killed = _is_killed(victim) or kill.target == "both"
    code = process.wait(600)
    connection.close()
    killed = killed and (kill.target == "worker" or code == -signal.SIGKILL)
    left = [worker for worker in psutil.wait_procs(workers, timeout=2.0)[1] if not _is_dead(worker)]
    return Disturbed(killed, seen, left)


def _is_killed(worker: psutil.Process) -> bool:
    """Kill a worker; return whether it lived until then."""
    alive = not _is_dead(worker)
    try:
        worker.kill()
    except psutil.NoSuchProcess:
        return False
    return alive


def _is_dead(process: psutil.Process) -> bool:
    """Whether a process has ended; a zombie counts, because only the system reaps orphans, at a time of its choice."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


@dataclass
class Tally:
    """Outcome of a campaign: kills that happened, how many of them between the answers, and every violation."""

    kills: int = 0
    between: int = 0
    wrong: list[str] = field(default_factory=list)

    def note(self, words: str) -> None:
        """Add a violation and print it at once: a campaign may be stopped."""
        self.wrong.append(words)
        print(f"WRONG: {words}", flush=True)


def _lost(before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """Describe rows that are gone or changed; empty if all are there."""
    gone = sum(key not in after for key in before)
    changed = sum(key in after and after[key] != row for key, row in before.items())
    return f"of {len(before)} answers that were seen {gone} are gone, {changed} changed" if gone or changed else ""


def violations(suite: Suite, folder: Path, found: Disturbed, expected: Sequence[object], jobs: int) -> list[str]:
    """Resume a suite after a kill; return all that is wrong.

    Parameters
    ----------
    suite : Suite
    folder : Path
        Folder of the killed suite.
    found : Disturbed
    expected : sequence of object
        Report of an undisturbed suite.
    jobs : int
        Number of its answers.
    """
    wrong = [f"{len(found.left)} processes were left"] if found.left else []
    wrong += [f"after the kill: {lost}"] if (lost := _lost(found.seen, kept(folder))) else []
    if error := suite.finish(folder):
        return [*wrong, error]
    ended = kept(folder)
    wrong += [f"at the end: {lost}"] if (lost := _lost(found.seen, ended)) else []
    if len(ended) != jobs or report(folder) != expected:
        wrong.append(f"another report, {len(ended)} answers in place of {jobs}")
    return wrong


def _drawn(choose: random.Random, target: str, jobs: int, start: float) -> Kill:
    """Draw a kill: nine of ten between the first and the last answer, the others before and after.

    Parameters
    ----------
    choose : random.Random
    target : str
    jobs : int
        Number of answers of the whole suite.
    start : float, s
        Time in which engines start.
    """
    when = choose.random()
    if when < 0.05:
        return Kill(target, 0, choose.uniform(0.0, start), choose.random())
    if when < 0.1:
        return Kill(target, jobs, choose.uniform(0.0, 0.5), choose.random())
    return Kill(target, choose.randint(1, 4 * jobs // 5), choose.uniform(0.0, 0.005), choose.random())


def campaign(suite: Suite, kills: int, seed: int, room: Path) -> Tally:
    """Run the rounds until that many kills have happened."""
    choose, tally, whole = random.Random(seed), Tally(), room / "whole"
    begun = time.monotonic()
    refuse_repeats(whole)
    if error := suite.finish(whole):
        tally.note(f"the undisturbed suite: {error}")
        return tally
    expected, jobs, took = report(whole), len(kept(whole)), time.monotonic() - begun
    print(f"the suite has {jobs} jobs and takes {took:.1f} s", flush=True)
    for n in range(MOST_ROUNDS * kills):
        if tally.kills == kills:
            break
        kill = _drawn(choose, TARGETS[tally.kills % len(TARGETS)], jobs, took / 2.0)
        folder = room / str(n)
        refuse_repeats(folder)
        found = disturb(suite, folder, kill)
        if not found.killed:
            print(f"round {n}: nothing was left to kill", flush=True)
        tally.kills += found.killed
        tally.between += found.killed and 0 < len(found.seen) < jobs
        for words in violations(suite, folder, found, expected, jobs):
            tally.note(f"round {n} ({kill.target}): {words}")
        print(f"round {n}: {kill.target}, {len(found.seen)} of {jobs} answers were seen", flush=True)
        shutil.rmtree(folder)
    if tally.kills < kills:
        tally.note(f"only {tally.kills} kills in {MOST_ROUNDS * kills} rounds")
    if tally.between < int(BETWEEN * kills):
        tally.note(f"only {tally.between} of {tally.kills} kills came between the first answer and the last")
    return tally


def main() -> int:
    """Run the campaign that the command line asks for; return the exit code, 1 if anything is wrong."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--kills", type=int, default=200)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--short", action="store_true", help="a suite of a few jobs")
    options.add_argument("--runner", default=shlex.join(RUNNER), help="command in place of `consilience`")
    chosen = options.parse_args()
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[variable] = "1"
    suite = Suite(SHORT if chosen.short else WHOLE, shlex.split(chosen.runner))
    with tempfile.TemporaryDirectory() as room:
        tally = campaign(suite, chosen.kills, chosen.seed, Path(room))
    print(f"{tally.kills} kills, {tally.between} between the first answer and the last, {len(tally.wrong)} wrong")
    return bool(tally.wrong)


if __name__ == "__main__":
    raise SystemExit(main())
