"""State derivative with lasting contacts in given modes, compiled; the equations are those of `equations`.

Calls from Python give the system as an array of words (`mechanism_record`).

Instead of singular values, the basis of the joint rows in the mass metric comes from Gram and Schmidt with pivoting,
each vector twice, up to the rank of the last projection.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.forces import control_errors, count_turns
from consilience.reference.bodies.mass_metric import solve_factor, solve_factor_transposed
from consilience.reference.bodies.motion import rotations, state_rates
from consilience.reference.contact.pairs import RowMotion, move_rows
from consilience.reference.kernel.compiled import allocating, inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of

RANK = 1e-9
"""Singular values of the scaled system of given modes below this count as zero: dependent contacts."""


class ActiveModes(NamedTuple):
    """Modes as arrays: c closed normals, s friction sets that act."""

    normal: Array  # (c,) rows
    row: Array  # (s, 2) rows; the second -1 for one row
    load: Array  # (s,) index into `normal`; -1: none
    offset: Array  # (s,)
    disc: Array  # (s,) coefficient of a disc that slides; 0: the drag is given
    heading: Array  # (s, 3) world axes: t1 and t2 turn about the normal as it turns
    pair: Array  # (s,) whose t1 and t2 are those of a disc
    slow: Array  # (s,) slip below which the direction is the heading
    drag: Array  # (s, 2)
    held: Array  # (s, 2, 2) directions
    holds: Array  # (s,) number of the directions that are held
    chosen: Array  # (m,) forces on rows: those that are undetermined are the nearest to them
    rank: Array  # (1,) limit of the rank of the joint rows
    owner: Array  # (n,) declared contact of each pair


class ContactSystem(NamedTuple):
    """Mechanism with contacts in given modes."""

    model: Model
    pairs: Array
    limits: Array
    rows: RowMotion  # of the last state
    ws: Workspace
    modes: ActiveModes


@inner
def _dot(a: Array, b: Array) -> float:
    """Return the scalar product of two arrays."""
    s = 0.0
    for i in range(a.shape[0]):
        s += a[i] * b[i]
    return s


@inner
def _add(into: Array, factor: float, a: Array) -> None:
    """Compute ``into += factor a``."""
    for i in range(a.shape[0]):
        into[i] += factor * a[i]


@inner
def _bring_up(B: Array, R: Array, pivot: Array, k: int) -> float:
    """Exchange row k of B for the largest of the rows from k on; return its squared norm."""
    best, most = k, -1.0
    for c in range(k, B.shape[0]):
        total = _dot(B[c], B[c])
        if total > most:
            best, most = c, total
    if best != k:
        pivot[k], pivot[best] = pivot[best], pivot[k]
        for i in range(B.shape[1]):
            B[k, i], B[best, i] = B[best, i], B[k, i]
        for i in range(k):
            R[i, k], R[i, best] = R[i, best], R[i, k]
    return most


@inner
def _orthonormal(B: Array, R: Array, pivot: Array, limit: int) -> int:
    """Orthonormalise rows of B in place, the largest first; return the rank.

    Parameters
    ----------
    B : ndarray, shape (q, n)
    R : ndarray, shape (q, q)
        Zero; then ``B[pivot[k]] = sum_i R[i, k] b_i`` with the basis b, the first rows of B afterwards.
    pivot : ndarray of int, shape (q,)
        0, 1, 2, ...; overwritten.
    limit : int
        Upper limit of the rank.
    """
    q, first = B.shape[0], 0.0
    rank = min(limit, B.shape[1], q)
    for k in range(rank):
        most = _bring_up(B, R, pivot, k)
        if k == 0:
            first = most
        if most <= RANK_TOLERANCE**2 * first:
            return k
        for j in range(k):  # once more against the basis: the row is what rounding has left of it
            s = _dot(B[j], B[k])
            R[j, k] += s
            _add(B[k], -s, B[j])
        R[k, k] = np.sqrt(_dot(B[k], B[k]))
        for i in range(B.shape[1]):
            B[k, i] /= R[k, k]
        for c in range(k + 1, q):
            R[k, c] = _dot(B[k], B[c])
            _add(B[c], -R[k, c], B[k])
    return rank


@inner
def _project_out(B: Array, rank: int, x: Array) -> None:
    """Remove from x its part along the basis, twice."""
    for _ in range(2):
        for j in range(rank):
            _add(x, -_dot(B[j], x), B[j])


@allocating
def _satisfy(B: Array, R: Array, pivot: Array, rank: int, gamma: Array, x: Array) -> None:
    """Replace the part of x along the basis by that of least norm with which the rows have the values gamma."""
    _project_out(B, rank, x)
    along = np.zeros(rank)
    for k in range(rank):
        s = gamma[pivot[k]]
        for j in range(k):
            s -= R[j, k] * along[j]
        along[k] = s / R[k, k]
        _add(x, along[k], B[k])


@inner
def _drag(modes: ActiveModes, j: int, u: Array, frame: Array) -> tuple[float, float]:
    """Return the friction of set j per unit of its bound: that of a disc along its slip, or given."""
    if modes.disc[j] == 0.0:
        return modes.drag[j, 0], modes.drag[j, 1]
    d0, d1 = _dot(frame[modes.pair[j], 1], modes.heading[j]), _dot(frame[modes.pair[j], 2], modes.heading[j])
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
    for k in range(modes.normal.shape[0]):
        S[k, modes.normal[k]] = E[k, modes.normal[k]] = 1.0
    at = modes.normal.shape[0]
    for j in range(modes.row.shape[0]):
        drag, k = _drag(modes, j, rows.u, rows.frame), modes.load[j]
        for axis in range(2):
            row = modes.row[j, axis]
            if row < 0:
                continue
            constant[row] += modes.offset[j] * drag[axis]
            if k >= 0:
                S[k, row] += drag[axis]
            for i in range(modes.holds[j]):
                S[at + i, row] = E[at + i, row] = modes.held[j, i, axis]
        at += modes.holds[j]


@allocating
def _solve(system: Array, wanted: Array) -> Array:
    """Solve a small system, of least norm where it is singular."""
    U, singular, Vt = np.linalg.svd(system)
    x = np.zeros(wanted.shape[0])
    for _ in range(2):
        left = wanted - system @ x
        for k in range(singular.shape[0]):
            if singular[k] > RANK * max(1.0, singular[0]):
                s = 0.0
                for i in range(left.shape[0]):
                    s += U[i, k] * left[i]
                for i in range(x.shape[0]):
                    x[i] += Vt[k, i] * (s / singular[k])
    return x


@allocating
def _keep_joints(model: Model, limit: int, ws: Workspace, a: Array, K: Array) -> None:
    """Let ``L^T a`` satisfy the joints' rows, and remove from rows of K what joints take; rows of joints in ``ws``.

    Parameters
    ----------
    model : Model
    limit : int
        Upper limit of the rank of the joint rows.
    ws : Workspace
    a : ndarray, shape (6 n_b,)
    K : ndarray, shape (m, 6 n_b)
    """
    q = ws.Q.shape[0]
    B, R, pivot = ws.Q.copy(), np.zeros((q, q)), np.arange(q)
    for r in range(q):
        solve_factor(model, B[r])
    rank = _orthonormal(B, R, pivot, limit)
    _satisfy(B, R, pivot, rank, ws.gamma, a)
    for r in range(K.shape[0]):
        _project_out(B, rank, K[r])


@kernel
def move(words: ContactSystem, y: Array, turns: Array) -> None:
    """Evaluate the rows of contacts at a state."""
    system = fields_of(words)
    rotations(y, system.ws.A)
    move_rows(system.model, system.pairs, system.limits, y, turns, system.ws.A, system.rows)


@kernel
def apply_forces(words: ContactSystem, t: float, y: Array, turns: Array) -> None:
    """Evaluate applied forces at a state whose rotations are known."""
    system = fields_of(words)
    forces.evaluate(system.model, t, y, turns, system.ws)


@kernel
def restrain(words: ContactSystem, t: float, y: Array, turns: Array) -> None:
    """Evaluate the rows of joints at a state."""
    system = fields_of(words)
    rotations(y, system.ws.A)
    constraints.evaluate(system.model, t, y, turns, system.ws)


@kernel
def follow_turns(words: ContactSystem, y: Array, turns: Array) -> None:
    """Replace joint coordinates by their values at a state (`count_turns`)."""
    system = fields_of(words)
    count_turns(system.model, y, system.ws, turns)


@kernel
def columns(words: ContactSystem, S: Array, E: Array, constant: Array) -> None:
    """Write what modes say at the last state, as `_columns`."""
    system = fields_of(words)
    _columns(system.modes, system.rows, S, E, constant)


@allocating
def forces_in_modes(words: ContactSystem, t: float, y: Array, turns: Array, a: Array, p: Array) -> None:
    """Compute rows, accelerations and forces in given modes, as `accelerations`."""
    accelerations(fields_of(words), t, y, turns, a, p)


@allocating
def accelerations(system: ContactSystem, t: float, y: Array, turns: Array, a: Array, p: Array) -> None:
    """Compute rows, accelerations and the forces on all rows in given modes.

    Parameters
    ----------
    system : ContactSystem
    t, y, turns
        As in `constraints.evaluate`.
    a : ndarray, shape (6 n_b,)
        (dv/dt, dw'/dt), overwritten.
    p : ndarray, shape (m,)
        Overwritten.
    """
    model, modes, rows, ws = system.model, system.modes, system.rows, system.ws
    rotations(y, ws.A)
    move_rows(model, system.pairs, system.limits, y, turns, ws.A, rows)
    forces.evaluate(model, t, y, turns, ws)
    for i in range(a.shape[0]):
        a[i] = ws.f[i]
    solve_factor(model, a)
    load, K = rows.J.copy(), rows.J.copy()
    for r in range(p.shape[0]):
        solve_factor(model, load[r])
        K[r] = load[r]
    if ws.Q.shape[0] > 0:
        constraints.evaluate(model, t, y, turns, ws)
        _keep_joints(model, modes.rank[0], ws, a, K)
    count = modes.normal.shape[0]
    for j in range(modes.row.shape[0]):
        count += modes.holds[j]
    S, E = np.zeros((count, p.shape[0])), np.zeros((count, p.shape[0]))
    _columns(modes, rows, S, E, p)
    for k in range(count):
        _add(p, _dot(E[k], modes.chosen), S[k])
    G = K @ K.T
    free = load @ a + rows.bias + G @ p
    if count > 0:
        of_row = np.abs(E) @ np.sqrt(np.sum(load * load, axis=1))
        for k in range(count):
            S[k] /= of_row[k]
            E[k] /= of_row[k]
        x = _solve(E @ (G @ np.ascontiguousarray(S.T)), -(E @ free))
        for k in range(count):
            _add(p, x[k], S[k])
    for r in range(p.shape[0]):
        _add(a, p[r], K[r])
    solve_factor_transposed(model, a)


@allocating
def rates(words: ContactSystem, t: float, Y: Array, turns: Array, dY: Array) -> None:
    """Write the derivative of the state, of the impulses of contacts, and of the energy lost.

    Parameters
    ----------
    words : ContactSystem
    t, turns
        As in `constraints.evaluate`.
    Y : ndarray
        Packed state, then impulses (n_c, 3), then the loss.
    dY : ndarray, shape of Y
        Overwritten.
    """
    system = fields_of(words)
    model, rows = system.model, system.rows
    bodies = model.mass.shape[0]
    count = 13 * (bodies + (model.control.shape[0] + 12) // 13)
    y, dy = Y[:count].reshape(-1, 13), dY[:count].reshape(-1, 13)
    a, p = np.zeros(6 * bodies), np.zeros(rows.u.shape[0])
    accelerations(system, t, y, turns, a, p)
    dY[count:] = 0.0
    if model.control.shape[0]:
        control_errors(model, t, y, turns, system.ws, dy)
    state_rates(y, a, dy)
    for k in range(system.pairs.shape[0]):
        for axis in range(3):
            for i in range(3):
                dY[count + 3 * system.modes.owner[k] + i] += p[3 * k + axis] * rows.frame[k, axis, i]
    dY[dY.shape[0] - 1] = -_dot(p, rows.u)
