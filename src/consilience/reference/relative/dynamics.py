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
from consilience.reference.relative.columns import REST
from consilience.reference.relative.cut_rows import (
    gather,
    joint_rows,
    open_accelerations,
    open_rates,
    size_of_rows,
)
from consilience.reference.relative.fronts import factorise, least_norm, respond, threshold
from consilience.reference.relative.kinematics import coordinate_rates, displace, normalise, place
from consilience.reference.relative.loops import ROW, ROW_END, Fronts, Loops
from consilience.reference.relative.model import Links, Scratch
from consilience.reference.workspace import Workspace
from consilience.spatial import Array

_POSITION_STEPS = 3
_PASSING = 1e-4
"""Part of its largest value at which the least independent pivot counts as passing through zero."""
_PASSING_VIOLATION = 1e-11
"""Violation that rows left out on the way through a singular pose may have."""


@njit(cache=True, error_model="numpy", inline="always")
def cut_rows(links: Links, cut: Model, t: float, memory: Array, ws: Scratch, rows: Workspace) -> None:
    """Value, wrenches, gamma and rate of the cut rows of the bodies as they are placed."""
    if links.other_rows:
        constraints.evaluate(cut, t, ws.y, memory, rows)
        gather(links.loops.touched, links.layout, rows.Q, ws.A, ws.fronts.W)
    else:
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
def _close(loops: Loops, layout: Array, link: Array, free: Array, fronts: Fronts, gamma: Array, size: float) -> None:
    """Joint forces that close the loops, for the accelerations of the links without them, added to the others."""
    open_accelerations(loops.touched, fronts.W, link, gamma, fronts.target)
    fronts.used[:] = fronts.chosen
    largest = respond(loops, layout, fronts, link, free)
    factorise(loops, fronts, threshold(size, largest), False)
    least_norm(loops, fronts, fronts.target, fronts.extra)
    for n in range(free.shape[0]):
        free[n, REST] += fronts.extra[n]


