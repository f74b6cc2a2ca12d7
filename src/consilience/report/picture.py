"""SVG picture of a mechanism: three orthogonal views and an axonometric view.

The orthogonal views are arranged as in third-angle projection, with one scale. Upward is the world axis that is most
against gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import Array, Mechanism, State
from consilience.report.figure import COLOURS
from consilience.report.figure3d import Figure3D, PlaceLabel, figure_of, upright, view_axes
from consilience.report.templating import template_environment

WIDTH, HEIGHT, MARGIN = 460.0, 380.0, 46.0
"""Size and margin of one view, in pixels."""

AXIS = 17.0
"""Half the length of a joint axis in the plane of the view, in pixels."""

NEAR = 9.0
"""Distance within which joints share one label, in pixels."""

CROWD, SMALLEST = 10, 0.6
"""Number of joints up to which symbols have their full size, and the least relative size."""

SHAPES = {"revolute": "circle", "prismatic": "square", "spherical": "ball", "rigid": "block", "free": "none"}
"""Symbols of joint kinds; every other kind is a diamond."""


DARK = """@media (prefers-color-scheme: dark) {
.mechanism, .mechanism .word { fill: #e7e9ec }
.mechanism .paper { fill: #15171b }
.mechanism .frame { stroke: #3a4048 }
.mechanism .ink, .mechanism .solid { stroke: #e7e9ec }
.mechanism .solid { fill: #e7e9ec }
.mechanism .faint:not(.line) { fill: #a9b1ba }
.mechanism :is(.line, .both) { stroke: #a9b1ba }
.mechanism .axis { stroke: #ff8a80 }
.mechanism .halo { stroke: #15171b }
}"""
"""Style of a picture on a dark ground; words are never in the colours of bodies."""


@dataclass(frozen=True, eq=False)
class Projection:
    """A view: directions to the right and upward (rows), and the place on the sheet."""

    title: str
    axes: Array
    column: int
    row: int


def views(figure: Figure3D) -> list[Projection]:
    """Choose the views; the axonometric view is from the side from which the mechanism is wider."""
    right, up, toward = upright(figure.gravity)
    normals = [side * 0.5 * right + 0.45 * up + 0.75 * toward for side in (1.0, -1.0)]
    tilted = [view_axes(normal / np.linalg.norm(normal), up) for normal in normals]
    points = figure.points - figure.points.mean(axis=0)
    widest = max(tilted, key=lambda axes: float(np.prod(np.linalg.svd(points @ axes.T, compute_uv=False))))
    return [
        Projection("from above", np.array([right, -toward]), 0, 0),
        Projection("from the front", np.array([right, up]), 0, 1),
        Projection("from the right", np.array([-toward, up]), 1, 1),
        Projection("axonometric", widest, 1, 0),
    ]


def picture(mechanism: Mechanism, state: State, title: str) -> str:
    """Draw a mechanism in a state as SVG, with a title above the views."""
    pairs = [(joint.predecessor, joint.successor) for joint in mechanism.joints]
    return drawn(figure_of(mechanism, state), pairs, title)


def as_png(svg: str) -> bytes:
    """Render a picture as PNG, two pixels for each of the SVG.

    Raises
    ------
    InvalidInput
        If resvg, or Matplotlib with its fonts, is not installed.
    """
    try:
        import resvg_py  # noqa: PLC0415 - an extra: only a PNG needs it
        from matplotlib import get_data_path  # noqa: PLC0415
    except ImportError:
        what = "resvg is not installed, and renders it"
        raise InvalidInput(
            "PNG", what, "Install pip install 'consilience[plot]', or let the name end with .svg."
        ) from None
    fonts = Path(get_data_path()) / "fonts" / "ttf"
    png: bytes = resvg_py.svg_to_bytes(svg, zoom=2.0, font_dirs=[str(fonts)], sans_serif_family="DejaVu Sans")
    return png


def drawn(figure: Figure3D, pairs: Sequence[Sequence[str]], title: str) -> str:
    """Draw a figure as SVG; `pairs` are the two bodies of each joint."""
    *orthogonal, tilted = views(figure)
    scale = min(_fitting(figure, view) for view in orthogonal)
    # the scale of a flat mechanism seen edge on must not be larger
    own = min(_fitting(figure, tilted), 1.3 * scale)
    panels = [*(_panel(figure, view, scale) for view in orthogonal), _panel(figure, tilted, own)]
    names = [
        (mark.letter or "+", f"{mark.name}: {mark.kind}, {first} - {second}")
        for mark, (first, second) in zip(figure.joints, pairs, strict=True)
    ]
    bodies = [(mark.letter, mark.name, _colour(i)) for i, mark in enumerate(figure.bodies)]
    lines = len(names) + len(bodies) + 4
    return (
        template_environment(autoescape=True)
        .get_template("picture.svg.j2")
        .render(
            title=title,
            dark=DARK,
            panels=panels,
            joints=names,
            bodies=bodies,
            view=(WIDTH, HEIGHT),
            symbol=f"{min(1.0, max(SMALLEST, CROWD / len(names))):.2f}" if names else "1",
            size=(2 * WIDTH + 330, max(2 * HEIGHT + 50, 16.0 * lines + 60)),
        )
    )


def _colour(body: int) -> str:
    return COLOURS[body % len(COLOURS)] if body >= 0 else "#8a8a8a"


def _fitting(figure: Figure3D, view: Projection) -> float:
    """Return the scale in pixels per metre at which the mechanism fills the view."""
    extent = np.ptp(figure.points @ view.axes.T, axis=0)
    room = np.array([WIDTH, HEIGHT]) - 2 * MARGIN
    return float(np.min(room / np.maximum(extent, 1e-6 + 0.02 * np.max(extent))))


def _panel(figure: Figure3D, view: Projection, scale: float) -> dict[str, Any]:
    """Draw one view, in pixels from its corner."""
    flat = figure.points @ view.axes.T
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2

    def place(point: Array) -> Array:
        offset = (view.axes @ point - middle) * scale
        return np.array([WIDTH / 2 + offset[0], HEIGHT / 2 - offset[1]])

    lines = [
        {
            "points": " ".join(f"{x:.1f},{y:.1f}" for x, y in map(place, line.points)),
            "colour": _colour(line.body),
            "kind": line.kind,
        }
        for line in figure.lines
    ]
    places = [place(mark.point) for mark in figure.joints]
    triad = [(f"{'xyz'[k]}", *(22.0 * view.axes[:, k] * [1.0, -1.0])) for k in range(3)]
    return {
        "title": view.title,
        "at": (view.column * WIDTH, 40 + view.row * HEIGHT),
        "lines": lines,
        "joints": [_joint(mark, at, view) for mark, at in zip(figure.joints, places, strict=True)],
        "labels": _labels(figure.joints, places),
        "bodies": [(*map(float, place(m.point)), m.letter, _colour(i)) for i, m in enumerate(figure.bodies)],
        "triad": triad,
        "bar": _bar(scale),
    }


def _joint(mark: PlaceLabel, at: Array, view: Projection) -> dict[str, Any]:
    """Draw the symbol of a joint and its axis."""
    along = np.zeros(2) if mark.axis is None else view.axes @ mark.axis * AXIS * np.array([1.0, -1.0])
    shape = SHAPES.get(mark.kind, "diamond")
    return {"x": at[0], "y": at[1], "axis": tuple(along), "shape": shape, "ground": mark.ground}


def _labels(marks: tuple[PlaceLabel, ...], places: list[Array]) -> list[tuple[float, float, str]]:
    """Label the joints; joints at one place share a label."""
    groups: list[tuple[Array, list[str]]] = []
    for mark, at in zip(marks, places, strict=True):
        group = next((letters for place, letters in groups if np.linalg.norm(place - at) < NEAR), None)
        if group is None:
            groups.append((at, [mark.letter]))
        elif mark.letter:
            group.append(mark.letter)
    return [(float(at[0]) + 7.0, float(at[1]) - 7.0, _abbreviated(letters)) for at, letters in groups]


def _abbreviated(letters: list[str]) -> str:
    """Join letters; more than three consecutive letters are abbreviated to first and last."""
    known = [letter for letter in letters if letter]
    straight = all(ord(b) == ord(a) + 1 for a, b in pairwise(known))
    return f"{known[0]}-{known[-1]}" if len(known) > 3 and straight else ", ".join(known)


def _bar(scale: float) -> tuple[float, str]:
    """Return the length of a scale bar in pixels, and its round length in m."""
    exponent = int(np.floor(np.log10(90.0 / scale)))
    length = max(n * 10.0**exponent for n in (1, 2, 5) if n * 10.0**exponent * scale <= 90.0)
    return length * scale, f"{length:g} m"
