"""Versions of an engine that pip finds, one with another mass, one that cannot be installed: bisection and workflows.

The steps of the action and of the workflow in `.github` run here as they run there, but for those that install.
"""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from consilience.cli.commands.bisect import versions_of
from consilience.cli.main import command_of
from consilience.errors import InvalidInput

pytestmark = pytest.mark.slow

FACTORS = {"1.9": 1.0, "1.10": 1.0, "2.0": 1.0, "2.1": 1.001}
"""Factor of the mass, by version: 1.10 comes after 1.9, and the mass has been wrong since 2.1."""

NOT_INSTALLABLE = "2.0"


def wheel(folder, version, factor):
    """Build a distribution of one module; one version needs what nobody has."""
    info = f"graded_engine-{version}.dist-info"
    needs = "Requires-Dist: graded-engine-lacks-this\n" if version == NOT_INSTALLABLE else ""
    files = {
        "graded_engine.py": f"VERSION = '{version}'\nFACTOR = {factor}\n",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: graded-engine\nVersion: {version}\n{needs}",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/RECORD": "",
    }
    with zipfile.ZipFile(folder / f"graded_engine-{version}-py3-none-any.whl", "w") as file:
        for name, text in files.items():
            file.writestr(name, text)


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """A folder where pip finds all versions, and an empty cache of environments."""
    folder = tmp_path_factory.mktemp("published")
    for version, factor in FACTORS.items():
        wheel(folder, version, factor)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        patch.setenv("PIP_FIND_LINKS", f"{os.environ.get('PIP_FIND_LINKS', '')} {folder}")
        patch.setenv("UV_FIND_LINKS", str(folder))
        yield folder


def called(capsys, *words):
    code = command_of("bisect").main([*words], "bisect", standalone_mode=False)
    return code, capsys.readouterr().out


def test_the_planted_version_is_named_and_the_one_that_does_not_install_is_said(published, tmp_path, capsys):
    words = ("double_pendulum", "-e", "graded@1.9..2.1", "-q", "model", "-o", str(tmp_path), "-f", "json")
    code, told = called(capsys, *words)
    found = json.loads(told)
    assert code == 1
    assert (found["last_good"], found["first_bad"], found["not_asked_between"]) == ("1.10", "2.1", ["2.0"])
    (change,) = found["changes"]
    assert change["kind"] == "verdict"
    assert "mass" in change["why"]
    assert "graded-engine-lacks-this" in next(t["why"] for t in found["trials"] if t["version"] == "2.0")
    # a report of each version asked
    assert sorted(f.parent.name for f in tmp_path.glob("*/report.html")) == ["1.10", "1.9", "2.1"]


def test_a_range_without_a_version_is_answered_with_what_pip_finds(published, monkeypatch):
    with pytest.raises(InvalidInput, match=r"pip finds no version from 4\.0 to 5\.0; it finds 1\.9 to 2\.1"):
        versions_of("graded@4.0..5.0")
    with pytest.raises(InvalidInput, match=r"Invalid version: 'new'; write a range such as"):
        versions_of("graded@1.9..new")
    with pytest.raises(InvalidInput, match="it is no range of versions"):
        versions_of("graded@1.9")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", "")
    with pytest.raises(InvalidInput, match="pip cannot list its versions: ERROR: No matching distribution"):
        versions_of("graded@1.9..2.1")


# ---------------------------------------------------------------- the action and the workflow

GITHUB = Path(__file__).parents[2] / ".github"


def steps(path, *keys):
    """Return the shell steps of a file of GitHub's, by name, with their variables."""
    import yaml

    document = yaml.safe_load((GITHUB / path).read_text(encoding="utf-8"))
    shared, found = document.get("env", {}), document
    for key in keys:
        found = found[key]
    assert all("@v" in step["uses"] for step in found if "uses" in step), "an action without a version may change"
    return {step["name"]: step | {"env": shared | step.get("env", {})} for step in found if "run" in step}


@pytest.fixture
def shell(tmp_path):
    """Return a function that runs a step as GitHub does, with the program and pip of this process."""
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    programs = {"consilience": "-c 'from consilience.cli.main import main; main()'", "pip": "-m pip"}
    for name, how in programs.items():
        (bin_folder / name).write_text(f'#!/bin/sh\nexec {sys.executable} {how} "$@"\n')
        (bin_folder / name).chmod(0o755)
    known = {"PATH": f"{bin_folder}:{os.environ['PATH']}", "PYTHONPATH": os.pathsep.join(sys.path)}
    known |= {name: str(tmp_path / name) for name in ("GITHUB_OUTPUT", "GITHUB_STEP_SUMMARY")}

    def run(step, code=0, **variables):
        env = os.environ | known | step["env"] | variables
        folder = tmp_path / step.get("working-directory", "")
        command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == code, done.stdout + done.stderr

    return run


def test_the_action_asks_and_summarises_and_ends_with_the_code_of_the_run(published, tmp_path, shell):
    named = steps("actions/consilience/action.yml", "runs", "steps")
    assert list(named) == ["Install", "Ask", "Summarise"]
    assert all(step["shell"] == "bash" for step in named.values())
    variables = {"CASES": "double_pendulum -q model", "ENGINES": "graded@2.1", "REPORT": "report"}
    shell(named["Ask"], **variables)
    shell(named["Summarise"], **variables)
    assert (tmp_path / "GITHUB_OUTPUT").read_text() == "code=1\n"
    assert "graded" in (tmp_path / "GITHUB_STEP_SUMMARY").read_text()
    assert "<testsuite" in (tmp_path / "report" / "junit.xml").read_text()
    shell(named["Ask"], 1, **variables | {"CASES": "double_pendulam"})


def test_the_workflow_asks_new_versions_once_and_keeps_what_it_finds(published, tmp_path, shell):
    named = steps("workflows/new-versions.yml", "jobs", "ask", "steps")
    assert list(named) == ["Install", "Ask", "Site", "Keep"]
    git = ["git", "-c", "init.defaultBranch=results"]
    subprocess.run([*git, "init", "--quiet", "--bare", "origin.git"], cwd=tmp_path, check=True)
    subprocess.run([*git, "clone", "--quiet", "origin.git", "results"], cwd=tmp_path, check=True, capture_output=True)
    variables = {"ENGINES": "graded=graded-engine", "CASES": "double_pendulum -q model"}
    times = []
    for _ in range(2):
        for name in ("Ask", "Site", "Keep"):
            shell(named[name], **variables)
        times.append((tmp_path / "results" / "reports" / "graded-2.1" / "report.jsonl").stat().st_mtime_ns)
    assert times[0] == times[1], "a version is asked once"
    assert (tmp_path / "public" / "cell" / "double_pendulum" / "graded" / "index.html").is_file()
    assert "interop score" in (tmp_path / "GITHUB_STEP_SUMMARY").read_text()
    kept = subprocess.check_output(["git", "log", "--format=%s", "results"], cwd=tmp_path / "origin.git", text=True)
    assert kept == "Reports of new versions\n"
