"""``consilience show --picture``: a mechanism in three views and an axonometric one, as an SVG file.

Views are arranged as in third-angle projection: from above over the front, from the right beside it; one scale for the
three. Up is the axis of the world that is most against gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from consilience.mechanism import Array, Mechanism, State
from consilience.report.figure import COLOURS
from consilience.report.figure3d import Figure3D, Mark, figure_of, upright

WIDTH, HEIGHT, MARGIN = 460.0, 380.0, 46.0
"""Of one view, and what it leaves free, in pixels."""

AXIS = 17.0
"""Half the length of the axis of a joint, in pixels where it lies in the view."""

NEAR = 9.0
"""Distance in pixels within which joints share one label."""

CROWD, SMALLEST = 10, 0.6
"""Joints up to which symbols have their full size, and the least size."""

SHAPES = {"revolute": "circle", "prismatic": "square", "spherical": "ball", "rigid": "block", "free": "none"}
"""Symbols of joints; every other kind is a diamond."""


@dataclass(frozen=True, eq=False)
class View:
    """A projection: rows to the right and upward, and where on the sheet."""

    title: str
    axes: Array
    column: int
    row: int


def views(figure: Figure3D) -> list[View]:
    """Views of the sheet; the axonometric one from the left or the right, wherever the mechanism is wider."""
    right, up, toward = upright(figure.gravity)
    tilted = [_axonometric(side * 0.5 * right + 0.45 * up + 0.75 * toward, up) for side in (1.0, -1.0)]
    points = figure.points - figure.points.mean(axis=0)
    widest = max(tilted, key=lambda axes: float(np.prod(np.linalg.svd(points @ axes.T, compute_uv=False))))
    return [
        View("from above", np.array([right, -toward]), 0, 0),
        View("from the front", np.array([right, up]), 0, 1),
        View("from the right", np.array([-toward, up]), 1, 1),
        View("axonometric", widest, 1, 0),
    ]


def _axonometric(toward: Array, up: Array) -> Array:
    """Rows of the projection that looks against `toward`, up as it can be."""
    normal = toward / np.linalg.norm(toward)
    upward = up - (up @ normal) * normal
    upward /= np.linalg.norm(upward)
    return np.array([np.cross(upward, normal), upward])


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("consilience.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("picture.svg.j2")


def picture(mechanism: Mechanism, state: State, title: str) -> str:
    """SVG text of a mechanism in a state.

    Parameters
    ----------
    title : str
        Above the views.
    """
    pairs = [(joint.predecessor, joint.successor) for joint in mechanism.joints]
    return drawn(figure_of(mechanism, state), pairs, title)


def drawn(figure: Figure3D, pairs: Sequence[Sequence[str]], title: str) -> str:
    """SVG text of a figure; `pairs` are the bodies that each joint is between."""
    *orthogonal, tilted = views(figure)
    scale = min(_fitting(figure, view) for view in orthogonal)
    # edge on, a view must not magnify what is hardly there
    own = min(_fitting(figure, tilted), 1.3 * scale)
    panels = [*(_panel(figure, view, scale) for view in orthogonal), _panel(figure, tilted, own)]
    names = [
        (mark.letter or "+", f"{mark.name}: {mark.kind}, {first} - {second}")
        for mark, (first, second) in zip(figure.joints, pairs, strict=True)
    ]
    bodies = [(mark.letter, mark.name, _colour(i)) for i, mark in enumerate(figure.bodies)]
    lines = len(names) + len(bodies) + 4
    return _template().render(
        title=title,
        panels=panels,
        joints=names,
        bodies=bodies,
        view=(WIDTH, HEIGHT),
        symbol=f"{min(1.0, max(SMALLEST, CROWD / len(names))):.2f}" if names else "1",
        size=(2 * WIDTH + 330, max(2 * HEIGHT + 50, 16.0 * lines + 60)),
    )


def _colour(body: int) -> str:
    return COLOURS[body % len(COLOURS)] if body >= 0 else "#8a8a8a"


def _fitting(figure: Figure3D, view: View) -> float:
    """Pixels a metre at which the mechanism fills the view."""
    extent = np.ptp(figure.points @ view.axes.T, axis=0)
    room = np.array([WIDTH, HEIGHT]) - 2 * MARGIN
    return float(np.min(room / np.maximum(extent, 1e-6 + 0.02 * np.max(extent))))


def _panel(figure: Figure3D, view: View, scale: float) -> dict[str, Any]:
    """Everything in one view, in pixels from its corner."""
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


def _joint(mark: Mark, at: Array, view: View) -> dict[str, Any]:
    """Symbol of a joint and its axis; an axis towards the viewer is a point."""
    along = np.zeros(2) if mark.axis is None else view.axes @ mark.axis * AXIS * np.array([1.0, -1.0])
    shape = SHAPES.get(mark.kind, "diamond")
    return {"x": at[0], "y": at[1], "axis": tuple(along), "shape": shape, "ground": mark.ground}


def _labels(marks: tuple[Mark, ...], places: list[Array]) -> list[tuple[float, float, str]]:
    """Letters beside the joints, those of one place together."""
    groups: list[tuple[Array, list[str]]] = []
    for mark, at in zip(marks, places, strict=True):
        group = next((letters for place, letters in groups if np.linalg.norm(place - at) < NEAR), None)
        if group is None:
            groups.append((at, [mark.letter]))
        elif mark.letter:
            group.append(mark.letter)
    return [(float(at[0]) + 7.0, float(at[1]) - 7.0, _run(letters)) for at, letters in groups]


def _run(letters: list[str]) -> str:
    """Letters as text; a run of more than three in alphabetical order by its ends."""
    known = [letter for letter in letters if letter]
    straight = all(ord(b) == ord(a) + 1 for a, b in pairwise(known))
    return f"{known[0]}-{known[-1]}" if len(known) > 3 and straight else ", ".join(known)


def _bar(scale: float) -> tuple[float, str]:
    """Length in pixels of a scale bar of a round length, and that length."""
    exponent = int(np.floor(np.log10(90.0 / scale)))
    length = max(n * 10.0**exponent for n in (1, 2, 5) if n * 10.0**exponent * scale <= 90.0)
    return length * scale, f"{length:g} m"
