"""Relative motion of two shapes that may touch: their nearest points, and the velocity of one relative to the other.

The normal n points from `partner` to `body`. For rigid shapes the rate of the gap is the normal component of the
relative velocity of the nearest points,

    gap' = n . (v_body + w_body x r_body - v_partner - w_partner x r_partner).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import (
    GROUND,
    Array,
    Contact,
    Mechanism,
    NearestPoints,
    State,
    contact_parts,
    cross,
    nearest_points,
)


@dataclass(frozen=True, eq=False)
class ContactMotion(NearestPoints):
    """Nearest points of two shapes at one state with their relative velocity, world axes.

    Attributes
    ----------
    velocity : ndarray, shape (3,), m/s
        Velocity of the contact point on `body` relative to that on `partner`.
    """

    velocity: Array

    @property
    def rate(self) -> float:
        """Rate of the gap, m/s: negative while the bodies approach."""
        return float(self.normal @ self.velocity)


def _velocity(mechanism: Mechanism, state: State, body: str, point_W: Array) -> Array:
    """Return the velocity of a point of a body at the world position `point_W`."""
    if body == GROUND:
        return np.zeros(3)
    i = mechanism.body_index[body]
    return state.v_WB_W[i] + cross(state.w_WB_W[i], point_W - state.p_WB[i])


def contact_motion(mechanism: Mechanism, state: State, contact: Contact) -> ContactMotion:
    """Return gap, normal, nearest points and their relative velocity at a state, of the part that is nearest."""
    near = min((nearest_points(mechanism, state, part) for part in contact_parts(contact)), key=lambda n: n.gap)
    velocity = _velocity(mechanism, state, contact.body, near.on_body)
    velocity = velocity - _velocity(mechanism, state, contact.partner, near.on_partner)
    return ContactMotion(**vars(near), velocity=velocity)
