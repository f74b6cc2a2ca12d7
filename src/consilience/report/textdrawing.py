"""Drawing of a mechanism in a terminal: lines of Braille dots, capital letters for joints, digits for bodies."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from consilience.mechanism import GROUND, Array, Mechanism, State
from consilience.report.figure3d import Figure3D, figure_of, widest_view

COLUMNS, ROWS = 76, 28
MARGIN = 2
"""Columns and rows at most, and the margin."""

DASHED = ("spring", "rod", "way")

TALL = 2.5
"""Ratio of height to width above which the drawing is turned on its side."""

DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the Braille patterns (U+2800) by row and column of the dot."""


class Canvas:
    """Dots, two per column and four per row, with letters over them."""

    def __init__(self, columns: int, rows: int) -> None:
        self.bits = np.zeros((rows, columns), dtype=int)
        self.letters: dict[tuple[int, int], str] = {}

    def line(self, start: Array, end: Array, dashed: bool = False) -> None:
        """Draw a line between two points in units of dots, y downward."""
        steps = max(1, int(np.ceil(np.max(np.abs(end - start)))))
        for n in range(steps + 1):
            x, y = np.round(start + (end - start) * n / steps).astype(int)
            if not (dashed and n // 3 % 2):
                self.bits[y // 4, x // 2] |= DOTS[y % 4, x % 2]

    def letter(self, point: Array, letter: str) -> str:
        """Write a letter, unless its place is taken; return the letter at the place."""
        x, y = np.round(point).astype(int)
        return self.letters.setdefault((int(y // 4), int(x // 2)), letter)

    def text(self) -> str:
        """Return the lines without blanks at their ends, and without empty lines above and below."""
        rows = []
        for r, row in enumerate(self.bits):
            cells = (self.letters.get((r, c)) or (chr(0x2800 + b) if b else " ") for c, b in enumerate(row))
            rows.append("".join(cells).rstrip())
        return "\n".join(rows).strip("\n")


def draw(mechanism: Mechanism, state: State) -> str:
    """Draw a mechanism in its widest plane, with a legend.

    Bodies are lines from joint to joint, or to the centre of mass; springs, rods and the line from frame F to frame M
    of a joint are dashed. The legend names letters that are hidden behind other letters.
    """
    figure = figure_of(mechanism, state)
    view = widest_view(figure)
    points = figure.points @ view.T
    if np.ptp(points[:, 1]) > TALL * np.ptp(points[:, 0]):  # a terminal is wider than high
        view = np.array([-view[1], view[0]])
        points = figure.points @ view.T
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    inner = np.array([2.0 * (COLUMNS - 2 * MARGIN), 4.0 * (ROWS - 2 * MARGIN)]) - 1.0
    scale = float(np.min(inner / np.maximum(size, 1e-9)))
    if not np.any(size > 1e-9):
        scale = 1.0
    rows = int(np.ceil(size[1] * scale / 4)) + 2 * MARGIN
    canvas = Canvas(COLUMNS, rows)
    # centre the drawing, y downward
    shift = np.array([(2 * COLUMNS - size[0] * scale) / 2, 4.0 * MARGIN])

    def place(point: Array) -> Array:
        flat = (point @ view.T - low) * scale
        return np.array([flat[0], size[1] * scale - flat[1]]) + shift

    for line in figure.lines:
        placed = [place(p) for p in line.points]
        for start, end in pairwise(placed):
            canvas.line(start, end, dashed=line.kind in DASHED)
    legend = _letters(figure, mechanism, canvas, place)
    length = COLUMNS // 4
    right, up = (f"({', '.join(f'{c:.2g}' for c in np.round(axis, 3) + 0.0)})" for axis in view)
    seen = f"right {right}, up {up} of the world; {2 * length / scale:.2g} m is {'─' * length}"
    return "\n".join([canvas.text(), "", f"  {seen}", "", *legend])


def _letters(figure: Figure3D, mechanism: Mechanism, canvas: Canvas, place: Callable[[Array], Array]) -> list[str]:
    """Write all letters to the canvas, and return the legend."""
    lines = []
    for mark, joint in zip(figure.joints, mechanism.joints, strict=True):
        at = place(mark.point)
        shown = canvas.letter(at, mark.letter or "+")
        behind = f", behind {shown}" if shown != (mark.letter or "+") else ""
        if mark.ground and not behind:
            canvas.letters.setdefault((round(at[1]) // 4 + 1, round(at[0]) // 2), "▔")
        between = f"{joint.predecessor} - {joint.successor}"
        lines.append(f"  {mark.letter or '+'}  {mark.name}: {mark.kind}, {between}{behind}")
    centers = []
    for mark in figure.bodies:
        letter = mark.letter or "●"
        shown = canvas.letter(place(mark.point), letter)
        centers.append(f"{letter} {mark.name}" + (f" (behind {shown})" if shown != letter else ""))
    lines += textwrap.wrap(f"centres of mass: {', '.join(centers)}", 100, initial_indent="  ", subsequent_indent="    ")
    if any(mark.ground for mark in figure.joints):
        lines.append(f"  ▔  below a joint: on the {GROUND}")
    if any(line.kind in DASHED for line in figure.lines):
        lines.append("  dashed: springs, rods, the way a joint has gone")
    return lines
