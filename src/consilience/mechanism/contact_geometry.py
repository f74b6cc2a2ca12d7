"""Geometry of contacts at a state: nearest points, normals and gaps of all shapes.

For shapes with one nearest point, world axes, n the unit normal from `partner` to `body`:

=================  ===========================================  =============================================
shapes             gap                                          contact point on `body`
=================  ===========================================  =============================================
sphere on plane    ``n . (c - p) - r``                          ``c - r n``
point on plane     ``n . (c - p)``                              c, the point itself
sphere on sphere   ``|c - c2| - r - r2``, n along ``c - c2``    ``c - r n``
disc on plane      ``n . (c - p) - r |n_a|``                    ``c - r n_a/|n_a|``, ``n_a = n - (n . a) a``
=================  ===========================================  =============================================

A disc with its axis a along n touches with its whole rim; the point is then one of the rim.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism.contacts import Contact, DiscPlane, ElementaryContact, SphereSphere, contact_parts
from consilience.mechanism.model import GROUND, Mechanism, State
from consilience.mechanism.observables import body_point, joint_spring_motion
from consilience.mechanism.spatial import Array, cross, orthogonal_triad
from consilience.mechanism.units import characteristic_length


@dataclass(frozen=True, eq=False)
class NearestPoints:
    """Nearest points of two shapes at one state, world axes.

    Attributes
    ----------
    gap : float, m
        Distance of the shapes; negative where they overlap.
    normal : ndarray, shape (3,)
        Unit vector from `partner` to `body`.
    on_body, on_partner : ndarray, shape (3,), m
        They coincide at zero gap.
    """

    gap: float
    normal: Array
    on_body: Array
    on_partner: Array


def _rotation(mechanism: Mechanism, state: State, body: str) -> Array:
    return np.eye(3) if body == GROUND else state.R_WB[mechanism.body_index[body]]


def nearest_points(mechanism: Mechanism, state: State, contact: ElementaryContact) -> NearestPoints:
    """Return the nearest points of the shapes of a contact at a state.

    Raises
    ------
    InvalidInput
        If the centres of two spheres coincide.
    """
    center, _ = body_point(mechanism, state, contact.body, contact.center)
    if isinstance(contact, SphereSphere):
        other, _ = body_point(mechanism, state, contact.partner, contact.partner_center)
        distance = float(np.linalg.norm(center - other))
        if distance == 0.0:
            raise InvalidInput(f"contact '{contact.name}'", "the centres of the spheres coincide", "Place them apart.")
        n = (center - other) / distance
        gap = distance - contact.radius - contact.partner_radius
        return NearestPoints(gap, n, center - contact.radius * n, other + contact.partner_radius * n)
    point, _ = body_point(mechanism, state, contact.partner, contact.point)
    n = _rotation(mechanism, state, contact.partner) @ contact.normal
    if isinstance(contact, DiscPlane):
        axis = _rotation(mechanism, state, contact.body) @ contact.axis
        across = n - (n @ axis) * axis
        if not np.any(across):
            across = orthogonal_triad(axis)[0]
        lowest = center - contact.radius * across / np.linalg.norm(across)
    else:
        lowest = center - contact.radius * n
    gap = float(n @ (lowest - point))
    return NearestPoints(gap, n, lowest, lowest - gap * n)


def contact_gap(mechanism: Mechanism, state: State, contact: Contact) -> float:
    """Return the gap of a contact at a state in m, the smallest of its parts, negative where the shapes overlap."""
    return min(nearest_points(mechanism, state, part).gap for part in contact_parts(contact))


def contact_velocity(mechanism: Mechanism, state: State, contact: Contact, near: NearestPoints) -> Array:
    """Return the velocity of the material point of the body relative to that of the partner, shape (3,), m/s."""
    found = np.zeros(3)
    for body, point, sign in ((contact.body, near.on_body, 1.0), (contact.partner, near.on_partner, -1.0)):
        i = mechanism.body_index[body]
        if i >= 0:
            found += sign * (state.v_WB_W[i] + cross(state.w_WB_W[i], point - state.p_WB[i]))
    return found


def contact_tangents(mechanism: Mechanism, state: State, contact: ElementaryContact) -> tuple[Array, Array]:
    """Return the tangents t1 and ``t2 = n x t1`` of the cone of a contact at a state, each (3,), world axes."""
    R = _rotation(mechanism, state, contact.partner)
    t1, t2 = contact.cone.tangents(R.T @ nearest_points(mechanism, state, contact).normal)
    return R @ t1, R @ t2


def elementary_contacts(mechanism: Mechanism) -> tuple[ElementaryContact, ...]:
    """Return the parts of all contacts of a mechanism, in their order; see `contact_parts`."""
    return tuple(part for contact in mechanism.contacts for part in contact_parts(contact))


def closing_rows(mechanism: Mechanism, state: State) -> Array:
    """Return the rows of the closed contacts and stops in the velocities of the bodies, shape (n, 6 n_b).

    Times the velocities ``(v_WB_W, w_WB_W)`` they are the rates of gaps and of joint coordinates at a limit.
    """
    slack, rows = TOUCHING * characteristic_length(mechanism), []
    for part in elementary_contacts(mechanism):
        near = nearest_points(mechanism, state, part)
        if near.gap <= slack:
            row = np.zeros((len(mechanism.bodies), 6))
            for body, point, sign in ((part.body, near.on_body, 1.0), (part.partner, near.on_partner, -1.0)):
                i = mechanism.body_index[body]
                if i >= 0:
                    row[i] = sign * np.concatenate([near.normal, cross(point - state.p_WB[i], near.normal)])
            rows.append(row.ravel())
    for stop in mechanism.stops:
        q, _ = joint_spring_motion(mechanism, state, stop.joint, stop.coordinate)
        room = slack if stop.coordinate == "distance" else TOUCHING
        if any(limit is not None and abs(q - limit) <= room for limit in (stop.lower, stop.upper)):
            rows.append(coordinate_row(mechanism, state, stop.joint, stop.coordinate))
    return np.array(rows).reshape(-1, 6 * len(mechanism.bodies))


def sharing_rows(mechanism: Mechanism, state: State) -> Array:
    """Return a row for each pair of bodies with more than three closed contacts on one plane, in their velocities.

    Times ``(v_WB_W, w_WB_W)`` a row is the angular velocity about the normal of the body relative to the partner. How
    four contacts share a load is open: where that turns, friction has several directions, and the motion is open, too.
    """
    slack, found = TOUCHING * characteristic_length(mechanism), list[tuple[tuple[str, str], Array]]()
    for part in elementary_contacts(mechanism):
        near = nearest_points(mechanism, state, part)
        if near.gap <= slack and part.friction > 0.0:
            found.append(((part.body, part.partner), near.normal))
    rows = []
    for n, (pair, normal) in enumerate(found):
        alike = [other == pair and np.max(np.abs(one - normal)) <= TOUCHING for other, one in found]
        if sum(alike) > 3 and alike.index(True) == n:  # once for each plane
            row = np.zeros((len(mechanism.bodies) + 1, 6))  # the last is the ground
            for body, sign in zip(pair, (1.0, -1.0), strict=True):
                row[mechanism.body_index[body], 3:] = sign * normal
            rows.append(row[:-1].ravel())
    return np.array(rows).reshape(-1, 6 * len(mechanism.bodies))


def coordinate_row(mechanism: Mechanism, state: State, joint: str, coordinate: str) -> Array:
    """Return the row of the rate of a joint coordinate: that rate for each unit velocity."""
    count, row = len(mechanism.bodies), []
    for unit in np.eye(6 * count):
        v, w = unit.reshape(-1, 6)[:, :3], unit.reshape(-1, 6)[:, 3:]
        moving = State(state.p_WB, state.quat_WB, v, w)
        row.append(joint_spring_motion(mechanism, moving, joint, coordinate)[1])
    return np.array(row)


TOUCHING = 1e-10
"""Largest gap, and largest overlap, of a closed contact, over the characteristic length of the mechanism."""

_APPROACHES = 1e-9
"""Least rate of what approaches, over the fastest velocity."""


def refuse_flat_discs(mechanism: Mechanism, state: State) -> None:
    """Refuse a state in which a disc is parallel to its plane: the lowest point of its rim is open.

    Raises
    ------
    InvalidInput
    """
    for part in elementary_contacts(mechanism):
        if isinstance(part, DiscPlane):
            axis = _rotation(mechanism, state, part.body) @ part.axis
            normal = _rotation(mechanism, state, part.partner) @ part.normal
            if np.linalg.norm(cross(axis, normal)) <= TOUCHING:
                what = "the disc is parallel to the plane: which point of its rim is the lowest is open"
                raise InvalidInput(f"contact '{part.name}'", what, "Tilt it, or state points of its rim as contacts.")


def overlaps(
    mechanism: Mechanism, state: State, values: Mapping[str, Mapping[str, Any]] | None = None
) -> Iterator[tuple[str, str]]:
    """Yield the name of each rigid contact that overlaps and of each stop that a joint is beyond, and by how much.

    Joint coordinates have their full turns if their values are given, by the names of joint and coordinate.
    """
    slack = TOUCHING * characteristic_length(mechanism)
    for contact in mechanism.contacts:
        gap = contact_gap(mechanism, state, contact)
        if gap < -slack and contact.compliance is None:
            yield f"contact '{contact.name}'", f"{contact.body} and {contact.partner} overlap by {-gap:.3g} m"
    for stop in mechanism.stops:
        if values is None:
            q, _ = joint_spring_motion(mechanism, state, stop.joint, stop.coordinate)
        else:
            q = float(values[stop.joint][stop.coordinate])
        room = slack if stop.coordinate == "distance" else TOUCHING
        for limit, beyond in ((stop.lower, -1.0), (stop.upper, 1.0)):
            if limit is not None and beyond * (q - limit) > room:
                past = f"beyond the limit {limit:.6g} by {abs(q - limit):.3g}"
                yield f"stop '{stop.name}'", f"{stop.coordinate} {q:.6g} of '{stop.joint}' is {past}"


def refuse_overlap(mechanism: Mechanism, state: State) -> None:
    """Refuse a start in which rigid shapes overlap, or a joint is beyond a stop.

    Raises
    ------
    InvalidInput
    """
    for name, what in overlaps(mechanism, state):
        remedy = "Start between the limits." if name.startswith("stop") else "Start with a gap of zero or more."
        raise InvalidInput(name, f"{what} at the start", remedy)


def strikes(mechanism: Mechanism, state: State) -> bool:
    """Whether a closed contact or a stop at its limit approaches: an impact, at which there are no accelerations."""
    length = characteristic_length(mechanism)
    least = _APPROACHES * float(np.max(np.abs([state.v_WB_W, length * state.w_WB_W]), initial=0.0))
    for part in elementary_contacts(mechanism):
        near = nearest_points(mechanism, state, part)
        rate = float(near.normal @ contact_velocity(mechanism, state, part, near))
        if near.gap <= TOUCHING * length and part.compliance is None and rate < -least:
            return True
    for stop in mechanism.stops:
        of_unit = 1.0 if stop.coordinate == "distance" else length
        q, rate = (of_unit * x for x in joint_spring_motion(mechanism, state, stop.joint, stop.coordinate))
        for limit, beyond in ((stop.lower, -1.0), (stop.upper, 1.0)):
            if limit is not None and beyond * (q - of_unit * limit) >= -TOUCHING * length and beyond * rate > least:
                return True
    return False
