"""``consilience doctor``: every fault of an installation is found and has one remedy."""

import json
import os
from types import SimpleNamespace as Namespace

import pytest
from typer.testing import CliRunner

from consilience.cli.commands import doctor
from consilience.cli.main import app
from consilience.compare import Verdict
from consilience.engine import Profile, Question
from consilience.suite import Results

REASONS = {
    "ModuleNotFoundError: No module named 'mujoco'": "pip install 'mujoco==4.0.0'",
    "ImportError: libGL.so.1: cannot open shared object file": "pip install --force-reinstall 'mujoco==4.0.0'",
    "no answer within 120 s; the worker was stopped": "--limit 1800",
    "out of memory: 4103 MiB, the limit is 4096 MiB": "close other programs",
    "while it started, the worker died: signal SIGSEGV": "python -X faulthandler -c 'import mujoco'",
    "AttributeError: module 'mujoco' has no attribute 'mj_fullM'": "another version: pip install 'mujoco==4.0.0'",
    "something else": "read the reason",
}


@pytest.mark.parametrize("reason", REASONS)
def test_each_reason_has_its_remedy(reason):
    assert REASONS[reason] in doctor.cure(reason, "mujoco==4.0.0", "mujoco")


def results(missing=(), version="4.0.0", verdict=Verdict.AGREES):
    found = Results([], [Question.MODEL])
    found.missing = dict(missing)
    found.engines = {} if missing else {"mujoco": Namespace(version=version)}
    found.comparisons = [
        Namespace(
            engine="mujoco", profile=Profile.MATCHED, verdict=verdict, question="instant", method="m", why="far off"
        ),
        Namespace(engine="mujoco", profile=Profile.DEFAULT, verdict=Verdict.MODEL, question="", method="", why=""),
    ]
    return found


def test_an_engine_that_is_missing_is_to_be_installed_in_the_version_that_is_tested():
    found = doctor.of_engine("mujoco", results({"mujoco": "ModuleNotFoundError: No module named 'mujoco'"}))
    assert (found.state, found.remedy.split(" (")[0]) == ("ill", f"pip install 'mujoco=={doctor.pinned()['mujoco']}'")


def test_an_engine_of_another_version_is_noted(monkeypatch):
    monkeypatch.setattr(doctor, "_version_of", lambda distribution: "3.3.7")
    found = doctor.of_engine("mujoco", results(version="3.3.7"))
    assert found.state == "note"
    assert "tested with 4.0.0" in found.found
    assert "-e mujoco@4.0.0" in found.remedy
    assert doctor.of_engine("mujoco", results(version="3.3.7", verdict=Verdict.MODEL)).remedy.startswith("pip install")


def test_an_engine_that_differs_is_ill_and_one_that_agrees_is_well():
    assert "far off" in doctor.of_engine("mujoco", results(verdict=Verdict.MODEL)).found
    assert doctor.of_engine("mujoco", results()).state == "well"
    assert doctor.of_engine("mujoco", results(verdict=Verdict.UNSUPPORTED)).state == "well"


def test_a_cache_that_cannot_be_written_and_one_that_is_empty(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "new"))
    assert "compiles for a minute" in doctor._kernels().remedy
    doctor.kernels_folder().mkdir(parents=True)
    (doctor.kernels_folder() / "f.nbi").touch()
    assert doctor._kernels().state == "well"
    monkeypatch.setattr(doctor, "writable", lambda folder: False)
    assert "NUMBA_CACHE_DIR" in doctor._kernels().remedy
    assert "XDG_CACHE_HOME" in doctor._versions_folder().remedy


def test_what_cannot_be_written_is_noticed():
    assert not doctor.writable(type(doctor.kernels_folder())("/proc/here"))


def test_processors_memory_threads_and_extras(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0}, raising=False)
    monkeypatch.setattr(doctor.psutil, "virtual_memory", lambda: Namespace(available=doctor.GIBI))
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.setattr(doctor.importlib.util, "find_spec", lambda name: None)
    remedies = [check().remedy for check in (doctor._processors, doctor._memory, doctor._threads, doctor._extras)]
    for remedy, expected in zip(
        remedies,
        ("--jobs 1", "--jobs 1", "unset OMP_NUM_THREADS", "pip install 'consilience[frames,fuzz,lagrange,plot]'"),
        strict=True,
    ):
        assert expected in remedy


def test_every_state_that_is_not_well_has_a_remedy_and_the_command_tells_all():
    done = CliRunner().invoke(app, ["doctor", "-e", "reference", "-f", "json"])
    document = json.loads(done.stdout)
    assert done.exit_code == 0
    assert document["ill"] == 0
    assert {one["what"] for one in document["diagnoses"]} >= {"Python", "compiled kernels", "reference"}
    assert all(one["remedy"] for one in document["diagnoses"] if one["state"] != "well")
