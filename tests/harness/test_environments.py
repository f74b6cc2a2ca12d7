"""Engines in environments of their own: two versions side by side, built once, small; clear errors where that fails."""

import ast
import os
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import consilience
from consilience.engine import Method, Question, Route, installed, require_installed, split_name
from consilience.engine.worker import environments
from consilience.engine.worker.client import Request, Worker
from consilience.engine.worker.environments import REQUIREMENTS, WORKER_SIDE
from consilience.mechanism import Coupling, through
from mechanisms import chain, states_of

SOURCE = Path(consilience.__file__).parent
ADAPTERS = Path(__file__).parents[2] / "adapters"
VERSIONS = ("1.0", "2.5")


def wheel(folder, version):
    """Build a minimal distribution with one module."""
    info = f"toy_engine-{version}.dist-info"
    with zipfile.ZipFile(folder / f"toy_engine-{version}-py3-none-any.whl", "w") as file:
        file.writestr("toy_engine.py", f"VERSION = '{version}'\n")
        file.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: toy-engine\nVersion: {version}\n")
        file.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        file.writestr(f"{info}/RECORD", "")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """An empty cache of environments, and a folder where pip finds both versions; NumPy comes from pip's own index."""
    folder = tmp_path_factory.mktemp("cache")
    for version in VERSIONS:
        wheel(folder, version)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        patch.setenv("PIP_FIND_LINKS", f"{os.environ.get('PIP_FIND_LINKS', '')} {folder}")
        patch.setenv("UV_FIND_LINKS", str(folder))
        yield folder


def test_names_have_variants_and_versions():
    assert split_name("mujoco") == ("mujoco", "", "")
    assert split_name("mujoco@3.3.7") == ("mujoco", "", "3.3.7")
    assert split_name("reference:lagrange@1.0") == ("reference", "lagrange", "1.0")
    require_installed("honest@3.3.7")


@pytest.mark.slow
def test_two_versions_answer_and_their_environments_are_built_once(cache):
    mechanism = chain("revolute", "revolute", seed=2)
    law = through(np.linspace(0.0, 1.0, 9), np.sin(3.0 * np.linspace(0.0, 1.0, 9)))
    first, second = (joint.name for joint in mechanism.joints)
    cam = replace(mechanism, couplings=(Coupling("cam", first, "angle", second, "angle", law),))
    ask = Request(cam, Question.MODEL, Method("toy", Route.NATIVE), states_of(mechanism, 1))
    for version in VERSIONS:
        with Worker(f"toy@{version}") as worker:
            reply = worker.ask(Request())
            assert reply.returned, reply.reason
            assert reply.value.version == version
            assert reply.value.remarks.startswith("own environment: Python 3.")
            assert f"toy-engine {version}" in reply.value.remarks.replace("_", "-")
            assert "numpy 2" in reply.value.remarks
            # equal to the last bit: the engine's environment lacks SciPy, so that the spline is computed here and sent
            assert worker.ask(ask).value.mass == law.jet(0.3)[2]
    built = sorted((cache / "consilience" / "environments").glob("*/consilience.json"))
    assert [file.parent.name.rpartition("-")[0] for file in built] == [f"toy-{version}" for version in VERSIONS]
    times = [file.stat().st_mtime_ns for file in built]
    with Worker(f"toy@{VERSIONS[0]}") as worker:
        assert worker.ask(Request()).returned
    assert [file.stat().st_mtime_ns for file in built] == times
    names = {path.name for path in (built[0].parent / "lib").glob("*/site-packages/*")}
    assert not [name for name in names if name.startswith(("scipy", "numba", "pydantic", "consilience"))]


@pytest.mark.slow
def test_an_environment_that_was_not_finished_is_built_again(cache, tmp_path, monkeypatch):
    """What is left of it is removed first. A copy of the whole environment stands for what pip would build."""
    with Worker(f"toy@{VERSIONS[0]}") as worker:
        assert worker.ask(Request()).returned
    (record,) = (cache / "consilience" / "environments").glob(f"toy-{VERSIONS[0]}-*/consilience.json")
    record.unlink()
    whole = shutil.copytree(record.parent, tmp_path / "whole", symlinks=True)
    (record.parent / "lib").rename(record.parent / "broken")
    monkeypatch.setattr(environments, "_build", lambda name, folder, *_: shutil.copytree(whole, folder, symlinks=True))
    with Worker(f"toy@{VERSIONS[0]}") as worker:
        assert worker.ask(Request()).returned
    assert record.is_file()
    assert not (record.parent / "broken").exists()


