"""Rows of an assembly, compiled: those of the mechanism, about body origins, and those of held joint coordinates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.joint_rows import FrameMotion, frame_motion, full_turns
from consilience.reference.bodies.motion import arm, rotations
from consilience.reference.kernel.compiled import inner
from consilience.reference.kernel.least_squares import LeastSquares
from consilience.reference.kernel.record_type import INT, record_type
from consilience.reference.kernel.vectors import Vector, add, column, cross, load, rotate, scale, store
from consilience.reference.tree.kinematics import euler_parameters

HELD = record_type(("joint", INT), ("kind", INT), ("value", float, 4))
"""Held joint coordinate, or its rate."""

_X, _Y, _Z, POSITION, _ANGLE, _SECOND_ANGLE, ORIENTATION = range(7)
HELD_KINDS = {
    "x": _X,
    "y": _Y,
    "distance": _Z,
    "position": POSITION,
    "angle": _ANGLE,
    "angle1": _ANGLE,
    "angle2": _SECOND_ANGLE,
    "orientation": ORIENTATION,
}
"""Kinds of held coordinates; those with three rows are position and orientation."""


class AssemblyArrays(NamedTuple):
    """Arrays of the assembly of n_b bodies with q rows and h rows of held coordinates."""

    model: Model
    ws: Workspace
    com: Array  # (n_b, 3) centres of mass, m
    length: float  # characteristic length, m
    size: Array  # (q + h,) size of a row: the characteristic length, or one
    holonomic: int  # number of rows at position level
    turns: Array  # (n_c,)
    y: Array  # (n_b + n_e, 13) bodies at their centres of mass
    pose: Array  # (n_b, 7) origins and quaternions
    kept: Array  # (n_b, 7) pose of the least residual
    J: Array  # (q + h, 6 n_b) scaled rows
    right: Array  # (q + h,) residual, scaled
    step: Array  # (6 n_b,) in units of their sizes
    v: Array  # (6 n_b,) velocities of the origins, in units of their sizes
    by: LeastSquares


@inner
def place_bodies(a: AssemblyArrays) -> None:
    """Place the centres of mass at the poses."""
    for b in range(a.pose.shape[0]):
        for k in range(4):
            a.y[b, 3 + k] = a.pose[b, 3 + k]
    rotations(a.y, a.ws.A)
    for b in range(a.pose.shape[0]):
        store(a.y[b, 0:3], add(load(a.pose[b, 0:3]), rotate(a.ws.A[b], load(a.com[b]))), 1.0)


@inner
def _write_row(a: AssemblyArrays, row: int, body: int, sign: float, on_v: Vector, on_w: Vector) -> None:
    """Add coefficients of the velocity of the centre of mass and of the angular velocity, world axes, to row of J."""
    if body >= 0:
        c = rotate(a.ws.A[body], load(a.com[body]))
        on_w = add(on_w, cross(c, on_v))
        for k in range(3):
            a.J[row, 6 * body + k] += sign * a.length * on_v[k] / a.size[row]
            a.J[row, 6 * body + 3 + k] += sign * on_w[k] / a.size[row]


@inner
def write_rows(a: AssemblyArrays, count: int) -> None:
    """Write the first `count` rows of the mechanism, scaled, from those of the centres of mass in body axes."""
    a.J[:, :] = 0.0
    for row in range(count):
        for b in range(a.pose.shape[0]):
            Q = a.ws.Q[row, 6 * b : 6 * b + 6]
            _write_row(a, row, b, 1.0, load(Q), rotate(a.ws.A[b], load(Q[3:])))


@inner
def _hold(a: AssemblyArrays, row: int, joint: int, u: Vector, along: bool) -> None:
    """Write a row that holds the displacement along an axis u of F, or the angle about it, world axes."""
    model, A = a.model, a.ws.A
    i, j = model.body_i[joint], model.body_j[joint]
    zero = (0.0, 0.0, 0.0)
    if not along:
        _write_row(a, row, i, -1.0, zero, u)
        _write_row(a, row, j, 1.0, zero, u)
        return
    s_j = arm(A, j, load(model.arm_j[joint]))
    end = add(load(a.y[j, 0:3]), s_j) if j >= 0 else s_j
    s_i = add(end, scale(-1.0, load(a.y[i, 0:3]))) if i >= 0 else end
    _write_row(a, row, i, -1.0, u, cross(s_i, u))
    _write_row(a, row, j, 1.0, u, cross(s_j, u))


@inner
def write_held(a: AssemblyArrays, held: Array, n: int, row: int) -> int:
    """Write the rows of held coordinate n; return the index of the next row."""
    joint, kind = held[n].joint, held[n].kind
    F, M = a.model.axes_i[joint], a.model.axes_j[joint]
    i, j, A = a.model.body_i[joint], a.model.body_j[joint], a.ws.A
    if kind in (POSITION, ORIENTATION):
        for axis in range(3):
            _hold(a, row + axis, joint, arm(A, i, column(F, axis)), kind == POSITION)
        return row + 3
    if kind == _SECOND_ANGLE:
        _hold(a, row, joint, arm(A, j, column(M, 0)), False)
    elif kind == _ANGLE:
        _hold(a, row, joint, arm(A, i, column(F, 2)), False)
    else:
        _hold(a, row, joint, arm(A, i, column(F, kind)), True)
    return row + 1


@inner
def _turn_between(X: tuple[Vector, Vector, Vector], held: Array) -> Vector:
    """Return the rotation vector, in axes of F, from a held orientation of M (a quaternion) to the one with axes X.

    ``R R_held^T = exp(phi)``, of which the quaternion is read as in `euler_parameters`.
    """
    e0, e1, e2, e3 = held[0], held[1], held[2], held[3]
    H = (
        (e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3, 2.0 * (e1 * e2 + e0 * e3), 2.0 * (e1 * e3 - e0 * e2)),
        (2.0 * (e1 * e2 - e0 * e3), e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3, 2.0 * (e2 * e3 + e0 * e1)),
        (2.0 * (e1 * e3 + e0 * e2), 2.0 * (e2 * e3 - e0 * e1), e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3),
    )
    # column k of R R_held^T is sum_l X_l (H_l)_k
    C0 = add(add(scale(H[0][0], X[0]), scale(H[1][0], X[1])), scale(H[2][0], X[2]))
    C1 = add(add(scale(H[0][1], X[0]), scale(H[1][1], X[1])), scale(H[2][1], X[2]))
    C2 = add(add(scale(H[0][2], X[0]), scale(H[1][2], X[1])), scale(H[2][2], X[2]))
    e = euler_parameters((C0, C1, C2))
    sign = 1.0 if e[0] >= 0.0 else -1.0
    s = np.sqrt(e[1] * e[1] + e[2] * e[2] + e[3] * e[3])
    factor = sign * (2.0 * np.arctan2(s, sign * e[0]) / s if s > 0.0 else 2.0)
    return factor * e[1], factor * e[2], factor * e[3]


@inner
def _held_errors(a: AssemblyArrays, held: Array, n: int, row: int) -> int:
    """Write the errors of held coordinate n to ``right``; return the index of the next row."""
    joint, kind, value = held[n].joint, held[n].kind, held[n].value
    motion: FrameMotion = frame_motion(a.model, a.y, a.ws.A, joint)
    p, X = motion[0], motion[1]
    if kind == POSITION:
        for axis in range(3):
            a.right[row + axis] = (p[axis] - value[axis]) / a.size[row + axis]
        return row + 3
    if kind == ORIENTATION:
        phi = _turn_between(X, value)
        for axis in range(3):
            a.right[row + axis] = phi[axis]
        return row + 3
    if kind == _ANGLE and a.model.pitch[joint] != 0.0:
        turn = 2.0 * np.pi * p[2] / a.model.pitch[joint]
        a.right[row] = full_turns(np.arctan2(X[0][1], X[0][0]), turn) - value[0]
    elif kind == _ANGLE:
        a.right[row] = full_turns(np.arctan2(X[0][1], X[0][0]) - value[0], 0.0)
    elif kind == _SECOND_ANGLE:
        a.right[row] = full_turns(np.arctan2(X[1][2], X[2][2]) - value[0], 0.0)
    else:
        a.right[row] = (p[kind] - value[0]) / a.size[row]
    return row + 1


@inner
def evaluate(a: AssemblyArrays, held: Array, t: float) -> float:
    """Evaluate residuals and rows at the poses; return the largest residual."""
    place_bodies(a)
    constraints.evaluate(a.model, t, a.y, a.turns, a.ws)
    write_rows(a, a.holonomic)
    row, largest = a.holonomic, 0.0
    for n in range(a.holonomic):
        a.right[n] = a.ws.value[n] / a.size[n]
    for n in range(held.shape[0]):
        _held_errors(a, held, n, row)
        row = write_held(a, held, n, row)
    for n in range(row):
        largest = max(largest, abs(a.right[n])) if np.isfinite(a.right[n]) else np.inf
    return largest
