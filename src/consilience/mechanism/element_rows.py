"""Constraint rows of drives, couplings, rolling bodies and skates, in plain NumPy.

All vectors are in axes of the world; v and w are the velocities of a body's *origin* and its angular velocity. A row
has a value g (m or rad; zero where it holds a velocity alone), coefficients Q of all body velocities and gamma, the
right-hand side of ``Q a = gamma``.

- Drive: ``q - f(t) = 0``. Coupling: ``q - f(q_driver) = 0``.
- Rolling: circle of radius R about centre c with axis a, thickened by r, on a plane with normal n. The point of contact
  is at ``rho = -R m / |m| - r n`` from c, ``m = n - (n.a) a`` (`rolling_contact`). It lies in the plane,
  ``n . (c + rho - point) = 0``, and its velocity ``v_c + w x rho`` vanishes along two directions of the plane; along n
  that velocity is the rate of the first row.
- Skate: ``l . (v + w x s) = 0`` at the arm s, the direction l fixed to the body.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from consilience.errors import CannotAssemble
from consilience.mechanism.elements import Coupling, Drive, Rolling, Skate
from consilience.mechanism.functions import Function
from consilience.mechanism.joint_rows import (
    coordinate_gamma,
    coordinate_jacobian,
    coordinate_value,
    joint_frames,
    scatter,
)
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.spatial import Array, cross, orthogonal_triad


@dataclass(frozen=True, eq=False)
class ElementRow:
    """One row: value (zero for a non-holonomic row), coefficients of all body velocities (6 n_b,), and gamma."""

    value: float
    Q: Array
    gamma: float


Angles = Mapping[str, float]
"""Previous angles of joints by name, rad, from which turns are counted; default: within half a turn of zero."""


def _coordinate(
    mechanism: Mechanism, state: State, name: str, coordinate: str, near: float
) -> tuple[float, Array, float, float]:
    """Value, coefficients (6 n_b,), gamma and rate of a joint coordinate.

    Parameters
    ----------
    name, coordinate : str
        Joint, and its coordinate.
    near : float, rad
        Angle from which turns are counted.
    """
    joint = mechanism.joints[mechanism.joint_index[name]]
    frames = joint_frames(mechanism, state, joint)
    pair = coordinate_jacobian(frames, coordinate)
    return (
        coordinate_value(frames, coordinate, near),
        scatter(mechanism, joint, pair),
        coordinate_gamma(frames, coordinate),
        frames.rate_of(pair),
    )


def _law_at(element: Drive | Coupling, law: Function, x: float, what: str) -> Array:
    """Return value and two derivatives of a law; refuse an argument beyond its table.

    Parameters
    ----------
    element : Drive or Coupling
    law : Function
    x : float, s, rad or m
    what : str
        Name of the argument, for the message.
    """
    f = law.at(x)
    if law.table is not None and np.isnan(f[0]):
        raise CannotAssemble(
            f"{type(element).__name__.lower()} '{element.name}'",
            f"its table reaches from {law.table.x[0]:g} to {law.table.x[-1]:g}, and {what} is {x:.6g}",
            "Give a longer table, or a motion that stays within it.",
        )
    return f


def holonomic_rows(mechanism: Mechanism, state: State, t: float, angles: Angles) -> list[ElementRow]:
    """Return the rows of drives, couplings and contacts of rolling bodies, in that order."""
    rows = []
    for drive in mechanism.drives:
        f = _law_at(drive, drive.motion, t, "the time")
        q, Q, gamma, _ = _coordinate(mechanism, state, drive.joint, drive.coordinate, float(f[0]))
        rows.append(ElementRow(q - f[0], Q, gamma + f[2]))
    for coupling in mechanism.couplings:
        near = angles.get(coupling.driver_joint, 0.0)
        driver, Q_driver, gamma_driver, rate = _coordinate(
            mechanism, state, coupling.driver_joint, coupling.driver_coordinate, near
        )
        f = _law_at(coupling, coupling.law, driver, f"the {coupling.driver_coordinate} of '{coupling.driver_joint}'")
        q, Q, gamma, _ = _coordinate(mechanism, state, coupling.joint, coupling.coordinate, float(f[0]))
        rows.append(ElementRow(q - f[0], Q - f[1] * Q_driver, gamma - f[1] * gamma_driver + f[2] * rate**2))
    rows += [next(rolling_rows(mechanism, state, rolling)) for rolling in mechanism.rollings]
    return rows


def count_turns(mechanism: Mechanism, state: State, angles: Angles) -> dict[str, float]:
    """Return the angles of joints that drive a coupling, over full turns, each nearest to its previous angle."""
    counted = {}
    for coupling in mechanism.couplings:
        if coupling.driver_coordinate == "angle":
            frames = joint_frames(mechanism, state, mechanism.joints[mechanism.joint_index[coupling.driver_joint]])
            near = angles.get(coupling.driver_joint, 0.0)
            counted[coupling.driver_joint] = coordinate_value(frames, "angle", near)
    return counted


def non_holonomic_rows(mechanism: Mechanism, state: State) -> list[ElementRow]:
    """Return two rows of slip for each rolling body, then one row for each skate."""
    rows = []
    for rolling in mechanism.rollings:
        rows += list(rolling_rows(mechanism, state, rolling))[1:]
    return rows + [_skate_row(mechanism, state, skate) for skate in mechanism.skates]


@lru_cache(maxsize=64)  # constant, and needed in every evaluation of a row
def plane_axes(rolling: Rolling) -> Array:
    """Return the axes of the plane as rows: normal and two directions in the plane, shape (3, 3), read-only."""
    along, across = orthogonal_triad(rolling.normal)
    axes = np.array([rolling.normal, along / np.linalg.norm(along), across / np.linalg.norm(across)])
    axes.flags.writeable = False
    return axes


def rolling_contact(axis: Array, normal: Array, w: Array, radius: float, rounding: float) -> tuple[Array, Array]:
    """Return the arm rho from the centre of a rolling body to its point of contact, and the rate of rho.

    ``rho = -R m / |m| - r n``, ``m = n - (n.a) a``. The material point in contact has the acceleration
    ``a_P = w x (w x rho - rho')``. Exported scripts contain the text of this function.

    Parameters
    ----------
    axis, normal : ndarray, shape (3,)
        Unit vectors in world axes: axis a of the circle, normal n of the plane towards the body.
    w : ndarray, shape (3,), rad/s
        Angular velocity of the body in world axes.
    radius, rounding : float, m
        Radius R of the circle, zero for a ball, and r of the tube about the circle.

    Returns
    -------
    rho, rho_dot : ndarray, shape (3,), m and m/s
        In world axes.
    """
    if not radius:
        return -rounding * normal, np.zeros(3)
    along, axis_dot = normal @ axis, cross(w, axis)
    m, m_dot = normal - along * axis, -(normal @ axis_dot) * axis - along * axis_dot
    size = np.sqrt(m @ m)
    e = m / size
    return -radius * e - rounding * normal, -radius * (m_dot - (e @ m_dot) * e) / size


def rolling_rows(mechanism: Mechanism, state: State, rolling: Rolling) -> Iterator[ElementRow]:
    """Yield the row of contact, then the two rows of slip."""
    i = mechanism.body_index[rolling.body]
    R_WB, w, n = state.R_WB[i], state.w_WB_W[i], rolling.normal
    s = R_WB @ rolling.center
    rho, rho_dot = rolling_contact(R_WB @ rolling.axis, n, w, rolling.radius, rolling.rounding)
    height = n @ (state.p_WB[i] + s + rho - rolling.point)
    bias = cross(w, cross(w, s)) + cross(w, rho_dot)
    for k, direction in enumerate(plane_axes(rolling)):
        Q = np.zeros(6 * len(mechanism.bodies))
        Q[6 * i : 6 * i + 6] = np.concatenate([direction, cross(s + rho, direction)])
        yield ElementRow(float(height) if k == 0 else 0.0, Q, -float(direction @ bias))


def _skate_row(mechanism: Mechanism, state: State, skate: Skate) -> ElementRow:
    """Row ``l . (v + w x s) = 0`` of a skate."""
    i = mechanism.body_index[skate.body]
    R_WB, v, w = state.R_WB[i], state.v_WB_W[i], state.w_WB_W[i]
    s, lateral = R_WB @ skate.point, R_WB @ skate.lateral
    Q = np.zeros(6 * len(mechanism.bodies))
    Q[6 * i : 6 * i + 6] = np.concatenate([lateral, cross(s, lateral)])
    gamma = -(cross(w, lateral) @ (v + cross(w, s)) + lateral @ cross(w, cross(w, s)))
    return ElementRow(0.0, Q, float(gamma))