def reason_of(engine):
    with Worker(engine) as worker:
        return worker.ask(Request()).reason


@pytest.mark.parametrize(
    ("engine", "said"),
    [
        ("toy@99.9", "the environment of toy-99.9 cannot be built: "),
        ("toy@../../x", "'../../x' is no version"),
        ("toy@--help", "'--help' is no version"),
        ("honest@1.0", f"its adapter has no {REQUIREMENTS}"),
        ("reference@0.1", f"its adapter has no {REQUIREMENTS}"),
        ("nothing@1.0", "nothing is not installed"),
    ],
)
def test_what_cannot_be_had_is_said(cache, engine, said):
    reason = reason_of(engine)
    assert said in reason
    assert not list((cache / "consilience").glob("environments/toy-99.9-*/bin"))


def test_without_a_network_it_says_so(cache, monkeypatch):
    """The package index refuses the connection, and there is no other source."""
    for name, value in {
        "PIP_INDEX_URL": "http://127.0.0.1:9/simple",
        "PIP_EXTRA_INDEX_URL": "",
        "PIP_FIND_LINKS": "",
        "PIP_NO_CACHE_DIR": "1",
        "PIP_RETRIES": "0",
        "PIP_CONFIG_FILE": os.devnull,
        "UV_DEFAULT_INDEX": "http://127.0.0.1:9/simple",
        "UV_OFFLINE": "1",
        "UV_FIND_LINKS": "",
    }.items():
        monkeypatch.setenv(name, value)
    assert "the environment of toy-1.7 cannot be built" in reason_of("toy@1.7")


# ---------------------------------------------------------------- the worker side is small


def imported(path):
    """Modules that are imported when a file is imported: not those in functions or for type checkers."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names if node.module == "consilience")
            if node.module == "consilience.engine.worker":
                yield from (f"{node.module}.{alias.name}" for alias in node.names)


ENGINE = {"exudyn": {"exudyn", "scipy"}, "pinocchio": {"pinocchio"}, "mujoco": {"mujoco"}, "dart": {"dartpy"}}
KNOWN = {
    ".".join(("consilience", *file.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__")
    for file in WORKER_SIDE
}


@pytest.mark.parametrize("file", WORKER_SIDE, ids=lambda file: str(file.relative_to(SOURCE)))
def test_the_worker_side_needs_numpy_alone(file):
    for module in imported(file):
        if module.startswith("consilience"):
            assert module in KNOWN or module.rpartition(".")[0] in KNOWN
        else:
            assert module.partition(".")[0] in {*sys.stdlib_module_names, "numpy"}


@pytest.mark.parametrize("engine", ENGINE)
def test_an_adapter_needs_its_engine_and_the_worker_side(engine):
    package = ADAPTERS / f"consilience_{engine}"
    assert (package / REQUIREMENTS).is_file()
    for file in package.rglob("*.py"):
        for module in imported(file):
            first = module.partition(".")[0]
            if file.name == "mutants.py" and module.startswith("consilience.audit.mutate"):
                continue  # only the mutation campaign imports this file, in the environment of the harness
            if first == "consilience":
                assert module in KNOWN or module.rpartition(".")[0] in KNOWN
            else:
                assert first in {*sys.stdlib_module_names, "numpy", package.name, *ENGINE[engine]}


def test_a_worker_of_its_own_environment_imports_nothing_heavy():
    """Checked in this environment, where heavy packages are installed and could be imported by mistake."""
    heavy = "{'numba', 'scipy', 'pydantic', 'psutil'} & set(sys.modules)"
    heavy = f"import sys, consilience.engine.worker.server; print({heavy})"
    done = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
    assert "toy" in installed()
