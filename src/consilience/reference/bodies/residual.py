"""Residuals of constraint rows: positions ``g = 0``, velocities ``Q v = nu``; whether ``Q a = gamma`` has a solution.

A residual is compared with a size: of a length, the length of the mechanism (but at least what rounding leaves of the
distances from the world's origin); of an angle or direction cosine, one; of their rates, these times the fastest motion
so far, in lengths a second, but at least one length in the time of the motion. The ratio does not depend on units.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import DISTANCE, Model, Workspace, all_rows, workspace
from consilience.reference.bodies.constraints import rolling_contact
from consilience.reference.bodies.joint_rows import TURN, FrameMotion, frame_motion, full_turns
from consilience.reference.bodies.mass_metric import factorise, solve_factor_transposed
from consilience.reference.bodies.motion import arm, motion, rotations
from consilience.reference.kernel import functions
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.factorisation import least_norm
from consilience.reference.kernel.mechanism_record import fields_of, record_array
from consilience.reference.kernel.vectors import add, cross, dot, load

CONSISTENT = 1e-9
"""Largest ratio of residual to size of a consistent state; rounding leaves 1e-16 to 1e-12."""

SOLVABLE = 1e-6
"""Largest part of gamma that accelerations may leave: rows a little off the manifold contradict each other a little."""

POSITION, VELOCITY = 0, 1

RATIO, ROW, LEVEL, RESIDUAL, SPEED, TURNS = range(6)
"""Entries of the array `found`: the largest ratio of residual to size, its row, its level, the residual itself; the
fastest motion so far, m/s; from TURNS on, drivers of couplings at the state before, and their rates. One array, because
each costs a short motion as much as the comparison itself."""


class CheckedRows(NamedTuple):
    """Record of the kernels of this module."""

    model: Model
    others: Array | None  # empty; None where all rows are those of joints, and kernels have no code for others


def other_rows(model: Model) -> Array | None:
    """Return the mark of rows of drives, couplings, rolling bodies and skates; None where there are none."""
    return np.zeros(0) if all_rows(model) > len(model.row_kind) else None


def checked_rows(model: Model) -> CheckedRows:
    """Return the rows of a model as a record array."""
    rows: CheckedRows = record_array(CheckedRows(model, other_rows(model)))
    return rows


class SolvableRows(NamedTuple):
    """Rows of a mechanism and the work arrays in which accelerations that satisfy them are sought."""

    model: Model
    rows: CheckedRows  # a record array
    ws: Workspace


def solvable_rows(model: Model) -> SolvableRows:
    """Return the rows of a model with new work arrays."""
    return SolvableRows(model, checked_rows(model), workspace(model))


@fused
def _compare(found: Array, row: int, level: int, residual: float, size: float) -> None:
    """Keep a residual whose ratio to its size is the largest."""
    ratio = abs(residual) / size
    if ratio > found[RATIO]:
        found[RATIO], found[ROW], found[LEVEL], found[RESIDUAL] = ratio, row, level, abs(residual)


@inner
def _reach_and_speed(model: Model, y: Array, found: Array) -> float:
    """Update the fastest motion; return the size of a length."""
    far = 0.0
    for b in range(model.mass.shape[0]):
        v, w = load(y[b, 7:10]), load(y[b, 10:13])
        far = max(far, abs(y[b, 0]) + abs(y[b, 1]) + abs(y[b, 2]))
        found[SPEED] = max(found[SPEED], np.sqrt(dot(v, v)), np.sqrt(dot(w, w)) * model.length)
    return max(model.length, 1e-5 * far)


@fused
def _joint_row(kind: int, target: float, pitch: float, motion: FrameMotion) -> tuple[float, float]:
    """Return value and rate of a joint row; kind indexes `ROWS`."""
    p, X, v, w = motion
    if kind < 3:
        return p[kind] - target, v[kind]
    if kind == 3:
        distance = np.sqrt(dot(p, p))
        return distance - target, dot(p, v) / distance
    if kind == 13:
        turn = p[2] / pitch
        angle = full_turns(np.arctan2(X[0][1], X[0][0]), TURN * turn)
        return p[2] - pitch * angle / TURN, v[2] - pitch * w[2] / TURN
    k, axis = (kind - 4) // 3, X[(kind - 4) % 3]
    return axis[k] - target, cross(w, axis)[k]


@fused
def _joints(model: Model, y: Array, A: Array, length: float, found: Array) -> int:
    """Compare the rows of joints; return the index of the next row."""
    speed = found[SPEED]
    for k in range(model.body_i.shape[0]):
        if model.first_row[k] == model.first_row[k + 1]:
            continue
        motion = frame_motion(model, y, A, k)
        for n in range(model.first_row[k], model.first_row[k + 1]):
            kind = model.row_kind[n]
            value, rate = _joint_row(kind, model.row_target[n], model.pitch[k], motion)
            size = length if kind < 4 or kind == 13 else 1.0
            _compare(found, n, POSITION, value, size)
            _compare(found, n, VELOCITY, rate, speed * size / model.length)
    return model.row_kind.shape[0]


@inner
def _coordinate(model: Model, y: Array, A: Array, n: int) -> tuple[float, float]:
    """Return value and rate of joint coordinate n: angles within half a turn of zero, those of screws by Z."""
    k = model.coordinate[n].joint
    p, X, v, w = frame_motion(model, y, A, k)
    if model.coordinate[n].kind == DISTANCE:
        return p[2], v[2]
    angle = np.arctan2(X[0][1], X[0][0])
    return full_turns(angle, TURN * p[2] / model.pitch[k]) if model.pitch[k] != 0.0 else angle, w[2]


@fused
def _with_turns(model: Model, n: int, value: float, near: float) -> float:
    """Return the value of joint coordinate n with the full turns that bring an angle nearest to `near`."""
    at = model.coordinate[n]
    return value if at.kind == DISTANCE or model.pitch[at.joint] != 0.0 else full_turns(value, near)


@fused
def _drives(model: Model, t: float, y: Array, A: Array, length: float, first: int, found: Array) -> int:
    """Compare the rows of drives, `first` and on; return the index of the next row."""
    for n in range(model.drive.shape[0]):
        driven = model.drive[n].coordinate
        f, f_dot, _ = functions.evaluate(model.functions, model.drive[n].motion, t)
        value, rate = _coordinate(model, y, A, driven)
        size = length if model.coordinate[driven].kind == DISTANCE else 1.0
        found[SPEED] = max(found[SPEED], abs(f_dot) * model.length / size)
        _compare(found, first + n, POSITION, _with_turns(model, driven, value, f) - f, size)
        _compare(found, first + n, VELOCITY, rate - f_dot, found[SPEED] * size / model.length)
    return first + model.drive.shape[0]


@fused
def _couplings(model: Model, y: Array, A: Array, dt: float, length: float, first: int, found: Array) -> int:
    """Compare the rows of couplings; return the index of the next row.

    A state has no count of turns. The driver's angle continues from the state before, dt earlier, by the mean of both
    rates; where these differ by turns in that time, the counts that are possible are tried, the nearest first, until
    one fits; if none does, the one that fits best counts.
    """
    for n in range(model.coupling.shape[0]):
        coupling, at = model.coupling[n], TURNS + 2 * n
        size = length if model.coordinate[coupling.coordinate].kind == DISTANCE else 1.0
        driver, driver_rate = _coordinate(model, y, A, coupling.driver)
        q, rate = _coordinate(model, y, A, coupling.coordinate)
        near = found[at] + 0.5 * dt * (found[at + 1] + driver_rate)
        others = int(np.ceil(0.2 * dt * abs(driver_rate - found[at + 1])))
        least, least_rate, found[at], found[at + 1] = np.inf, 0.0, near, driver_rate
        for m in range(2 * others + 1):
            turn = (m + 1) // 2 if m % 2 else -(m // 2)
            angle = _with_turns(model, coupling.driver, driver, near + TURN * turn)
            f, slope, _ = functions.evaluate(model.functions, coupling.law, angle)
            left = _with_turns(model, coupling.coordinate, q, f) - f
            if abs(left) < abs(least):
                least, least_rate, found[at] = left, rate - slope * driver_rate, angle
            if abs(least) <= CONSISTENT * size:
                break
        if np.isfinite(least):
            _compare(found, first + n, POSITION, least, size)
            _compare(found, first + n, VELOCITY, least_rate, found[SPEED] * size / model.length)
    return first + model.coupling.shape[0]


@fused
def _contacts(model: Model, y: Array, A: Array, length: float, first: int, found: Array) -> None:
    """Compare the rows of rolling bodies and skates."""
    count = model.rolling.shape[0]
    for k in range(count):
        height, s, _ = rolling_contact(model, y, A, k)
        _, v, w = motion(y, A, model.rolling[k].body)
        of_point = add(v, cross(w, s))
        _compare(found, first + k, POSITION, height, length)
        for axis in range(3):
            row = first + k if axis == 0 else first + count + 2 * k + axis - 1
            _compare(found, row, VELOCITY, dot(load(model.rolling[k].plane[axis]), of_point), found[SPEED])
    for n in range(model.skate.shape[0]):
        b = model.skate[n].body
        _, v, w = motion(y, A, b)
        s, lateral = arm(A, b, load(model.skate[n].arm)), arm(A, b, load(model.skate[n].lateral))
        _compare(found, first + 3 * count + n, VELOCITY, dot(lateral, add(v, cross(w, s))), found[SPEED])


@fused
def _compare_by(
    model: Model, others: Array | None, t: float, dt: float, y: Array, A: Array, length: float, found: Array
) -> None:
    """Compare all rows of a state with the sizes that follow from a length and the fastest motion so far."""
    row = _joints(model, y, A, length, found)
    if others is not None:
        row = _drives(model, t, y, A, length, row, found)
        row = _couplings(model, y, A, dt, length, row, found)
        _contacts(model, y, A, length, row, found)


@inner
def compare_rows(model: Model, others: Array | None, t: float, dt: float, y: Array, A: Array, found: Array) -> None:
    """Compare all rows of a state with their sizes; `found` keeps the largest ratio.

    Parameters
    ----------
    model : Model
    others : ndarray or None
        See `CheckedRows`.
    t : float, s
    dt : float, s
        Time since the state before.
    y : ndarray, shape (n_b + n_e, 13)
    A : ndarray, shape (n_b, 3, 3)
        Rotation matrices of y.
    found : ndarray, shape (TURNS + 2 couplings,)
    """
    _compare_by(model, others, t, dt, y, A, _reach_and_speed(model, y, found), found)


@inner
def set_slowest(model: Model, times: Array, found: Array) -> None:
    """Set the least speed that residuals are compared with: a length in the time of the motion, or in a second."""
    span = times[times.shape[0] - 1] - times[0]
    found[SPEED] = model.length / (span if span > 0.0 else 1.0)


@kernel
def first_violation(rows: CheckedRows, times: Array, states: Array, A: Array, limit: float, found: Array) -> int:
    """Return the first of the packed states whose largest ratio is above a limit; -1: none.

    Sizes grow with the reach and speed of the bodies: most motions are below the limit already by the least sizes.

    Parameters
    ----------
    rows : CheckedRows
        As a record array.
    times : ndarray, shape (n_t,), s
    states : ndarray, shape (n_t, n_b + n_e, 13)
    A : ndarray, shape (n_b, 3, 3)
        Work array: rotation matrices.
    limit : float
    found : ndarray, shape (TURNS + 2 couplings,)
        Overwritten by the largest residual: see the module.
    """
    by = fields_of(rows)
    model, others = by.model, by.others
    for by_reach in range(2):
        found[:] = 0.0
        set_slowest(model, times, found)
        at = -1
        for n in range(times.shape[0]):
            rotations(states[n], A)
            length = _reach_and_speed(model, states[n], found) if by_reach else model.length
            since = times[n] - times[n - 1] if n else 0.0
            _compare_by(model, others, times[n], since, states[n], A, length, found)
            if found[RATIO] > limit:
                at = n
                break
        if at < 0:
            return -1
    return at


@kernel
def unsolved(rows: CheckedRows, t: float, y: Array, turns: Array, ws: Workspace, found: Array) -> None:
    """Compare what accelerations of least norm leave of gamma with the largest gamma.

    Parameters
    ----------
    rows : CheckedRows
        As a record array.
    t : float, s
    y : ndarray, shape (n_b + n_e, 13)
    turns : ndarray, shape (n_c,)
    ws : Workspace
        Overwritten.
    found : ndarray, shape (TURNS,)
        Overwritten by the largest residual: see the module.
    """
    model = fields_of(rows).model
    rotations(y, ws.A)
    constraints.evaluate(model, t, y, turns, ws)
    ws.limit[0] = ws.Q.shape[0]
    least_norm(ws.B, ws.tau, ws.pivot, factorise(model, ws), ws.gamma, ws.z)
    solve_factor_transposed(model, ws.z)
    most = 0.0
    for row in range(ws.gamma.shape[0]):
        most = max(most, abs(ws.gamma[row]) / row_size(model, row))
    for row in range(ws.gamma.shape[0]):
        left = ws.gamma[row]
        for c in range(ws.z.shape[0]):
            left -= ws.Q[row, c] * ws.z[c]
        if most > 0.0:
            _compare(found, row, VELOCITY, left, most * row_size(model, row))


@inner
def row_size(model: Model, row: int) -> float:
    """Return the length of the mechanism for a row of lengths, one for another."""
    joints, drives = model.row_kind.shape[0], model.drive.shape[0]
    if row < joints:
        return model.length if model.row_kind[row] < 4 or model.row_kind[row] == 13 else 1.0
    n = row - joints
    if n < drives:
        return model.length if model.coordinate[model.drive[n].coordinate].kind == DISTANCE else 1.0
    n -= drives
    if n < model.coupling.shape[0]:
        return model.length if model.coordinate[model.coupling[n].coordinate].kind == DISTANCE else 1.0
    return model.length
