"""Bodies from the state of the tree joints: poses, velocities, free directions and what is quadratic in velocities.

From the parent outward, with P the origin of M, s_i and s_j the arms to it from the centres of mass of predecessor i
and successor j, e the free axes in the world and u their speeds,

    v_j + w_j x s_j = v_i + w_i x s_i + sum_along e u,     w_j = w_i + sum_about e u,

solved for the body that the tree leads to; where that is the predecessor, the sums change sign.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from consilience.reference.bodies import ZERO, arm
from consilience.reference.relative.model import (
    ABOUT,
    ALONG,
    ARM,
    ARM_PARENT,
    AXES,
    AXES_PARENT,
    BODY,
    COORDINATE,
    FORWARD,
    FREE,
    FREE_END,
    PARENT_BODY,
)
from consilience.reference.vectors import Vector, add, cross, dot, load, rotate, rotate_back, scale, store, sub
from consilience.spatial import Array

Matrix = tuple[Vector, Vector, Vector]
"""A 3 x 3 matrix by columns."""


@njit(cache=True, error_model="numpy", inline="always")
def _combine(X: Matrix, a: Vector) -> Vector:
    """``X a``."""
    return add(add(scale(a[0], X[0]), scale(a[1], X[1])), scale(a[2], X[2]))


@njit(cache=True, error_model="numpy")
def _turned(z: Array, at: int, about: int) -> Matrix:
    """Columns of the rotation from M to F at the coordinates of a joint."""
    if about == 0:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    if about < 3:
        c, s = np.cos(z[at]), np.sin(z[at])
        if about == 1:
            return (c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)
        c2, s2 = np.cos(z[at + 1]), np.sin(z[at + 1])
        return (c, s, 0.0), (-s * c2, c * c2, s2), (s * s2, -c * s2, c2)
    e0, e1, e2, e3 = z[at], z[at + 1], z[at + 2], z[at + 3]
    n = 1.0 / (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    return (
        (n * (e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3), n * 2 * (e1 * e2 + e0 * e3), n * 2 * (e1 * e3 - e0 * e2)),
        (n * 2 * (e1 * e2 - e0 * e3), n * (e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3), n * 2 * (e2 * e3 + e0 * e1)),
        (n * 2 * (e1 * e3 + e0 * e2), n * 2 * (e2 * e3 - e0 * e1), n * (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3)),
    )


@njit(cache=True, error_model="numpy", inline="always")
def _world_axes(A: Array, body: int, real: Array, at: int) -> Matrix:
    """Columns of a joint frame fixed to a body (-1: the ground), in the world."""
    x = real[at], real[at + 3], real[at + 6]
    y = real[at + 1], real[at + 4], real[at + 7]
    z = real[at + 2], real[at + 5], real[at + 8]
    if body < 0:
        return x, y, z
    return rotate(A[body], x), rotate(A[body], y), rotate(A[body], z)


@njit(cache=True, error_model="numpy", inline="always")
def _transposed(X: Matrix) -> Matrix:
    return (X[0][0], X[1][0], X[2][0]), (X[0][1], X[1][1], X[2][1]), (X[0][2], X[1][2], X[2][2])


@njit(cache=True, error_model="numpy")
def _place(index: Array, real: Array, z: Array, y: Array, A: Array, along: Vector) -> tuple[Matrix, Matrix, Vector]:
    """Place the body of a link; the axes of F and M in the world, and P."""
    parent, body = index[PARENT_BODY], index[BODY]
    turned = _turned(z, index[COORDINATE] + index[ALONG], index[ABOUT])
    near = _world_axes(A, parent, real, AXES_PARENT)
    if index[FORWARD] == 0:
        turned = _transposed(turned)
    far = _combine(near, turned[0]), _combine(near, turned[1]), _combine(near, turned[2])
    R = A[body]
    for r in range(3):
        for c in range(3):
            at = AXES + 3 * c
            R[r, c] = far[0][r] * real[at] + far[1][r] * real[at + 1] + far[2][r] * real[at + 2]
    P = arm(A, parent, load(real[ARM_PARENT:]))
    if parent >= 0:
        P = add(P, load(y[parent, 0:3]))
    out = rotate(R, load(real[ARM:]))
    if index[FORWARD] == 1:
        P = add(P, _combine(near, along))
        store(y[body, 0:3], sub(P, out), 1.0)
        return near, far, P
    # M is on the parent: P is its origin, and F's is behind it by the displacement
    store(y[body, 0:3], sub(sub(P, _combine(far, along)), out), 1.0)
    return far, near, P


@njit(cache=True, error_model="numpy")
def _move(
    index: Array,
    direction: Array,
    speeds: Array,
    frames: tuple[Matrix, Matrix, Vector],
    y: Array,
    A: Array,
    S: Array,
    c: Array,
    d: Array,
) -> None:
    """Velocities, S, c and d of a link that is placed; `speeds` are those of all free directions."""
    F, M, P = frames
    parent, body = index[PARENT_BODY], index[BODY]
    sign = 1.0 if index[FORWARD] == 1 else -1.0
    r_p, v_p, w_p = ZERO, ZERO, ZERO
    if parent >= 0:
        r_p, v_p, w_p = load(y[parent, 0:3]), load(y[parent, 7:10]), rotate(A[parent], load(y[parent, 10:13]))
    r = load(y[body, 0:3])
    s, s_p = sub(P, r), sub(P, r_p)
    speed, spin, linear, angular = ZERO, ZERO, ZERO, ZERO
    for n in range(index[FREE], index[FREE_END]):
        e = F[direction[n, 1]] if direction[n, 0] == 0 else M[direction[n, 1]]
        u = sign * speeds[n]
        if direction[n, 2] == 1:
            spin = add(spin, scale(u, e))
            store(S[n, 0:3], cross(s, e), sign)
            store(S[n, 3:6], e, sign)
        else:
            speed = add(speed, scale(u, e))
            store(S[n, 0:3], e, sign)
            store(S[n, 3:6], ZERO, 1.0)
    w = add(w_p, spin)
    v = sub(add(add(v_p, cross(w_p, s_p)), speed), cross(w, s))
    # F moves with the predecessor, M with the successor
    w_F, w_M = (w_p, w) if index[FORWARD] == 1 else (w, w_p)
    for n in range(index[FREE], index[FREE_END]):
        e = F[direction[n, 1]] if direction[n, 0] == 0 else M[direction[n, 1]]
        e_dot = cross(w_F if direction[n, 0] == 0 else w_M, e)
        u = sign * speeds[n]
        if direction[n, 2] == 1:
            angular = add(angular, scale(u, e_dot))
        else:
            linear = add(linear, scale(2.0 * u, e_dot))
    linear = add(linear, sub(cross(w_p, cross(w_p, s_p)), cross(w, cross(w, s))))
    store(y[body, 7:10], v, 1.0)
    store(y[body, 10:13], rotate_back(A[body], w), 1.0)
    store(c[0:3], add(linear, cross(s, angular)), 1.0)
    store(c[3:6], angular, 1.0)
    store(d, sub(r, r_p), 1.0)


@njit(cache=True, error_model="numpy")
def place_bodies(
    index: Array,
    real: Array,
    direction: Array,
    first_speed: int,
    z: Array,
    y: Array,
    A: Array,
    S: Array,
    c: Array,
    d: Array,
) -> None:
    """Fill y (but for the Euler parameters), A, S, c and d of all links at a state z."""
    speeds = z[first_speed:]
    for k in range(index.shape[0]):
        link = index[k]
        along = ZERO
        for n in range(link[ALONG]):
            axis, q = direction[link[FREE] + n, 1], z[link[COORDINATE] + n]
            along = add(along, (q if axis == 0 else 0.0, q if axis == 1 else 0.0, q if axis == 2 else 0.0))
        frames = _place(link, real[k], z, y, A, along)
        _move(link, direction, speeds, frames, y, A, S, c[k], d[k])


@njit(cache=True, error_model="numpy")
def coordinate_rates(index: Array, first_speed: int, z: Array, dz: Array) -> None:
    """Rates of the coordinates; of Euler parameters, ``p' = 1/2 (0, w) p`` with w in axes of F."""
    for k in range(index.shape[0]):
        along, about = index[k, ALONG], index[k, ABOUT]
        at, n = index[k, COORDINATE], first_speed + index[k, FREE]
        for m in range(along):
            dz[at + m] = z[n + m]
        at, n = at + along, n + along
        if about < 3:
            for m in range(about):
                dz[at + m] = z[n + m]
        else:
            e0, e1, e2, e3 = z[at], z[at + 1], z[at + 2], z[at + 3]
            w1, w2, w3 = z[n], z[n + 1], z[n + 2]
            dz[at] = -0.5 * (w1 * e1 + w2 * e2 + w3 * e3)
            dz[at + 1] = 0.5 * (w1 * e0 + w2 * e3 - w3 * e2)
            dz[at + 2] = 0.5 * (w2 * e0 + w3 * e1 - w1 * e3)
            dz[at + 3] = 0.5 * (w3 * e0 + w1 * e2 - w2 * e1)


