"""Kinematics, articulated bodies and whitened responses in a plane, with three components instead of six.

The equations are those of `kinematics`, `articulated` and `multifrontal` [Featherstone 2008, table 7.1]. Motions are
(linear, angular), wrenches (force, torque), in the axes e_1, e_2, n of `planar_detection` at centres of mass. An
angular velocity w moves the end of an arm d with ``w (-d_2, d_1)``.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import load, put
from consilience.reference.tree.arrays import LoopClosure
from consilience.reference.tree.inertia import load_six
from consilience.reference.tree.loop_groups import TOUCHED
from consilience.reference.tree.multifrontal import clear_fronts

Pair = tuple[float, float]
PlanarVector = tuple[float, float, float]
"""A motion (linear, angular) or wrench (force, torque) in a plane."""

PlanarInertia = tuple[float, float, float, float, float, float]
"""Articulated inertia: xx, xy, yy, x and y with the angle, moment."""


@fused
def pair(a: Array) -> Pair:
    """Return two numbers."""
    return a[0], a[1]


@fused
def put_pair(a: Array, given: Pair) -> None:
    """Set two numbers."""
    a[0], a[1] = given


@fused
def rotate_pair(turn: Pair, a: Pair) -> Pair:
    """Rotate a vector by the angle of this cosine and sine."""
    return turn[0] * a[0] - turn[1] * a[1], turn[1] * a[0] + turn[0] * a[1]


@fused
def planar_power(a: PlanarVector, b: PlanarVector) -> float:
    """Return the power of a wrench on a motion."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@fused
def _joint_displacement(
    link: Array, free: Array, k: int, q: Array, v: Array, turn: Pair, spin: float
) -> tuple[Pair, Pair, Pair]:
    """Return displacement, velocity and velocity-product acceleration of a joint; fill s of its displacements."""
    sense, displacement, speed, bent = link[k].sense, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    for n in range(link[k].first, link[k].last - (1 if link[k].rotation_sense != 0.0 else 0)):
        e, u = rotate_pair(turn, pair(free[n].direction)), sense * v[n]
        displacement = displacement[0] + q[n] * e[0], displacement[1] + q[n] * e[1]
        speed = speed[0] + u * e[0], speed[1] + u * e[1]
        bent = bent[0] - 2.0 * u * spin * e[1], bent[1] + 2.0 * u * spin * e[0]
        put(free[n].s, (sense * e[0], sense * e[1], 0.0))
    return displacement, speed, bent


@inner
def place_planar_links(link: Array, free: Array, q: Array, v: Array) -> None:
    """Fill the fields turn to bias of all links, and s of all directions, at coordinates q and speeds v.

    Biases are of gravity alone. q may be longer than the coordinates: a whole state z will do.
    """
    for k in range(link.shape[0] - 1):
        p, sense, turn_sense, last = (link[k].parent, link[k].sense, link[k].rotation_sense, link[k].last)
        base, w_p = pair(link[p].turn), link[p].spin
        outboard, w = base, w_p
        if turn_sense != 0.0:
            angle = turn_sense * q[last - 1]
            outboard, w = rotate_pair(base, (np.cos(angle), np.sin(angle))), w_p + turn_sense * v[last - 1]
        s_p, s = (rotate_pair(base, pair(link[k].parent_arm)), rotate_pair(outboard, pair(link[k].arm)))
        x, y = w * w * s[0], w * w * s[1]
        speed = (0.0, 0.0)
        if last - link[k].first > (1 if turn_sense != 0.0 else 0):
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
            put(free[last - 1].s, (turn_sense * s[1], -turn_sense * s[0], turn_sense))
        step, v_p, r_p = ((s_p[0] - s[0], s_p[1] - s[1]), pair(link[p].velocity), pair(link[p].position))
        put_pair(link[k].turn, outboard)
        put_pair(link[k].position, (r_p[0] + step[0], r_p[1] + step[1]))
        put_pair(
            link[k].velocity, (v_p[0] - w_p * s_p[1] + w * s[1] + speed[0], v_p[1] + w_p * s_p[0] - w * s[0] + speed[1])
        )
        link[k].spin = w
        put_pair(link[k].velocity_product, (x - w_p * w_p * s_p[0], y - w_p * w_p * s_p[1]))
        put_pair(link[k].offset, step)
        m = link[k].mass
        put(link[k].articulated[:3], (m, 0.0, m))
        put(link[k].articulated[3:], (0.0, 0.0, link[k].inertia))
        put(link[k].bias, (-link[k].weight[0], -link[k].weight[1], 0.0))


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
def _add_shifted_inertia(link: Array, p: int, I: PlanarInertia, d: Pair) -> None:
    """Add ``X^T I X`` to the inertia of the parent, X = [1 t; 0 1] with t = (-d_2, d_1)."""
    s, t = -d[1], d[0]
    x, y = I[3] + I[0] * s + I[1] * t, I[4] + I[1] * s + I[2] * t
    link[p].articulated[0] += I[0]
    link[p].articulated[1] += I[1]
    link[p].articulated[2] += I[2]
    link[p].articulated[3] += x
    link[p].articulated[4] += y
    link[p].articulated[5] += I[5] + (I[3] + x) * s + (I[4] + y) * t


