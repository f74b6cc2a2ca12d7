"""Scripts of findings: each uses the engine alone, still shows the finding (exit code 0) and prints engine versions."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from alone import run_alone

FINDINGS = Path(__file__).parents[2] / "reports" / "findings"
NAMES = sorted(path.parent.name for path in FINDINGS.glob("*/show.py"))
MODULES = {"exudyn": "exudyn", "pinocchio": "pin", "mujoco": "mujoco", "dartpy": "dartpy"}  # module: printed name
LIMIT = 20  # s, many times what the slowest script takes


def imported(script):
    """Engine modules that a script imports."""
    return re.findall(rf"^import ({'|'.join(MODULES)})\b", script, re.MULTILINE)


def test_there_are_findings():
    assert len(NAMES) > 20


@pytest.mark.parametrize("name", NAMES)
def test_script_shows_its_finding(name, tmp_path):
    path = FINDINGS / name / "show.py"
    engines = imported(path.read_text())
    assert engines, "a finding is about an engine"
    for engine in engines:
        if find_spec(engine) is None:
            pytest.skip(f"{engine} is not installed")
    told = run_alone(path, folder=tmp_path, limit=LIMIT)
    for engine in engines:
        assert re.search(rf"\b{MODULES[engine]} \d+\.\d+", told), "the version is printed"


@pytest.mark.parametrize("name", NAMES)
def test_script_uses_the_engine_alone(name):
    modules = re.findall(r"^(?:import|from) (\w+)", (FINDINGS / name / "show.py").read_text(), re.MULTILINE)
    assert set(modules) <= {*MODULES, "numpy", *sys.stdlib_module_names}


@pytest.mark.parametrize("name", NAMES)
def test_finding_has_a_page_and_stands_in_the_index(name):
    page = (FINDINGS / name / "README.md").read_text()
    for heading in ("Expected", "Observed", "Second route", "Upstream"):
        assert f"**{heading}" in page, heading
    assert f"({name}/README.md)" in (FINDINGS / "README.md").read_text()


def test_index_names_no_folder_that_is_not_there():
    linked = re.findall(r"\]\((\w+)/README\.md\)", (FINDINGS / "README.md").read_text())
    assert sorted(linked) == NAMES