@njit(cache=True, error_model="numpy")
def displace(index: Array, z: Array, u: Array) -> None:
    """Move the coordinates by small displacements along the free directions; Euler parameters stay unit."""
    for k in range(index.shape[0]):
        along, about = index[k, ALONG], index[k, ABOUT]
        at, n = index[k, COORDINATE], index[k, FREE]
        for m in range(along):
            z[at + m] += u[n + m]
        at, n = at + along, n + along
        if about < 3:
            for m in range(about):
                z[at + m] += u[n + m]
        else:
            e0, e1, e2, e3 = z[at], z[at + 1], z[at + 2], z[at + 3]
            h1, h2, h3 = 0.5 * u[n], 0.5 * u[n + 1], 0.5 * u[n + 2]
            z[at] = e0 - h1 * e1 - h2 * e2 - h3 * e3
            z[at + 1] = e1 + h1 * e0 + h2 * e3 - h3 * e2
            z[at + 2] = e2 + h2 * e0 + h3 * e1 - h1 * e3
            z[at + 3] = e3 + h3 * e0 + h1 * e2 - h2 * e1
    normalise(index, z)


@njit(cache=True, error_model="numpy")
def normalise(index: Array, z: Array) -> None:
    """Divide the Euler parameters of all balls by their norm."""
    for k in range(index.shape[0]):
        if index[k, ABOUT] == 3:
            at = index[k, COORDINATE] + index[k, ALONG]
            norm = np.sqrt(z[at] ** 2 + z[at + 1] ** 2 + z[at + 2] ** 2 + z[at + 3] ** 2)
            z[at : at + 4] /= norm


@njit(cache=True, error_model="numpy")
def orient(A: Array, y: Array) -> None:
    """Euler parameters of all bodies from their rotation matrices, into y: the largest one as pivot [Shepperd 1978]."""
    for b in range(A.shape[0]):
        R = A[b]
        trace = R[0, 0] + R[1, 1] + R[2, 2]
        p = (1.0 + trace, 1.0 + 2.0 * R[0, 0] - trace, 1.0 + 2.0 * R[1, 1] - trace, 1.0 + 2.0 * R[2, 2] - trace)
        x, yy, zz = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
        xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
        largest = max(p)
        if p[0] == largest:
            e = (p[0], x, yy, zz)
        elif p[1] == largest:
            e = (x, p[1], xy, xz)
        elif p[2] == largest:
            e = (yy, xy, p[2], yz)
        else:
            e = (zz, xz, yz, p[3])
        norm = np.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2 + e[3] ** 2)
        for n in range(4):
            y[b, 3 + n] = e[n] / norm


@njit(cache=True, error_model="numpy", inline="always")
def project_on(S: Array, w: Array) -> float:
    """Scalar product of a direction and a wrench."""
    return dot(load(S[0:3]), load(w[0:3])) + dot(load(S[3:6]), load(w[3:6]))
