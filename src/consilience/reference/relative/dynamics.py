"""Equations of motion in the state z, and the projection of z onto what closes the loops, compiled.

Cut rows ``Q a = gamma`` act with ``Q^T lam``. With the whitened responses B of the tree, the zeta of least norm in
``B^T zeta = gamma - Q a_tree`` adds ``sqrt(D) zeta`` to the remaining joint forces, as in `formulations.recursive`.
"""

from __future__ import annotations

from numba import njit

from consilience.reference import constraints, forces
from consilience.reference.functions import evaluate as function_at
from consilience.reference.joint_rows import coordinate
from consilience.reference.model import Model
from consilience.reference.relative.articulated import (
    articulate,
    free_accelerations,
    free_biases,
    inertias,
    push_wrenches,
    sweep_in,
    sweep_out,
)
from consilience.reference.relative.cut_rows import (
    gather,
    joint_rows,
    open_accelerations,
    open_rates,
    size_of_rows,
)
from consilience.reference.relative.fronts import factorise, least_norm, respond, threshold
from consilience.reference.relative.kinematics import coordinate_rates, displace, normalise, place_bodies, place_links
from consilience.reference.relative.loops import ROW, ROW_END
from consilience.reference.relative.model import Links, Scratch
from consilience.reference.workspace import Workspace
from consilience.spatial import Array

_POSITION_STEPS = 3
_TINY = 1e-8
"""Violation (over the length of the mechanism) whose square is below rounding."""
_CLOSED, _HELD = 1e-14, 1e-13
"""Violations of positions and of speeds that rounding leaves."""
_WORN = 0.3
"""Part of the least pivot that a choice of rows had at first, at which rows are chosen anew."""
_PASSING = 1e-4
"""Part of its largest value at which the least independent pivot counts as passing through zero."""
_PASSING_VIOLATION = 1e-11
"""Violation that rows left out on the way through a singular pose may have."""


@njit(cache=True, error_model="numpy")
def cut_rows(links: Links, cut: Model, t: float, memory: Array, ws: Scratch, rows: Workspace) -> None:
    """Value, wrenches, gamma and rate of the cut rows of the bodies as they are placed."""
    if links.other_rows:
        constraints.evaluate(cut, t, ws.y, memory, rows)
        gather(links.loops.touched, links.layout, rows.Q, ws.A, ws.fronts.W)
        return
    joint_rows(
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
        ws.fronts.W,
        rows.value,
        rows.gamma,
    )


@njit(cache=True, error_model="numpy")
def _factorise(links: Links, ws: Scratch) -> float:
    """Factorise the responses to the rows chosen, in their order; the least pivot."""
    ws.fronts.used[:] = ws.fronts.chosen
    largest = respond(links.loops, links.layout, ws.fronts, ws.S, ws.d, ws.U, ws.D)
    return factorise(links.loops, ws.fronts, threshold(ws.size[0], largest), False)