@njit(cache=True, error_model="numpy", inline="always")
def accelerations(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Fill ``ws.u``, accelerations of the free directions, and those of all links in their rows.

    Parameters
    ----------
    rows : Workspace
        Of the cut rows; its A is that of the bodies.
    """
    index, link, free = links.layout, ws.link, ws.free
    place(index, link, free, links.speeds, z, ws.y, ws.A)
    inertias(link)
    if links.plain:
        free_biases(link)
    else:
        for n in range(model.control.shape[0]):
            ws.y[index.shape[0] + n // 13, n % 13] = z[links.integrals + n]
        forces.evaluate(model, t, ws.y, memory, rows)
        push_wrenches(index, rows.f, ws.A, link)
    sweep_in(link, free)
    sweep_out(link, free, ws.u, 1.0)
    if links.loops.group.shape[0] > 0:
        cut_rows(links, cut, t, memory, ws, rows)
        _close(links.loops, index, link, free, ws.fronts, rows.gamma, ws.size[0])
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
def free_derivative(index: Array, link: Array, free: Array, first_speed: int, z: Array, dz: Array) -> None:
    """`derivative` of a tree without elements."""
    free_accelerations(link, free, z, z[first_speed:], dz[first_speed:])
    coordinate_rates(index, first_speed, z, dz)


@njit(cache=True, error_model="numpy")
def remember(model: Model, y: Array, A: Array, memory: Array) -> None:
    """Update the joint coordinates that elements read, turns counted, of the bodies as they are placed."""
    for n in range(memory.shape[0]):
        memory[n] = coordinate(model, y, A, n, memory[n]).value


@njit(cache=True, error_model="numpy")
def _largest(x: Array) -> float:
    found = 0.0
    for value in x:
        found = max(found, abs(value))
    return found


@njit(cache=True, error_model="numpy")
def _articulate(link: Array, free: Array) -> None:
    """Articulated inertias, bodies as they are placed."""
    inertias(link)
    articulate(link, free)


@njit(cache=True, error_model="numpy")
def _displacements(loops: Loops, fronts: Fronts, link: Array, free: Array, u: Array) -> None:
    """Displacements u of least M-norm that change the rows by the target of the fronts."""
    least_norm(loops, fronts, fronts.target, fronts.extra)
    for n in range(free.shape[0]):
        free[n, REST] = fronts.extra[n]
    sweep_out(link, free, u, 0.0)


@njit(cache=True, error_model="numpy")
def _choose_rows(
    loops: Loops, layout: Array, fronts: Fronts, link: Array, free: Array, smallest: float, size: float
) -> tuple[int, float, float]:
    """Factorise the responses to all rows; rank, least pivot, and the square that counted as dependent."""
    group = loops.group
    for g in range(group.shape[0]):
        fronts.used[g] = group[g, ROW_END] - group[g, ROW]
    largest = respond(loops, layout, fronts, link, free)
    smallest = max(smallest, threshold(size, largest))
    least = factorise(loops, fronts, smallest, True)
    rank = 0
    for g in range(group.shape[0]):
        rank += fronts.rank[g]
    return rank, least, smallest


@njit(cache=True, error_model="numpy")
def _choose(
    loops: Loops,
    layout: Array,
    fronts: Fronts,
    link: Array,
    free: Array,
    size: float,
    best: Array,
    limit: Array,
    violation: float,
) -> None:
    """Choose the rows to work with until the next projection, and factorise the responses.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Close to it they have the
    full rank still, but what they say of the accelerations drowns in rounding. There the rows that are about to become
    dependent are left out, as in the pose itself: the motion so far has satisfied them, and does so on the way
    through. Where it does not, in a linkage that comes near such a pose and turns, they are taken back.
    """
    rank, least, smallest = _choose_rows(loops, layout, fronts, link, free, 0.0, size)
    if rank > best[0]:
        best[0], best[1] = rank, least
    elif rank == best[0]:
        best[1] = max(best[1], least)
    if violation <= _PASSING_VIOLATION and least < _PASSING * best[1]:
        passing = (_PASSING * best[1]) ** 2
        fewer = _choose_rows(loops, layout, fronts, link, free, passing, size)[0]
        if fewer:
            rank = fewer
        else:
            _choose_rows(loops, layout, fronts, link, free, smallest, size)
    fronts.chosen[:] = fronts.rank
    limit[0] = rank


@njit(cache=True, error_model="numpy", inline="always")
def _measure(links: Links, model: Model, ws: Scratch) -> None:
    """Size of the rows, once: what says which of them depend on others."""
    if ws.size[0] == 0.0:
        fronts = ws.fronts
        ws.size[0] = size_of_rows(model.mass, model.inertia_factor, links.loops.touched, links.layout, fronts.W, ws.A)


@njit(cache=True, error_model="numpy")
def find_rank(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Independent rows of a state whose loops are closed, into ``ws.fronts``; places the bodies."""
    loops, layout, fronts, link, free = links.loops, links.layout, ws.fronts, ws.link, ws.free
    place(layout, link, free, links.speeds, z, ws.y, ws.A)
    if loops.group.shape[0]:
        cut_rows(links, cut, t, memory, ws, rows)
        _measure(links, model, ws)
        _articulate(link, free)
        violation = _largest(rows.value[: links.held]) / max(1.0, model.length)
        _choose(loops, layout, fronts, link, free, ws.size[0], ws.best, ws.limit, violation)


@njit(cache=True, error_model="numpy")
def project(
    links: Links, model: Model, cut: Model, t: float, z: Array, memory: Array, ws: Scratch, rows: Workspace
) -> None:
    """Bring z back to closed loops, in place: coordinates by Newton's method, then speeds, each of least M-norm.

    Newton's method goes on until rounding is reached: in a flat parallelogram, whose coordinates violate the rows by
    their square, a violation of 1e-14 is a coordinate that is wrong by 1e-7. Leaves the bodies placed at the state it
    ends with.
    """
    loops, layout, fronts, link, free = links.loops, links.layout, ws.fronts, ws.link, ws.free
    normalise(layout, z)
    place(layout, link, free, links.speeds, z, ws.y, ws.A)
    if loops.group.shape[0] == 0:
        return
    held, last, violation = links.held, False, 0.0
    for step in range(_POSITION_STEPS + 1):
        cut_rows(links, cut, t, memory, ws, rows)
        _measure(links, model, ws)
        _articulate(link, free)
        violation = _largest(rows.value[:held]) / max(1.0, model.length)
        if last or step == _POSITION_STEPS or violation <= 2e-16:
            break
        fronts.W[held:] = 0.0
        _choose_rows(loops, layout, fronts, link, free, 0.0, ws.size[0])
        fronts.target[:] = 0.0
        for row in range(held):
            fronts.target[row] = -rows.value[row]
        _displacements(loops, fronts, link, free, ws.u)
        last = _largest(ws.u) < 1e-9
        displace(layout, z, ws.u)
        place(layout, link, free, links.speeds, z, ws.y, ws.A)
    _choose(loops, layout, fronts, link, free, ws.size[0], ws.best, ws.limit, violation)
    open_rates(loops.touched, layout, fronts.W, ws.y, ws.A, rows.rate, fronts.target)
    _displacements(loops, fronts, link, free, ws.u)
    for n in range(ws.u.shape[0]):
        z[links.speeds + n] += ws.u[n]
    place(layout, link, free, links.speeds, z, ws.y, ws.A)
