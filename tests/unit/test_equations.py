"""docs/equations.md: all names in its tables exist, and no equation number of a source is missing."""

import ast
import re
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from consilience.reference import FORMULATIONS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
SOURCES = ("INTRO", "EXU", "C4", "ATTIA", "MASS")
NUMBERED = {"C4": (1, 116), "ATTIA": (1, 25), "MASS": (1, 50), "EXU": (2, 3)}
"""First and last equation number of the sources; C4 counts 4.1 to 4.116, INTRO has no numbers."""
RANGE = re.compile(r"\((?:4\.)?(\d+)\)(?:-\((?:4\.)?(\d+)\))?")


def tables():
    """Return the cells of all table rows of the page."""
    lines = [line for line in PAGE.splitlines() if line.startswith("|") and not line.startswith(("| source", "|---"))]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


ROWS = [row for row in tables() if len(row) == 4]
MISSING = [row for row in tables() if len(row) == 3]
FUNCTIONS = sorted({name for row in ROWS for name in re.findall(r"`([^`]+)`", row[2])})
TESTS = sorted({name for row in ROWS for name in re.findall(r"`([^`]+)`", row[3])})


def found(name):
    """Return the object that a dotted name below `consilience` names: the longest module, then attributes."""
    parts = ["consilience", *name.split(".")]
    for n in range(len(parts) - 1, 0, -1):
        try:
            value = import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[n:]:
            value = getattr(value, attribute)
        return value
    raise ModuleNotFoundError(name)


@cache
def names_in(file):
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def numbers(cell, source):
    """Return the equation numbers of a source that the first cell of a row lists."""
    listed = set()
    for part in re.split(r", (?=[A-Z])", cell):
        if part.split()[0] == source:
            for first, last in RANGE.findall(part):
                listed |= set(range(int(first), int(last or first) + 1))
    return listed


def test_every_row_is_whole():
    assert len(ROWS) > 70
    assert len(ROWS) + len(MISSING) == len(tables())
    for row in tables():
        assert all(part.split()[0] in SOURCES for part in re.split(r", (?=[A-Z])", row[0])), row[0]
        assert all(row)
    for row in ROWS:
        for cell in row[2:]:  # names only, so that the tests below see every entry
            assert re.fullmatch(r"`[^`]+`(, `[^`]+`)*", cell), cell


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_exists(name):
    assert found(name) is not None


def test_every_test_exists():
    for name in TESTS:
        file, _, test = name.partition("::")
        assert test.startswith("test_")
        assert test in names_in(file), name


@pytest.mark.parametrize("source", NUMBERED)
def test_every_numbered_equation_has_its_place(source):
    first, last = NUMBERED[source]
    listed = set().union(*(numbers(row[0], source) for row in tables()))
    assert listed == set(range(first, last + 1))


def test_every_formulation_is_on_its_page():
    text = (ROOT / "docs" / "formulations.md").read_text(encoding="utf-8")
    assert [name for name in FORMULATIONS if f"`{name}`" not in text] == []


def test_names_that_do_not_exist_are_noticed():
    with pytest.raises(AttributeError):
        found("mechanism.spatial.no_such_function")
    with pytest.raises(ModuleNotFoundError):
        import_module("consilience.no_such_module")
    assert numbers("INTRO force analysis, C4 (4.69)-(4.72), (4.80)", "C4") == {69, 70, 71, 72, 80}
    assert numbers("EXU (3), C4 (4.82)", "EXU") == {3}
