"""Commands on a Dask cluster of two workers, one of them killed during the run, give the results of one machine."""

import json
import sqlite3
import subprocess
import sys
import time

import psutil
import pytest

from consilience.audit.fuzz.campaign import SHARD
from consilience.suite import Store
from consilience.suite.store import FILE
from harness.kills import report
from pace import soon

pytestmark = pytest.mark.slow

MECHANISMS = SHARD + 2
"""Mechanisms of two tasks."""

SUITE = ("run", "double_pendulum", "chain:bodies=3", "-e", "mujoco", "--quick")
FUZZ = ("fuzz", "-n", str(MECHANISMS), "-e", "mujoco", "--effort", "0")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Address of the scheduler, and the nannies, which restart Dask workers that die."""
    folder = tmp_path_factory.mktemp("cluster")
    file, processes = folder / "scheduler.json", []

    def start(what, *options):
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.dask_{what}",
            "--no-dashboard",
            "--scheduler-file",
            str(file),
        ]
        with (folder / f"{len(processes)}.log").open("wb") as log:
            processes.append(subprocess.Popen([*command, *options], cwd=folder, stdout=log, stderr=log))
        return processes[-1]

    start("scheduler", "--host", "127.0.0.1", "--port", "0")
    workers = [start("worker", "--nthreads", "1", "--host", "127.0.0.1") for _ in range(2)]
    until = time.monotonic() + 120.0
    while "Starting established connection" not in (folder / "2.log").read_text() or not file.exists():
        assert time.monotonic() < until, (folder / "2.log").read_text()
        time.sleep(0.1)
    yield json.loads(file.read_text())["address"], workers
    for process in reversed(processes):
        process.terminate()
        process.wait(60.0)


def start(*words):
    program = "from consilience.cli.main import main; main()"
    return subprocess.Popen([sys.executable, "-c", program, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def done(process):
    _, complaints = process.communicate(timeout=600)
    assert process.returncode in (0, 1, 3), complaints.decode()


def kill(nanny):
    """Kill a Dask worker and its engines at once, as when a machine fails."""
    (worker,) = [child for child in psutil.Process(nanny.pid).children() if "spawn_main" in " ".join(child.cmdline())]
    engines = worker.children()
    worker.kill()
    return engines


def kept(folder):
    with sqlite3.connect(folder / FILE) as connection:
        return dict(connection.execute("SELECT key, arrays FROM answers"))


def test_a_suite_on_a_cluster_that_loses_a_worker_says_what_it_says_here(cluster, tmp_path):
    address, workers = cluster
    here, there = tmp_path / "here", tmp_path / "there"
    done(start(*SUITE, "-o", str(here), "--jobs", "2"))
    Store(there).close()
    running = start(*SUITE, "-o", str(there), "--scheduler", address)
    while len(kept(there)) < 10:
        assert running.poll() is None, running.stderr.read().decode()
        time.sleep(0.01)
    engines = kill(workers[0])
    assert len(kept(there)) < len(kept(here))
    done(running)
    assert kept(there) == kept(here)  # to the last bit
    assert report(there) == report(here)
    assert soon(lambda: not psutil.wait_procs(engines, timeout=0.0)[1])


def test_a_fuzz_on_a_cluster_that_loses_a_worker_finds_what_it_finds_here(cluster, tmp_path):
    address, workers = cluster
    here, there = tmp_path / "here", tmp_path / "there"
    done(start(*FUZZ, "-o", str(here)))
    running = start(*FUZZ, "-o", str(there), "--scheduler", address)
    until = time.monotonic() + 300.0
    while not psutil.Process(workers[1].pid).children(recursive=True)[1:]:  # engines run, so jobs have begun
        assert time.monotonic() < until
        time.sleep(0.05)
    kill(workers[1])
    done(running)
    found, expected = (json.loads((folder / "fuzz.json").read_text()) for folder in (there, here))
    assert {**found, "time": None} == {**expected, "time": None}
    assert len(found["seeds"]) == MECHANISMS


def test_no_engine_stays_on_the_cluster_when_a_command_has_ended(cluster):
    _, workers = cluster
    for nanny in workers:
        assert len(psutil.Process(nanny.pid).children(recursive=True)) <= 2  # Dask worker, resource tracker


@pytest.mark.parametrize("address", ["127.0.0.1:9", "nonsense://x"])
def test_a_scheduler_that_does_not_answer_is_said(address, tmp_path, monkeypatch):
    monkeypatch.setattr("consilience.suite.cluster.PATIENCE", "1s")
    from consilience.suite.cluster import Cluster, ClusterError

    with pytest.raises(ClusterError, match=f"scheduler '{address}': "):
        Cluster(address)
