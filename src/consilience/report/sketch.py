"""Sketch of a mechanism for a page: one view as SVG, in the colour of the text around it.

The view is the widest plane of a flat mechanism, and axonometric for any other. A motion makes the sketch move.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from consilience.mechanism import Array, Mechanism, State
from consilience.report.figure3d import Figure3D, Polyline, figure_of, upright, view_axes, widest_view
from consilience.report.templating import template_environment

SIZE = (240.0, 180.0)
"""Width and height in pixels."""

MARGIN = 16.0
"""Empty border in pixels, wide enough for the sign of the ground."""

THIN = 1e-6
"""Thickness over width below which a mechanism is flat."""


def sketch(mechanism: Mechanism, states: Sequence[State], title: str, duration: float = 0.0) -> str:
    """Draw a mechanism as SVG without a background, lines in ``currentColor``.

    Parameters
    ----------
    mechanism : Mechanism
    states : sequence of State
        States at equal intervals; the first one gives the view. One state makes a still picture.
    title : str
        Title of the picture, for those who do not see it.
    duration : float, s
        Time from the first to the last state; the motion is shown over and over.
    """
    figures = [figure_of(mechanism, state) for state in states]
    axes = _view(figures[0])
    flat = np.concatenate([figure.points @ axes.T for figure in figures])
    low, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    room = np.array(SIZE) - 2 * MARGIN
    scale = float(np.min(room / np.maximum(extent, max(0.02 * float(np.max(extent)), 1e-9))))
    middle = low + extent / 2

    def place(points: Array) -> Array:
        """Return places on the sheet, in pixels from its upper left corner."""
        return np.asarray(np.array(SIZE) / 2 + (points @ axes.T - middle) * scale * [1.0, -1.0])

    lines = [
        {"kind": parts[0].kind, "points": [_text(place(line.points)) for line in parts]} for parts in _followed(figures)
    ]
    joints = [
        {"kind": marks[0].kind, "ground": marks[0].ground, "places": [_text(place(mark.point)) for mark in marks]}
        for marks in zip(*(figure.joints for figure in figures), strict=True)
        if marks[0].kind != "free"
    ]
    centres = [[_text(place(m.point)) for m in marks] for marks in zip(*(f.bodies for f in figures), strict=True)]
    page = template_environment(autoescape=True).get_template("sketch.svg.j2")
    return page.render(title=title, size=SIZE, lines=lines, joints=joints, centres=centres, duration=duration)


def _followed(figures: Sequence[Figure3D]) -> list[list[Polyline]]:
    """Follow each line through all figures; a line whose ends coincide in a figure stays where it was."""
    named = [dict(_named(figure)) for figure in figures]
    followed = []
    for name in dict.fromkeys(name for lines in named for name in lines):
        line = next(lines[name] for lines in named if name in lines)
        followed.append([line := lines.get(name, line) for lines in named])
    return followed


def _named(figure: Figure3D) -> Iterator[tuple[tuple[object, ...], Polyline]]:
    """Name the lines of a figure by what they connect, and number those that connect the same."""
    seen: Counter[tuple[object, ...]] = Counter()
    for line in figure.lines:
        what = (line.kind, line.body, line.ends)
        yield (*what, seen[what]), line
        seen[what] += 1


def _view(figure: Figure3D) -> Array:
    """Return the directions to the right and upward (rows) of the view, shape (2, 3)."""
    spread = np.linalg.svd(figure.points - figure.points.mean(axis=0), compute_uv=False)
    if spread[-1] <= THIN * spread[0]:
        return widest_view(figure)
    right, up, toward = upright(figure.gravity)
    normal = 0.5 * right + 0.4 * up + 0.8 * toward
    return view_axes(normal / np.linalg.norm(normal), up)


def _text(places: Array) -> str:
    """Write one place or several, to a tenth of a pixel."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in np.atleast_2d(places))
