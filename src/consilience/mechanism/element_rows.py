"""Constraint rows of drives, couplings, rolling bodies and skates, in plain NumPy, on body origins.

- Drive: ``q - f(t) = 0``. Coupling: ``q - f(q_driver) = 0``.
- Rolling: centre c, axis a, normal n of the plane, ``m = n - (n.a) a``, ``mu = |m|``. The point of contact is at
  ``rho = -R m / mu - r n`` from c; it is in the plane, ``n . (c - point) - R mu - r = 0``, and its velocity
  ``v_c + w x rho`` vanishes along two directions of the plane (along n that is the rate of the first).
- Skate: ``l . (v + w x s) = 0`` at the arm s, l fixed to the body.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from consilience.mechanism.joint_rows import coordinate_gamma, coordinate_jacobian, coordinate_value, joint_frames
from consilience.mechanism.model import GROUND, Joint, Mechanism, Rolling, Skate, State
from consilience.mechanism.spatial import Array, cross, orthogonal_triad


@dataclass(frozen=True, eq=False)
class ElementRow:
    """One row: value (zero for a non-holonomic one), coefficients of all body velocities (6 n_b,), and gamma."""

    value: float
    Q: Array
    gamma: float


Angles = Mapping[str, float]
"""Angle of joints a moment ago, by name, from which turns are counted; a joint not in it is within half a turn of 0."""


def _coordinate(
    mechanism: Mechanism, state: State, name: str, coordinate: str, near: float
) -> tuple[float, Array, float, float]:
    """Value, coefficients (6 n_b,), gamma and rate of a joint coordinate."""
    joint: Joint = mechanism.joints[mechanism.joint_index[name]]
    frames = joint_frames(mechanism, state, joint)
    pair = coordinate_jacobian(frames, coordinate)
    Q = np.zeros(6 * len(mechanism.bodies))
    for body, columns in ((joint.predecessor, pair[:6]), (joint.successor, pair[6:])):
        if body != GROUND:
            i = mechanism.body_index[body]
            Q[6 * i : 6 * i + 6] = columns
    return coordinate_value(frames, coordinate, near), Q, coordinate_gamma(frames, coordinate), frames.rate_of(pair)


def holonomic_rows(mechanism: Mechanism, state: State, t: float, angles: Angles) -> list[ElementRow]:
    """Rows of drives, couplings and contacts of rolling bodies, in that order."""
    rows = []
    for drive in mechanism.drives:
        f = drive.motion.at(t)
        q, Q, gamma, _ = _coordinate(mechanism, state, drive.joint, drive.coordinate, float(f[0]))
        rows.append(ElementRow(q - f[0], Q, gamma + f[2]))
    for coupling in mechanism.couplings:
        near = angles.get(coupling.driver_joint, 0.0)
        driver, Q_driver, gamma_driver, rate = _coordinate(
            mechanism, state, coupling.driver_joint, coupling.driver_coordinate, near
        )
        f = coupling.law.at(driver)
        q, Q, gamma, _ = _coordinate(mechanism, state, coupling.joint, coupling.coordinate, float(f[0]))
        rows.append(ElementRow(q - f[0], Q - f[1] * Q_driver, gamma - f[1] * gamma_driver + f[2] * rate**2))
    rows += [next(rolling_rows(mechanism, state, rolling)) for rolling in mechanism.rollings]
    return rows


def count_turns(mechanism: Mechanism, state: State, angles: Angles) -> dict[str, float]:
    """Angles of the joints that drive a coupling, turns counted from the angles a moment ago."""
    counted = {}
    for coupling in mechanism.couplings:
        if coupling.driver_coordinate == "angle":
            frames = joint_frames(mechanism, state, mechanism.joints[mechanism.joint_index[coupling.driver_joint]])
            near = angles.get(coupling.driver_joint, 0.0)
            counted[coupling.driver_joint] = coordinate_value(frames, "angle", near)
    return counted


def non_holonomic_rows(mechanism: Mechanism, state: State) -> list[ElementRow]:
    """Two rows of slip for each rolling body, one for each skate."""
    rows = []
    for rolling in mechanism.rollings:
        rows += list(rolling_rows(mechanism, state, rolling))[1:]
    return rows + [_skate_row(mechanism, state, skate) for skate in mechanism.skates]


@lru_cache(maxsize=64)  # fixed to the ground, and asked for in every evaluation of a row
def plane_axes(rolling: Rolling) -> Array:
    """Axes of the plane as rows: normal and two directions in the plane, shape (3, 3), read-only."""
    along, across = orthogonal_triad(rolling.normal)
    axes = np.array([rolling.normal, along / np.linalg.norm(along), across / np.linalg.norm(across)])
    axes.flags.writeable = False
    return axes


def rolling_rows(mechanism: Mechanism, state: State, rolling: Rolling) -> Iterator[ElementRow]:
    """Contact, and the two of slip."""
    i = mechanism.body_index[rolling.body]
    R_WB, w = state.R_WB[i], state.w_WB_W[i]
    s, a, n = R_WB @ rolling.center, R_WB @ rolling.axis, rolling.normal
    a_dot = cross(w, a)
    m, m_dot = n - (n @ a) * a, -(n @ a_dot) * a - (n @ a) * a_dot
    mu = float(np.linalg.norm(m)) if rolling.radius else 1.0  # a ball has no axis that could stand upright
    mu_dot = m @ m_dot / mu
    rho = -rolling.radius * m / mu - rolling.rounding * n
    rho_dot = -rolling.radius * (m_dot / mu - m * mu_dot / mu**2)
    height = n @ (state.p_WB[i] + s - rolling.point) - rolling.radius * mu - rolling.rounding
    bias = cross(w, cross(w, s)) + cross(w, rho_dot)
    for k, direction in enumerate(plane_axes(rolling)):
        Q = np.zeros(6 * len(mechanism.bodies))
        Q[6 * i : 6 * i + 6] = np.concatenate([direction, cross(s + rho, direction)])
        yield ElementRow(float(height) if k == 0 else 0.0, Q, -float(direction @ bias))


def _skate_row(mechanism: Mechanism, state: State, skate: Skate) -> ElementRow:
    i = mechanism.body_index[skate.body]
    R_WB, v, w = state.R_WB[i], state.v_WB_W[i], state.w_WB_W[i]
    s, lateral = R_WB @ skate.point, R_WB @ skate.lateral
    Q = np.zeros(6 * len(mechanism.bodies))
    Q[6 * i : 6 * i + 6] = np.concatenate([lateral, cross(s, lateral)])
    gamma = -(cross(w, lateral) @ (v + cross(w, s)) + lateral @ cross(w, cross(w, s)))
    return ElementRow(0.0, Q, float(gamma))
