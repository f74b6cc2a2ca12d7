"""Poses, velocities and state rates of bodies from the packed state y, compiled. Body -1 is the ground."""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import Vector, accumulate, load, rotate, rotate_back, scale

ZERO = (0.0, 0.0, 0.0)


@kernel
def rotations(y: Array, A: Array) -> None:
    """Compute the rotation matrices of all bodies, shape (n_b, 3, 3), from normalised Euler parameters [MASS (2)].

    In the stages of an integrator the norm of the parameters differs from one by the local error.
    """
    for b in range(A.shape[0]):
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


@fused
def arm(A: Array, body: int, s: Vector) -> Vector:
    """Return the world components of a vector given in axes of a body."""
    return rotate(A[body], s) if body >= 0 else s


@fused
def motion(y: Array, A: Array, body: int) -> tuple[Vector, Vector, Vector]:
    """Return position and velocity of the centre of mass, and the angular velocity, world axes; zero for the ground."""
    if body < 0:
        return ZERO, ZERO, ZERO
    return load(y[body, 0:3]), load(y[body, 7:10]), rotate(A[body], load(y[body, 10:13]))


@inner
def add_coefficients(Q: Array, row: int, A: Array, body: int, factor: float, on_v: Vector, on_w: Vector) -> None:
    """Add coefficients of one body to a row of Q.

    Parameters
    ----------
    Q : ndarray, shape (q, 6 n_b)
    row, body : int
    A : ndarray, shape (n_b, 3, 3)
    factor : float
        Of both coefficients.
    on_v, on_w : Vector
        Coefficients of v (centre of mass) and of the angular velocity w, world axes; stored for w' in body axes.
    """
    if body >= 0:
        accumulate(Q[row, 6 * body : 6 * body + 3], scale(factor, on_v))
        accumulate(Q[row, 6 * body + 3 : 6 * body + 6], scale(factor, rotate_back(A[body], on_w)))


@inner
def state_rates(y: Array, a: Array, dy: Array) -> None:
    """Write ``r' = v``, ``p' = 1/2 G^T w'`` [MASS (38)] and the accelerations a, shape (6 n_b,), into dy."""
    for b in range(a.shape[0] // 6):
        e0, e1, e2, e3 = y[b, 3], y[b, 4], y[b, 5], y[b, 6]
        w1, w2, w3 = y[b, 10], y[b, 11], y[b, 12]
        for k in range(3):
            dy[b, k] = y[b, 7 + k]
        dy[b, 3] = -0.5 * (e1 * w1 + e2 * w2 + e3 * w3)
        dy[b, 4] = 0.5 * (e0 * w1 + e2 * w3 - e3 * w2)
        dy[b, 5] = 0.5 * (e0 * w2 + e3 * w1 - e1 * w3)
        dy[b, 6] = 0.5 * (e0 * w3 + e1 * w2 - e2 * w1)
        for k in range(6):
            dy[b, 7 + k] = a[6 * b + k]
