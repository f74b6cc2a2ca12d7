"""Articulated bodies, one free direction eliminated after the other [Featherstone 2008, table 7.1].

From the tips to the ground, for the directions of a link last to first,

    U = I^A s,   D = s . U,   r = -s . p^A,   I^A <- I^A - U U^T / D,   p^A <- p^A + U r / D,

which for a joint of several directions is the block elimination of the table, and then, with c of the whole joint and
X = [1 -~d; 0 1] to the parent, ``I^A_p += X^T I^A X``, ``p^A_p += X^T (p^A + I^A c)``. Outward again,

    a' = X a_p + c,   u = (r - U . a') / D,   a' <- a' + s u.

Wrenches and accelerations are (linear, angular) in world axes at centres of mass. ``r / sqrt(D)`` are whitened forces.
"""

from __future__ import annotations

from numba import njit

from consilience.reference.relative.kinematics import project_on
from consilience.reference.relative.model import BODY, FREE, FREE_END, INERTIA, MASS, PARENT
from consilience.reference.vectors import accumulate, add, cross, dot, load, rotate, store
from consilience.spatial import Array


@njit(cache=True, error_model="numpy")
def inertias(index: Array, real: Array, A: Array, inertia: Array) -> None:
    """``diag(m 1, A I A^T)`` of all links."""
    for k in range(index.shape[0]):
        R, given, out = A[index[k, BODY]], real[k, INERTIA:], inertia[k]
        out[:, :] = 0.0
        for n in range(3):
            out[n, n] = real[k, MASS]
        for r in range(3):
            a = load(R[r])
            t = (
                given[0] * a[0] + given[1] * a[1] + given[2] * a[2],
                given[3] * a[0] + given[4] * a[1] + given[5] * a[2],
                given[6] * a[0] + given[7] * a[1] + given[8] * a[2],
            )
            for c in range(r + 1):
                value = dot(t, load(R[c]))
                out[3 + r, 3 + c] = value
                out[3 + c, 3 + r] = value


@njit(cache=True, error_model="numpy")
def free_biases(index: Array, real: Array, gravity: Array, y: Array, A: Array, inertia: Array, bias: Array) -> None:
    """Biases of gravity and gyroscopic torques alone, ``-(m g, -w x I w)``, from inertias of single bodies."""
    g = load(gravity)
    for k in range(index.shape[0]):
        b = index[k, BODY]
        w = rotate(A[b], load(y[b, 10:13]))
        store(bias[k, 0:3], g, -real[k, MASS])
        store(bias[k, 3:6], cross(w, rotate(inertia[k, 3:6, 3:6], w)), 1.0)


@njit(cache=True, error_model="numpy")
def push_wrenches(index: Array, f: Array, A: Array, bias: Array) -> None:
    """Biases of the links from generalised forces (world, body axes) of the bodies."""
    for k in range(index.shape[0]):
        b = index[k, BODY]
        store(bias[k, 0:3], load(f[6 * b : 6 * b + 3]), -1.0)
        store(bias[k, 3:6], rotate(A[b], load(f[6 * b + 3 : 6 * b + 6])), -1.0)


@njit(cache=True, error_model="numpy")
def _hand_on(I: Array, d: Array, parent: Array) -> None:
    """``I_p += X^T I X`` for I = [M H; H^T J]: M, H - M ~d, J - H^T ~d + ~d (H - M ~d)."""
    d0, d1, d2 = d[0], d[1], d[2]
    for r in range(3):
        m0, m1, m2 = I[r, 0], I[r, 1], I[r, 2]
        h0 = I[r, 3] - (m1 * d2 - m2 * d1)
        h1 = I[r, 4] - (m2 * d0 - m0 * d2)
        h2 = I[r, 5] - (m0 * d1 - m1 * d0)
        parent[r, 0] += m0
        parent[r, 1] += m1
        parent[r, 2] += m2
        parent[r, 3] += h0
        parent[r, 4] += h1
        parent[r, 5] += h2
        parent[3, r] += h0
        parent[4, r] += h1
        parent[5, r] += h2
    for c in range(3):
        # columns of H - M ~d, that of H^T ~d by its rows
        h = (
            I[0, 3 + c] - _column(I[0], d, c),
            I[1, 3 + c] - _column(I[1], d, c),
            I[2, 3 + c] - _column(I[2], d, c),
        )
        parent[3, 3 + c] += I[3, 3 + c] - _column(I[3], d, c) + d1 * h[2] - d2 * h[1]
        parent[4, 3 + c] += I[4, 3 + c] - _column(I[4], d, c) + d2 * h[0] - d0 * h[2]
        parent[5, 3 + c] += I[5, 3 + c] - _column(I[5], d, c) + d0 * h[1] - d1 * h[0]


