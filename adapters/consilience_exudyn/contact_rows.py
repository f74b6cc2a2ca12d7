"""Rows of closed contacts and of joint coordinates in the velocities ``(v_WB_W, w_WB_W)`` of all bodies.

The points of contact are those of `consilience.mechanism.nearest_points`. A point x in contact moves in both bodies:
for each, ``u = v + w x r`` and ``u' = a + alpha x r + w x (x' - v)`` with the arm r from the body's origin to x.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from consilience.engine import without_screws
from consilience.mechanism import (
    GROUND,
    Array,
    Drive,
    ElementaryContact,
    Mechanism,
    SphereSphere,
    State,
    body_point,
    constant,
    constraint_gamma,
    constraint_jacobian,
    cross,
    mass_matrix,
    nearest_points,
    null_space,
    skew,
)


@dataclass(frozen=True, eq=False)
class TouchRow:
    """An elementary contact at a state.

    Attributes
    ----------
    part : ElementaryContact
    contact : int
        Declared contact of which it is a part.
    J : ndarray, shape (3, 6 n_b)
    gamma, u, normal, n_dot : ndarray, shape (3,)
        ``u' = J a + gamma``, u, the normal and its rate; world axes.
    gap : float, m
    """

    part: ElementaryContact
    contact: int
    J: Array
    gamma: Array
    u: Array
    normal: Array
    n_dot: Array
    gap: float

    @property
    def rate(self) -> float:
        """Rate of the gap, m/s."""
        return float(self.normal @ self.u)

    @property
    def slip(self) -> Array:
        """Velocity across the normal, shape (3,), m/s."""
        return np.asarray(self.u - self.rate * self.normal)


def contact_row(mechanism: Mechanism, state: State, part: ElementaryContact, contact: int) -> TouchRow:
    """Return the row of an elementary contact at a state; apart, of the nearest points, with gamma of a closed one."""
    nearest = nearest_points(mechanism, state, part)
    n = nearest.normal
    _, center_rate = body_point(mechanism, state, part.body, part.center)
    zero = np.zeros(3)
    motions = [
        (zero, zero, zero) if name == GROUND else tuple(getattr(state, f)[mechanism.body_index[name]] for f in _MOTION)
        for name in (part.body, part.partner)
    ]
    if isinstance(part, SphereSphere):
        _, other = body_point(mechanism, state, part.partner, part.partner_center)
        apart = center_rate - other
        n_dot = (apart - n * (n @ apart)) / (part.radius + part.partner_radius + nearest.gap)
    else:
        n_dot = cross(motions[1][2], n)
    x_dot = center_rate - part.radius * n_dot
    J, gamma, u = np.zeros((3, 6 * len(mechanism.bodies))), np.zeros(3), np.zeros(3)
    both = ((part.body, nearest.on_body, 1.0), (part.partner, nearest.on_partner, -1.0))
    for (name, x, sign), (p, v, w) in zip(both, motions, strict=True):
        if name != GROUND:
            i = 6 * mechanism.body_index[name]
            J[:, i : i + 3] += sign * np.eye(3)
            J[:, i + 3 : i + 6] -= sign * skew(x - p)
            u += sign * (v + cross(w, x - p))
            gamma += sign * cross(w, x_dot - v)
    return TouchRow(part, contact, J, gamma, u, n, n_dot, nearest.gap)


_MOTION = ("p_WB", "v_WB_W", "w_WB_W")


def coordinate_row(mechanism: Mechanism, state: State, joint: str, coordinate: str) -> tuple[Array, float]:
    """Return the Jacobian (6 n_b,) of a joint coordinate and gamma of ``q'' = J a - gamma``: the row of a drive."""
    drive = Drive("", joint, coordinate, constant(0.0))
    bare = without_screws(mechanism, "cylindrical")
    alone = replace(bare, drives=(drive,), couplings=(), rollings=(), skates=(), stops=(), dry_frictions=())
    return constraint_jacobian(alone, state)[-1], float(constraint_gamma(alone, state)[-1])


def mobility(mechanism: Mechanism, state: State) -> Array:
    """Return the inverse inertia of the bodies' velocities under the constraints, shape (6 n_b, 6 n_b)."""
    N = null_space(constraint_jacobian(mechanism, state))
    return np.asarray(N @ np.linalg.solve(N.T @ mass_matrix(mechanism, state) @ N, N.T))
