"""An adapter whose engine is not installed names the installation command; everything else works without the engine."""

import json
import os
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest

from consilience.cli.commands import doctor
from consilience.engine import engine_distribution, lacks_engine, pip_requirement
from consilience.suite import Results

REMEDY = "pip install 'consilience-absent[absent]'"
FILES = {
    "consilience_absent/__init__.py": "import engine_that_is_absent\n",
    "consilience_absent/reading.py": "READERS = {}\n",
    "consilience_absent/export.py": "",
    "consilience_absent/mutants.py": "MUTANTS = ()\n",
    "consilience_absent/worker-requirements.txt": "engine-that-is-absent\n",
    "consilience_absent-1.0.dist-info/METADATA": (
        "Metadata-Version: 2.1\nName: consilience-absent\nVersion: 1.0\n"
        "Requires-Dist: numpy\nProvides-Extra: absent\n"
        'Requires-Dist: engine-that-is-absent==2.0; extra == "absent"\n'
    ),
    "consilience_absent-1.0.dist-info/entry_points.txt": "[consilience.engines]\nabsent = consilience_absent:Engine\n",
}


@pytest.fixture(scope="module")
def consilience(tmp_path_factory):
    """Run the command line in an environment with such an adapter: arguments in, finished process out."""
    folder = tmp_path_factory.mktemp("adapter")
    for name, text in FILES.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    places = [str(folder), *(path for path in sys.path if path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places), "COLUMNS": "1000"}
    code = "from consilience.cli.main import main; main()"

    def call(*arguments):
        command = [sys.executable, "-c", code, *arguments]
        return subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=600
        )

    call.folder = folder
    return call


@pytest.mark.slow
def test_the_list_says_how_to_get_it(consilience):
    done = consilience("list")
    assert done.returncode == 0
    assert f"absent is not installed: {REMEDY}" in done.stdout


@pytest.mark.slow
def test_a_run_makes_the_report_of_the_reference_and_says_how_to_get_it(consilience):
    done = consilience("run", "double_pendulum", "-q", "model", "-e", "absent", "-o", "report")
    assert done.returncode == 3
    assert REMEDY in done.stderr
    assert "Traceback" not in done.stderr
    header = json.loads((consilience.folder / "report" / "report.jsonl").read_text().splitlines()[0])
    assert list(header["engines"]) == ["reference"]
    assert REMEDY in header["missing"]["absent"]
    assert "double_pendulum" in (consilience.folder / "report" / "report.md").read_text()


@pytest.mark.slow
def test_the_doctor_says_how_to_get_it(consilience):
    done = consilience("doctor", "-e", "absent", "-f", "json")
    assert done.returncode == 3
    (found,) = [one for one in json.loads(done.stdout)["diagnoses"] if one["what"] == "absent"]
    assert found["state"] == "ill"
    assert found["remedy"].startswith(REMEDY)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "double_pendulum", "-e", "absent"),
        ("translate", "double_pendulum", "-e", "absent", "-o", "native"),
        ("mutate", "1", "-e", "absent"),
        ("validate", "double_pendulum", "-e", "absent"),
        ("import", "model.xml", "-o", "model.toml"),
    ],
    ids=lambda words: words[0],
)
def test_no_command_crashes(consilience, arguments):
    (consilience.folder / "model.xml").write_text("<model/>")
    done = consilience(*arguments)
    assert "Traceback" not in done.stderr
    assert REMEDY in done.stderr + done.stdout


ENGINES = ("dart", "exudyn", "mujoco", "pinocchio")
EXTRAS = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["optional-dependencies"]


@pytest.mark.parametrize("engine", ENGINES)
def test_an_extra_of_ours_has_the_distribution_that_the_adapter_names(engine):
    point = EntryPoint(engine, f"consilience_{engine}:x", "consilience.engines")
    (requirement,) = EXTRAS[engine]
    assert requirement.partition("==")[0] == engine_distribution(point)
    assert not lacks_engine(point)
    # written as in the metadata of a wheel, where an extra that names other extras is written out
    all_of_them = [f"{one}; extra == 'engines'" for name in ENGINES for one in EXTRAS[name]]
    requires = ["numpy>=2.0", *all_of_them, f"{requirement}; extra == '{engine}'"]
    distribution = SimpleNamespace(name="consilience", requires=requires)
    assert pip_requirement(SimpleNamespace(module=point.module, dist=distribution)) == f"consilience[{engine}]"


def test_the_remedy_of_the_doctor_is_the_extra(monkeypatch):
    results = Results([], [])
    results.missing = {"mujoco": "InvalidInput: its package is not here (No module named 'mujoco')"}
    monkeypatch.setattr(doctor, "lacks_engine", lambda point: True)
    monkeypatch.setattr(doctor, "pip_requirement", lambda point: "consilience[mujoco]")
    assert doctor.of_engine("mujoco", results).remedy.startswith("pip install 'consilience[mujoco]'")
