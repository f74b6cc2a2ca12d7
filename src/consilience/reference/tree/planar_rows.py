"""Rows and efforts of mechanisms that move in parallel planes: `joint_rows`, `constraints` and `forces` in the plane.

A form is a function of two links, with its rate and what is quadratic in the speeds. With u and w axes turned with
their links, by the angles of the links to the power of one each, ``u'' = -w_i^2 u`` where a link turns steadily.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.joint_rows import full_turns
from consilience.reference.kernel import functions
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.functions import Functions
from consilience.reference.tree.loop_groups import TOUCHED
from consilience.reference.tree.planar import Pair, Three, dot3, pair_at, three_at, turned
from consilience.reference.tree.plane import (
    ABOUT_N,
    ACCELERATION,
    ANGLE_AT,
    APART,
    ARM_I,
    ARM_J,
    AXIS_I,
    AXIS_J,
    BIAS,
    CONTROL,
    COS,
    EFFORT,
    EFFORT_ARM_I,
    EFFORT_ARM_J,
    EFFORT_I,
    EFFORT_J,
    FRICTION,
    FUNCTION,
    INERTIA,
    KIND,
    LAW,
    LOAD,
    MASS,
    OF_JOINT,
    ON_I,
    ON_J,
    POINT,
    POSITION,
    SPIN,
    SPRING,
    SQUARE,
    TARGET,
    TURNING,
    TURNS_ALONG,
    VELOCITY,
    Plane,
)


class Form(NamedTuple):
    """A form at a state: value, rate, gamma, and wrenches on its links i and j of a unit of it."""

    value: float
    rate: float
    gamma: float
    i: int
    j: int
    on_i: Three
    on_j: Three


@fused
def _cross(a: Pair, b: Pair) -> float:
    return a[0] * b[1] - a[1] * b[0]


@fused
def _dot(a: Pair, b: Pair) -> float:
    return a[0] * b[0] + a[1] * b[1]


@fused
def _between(link: Array, i: int, j: int, s_i: Pair, s_j: Pair) -> tuple[Pair, Pair, Pair]:
    """From a point of i to one of j: way, velocity, and acceleration if both links turned steadily."""
    r_i, r_j, v_i, v_j = (
        pair_at(link, i, POSITION),
        pair_at(link, j, POSITION),
        pair_at(link, i, VELOCITY),
        pair_at(link, j, VELOCITY),
    )
    w_i, w_j = link[i, SPIN], link[j, SPIN]
    return (
        (r_j[0] + s_j[0] - r_i[0] - s_i[0], r_j[1] + s_j[1] - r_i[1] - s_i[1]),
        (v_j[0] - w_j * s_j[1] - v_i[0] + w_i * s_i[1], v_j[1] + w_j * s_j[0] - v_i[1] - w_i * s_i[0]),
        (w_i * w_i * s_i[0] - w_j * w_j * s_j[0], w_i * w_i * s_i[1] - w_j * w_j * s_j[1]),
    )


@inner
def evaluate_form(form: Array, n: int, link: Array, z: Array) -> Form:
    """A form of links that are placed."""
    kind, i, j = form[n, KIND], int(form[n, ON_I]), int(form[n, ON_J])
    w_i, w_j = link[i, SPIN], link[j, SPIN]
    if kind == TURNING:
        about = form[n, ABOUT_N]
        angle = z[int(form[n, ANGLE_AT])]
        return Form(angle, about * (w_j - w_i), 0.0, i, j, (0.0, 0.0, -about), (0.0, 0.0, about))
    turn_i, turn_j = pair_at(link, i, COS), pair_at(link, j, COS)
    u, w = turned(turn_i, pair_at(form, n, AXIS_I)), turned(turn_j, pair_at(form, n, AXIS_J))
    apart, target = w_j - w_i, form[n, TARGET]
    if kind == SQUARE:
        product, torque = _dot(u, w), _cross(u, w)
        gamma = product * apart * apart
        return Form(product - target, -torque * apart, gamma, i, j, (0.0, 0.0, torque), (0.0, 0.0, -torque))
    s_i, s_j = turned(turn_i, pair_at(form, n, ARM_I)), turned(turn_j, pair_at(form, n, ARM_J))
    d, v, c = _between(link, i, j, s_i, s_j)
    reach = s_i[0] + d[0], s_i[1] + d[1]
    if kind == POINT:
        rate = _dot(u, v) + w_i * _cross(u, d)
        gamma = w_i * w_i * _dot(u, d) - 2.0 * w_i * _cross(u, v) - _dot(u, c)
        value = _dot(u, d) - target
        return Form(value, rate, gamma, i, j, (-u[0], -u[1], -_cross(reach, u)), (u[0], u[1], _cross(s_j, u)))
    h = form[n, AXIS_J]
    L = np.sqrt(_dot(d, d) + h * h)
    e = d[0] / L, d[1] / L
    rate = _dot(e, v)
    gamma = -((_dot(v, v) - rate * rate) / L + _dot(e, c))
    return Form(L - target, rate, gamma, i, j, (-e[0], -e[1], -_cross(s_i, e)), (e[0], e[1], _cross(s_j, e)))


@fused
def _store(W: Array, row: int, at: int, a: Three) -> None:
    """Store a wrench of a row."""
    W[row, at, 0], W[row, at, 1], W[row, at, 2] = a


@inner
def _add(touched: Array, W: Array, row: int, link: int, factor: float, wrench: Three) -> None:
    """Add a wrench on a link that may be touched by both coordinates of a coupling."""
    for at in range(TOUCHED):
        if link >= 0 and touched[row, at] == link:
            for r in range(3):
                W[row, at, r] += factor * wrench[r]


@fused
def planar_rows(
    plane: Plane,
    touched: Array,
    wanted: Array,
    link: Array,
    t: float,
    z: Array,
    W: Array,
    value: Array,
    gamma: Array,
    rate: Array,
) -> None:
    """Rows wanted: wrenches, values, gammas and rates. Those of joints, then those of drives and couplings."""
    form, tied = plane.form, plane.tied
    first = wanted.shape[0] - tied.shape[0]
    for n in range(first):
        if wanted[n]:
            found = evaluate_form(form, n, link, z)
            value[n], gamma[n] = found.value, found.gamma
            _store(W, n, 0, found.on_i)
            _store(W, n, 1, found.on_j)
    for n in range(tied.shape[0]):
        if wanted[first + n]:
            _tie(plane.form, tied, plane.functions, touched, n, first + n, link, t, z, W, value, gamma, rate)


@inner
def _tie(
    form: Array,
    tied: Array,
    given: Functions,
    touched: Array,
    n: int,
    row: int,
    link: Array,
    t: float,
    z: Array,
    W: Array,
    value: Array,
    gamma: Array,
    rate: Array,
) -> None:
    """``q - f(t) = 0`` or ``q - f(q_driver) = 0``."""
    q, by = evaluate_form(form, tied[n, 0], link, z), tied[n, 1]
    for at in range(TOUCHED):
        for r in range(3):
            W[row, at, r] = 0.0
    _add(touched, W, row, q.i, 1.0, q.on_i)
    _add(touched, W, row, q.j, 1.0, q.on_j)
    if by < 0:
        f, slope, bend = functions.evaluate(given, tied[n, 2], t)
        gamma[row], rate[row] = q.gamma + bend, slope
    else:
        driver = evaluate_form(form, by, link, z)
        f, slope, bend = functions.evaluate(given, tied[n, 2], driver.value)
        gamma[row] = q.gamma - slope * driver.gamma + bend * driver.rate * driver.rate
        _add(touched, W, row, driver.i, -slope, driver.on_i)
        _add(touched, W, row, driver.j, -slope, driver.on_j)
    turning = form[tied[n, 0], KIND] == TURNING
    value[row] = (full_turns(q.value, f) if turning else q.value) - f


@inner
def open_planar_accelerations(touched: Array, W: Array, link: Array, gamma: Array, target: Array) -> None:
    """``gamma - Q a`` of the accelerations of the links."""
    _open(touched, W, link, ACCELERATION, gamma, target)


@inner
def open_planar_rates(touched: Array, W: Array, link: Array, rate: Array, target: Array) -> None:
    """``rate - Q v`` of the velocities of the links."""
    _open(touched, W, link, VELOCITY, rate, target)


@fused
def _open(touched: Array, W: Array, link: Array, at: int, given: Array, target: Array) -> None:
    for row in range(touched.shape[0]):
        total = given[row]
        for n in range(TOUCHED):
            k = touched[row, n]
            if k >= 0:
                total -= dot3((W[row, n, 0], W[row, n, 1], W[row, n, 2]), three_at(link, k, at))
        target[row] = total


@inner
def size_of_planar_rows(touched: Array, W: Array, link: Array) -> float:
    """Largest response of a row of links without joints: what its response in the tree comes to at most."""
    largest = 0.0
    for row in range(touched.shape[0]):
        total = 0.0
        for n in range(TOUCHED):
            k = touched[row, n]
            if k >= 0:
                x, y, torque = W[row, n, 0], W[row, n, 1], W[row, n, 2]
                total += (x * x + y * y) / link[k, MASS] + torque * torque / link[k, INERTIA]
        largest = max(largest, np.sqrt(total))
    return largest


# ---------------------------------------------------------------- efforts


@fused
def _exert(link: Array, k: int, factor: float, wrench: Three) -> None:
    """Add a wrench to the bias of a link; the ground takes anything."""
    if k >= 0:
        for r in range(3):
            link[k, BIAS + r] -= factor * wrench[r]


@inner
def _spring(effort: Array, n: int, link: Array, actuator: float) -> None:
    """``F = (k (L - L0) + c L' - f(t)) e`` on the predecessor, the opposite on the successor."""
    i, j, h = int(effort[n, EFFORT_I]), int(effort[n, EFFORT_J]), effort[n, APART]
    s_i = turned(pair_at(link, i, COS), pair_at(effort, n, EFFORT_ARM_I))
    s_j = turned(pair_at(link, j, COS), pair_at(effort, n, EFFORT_ARM_J))
    d, v, _ = _between(link, i, j, s_i, s_j)
    L = np.sqrt(_dot(d, d) + h * h)
    e = d[0] / L, d[1] / L
    stiffness, damping, free_length = three_at(effort, n, LAW)
    force = stiffness * (L - free_length) + damping * _dot(e, v) - actuator
    _exert(link, i, force, (e[0], e[1], _cross(s_i, e)))
    _exert(link, j, -force, (e[0], e[1], _cross(s_j, e)))


@inner
def _load(effort: Array, n: int, link: Array, factor: float) -> None:
    """A force and a torque on a link, in axes of the world or of the link."""
    k = int(effort[n, EFFORT_J])
    x, y, torque = three_at(effort, n, LAW)
    turn = pair_at(link, k, COS)
    force = turned(turn, (x, y)) if effort[n, TURNS_ALONG] else (x, y)
    _exert(
        link, k, factor, (force[0], force[1], torque + _cross(turned(turn, pair_at(effort, n, EFFORT_ARM_J)), force))
    )


@inner
def _of_coordinate(kind: float, law: Three, q: Form, given: Three, integral: float) -> float:
    """Effort of a spring, of friction or of a controller in a joint coordinate; given: its function of time."""
    if kind == OF_JOINT:
        return given[0] - law[0] * (q.value - law[2]) - law[1] * q.rate
    if kind == FRICTION:
        return -law[0] * q.rate - law[1] * np.tanh(q.rate / law[2])
    return law[0] * (given[0] - q.value) + law[1] * integral + law[2] * (given[1] - q.rate)


@kernel
def push_efforts(plane: Plane, link: Array, t: float, z: Array) -> None:
    """Add the efforts to the biases of links that are placed."""
    form, effort = plane.form, plane.effort
    for n in range(effort.shape[0]):
        kind, given = effort[n, EFFORT], (0.0, 0.0, 0.0)
        if effort[n, FUNCTION] >= 0.0:
            given = functions.evaluate(plane.functions, int(effort[n, FUNCTION]), t)
        if kind == SPRING:
            _spring(effort, n, link, given[0])
        elif kind == LOAD:
            _load(effort, n, link, given[0] if effort[n, FUNCTION] >= 0.0 else 1.0)
        else:
            q = evaluate_form(form, int(effort[n, EFFORT_I]), link, z)
            integral = z[int(effort[n, EFFORT_J])] if kind == CONTROL else 0.0
            found = _of_coordinate(kind, three_at(effort, n, LAW), q, given, integral)
            _exert(link, q.i, found, q.on_i)
            _exert(link, q.j, found, q.on_j)


@inner
def planar_rates(plane: Plane, link: Array, speeds: int, t: float, z: Array, dz: Array) -> None:
    """Rates of the coordinates, one for each direction, and of the integrals of controllers."""
    for n in range(speeds):
        dz[n] = z[speeds + n]
    effort = plane.effort
    for n in range(effort.shape[0]):
        if effort[n, EFFORT] == CONTROL:
            target = functions.evaluate(plane.functions, int(effort[n, FUNCTION]), t)[0]
            q = evaluate_form(plane.form, int(effort[n, EFFORT_I]), link, z)
            dz[int(effort[n, EFFORT_J])] = target - q.value
