"""Positions, velocities, free directions and velocity-product accelerations of the links at a state z.

Outward from the ground, with P the origin of M, s_i and s_j the arms to P from the centres of mass of predecessor i and
successor j, e the free axes in the world and u their speeds,

    v_j + w_j x s_j = v_i + w_i x s_i + sum_translations e u,     w_j = w_i + sum_rotations e u,

solved for the body that the tree leads to; where that is the predecessor, the sums change sign [Featherstone 2008,
section 4.4]. Inboard and outboard are the joint frames on the parent and on the link.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.motion import ZERO
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import Vector, add, column, cross, dot, load, put, scale, sub
from consilience.reference.tree.inertia import Columns, columns, matrix_times


@fused
def _joint_rotation(q: Array, at: int, about: int) -> Columns:
    """Return the rotation matrix from M to F at the coordinates of a joint."""
    if about == 0:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    if about < 3:
        c, s = np.cos(q[at]), np.sin(q[at])
        if about == 1:
            return (c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)
        c2, s2 = np.cos(q[at + 1]), np.sin(q[at + 1])
        return (c, s, 0.0), (-s * c2, c * c2, s2), (s * s2, -c * s2, c2)
    e0, e1, e2, e3 = q[at], q[at + 1], q[at + 2], q[at + 3]
    n = 1.0 / (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    return (
        (n * (e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3), n * 2 * (e1 * e2 + e0 * e3), n * 2 * (e1 * e3 - e0 * e2)),
        (n * 2 * (e1 * e2 - e0 * e3), n * (e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3), n * 2 * (e2 * e3 + e0 * e1)),
        (n * 2 * (e1 * e3 + e0 * e2), n * 2 * (e2 * e3 - e0 * e1), n * (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3)),
    )


@fused
def load_vector(table: Array, k: int, at: int) -> Vector:
    """Return three numbers of a row, from column `at` on."""
    return table[k, at], table[k, at + 1], table[k, at + 2]


@fused
def store_vector(table: Array, k: int, at: int, a: Vector) -> None:
    """Store three numbers in a row, from column `at` on."""
    table[k, at] = a[0]
    table[k, at + 1] = a[1]
    table[k, at + 2] = a[2]


@inner
def _transposed(A: Columns) -> Columns:
    return (A[0][0], A[1][0], A[2][0]), (A[0][1], A[1][1], A[2][1]), (A[0][2], A[1][2], A[2][2])


@fused
def _store_motion(
    link: Array, k: int, outboard: Columns, s_p: Vector, s: Vector, joint: tuple[Vector, Vector, Vector, Vector]
) -> None:
    """Store the motion of a link, from the motion of its parent and of its joint.

    With arms to P: ``w = w_p + spin``, ``v + w x s = v_p + w_p x s_p + speed``.

    Parameters
    ----------
    link : see `arrays`
    k : int
    outboard : Columns
        Axes of the link.
    s_p, s : Vector, m
        Arms from the centres of mass of parent and link.
    joint : tuple of Vector
        Of the joint: speed, spin, and linear and angular acceleration quadratic in the joint speeds.
    """
    p, (speed, spin, c, c_angular) = link[k].parent, joint
    w_p = load(link[p].spin)
    w = add(w_p, spin)
    carried = sub(cross(w_p, s_p), cross(w, s))
    step = sub(s_p, s)
    for n in range(3):
        put(link[k].axes[n], outboard[n])
    put(link[k].offset, step)
    put(link[k].position, add(load(link[p].position), step))
    put(link[k].velocity, add(load(link[p].velocity), add(carried, speed)))
    put(link[k].spin, w)
    linear = sub(cross(w_p, cross(w_p, s_p)), cross(w, cross(w, s)))
    put(link[k].velocity_product[0], add(add(linear, c), cross(s, c_angular)))
    put(link[k].velocity_product[1], c_angular)


@fused
def _place_revolute(link: Array, free: Array, k: int, q: Array, v: Array) -> None:
    """Place a link on a revolute joint; both senses of the joint differ only in sign."""
    p, n, sign = link[k].parent, link[k].first, link[k].sense
    base, angle, u = columns(link[p].axes), sign * q[link[k].coordinate], sign * v[n]
    x, y, e = (
        matrix_times(base, load(link[k].inboard_axes[0])),
        matrix_times(base, load(link[k].inboard_axes[1])),
        matrix_times(base, load(link[k].inboard_axes[2])),
    )
    c, s = np.cos(angle), np.sin(angle)
    outboard = add(scale(c, x), scale(s, y)), sub(scale(c, y), scale(s, x)), e
    s_p = matrix_times(base, load(link[k].parent_arm))
    s_k = matrix_times(outboard, load(link[k].arm))
    put(free[n].s[0], scale(sign, cross(s_k, e)))
    put(free[n].s[1], scale(sign, e))
    e_dot = cross(load(link[p].spin), e)
    _store_motion(link, k, outboard, s_p, s_k, (ZERO, scale(u, e), ZERO, scale(u, e_dot)))


@fused
def _axis(free: Array, n: int, F: Columns, M: Columns) -> Vector:
    """Return the axis of a free direction in the world."""
    number = free[n].axis
    return F[number] if number < 3 else M[number - 3]


@fused
def _place_joint(link: Array, free: Array, k: int, q: Array, v: Array) -> None:
    """Place a link on a joint of any kind."""
    p, first, last, sign = link[k].parent, link[k].first, link[k].last, link[k].sense
    at, along = link[k].coordinate, link[k].translations
    base, turned = columns(link[p].axes), _joint_rotation(q, at + along, link[k].rotations)
    if sign < 0.0:
        turned = _transposed(turned)
    inboard = (
        matrix_times(base, load(link[k].inboard_axes[0])),
        matrix_times(base, load(link[k].inboard_axes[1])),
        matrix_times(base, load(link[k].inboard_axes[2])),
    )
    outboard = matrix_times(inboard, turned[0]), matrix_times(inboard, turned[1]), matrix_times(inboard, turned[2])
    F, M = (inboard, outboard) if sign > 0.0 else (outboard, inboard)
    s_p = matrix_times(base, load(link[k].parent_arm))
    s_k = matrix_times(outboard, load(link[k].arm))
    displacement, speed, spin = ZERO, ZERO, ZERO
    for n in range(first, last):
        e, u = _axis(free, n, F, M), sign * v[n]
        if n - first < along:
            displacement, speed = add(displacement, scale(q[at + n - first], e)), add(speed, scale(u, e))
        else:
            spin = add(spin, scale(u, e))
    # P is the origin of M; the origin of F lies behind it by the displacement
    if sign > 0.0:
        s_p = add(s_p, displacement)
    else:
        s_k = add(s_k, displacement)
    w_p = load(link[p].spin)
    # F moves with the predecessor, M with the successor
    w_F, w_M = (w_p, add(w_p, spin)) if sign > 0.0 else (add(w_p, spin), w_p)
    linear, angular = ZERO, ZERO
    for n in range(first, last):
        e, u = _axis(free, n, F, M), sign * v[n]
        e_dot = cross(w_F if free[n].axis < 3 else w_M, e)
        if n - first < along:
            linear = add(linear, scale(2.0 * u, e_dot))
            put(free[n].s[0], scale(sign, e))
            put(free[n].s[1], ZERO)
        else:
            angular = add(angular, scale(u, e_dot))
            put(free[n].s[0], scale(sign, cross(s_k, e)))
            put(free[n].s[1], scale(sign, e))
    _store_motion(link, k, outboard, s_p, s_k, (speed, spin, linear, angular))


@fused
def place_links(link: Array, free: Array, q: Array, v: Array) -> None:
    """Fill the fields axes to offset of all links, and s of all directions, at coordinates q and speeds v.

    q may be longer than the coordinates: a whole state z will do.
    """
    for k in range(link.shape[0] - 1):
        if link[k].is_revolute:
            _place_revolute(link, free, k, q, v)
        else:
            _place_joint(link, free, k, q, v)


@kernel
def place_bodies(layout: Array, link: Array, y: Array, A: Array) -> None:
    """Fill y (except Euler parameters) and A of all bodies from placed links."""
    for k in range(layout.shape[0]):
        b, base, w = layout[k].body, columns(link[k].axes), load(link[k].spin)
        store_vector(y, b, 0, load(link[k].position))
        store_vector(y, b, 7, load(link[k].velocity))
        for n in range(3):
            axis = matrix_times(base, load(link[k].body_axes[n]))
            y[b, 10 + n] = dot(axis, w)
            A[b, 0, n], A[b, 1, n], A[b, 2, n] = axis


@kernel
def place_links_and_bodies(
    layout: Array, link: Array, free: Array, first_speed: int, z: Array, y: Array, A: Array
) -> None:
    """Place links and bodies at a state z.

    Parameters
    ----------
    layout, link, free, first_speed, z : see `arrays`
    y : ndarray, shape (n_b + n_e, 13)
        Overwritten: canonical rows of the bodies, Euler parameters excepted.
    A : ndarray, shape (n_b, 3, 3)
        Overwritten: rotation matrices of the bodies.
    """
    place_links(link, free, z, z[first_speed:])
    place_bodies(layout, link, y, A)


@inner
def coordinate_rates(layout: Array, first_speed: int, z: Array, dz: Array) -> None:
    """Fill the rates of the coordinates; of Euler parameters ``p' = 1/2 (0, w) p`` with w in axes of F."""
    for k in range(layout.shape[0]):
        along, about = layout[k].translations, layout[k].rotations
        at, n = layout[k].coordinate, first_speed + layout[k].free
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


