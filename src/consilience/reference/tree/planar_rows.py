"""Constraint rows and force elements of mechanisms that move in parallel planes.

They correspond to `bodies.joint_rows`, `bodies.constraints` and `bodies.forces` in space. A row is a function of two
links with its rate and the right side gamma of ``Q a = gamma``. An axis u fixed to link i obeys ``u'' = -w_i^2 u`` at a
constant angular velocity w_i; gamma collects these terms.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.forces import friction_effort, joint_spring_effort, spring_force
from consilience.reference.bodies.joint_rows import full_turns
from consilience.reference.kernel import functions
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import load, put
from consilience.reference.tree.arrays import LoopClosure, PlanarArrays
from consilience.reference.tree.loop_groups import TOUCHED
from consilience.reference.tree.planar import Pair, PlanarVector, pair, planar_power, rotate_pair
from consilience.reference.tree.records import (
    AXIS_DISPLACEMENT,
    AXIS_PRODUCT,
    CONTROL,
    FRICTION,
    JOINT_ANGLE,
    JOINT_SPRING,
    LOAD,
    SPRING,
)


class PlanarRow(NamedTuple):
    """A row at a state: value, rate, gamma, and the wrenches of a unit multiplier on its links i and j."""

    value: float
    rate: float
    gamma: float
    i: int
    j: int
    on_i: PlanarVector
    on_j: PlanarVector


@fused
def _cross(a: Pair, b: Pair) -> float:
    return a[0] * b[1] - a[1] * b[0]


@fused
def _dot(a: Pair, b: Pair) -> float:
    return a[0] * b[0] + a[1] * b[1]


@fused
def _between(link: Array, i: int, j: int, s_i: Pair, s_j: Pair) -> tuple[Pair, Pair, Pair]:
    """Return distance vector, velocity, and acceleration for constant w, from a point of i to a point of j."""
    r_i, r_j, v_i, v_j = (
        pair(link[i].position),
        pair(link[j].position),
        pair(link[i].velocity),
        pair(link[j].velocity),
    )
    w_i, w_j = link[i].spin, link[j].spin
    return (
        (r_j[0] + s_j[0] - r_i[0] - s_i[0], r_j[1] + s_j[1] - r_i[1] - s_i[1]),
        (v_j[0] - w_j * s_j[1] - v_i[0] + w_i * s_i[1], v_j[1] + w_j * s_j[0] - v_i[1] - w_i * s_i[0]),
        (w_i * w_i * s_i[0] - w_j * w_j * s_j[0], w_i * w_i * s_i[1] - w_j * w_j * s_j[1]),
    )


@inner
def evaluate_row(row_table: Array, n: int, link: Array, z: Array) -> PlanarRow:
    """Evaluate a row at placed links."""
    kind, i, j = row_table[n].kind, row_table[n].i, row_table[n].j
    w_i, w_j = link[i].spin, link[j].spin
    if kind == JOINT_ANGLE:
        about = row_table[n].angle_sense
        angle = z[row_table[n].angle_index]
        return PlanarRow(angle, about * (w_j - w_i), 0.0, i, j, (0.0, 0.0, -about), (0.0, 0.0, about))
    turn_i, turn_j = pair(link[i].turn), pair(link[j].turn)
    u, w = (rotate_pair(turn_i, pair(row_table[n].axis_i)), rotate_pair(turn_j, pair(row_table[n].axis_j)))
    apart, target = w_j - w_i, row_table[n].target
    if kind == AXIS_PRODUCT:
        product, torque = _dot(u, w), _cross(u, w)
        gamma = product * apart * apart
        return PlanarRow(product - target, -torque * apart, gamma, i, j, (0.0, 0.0, torque), (0.0, 0.0, -torque))
    s_i, s_j = (rotate_pair(turn_i, pair(row_table[n].arm_i)), rotate_pair(turn_j, pair(row_table[n].arm_j)))
    d, v, c = _between(link, i, j, s_i, s_j)
    reach = s_i[0] + d[0], s_i[1] + d[1]
    if kind == AXIS_DISPLACEMENT:
        rate = _dot(u, v) + w_i * _cross(u, d)
        gamma = w_i * w_i * _dot(u, d) - 2.0 * w_i * _cross(u, v) - _dot(u, c)
        value = _dot(u, d) - target
        return PlanarRow(value, rate, gamma, i, j, (-u[0], -u[1], -_cross(reach, u)), (u[0], u[1], _cross(s_j, u)))
    h = row_table[n].normal_distance
    L = np.sqrt(_dot(d, d) + h * h)
    e = d[0] / L, d[1] / L
    rate = _dot(e, v)
    gamma = -((_dot(v, v) - rate * rate) / L + _dot(e, c))
    return PlanarRow(L - target, rate, gamma, i, j, (-e[0], -e[1], -_cross(s_i, e)), (e[0], e[1], _cross(s_j, e)))


@fused
def _add_wrench(touched: Array, W: Array, row: int, link: int, factor: float, wrench: PlanarVector) -> None:
    """Add a wrench on a link, which both coordinates of a coupling may act on."""
    for at in range(TOUCHED):
        if link >= 0 and touched[row, at] == link:
            for r in range(3):
                W[row, at, r] += factor * wrench[r]


@fused
def evaluate_planar_rows(planar: PlanarArrays, closure: LoopClosure, t: float, z: Array) -> None:
    """Evaluate the active rows: first those of joints, then those of drives and couplings.

    Violations, wrenches, and the right sides of ``Q a = gamma`` and ``Q v = rate`` are overwritten.
    """
    link, row_table, active, W = closure.link, planar.row_table, closure.qr.active, closure.qr.W
    first = active.shape[0] - planar.driven.shape[0]
    for n in range(first):
        if active[n]:
            found = evaluate_row(row_table, n, link, z)
            closure.value[n], closure.gamma[n] = found.value, found.gamma
            put(W[n, 0], found.on_i)
            put(W[n, 1], found.on_j)
    for row in range(first, active.shape[0]):
        if active[row]:
            _driven_row(planar, closure, row, row - first, t, z)


@fused
def _driven_row(planar: PlanarArrays, closure: LoopClosure, row: int, n: int, t: float, z: Array) -> None:
    """Evaluate row `row`, drive or coupling n: ``q - f(t) = 0`` or ``q - f(q_driver) = 0``."""
    row_table, driven, link = planar.row_table, planar.driven, closure.link
    touched, W, gamma = closure.loops.touched, closure.qr.W, closure.gamma
    q, by = evaluate_row(row_table, driven[n].row, link, z), driven[n].driver
    for at in range(TOUCHED):
        for r in range(3):
            W[row, at, r] = 0.0
    _add_wrench(touched, W, row, q.i, 1.0, q.on_i)
    _add_wrench(touched, W, row, q.j, 1.0, q.on_j)
    if by < 0:
        f, slope, bend = functions.evaluate(planar.functions, driven[n].law, t)
        gamma[row], closure.rate[row] = q.gamma + bend, slope
    else:
        driver = evaluate_row(row_table, by, link, z)
        f, slope, bend = functions.evaluate(planar.functions, driven[n].law, driver.value)
        gamma[row] = q.gamma - slope * driver.gamma + bend * driver.rate * driver.rate
        _add_wrench(touched, W, row, driver.i, -slope, driver.on_i)
        _add_wrench(touched, W, row, driver.j, -slope, driver.on_j)
    turning = row_table[driven[n].row].kind == JOINT_ANGLE
    closure.value[row] = (full_turns(q.value, f) if turning else q.value) - f


@inner
def planar_acceleration_residual(touched: Array, W: Array, link: Array, gamma: Array, target: Array) -> None:
    """Compute ``gamma - Q a`` from the accelerations of the links.

    Parameters
    ----------
    touched, W, link : see `arrays`
    gamma : ndarray, shape (q,)
    target : ndarray, shape (q,)
        Overwritten: the residual.
    """
    for row in range(touched.shape[0]):
        total = gamma[row]
        for n in range(TOUCHED):
            k = touched[row, n]
            if k >= 0:
                total -= planar_power(load(W[row, n]), load(link[k].acceleration))
        target[row] = total


@inner
def planar_velocity_residual(touched: Array, W: Array, link: Array, rate: Array, target: Array) -> None:
    """Compute ``rate - Q v`` from the velocities of the links.

    Parameters
    ----------
    touched, W, link : see `arrays`
    rate : ndarray, shape (q,)
    target : ndarray, shape (q,)
        Overwritten: the residual.
    """
    for row in range(touched.shape[0]):
        total = rate[row]
        for n in range(TOUCHED):
            k = touched[row, n]
            if k >= 0:
                v = link[k].velocity
                total -= planar_power(load(W[row, n]), (v[0], v[1], link[k].spin))
        target[row] = total


@inner
def largest_planar_row(touched: Array, W: Array, link: Array) -> float:
    """Return the largest ``|M^(-1/2) q|`` of a row q of free links: an upper bound of its response in the tree."""
    largest = 0.0
    for row in range(touched.shape[0]):
        total = 0.0
        for n in range(TOUCHED):
            k = touched[row, n]
            if k >= 0:
                x, y, torque = W[row, n, 0], W[row, n, 1], W[row, n, 2]
                total += (x * x + y * y) / link[k].mass + torque * torque / link[k].inertia
        largest = max(largest, np.sqrt(total))
    return largest


# ---------------------------------------------------------------- efforts


@fused
def _add_to_bias(link: Array, k: int, factor: float, wrench: PlanarVector) -> None:
    """Add a wrench to the bias of a link that is not the ground."""
    if k >= 0:
        for r in range(3):
            link[k].bias[r] -= factor * wrench[r]


@fused
def _spring(force_table: Array, n: int, link: Array, actuator: float) -> None:
    """Apply ``F = (k (L - L0) + c L' - f(t)) e`` to the predecessor, its opposite to the successor."""
    i, j, h = force_table[n].i, force_table[n].j, force_table[n].normal_distance
    s_i = rotate_pair(pair(link[i].turn), pair(force_table[n].arm_i))
    s_j = rotate_pair(pair(link[j].turn), pair(force_table[n].arm_j))
    d, v, _ = _between(link, i, j, s_i, s_j)
    force = spring_force(load(force_table[n].law), actuator, (d[0], d[1], h), (v[0], v[1], 0.0))
    e = force[0], force[1]
    _add_to_bias(link, i, 1.0, (e[0], e[1], _cross(s_i, e)))
    _add_to_bias(link, j, -1.0, (e[0], e[1], _cross(s_j, e)))


@fused
def _load(force_table: Array, n: int, link: Array, factor: float) -> None:
    """Apply a force and a torque to a link, in axes of the world or of the link."""
    k = force_table[n].j
    x, y, torque = load(force_table[n].law)
    turn = pair(link[k].turn)
    force = rotate_pair(turn, (x, y)) if force_table[n].body_fixed else (x, y)
    _add_to_bias(
        link, k, factor, (force[0], force[1], torque + _cross(rotate_pair(turn, pair(force_table[n].arm_j)), force))
    )


@inner
def _joint_force(
    kind: float, law: PlanarVector, higher: Array, q: PlanarRow, given: PlanarVector, integral: float
) -> float:
    """Return the force of a spring, of friction or of a controller in a joint coordinate.

    Parameters
    ----------
    kind, law, higher
        Fields of a PLANAR_FORCE.
    q : PlanarRow
        The coordinate.
    given : PlanarVector
        Value and rate of the element's function of time.
    integral : float
        Of a controller.
    """
    if kind == JOINT_SPRING:
        return joint_spring_effort(given[0], law, higher, q.value, q.rate)
    if kind == FRICTION:
        return friction_effort(law, q.rate)
    return law[0] * (given[0] - q.value) + law[1] * integral + law[2] * (given[1] - q.rate)


@kernel
def add_force_biases(planar: PlanarArrays, link: Array, t: float, z: Array) -> None:
    """Add the force elements to the biases of placed links."""
    row_table, force_table = planar.row_table, planar.force_table
    for n in range(force_table.shape[0]):
        kind, given = force_table[n].kind, (0.0, 0.0, 0.0)
        if force_table[n].function >= 0:
            given = functions.evaluate(planar.functions, force_table[n].function, t)
        if kind == SPRING:
            _spring(force_table, n, link, given[0])
        elif kind == LOAD:
            _load(force_table, n, link, given[0] if force_table[n].function >= 0 else 1.0)
        else:
            q = evaluate_row(row_table, force_table[n].i, link, z)
            integral = z[force_table[n].j] if kind == CONTROL else 0.0
            found = _joint_force(kind, load(force_table[n].law), force_table[n].higher, q, given, integral)
            _add_to_bias(link, q.i, found, q.on_i)
            _add_to_bias(link, q.j, found, q.on_j)


@inner
def planar_coordinate_rates(planar: PlanarArrays, link: Array, first_speed: int, t: float, z: Array, dz: Array) -> None:
    """Fill the rates of the coordinates and of the integrals of controllers.

    Parameters
    ----------
    planar, link, first_speed, t, z, dz : see `arrays`
    """
    for n in range(first_speed):
        dz[n] = z[first_speed + n]
    force_table = planar.force_table
    for n in range(force_table.shape[0]):
        if force_table[n].kind == CONTROL:
            target = functions.evaluate(planar.functions, force_table[n].function, t)[0]
            q = evaluate_row(planar.row_table, force_table[n].i, link, z)
            dz[force_table[n].j] = target - q.value
