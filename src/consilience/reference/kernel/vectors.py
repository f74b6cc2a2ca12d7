"""Three-vectors as tuples in kernels: on the stack, without allocation.

Kernels divide as NumPy does: a quotient by zero is not finite, and the caller in Python raises `NumericalFailure`.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inner

Vector = tuple[float, float, float]


@fused
def load(a: Array) -> Vector:
    """Return the first three entries of an array."""
    return a[0], a[1], a[2]


@fused
def column(R: Array, k: int) -> Vector:
    """Return column k of a 3 x 3 matrix."""
    return R[0, k], R[1, k], R[2, k]


@fused
def store(a: Array, v: Vector, factor: float) -> None:
    """Compute ``a[:3] = factor v``."""
    a[0], a[1], a[2] = factor * v[0], factor * v[1], factor * v[2]


@fused
def put(a: Array, v: Vector) -> None:
    """Set the first three entries of an array."""
    a[0], a[1], a[2] = v


@fused
def accumulate(a: Array, v: Vector) -> None:
    """Compute ``a[:3] += v``."""
    a[0] += v[0]
    a[1] += v[1]
    a[2] += v[2]


@fused
def add(a: Vector, b: Vector) -> Vector:
    """Return ``a + b``."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@fused
def sub(a: Vector, b: Vector) -> Vector:
    """Return ``a - b``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@fused
def scale(s: float, a: Vector) -> Vector:
    """Return ``s a``."""
    return s * a[0], s * a[1], s * a[2]


@fused
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@fused
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@fused
def rotate(R: Array, a: Vector) -> Vector:
    """Return ``R a``."""
    return (
        R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
        R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
        R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
    )


@fused
def rotate_back(R: Array, a: Vector) -> Vector:
    """Return ``R^T a``."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )


@inner
def assign(into: Array, values: Array) -> None:
    """Copy a one-dimensional array; a slice would make another array object."""
    for n in range(into.shape[0]):
        into[n] = values[n]
