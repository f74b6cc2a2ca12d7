"""A mechanism as lines and labelled places in space, for the text drawing and the SVG picture of a case."""

from __future__ import annotations

import string
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from consilience.mechanism import (
    GROUND,
    Array,
    Mechanism,
    State,
    body_point,
    centres_of_mass,
    joint_frames,
    rotation_from_quaternion,
    rotation_with_z_axis,
)

BODY_MARKS = string.digits[1:] + string.ascii_lowercase
JOINT_MARKS = string.ascii_uppercase

WITHOUT_AXIS = ("spherical", "free", "rigid", "rod")


@dataclass(frozen=True, eq=False)
class Polyline:
    """A line through points.

    Attributes
    ----------
    body : int
        Index of the body that carries the line; -1 for a line between two bodies.
    kind : {"body", "rod", "spring", "circle", "way"}
        ``way``: from frame F to frame M of a joint.
    points : ndarray, shape (n, 3), m
        World axes.
    ends : tuple of int or None
        Indices of the two bodies of a line between bodies, -1 for the ground.
    """

    body: int
    kind: str
    points: Array
    ends: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class PlaceLabel:
    """A joint or a centre of mass with its label.

    Attributes
    ----------
    letter : str
        Label; empty once the letters are used up.
    name : str
        Name of the joint or of the body.
    kind : str
        Kind of the joint; ``body`` for a centre of mass.
    point : ndarray, shape (3,), m
        World axes.
    axis : ndarray, shape (3,), or None
        Unit vector of the joint axis, world axes.
    ground : bool
        Whether the joint is on the ground.
    body : int
        Index of the body that carries the place, -1 for the ground.
    """

    letter: str
    name: str
    kind: str
    point: Array
    axis: Array | None = None
    ground: bool = False
    body: int = -1


@dataclass(frozen=True, eq=False)
class Figure3D:
    """Lines, joints and centres of mass of a mechanism, world axes."""

    lines: tuple[Polyline, ...]
    joints: tuple[PlaceLabel, ...]
    bodies: tuple[PlaceLabel, ...]
    gravity: Array

    @property
    def points(self) -> Array:
        """All points, shape (n, 3), m."""
        return np.vstack([*(line.points for line in self.lines), *(m.point for m in (*self.joints, *self.bodies))])


def figure_of(mechanism: Mechanism, state: State) -> Figure3D:
    """Make the figure of a mechanism in a state."""
    joints, ends = [], {body.name: list[Array]() for body in mechanism.bodies}
    for n, joint in enumerate(mechanism.joints):
        first = body_point(mechanism, state, joint.predecessor, joint.F.p)[0]
        second = body_point(mechanism, state, joint.successor, joint.M.p)[0]
        for name, point in ((joint.predecessor, first), (joint.successor, second)):
            if name != GROUND and joint.kind != "free":
                ends[name].append(point)
        axis = None if joint.kind in WITHOUT_AXIS else joint_frames(mechanism, state, joint).U[:, 2]
        letter = JOINT_MARKS[n] if n < len(JOINT_MARKS) else ""
        ground = GROUND in (joint.predecessor, joint.successor)
        place, carrier = (second, joint.successor) if joint.kind == "free" else (first, joint.predecessor)
        joints.append(PlaceLabel(letter, joint.name, joint.kind, place, axis, ground, index_of(mechanism, carrier)))
    centers = centres_of_mass(mechanism, state)[0]
    bodies = [
        PlaceLabel(BODY_MARKS[i] if i < len(BODY_MARKS) else "", body.name, "body", centers[i], body=i)
        for i, body in enumerate(mechanism.bodies)
    ]
    lines = [
        Polyline(i, "body", line)
        for i, body in enumerate(mechanism.bodies)
        for line in _skeleton(ends[body.name], centers[i], state.p_WB[i])
    ]
    return Figure3D((*lines, *_other_lines(mechanism, state)), tuple(joints), tuple(bodies), mechanism.gravity)


def index_of(mechanism: Mechanism, body: str) -> int:
    """Return the index of a body; -1 for the ground."""
    return -1 if body == GROUND else mechanism.body_index[body]


