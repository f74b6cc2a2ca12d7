"""Taylor coefficients of the motion of a planar tree, one order after the other.

All quantities of a planar mechanism follow from the direction ``e = exp(i theta)`` of each link, with plane vectors as
complex numbers, by sums and products. Their coefficients, with w the angular velocity, are

    (a b)_m = sum_j a_j b_{m-j},        e_{m+1} = i / (m + 1) sum_j w_j e_{m-j}

[Griewank and Walther, Evaluating Derivatives, 2008, chapter 13; Jorba and Zou, A software package for the numerical
integration of ODEs by means of high-order Taylor methods, Experimental Mathematics 14, 2005, 99-117]. A joint applies
the force F to its link at the arm e a, and -F to the parent at the arm e_p a_p; both arms rotate. With * for the
conjugate, forces, and torques about the centre of mass r of a link, are

    F = m r'' - weight + sum of F of the joints on the link's outboard side
    J w' + Im(e* P) = 0 where all joints rotate,        P = sum of a_p* F of these joints - a* F.

The accelerations of order m enter the equations of order m as the accelerations of a state do, with the same inertias,
arms and axes: articulated bodies and fronts, factorised once at the state, solve the equations of all orders. The other
terms of order m are known from lower orders and enter as biases: terms of Im(e* P), and velocity products.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused
from consilience.reference.kernel.vectors import load, put
from consilience.reference.tree.inertia import load_six
from consilience.reference.tree.planar import (
    Pair,
    PlanarVector,
    inertia_times,
    pair,
    planar_power,
    put_pair,
    rotate_pair,
)
from consilience.reference.tree.records import COEFFICIENTS, LINK_SERIES


class Series(NamedTuple):
    """Coefficients by order, the last index; N free directions."""

    link: Array  # (n_b + 1,) of LINK_SERIES; the ground is last
    q: Array  # (N, COEFFICIENTS) coordinates


def series_arrays(links: int, directions: int) -> Series:
    """Return new arrays of series."""
    link = np.zeros(links + 1, LINK_SERIES)
    link[-1].c[0] = 1.0
    return Series(link, np.zeros((directions, COEFFICIENTS)))


@fused
def begin_series(link: Array, free: Array, coef: Array, q: Array, first_speed: int, z: Array, inverse: Array) -> None:
    """Set the coefficients that are known from a state, at placed links.

    Parameters
    ----------
    link, free, first_speed, z : see `arrays`
    coef, q : ndarray
        Fields link and q of `Series`; overwritten in the orders 0 and 1.
    inverse : ndarray, shape (N,)
        Overwritten: reciprocals of the pivots D.
    """
    for k in range(link.shape[0] - 1):
        c, s = pair(link[k].turn)
        w = link[k].spin
        coef[k].c[0], coef[k].s[0], coef[k].w[0] = c, s, w
        coef[k].c[1], coef[k].s[1] = -w * s, w * c
    for n in range(q.shape[0]):
        q[n, 0], q[n, 1] = z[n], z[first_speed + n]
        inverse[n] = 1.0 / free[n].pivot


@fused
def _carrier(link: Array, k: int) -> int:
    """Return the link that carries the axes of the displacements of a joint."""
    return link[k].parent if link[k].sense > 0.0 else k


@fused
def _translations_end(link: Array, k: int) -> int:
    """Return the index behind the displacements of a joint."""
    return link[k].last - (1 if link[k].rotation_sense != 0.0 else 0)


@fused
def _slide_forces(link: Array, free: Array, coef: Array, q: Array, k: int, m: int, joint_force: Array) -> None:
    """Add the known part of P at a sliding joint, and compute the known joint force along it."""
    b, sense = _carrier(link, k), link[k].sense
    along = across = 0.0
    for j in range(1, m + 1):
        c, s, x, y = coef[b].c[j], coef[b].s[j], coef[k].F_x[m - j], coef[k].F_y[m - j]
        along += c * x + s * y
        across += c * y - s * x
    for n in range(link[k].first, _translations_end(link, k)):
        d = pair(free[n].direction)
        joint_force[n] = -sense * (d[0] * along + d[1] * across)
        x = y = 0.0
        for j in range(1, m + 1):
            x += q[n, j] * coef[k].F_x[m - j]
            y += q[n, j] * coef[k].F_y[m - j]
        add_moment(coef, b, m, d, sense * x, sense * y)


@fused
def add_moment(coef: Array, k: int, m: int, a: Pair, x: float, y: float) -> None:
    """Add ``a* F`` of order m to P of link k.

    Parameters
    ----------
    coef : ndarray
        Field link of `Series`; updated.
    k, m : int
    a : tuple of float, m
        Arm in axes of the link.
    x, y : float, N
        Force.
    """
    coef[k].P_x[m] += a[0] * x + a[1] * y
    coef[k].P_y[m] += a[0] * y - a[1] * x


@fused
def known_forces(link: Array, free: Array, coef: Array, q: Array, m: int, joint_force: Array, torque: Array) -> None:
    """Compute the known parts of the forces of order m and of P, without rows, and of the joint forces.

    Parameters
    ----------
    link, free : see `arrays`
    coef, q : ndarray
        Fields link and q of `Series`; updated.
    m : int
    joint_force : ndarray, shape (N,)
        Overwritten.
    torque : ndarray, shape (n_b + 1,)
        Overwritten with zero: see `known_rotations`.
    """
    for k in range(link.shape[0]):
        torque[k] = 0.0
        coef[k].F_x[m] = coef[k].F_y[m] = coef[k].P_x[m] = coef[k].P_y[m] = 0.0
    if m == 0:
        for k in range(link.shape[0] - 1):
            coef[k].F_x[0], coef[k].F_y[0] = -link[k].weight[0], -link[k].weight[1]
    for n in range(free.shape[0]):
        joint_force[n] = 0.0
    for k in range(link.shape[0] - 1):
        if _translations_end(link, k) > link[k].first:
            _slide_forces(link, free, coef, q, k, m, joint_force)


@fused
def _advance_direction(coef: Array, k: int, m: int) -> float:
    """Compute e of order m + 2 without the unknown acceleration of order m; return the known part of ``Im(e* P)``."""
    x = y = one = two = 0.0
    for j in range(m + 1):
        w = coef[k].w[j]
        x += w * coef[k].s[m + 1 - j]
        y += w * coef[k].c[m + 1 - j]
        one += coef[k].c[j] * coef[k].P_y[m - j]
        two += coef[k].s[j] * coef[k].P_x[m - j]
    factor = 1.0 / (m + 2.0)
    coef[k].c[m + 2], coef[k].s[m + 2] = -factor * x, factor * y
    return one - two


@fused
def known_rotations(link: Array, free: Array, coef: Array, q: Array, m: int, torque: Array) -> None:
    """Compute the known parts of the offsets of order m + 2, and the biases of order m.

    Parameters
    ----------
    link, free : see `arrays`
    coef, q : ndarray
        Fields link and q of `Series`; updated.
    m : int
    torque : ndarray, shape (n_b + 1,)
        Torques on the links that P does not contain.
    """
    scale = (m + 1.0) * (m + 2.0)
    for k in range(link.shape[0] - 1):
        p = link[k].parent
        put(link[k].bias, (coef[k].F_x[m], coef[k].F_y[m], torque[k] + _advance_direction(coef, k, m)))
        e_p, e = (coef[p].c[m + 2], coef[p].s[m + 2]), (coef[k].c[m + 2], coef[k].s[m + 2])
        s_p, s = rotate_pair(e_p, pair(link[k].parent_arm)), rotate_pair(e, pair(link[k].arm))
        x, y = s_p[0] - s[0], s_p[1] - s[1]
        behind = _translations_end(link, k)
        if behind > link[k].first:
            b, sense = _carrier(link, k), link[k].sense
            for n in range(link[k].first, behind):
                c = s_n = 0.0
                for j in range(m + 2):
                    c += q[n, j] * coef[b].c[m + 2 - j]
                    s_n += q[n, j] * coef[b].s[m + 2 - j]
                away = rotate_pair((c, s_n), pair(free[n].direction))
                x, y = x + sense * away[0], y + sense * away[1]
        put_pair(link[k].velocity_product, (scale * x, scale * y))


@fused
def _carried(link: Array, free: Array, inverse: Array, k: int) -> PlanarVector:
    """Return the wrench on the parent due to the velocity products of a link, with the link's directions free."""
    c = pair(link[k].velocity_product)
    c = c[0], c[1], 0.0
    x = inertia_times(load_six(link[k].articulated), c)
    for n in range(link[k].last - 1, link[k].first - 1, -1):
        u = load(free[n].U)
        part = planar_power(u, c) * inverse[n]
        x = x[0] - part * u[0], x[1] - part * u[1], x[2] - part * u[2]
    return x


