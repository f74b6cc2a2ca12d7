"""Rotation matrices, quaternions, Euler and Bryant angles, and frames, in plain NumPy.

Rotation matrices map components: ``v_W = R_WB @ v_B``. Quaternions (Euler parameters) are scalar first,
``(e0, e1, e2, e3)``, of unit length, and belong to the same map. Angles are radians. Equation keys refer to
`docs/formulations.md`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from consilience.errors import InvalidInput

Array = NDArray[Any]
"""An array; dtype, shape, frame and unit stand in the docstrings."""


def float_array(value: ArrayLike, where: str, remedy: str) -> Array:
    """Return an array as floats; refuse text, truth values, complex numbers and what is no array.

    Raises
    ------
    InvalidInput
    """
    try:
        found = np.asarray(value)
        if found.dtype.kind in "fiuO":
            return np.array(found, dtype=float)
    except (TypeError, ValueError):
        pass
    raise InvalidInput(where, "it is no array of numbers", remedy)


def fixed_array(value: ArrayLike, shape: tuple[int, ...], where: str = "array", hint: str = "") -> Array:
    """Return a read-only copy of an array of finite numbers.

    Parameters
    ----------
    value : array_like
    shape : tuple of int
    where : str
        Object and field, for the message.
    hint : str
        What a user may have meant, for the message about another shape.

    Raises
    ------
    InvalidInput
        It holds no numbers, the shape is another one, or a component is not finite.
    """
    a = float_array(value, where, f"Give an array of shape {shape}.{hint}")
    if a.shape != shape:
        raise InvalidInput(where, f"shape {a.shape}", f"Give an array of shape {shape}.{hint}")
    if not np.isfinite(a).all():
        raise InvalidInput(where, "a component is not finite", "Give finite numbers.")
    a.setflags(write=False)
    return a


def skew(a: ArrayLike) -> Array:
    """Return the skew matrix ``~a`` with ``~a @ b == cross(a, b)``, shape (3, 3)."""
    x, y, z = np.asarray(a, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Return the vector product of two vectors of shape (3,), for which `numpy.cross` is several times slower."""
    return np.array(plain_cross(a.tolist(), b.tolist()))


def crosses(a: Array, b: Array) -> Array:
    """Return the vector products of arrays of vectors, shape (..., 3); `numpy.cross` is several times slower."""
    found = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        found[..., k] = a[..., i] * b[..., j] - a[..., j] * b[..., i]
    return found


def plain_cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    """Return the vector product of two lists of three numbers."""
    ax, ay, az = a
    bx, by, bz = b
    return [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]