def connections(mechanism: Mechanism, state: State) -> Iterator[Polyline]:
    """List the lines between two bodies: rods, displacements from frame F to frame M of other joints, and springs.

    The two frames of a joint may coincide.
    """
    lines = [
        ("rod" if j.kind == "rod" else "way", j.predecessor, j.F.p, j.successor, j.M.p)
        for j in mechanism.joints
        if j.kind != "free"
    ]
    lines += [("spring", s.predecessor, s.point_predecessor, s.successor, s.point_successor) for s in mechanism.springs]
    for kind, first, p, second, q in lines:
        ends = np.array([body_point(mechanism, state, first, p)[0], body_point(mechanism, state, second, q)[0]])
        yield Polyline(-1, kind, ends, (index_of(mechanism, first), index_of(mechanism, second)))


def _skeleton(ends: list[Array], center: Array, origin: Array) -> Iterator[Array]:
    """Draw a body: a line between two joints, a star of three or more, a line from one joint to the centre of mass."""
    if len(ends) == 2 and np.linalg.norm(ends[0] - ends[1]) > 1e-9:
        yield np.array(ends)
        return
    hub = np.mean(ends, axis=0) if len(ends) > 2 else center
    for end in ends or [origin]:
        if np.linalg.norm(end - hub) > 1e-9:
            yield np.array([end, hub])


def _other_lines(mechanism: Mechanism, state: State) -> Iterator[Polyline]:
    """List the connections whose ends differ by more than rounding, rolling circles, and spheres with contacts."""
    for line in connections(mechanism, state):
        if line.kind == "spring" or np.linalg.norm(line.points[0] - line.points[1]) > 1e-9:
            yield line
    for r in mechanism.rollings:
        i = mechanism.body_index[r.body]
        R = rotation_from_quaternion(state.quat_WB[i])
        across = R @ rotation_with_z_axis(r.axis)
        center = body_point(mechanism, state, r.body, r.center)[0]
        yield Polyline(i, "circle", _circle(center, across, r.radius + r.rounding))
    for c in mechanism.contacts:
        if c.radius and c.body != GROUND:
            center = body_point(mechanism, state, c.body, c.center)[0]
            for k in range(3):  # three great circles
                axes = np.roll(np.eye(3), k, axis=1)
                yield Polyline(mechanism.body_index[c.body], "circle", _circle(center, axes, c.radius))


def _circle(center: Array, axes: Array, radius: float) -> Array:
    """Return points of a circle normal to the third column of `axes`, shape (49, 3), m."""
    turns = np.linspace(0.0, 2 * np.pi, 49)
    arms = np.outer(np.cos(turns), axes[:, 0]) + np.outer(np.sin(turns), axes[:, 1])
    return np.asarray(center + radius * arms)


def upright(gravity: Array) -> tuple[Array, Array, Array]:
    """Choose world axes to the right, upward and towards the viewer: upward is most against gravity."""
    k = int(np.argmax(np.abs(gravity))) if np.any(gravity) else 2
    up = np.zeros(3)
    up[k] = -np.sign(gravity[k]) if np.any(gravity) else 1.0
    right = np.eye(3)[0 if k != 0 else 1]
    return right, up, np.cross(right, up)


def widest_view(figure: Figure3D) -> Array:
    """Return the directions to the right and upward (rows) of the widest plane of a mechanism, shape (2, 3).

    Upward is the direction in that plane most against gravity.
    """
    points = figure.points - figure.points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points, full_matrices=True)
    right, up, toward = upright(figure.gravity)
    flat = len(sizes) > 1 and sizes[1] > 1e-6 * max(sizes[0], 1e-300)
    if flat:
        normal = axes[2] if axes[2] @ (toward + 0.3 * right + 0.2 * up) >= 0 else -axes[2]
    else:  # all points on one line: view normal to the line
        normal = np.cross(axes[0], up) if np.linalg.norm(np.cross(axes[0], up)) > 1e-3 else toward
        normal = normal / np.linalg.norm(normal) * (1.0 if normal @ toward >= 0 else -1.0)
    for candidate in (up, -toward, right):
        if np.linalg.norm(candidate - (candidate @ normal) * normal) > 0.2:
            break
    return view_axes(normal, candidate)


def view_axes(normal: Array, up: Array) -> Array:
    """Return the directions to the right and upward (rows) of a view against a unit normal, shape (2, 3)."""
    upward = up - (up @ normal) * normal
    upward /= np.linalg.norm(upward)
    return np.array([np.cross(upward, normal), upward])
