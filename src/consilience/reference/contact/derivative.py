"""State derivative with lasting contacts in given modes, and projection onto what lasts, compiled.

The equations are those of `equations`. Everything is one kernel, `serve`, which steppers call by address.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.forces import control_errors, count_turns
from consilience.reference.bodies.mass_metric import solve_factor, solve_factor_transposed
from consilience.reference.bodies.motion import rotations, state_rates
from consilience.reference.bodies.projection import move_bodies, normalise
from consilience.reference.contact.algebra import add_row, dot_rows, hold, least_change, project_out, satisfy
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.pairs import RowMotion, carry_tangents, move_rows
from consilience.reference.kernel.compiled import allocating, inner
from consilience.reference.kernel.operation import allocating_operation, array_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers.motion import DERIVATIVE, END_STEP

FORCES, OBSERVE, SAMPLE, MOVE, EVALUATE, FOLLOW, COLUMNS, CARRY = range(4, 12)
"""Requests to `serve`, besides those of `motion`; z is a packed state:

- compute the forces on all rows, out of shape (m,), and the rows; return the determinant of the scaled system of the
  modes (`equations.determinant`), zero where it is nearly singular;
- write gaps, rates and forces of all rows, n rows of out, at n times and states, n rows (t, y) of z;
- project n states first, which overwrites them, rows (t, y, turns), and write what `_sample` lists, too;
- evaluate the rows of contacts;
- evaluate the rows of contacts, those of joints and the applied forces;
- replace the joint coordinates by their values;
- write S and E at the last state, out of shape (2 r m,), see `_columns`;
- evaluate the rows of contacts, and carry the tangents of spheres.
"""

_CORRECTIONS = 4


class ActiveModes(NamedTuple):
    """Modes as arrays, of which the first c normals and s friction sets act."""

    acting: Array  # (2,) c and s
    normal: Array  # (n_n,) rows
    gap: Array  # (n_n,) index of each into `RowMotion.gap`
    row: Array  # (n, 2) rows; the second -1 for one row
    load: Array  # (n,) index into `normal`; -1: none
    offset: Array  # (n,)
    spring: Array  # (n,) part whose spring gives the offset; -1: it is given
    law: Array  # (n, 2) stiffness and damping of the spring
    disc: Array  # (n,) coefficient of a disc that slides; 0: the drag is given
    heading: Array  # (n, 3) world axes: t1 and t2 turn about the normal as it turns
    pair: Array  # (n,) whose t1 and t2 are those of a disc
    slow: Array  # (n,) slip below which the direction is the heading
    drag: Array  # (n, 2)
    held: Array  # (n, 2, 2) directions
    holds: Array  # (n,) number of the directions that are held
    chosen: Array  # (2, m) forces on rows and their rates: those that are undetermined are the nearest to them
    since: Array  # (1,) time of the chosen forces
    rank: Array  # (1,) limit of the rank of the joint rows
    halted: Array  # (m,) 1: the row is at rest, besides what the modes hold
    owner: Array  # (n_p,) declared contact of each pair


class ContactSystem(NamedTuple):
    """Mechanism with contacts in given modes."""

    model: Model
    pairs: Array
    limits: Array
    rows: RowMotion  # of the last state
    ws: Workspace
    modes: ActiveModes
    turns: Array  # (n_q,) joint coordinates that are read, near those of the state
    sums: Array  # (2,) units of impulses, N s, and of losses, J


def room_for_modes(layout: RowLayout, rank: Array) -> ActiveModes:
    """Allocate the arrays of modes of a layout."""
    normals, sets, m = len(layout.normals), len(layout.friction) + len(layout.springs), len(layout.names)
    return ActiveModes(
        acting=np.zeros(2, dtype=np.int64),
        normal=np.zeros(normals, dtype=np.int64),
        gap=np.zeros(normals, dtype=np.int64),
        row=np.full((sets, 2), -1),
        load=np.full(sets, -1),
        offset=np.zeros(sets),
        spring=np.full(sets, -1),
        law=np.zeros((sets, 2)),
        disc=np.zeros(sets),
        heading=np.zeros((sets, 3)),
        pair=np.zeros(sets, dtype=np.int64),
        slow=np.zeros(sets),
        drag=np.zeros((sets, 2)),
        held=np.zeros((sets, 2, 2)),
        holds=np.zeros(sets, dtype=np.int64),
        chosen=np.zeros((2, m)),
        since=np.zeros(1),
        rank=rank,
        halted=np.zeros(m, dtype=np.int64),
        owner=layout.site[3 * np.arange(len(layout.parts))],
    )


@inner
def _held_count(modes: ActiveModes) -> int:
    """Return the number of closed normals and of directions that are held."""
    count = modes.acting[0]
    for j in range(modes.acting[1]):
        count += modes.holds[j]
    return count


@inner
def _offset(modes: ActiveModes, j: int, rows: RowMotion) -> float:
    """Return the constant part of the bound of set j: the force ``k (-g) + c (-g')`` of a spring, or given."""
    k = modes.spring[j]
    if k < 0:
        return modes.offset[j]
    return -modes.law[j, 0] * rows.gap[k] - modes.law[j, 1] * rows.u[3 * k]


@inner
def _drag(modes: ActiveModes, j: int, u: Array, frame: Array) -> tuple[float, float]:
    """Return the friction of set j per unit of its bound: that of a disc along its slip, or given."""
    if modes.disc[j] == 0.0:
        return modes.drag[j, 0], modes.drag[j, 1]
    d0, d1 = dot_rows(frame[modes.pair[j], 1], modes.heading[j]), dot_rows(frame[modes.pair[j], 2], modes.heading[j])
    size = np.sqrt(d0 * d0 + d1 * d1)
    d0, d1 = d0 / size, d1 / size
    u0, u1 = u[modes.row[j, 0]], u[modes.row[j, 1]]
    speed = np.sqrt(u0 * u0 + u1 * u1)
    if speed > modes.slow[j]:
        if u0 * d0 + u1 * d1 < 0.0:  # the direction is continued through zero speed
            speed = -speed
        d0, d1 = u0 / speed, u1 / speed
    return -modes.disc[j] * d0, -modes.disc[j] * d1


@inner
def _columns(modes: ActiveModes, rows: RowMotion, S: Array, E: Array, constant: Array) -> None:
    """Write what modes say of forces and accelerations: ``p = constant + S x``, ``E u' = 0``, as rows of S and E.

    Parameters
    ----------
    modes : ActiveModes
    rows : RowMotion
    S, E : ndarray, shape (r, m)
    constant : ndarray, shape (m,)
    """
    S[:, :] = 0.0
    E[:, :] = 0.0
    constant[:] = 0.0
    for k in range(modes.acting[0]):
        S[k, modes.normal[k]] = E[k, modes.normal[k]] = 1.0
    at = modes.acting[0]
    for j in range(modes.acting[1]):
        drag, k, offset = _drag(modes, j, rows.u, rows.frame), modes.load[j], _offset(modes, j, rows)
        for axis in range(2):
            row = modes.row[j, axis]
            if row < 0:
                continue
            constant[row] += offset * drag[axis]
            if k >= 0:
                S[k, row] += drag[axis]
            for i in range(modes.holds[j]):
                S[at + i, row] = E[at + i, row] = modes.held[j, i, axis]
        at += modes.holds[j]


@allocating
def _accelerations(system: ContactSystem, t: float, y: Array, a: Array, p: Array) -> float:
    """Compute rows, accelerations and the forces on all rows in given modes; return the determinant of the modes.

    Parameters
    ----------
    system : ContactSystem
    t, y
        As in `constraints.evaluate`.
    a : ndarray, shape (6 n_b,)
        (dv/dt, dw'/dt), overwritten.
    p : ndarray, shape (m,)
        Overwritten.
    """
    model, modes, rows, ws = system.model, system.modes, system.rows, system.ws
    rotations(y, ws.A)
    move_rows(model, system.pairs, system.limits, y, system.turns, ws.A, rows)
    forces.evaluate(model, t, y, system.turns, ws)
    for i in range(a.shape[0]):
        a[i] = ws.f[i]
    solve_factor(model, a)
    load, K = rows.J.copy(), rows.J.copy()
    for r in range(p.shape[0]):
        solve_factor(model, load[r])
        K[r] = load[r]
    if ws.Q.shape[0] > 0:
        constraints.evaluate(model, t, y, system.turns, ws)
        B = ws.Q.copy()
        rank = satisfy(model, B, modes.rank[0], ws.gamma, a)
        for r in range(p.shape[0]):
            project_out(B, rank, K[r])
    count = _held_count(modes)
    S, E = np.zeros((count, p.shape[0])), np.zeros((count, p.shape[0]))
    _columns(modes, rows, S, E, p)
    for k in range(count):
        near = dot_rows(E[k], modes.chosen[0]) + (t - modes.since[0]) * dot_rows(E[k], modes.chosen[1])
        add_row(p, near, S[k])
    determinant = hold(rows.bias, load, K, a, (S, E), p) if count > 0 else 1.0
    for r in range(p.shape[0]):
        add_row(a, p[r], K[r])
    solve_factor_transposed(model, a)
    return determinant


@allocating
def _rates(system: ContactSystem, t: float, y: Array, dY: Array) -> None:
    """Write the derivative of a packed state, and of what is summed over time (`RowLayout.sums`)."""
    model, rows = system.model, system.rows
    count = y.shape[0] * y.shape[1]
    dy = dY[:count].reshape(-1, 13)
    a, p = np.zeros(6 * model.mass.shape[0]), np.zeros(rows.u.shape[0])
    _accelerations(system, t, y, a, p)
    dY[count:] = 0.0
    if model.control.shape[0]:
        control_errors(model, t, y, system.turns, system.ws, dy)
    state_rates(y, a, dy)
    for k in range(system.pairs.shape[0]):
        for axis in range(3):
            force = p[3 * k + axis] / system.sums[0]
            for i in range(3):
                dY[count + 3 * system.modes.owner[k] + i] += force * rows.frame[k, axis, i]
    for r in range(p.shape[0] if (dY.shape[0] - count) % 3 == 2 else 0):  # weights without a pattern
        dY[dY.shape[0] - 2] += math.cos(r) * p[r] / system.sums[0]
    dY[dY.shape[0] - 1] = -dot_rows(p, rows.u) / system.sums[1]


@inner
def _evaluate_rows(system: ContactSystem, t: float, y: Array) -> None:
    """Evaluate the rows of joints and of contacts."""
    rotations(y, system.ws.A)
    constraints.evaluate(system.model, t, y, system.turns, system.ws)
    move_rows(system.model, system.pairs, system.limits, y, system.turns, system.ws.A, system.rows)


@allocating
def _project_position(system: ContactSystem, t: float, y: Array) -> None:
    """Project positions onto the joints and the closed gaps by steps of least M-norm; evaluate the rows there."""
    model, modes, rows, ws = system.model, system.modes, system.rows, system.ws
    q = ws.Q.shape[0] - 2 * model.rolling.shape[0] - model.skate.shape[0]
    count = q + modes.acting[0]
    B, wanted = np.zeros((count, ws.Q.shape[1])), np.zeros(count)
    _evaluate_rows(system, t, y)
    for _ in range(_CORRECTIONS):
        most = 0.0
        for k in range(count):
            wanted[k] = -(ws.value[k] if k < q else rows.gap[modes.gap[k - q]])
            most = max(most, abs(wanted[k]))
        if most <= 2e-16 * max(1.0, model.length):
            return
        for k in range(count):
            assign(B[k], ws.Q[k] if k < q else rows.J[modes.normal[k - q]])
        move_bodies(y, least_change(model, B, wanted))
        _evaluate_rows(system, t, y)


@allocating
def _project(system: ContactSystem, t: float, y: Array) -> None:
    """Project a state onto the joints, closed gaps, sticking and halted rows, in the mass metric; count turns.

    The rank of the joints' rows is determined here, where they hold.
    """
    model, modes, rows, ws = system.model, system.modes, system.rows, system.ws
    normalise(y, model.mass.shape[0])
    q, m, held = ws.Q.shape[0], rows.J.shape[0], _held_count(modes)
    count = q + held + np.sum(modes.halted)
    if count > 0:
        _project_position(system, t, y)
        S, E = np.zeros((count - q, m)), np.zeros((count - q, m))
        _columns(modes, rows, S, E, np.zeros(m))
        for r in range(m):
            if modes.halted[r]:
                E[held, r], held = 1.0, held + 1
        B, wanted, x = np.zeros((count, ws.Q.shape[1])), np.zeros(count), np.zeros(ws.Q.shape[1])
        if q > 0:
            B[:q] = ws.Q
            modes.rank[0] = satisfy(model, B[:q], q, wanted[:q], x)
            B[:q] = ws.Q
        B[q:] = E @ rows.J
        for b in range(model.mass.shape[0]):
            for i in range(6):
                x[6 * b + i] = y[b, 7 + i]
        wanted[:] = -(B @ x)
        for k in range(q):
            wanted[k] += ws.rate[k]
        x = least_change(model, B, wanted)
        for b in range(model.mass.shape[0]):
            for i in range(6):
                y[b, 7 + i] += x[6 * b + i]
    count_turns(model, y, ws, system.turns)


@allocating
def _observe(system: ContactSystem, t: float, y: Array, found: Array) -> None:
    """Write gaps, rates and forces of all rows at a state."""
    rows, gaps, m = system.rows, system.rows.gap.shape[0], system.rows.u.shape[0]
    _accelerations(system, t, y, np.zeros(rows.J.shape[1]), found[gaps + m : gaps + 2 * m])
    assign(found[:gaps], rows.gap)
    assign(found[gaps : gaps + m], rows.u)


@inner
def _append(found: Array, at: int, values: Array) -> int:
    """Write values from a place on; return the place behind them."""
    assign(found[at : at + values.shape[0]], values)
    return at + values.shape[0]


@allocating
def _sample(system: ContactSystem, t: float, y: Array, found: Array) -> None:
    """Project a state; write gap, u and forces, then bias and J of the rows, applied forces, and the rows of joints.

    Of the joints: Q, gamma, the violations, the rates nu, and the limit of the rank.
    """
    rows, ws = system.rows, system.ws
    _project(system, t, y)
    _observe(system, t, y, found)
    at = _append(found, rows.gap.shape[0] + 2 * rows.u.shape[0], rows.bias)
    for r in range(rows.J.shape[0]):
        at = _append(found, at, rows.J[r])
    at = _append(found, at, ws.f)
    for r in range(ws.Q.shape[0]):
        at = _append(found, at, ws.Q[r])
    at = _append(found, at, ws.gamma)
    at = _append(found, at, ws.value)
    at = _append(found, at, ws.rate)
    found[at] = system.modes.rank[0]


@allocating
def _at_states(system: ContactSystem, request: int, size: int, z: Array, out: Array) -> None:
    """Answer OBSERVE or SAMPLE at states, `size` numbers each."""
    turns = system.turns
    count = z.shape[0] // (1 + size + (turns.shape[0] if request == SAMPLE else 0))
    states, found = z.reshape(count, -1), out.reshape(count, -1)
    for k in range(count):
        at, y = states[k, 0], states[k, 1 : 1 + size].reshape(-1, 13)
        if request == SAMPLE:
            assign(turns, states[k, 1 + size :])
            _sample(system, at, y, found[k])
        else:
            _observe(system, at, y, found[k])


@allocating_operation
def serve(system: ContactSystem, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests DERIVATIVE and END_STEP of `motion`, without samples, and those of this module.

    Parameters
    ----------
    system : ContactSystem
    request, t, z, out : see `motion.ask`
        The state z is packed, then `RowLayout.sums` numbers.
    """
    state, result = array_of(z), array_of(out)
    model, rows, ws = system.model, system.rows, system.ws
    bodies = model.mass.shape[0]
    size = 13 * (bodies + (model.control.shape[0] + 12) // 13)
    y = state[:size].reshape(-1, 13)
    if request == DERIVATIVE:
        _rates(system, t, y, result)
    elif request == END_STEP:
        _project(system, t, y)
    elif request == FORCES:
        return _accelerations(system, t, y, np.zeros(6 * bodies), result)
    elif request in (OBSERVE, SAMPLE):
        _at_states(system, request, size, state, result)
    elif request == COLUMNS:
        both = result.reshape(2, -1, rows.u.shape[0])
        _columns(system.modes, rows, both[0], both[1], np.zeros(rows.u.shape[0]))
    elif request == FOLLOW:
        count_turns(model, y, ws, system.turns)
    else:
        rotations(y, ws.A)
        move_rows(model, system.pairs, system.limits, y, system.turns, ws.A, rows)
        if request == EVALUATE:
            forces.evaluate(model, t, y, system.turns, ws)
            constraints.evaluate(model, t, y, system.turns, ws)
        elif request == CARRY:
            carry_tangents(system.pairs, ws.A, rows)
    return 0.0
