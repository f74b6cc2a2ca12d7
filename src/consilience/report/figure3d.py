"""A mechanism as lines and labelled places in space, for the text drawing and the SVG picture of a case."""

from __future__ import annotations

import string
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from consilience.mechanism import (
    GROUND,
    Array,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    body_point,
    centres_of_mass,
    joint_frames,
    rotation_from_quaternion,
    rotation_with_z_axis,
)
from consilience.report.contact_figure import circle, contact_lines

BODY_MARKS = string.digits[1:] + string.ascii_lowercase
JOINT_MARKS = string.ascii_uppercase

SAME, FLAT, SPUR = 1e-9, 1e-6, 0.05
"""Distance of points that coincide, m; relative size of a plane's thickness; of an offset of a centre of mass."""

WITHOUT_AXIS = ("spherical", "free", "rigid", "rod")


@dataclass(frozen=True, eq=False)
class Polyline:
    """A line through points.

    Attributes
    ----------
    body : int
        Index of the body that carries the line; -1 for a line between two bodies.
    kind : {"body", "rod", "spring", "circle", "way", "edge", "plane"}
        ``way``: from frame F to frame M of a joint; ``edge`` and ``plane``: of shapes of contacts.
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
    for name, point in _touching_points(mechanism, {name for name, found in ends.items() if found}):
        ends[name].append(body_point(mechanism, state, name, point)[0])
    centers = centres_of_mass(mechanism, state)[0]
    bodies = [
        PlaceLabel(BODY_MARKS[i] if i < len(BODY_MARKS) else "", body.name, "body", centers[i], body=i)
        for i, body in enumerate(mechanism.bodies)
    ]
    lines = []
    shaped = {r.body for r in mechanism.rollings} | {
        c.body for c in mechanism.contacts if not isinstance(c, PointPlane)
    }
    for i, body in enumerate(mechanism.bodies):
        own = list(_skeleton(ends[body.name] or [state.p_WB[i]], centers[i]))
        lines += [Polyline(i, "body", line) for line in own]
        if not own and body.name not in shaped:
            lines += _disc(mechanism, state, i, centers[i])
    return Figure3D((*lines, *_other_lines(mechanism, state)), tuple(joints), tuple(bodies), mechanism.gravity)


def _touching_points(mechanism: Mechanism, jointed: Collection[str]) -> Iterator[tuple[str, Array]]:
    """List bodies and points on them that touch: corners, and centres of spheres that a body with joints carries."""
    for contact in mechanism.contacts:
        if isinstance(contact, PointPlane) and contact.body != GROUND:
            yield contact.body, contact.corner
        if isinstance(contact, SpherePlane | SphereSphere) and contact.body in jointed:
            yield contact.body, contact.center
        if isinstance(contact, SphereSphere) and contact.partner in jointed:
            yield contact.partner, contact.partner_center


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


def _skeleton(ends: list[Array], center: Array) -> Iterator[Array]:
    """Draw a body by its joints and touching points: a line, the outline of a plate, or a star; a spur to the centre.

    The order of the points is that of the joints, so that it is the same in every pose.
    """
    points = [p for k, p in enumerate(ends) if all(np.linalg.norm(p - q) > SAME for q in ends[:k])]
    hub = np.mean(points, axis=0)
    arms = np.array(points) - hub
    _, sizes, axes = np.linalg.svd(arms)
    rank = int(np.sum(sizes > FLAT * sizes[0])) if len(points) > 1 else 0
    if rank == 1:
        along = arms @ axes[0]
        first, last = sorted((int(np.argmin(along)), int(np.argmax(along))))
        drawn = [np.array([points[first], points[last]])]
    elif rank == 2 and (order := _outline(arms @ axes[:2].T)):
        drawn = [np.array([points[k] for k in order])]
    else:
        drawn = [np.array([point, hub]) for point in points] if rank else []
    yield from drawn
    segments = [pair for line in drawn for pair in pairwise(line)] or [(points[0], points[0])]
    near = min((_nearest(center, *pair) for pair in segments), key=lambda point: float(np.linalg.norm(point - center)))
    if np.linalg.norm(near - center) > max(SAME, SPUR * np.max(np.abs(arms))):
        yield np.array([near, center])


def _outline(flat: Array) -> list[int]:
    """Return the closed order of points around their mean, shape (n, 2), if they are the corners of a convex plate."""
    order = np.argsort(np.arctan2(flat[:, 1], flat[:, 0])).tolist()
    edges = np.diff(flat[[*order, *order[:2]]], axis=0)
    turns = edges[:-1, 0] * edges[1:, 1] - edges[:-1, 1] * edges[1:, 0]
    if np.any(turns < FLAT * np.max(np.abs(flat)) ** 2):
        return []
    order = order[order.index(0) :] + order[: order.index(0)]
    return [*order, 0] if order[1] < order[-1] else [0, *order[::-1]]


def _nearest(point: Array, start: Array, end: Array) -> Array:
    """Return the point of a segment that is nearest to a point."""
    along = end - start
    part = (point - start) @ along / max(along @ along, SAME**2)
    return np.asarray(start + np.clip(part, 0.0, 1.0) * along)


def _disc(mechanism: Mechanism, state: State, body: int, center: Array) -> Iterator[Polyline]:
    """Draw a body whose joints are at its centre of mass: a circle of the radius of gyration about its widest axis."""
    own = mechanism.bodies[body]
    moments, axes = np.linalg.eigh(own.inertia)
    if moments[-1] > 0.0:
        across = rotation_from_quaternion(state.quat_WB[body]) @ axes
        yield Polyline(body, "circle", circle(center, across, float(np.sqrt(moments[-1] / own.mass))))


def _other_lines(mechanism: Mechanism, state: State) -> Iterator[Polyline]:
    """List the connections whose ends differ by more than rounding, rolling circles, and shapes of contacts."""
    for line in connections(mechanism, state):
        if line.kind == "spring" or np.linalg.norm(line.points[0] - line.points[1]) > 1e-9:
            yield line
    for r in mechanism.rollings:
        i = mechanism.body_index[r.body]
        R = rotation_from_quaternion(state.quat_WB[i])
        across = R @ rotation_with_z_axis(r.axis)
        center = body_point(mechanism, state, r.body, r.center)[0]
        yield Polyline(i, "circle", circle(center, across, r.radius + r.rounding))
    for name, kind, points in contact_lines(mechanism, state):
        placed = np.array([body_point(mechanism, state, name, point)[0] for point in points])
        yield Polyline(index_of(mechanism, name), kind, placed)


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