@kernel
def planar_inward_sweep(link: Array, free: Array, biased: bool) -> None:
    """Compute articulated inertias, U and D and, where `biased`, remaining joint forces; overwrites the biases."""
    for k in range(link.shape[0] - 2, -1, -1):
        I, f = load_six(link[k].articulated), load(link[k].bias)
        for n in range(link[k].last - 1, link[k].first - 1, -1):
            s = load(free[n].s)
            x = inertia_times(I, s)
            pivot, joint_force = planar_power(s, x), -planar_power(s, f)
            put(free[n].U, x)
            free[n].pivot, free[n].joint_force = pivot, joint_force
            inverse = 1.0 / pivot
            I = _rank_one_update(I, x, inverse)
            joint_force *= inverse
            f = f[0] + joint_force * x[0], f[1] + joint_force * x[1], f[2] + joint_force * x[2]
        p = link[k].parent
        if p >= 0:
            d = pair(link[k].offset)
            _add_shifted_inertia(link, p, I, d)
            if biased:
                c = pair(link[k].velocity_product)
                x = inertia_times(I, (c[0], c[1], 0.0))
                a, b = f[0] + x[0], f[1] + x[1]
                link[p].bias[0] += a
                link[p].bias[1] += b
                link[p].bias[2] += f[2] + x[2] + d[0] * b - d[1] * a


@inner
def planar_outward_sweep(link: Array, free: Array, u: Array, velocity_terms: float) -> None:
    """Compute the accelerations of the links and, into u, of the free directions; see `arrays` for `velocity_terms`."""
    for k in range(link.shape[0] - 1):
        a, d, c = (load(link[link[k].parent].acceleration), pair(link[k].offset), pair(link[k].velocity_product))
        a = a[0] - a[2] * d[1] + velocity_terms * c[0], a[1] + a[2] * d[0] + velocity_terms * c[1], a[2]
        for n in range(link[k].first, link[k].last):
            s = load(free[n].s)
            found = (free[n].joint_force - planar_power(a, load(free[n].U))) / free[n].pivot
            u[n] = found
            a = a[0] + found * s[0], a[1] + found * s[1], a[2] + found * s[2]
        put(link[k].acceleration, a)


@fused
def _store_row(touched: Array, row: int, W: Array, path: Array, first: int, last: int, wrench: Array) -> None:
    """Set the wrenches on the links of a path to those of a row."""
    for m in range(first, last):
        put(wrench[path[m]], (0.0, 0.0, 0.0))
    for at in range(TOUCHED):
        k = touched[row, at]
        if k >= 0:
            for r in range(3):
                wrench[k, r] += W[row, at, r]


@inner
def planar_responses(closure: LoopClosure) -> float:
    """Fill the fronts with the responses of the tree to the rows in use; return the largest squared norm of a column.

    Articulated inertias are swept.
    """
    loops, qr, link, free = closure.loops, closure.qr, closure.link, closure.free
    group, owner, path, state, wrench, F = loops.group, loops.owner, loops.path, qr.state, qr.wrench, qr.F
    clear_fronts(group, state, F)
    for n in range(free.shape[0]):
        free[n].inverse_root = 1.0 / np.sqrt(free[n].pivot)
    largest = 0.0
    for g in range(group.shape[0]):
        first, last = group[g].path, group[g].path_end
        for number in range(state[g].used):
            row, column, total = qr.order[group[g].row + number], state[g].start + number, 0.0
            _store_row(loops.touched, row, qr.W, path, first, last, wrench)
            for m in range(first, last):
                k = path[m]
                p, f = link[k].parent, load(wrench[k])
                for n in range(link[k].last - 1, link[k].first - 1, -1):
                    x, root = load(free[n].U), free[n].inverse_root
                    white = planar_power(load(free[n].s), f) * root
                    factor = white * root
                    f = f[0] - factor * x[0], f[1] - factor * x[1], f[2] - factor * x[2]
                    total += white * white
                    h = owner[n, 0]
                    F[group[h].front_start + (column - state[h].start) * group[h].front_rows + owner[n, 1]] = white
                if p >= 0:
                    d = pair(link[k].offset)
                    wrench[p, 0] += f[0]
                    wrench[p, 1] += f[1]
                    wrench[p, 2] += f[2] + d[0] * f[1] - d[1] * f[0]
            largest = max(largest, total)
    return largest


@kernel
def place_planar_bodies(body: Array, link: Array, y: Array, A: Array) -> None:
    """Fill y (except Euler parameters) and A of all bodies from placed links."""
    for k in range(body.shape[0]):
        b, c, s, w = int(body[k, 0]), link[k].turn[0], link[k].turn[1], link[k].spin
        for r in range(3):
            one, two, normal = body[k, 11 + r], body[k, 14 + r], body[k, 17 + r]
            y[b, r] = one * link[k].position[0] + two * link[k].position[1] + normal * body[k, 1]
            y[b, 7 + r] = one * link[k].velocity[0] + two * link[k].velocity[1]
            y[b, 10 + r] = w * body[k, 8 + r]
            for n in range(3):
                x, z = body[k, 2 + n], body[k, 5 + n]
                A[b, r, n] = one * (c * x - s * z) + two * (s * x + c * z) + normal * body[k, 8 + n]
