"""Draw the rooms of the house from the imports of the code: `python docs/draw_architecture.py` writes the drawings.

The drawings stand in the repository, so that they show on a code host, too. The build of the site and a test see to it
that they are those of today's imports.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import cache
from html import escape
from pathlib import Path

DOCS = Path(__file__).parent
SOURCE = DOCS.parent / "src" / "consilience"
ADAPTERS = DOCS.parent / "adapters"

Rooms = dict[str, set[str]]
"""Each room, with the rooms that it imports from."""

CAPTIONS = {
    "__init__": "the library's names",
    "adapters": "one per engine",
    "audit": "the harness judged",
    "case": "questions and files",
    "cli": "the command line",
    "compare": "runs to verdicts",
    "engine": "protocol, workers",
    "errors": "what is raised",
    "mechanism": "the neutral model",
    "pytest_plugin": "cases as tests",
    "reference": "the neutral solver",
    "report": "record and pages",
    "suite": "many runs",
}
"""A few words for each room of the whole."""

REFERENCE_CAPTIONS = {
    "__init__": "its names",
    "analyses": "statics to modes",
    "bodies": "descriptor arrays",
    "engine": "as an engine",
    "formulations": "equations by name",
    "contact": "contacts, friction",
    "integrators": "tables, methods",
    "kernel": "compiled ground",
    "solver": "simulate",
    "states": "single states",
    "steppers": "compiled steps",
    "tree": "joint coordinates",
}
"""The same for the rooms of `reference`."""

WIDTH, FLOOR, BOX, TALL = 400, 74, 124, 42
"""Sizes in px: of the drawing, of a floor from the next, and of a box."""

STYLE = (
    "text{text-anchor:middle;font-family:ui-monospace,Menlo,Consolas,monospace}"
    ".n{font-size:15px;font-weight:600;fill:#16324f}.c{font-family:system-ui,Arial,sans-serif;font-size:12px;fill:#34465b}"
    ".b{fill:#eaf1f8;stroke:#5b7fa3}.p{fill:#fbf3e4;stroke:#b08b46}"
    ".a{stroke:#7d8b99;stroke-width:1.4;fill:none;marker-end:url(#h)}"
)


HEAD = (
    '<defs><marker id="h" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    '<path d="M0 0 8 4 0 8z" fill="#7d8b99"/></marker></defs>'
)
"""The head of an arrow."""


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Dotted names of all modules and names that a file imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    plain = (alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names)
    named = (f"{n.module}.{alias.name}" for n in nodes if isinstance(n, ast.ImportFrom) for alias in n.names)
    return (*plain, *named)


def rooms(package: str = "") -> Rooms:
    """Rooms of `consilience`, or of a package of it, with the imports between them."""
    base, prefix = SOURCE / package, ".".join(filter(None, ("consilience", package))) + "."
    files = {path: path.relative_to(base).with_suffix("").parts[0] for path in base.rglob("*.py")}
    if not package:
        files |= dict.fromkeys(ADAPTERS.rglob("*.py"), "adapters")
    found: Rooms = {room: set() for room in sorted(set(files.values()))}
    for path, room in files.items():
        below = (name.removeprefix(prefix).split(".")[0] for name in imported(path) if name.startswith(prefix))
        found[room] |= found.keys() & set(below) - {room}
    return found


def _reached(graph: Rooms, room: str) -> set[str]:
    """Everything below a room."""
    return set(graph[room]).union(*(_reached(graph, target) for target in graph[room]))


def reduced(graph: Rooms) -> Rooms:
    """The arrows that do not follow from others."""
    return {
        room: {t for t in targets if not any(t in _reached(graph, other) for other in targets)}
        for room, targets in graph.items()
    }


def floors(graph: Rooms) -> list[list[str]]:
    """Rooms by floor from the ground: a room stands one floor above the highest room that it imports from."""

    def height(room: str) -> int:
        return max((height(target) + 1 for target in graph[room]), default=0)

    heights = {room: height(room) for room in graph}
    return [sorted(r for r, h in heights.items() if h == n) for n in range(max(heights.values()) + 1)]


def _places(graph: Rooms) -> dict[str, tuple[float, float]]:
    """Centre of each box: a floor's boxes side by side, as nearly above the rooms that they import from as they fit."""
    places: dict[str, tuple[float, float]] = {}
    storeys, apart, margin = floors(graph), BOX + 10, BOX / 2 + 2
    for n, storey in enumerate(storeys):
        wish = {r: sum(places[t][0] for t in graph[r]) / len(graph[r]) if graph[r] else WIDTH / 2 for r in storey}
        wide = (len(storey) - 1) * apart
        first = min(max(sum(wish.values()) / len(wish) - wide / 2, margin), WIDTH - margin - wide)
        for k, room in enumerate(sorted(storey, key=lambda r: (wish[r], r == "adapters", r))):
            places[room] = first + k * apart, (len(storeys) - 1 - n) * FLOOR + TALL / 2 + 4
    return places


def drawing(package: str, captions: Mapping[str, str]) -> str:
    """The rooms of a package by floor and the arrows between them, as SVG."""
    arrows = reduced(rooms(package))
    places = _places(arrows)
    tall = max(y for _, y in places.values()) + TALL / 2 + 4
    what = f"Rooms of {package or 'consilience'}; an arrow leads from a room to one that it imports from."
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {tall:g}" width="{WIDTH}" role="img">',
        f"<title>{what}</title><style>{STYLE}</style>",
        HEAD,
        f'<rect width="{WIDTH}" height="{tall:g}" rx="6" fill="#fff"/>',
    ]
    for room in sorted(arrows):
        for target in sorted(arrows[room]):
            (x, y), (u, v) = places[room], places[target]
            lines.append(f'<path class="a" d="M{x:g} {y + TALL / 2:g} {u:g} {v - TALL / 2 - 1:g}"/>')
    for room in sorted(places):
        x, y = places[room]
        kind = "p" if room in ("adapters", "__init__") else "b"
        box = f'x="{x - BOX / 2:g}" y="{y - TALL / 2:g}" width="{BOX}" height="{TALL}" rx="5"'
        lines.append(f'<rect class="{kind}" {box}/>')
        lines.append(f'<text class="n" x="{x:g}" y="{y - 2:g}">{escape(room)}</text>')
        lines.append(f'<text class="c" x="{x:g}" y="{y + 13:g}">{escape(captions.get(room, ""))}</text>')
    return "\n".join([*lines, "</svg>", ""])


def drawings() -> dict[str, str]:
    """The drawings of the page, by the name of their file in `docs`."""
    return {
        "architecture.svg": drawing("", CAPTIONS),
        "architecture-reference.svg": drawing("reference", REFERENCE_CAPTIONS),
    }


def write() -> None:
    """Write the drawings that are not those of today's imports."""
    for name, text in drawings().items():
        path = DOCS / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
