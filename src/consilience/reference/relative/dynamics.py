"""Equations of motion in the state z, and the projection of z onto what closes the loops, compiled.

Cut rows ``Q a = gamma`` act with ``Q^T lam``. With the whitened responses B of the tree, the zeta of least norm in
``B^T zeta = gamma - Q a_tree`` adds ``sqrt(D) zeta`` to the remaining joint forces, as in `formulations.recursive`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from consilience.reference import constraints, forces
from consilience.reference.factorisation import least_norm, ordered_qr, pivoted_qr
from consilience.reference.formulations.descriptor import solve_factor
from consilience.reference.functions import evaluate as function_at
from consilience.reference.joint_rows import coordinate, joint_motion, joint_row, place
from consilience.reference.model import Model
from consilience.reference.projection import rank_to_work_with
from consilience.reference.relative.articulated import (
    articulate,
    free_biases,
    inertias,
    push_wrenches,
    respond,
    sweep_in,
    sweep_out,
)
from consilience.reference.relative.kinematics import coordinate_rates, displace, normalise, place_bodies, place_links
from consilience.reference.relative.model import BODY, Links, Scratch
from consilience.reference.vectors import dot, load, rotate_back
from consilience.reference.workspace import Workspace
from consilience.spatial import Array

_POSITION_STEPS = 3


@njit(cache=True, error_model="numpy")
def _joint_rows(
    closing: Array,
    first_row: Array,
    row_kind: Array,
    row_target: Array,
    body_i: Array,
    body_j: Array,
    arm_i: Array,
    arm_j: Array,
    axes_i: Array,
    axes_j: Array,
    pitch: Array,
    y: Array,
    A: Array,
    Q: Array,
    value: Array,
    gamma: Array,
) -> None:
    """Rows of the joints that close loops."""
    for m in range(closing.shape[0]):
        k = closing[m]
        motion = joint_motion(body_i, body_j, arm_i, arm_j, y, A, k)
        for n in range(first_row[k], first_row[k + 1]):
            row = joint_row(axes_i[k], axes_j[k], pitch[k], A, motion, row_kind[n])
            value[n] = row.value - row_target[n]
            gamma[n] = row.gamma
            place(Q, n, A, motion.i, motion.j, 1.0, row)


@njit(cache=True, error_model="numpy", inline="always")
def cut_rows(links: Links, cut: Model, t: float, memory: Array, ws: Scratch, rows: Workspace) -> None:
    """Value, Q, gamma and rate of the cut rows of the bodies as they are placed."""
    if links.other_rows:
        constraints.evaluate(cut, t, ws.y, memory, rows)
        return
    rows.Q[:, :] = 0.0
    _joint_rows(
        links.closing,
        cut.first_row,
        cut.row_kind,
        cut.row_target,
        cut.body_i,
        cut.body_j,
        cut.arm_i,
        cut.arm_j,
        cut.axes_i,
        cut.axes_j,
        cut.pitch,
        ws.y,
        ws.A,
        rows.Q,
        rows.value,
        rows.gamma,
    )


@njit(cache=True, error_model="numpy")
def _open_rates(index: Array, A: Array, Q: Array, gamma: Array, acc: Array, target: Array) -> None:
    """``gamma - Q a`` of the accelerations of the links."""
    for row in range(Q.shape[0]):
        total = gamma[row]
        for k in range(index.shape[0]):
            b = index[k, BODY]
            at = 6 * b
            total -= dot(load(Q[row, at : at + 3]), load(acc[k, 0:3]))
            total -= dot(load(Q[row, at + 3 : at + 6]), rotate_back(A[b], load(acc[k, 3:6])))
        target[row] = total


@njit(cache=True, error_model="numpy")
def _close(rank: int, B: Array, tau: Array, pivot: Array, target: Array, zeta: Array, D: Array, extra: Array) -> None:
    """`extra` for the rows to change by `target`; B is factorised already, with that rank."""
    least_norm(B, tau, pivot, rank, target, zeta)
    for n in range(zeta.shape[0]):
        extra[n] = np.sqrt(D[n]) * zeta[n]


@njit(cache=True, error_model="numpy", inline="always")
def accelerations(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Fill ``ws.u``, accelerations of the free directions, and ``ws.acc``, those of all links.

    Parameters
    ----------
    rows : Workspace
        Of the cut rows; its A is that of the bodies.
    """
    index, link, free = links.layout, ws.link, ws.free
    place_links(link, free, z, z[links.speeds :])
    inertias(link)
    looped = ws.B.shape[1] > 0
    if looped or not links.plain:
        place_bodies(index, link, ws.y, ws.A)
    if links.plain:
        free_biases(link)
    else:
        for n in range(model.control.shape[0]):
            ws.y[index.shape[0] + n // 13, n % 13] = z[links.integrals + n]
        forces.evaluate(model, t, ws.y, memory, rows)
        push_wrenches(index, rows.f, ws.A, ws.bias)
    sweep_in(link, free)
    sweep_out(link, free, ws.u, 1.0)
    if looped:
        cut_rows(links, cut, t, memory, ws, rows)
        _open_rates(index, ws.A, rows.Q, rows.gamma, ws.acc, ws.target)
        # the independent rows of the last projection, in its order: see `ordered_qr`
        respond(index, rows.Q, ws.pivot, ws.limit[0], ws.A, ws.S, ws.d, ws.bias, ws.U, ws.D, ws.B)
        rank = ordered_qr(ws.B, ws.tau, ws.size[0], ws.limit[0])
        _close(rank, ws.B, ws.tau, ws.pivot, ws.target, ws.zeta, ws.D, ws.extra)
        for n in range(ws.extra.shape[0]):
            ws.rest[n] += ws.extra[n]
        sweep_out(link, free, ws.u, 1.0)


@njit(cache=True, error_model="numpy", inline="always")
def derivative(
    links: Links,
    model: Model,
    cut: Model,
    t: float,
    z: Array,
    memory: Array,
    ws: Scratch,
    rows: Workspace,
    dz: Array,
) -> None:
    """State derivative, shape of z."""
    accelerations(links, model, cut, t, z, memory, ws, rows)
    coordinate_rates(links.layout, links.speeds, z, dz)
    for n in range(ws.u.shape[0]):
        dz[links.speeds + n] = ws.u[n]
    for n in range(model.control.shape[0]):
        target = function_at(model.functions, model.control[n, 1], t)[0]
        c = model.control[n, 0]
        dz[links.integrals + n] = target - coordinate(model, ws.y, ws.A, c, memory[c]).value


@njit(cache=True, error_model="numpy")
def remember(model: Model, ws: Scratch, memory: Array) -> None:
    """Update the joint coordinates that elements read, turns counted, of the bodies as they are placed."""
    for n in range(memory.shape[0]):
        memory[n] = coordinate(model, ws.y, ws.A, n, memory[n]).value


@njit(cache=True, error_model="numpy")
def _size_of_rows(model: Model, rows: Workspace) -> float:
    """Largest ``|L^-1 q|`` of a row for bodies without joints: what its response in the tree comes to at most."""
    largest = 0.0
    for row in range(rows.Q.shape[0]):
        rows.z[:] = rows.Q[row]
        solve_factor(model, rows.z)
        total = 0.0
        for value in rows.z:
            total += value * value
        largest = max(largest, np.sqrt(total))
    return largest


@njit(cache=True, error_model="numpy")
def _largest(x: Array) -> float:
    found = 0.0
    for value in x:
        found = max(found, abs(value))
    return found


@njit(cache=True, error_model="numpy")
def place_at(links: Links, z: Array, ws: Scratch) -> None:
    """Place links and bodies at a state."""
    place_links(ws.link, ws.free, z, z[links.speeds :])
    place_bodies(links.layout, ws.link, ws.y, ws.A)


@njit(cache=True, error_model="numpy")
def _respond(links: Links, ws: Scratch, rows: Workspace) -> None:
    """Responses of the tree to the rows, bodies as they are placed."""
    inertias(ws.link)
    articulate(ws.link, ws.free)
    for row in range(rows.Q.shape[0]):
        ws.pivot[row] = row
    respond(links.layout, rows.Q, ws.pivot, rows.Q.shape[0], ws.A, ws.S, ws.d, ws.bias, ws.U, ws.D, ws.B)


@njit(cache=True, error_model="numpy")
def _displacements(links: Links, rank: int, ws: Scratch) -> None:
    """``ws.u`` of least M-norm that changes the rows by ``ws.target``."""
    _close(rank, ws.B, ws.tau, ws.pivot, ws.target, ws.zeta, ws.D, ws.extra)
    ws.rest[:] = ws.extra
    sweep_out(ws.link, ws.free, ws.u, 0.0)


@njit(cache=True, error_model="numpy")
def find_rank(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Independent rows of a state whose loops are closed, into ``ws.pivot`` and ``ws.limit``; places the bodies."""
    place_at(links, z, ws)
    if rows.Q.shape[0]:
        cut_rows(links, cut, t, memory, ws, rows)
        _choose(links, model, ws, rows)


@njit(cache=True, error_model="numpy")
def _choose(links: Links, model: Model, ws: Scratch, rows: Workspace) -> None:
    """Factorise the responses to the rows, and choose the independent ones."""
    held = rows.Q.shape[0] - 2 * model.rolling_body.shape[0] - model.skate_body.shape[0]
    if ws.size[0] == 0.0:
        ws.size[0] = _size_of_rows(model, rows)
    _respond(links, ws, rows)
    violation = _largest(rows.value[:held]) / max(1.0, model.length)
    rank = pivoted_qr(ws.B, ws.tau, ws.pivot, ws.norms, ws.size[0], rows.Q.shape[0])
    ws.limit[0] = rank_to_work_with(ws.B, ws.best, rank, violation)


@njit(cache=True, error_model="numpy")
def project(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Bring z back to closed loops, in place: coordinates by Newton's method, then speeds, each of least M-norm.

    Leaves the bodies placed at the state it ends with.
    """
    normalise(links.layout, z)
    place_at(links, z, ws)
    q = rows.Q.shape[0]
    if q == 0:
        return
    held = q - 2 * model.rolling_body.shape[0] - model.skate_body.shape[0]
    last = False
    for step in range(_POSITION_STEPS + 1):
        cut_rows(links, cut, t, memory, ws, rows)
        if last or step == _POSITION_STEPS or _largest(rows.value[:held]) <= 2e-16 * max(1.0, model.length):
            break
        rows.Q[held:, :] = 0.0
        _respond(links, ws, rows)
        rank = pivoted_qr(ws.B, ws.tau, ws.pivot, ws.norms, ws.size[0], q)
        for row in range(q):
            ws.target[row] = -rows.value[row] if row < held else 0.0
        _displacements(links, rank, ws)
        last = _largest(ws.u) < 1e-9
        displace(links.layout, z, ws.u)
        place_at(links, z, ws)
    _choose(links, model, ws, rows)
    for row in range(q):
        total = rows.rate[row]
        for b in range(model.mass.shape[0]):
            for n in range(6):
                total -= rows.Q[row, 6 * b + n] * ws.y[b, 7 + n]
        ws.target[row] = total
    _displacements(links, ws.limit[0], ws)
    for n in range(ws.u.shape[0]):
        z[links.speeds + n] += ws.u[n]
    place_at(links, z, ws)
