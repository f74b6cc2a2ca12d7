"""The floors of the house: a module imports only from floors below its own, and engines stay out of `src`."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "consilience"

FLOORS = {
    "errors": 0,
    **dict.fromkeys(("spatial", "reading", "formats"), 1),
    **dict.fromkeys(("functions", "joints", "explain", "examples", "progress"), 2),
    **dict.fromkeys(("elements", "casevalues", "contacts"), 3),
    "mechanism": 4,
    **dict.fromkeys(("rows", "topology"), 5),
    "element_rows": 6,
    "kinematics": 7,
    **dict.fromkeys(("assembly", "observe", "tree", "run"), 8),
    **dict.fromkeys(("engine", "harness", "export", "generate", "conditioning", "published", "energies"), 9),
    **dict.fromkeys(("caseschema", "workers"), 10),
    **dict.fromkeys(("case", "case_elements"), 11),
    **dict.fromkeys(("casefile", "casewriter", "reference", "worker"), 12),
    **dict.fromkeys(("families", "importing"), 13),
    **dict.fromkeys(("library", "compare"), 14),
    **dict.fromkeys(("judge", "identities", "store", "native"), 15),
    **dict.fromkeys(("asking", "cluster", "compiling"), 16),
    **dict.fromkeys(("suite", "scale"), 17),
    **dict.fromkeys(("coverage", "fuzz", "mutate"), 18),
    "report": 19,
    **dict.fromkeys(("history", "newcase", "outputs", "validate"), 20),
    **dict.fromkeys(("doctor", "frames", "listing", "pytest_plugin", "values"), 21),
    "cli": 22,
    "__init__": 23,
}
"""Files and packages of `src/consilience`; the names the top package offers are imported lazily, from anywhere."""

OUTSIDERS = ("exudyn", "pinocchio", "mujoco", "dartpy", "consilience_")

MODULES = {path.relative_to(SOURCE): path for path in sorted(SOURCE.rglob("*.py"))}


def home(relative):
    return relative.parts[0].removesuffix(".py")


def imported(path):
    """Every module a file imports, at any depth of its syntax tree."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}, line {node.lineno}: a relative import"
            yield from (
                [node.module] if node.module != "consilience" else [f"consilience.{a.name}" for a in node.names]
            )


@pytest.mark.parametrize("relative", MODULES, ids=str)
def test_a_module_imports_only_from_lower_floors(relative):
    own = home(relative)
    assert own in FLOORS, "give the new module a floor"
    ours = {name.split(".")[1] for name in imported(MODULES[relative]) if name.startswith("consilience.")} - {own}
    too_high = {name for name in ours if FLOORS[name] >= FLOORS[own]}
    assert not too_high
    if own in ("compare", "report"):
        assert "reference" not in ours


@pytest.mark.parametrize("relative", MODULES, ids=str)
def test_the_core_imports_no_engine_and_no_adapter(relative):
    assert not [name for name in imported(MODULES[relative]) if name.startswith(OUTSIDERS)]


def test_every_floor_of_the_table_is_built():
    assert {home(relative) for relative in MODULES} == set(FLOORS)


@pytest.mark.parametrize(
    "path", sorted([*SOURCE.rglob("*.py"), *(ROOT / "adapters").rglob("*.py")]), ids=lambda p: str(p.relative_to(ROOT))
)
def test_no_file_is_so_long_that_nobody_reads_it(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400