def rotation_from_quaternion(quat: ArrayLike) -> Array:
    """Return the rotation matrix of unit Euler parameters, ``A = (e0^2 - e.e) 1 + 2 e e^T + 2 e0 ~e`` [MASS (2)].

    Parameters
    ----------
    quat : array_like, shape (..., 4)
        Unit quaternions, scalar first; not normalised here: a norm other than one scales the matrix.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    q = np.asarray(quat, dtype=float)
    # numbers for a single quaternion: arrays of one element are several times slower
    w, x, y, z = q.tolist() if q.ndim == 1 else (q[..., k] for k in range(4))
    R = np.empty((*q.shape[:-1], 3, 3))
    R[..., 0, 0] = w * w + x * x - y * y - z * z
    R[..., 1, 1] = w * w - x * x + y * y - z * z
    R[..., 2, 2] = w * w - x * x - y * y + z * z
    R[..., 0, 1] = 2 * (x * y - w * z)
    R[..., 1, 0] = 2 * (x * y + w * z)
    R[..., 0, 2] = 2 * (x * z + w * y)
    R[..., 2, 0] = 2 * (x * z - w * y)
    R[..., 1, 2] = 2 * (y * z - w * x)
    R[..., 2, 1] = 2 * (y * z + w * x)
    return R


def quaternion_from_rotation(R: ArrayLike) -> Array:
    """Return unit Euler parameters of rotation matrices, the largest component positive (Shepperd's pivot).

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 4)
    """
    R = np.asarray(R, dtype=float)
    if R.ndim > 2:
        flat = np.array([quaternion_from_rotation(r) for r in R.reshape(-1, 3, 3)])
        return flat.reshape(*R.shape[:-2], 4)
    r = R.tolist()  # numbers: arrays of one element are several times slower
    diagonal = r[0][0], r[1][1], r[2][2]
    trace = sum(diagonal)
    pivots = (trace, *diagonal)
    i = pivots.index(max(pivots))
    if i == 0:
        quat = [1.0 + trace, r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]
    else:
        a, b, c = (i - 1), i % 3, (i + 1) % 3
        quat = [r[c][b] - r[b][c], 0.0, 0.0, 0.0]
        quat[1 + a] = 1.0 + 2.0 * r[a][a] - trace
        quat[1 + b] = r[a][b] + r[b][a]
        quat[1 + c] = r[a][c] + r[c][a]
    return np.array(quat) / math.hypot(*quat)


def quaternion_product(p: ArrayLike, q: ArrayLike) -> Array:
    """Return Hamilton's product: the rotation ``q`` followed by ``p``, ``R(p q) = R(p) @ R(q)``."""
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    p0, p1, p2, p3 = (p[..., k] for k in range(4))
    q0, q1, q2, q3 = (q[..., k] for k in range(4))
    product = np.empty(np.broadcast_shapes(p.shape, q.shape))
    product[..., 0] = p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3
    product[..., 1] = p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2
    product[..., 2] = p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1
    product[..., 3] = p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0
    return product


def quaternion_from_rotation_vector(phi: ArrayLike) -> Array:
    """Return unit Euler parameters of rotations by ``|phi|`` about ``phi``, shape (..., 3) to (..., 4)."""
    phi = np.asarray(phi, dtype=float)
    angle = np.linalg.norm(phi, axis=-1, keepdims=True)
    # np.sinc(x) = sin(pi x) / (pi x) is smooth through zero, unlike the quotient written out
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * phi], axis=-1)


def rotation_vector_from_quaternion(quat: ArrayLike) -> Array:
    """Return the rotation vector (axis times angle in [0, pi]) of unit Euler parameters, shape (3,)."""
    q = np.asarray(quat, dtype=float)
    q = -q if q[0] < 0 else q
    sine = float(np.linalg.norm(q[1:]))
    if sine < 1e-9:  # angle / sin(angle / 2) is 2 to rounding
        return 2.0 * q[1:]
    return (2.0 * np.arctan2(sine, q[0]) / sine) * q[1:]