@njit(cache=True, error_model="numpy", inline="always")
def _column(row: Array, d: Array, c: int) -> float:
    """Component c of ``row[:3] ~d``."""
    one, two = (c + 1) % 3, (c + 2) % 3
    return row[one] * d[two] - row[two] * d[one]


@njit(cache=True, error_model="numpy")
def articulate(index: Array, S: Array, d: Array, inertia: Array, U: Array, D: Array) -> None:
    """Articulated inertias, U and D: what does not depend on forces or velocities."""
    for k in range(index.shape[0] - 1, -1, -1):
        I = inertia[k]
        for n in range(index[k, FREE_END] - 1, index[k, FREE] - 1, -1):
            pivot = 0.0
            for r in range(6):
                total = 0.0
                for s in range(6):
                    total += I[r, s] * S[n, s]
                U[n, r] = total
                pivot += S[n, r] * total
            D[n] = pivot
            for r in range(6):
                factor = U[n, r] / pivot
                for s in range(6):
                    I[r, s] -= factor * U[n, s]
        if index[k, PARENT] >= 0:
            _hand_on(I, d[k], inertia[index[k, PARENT]])


@njit(cache=True, error_model="numpy")
def sweep_in(
    index: Array, S: Array, c: Array, d: Array, inertia: Array, bias: Array, U: Array, D: Array, rest: Array
) -> None:
    """Remaining joint forces, into `rest`, of the biases, which are overwritten."""
    for k in range(index.shape[0] - 1, -1, -1):
        own, p = bias[k], index[k, PARENT]
        for n in range(index[k, FREE_END] - 1, index[k, FREE] - 1, -1):
            rest[n] = -project_on(S[n], own)
            factor = rest[n] / D[n]
            for r in range(6):
                own[r] += factor * U[n, r]
        if p >= 0:
            I = inertia[k]
            for r in range(6):
                total = 0.0
                for s in range(6):
                    total += I[r, s] * c[k, s]
                own[r] += total
            _hand_wrench_on(own, d[k], bias[p])


@njit(cache=True, error_model="numpy", inline="always")
def _hand_wrench_on(wrench: Array, d: Array, parent: Array) -> None:
    """``X^T w``."""
    force = load(wrench[0:3])
    accumulate(parent[0:3], force)
    accumulate(parent[3:6], add(load(wrench[3:6]), cross(load(d), force)))


@njit(cache=True, error_model="numpy")
def sweep_out(
    index: Array,
    S: Array,
    c: Array,
    d: Array,
    U: Array,
    D: Array,
    force: Array,
    extra: Array,
    acc: Array,
    u: Array,
    moving: float,
) -> None:
    """Accelerations of the links and of the directions, of joint forces ``force + extra``; moving: 1, at rest: 0."""
    for k in range(index.shape[0]):
        p, a = index[k, PARENT], acc[k]
        for r in range(6):
            a[r] = moving * c[k, r]
        if p >= 0:
            turn = cross(load(acc[p, 3:6]), load(d[k]))
            accumulate(a[0:3], add(load(acc[p, 0:3]), turn))
            accumulate(a[3:6], load(acc[p, 3:6]))
        for n in range(index[k, FREE], index[k, FREE_END]):
            u[n] = (force[n] + extra[n] - project_on(U[n], a)) / D[n]
            for r in range(6):
                a[r] += u[n] * S[n, r]
