"""Documentation of the architecture: pages, glossary and decisions agree with the code."""

import ast
import functools
import importlib
import importlib.util
import inspect
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
SOURCE = ROOT / "src" / "consilience"
PAGE = (DOCS / "architecture.md").read_text(encoding="utf-8")
GLOSSARY = (DOCS / "glossary.md").read_text(encoding="utf-8")
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
RECORDS = sorted(path for path in (DOCS / "decisions").glob("*.md") if path.name != "index.md")
HEADINGS = ["Context", "Decision", "Consequences", "Evidence"]


def loaded(path):
    """Return a module of the site's scripts, which belong to no package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


draw = loaded(DOCS / "draw_architecture.py")
drawings = functools.cache(draw.drawings)


# ---------------------------------------------------------------- architecture


@pytest.mark.parametrize("name", ["architecture.svg", "architecture-reference.svg"])
def test_the_drawings_are_those_of_the_imports(name):
    there = (DOCS / name).read_text(encoding="utf-8")
    assert there == drawings()[name], "run: python docs/draw_architecture.py"
    assert f"]({name})" in PAGE


def test_a_drawing_shows_an_import_that_is_new():
    graph = {"roof": {"wall"}, "wall": {"ground"}, "ground": set()}
    assert draw.floors(graph) == [["ground"], ["wall"], ["roof"]]
    assert draw.reduced(graph | {"roof": {"wall", "ground"}}) == graph
    assert draw.reduced(graph | {"roof": {"ground"}})["roof"] == {"ground"}


@pytest.mark.parametrize(
    ("package", "captions", "extra"), [("", draw.CAPTIONS, set()), ("reference", draw.REFERENCE_CAPTIONS, {"__init__"})]
)
def test_every_room_is_drawn_and_described(package, captions, extra):
    assert draw.rooms(package).keys() == captions.keys()
    assert all(len(text) <= 20 for text in captions.values()), "longer than its box"
    section = PAGE.split("### Rooms of the reference")[1 if package else 0].split("## From a case")[0]
    listed = re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)
    assert sorted(listed) == sorted(captions.keys() - extra)


def walk(title):
    """Return file and qualified name of the functions in one walk-through of the page."""
    section = PAGE.split(f"## {title}")[1].split("\n## ")[0]
    return re.findall(r"^\| `([\w/]+\.py):([\w.]+)` \|", section, re.MULTILINE)


def functions_of(path):
    """Return the names of all functions of a module; methods as ``Class.method``."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{part.name}" for part in node.body if isinstance(part, ast.FunctionDef)}
    return found


@pytest.mark.parametrize(
    ("title", "folder"),
    [("From a case file to a verdict", SOURCE), ("From a mechanism to a motion", SOURCE / "reference")],
)
def test_every_function_of_a_walk_exists(title, folder):
    steps = walk(title)
    assert len(steps) >= 15
    missing = [f"{file}:{name}" for file, name in steps if name not in functions_of(folder / file)]
    assert not missing


# ---------------------------------------------------------------- glossary


TERMS = re.findall(r"^\| ([^|]+?) \| `([\w.]+)` \| [^|]+ \|$", GLOSSARY, re.MULTILINE)
"""Terms of the glossary, with the class, function or module that each names."""

COMPLETE = ("consilience", "consilience.mechanism", "consilience.engine", "consilience.case", "consilience.compare")
"""Packages whose classes must all be in the glossary."""


def resolved(name):
    """Return the object that a dotted name below `consilience` names."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(["consilience", *parts[:n]]))
        except ModuleNotFoundError:
            continue
        for part in parts[n:]:
            thing = getattr(thing, part)
        return thing
    raise AssertionError(name)


@pytest.mark.parametrize(("term", "name"), TERMS)
def test_what_a_term_names_exists(term, name):
    assert resolved(name) is not None, term


def test_one_term_names_one_class():
    rows = [line for line in GLOSSARY.splitlines() if line.startswith("| ") and not line.startswith("| term")]
    assert len(rows) == len(TERMS), "a row that is not: term, name, meaning"
    terms, names = [term for term, _ in TERMS], [name for _, name in TERMS]
    assert not [term for term in terms if terms.count(term) > 1]
    classes = [name for name in names if inspect.isclass(resolved(name))]
    assert not [name for name in classes if classes.count(name) > 1]


@pytest.mark.parametrize("package", COMPLETE)
def test_every_class_of_the_main_rooms_is_a_term(package):
    module = importlib.import_module(package)
    known = [resolved(name) for _, name in TERMS]
    assert not [
        name for name in module.__all__ if inspect.isclass(thing := getattr(module, name)) and thing not in known
    ]


# ---------------------------------------------------------------- decisions


@pytest.mark.parametrize("path", RECORDS, ids=lambda p: p.stem)
def test_a_decision_record_has_its_parts(path):
    text = path.read_text(encoding="utf-8")
    number = int(path.name[:3])
    assert text.startswith(f"# {number}. ")
    assert re.search(r"^(Accepted|Superseded)\b.* 20\d\d-\d\d-\d\d, `[0-9a-f]{7}`", text, re.MULTILINE | re.DOTALL)
    assert re.findall(r"^## (.+)$", text, re.MULTILINE) == HEADINGS
    assert len(text.splitlines()) <= 45, "longer than a screen"
    assert number == RECORDS.index(path) + 1


# ---------------------------------------------------------------- changelog


def test_new_import_paths_exist_and_old_ones_do_not():
    rows = re.findall(r"^\| (`consilience[^|]+) \| (`consilience[^|]+) \|$", CHANGELOG, re.MULTILINE)
    assert len(rows) > 15
    for old, new in rows:
        for name in re.findall(r"`([\w.]+)`", new):
            importlib.import_module(name)
        for name in re.findall(r"`([\w.]+)`", old):
            assert importlib.util.find_spec(name) is None, name