def elementary_rotation(axis: int, angle: float) -> Array:
    """Return the matrix of a rotation by an angle in rad about coordinate axis 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    b, d = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[b, b] = R[d, d] = c
    R[b, d], R[d, b] = -s, s
    return R


def rotation_from_euler_zxz(angles: ArrayLike) -> Array:
    """Return the rotation matrix of Euler angles (phi, theta, psi), ``Rz(phi) Rx(theta) Rz(psi)`` [C4, 4.3.1]."""
    phi, theta, psi = np.asarray(angles, dtype=float)
    return elementary_rotation(2, phi) @ elementary_rotation(0, theta) @ elementary_rotation(2, psi)


def rotation_from_bryant_xyz(angles: ArrayLike) -> Array:
    """Return the rotation matrix of Bryant angles (alpha, beta, gamma), ``Rx(alpha) Ry(beta) Rz(gamma)`` [C4]."""
    alpha, beta, gamma = np.asarray(angles, dtype=float)
    return elementary_rotation(0, alpha) @ elementary_rotation(1, beta) @ elementary_rotation(2, gamma)


def rotation_from_three_points(O: ArrayLike, P: ArrayLike, Q: ArrayLike) -> Array:
    """Return the rotation matrix ``[i j k]`` of the frame with origin O, P on x and Q in the xy plane [INTRO].

    Raises
    ------
    ValueError
        The three points lie on one line and define no plane.
    """
    OP = np.subtract(P, O, dtype=float)
    OQ = np.subtract(Q, O, dtype=float)
    normal = np.cross(OP, OQ)
    if np.linalg.norm(normal) <= 1e-12 * np.linalg.norm(OP) * np.linalg.norm(OQ):
        raise ValueError("the three points lie on one line")
    i = OP / np.linalg.norm(OP)
    k = normal / np.linalg.norm(normal)
    return np.column_stack([i, np.cross(k, i), k])


def orthogonal_triad(a: ArrayLike) -> tuple[Array, Array]:
    """Return two vectors that make an orthogonal (not normalised) triad with `a` [INTRO].

    ``a_d`` has 0 where ``|a|`` is largest and 1 elsewhere; ``a1 = a x a_d``, ``a2 = a1 x a``.
    """
    a = np.asarray(a, dtype=float)
    a_d = np.ones(3)
    a_d[int(np.argmax(np.abs(a)))] = 0.0
    a1 = cross(a, a_d)
    return a1, cross(a1, a)


def rotation_with_z_axis(axis: ArrayLike, second: ArrayLike | None = None) -> Array:
    """Return the rotation matrix with z along `axis` and x along `second`, made orthogonal to z.

    Parameters
    ----------
    axis : array_like, shape (3,)
    second : array_like, shape (3,), optional
        Direction of x; its component along `axis` is removed. Default: the first vector of `orthogonal_triad`.

    Raises
    ------
    ValueError
        `axis` is zero, or `second` is zero or parallel to `axis`.
    """
    axis = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise ValueError("the axis is the zero vector")
    z = axis / length
    if second is None:
        x = orthogonal_triad(z)[0]
    else:
        x = np.asarray(second, dtype=float)
        if np.linalg.norm(np.cross(z, x)) <= 1e-9 * max(float(np.linalg.norm(x)), np.finfo(float).tiny):
            raise ValueError("the second axis is parallel to the first, or zero")
        for _ in range(2):  # once leaves an error that grows as the angle between the axes shrinks
            x = x - z * (z @ x)
            x = x / np.linalg.norm(x)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def euler_parameter_matrix(quat: ArrayLike) -> Array:
    """Return ``G = [-e | e0 1 - ~e]``, shape (3, 4).

    With the angular velocity w' in body axes, ``w' = 2 G dp/dt`` and ``dp/dt = 1/2 G^T w'`` [MASS (38)].
    """
    q = np.asarray(quat, dtype=float)
    return np.column_stack([-q[1:], q[0] * np.eye(3) - skew(q[1:])])


def rotation_angle_between(quat_a: ArrayLike, quat_b: ArrayLike) -> Array:
    """Return the angle of the rotation from orientation a to b, in [0, pi], whatever the signs of the quaternions.

    Parameters
    ----------
    quat_a, quat_b : array_like, shape (..., 4)
    """
    a, b = np.asarray(quat_a, dtype=float), np.asarray(quat_b, dtype=float)
    conjugate = a * np.array([1.0, -1.0, -1.0, -1.0])
    relative = quaternion_product(conjugate, b)
    # the arctangent keeps full accuracy near zero, where arccos of the scalar part loses half the digits
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(relative[..., 1:], axis=-1), np.abs(relative[..., 0])))


def continuous_in_time(quats: ArrayLike) -> Array:
    """Choose the signs of a series of quaternions so that neighbours are close and the first has e0 >= 0.

    Parameters
    ----------
    quats : array_like, shape (n_t, ..., 4)
    """
    q = np.array(quats, dtype=float)
    if len(q) == 0:
        return q
    jumps = np.sum(q[1:] * q[:-1], axis=-1) < 0
    first = q[:1, ..., 0] < 0
    flips = np.cumsum(np.concatenate([first, jumps]), axis=0) % 2 == 1
    q[flips] *= -1.0
    return q
