"""The page of the site "Which engine for my work?", from what is kept of a report in `reports/agreement`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from html import escape
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

from consilience.compare import markdown_table
from consilience.report.figure import COLOURS
from consilience.report.statement import escaped

KEPT = Path(__file__).parents[1] / "reports" / "agreement" / "choice.json"

WIDTH, HEIGHT, LEFT, BELOW = 720, 190, 46, 34
"""Size of a chart, and room for the numbers at its axes, px."""

MOST = 16
"""Digits at the upper end of an axis."""

Place = Callable[[float, float], tuple[float, float]]

ABOUT = """\
Over {summary}. Digits and times are those of the report kept in `reports/agreement`. For your own cases the same
page is *Which engine* in the head of any [report](../report.md).

## Accuracy and time

Each mark is a case: digits of the best motion at its finest level over CPU time by simulated time. Upper left is
better. Hollow: by the harness's integrator, where the engine gives accelerations alone.
"""


def choice() -> str:
    """Return the page as Markdown; without a report that is kept, it says how to make one."""
    lines = ["# Which engine for my work?", ""]
    if not KEPT.is_file():
        return "\n".join([*lines, "`just agreement` makes the report that this page is drawn from.", ""])
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    lines += [ABOUT.format(summary=kept["summary"])]
    groups = list(dict.fromkeys(point[1] for point in kept["points"]))
    lines += [_chart(kept, group) for group in groups]
    lines += ["", "## Medians by class of mechanism", ""]
    lines += ["A dash: not asked. A quick run asks nothing at defaults.", ""]
    heads = ("engine", "class", "cases", "digits", "CPU time by simulated time", "digits at its defaults")
    lines += markdown_table(heads, kept["rows"], escape=escaped)
    lines += ["", "## What engines do not represent", "", "Reasons are those of the adapters.", ""]
    lines += markdown_table(("engine", "feature: reason", "cases"), kept["missing"], escape=escaped)
    return "\n".join([*lines, ""])


def _chart(kept: dict[str, Any], group: str) -> str:
    """Draw the cases of a class as SVG in the ink of the page, in one line as a blank one would end the HTML."""
    points = [point for point in kept["points"] if point[1] == group]
    low, high = (way(log10(pick(p[4] for p in kept["points"]))) for way, pick in ((floor, min), (ceil, max)))
    engines = list(dict.fromkeys(point[0] for point in kept["points"]))

    def place(cost: float, digits: float) -> tuple[float, float]:
        across = (log10(cost) - low) / max(high - low, 1)
        return LEFT + across * (WIDTH - LEFT - 10), HEIGHT - BELOW - digits / MOST * (HEIGHT - BELOW - 10)

    marks = "".join(_mark(point, engines.index(point[0]), place) for point in points)
    keys = "".join(_key(engine, n) for n, engine in enumerate(engines))
    size = f'viewBox="0 0 {WIDTH} {HEIGHT}" style="max-width:{WIDTH}px;width:100%" font-size="11"'
    told = f'role="img" aria-label="Digits over CPU time, {escape(group)}"'
    head = f"<figcaption><strong>{escape(group)}</strong> {keys}</figcaption>"
    return f"<figure>{head}<svg {size} {told}>{_axes(low, high, place)}{marks}</svg></figure>"


def _key(engine: str, n: int) -> str:
    dot = f'<span style="color:{_colour(n)}">\N{BLACK CIRCLE}</span>'
    return f'<span style="white-space:nowrap">{dot} {escape(engine)}</span> '


def _axes(low: int, high: int, place: Place) -> str:
    """Draw lines at each decade and at every fourth digit."""
    drawn = []
    for decade in range(low, high + 1):
        x, y = place(10.0**decade, 0.0)
        drawn.append(f'<path d="M{x:.1f},10 V{y:.1f}" stroke="currentColor" stroke-opacity="0.2"/>')
        words = f'<text x="{x:.1f}" y="{y + 16:.1f}" text-anchor="middle" fill="currentColor">'
        drawn.append(f"{words}{10.0**decade:g}</text>")
    for digits in range(0, MOST + 1, 4):
        x, y = place(10.0**low, float(digits))
        drawn.append(f'<path d="M{x:.1f},{y:.1f} H{WIDTH - 10}" stroke="currentColor" stroke-opacity="0.2"/>')
        drawn.append(f'<text x="{x - 8:.1f}" y="{y + 4:.1f}" text-anchor="end" fill="currentColor">{digits}</text>')
    return "".join(drawn)


def _mark(point: Sequence[Any], n: int, place: Place) -> str:
    engine, _, case, method, cost, digits, own = point
    x, y = place(cost, digits)
    told = escape(f"{engine}, {case}: {digits:.1f} digits by {method}, {cost:g} s of CPU time by second")
    fill = _colour(n) if own else "none"
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.2" fill="{fill}" stroke="{_colour(n)}" stroke-width="1.3">'
        f"<title>{told}</title></circle>"
    )


def _colour(n: int) -> str:
    """Return the colour of an engine; the first one of a report is the reference's."""
    return COLOURS[(n + 1) % len(COLOURS)]
