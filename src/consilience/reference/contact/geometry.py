"""Contact geometry: contact points, gap, normal and relative velocity of two shapes.

A contact is a pair of shapes on two bodies, one of which may be the ground: a sphere or a corner on a plane, or two
spheres. The normal n points from `partner` to `body`. Contact points are the nearest points of the shapes; for rigid
shapes the rate of the gap is the normal component of their relative velocity,

    gap' = n . (v_body + w_body x r_body - v_partner - w_partner x r_partner).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Array,
    Contact,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    body_point,
    cross,
)


@dataclass(frozen=True, eq=False)
class ContactMotion:
    """Contact at one state, world axes.

    Attributes
    ----------
    gap : float, m
        Distance of the shapes; negative where they overlap.
    normal : ndarray, shape (3,)
        Unit vector from `partner` to `body`.
    on_body, on_partner : ndarray, shape (3,), m
        Contact points; they coincide at zero gap.
    velocity : ndarray, shape (3,), m/s
        Velocity of the contact point on `body` relative to that on `partner`.
    """

    gap: float
    normal: Array
    on_body: Array
    on_partner: Array
    velocity: Array

    @property
    def rate(self) -> float:
        """Rate of the gap, m/s: negative while the bodies approach."""
        return float(self.normal @ self.velocity)


def _sphere_on_plane(
    mechanism: Mechanism, state: State, contact: SpherePlane | PointPlane
) -> tuple[float, Array, Array, Array]:
    """Return gap, normal and the contact points on body and partner."""
    centre, _ = body_point(mechanism, state, contact.body, contact.center)
    point, _ = body_point(mechanism, state, contact.partner, contact.point)
    i = mechanism.body_index[contact.partner]
    n = contact.normal if i < 0 else state.R_WB[i] @ contact.normal
    height = float(n @ (centre - point))
    return height - contact.radius, n, centre - contact.radius * n, centre - height * n


def _sphere_on_sphere(mechanism: Mechanism, state: State, contact: SphereSphere) -> tuple[float, Array, Array, Array]:
    """Return gap, normal and the contact points on body and partner."""
    one, _ = body_point(mechanism, state, contact.body, contact.center)
    two, _ = body_point(mechanism, state, contact.partner, contact.partner_center)
    distance = float(np.linalg.norm(one - two))
    if distance == 0.0:
        raise InvalidInput(f"contact '{contact.name}'", "the centres of the spheres coincide", "Place them apart.")
    n = (one - two) / distance
    gap = distance - contact.radius - contact.partner_radius
    return gap, n, one - contact.radius * n, two + contact.partner_radius * n


_NEAREST: dict[type, Callable[..., tuple[float, Array, Array, Array]]] = {
    SpherePlane: _sphere_on_plane,
    PointPlane: _sphere_on_plane,
    SphereSphere: _sphere_on_sphere,
}


def _velocity(mechanism: Mechanism, state: State, body: str, point_W: Array) -> Array:
    """Return the velocity of a point of a body at the world position `point_W`."""
    if body == GROUND:
        return np.zeros(3)
    i = mechanism.body_index[body]
    return state.v_WB_W[i] + cross(state.w_WB_W[i], point_W - state.p_WB[i])


def contact_motion(mechanism: Mechanism, state: State, contact: Contact) -> ContactMotion:
    """Evaluate gap, normal, contact points and their relative velocity at a state."""
    gap, n, on_body, on_partner = _NEAREST[type(contact)](mechanism, state, contact)
    velocity = _velocity(mechanism, state, contact.body, on_body)
    velocity = velocity - _velocity(mechanism, state, contact.partner, on_partner)
    return ContactMotion(gap, n, on_body, on_partner, velocity)


def check_contacts(mechanism: Mechanism, contacts: tuple[Contact, ...]) -> None:
    """Refuse duplicate names and unknown bodies.

    Raises
    ------
    InvalidInput
    """
    seen: set[str] = set()
    for contact in contacts:
        where = f"contact '{contact.name}'"
        if contact.name in seen:
            raise InvalidInput(where, "the name is used twice", "Give each its own name.")
        seen.add(contact.name)
        for name in (contact.body, contact.partner):
            if name not in mechanism.body_index:
                known = ", ".join(mechanism.body_index)
                raise InvalidInput(where, f"there is no body '{name}'", f"Bodies are: {known}.")