@inner
def displace(layout: Array, z: Array, u: Array) -> None:
    """Add small displacements u along the free directions to the coordinates; Euler parameters stay unit."""
    for k in range(layout.shape[0]):
        along, about = layout[k].translations, layout[k].rotations
        at, n = layout[k].coordinate, layout[k].free
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
    normalise(layout, z)


@inner
def normalise(layout: Array, z: Array) -> None:
    """Divide the Euler parameters of all balls by their norm."""
    for k in range(layout.shape[0]):
        if layout[k].rotations == 3:
            at = layout[k].coordinate + layout[k].translations
            norm = np.sqrt(z[at] ** 2 + z[at + 1] ** 2 + z[at + 2] ** 2 + z[at + 3] ** 2)
            for n in range(4):
                z[at + n] /= norm


@inner
def euler_parameters(X: Columns) -> tuple[float, float, float, float]:
    """Return unit Euler parameters of a rotation matrix, the largest one positive [Shepperd 1978]."""
    trace = X[0][0] + X[1][1] + X[2][2]
    p = (1.0 + trace, 1.0 + 2.0 * X[0][0] - trace, 1.0 + 2.0 * X[1][1] - trace, 1.0 + 2.0 * X[2][2] - trace)
    x, y, z = X[1][2] - X[2][1], X[2][0] - X[0][2], X[0][1] - X[1][0]
    xy, xz, yz = X[1][0] + X[0][1], X[2][0] + X[0][2], X[2][1] + X[1][2]
    largest = max(p)
    if p[0] == largest:
        e = (p[0], x, y, z)
    elif p[1] == largest:
        e = (x, p[1], xy, xz)
    elif p[2] == largest:
        e = (y, xy, p[2], yz)
    else:
        e = (z, xz, yz, p[3])
    norm = np.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2 + e[3] ** 2)
    return e[0] / norm, e[1] / norm, e[2] / norm, e[3] / norm


@kernel
def fill_euler_parameters(A: Array, y: Array) -> None:
    """Fill the Euler parameters of all bodies in y from their rotation matrices."""
    for b in range(A.shape[0]):
        y[b, 3], y[b, 4], y[b, 5], y[b, 6] = euler_parameters((column(A[b], 0), column(A[b], 1), column(A[b], 2)))


@inner
def copy_sample(A: Array, y: Array, sample: Array) -> None:
    """Copy the placed bodies, with their Euler parameters, into one sample, shape (13 (n_b + n_e),)."""
    fill_euler_parameters(A, y)
    width = y.shape[1]
    for b in range(y.shape[0]):
        for n in range(width):
            sample[width * b + n] = y[b, n]
