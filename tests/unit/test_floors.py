"""Import structure: a package imports only from packages on lower floors, and `src` names no engine."""

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "consilience"

FLOORS = (
    ("errors",),
    ("mechanism",),
    ("engine",),
    ("case",),
    ("compare", "reference"),
    ("suite",),
    ("audit", "report"),
    ("cli", "pytest_plugin"),
    ("__init__",),  # imports public names lazily
)
"""Packages of `src/consilience`, floor by floor from the lowest."""

REFERENCE = (
    ("kernel",),
    ("bodies", "integrators"),
    ("steppers",),
    ("formulations", "tree"),
    ("states",),
    ("solver",),
    ("contact",),
    ("analyses", "engine"),
    ("__init__",),
)
"""Packages and modules of `src/consilience/reference`, floor by floor from the lowest."""

NEVER = {"compare": {"reference"}, "report": {"reference"}, "audit": {"report"}}
"""Forbidden imports that would not be circular: comparison and report must not know who answers."""

ADAPTER_ROOMS = {"consilience.mechanism", "consilience.engine", "consilience.engine.native", "consilience.errors"}
"""Packages of the library that an adapter may import, always as a package."""

ENGINES = re.compile(r"\b(exudyn|pinocchio|mujoco|dart|dartpy)\b", re.IGNORECASE)


def modules():
    """Yield every file of `src/consilience`, with its dotted name below the package."""
    for path in sorted(SOURCE.rglob("*.py")):
        yield path.relative_to(SOURCE).with_suffix("").parts, path


@cache
def nodes(path):
    """Return all nodes of the syntax tree of a file."""
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def imported(path):
    """Return every module that a file imports, at any depth of its syntax tree."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}, line {node.lineno}: a relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def arrows(package=()):
    """Return what each part of a package imports from the others."""
    found, depth = {}, len(package)
    for name, path in modules():
        if name[:depth] != package:
            continue
        own = found.setdefault(name[depth], set())
        for target in imported(path):
            words = tuple(target.split("."))
            if words[: depth + 1] == ("consilience", *package) and len(words) > depth + 1:
                own.add(words[depth + 1])
    return {room: targets & found.keys() - {room} for room, targets in found.items()}


def climbs(rooms, floors):
    """Return the imports that do not lead to a lower floor."""
    height = {room: n for n, floor in enumerate(floors) for room in floor}
    assert height.keys() == rooms.keys(), "every room has a floor, and every floor is built"
    return [f"{room} imports {t}" for room, targets in rooms.items() for t in targets if height[t] >= height[room]]


def test_a_room_imports_only_from_lower_floors():
    rooms = arrows()
    assert not climbs(rooms, FLOORS)
    assert not climbs(arrows(("reference",)), REFERENCE)
    assert not {room: rooms[room] & never for room, never in NEVER.items() if rooms[room] & never}
    assert len(rooms) <= 12
    # files must not import one another in a circle either
    names = {".".join(name).removesuffix(".__init__"): path for name, path in modules()}
    graph = {}
    for name, path in names.items():
        targets = {
            target.removeprefix("consilience.") for target in imported(path) if target.startswith("consilience.")
        }
        graph[name] = {t if t in names else t.rpartition(".")[0] for t in targets} & names.keys() - {name}
    assert len(tuple(TopologicalSorter(graph).static_order())) >= len(names)


def test_nothing_in_src_names_an_engine():
    """No import and no string, docstrings included, names an engine: adapters are discovered."""
    named = []
    for name, path in modules():
        for node in nodes(path):
            text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
            if ENGINES.search(text):
                named.append(f"{'/'.join(name)}, line {node.lineno}: {ENGINES.search(text)[0]}")
        named += [f"{'/'.join(name)} imports {t}" for t in imported(path) if ENGINES.match(t) or "consilience_" in t]
    for path in sorted(SOURCE.rglob("*.toml")):
        named += [f"{path.name}: {found}" for found in ENGINES.findall(path.read_text(encoding="utf-8"))]
    assert not named


def test_an_adapter_imports_the_protocol_and_the_model_alone():
    """Adapters may also import `consilience.engine.native`, and `mutants.py` the vocabulary of `audit.mutate`."""
    climbing, seen = [], 0
    for path in sorted((ROOT / "adapters").rglob("*.py")):
        rooms = ADAPTER_ROOMS | ({"consilience.audit.mutate"} if path.name == "mutants.py" else set())
        for node in nodes(path):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            ours = [name for name in names if name.split(".")[0] == "consilience"]
            seen += len(ours)
            climbing += [f"{path.parent.name}/{path.name}, line {node.lineno}: {n}" for n in ours if n not in rooms]
            others = [n for n in names if n.startswith("consilience_") and n.split(".")[0] != path.parent.name]
            climbing += [f"{path.parent.name}/{path.name}, line {node.lineno}: {n}" for n in others]
    assert seen > 50
    assert not climbing


def test_no_file_is_so_long_that_nobody_reads_it():
    files = [*SOURCE.rglob("*.py"), *(ROOT / "adapters").rglob("*.py")]
    assert not [f.name for f in files if len(f.read_text(encoding="utf-8").splitlines()) > 400]
