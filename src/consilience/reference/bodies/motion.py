"""Poses and velocities of single bodies out of the state y, compiled. Body -1 is the ground."""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.vectors import Vector, accumulate, load, rotate, rotate_back, scale

ZERO = (0.0, 0.0, 0.0)


@kernel
def rotations(y: Array, A: Array) -> None:
    """Rotation matrices of all bodies from their Euler parameters [MASS (2)], shape (n_b, 3, 3).

    The parameters are divided by their norm, which the stages of an integrator leave off one by their local error.
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


@inner
def arm(A: Array, body: int, s: Vector) -> Vector:
    """World components of a vector fixed to a body (-1: the ground)."""
    return rotate(A[body], s) if body >= 0 else s


@inner
def motion(y: Array, A: Array, body: int) -> tuple[Vector, Vector, Vector]:
    """Position and velocity of the centre of mass, and angular velocity in world axes; zero for the ground."""
    if body < 0:
        return ZERO, ZERO, ZERO
    return load(y[body, 0:3]), load(y[body, 7:10]), rotate(A[body], load(y[body, 10:13]))


@inner
def add_coefficients(Q: Array, row: int, A: Array, body: int, factor: float, on_v: Vector, on_w: Vector) -> None:
    """Add to a row the coefficients of v (centre of mass) and w (world, turned here into body axes) of one body."""
    if body >= 0:
        accumulate(Q[row, 6 * body : 6 * body + 3], scale(factor, on_v))
        accumulate(Q[row, 6 * body + 3 : 6 * body + 6], scale(factor, rotate_back(A[body], on_w)))
