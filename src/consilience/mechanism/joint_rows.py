"""Constraint rows of single joints: values, Jacobian coefficients and gamma, in plain NumPy.

Frame F with axes U is fixed to the predecessor i, frame M with axes W to the successor j; d is the vector from the
origin of F to that of M, all in axes of the world. The basic constraints are ``(X, Y, Z) = U^T d``, ``L = |d|`` and
``D_kl = u_k . w_l`` [MASS (9)-(12)]; a screw has the row ``H = Z - pitch angle / 2 pi``. Lengths are in m, angles in
rad, D without unit.

Coefficients of a row multiply ``(v_i, w_i, v_j, w_j)``: velocities of the body *origins* and angular velocities, in
world axes. Gamma is the right-hand side of ``row . (a_i, alpha_i, a_j, alpha_j) = gamma``.

The reference solver has compiled rows of its own, about the *centres of mass* (`reference.bodies.joint_rows`). Both
share no code on purpose, and tests compare them. An adapter that takes rows from here needs a test with rows from
elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from consilience.mechanism.bodies import Frame
from consilience.mechanism.model import GROUND, Joint, Mechanism, State
from consilience.mechanism.spatial import Array, cross, plain_cross

TURN = 2 * np.pi


@dataclass(frozen=True, eq=False)
class JointFrames:
    """Frames F and M of one joint in the world, with the arms from the body origins.

    Attributes
    ----------
    U, W : ndarray, shape (3, 3)
        Axes of F and of M as columns, in world components.
    s_i, s_j : ndarray, shape (3,), m
        From the origin of the predecessor (successor) to the origin of F (M), in world axes.
    d : ndarray, shape (3,), m
        From the origin of F to the origin of M, in world axes.
    v_i, w_i, v_j, w_j : ndarray, shape (3,)
        Velocities of the two bodies.
    pitch : float, m
        Of a screw; zero for every other joint.
    """

    U: Array
    W: Array
    s_i: Array
    s_j: Array
    d: Array
    v_i: Array
    w_i: Array
    v_j: Array
    w_j: Array
    pitch: float = 0.0

    @cached_property
    def d_dot(self) -> Array:
        """Velocity of the origin of M relative to that of F, in world axes."""
        return self.v_j + cross(self.w_j, self.s_j) - self.v_i - cross(self.w_i, self.s_i)

    @cached_property
    def centripetal(self) -> Array:
        """Part of the relative acceleration of the origins of F and M that is quadratic in the angular velocities."""
        w_i, w_j = self.w_i, self.w_j
        return cross(w_j, cross(w_j, self.s_j)) - cross(w_i, cross(w_i, self.s_i))

    def rate_of(self, coefficients: Array) -> float:
        """Return the rate of a row from its coefficients, shape (12,)."""
        return float(coefficients @ np.concatenate([self.v_i, self.w_i, self.v_j, self.w_j]))

    def rate(self, row: str) -> float:
        """Return the rate of a basic constraint."""
        return self.rate_of(row_jacobian(self, row))


def side(mechanism: Mechanism, state: State, body: str, frame: Frame) -> tuple[Array, Array, Array, Array, Array]:
    """Return axes, arm from the body's origin and position of a frame on a body, and the body's v and w, world axes."""
    if body == GROUND:
        return frame.R, frame.p, frame.p, np.zeros(3), np.zeros(3)
    i = mechanism.body_index[body]
    R_WB = state.R_WB[i]
    s = R_WB @ frame.p
    return R_WB @ frame.R, s, state.p_WB[i] + s, state.v_WB_W[i], state.w_WB_W[i]


def joint_frames(mechanism: Mechanism, state: State, joint: Joint) -> JointFrames:
    """Return frames F and M of a joint in the world."""
    U, s_i, p_F, v_i, w_i = side(mechanism, state, joint.predecessor, joint.F)
    W, s_j, p_M, v_j, w_j = side(mechanism, state, joint.successor, joint.M)
    return JointFrames(U, W, s_i, s_j, p_M - p_F, v_i, w_i, v_j, w_j, joint.pitch)


def full_turns(angle: float, near: float) -> float:
    """Add to an angle the full turns that bring it nearest to `near`, rad."""
    return angle + TURN * round((near - angle) / TURN)


def coordinate_value(frames: JointFrames, coordinate: str, near: float = 0.0) -> float:
    """Return a coordinate of a one-axis joint: ``distance`` is Z, ``angle`` has the tangent ``D21 / D11``.

    The angle is within half a turn of `near`; that of a screw counts the turns of the displacement, whatever `near` is.
    """
    if coordinate == "distance":
        return row_value(frames, "Z")
    if frames.pitch != 0.0:
        near = TURN * row_value(frames, "Z") / frames.pitch
    return full_turns(float(np.arctan2(row_value(frames, "D21"), row_value(frames, "D11"))), near)


def coordinate_jacobian(frames: JointFrames, coordinate: str) -> Array:
    """Return the coefficients of the rate of a coordinate, shape (12,)."""
    if coordinate == "distance":
        return row_jacobian(frames, "Z")
    c, s = row_value(frames, "D11"), row_value(frames, "D21")
    return (c * row_jacobian(frames, "D21") - s * row_jacobian(frames, "D11")) / (c * c + s * s)


def coordinate_gamma(frames: JointFrames, coordinate: str) -> float:
    """Return gamma of a coordinate: its second rate is ``coefficients @ (a_i, alpha_i, a_j, alpha_j) - gamma``."""
    if coordinate == "distance":
        return row_gamma(frames, "Z")
    c, s = row_value(frames, "D11"), row_value(frames, "D21")
    c_dot, s_dot = frames.rate("D11"), frames.rate("D21")
    angle_dot = frames.rate_of(coordinate_jacobian(frames, coordinate))
    square = c * c + s * s
    plain = c * row_gamma(frames, "D21") - s * row_gamma(frames, "D11")
    return (plain + 2.0 * angle_dot * (c * c_dot + s * s_dot)) / square


def row_value(frames: JointFrames, row: str) -> float:
    """Return the value of a basic constraint."""
    if row in "XYZ":
        return float(frames.U[:, "XYZ".index(row)] @ frames.d)
    if row == "L":
        return float(np.linalg.norm(frames.d))
    if row == "H":
        return row_value(frames, "Z") - frames.pitch * coordinate_value(frames, "angle") / TURN
    return float(frames.U[:, int(row[1]) - 1] @ frames.W[:, int(row[2]) - 1])


def row_jacobian(frames: JointFrames, row: str) -> Array:
    """Return the coefficients of a basic constraint, shape (12,)."""
    return row_jacobians(frames, (row,))[0]


def row_jacobians(frames: JointFrames, rows: Sequence[str]) -> Array:
    """Return the coefficients of several basic constraints, shape (rows, 12)."""
    # lists of numbers: for so few, arrays are several times slower
    U, W = frames.U.T.tolist(), frames.W.T.tolist()
    arm, s_j = (frames.s_i + frames.d).tolist(), frames.s_j.tolist()
    found = list[list[float]]()
    for row in rows:
        if row[0] == "D":
            x, y, z = plain_cross(U[int(row[1]) - 1], W[int(row[2]) - 1])
            found.append([0.0, 0.0, 0.0, x, y, z, 0.0, 0.0, 0.0, -x, -y, -z])
        elif row in "XYZ":
            u = U["XYZ".index(row)]
            x, y, z = plain_cross(arm, u)
            found.append([-u[0], -u[1], -u[2], -x, -y, -z, *u, *plain_cross(s_j, u)])
        elif row == "L":
            e = frames.d / (np.linalg.norm(frames.d) or np.nan)  # none where the ends meet
            found.append([*-e, *-cross(frames.s_i, e), *e, *cross(frames.s_j, e)])
        else:
            turned = frames.pitch / TURN * coordinate_jacobian(frames, "angle")
            found.append((row_jacobian(frames, "Z") - turned).tolist())
    return np.array(found).reshape(-1, 12)


def row_gamma(frames: JointFrames, row: str) -> float:
    """Return gamma of a basic constraint."""
    w_i, w_j = frames.w_i, frames.w_j
    if row[0] == "D":
        u, w = frames.U[:, int(row[1]) - 1], frames.W[:, int(row[2]) - 1]
        u_dot, w_dot = cross(w_i, u), cross(w_j, w)
        return -float(cross(w_i, u_dot) @ w + 2 * u_dot @ w_dot + u @ cross(w_j, w_dot))
    if row == "L":
        L = np.linalg.norm(frames.d)
        e, d_dot = frames.d / L, frames.d_dot
        return -float((d_dot @ d_dot - (e @ d_dot) ** 2) / L + e @ frames.centripetal)
    if row == "H":
        return row_gamma(frames, "Z") - frames.pitch / TURN * coordinate_gamma(frames, "angle")
    u = frames.U[:, "XYZ".index(row)]
    u_dot = cross(w_i, u)
    return -float(cross(w_i, u_dot) @ frames.d + 2 * u_dot @ frames.d_dot + u @ frames.centripetal)


def row_target(joint: Joint, row: str) -> float:
    """Return the value at which a joint holds a row: the rod at its length, every other row at zero."""
    return joint.length if row == "L" else 0.0


def scatter(mechanism: Mechanism, joint: Joint, coefficients: Array) -> Array:
    """Spread coefficients (..., 12) of the two bodies of a joint over the columns of all bodies, (..., 6 n_b)."""
    Q = np.zeros((*coefficients.shape[:-1], 6 * len(mechanism.bodies)))
    for body, columns in ((joint.predecessor, coefficients[..., :6]), (joint.successor, coefficients[..., 6:])):
        if body != GROUND:
            i = mechanism.body_index[body]
            Q[..., 6 * i : 6 * i + 6] = columns
    return Q
