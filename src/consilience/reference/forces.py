"""Applied and gyroscopic forces, compiled [MASS (30)-(36)].

The generalised force of a body goes with the velocities (v, w'): force at the centre of mass in world axes, torque
about it in body axes, the latter with the gyroscopic term ``-w' x I' w'``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from consilience.reference.constraints import arm, motion
from consilience.reference.model import Model
from consilience.reference.vectors import (
    Vector,
    accumulate,
    add,
    column,
    cross,
    dot,
    load,
    rotate,
    rotate_back,
    scale,
    sub,
)
from consilience.spatial import Array


@njit(cache=True, error_model="numpy")
def _push(f: Array, A: Array, body: int, force: Vector, s: Vector, torque: Vector) -> None:
    """Add a force at the arm s from the centre of mass, and a torque, all in world axes; the ground takes anything."""
    if body >= 0:
        accumulate(f[6 * body : 6 * body + 3], force)
        accumulate(f[6 * body + 3 : 6 * body + 6], rotate_back(A[body], add(torque, cross(s, force))))


@njit(cache=True, error_model="numpy")
def joint_spring_motion(model: Model, y: Array, A: Array, n: int) -> tuple[float, float, Vector]:
    """Coordinate (angle in (-pi, pi]), its rate, and the axis (world) of a sprung joint."""
    k = model.joint_spring[n, 0]
    i, j = model.body_i[k], model.body_j[k]
    r_i, v_i, w_i = motion(y, A, i)
    r_j, v_j, w_j = motion(y, A, j)
    axis = arm(A, i, column(model.axes_i[k], 2))
    if model.joint_spring[n, 1] == 1:
        s_i, s_j = arm(A, i, load(model.arm_i[k])), arm(A, j, load(model.arm_j[k]))
        d = sub(add(r_j, s_j), add(r_i, s_i))
        d_dot = sub(add(v_j, cross(w_j, s_j)), add(v_i, cross(w_i, s_i)))
        return dot(axis, d), dot(axis, d_dot) + dot(cross(w_i, axis), d), axis
    u1, u2 = arm(A, i, column(model.axes_i[k], 0)), arm(A, i, column(model.axes_i[k], 1))
    x = arm(A, j, column(model.axes_j[k], 0))
    return np.arctan2(dot(u2, x), dot(u1, x)), dot(axis, sub(w_j, w_i)), axis


@njit(cache=True, error_model="numpy")
def full_turns(angle: float, near: float) -> float:
    """The angle plus the full turns that bring it nearest to `near`."""
    return angle + 2.0 * np.pi * np.round((near - angle) / (2.0 * np.pi))


@njit(cache=True, error_model="numpy")
def _joint_springs(model: Model, y: Array, A: Array, memory: Array, f: Array) -> None:
    """Add ``-(k (q - q0) + c q')`` about or along the axis on the successor, the opposite on the predecessor."""
    for n in range(model.joint_spring.shape[0]):
        k = model.joint_spring[n, 0]
        i, j = model.body_i[k], model.body_j[k]
        q, rate, axis = joint_spring_motion(model, y, A, n)
        if model.joint_spring[n, 1] == 0:
            q = full_turns(q, memory[n])
        stiffness, damping, rest = load(model.joint_spring_law[n])
        effort = scale(-(stiffness * (q - rest) + damping * rate), axis)
        opposite = scale(-1.0, effort)
        zero = (0.0, 0.0, 0.0)
        if model.joint_spring[n, 1] == 0:
            _push(f, A, j, zero, zero, effort)
            _push(f, A, i, zero, zero, opposite)
        else:
            s_j = arm(A, j, load(model.arm_j[k]))
            point = add(motion(y, A, j)[0], s_j)
            _push(f, A, j, effort, s_j, zero)
            _push(f, A, i, opposite, sub(point, motion(y, A, i)[0]), zero)


@njit(cache=True, error_model="numpy")
def _springs(model: Model, y: Array, A: Array, f: Array) -> None:
    """Add ``F = (k (L - L0) + c L') e`` on the predecessor, the opposite on the successor [MASS (31)]."""
    for n in range(model.spring_body.shape[0]):
        i, j = model.spring_body[n, 0], model.spring_body[n, 1]
        s_i, s_j = arm(A, i, load(model.spring_arm[n, 0])), arm(A, j, load(model.spring_arm[n, 1]))
        r_i, v_i, w_i = motion(y, A, i)
        r_j, v_j, w_j = motion(y, A, j)
        d = sub(add(r_j, s_j), add(r_i, s_i))
        L = np.sqrt(dot(d, d))
        e = scale(1.0 / L, d)
        rate = dot(e, sub(add(v_j, cross(w_j, s_j)), add(v_i, cross(w_i, s_i))))
        stiffness, damping, free_length = load(model.spring_law[n])
        force = scale(stiffness * (L - free_length) + damping * rate, e)
        zero = (0.0, 0.0, 0.0)
        _push(f, A, i, force, s_i, zero)
        _push(f, A, j, scale(-1.0, force), s_j, zero)


@njit(cache=True, error_model="numpy")
def evaluate(model: Model, y: Array, A: Array, memory: Array, f: Array) -> None:
    """All applied and gyroscopic forces.

    Parameters
    ----------
    memory : ndarray, shape (n_k,)
        Angle of each joint spring a moment ago: turns are counted from it.
    f : ndarray, shape (6 n_b,)
        Overwritten.
    """
    f[:] = 0.0
    gravity = load(model.gravity)
    zero = (0.0, 0.0, 0.0)
    for b in range(y.shape[0]):
        w = load(y[b, 10:13])
        accumulate(f[6 * b : 6 * b + 3], scale(model.mass[b], gravity))
        accumulate(f[6 * b + 3 : 6 * b + 6], scale(-1.0, cross(w, rotate(model.inertia[b], w))))
    _springs(model, y, A, f)
    _joint_springs(model, y, A, memory, f)
    for n in range(model.load_body.shape[0]):
        b = model.load_body[n]
        vector = load(model.load_vector[n])
        if model.load_kind[n, 1] == 1:
            vector = arm(A, b, vector)
        if model.load_kind[n, 0] == 0:
            _push(f, A, b, vector, arm(A, b, load(model.load_arm[n])), zero)
        else:
            _push(f, A, b, zero, zero, vector)