@njit(cache=True, error_model="numpy")
def _close(links: Links, ws: Scratch, gamma: Array) -> None:
    """Joint forces that close the loops, for the accelerations of the links without them."""
    open_accelerations(links.loops.touched, ws.fronts.W, ws.acc, gamma, ws.target)
    _factorise(links, ws)
    least_norm(links.loops, ws.fronts, ws.target, ws.extra)


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
    looped = links.loops.group.shape[0] > 0
    if looped or not links.plain:
        place_bodies(index, link, ws.y, ws.A)
    if links.plain:
        free_biases(link)
    else:
        for n in range(model.control.shape[0]):
            ws.y[index.shape[0] + n // 13, n % 13] = z[links.integrals + n]
        forces.evaluate(model, t, ws.y, memory, rows)
        push_wrenches(index, rows.f, ws.A, link)
    sweep_in(link, free)
    sweep_out(link, free, ws.u, 1.0)
    if looped:
        cut_rows(links, cut, t, memory, ws, rows)
        _close(links, ws, rows.gamma)
        for n in range(ws.extra.shape[0]):
            ws.rest[n] += ws.extra[n]
        sweep_out(link, free, ws.u, 1.0)


@njit(cache=True, error_model="numpy")
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
def free_derivative(index: Array, link: Array, free: Array, first_speed: int, z: Array, dz: Array) -> None:
    """`derivative` of a tree without elements."""
    free_accelerations(link, free, z, z[first_speed:], dz[first_speed:])
    coordinate_rates(index, first_speed, z, dz)


@njit(cache=True, error_model="numpy")
def remember(model: Model, ws: Scratch, memory: Array) -> None:
    """Update the joint coordinates that elements read, turns counted, of the bodies as they are placed."""
    for n in range(memory.shape[0]):
        memory[n] = coordinate(model, ws.y, ws.A, n, memory[n]).value


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
def _articulate(links: Links, ws: Scratch) -> None:
    """Articulated inertias, bodies as they are placed."""
    inertias(ws.link)
    articulate(ws.link, ws.free)


@njit(cache=True, error_model="numpy")
def _displacements(links: Links, ws: Scratch) -> None:
    """``ws.u`` of least M-norm that changes the rows by ``ws.target``."""
    least_norm(links.loops, ws.fronts, ws.target, ws.extra)
    ws.rest[:] = ws.extra
    sweep_out(ws.link, ws.free, ws.u, 0.0)


@njit(cache=True, error_model="numpy")
def _choose_rows(links: Links, ws: Scratch, smallest: float) -> tuple[int, float, float]:
    """Factorise the responses to all rows; rank, least pivot, and the square that counted as dependent."""
    group, fronts = links.loops.group, ws.fronts
    for g in range(group.shape[0]):
        fronts.used[g] = group[g, ROW_END] - group[g, ROW]
    largest = respond(links.loops, links.layout, fronts, ws.S, ws.d, ws.U, ws.D)
    smallest = max(smallest, threshold(ws.size[0], largest))
    least = factorise(links.loops, fronts, smallest, True)
    rank = 0
    for g in range(group.shape[0]):
        rank += fronts.rank[g]
    return rank, least, smallest


@njit(cache=True, error_model="numpy")
def _choose(links: Links, model: Model, ws: Scratch, violation: float) -> None:
    """Choose the rows to work with until the next projection, and factorise the responses.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Close to it they have the
    full rank still, but what they say of the accelerations drowns in rounding. There the rows that are about to become
    dependent are left out, as in the pose itself: the motion so far has satisfied them, and does so on the way
    through. Where it does not, in a linkage that comes near such a pose and turns, they are taken back.
    """
    fronts, best = ws.fronts, ws.best
    if ws.size[0] == 0.0:
        ws.size[0] = size_of_rows(model, links.loops.touched, links.layout, fronts.W, ws.A)
    rank, least, smallest = _choose_rows(links, ws, 0.0)
    if rank > best[0]:
        best[0], best[1] = rank, least
    elif rank == best[0]:
        best[1] = max(best[1], least)
    if violation <= _PASSING_VIOLATION and least < _PASSING * best[1]:
        fewer = _choose_rows(links, ws, (_PASSING * best[1]) ** 2)[0]
        if fewer:
            rank = fewer
        else:
            _choose_rows(links, ws, smallest)
    fronts.chosen[:] = fronts.rank
    fronts.least[0] = least if rank == best[0] else 0.0
    ws.limit[0] = rank


@njit(cache=True, error_model="numpy")
def find_rank(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Independent rows of a state whose loops are closed, into ``ws.fronts``; places the bodies."""
    place_at(links, z, ws)
    if links.loops.group.shape[0]:
        cut_rows(links, cut, t, memory, ws, rows)
        _articulate(links, ws)
        _choose(links, model, ws, _violation(model, rows))


@njit(cache=True, error_model="numpy")
def _violation(model: Model, rows: Workspace) -> float:
    """Largest violation of a row that holds positions, over the length of the mechanism."""
    held = rows.value.shape[0] - 2 * model.rolling_body.shape[0] - model.skate_body.shape[0]
    return _largest(rows.value[:held]) / max(1.0, model.length)


@njit(cache=True, error_model="numpy")
def _keep(links: Links, ws: Scratch) -> bool:
    """Factorise in the order chosen before; whether that is as good a choice as it was."""
    if ws.fronts.least[0] == 0.0:
        return False
    least = _factorise(links, ws)
    for g in range(ws.fronts.rank.shape[0]):
        if ws.fronts.rank[g] < ws.fronts.chosen[g]:
            return False
    return least > _WORN * ws.fronts.least[0]


@njit(cache=True, error_model="numpy")
def _near(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> bool:
    """Projection of a state that is closed to `_TINY`, with one factorisation; whether it has come out closed.

    Coordinates move by no more than their error, so that the factors serve for the speeds too.
    """
    _articulate(links, ws)
    if not _keep(links, ws):
        return False
    for row in range(rows.value.shape[0]):
        ws.target[row] = -rows.value[row]
    _displacements(links, ws)
    displace(links.layout, z, ws.u)
    place_at(links, z, ws)
    cut_rows(links, cut, t, memory, ws, rows)
    if _violation(model, rows) > _CLOSED:  # of rows left out as dependent
        return False
    open_rates(links.loops.touched, links.layout, ws.fronts.W, ws.y, ws.A, rows.rate, ws.target)
    _displacements(links, ws)
    for n in range(ws.u.shape[0]):
        z[links.speeds + n] += ws.u[n]
    place_at(links, z, ws)
    open_rates(links.loops.touched, links.layout, ws.fronts.W, ws.y, ws.A, rows.rate, ws.target)
    return _largest(ws.target) <= _HELD * max(1.0, _largest(z[links.speeds :])) * max(1.0, model.length)


@njit(cache=True, error_model="numpy")
def project(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Bring z back to closed loops, in place: coordinates by Newton's method, then speeds, each of least M-norm.

    Leaves the bodies placed at the state it ends with.
    """
    normalise(links.layout, z)
    place_at(links, z, ws)
    if links.loops.group.shape[0] == 0:
        return
    q = rows.value.shape[0]
    held = q - 2 * model.rolling_body.shape[0] - model.skate_body.shape[0]
    last = False
    for step in range(_POSITION_STEPS + 1):
        cut_rows(links, cut, t, memory, ws, rows)
        violation = _violation(model, rows)
        if step == 0 and held == q and violation < _TINY:
            if _near(links, model, cut, t, z, memory, ws, rows):
                return
            cut_rows(links, cut, t, memory, ws, rows)
            violation = _violation(model, rows)
        if last or step == _POSITION_STEPS or violation <= 2e-16:
            break
        ws.fronts.W[held:] = 0.0
        _articulate(links, ws)
        _choose_rows(links, ws, 0.0)
        for row in range(q):
            ws.target[row] = -rows.value[row] if row < held else 0.0
        _displacements(links, ws)
        last = _largest(ws.u) < 1e-9
        displace(links.layout, z, ws.u)
        place_at(links, z, ws)
    _articulate(links, ws)
    _choose(links, model, ws, violation)
    open_rates(links.loops.touched, links.layout, ws.fronts.W, ws.y, ws.A, rows.rate, ws.target)
    _displacements(links, ws)
    for n in range(ws.u.shape[0]):
        z[links.speeds + n] += ws.u[n]
    place_at(links, z, ws)
