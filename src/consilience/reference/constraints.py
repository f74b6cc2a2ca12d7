"""The thirteen basic constraints, compiled: values, Jacobian rows and gamma at the state y [MASS (9)-(29)].

``(X, Y, Z) = U^T d`` (three), ``L = |d|`` (one), ``D_kl = u_k . w_l`` (nine), from the frames of a joint,

    U = A_i A_Ji,  W = A_j A_Jj,  s = A s',  d = r_j + s_j - r_i - s_i.

Jacobian columns of a body are its velocity v of the centre of mass in world axes and its angular velocity w' in
**body** axes, so that the mass matrix they go with, ``diag(m 1, I')``, is constant. A coefficient vector c of w
(world) becomes ``A^T c``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from consilience.reference.model import Model
from consilience.reference.vectors import (
    Vector,
    add,
    column,
    cross,
    dot,
    load,
    rotate,
    rotate_back,
    scale,
    store,
    sub,
)
from consilience.spatial import Array

_ZERO = (0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def rotations(y: Array, A: Array) -> None:
    """Rotation matrices of all bodies from their Euler parameters [MASS (2)], shape (n_b, 3, 3).

    The parameters are divided by their norm, which the stages of an integrator leave off one by their local error.
    """
    for b in range(y.shape[0]):
        e0, e1, e2, e3 = y[b, 3], y[b, 4], y[b, 5], y[b, 6]
        n = 1.0 / (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
        A[b, 0, 0] = n * (e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3)
        A[b, 1, 1] = n * (e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3)
        A[b, 2, 2] = n * (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3)
        A[b, 0, 1] = n * 2.0 * (e1 * e2 - e0 * e3)
        A[b, 1, 0] = n * 2.0 * (e1 * e2 + e0 * e3)
        A[b, 0, 2] = n * 2.0 * (e1 * e3 + e0 * e2)
        A[b, 2, 0] = n * 2.0 * (e1 * e3 - e0 * e2)
        A[b, 1, 2] = n * 2.0 * (e2 * e3 - e0 * e1)
        A[b, 2, 1] = n * 2.0 * (e2 * e3 + e0 * e1)


@njit(cache=True, error_model="numpy")
def arm(A: Array, body: int, s: Vector) -> Vector:
    """World components of a vector fixed to a body (-1: the ground)."""
    return rotate(A[body], s) if body >= 0 else s


@njit(cache=True, error_model="numpy")
def motion(y: Array, A: Array, body: int) -> tuple[Vector, Vector, Vector]:
    """Position and velocity of the centre of mass, and angular velocity in world axes; zero for the ground."""
    if body < 0:
        return _ZERO, _ZERO, _ZERO
    return load(y[body, 0:3]), load(y[body, 7:10]), rotate(A[body], load(y[body, 10:13]))


@njit(cache=True, error_model="numpy")
def _place(Q: Array, row: int, A: Array, body: int, on_v: Vector, on_w: Vector) -> None:
    """Write the coefficients of one body, turned into body axes for w'."""
    if body >= 0:
        store(Q[row, 6 * body : 6 * body + 3], on_v, 1.0)
        store(Q[row, 6 * body + 3 : 6 * body + 6], rotate_back(A[body], on_w), 1.0)


@njit(cache=True, error_model="numpy")
def evaluate(model: Model, y: Array, A: Array, value: Array, Q: Array, gamma: Array) -> None:
    """Values, Jacobian and gamma of all rows.

    Parameters
    ----------
    A : ndarray, shape (n_b, 3, 3)
        Rotation matrices of y, from `rotations`.
    value, gamma : ndarray, shape (q,)
        Overwritten. `value` is the violation g.
    Q : ndarray, shape (q, 6 n_b)
        Overwritten.
    """
    Q[:, :] = 0.0
    for k in range(model.body_i.shape[0]):
        if model.first_row[k] == model.first_row[k + 1]:
            continue
        i, j = model.body_i[k], model.body_j[k]
        s_i, s_j = arm(A, i, load(model.arm_i[k])), arm(A, j, load(model.arm_j[k]))
        r_i, v_i, w_i = motion(y, A, i)
        r_j, v_j, w_j = motion(y, A, j)
        d = sub(add(r_j, s_j), add(r_i, s_i))
        d_dot = sub(add(v_j, cross(w_j, s_j)), add(v_i, cross(w_i, s_i)))
        centripetal = sub(cross(w_j, cross(w_j, s_j)), cross(w_i, cross(w_i, s_i)))
        for row in range(model.first_row[k], model.first_row[k + 1]):
            kind = model.row_kind[row]
            if kind < 3:
                u = arm(A, i, column(model.axes_i[k], kind))
                u_dot = cross(w_i, u)
                value[row] = dot(u, d)
                gamma[row] = -(dot(cross(w_i, u_dot), d) + 2.0 * dot(u_dot, d_dot) + dot(u, centripetal))
                _place(Q, row, A, i, scale(-1.0, u), scale(-1.0, cross(add(s_i, d), u)))
                _place(Q, row, A, j, u, cross(s_j, u))
            elif kind == 3:
                L = np.sqrt(dot(d, d))
                e = scale(1.0 / L, d)
                value[row] = L - model.row_target[row]
                gamma[row] = -((dot(d_dot, d_dot) - dot(e, d_dot) ** 2) / L + dot(e, centripetal))
                _place(Q, row, A, i, scale(-1.0, e), scale(-1.0, cross(s_i, e)))
                _place(Q, row, A, j, e, cross(s_j, e))
            else:
                u = arm(A, i, column(model.axes_i[k], (kind - 4) // 3))
                w = arm(A, j, column(model.axes_j[k], (kind - 4) % 3))
                u_dot, w_dot = cross(w_i, u), cross(w_j, w)
                normal = cross(u, w)
                value[row] = dot(u, w)
                gamma[row] = -(dot(cross(w_i, u_dot), w) + 2.0 * dot(u_dot, w_dot) + dot(u, cross(w_j, w_dot)))
                _place(Q, row, A, i, _ZERO, normal)
                _place(Q, row, A, j, _ZERO, scale(-1.0, normal))
