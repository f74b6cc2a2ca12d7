"""Lines of contacts in a figure: shapes of bodies once each, and a square of every plane below its shapes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from consilience.mechanism import (
    GROUND,
    Array,
    BoxPlane,
    CapsulePlane,
    Contact,
    DiscPlane,
    Mechanism,
    SphereSphere,
    State,
    body_point,
    characteristic_length,
    contact_parts,
    nearest_points,
    rotation_with_z_axis,
)

AROUND = 1.3
"""Half the edge of a square over the distance of the outermost shape above it."""

Line = tuple[str, str, Array]
"""Body, kind of line, and points (n, 3) in axes of the body, from its origin."""


def circle(center: Array, axes: Array, radius: float) -> Array:
    """Return points of a circle normal to the third column of `axes`, shape (49, 3), m."""
    turns = np.linspace(0.0, 2 * np.pi, 49)
    arms = np.outer(np.cos(turns), axes[:, 0]) + np.outer(np.sin(turns), axes[:, 1])
    return np.asarray(center + radius * arms)


def _sphere(body: str, center: Array, radius: float) -> Iterator[Line]:
    """Three great circles; nothing of a point."""
    if radius:
        yield from ((body, "circle", circle(center, np.roll(np.eye(3), k, axis=1), radius)) for k in range(3))


def _shapes(contact: Contact) -> Iterator[Line]:
    """Lines of the shapes of a contact other than planes."""
    if isinstance(contact, DiscPlane):
        yield contact.body, "circle", circle(contact.center, rotation_with_z_axis(contact.axis), contact.radius)
        return
    if isinstance(contact, BoxPlane):
        corners = [np.array(signs) for signs in product((-1.0, 1.0), repeat=3)]
        for a, b in combinations(corners, 2):
            if np.sum(a != b) == 1:
                ends = np.array([a, b]) * contact.half_sizes @ contact.orientation.T
                yield contact.body, "edge", contact.center + ends
        return
    if isinstance(contact, CapsulePlane):
        yield contact.body, "edge", np.array([contact.start, contact.end])
    for part in contact_parts(contact):
        yield from _sphere(part.body, part.center, part.radius)
    if isinstance(contact, SphereSphere):
        yield from _sphere(contact.partner, contact.partner_center, contact.partner_radius)


def _below(mechanism: Mechanism, state: State, contact: Contact, point: Array, normal: Array) -> list[Array]:
    """Return the feet of the lines of a contact's shape on its plane, world axes."""
    placed = [body_point(mechanism, state, body, x)[0] for body, _, points in _shapes(contact) for x in points]
    return [x - normal @ (x - point) * normal for x in placed]


def _planes(mechanism: Mechanism, state: State) -> Iterator[Line]:
    """Squares of all planes; contacts with one plane share its square."""
    shared: dict[tuple[object, ...], list[Array]] = {}
    for contact in mechanism.contacts:
        if isinstance(contact, SphereSphere):
            continue
        carrier = mechanism.body_index[contact.partner]
        p, R = (np.zeros(3), np.eye(3)) if contact.partner == GROUND else (state.p_WB[carrier], state.R_WB[carrier])
        plane = contact.partner, *np.round([*contact.normal, contact.normal @ contact.point], 9)
        feet = [nearest_points(mechanism, state, part).on_partner for part in contact_parts(contact)]
        feet += _below(mechanism, state, contact, p + R @ contact.point, R @ contact.normal)
        shared.setdefault(plane, []).extend(R.T @ (foot - p) for foot in feet)
    for (partner, *normal, _), feet in shared.items():
        middle = np.mean(feet, axis=0)
        reach = max(float(np.max(np.abs(np.array(feet) - middle))), 0.5 * characteristic_length(mechanism))
        square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]])
        across = rotation_with_z_axis(normal)[:, :2]  # type: ignore[arg-type]
        yield str(partner), "plane", middle + AROUND * reach * square @ across.T


def contact_lines(mechanism: Mechanism, state: State) -> Iterator[Line]:
    """List the lines of all contacts; a shape that takes part in several contacts is drawn once."""
    drawn: set[tuple[str, bytes]] = set()
    for contact in mechanism.contacts:
        for body, kind, points in _shapes(contact):
            seen = body, np.round(points, 9).tobytes()
            if seen not in drawn:
                drawn.add(seen)
                yield body, kind, points
    yield from _planes(mechanism, state)
