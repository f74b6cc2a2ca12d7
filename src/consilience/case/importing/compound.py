"""Joints in a row, without mass in between, as one joint of the joint table.

A joint is defined by the set of relative poses it allows; a row of joints that allows the same set is that joint.
`_RULES` has the kinds in a row, and for each the check of the geometry in the drawing. Where the axes of three hinges
come to lie in one plane, the row locks and the ball does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from consilience.engine.native import NativeJoint
from consilience.mechanism import Array

SQUARE = 1e-9
"""Tolerance for axes to count as perpendicular, parallel (rad) or intersecting (m)."""


@dataclass(frozen=True, eq=False)
class Recognised:
    """A joint of the joint table, in the drawing.

    Attributes
    ----------
    kind : str
    at, axis, second : ndarray, shape (3,)
        Origin (m), z and x of F and M in the drawing; `second` is None where x does not matter.
    coordinates : dict
        Coordinate and sign of each joint in the row that is a coordinate of the joint.
    also : ndarray, shape (3,), optional
        Axis whose direction a second joint keeps, `parallel_axes` beside the first.
    """

    kind: str
    at: Array
    axis: Array
    second: Array | None
    coordinates: dict[str, tuple[str, float]]
    also: Array | None = None


def _parallel(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(np.cross(a, b)) < SQUARE)


def _on_line(point: Array, motion: NativeJoint) -> bool:
    return bool(np.linalg.norm(np.cross(point - motion.at, motion.axis)) < SQUARE)


def _meeting_point(motions: Sequence[NativeJoint]) -> Array | None:
    """Point on all axes, or None, by least squares of the distances to the lines."""
    normal = sum((np.eye(3) - np.outer(m.axis, m.axis) for m in motions), np.zeros((3, 3)))
    right = sum(((np.eye(3) - np.outer(m.axis, m.axis)) @ m.at for m in motions), np.zeros(3))
    start = motions[0].at
    point: Array = start + np.linalg.lstsq(normal, right - normal @ start, rcond=1e-12)[0]
    return point if all(_on_line(point, m) for m in motions) else None


def _independent(motions: Sequence[NativeJoint]) -> bool:
    axes = np.array([m.axis for m in motions])
    return bool(np.linalg.svd(axes, compute_uv=False)[-1] > SQUARE)


def _single(motions: Sequence[NativeJoint]) -> Recognised:
    (m,) = motions
    kind, coordinate = {
        "R": ("revolute", "angle"),
        "P": ("prismatic", "distance"),
        "S": ("spherical", ""),
        "F": ("free", ""),
        "planar": ("planar", ""),
    }[m.kind]
    known = {m.name: (coordinate, 1.0)} if coordinate else {}
    return Recognised(kind, m.at, m.axis, None, known)


def _universal(motions: Sequence[NativeJoint]) -> Recognised | None:
    first, second = motions
    at = _meeting_point(motions)
    if at is None or abs(first.axis @ second.axis) > SQUARE:
        return None
    return Recognised("universal", at, first.axis, second.axis, {})


def _cylindrical(motions: Sequence[NativeJoint]) -> Recognised | None:
    hinge, slide = sorted(motions, key=lambda m: m.kind, reverse=True)
    if not _parallel(hinge.axis, slide.axis):
        return None
    sign = 1.0 if hinge.axis @ slide.axis > 0 else -1.0
    return Recognised(
        "cylindrical", hinge.at, hinge.axis, None, {hinge.name: ("angle", 1.0), slide.name: ("distance", sign)}
    )


def _planar(motions: Sequence[NativeJoint]) -> Recognised | None:
    (hinge,) = (m for m in motions if m.kind == "R")
    slides = [m for m in motions if m.kind == "P"]
    across = all(abs(hinge.axis @ slide.axis) < SQUARE for slide in slides)
    return Recognised("planar", hinge.at, hinge.axis, None, {}) if across and _independent(slides) else None


def _slides(motions: Sequence[NativeJoint]) -> Recognised | None:
    """Two or three slides: no rotation, by a plane or a fixed direction, and another fixed direction."""
    first, second = (m.axis for m in motions[:2])
    if not _independent(motions):
        return None
    kind, axis = ("planar", np.cross(first, second)) if len(motions) == 2 else ("parallel_axes", second)
    across = first - axis * (axis @ first) / (axis @ axis)
    return Recognised(kind, motions[0].at, axis, first, {}, across)


def _spherical(motions: Sequence[NativeJoint]) -> Recognised | None:
    at = _meeting_point(motions)
    return Recognised("spherical", at, motions[0].axis, None, {}) if at is not None and _independent(motions) else None


def _free(motions: Sequence[NativeJoint]) -> Recognised | None:
    slides = [m for m in motions if m.kind == "P"]
    turning = [m for m in motions if m.kind != "P"]
    if not _independent(slides) or (len(turning) == 3 and not _independent(turning)):
        return None
    return Recognised("free", turning[-1].at, turning[-1].axis, None, {})


_RULES: dict[str, Callable[[Sequence[NativeJoint]], Recognised | None]] = {
    "RR": _universal,
    "PR": _cylindrical,
    "RP": _cylindrical,
    "PPR": _planar,
    "PRP": _planar,
    "RPP": _planar,
    "PP": _slides,
    "PPP": _slides,
    "RRR": _spherical,
    "PPPS": _free,
    "PPPRRR": _free,
}
"""By the kinds of the joints in a row."""


def recognise(motions: Sequence[NativeJoint]) -> Recognised | None:
    """Return the joint that joints in a row are equivalent to, or None."""
    if len(motions) == 1:
        return _single(motions)
    rule = _RULES.get("".join(m.kind for m in motions))
    return None if rule is None else rule(motions)
