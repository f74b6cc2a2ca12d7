"""Kinematics, articulated bodies and whitened responses in a plane, with three components instead of six.

The equations are those of `kinematics`, `articulated` and `multifrontal` [Featherstone 2008, table 7.1]. Motions are
(linear, angular), wrenches (force, torque), in the axes e_1, e_2, n of `planar_detection` at centres of mass. An
angular velocity w moves the end of an arm d with ``w (-d_2, d_1)``.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.tree import plane as col
from consilience.reference.tree.arrays import FREE, FREE_END
from consilience.reference.tree.arrays import PARENT as PARENT_LINK
from consilience.reference.tree.loop_groups import FRONT_ROWS, FRONT_START, PATH, PATH_END, ROW, START, TOUCHED, USED
from consilience.reference.tree.multifrontal import clear_fronts

Pair = tuple[float, float]
PlanarVector = tuple[float, float, float]
"""A motion (linear, angular) or wrench (force, torque) in a plane."""

PlanarInertia = tuple[float, float, float, float, float, float]
"""Articulated inertia: xx, xy, yy, x and y with the angle, moment."""


@fused
def load_pair(table: Array, k: int, at: int) -> Pair:
    """Return two numbers of a row, from column `at` on."""
    return table[k, at], table[k, at + 1]


@fused
def load_triple(table: Array, k: int, at: int) -> PlanarVector:
    """Return three numbers of a row, from column `at` on."""
    return table[k, at], table[k, at + 1], table[k, at + 2]


@fused
def store_pair(table: Array, k: int, at: int, a: Pair) -> None:
    """Store two numbers in a row, from column `at` on."""
    table[k, at], table[k, at + 1] = a


@fused
def store_triple(table: Array, k: int, at: int, a: PlanarVector) -> None:
    """Store three numbers in a row, from column `at` on."""
    table[k, at], table[k, at + 1], table[k, at + 2] = a


@fused
def rotate_pair(turn: Pair, a: Pair) -> Pair:
    """Rotate a vector by the angle of this cosine and sine."""
    return turn[0] * a[0] - turn[1] * a[1], turn[1] * a[0] + turn[0] * a[1]


@fused
def planar_power(a: PlanarVector, b: PlanarVector) -> float:
    """Return the power of a wrench on a motion."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _joint_displacement(
    link: Array, free: Array, k: int, q: Array, v: Array, turn: Pair, spin: float
) -> tuple[Pair, Pair, Pair]:
    """Return displacement, velocity and velocity-product acceleration of a joint; fill S of its displacements."""
    sense, displacement, speed, bent = link[k, col.SENSE], (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    for n in range(int(link[k, col.FIRST]), int(link[k, col.LAST]) - (1 if link[k, col.ROTATION_SENSE] != 0.0 else 0)):
        e, u = rotate_pair(turn, load_pair(free, n, col.DIRECTION)), sense * v[n]
        displacement = displacement[0] + q[n] * e[0], displacement[1] + q[n] * e[1]
        speed = speed[0] + u * e[0], speed[1] + u * e[1]
        bent = bent[0] - 2.0 * u * spin * e[1], bent[1] + 2.0 * u * spin * e[0]
        store_triple(free, n, col.S, (sense * e[0], sense * e[1], 0.0))
    return displacement, speed, bent


@inner
def place_planar_links(link: Array, free: Array, q: Array, v: Array) -> None:
    """Fill columns COS to BIAS of all links, and S of all directions, at coordinates q and speeds v.

    Biases are of gravity alone. q may be longer than the coordinates: a whole state z will do.
    """
    for k in range(link.shape[0] - 1):
        p, sense, turn_sense, last = (
            int(link[k, col.PARENT]),
            link[k, col.SENSE],
            link[k, col.ROTATION_SENSE],
            int(link[k, col.LAST]),
        )
        base, w_p = load_pair(link, p, col.COS), link[p, col.SPIN]
        outboard, w = base, w_p
        if turn_sense != 0.0:
            angle = turn_sense * q[last - 1]
            outboard, w = rotate_pair(base, (np.cos(angle), np.sin(angle))), w_p + turn_sense * v[last - 1]
        s_p, s = (
            rotate_pair(base, load_pair(link, k, col.ARM_PARENT)),
            rotate_pair(outboard, load_pair(link, k, col.ARM)),
        )
        x, y = w * w * s[0], w * w * s[1]
        speed = (0.0, 0.0)
        if last - int(link[k, col.FIRST]) > (1 if turn_sense != 0.0 else 0):
            # F moves with the predecessor
            displacement, speed, bent = _joint_displacement(
                link, free, k, q, v, base if sense > 0.0 else outboard, w_p if sense > 0.0 else w
            )
            if sense > 0.0:
                s_p = s_p[0] + displacement[0], s_p[1] + displacement[1]
            else:
                s = s[0] + displacement[0], s[1] + displacement[1]
                x, y = w * w * s[0], w * w * s[1]
            x, y = x + bent[0], y + bent[1]
        if turn_sense != 0.0:
            store_triple(free, last - 1, col.S, (turn_sense * s[1], -turn_sense * s[0], turn_sense))
        step, v_p, r_p = (
            (s_p[0] - s[0], s_p[1] - s[1]),
            load_pair(link, p, col.VELOCITY),
            load_pair(link, p, col.POSITION),
        )
        store_pair(link, k, col.COS, outboard)
        store_pair(link, k, col.POSITION, (r_p[0] + step[0], r_p[1] + step[1]))
        store_pair(
            link,
            k,
            col.VELOCITY,
            (v_p[0] - w_p * s_p[1] + w * s[1] + speed[0], v_p[1] + w_p * s_p[0] - w * s[0] + speed[1]),
        )
        link[k, col.SPIN] = w
        store_pair(link, k, col.VELOCITY_PRODUCT, (x - w_p * w_p * s_p[0], y - w_p * w_p * s_p[1]))
        store_pair(link, k, col.OFFSET, step)
        m = link[k, col.MASS]
        store_triple(link, k, col.ARTICULATED, (m, 0.0, m))
        store_triple(link, k, col.ARTICULATED + 3, (0.0, 0.0, link[k, col.INERTIA]))
        store_triple(link, k, col.BIAS, (-link[k, col.WEIGHT], -link[k, col.WEIGHT + 1], 0.0))


@fused
def inertia_times(I: PlanarInertia, a: PlanarVector) -> PlanarVector:
    """Return ``I a``."""
    return (
        I[0] * a[0] + I[1] * a[1] + I[3] * a[2],
        I[1] * a[0] + I[2] * a[1] + I[4] * a[2],
        I[3] * a[0] + I[4] * a[1] + I[5] * a[2],
    )


@fused
def _rank_one_update(I: PlanarInertia, x: PlanarVector, factor: float) -> PlanarInertia:
    """Return ``I - factor x x^T``."""
    a, b, c = factor * x[0], factor * x[1], factor * x[2]
    return I[0] - a * x[0], I[1] - a * x[1], I[2] - b * x[1], I[3] - a * x[2], I[4] - b * x[2], I[5] - c * x[2]


@fused
def load_planar_inertia(link: Array, k: int) -> PlanarInertia:
    """Return the articulated inertia of a link."""
    return (
        link[k, col.ARTICULATED],
        link[k, col.ARTICULATED + 1],
        link[k, col.ARTICULATED + 2],
        link[k, col.ARTICULATED + 3],
        link[k, col.ARTICULATED + 4],
        link[k, col.ARTICULATED + 5],
    )


@fused
def _add_shifted_inertia(link: Array, p: int, I: PlanarInertia, d: Pair) -> None:
    """Add ``X^T I X`` to the inertia of the parent, X = [1 t; 0 1] with t = (-d_2, d_1)."""
    s, t = -d[1], d[0]
    x, y = I[3] + I[0] * s + I[1] * t, I[4] + I[1] * s + I[2] * t
    link[p, col.ARTICULATED] += I[0]
    link[p, col.ARTICULATED + 1] += I[1]
    link[p, col.ARTICULATED + 2] += I[2]
    link[p, col.ARTICULATED + 3] += x
    link[p, col.ARTICULATED + 4] += y
    link[p, col.ARTICULATED + 5] += I[5] + (I[3] + x) * s + (I[4] + y) * t


@kernel
def planar_inward_sweep(link: Array, free: Array, biased: bool) -> None:
    """Compute articulated inertias, U and D and, where `biased`, remaining joint forces; overwrites the biases."""
    for k in range(link.shape[0] - 2, -1, -1):
        I, f = load_planar_inertia(link, k), load_triple(link, k, col.BIAS)
        for n in range(int(link[k, col.LAST]) - 1, int(link[k, col.FIRST]) - 1, -1):
            s = load_triple(free, n, col.S)
            x = inertia_times(I, s)
            pivot, joint_force = planar_power(s, x), -planar_power(s, f)
            store_triple(free, n, col.U, x)
            free[n, col.PIVOT], free[n, col.JOINT_FORCE] = pivot, joint_force
            inverse = 1.0 / pivot
            I = _rank_one_update(I, x, inverse)
            joint_force *= inverse
            f = f[0] + joint_force * x[0], f[1] + joint_force * x[1], f[2] + joint_force * x[2]
        p = int(link[k, col.PARENT])
        if p >= 0:
            d = load_pair(link, k, col.OFFSET)
            _add_shifted_inertia(link, p, I, d)
            if biased:
                c = load_pair(link, k, col.VELOCITY_PRODUCT)
                x = inertia_times(I, (c[0], c[1], 0.0))
                a, b = f[0] + x[0], f[1] + x[1]
                link[p, col.BIAS] += a
                link[p, col.BIAS + 1] += b
                link[p, col.BIAS + 2] += f[2] + x[2] + d[0] * b - d[1] * a


@inner
def planar_outward_sweep(link: Array, free: Array, u: Array, velocity_terms: float) -> None:
    """Compute the accelerations of the links and, into u, of the free directions; see `arrays` for `velocity_terms`."""
    for k in range(link.shape[0] - 1):
        a, d, c = (
            load_triple(link, int(link[k, col.PARENT]), col.ACCELERATION),
            load_pair(link, k, col.OFFSET),
            load_pair(link, k, col.VELOCITY_PRODUCT),
        )
        a = a[0] - a[2] * d[1] + velocity_terms * c[0], a[1] + a[2] * d[0] + velocity_terms * c[1], a[2]
        for n in range(int(link[k, col.FIRST]), int(link[k, col.LAST])):
            s = load_triple(free, n, col.S)
            found = (free[n, col.JOINT_FORCE] - planar_power(a, load_triple(free, n, col.U))) / free[n, col.PIVOT]
            u[n] = found
            a = a[0] + found * s[0], a[1] + found * s[1], a[2] + found * s[2]
        store_triple(link, k, col.ACCELERATION, a)


@fused
def _store_row(touched: Array, row: int, W: Array, path: Array, first: int, last: int, wrench: Array) -> None:
    """Set the wrenches on the links of a path to those of a row."""
    for m in range(first, last):
        store_triple(wrench, path[m], 0, (0.0, 0.0, 0.0))
    for at in range(TOUCHED):
        k = touched[row, at]
        if k >= 0:
            for r in range(3):
                wrench[k, r] += W[row, at, r]


@inner
def planar_responses(
    group: Array,
    touched: Array,
    path: Array,
    owner: Array,
    order: Array,
    state: Array,
    layout: Array,
    W: Array,
    wrench: Array,
    F: Array,
    links: Array,
    free: Array,
) -> float:
    """Fill the fronts with the responses of the tree to the rows in use; return the largest squared norm of a column.

    Parameters
    ----------
    group, touched, path, owner, order, state, W, wrench, F : see `loop_groups.Loops`, `loop_groups.MultifrontalQR`
    layout, free : see `arrays`
    links : ndarray
        Table of the links, articulated inertias swept.
    """
    clear_fronts(group, state, F)
    for n in range(free.shape[0]):
        free[n, col.INVERSE_ROOT] = 1.0 / np.sqrt(free[n, col.PIVOT])
    largest = 0.0
    for g in range(group.shape[0]):
        first, last = group[g, PATH], group[g, PATH_END]
        for number in range(state[g, USED]):
            row, column, total = order[group[g, ROW] + number], state[g, START] + number, 0.0
            _store_row(touched, row, W, path, first, last, wrench)
            for m in range(first, last):
                k = path[m]
                p, f = layout[k, PARENT_LINK], load_triple(wrench, k, 0)
                for n in range(layout[k, FREE_END] - 1, layout[k, FREE] - 1, -1):
                    x, root = load_triple(free, n, col.U), free[n, col.INVERSE_ROOT]
                    white = planar_power(load_triple(free, n, col.S), f) * root
                    factor = white * root
                    f = f[0] - factor * x[0], f[1] - factor * x[1], f[2] - factor * x[2]
                    total += white * white
                    h = owner[n, 0]
                    F[group[h, FRONT_START] + (column - state[h, START]) * group[h, FRONT_ROWS] + owner[n, 1]] = white
                if p >= 0:
                    d = load_pair(links, k, col.OFFSET)
                    wrench[p, 0] += f[0]
                    wrench[p, 1] += f[1]
                    wrench[p, 2] += f[2] + d[0] * f[1] - d[1] * f[0]
            largest = max(largest, total)
    return largest


@kernel
def place_planar_bodies(body: Array, link: Array, y: Array, A: Array) -> None:
    """Fill y (except Euler parameters) and A of all bodies from placed links."""
    for k in range(body.shape[0]):
        b, c, s, w = int(body[k, 0]), link[k, col.COS], link[k, col.SIN], link[k, col.SPIN]
        for r in range(3):
            one, two, normal = body[k, 11 + r], body[k, 14 + r], body[k, 17 + r]
            y[b, r] = one * link[k, col.POSITION] + two * link[k, col.POSITION + 1] + normal * body[k, 1]
            y[b, 7 + r] = one * link[k, col.VELOCITY] + two * link[k, col.VELOCITY + 1]
            y[b, 10 + r] = w * body[k, 8 + r]
            for n in range(3):
                x, z = body[k, 2 + n], body[k, 5 + n]
                A[b, r, n] = one * (c * x - s * z) + two * (s * x + c * z) + normal * body[k, 8 + n]
