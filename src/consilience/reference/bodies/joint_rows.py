"""Constraint rows and coordinates of single joints, compiled [MASS (9)-(29)].

``(X, Y, Z) = U^T d`` (three), ``L = |d|`` (one), ``D_kl = u_k . w_l`` (nine), from the frames of a joint,

    U = A_i A_Ji,  W = A_j A_Jj,  s = A s',  d = r_j + s_j - r_i - s_i.

The rate of a row has the coefficients e of the velocity of the centre of mass of j, -e of that of i, and c_i, c_j of
the angular velocities, all in world axes.

`consilience.mechanism.joint_rows` has the same rows about body origins in NumPy. Neither is derived from the other: the
two check each other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import DISTANCE, Model
from consilience.reference.bodies.motion import ZERO, add_coefficients, arm, motion
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import Vector, add, column, cross, dot, load, scale, sub

TURN = 2.0 * np.pi
_D11, _D21, _Z = np.array([4, 7, 2])  # NumPy integers: Numba types them as array elements, not as literals


BodyVectors = tuple[Vector, Vector, Vector]
"""Position (m) and velocity (m/s) of a centre of mass, and angular velocity (rad/s), world axes."""


FrameMotion = tuple[Vector, tuple[Vector, Vector, Vector], Vector, Vector]
"""Position (m), axes, velocity (m/s) and angular velocity (rad/s) of frame M relative to frame F, in axes of F."""


class JointMotion(NamedTuple):
    """Relative motion of the two frames of a joint, world axes."""

    i: int
    j: int
    s_i: Vector
    s_j: Vector
    d: Vector
    d_dot: Vector
    centripetal: Vector
    w_i: Vector
    w_j: Vector


class Row(NamedTuple):
    """One row: value, gamma and coefficients of the velocities."""

    value: float
    gamma: float
    e: Vector
    c_i: Vector
    c_j: Vector


class CoordinateRow(NamedTuple):
    """One joint coordinate: value, rate, its row, predecessor i and successor j."""

    value: float
    rate: float
    row: Row
    i: int
    j: int


@fused
def motion_between(i: int, j: int, s_i: Vector, s_j: Vector, body_i: BodyVectors, body_j: BodyVectors) -> JointMotion:
    """Return the relative motion of two frames of bodies i and j, world axes.

    Parameters
    ----------
    i, j : int
        Bodies, -1 for the ground.
    s_i, s_j : Vector, m
        Arms from the centres of mass to the frames' origins.
    body_i, body_j : BodyVectors
        Motion of the bodies.
    """
    r_i, v_i, w_i = body_i
    r_j, v_j, w_j = body_j
    d = sub(add(r_j, s_j), add(r_i, s_i))
    d_dot = sub(add(v_j, cross(w_j, s_j)), add(v_i, cross(w_i, s_i)))
    centripetal = sub(cross(w_j, cross(w_j, s_j)), cross(w_i, cross(w_i, s_i)))
    return JointMotion(i, j, s_i, s_j, d, d_dot, centripetal, w_i, w_j)


@fused
def joint_motion(model: Model, y: Array, A: Array, k: int) -> JointMotion:
    """Return the relative motion of the frames of joint k at a packed state, rotation matrices A of all bodies."""
    i, j = model.body_i[k], model.body_j[k]
    s_i, s_j = arm(A, i, load(model.arm_i[k])), arm(A, j, load(model.arm_j[k]))
    return motion_between(i, j, s_i, s_j, motion(y, A, i), motion(y, A, j))


@inner
def _frame(axes: Array, A: Array, body: int) -> tuple[Vector, Vector, Vector]:
    """Return the axes of a frame on a body, in the world."""
    return arm(A, body, column(axes, 0)), arm(A, body, column(axes, 1)), arm(A, body, column(axes, 2))


@inner
def _components(F: tuple[Vector, Vector, Vector], a: Vector) -> Vector:
    """Return the components of a world vector in axes of F."""
    return dot(F[0], a), dot(F[1], a), dot(F[2], a)


@inner
def frame_motion(model: Model, y: Array, A: Array, k: int) -> FrameMotion:
    """Return position, axes, velocity (seen from F) and angular velocity of M relative to F of joint k, axes of F."""
    m = joint_motion(model, y, A, k)
    F, M = _frame(model.axes_i[k], A, m.i), _frame(model.axes_j[k], A, m.j)
    X = _components(F, M[0]), _components(F, M[1]), _components(F, M[2])
    p, v = _components(F, m.d), _components(F, sub(m.d_dot, cross(m.w_i, m.d)))
    return p, X, v, _components(F, sub(m.w_j, m.w_i))


@fused
def displacement_row(u: Vector, m: JointMotion) -> Row:
    """Return the row ``u . d`` of an axis u of body i."""
    u_dot = cross(m.w_i, u)
    gamma = -(dot(cross(m.w_i, u_dot), m.d) + 2.0 * dot(u_dot, m.d_dot) + dot(u, m.centripetal))
    return Row(dot(u, m.d), gamma, u, scale(-1.0, cross(add(m.s_i, m.d), u)), cross(m.s_j, u))


@fused
def distance_row(m: JointMotion) -> Row:
    """Return the row ``|d|``."""
    L = np.sqrt(dot(m.d, m.d))
    e = scale(1.0 / L, m.d)
    gamma = -((dot(m.d_dot, m.d_dot) - dot(e, m.d_dot) ** 2) / L + dot(e, m.centripetal))
    return Row(L, gamma, e, scale(-1.0, cross(m.s_i, e)), cross(m.s_j, e))


@fused
def product_row(u: Vector, w: Vector, m: JointMotion) -> Row:
    """Return the row ``u . w`` of an axis u of body i and an axis w of body j."""
    u_dot, w_dot = cross(m.w_i, u), cross(m.w_j, w)
    normal = cross(u, w)
    gamma = -(dot(cross(m.w_i, u_dot), w) + 2.0 * dot(u_dot, w_dot) + dot(u, cross(m.w_j, w_dot)))
    return Row(dot(u, w), gamma, ZERO, normal, scale(-1.0, normal))


@fused
def basic_row(model: Model, A: Array, m: JointMotion, k: int, kind: int) -> Row:
    """Return one of the thirteen basic constraint rows of joint k; kind indexes `ROWS`.

    Parameters
    ----------
    model : Model
    A : ndarray, shape (n_b, 3, 3)
    m : JointMotion
        Of joint k.
    k, kind : int
    """
    if kind < 3:
        return displacement_row(arm(A, m.i, column(model.axes_i[k], kind)), m)
    if kind == 3:
        return distance_row(m)
    u = arm(A, m.i, column(model.axes_i[k], (kind - 4) // 3))
    return product_row(u, arm(A, m.j, column(model.axes_j[k], (kind - 4) % 3)), m)


@kernel
def full_turns(angle: float, near: float) -> float:
    """Add full turns to an angle, rad, until it is nearest to `near`."""
    return angle + TURN * np.round((near - angle) / TURN)


@fused
def row_of_angle(cos: Row, sin: Row, m: JointMotion, near: float) -> Row:
    """Return the row of the angle ``atan2(sin, cos)`` within half a turn of `near`; sin and cos share any factor."""
    square = cos.value**2 + sin.value**2
    p, q = cos.value / square, sin.value / square
    c_i = sub(scale(p, sin.c_i), scale(q, cos.c_i))
    c_j = sub(scale(p, sin.c_j), scale(q, cos.c_j))
    rate = dot(c_i, m.w_i) + dot(c_j, m.w_j)
    cos_dot = dot(cos.c_i, m.w_i) + dot(cos.c_j, m.w_j)
    sin_dot = dot(sin.c_i, m.w_i) + dot(sin.c_j, m.w_j)
    gamma = p * sin.gamma - q * cos.gamma + 2.0 * rate * (p * cos_dot + q * sin_dot)
    return Row(full_turns(np.arctan2(sin.value, cos.value), near), gamma, ZERO, c_i, c_j)


@inner
def row_of_screw(z: Row, turn: Row, pitch: float) -> Row:
    """Return the row ``Z - pitch angle / 2 pi``."""
    h = pitch / TURN
    return Row(
        z.value - h * turn.value,
        z.gamma - h * turn.gamma,
        z.e,
        sub(z.c_i, scale(h, turn.c_i)),
        sub(z.c_j, scale(h, turn.c_j)),
    )


@fused
def angle_row(model: Model, A: Array, m: JointMotion, k: int, near: float) -> Row:
    """Return the row of the angle of joint k, ``atan2(D21, D11)`` within half a turn of `near`.

    Parameters
    ----------
    model, A, m, k
        As in `basic_row`.
    near : float, rad
    """
    return row_of_angle(basic_row(model, A, m, k, _D11), basic_row(model, A, m, k, _D21), m, near)


@inner
def screw_row(model: Model, A: Array, m: JointMotion, k: int) -> Row:
    """Return the row ``Z - pitch angle / 2 pi`` of a screw; Z gives the full turns of the angle."""
    z, pitch = basic_row(model, A, m, k, _Z), model.pitch[k]
    return row_of_screw(z, angle_row(model, A, m, k, TURN * z.value / pitch), pitch)


@inner
def joint_row(model: Model, A: Array, m: JointMotion, k: int, kind: int) -> Row:
    """Return a row of joint k; kind indexes `arrays.ROWS`.

    Parameters
    ----------
    model, A, m, k, kind
        As in `basic_row`.
    """
    if kind == 13:
        return screw_row(model, A, m, k)
    return basic_row(model, A, m, k, kind)


@fused
def coordinate(model: Model, y: Array, A: Array, n: int, near: float) -> CoordinateRow:
    """Return joint coordinate n of `Model.coordinate`; angles within half a turn of `near`, of a screw by its Z.

    Parameters
    ----------
    model : Model
    y : ndarray, shape (n_b + n_e, 13)
    A : ndarray, shape (n_b, 3, 3)
    n : int
    near : float, rad
    """
    k = model.coordinate[n].joint
    m = joint_motion(model, y, A, k)
    if model.coordinate[n].kind == DISTANCE:
        row = basic_row(model, A, m, k, _Z)
        # the velocities of the centres of mass enter only through those of the frames' origins
        rate = dot(row.e, m.d_dot) + dot(cross(m.w_i, row.e), m.d)
        return CoordinateRow(row.value, rate, row, m.i, m.j)
    if model.pitch[k] != 0.0:
        near = TURN * basic_row(model, A, m, k, _Z).value / model.pitch[k]
    row = angle_row(model, A, m, k, near)
    return CoordinateRow(row.value, dot(row.c_i, m.w_i) + dot(row.c_j, m.w_j), row, m.i, m.j)


@inner
def place(Q: Array, index: int, A: Array, i: int, j: int, factor: float, row: Row) -> None:
    """Add `factor` times the coefficients of a row to row `index` of Q, columns of bodies i and j.

    Parameters
    ----------
    Q : ndarray, shape (q, 6 n_b)
    index : int
    A : ndarray, shape (n_b, 3, 3)
    i, j : int
        Predecessor and successor.
    factor : float
    row : Row
    """
    add_coefficients(Q, index, A, i, -factor, row.e, scale(-1.0, row.c_i))
    add_coefficients(Q, index, A, j, factor, row.e, row.c_j)