@fused
def sweep_biases(link: Array, free: Array, joint_force: Array, inverse: Array) -> None:
    """Compute the remaining joint forces from the biases and from known joint forces, articulated inertias swept."""
    for k in range(link.shape[0] - 2, -1, -1):
        f = load(link[k].bias)
        for n in range(link[k].last - 1, link[k].first - 1, -1):
            left = joint_force[n] - planar_power(load(free[n].s), f)
            free[n].joint_force = left
            u = load(free[n].U)
            left *= inverse[n]
            f = f[0] + left * u[0], f[1] + left * u[1], f[2] + left * u[2]
        p = link[k].parent
        if p >= 0:
            x, d = _carried(link, free, inverse, k), pair(link[k].offset)
            a, b = f[0] + x[0], f[1] + x[1]
            link[p].bias[0] += a
            link[p].bias[1] += b
            link[p].bias[2] += f[2] + x[2] + d[0] * b - d[1] * a


@fused
def next_order(link: Array, free: Array, coef: Array, q: Array, inverse: Array, m: int) -> None:
    """Compute accelerations of order m outward along the tree, and the coefficients that follow from them.

    Parameters
    ----------
    link, free : see `arrays`
    coef, q : ndarray
        Fields link and q of `Series`; updated.
    inverse : ndarray, shape (N,)
        Reciprocals of the pivots D.
    m : int
    """
    one, two = 1.0 / (m + 1.0), 1.0 / (m + 2.0)
    for k in range(link.shape[0] - 1):
        a, d, c = (load(link[link[k].parent].acceleration), pair(link[k].offset), pair(link[k].velocity_product))
        a = a[0] - a[2] * d[1] + c[0], a[1] + a[2] * d[0] + c[1], a[2]
        for n in range(link[k].first, link[k].last):
            s = load(free[n].s)
            u = (free[n].joint_force - planar_power(a, load(free[n].U))) * inverse[n]
            q[n, m + 2] = u * one * two
            a = a[0] + u * s[0], a[1] + u * s[1], a[2] + u * s[2]
        put(link[k].acceleration, a)
        w = one * a[2]
        coef[k].w[m + 1] = w
        coef[k].c[m + 2] -= two * w * coef[k].s[0]
        coef[k].s[m + 2] += two * w * coef[k].c[0]
        coef[k].F_x[m] += link[k].mass * a[0]
        coef[k].F_y[m] += link[k].mass * a[1]


@fused
def joint_forces(link: Array, free: Array, coef: Array, q: Array, m: int) -> None:
    """Compute the joint forces F of order m inward along the tree, and P.

    Parameters
    ----------
    link, free : see `arrays`
    coef, q : ndarray
        Fields link and q of `Series`; coef is updated.
    m : int
    """
    for k in range(link.shape[0] - 2, -1, -1):
        p, x, y = link[k].parent, coef[k].F_x[m], coef[k].F_y[m]
        add_moment(coef, k, m, pair(link[k].arm), -x, -y)
        add_moment(coef, p, m, pair(link[k].parent_arm), x, y)
        coef[p].F_x[m] += x
        coef[p].F_y[m] += y
        behind = _translations_end(link, k)
        if behind > link[k].first:
            b, sense = _carrier(link, k), link[k].sense
            for n in range(link[k].first, behind):
                away = sense * q[n, 0]
                add_moment(coef, b, m, pair(free[n].direction), away * x, away * y)
