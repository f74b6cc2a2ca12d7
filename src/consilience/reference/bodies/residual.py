"""Residuals of constraint rows: positions ``g = 0``, velocities ``Q v = nu``; whether ``Q a = gamma`` has a solution.

A residual is compared with a size: of a length, the length of the mechanism (but at least what rounding leaves of the
distances from the world's origin); of an angle or direction cosine, one; of their rates, these times the fastest motion
so far, in lengths a second, but at least one length in the time of the motion. The ratio does not depend on units.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, row_names
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import DISTANCE, ROWS, Model, Workspace, workspace
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


class SolvableRows(NamedTuple):
    """Rows of a mechanism and the work arrays in which accelerations that satisfy them are sought."""

    model: Model
    rows: CheckedRows  # a record array
    ws: Workspace


def solvable_rows(model: Model) -> SolvableRows:
    """Return the rows of a model with new work arrays."""
    return SolvableRows(model, record_array(CheckedRows(model)), workspace(model))


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
def _compare_by(model: Model, t: float, dt: float, y: Array, A: Array, length: float, found: Array) -> None:
    """Compare all rows of a state with the sizes that follow from a length and the fastest motion so far."""
    row = _joints(model, y, A, length, found)
    row = _drives(model, t, y, A, length, row, found)
    row = _couplings(model, y, A, dt, length, row, found)
    _contacts(model, y, A, length, row, found)


@inner
def compare_rows(model: Model, t: float, dt: float, y: Array, A: Array, found: Array) -> None:
    """Compare all rows of a state with their sizes; `found` keeps the largest ratio.

    Parameters
    ----------
    model : Model
    t : float, s
    dt : float, s
        Time since the state before.
    y : ndarray, shape (n_b + n_e, 13)
    A : ndarray, shape (n_b, 3, 3)
        Rotation matrices of y.
    found : ndarray, shape (TURNS + 2 couplings,)
    """
    _compare_by(model, t, dt, y, A, _reach_and_speed(model, y, found), found)


@inner
def set_slowest(model: Model, times: Array, found: Array) -> None:
    """Set the least speed that residuals are compared with: a length in the time of the motion, or in a second."""
    span = times[times.shape[0] - 1] - times[0]
    found[SPEED] = model.length / (span if span > 0.0 else 1.0)


@kernel
def _first_violation(rows: CheckedRows, times: Array, states: Array, A: Array, limit: float, found: Array) -> int:
    """Return the first of the packed states whose largest ratio is above a limit; -1: none.

    Sizes grow with the reach and speed of the bodies: most motions are below the limit already by the least sizes.
    """
    model = fields_of(rows).model
    for by_reach in range(2):
        found[:] = 0.0
        set_slowest(model, times, found)
        at = -1
        for n in range(times.shape[0]):
            rotations(states[n], A)
            length = _reach_and_speed(model, states[n], found) if by_reach else model.length
            _compare_by(model, times[n], times[n] - times[n - 1] if n else 0.0, states[n], A, length, found)
            if found[RATIO] > limit:
                at = n
                break
        if at < 0:
            return -1
    return at


@kernel
def _unsolved(rows: CheckedRows, t: float, y: Array, turns: Array, ws: Workspace, found: Array) -> None:
    """Compare what accelerations of least norm leave of gamma with the largest gamma."""
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


def _row_name(mechanism: Mechanism, model: Model, row: int) -> str:
    """Return the name of a row of a model, which may have a part of the joint rows of the mechanism."""
    joint_rows = len(model.row_kind)
    if row >= joint_rows:
        others = row_names(mechanism, [], velocities=True)[sum(len(j.rows) for j in mechanism.joints) :]
        return others[row - joint_rows]
    joint = mechanism.joints[int(np.searchsorted(model.first_row, row, side="right")) - 1]
    return f"joint '{joint.name}', constraint {ROWS[model.row_kind[row]]}"


def refuse_inconsistent(mechanism: Mechanism, model: Model, found: Array, t: float) -> None:
    """Refuse a given state for its largest ratio of residual to size.

    Raises
    ------
    InvalidInput
        With the row and its residual.
    """
    _, row, level, size = found[:SPEED]
    what = "is violated" if level == POSITION else "has a wrong rate,"
    raise InvalidInput(
        f"state of mechanism '{mechanism.name}'",
        f"at t = {t:g} s {_row_name(mechanism, model, int(row))} {what} by {size:.3g}",
        "Give a consistent state (consilience.initial_state), or let it be assembled: assemble=True.",
    )


def check_given(mechanism: Mechanism, model: Model, times: Array, y: Array) -> None:
    """Refuse a packed state y at ``times[0]`` that is not consistent.

    Raises
    ------
    InvalidInput
    """
    found, A, rows = np.zeros(TURNS + 2 * len(model.coupling)), np.empty((len(model.mass), 3, 3)), CheckedRows(model)
    if _first_violation(record_array(rows), times[:1], y[None], A, CONSISTENT, found) >= 0:
        refuse_inconsistent(mechanism, model, found, times[0])


def check_motion(
    mechanism: Mechanism, rows: CheckedRows, model: Model, times: Array, states: Array, tolerance: float, label: str
) -> None:
    """Refuse a motion with a sample at which rows are violated beyond the tolerance (and beyond `CONSISTENT`).

    Parameters
    ----------
    mechanism : Mechanism
    rows : CheckedRows
        Record array of `model`.
    model : Model
        Of the mechanism, with all rows or with those to check.
    times : ndarray, shape (n_t,), s
    states : ndarray, shape (n_t, n_b + n_e, 13)
        Packed states.
    tolerance : float
    label : str
        How the motion was computed.

    Raises
    ------
    NumericalFailure
        With the time, the row and its residual.
    """
    found, A = np.zeros(TURNS + 2 * len(model.coupling)), np.empty((len(model.mass), 3, 3))
    n = _first_violation(rows, times, states, A, max(tolerance, CONSISTENT), found)
    if n < 0:
        return
    _, row, level, size = found[:SPEED]
    what = "" if level == POSITION else "the rate of "
    raise NumericalFailure(
        f"{label}: at t = {times[n]:.6g} s {what}{_row_name(mechanism, model, int(row))} stays wrong by {size:.3g}: "
        "the constraints contradict each other there, or the mechanism locks"
    )


def check_solvable(mechanism: Mechanism, solvable: SolvableRows, t: float, y: Array) -> None:
    """Refuse a consistent packed state y at which no accelerations satisfy all rows, ``Q a = gamma``.

    Dependent rows may agree at a pose and contradict each other behind it: a mechanism can move at the pose alone, or
    drives contradict each other.

    Raises
    ------
    NumericalFailure
        With the row.
    """
    model, rows, ws = solvable
    found = np.zeros(TURNS)
    _unsolved(rows, t, y, np.zeros(len(model.coordinate)), ws, found)
    if found[RATIO] > SOLVABLE:
        raise NumericalFailure(
            f"mechanism '{mechanism.name}': at t = {t:g} s no accelerations satisfy at once "
            f"{_contradiction(mechanism, model.length, ws)}: it can move at this pose alone and locks, its velocities "
            "lead along no motion, or drives contradict each other"
        )


def _contradiction(mechanism: Mechanism, length: float, ws: Workspace) -> str:
    """Return the joints and elements with rows in the part of gamma that no accelerations reach, drives first."""
    Q = ws.Q * np.tile(np.repeat([length, 1.0], 3), len(mechanism.bodies))
    norms = np.linalg.norm(Q, axis=1)
    U, singular, _ = np.linalg.svd(Q / norms[:, None])
    unreached = U[:, int(np.sum(singular > RANK_TOLERANCE * singular[0])) :]
    left = np.abs(unreached @ (unreached.T @ (ws.gamma / norms)))
    names = [name.partition(",")[0] for name in row_names(mechanism, [], velocities=True)]
    found = dict.fromkeys(name for name, part in zip(names, left, strict=True) if part > 1e-3 * np.max(left))
    return ", ".join(sorted(found, key=lambda name: not name.startswith("drive")))
