"""Articulated inertias about the centre of mass of a link, in world axes, as three tuples.

I = [M H; H^T J],   M and J symmetric (xx, xy, xz, yy, yz, zz),   H row by row.

Tuples stay on the stack of a compiled kernel. Transformation rules: Featherstone 2008, chapters 2 and 7.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inner
from consilience.reference.kernel.vectors import Vector, add, dot, load

Six = tuple[float, float, float, float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]
Inertia = tuple[Six, Nine, Six]
Columns = tuple[Vector, Vector, Vector]
"""A 3 x 3 matrix by columns."""


@fused
def matrix_times(X: Columns, a: Vector) -> Vector:
    """Return ``X a``."""
    return (
        X[0][0] * a[0] + X[1][0] * a[1] + X[2][0] * a[2],
        X[0][1] * a[0] + X[1][1] * a[1] + X[2][1] * a[2],
        X[0][2] * a[0] + X[1][2] * a[1] + X[2][2] * a[2],
    )


@fused
def symmetric_times(J: Six, a: Vector) -> Vector:
    """Return ``J a``."""
    return (
        J[0] * a[0] + J[1] * a[1] + J[2] * a[2],
        J[1] * a[0] + J[3] * a[1] + J[4] * a[2],
        J[2] * a[0] + J[4] * a[1] + J[5] * a[2],
    )


@inner
def rotate_inertia(X: Columns, J: Six) -> Six:
    """Return ``X J X^T``."""
    a, b, c = X
    s, t, u = (
        matrix_times(X, (J[0], J[1], J[2])),
        matrix_times(X, (J[1], J[3], J[4])),
        matrix_times(X, (J[2], J[4], J[5])),
    )
    return (
        s[0] * a[0] + t[0] * b[0] + u[0] * c[0],
        s[0] * a[1] + t[0] * b[1] + u[0] * c[1],
        s[0] * a[2] + t[0] * b[2] + u[0] * c[2],
        s[1] * a[1] + t[1] * b[1] + u[1] * c[1],
        s[1] * a[2] + t[1] * b[2] + u[1] * c[2],
        s[2] * a[2] + t[2] * b[2] + u[2] * c[2],
    )


@fused
def columns(A: Array) -> Columns:
    """Return a matrix that is stored column by column."""
    return load(A[0]), load(A[1]), load(A[2])


@fused
def load_six(a: Array) -> Six:
    """Return six numbers."""
    return a[0], a[1], a[2], a[3], a[4], a[5]


@fused
def load_inertia(link: Array, k: int) -> Inertia:
    """Return the articulated inertia of a link."""
    H = link[k].H
    return load_six(link[k].M), (H[0], H[1], H[2], H[3], H[4], H[5], H[6], H[7], H[8]), load_six(link[k].J)


@fused
def add_inertia(link: Array, k: int, I: Inertia) -> None:
    """Add to the articulated inertia of a link."""
    M, H, J = I
    for n in range(6):
        link[k].M[n] += M[n]
        link[k].J[n] += J[n]
    for n in range(9):
        link[k].H[n] += H[n]


@fused
def inertia_times(I: Inertia, linear: Vector, angular: Vector) -> tuple[Vector, Vector]:
    """Return force and torque ``I (linear, angular)``."""
    M, H, J = I
    force = (
        H[0] * angular[0] + H[1] * angular[1] + H[2] * angular[2],
        H[3] * angular[0] + H[4] * angular[1] + H[5] * angular[2],
        H[6] * angular[0] + H[7] * angular[1] + H[8] * angular[2],
    )
    torque = (
        H[0] * linear[0] + H[3] * linear[1] + H[6] * linear[2],
        H[1] * linear[0] + H[4] * linear[1] + H[7] * linear[2],
        H[2] * linear[0] + H[5] * linear[1] + H[8] * linear[2],
    )
    return add(symmetric_times(M, linear), force), add(torque, symmetric_times(J, angular))


@inner
def rank_one_update(I: Inertia, x: Vector, y: Vector, factor: float) -> Inertia:
    """Return ``I - factor U U^T`` with U = (x, y)."""
    M, H, J = I
    a, b, c = factor * x[0], factor * x[1], factor * x[2]
    d, e, f = factor * y[0], factor * y[1], factor * y[2]
    return (
        (M[0] - a * x[0], M[1] - a * x[1], M[2] - a * x[2], M[3] - b * x[1], M[4] - b * x[2], M[5] - c * x[2]),
        (
            H[0] - a * y[0],
            H[1] - a * y[1],
            H[2] - a * y[2],
            H[3] - b * y[0],
            H[4] - b * y[1],
            H[5] - b * y[2],
            H[6] - c * y[0],
            H[7] - c * y[1],
            H[8] - c * y[2],
        ),
        (J[0] - d * y[0], J[1] - d * y[1], J[2] - d * y[2], J[3] - e * y[1], J[4] - e * y[2], J[5] - f * y[2]),
    )


@inner
def shift_inertia(I: Inertia, d: Vector) -> Inertia:
    """Return ``X^T I X`` for X = [1 -~d; 0 1]: M, K = H - M ~d, J - H^T ~d + ~d K."""
    M, H, J = I
    d0, d1, d2 = d
    K = (
        H[0] - (M[1] * d2 - M[2] * d1),
        H[1] - (M[2] * d0 - M[0] * d2),
        H[2] - (M[0] * d1 - M[1] * d0),
        H[3] - (M[3] * d2 - M[4] * d1),
        H[4] - (M[4] * d0 - M[1] * d2),
        H[5] - (M[1] * d1 - M[3] * d0),
        H[6] - (M[4] * d2 - M[5] * d1),
        H[7] - (M[5] * d0 - M[2] * d2),
        H[8] - (M[2] * d1 - M[4] * d0),
    )
    L = (
        J[0] - (H[3] * d2 - H[6] * d1) + d1 * K[6] - d2 * K[3],
        J[1] - (H[6] * d0 - H[0] * d2) + d1 * K[7] - d2 * K[4],
        J[2] - (H[0] * d1 - H[3] * d0) + d1 * K[8] - d2 * K[5],
        J[3] - (H[7] * d0 - H[1] * d2) + d2 * K[1] - d0 * K[7],
        J[4] - (H[1] * d1 - H[4] * d0) + d2 * K[2] - d0 * K[8],
        J[5] - (H[2] * d1 - H[5] * d0) + d0 * K[5] - d1 * K[2],
    )
    return M, K, L


@fused
def power(linear: Vector, angular: Vector, force: Vector, torque: Vector) -> float:
    """Return the power of a wrench on a motion."""
    return dot(linear, force) + dot(angular, torque)
