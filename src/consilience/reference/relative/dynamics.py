"""Equations of motion in the state z, and the projection of z onto what closes the loops, compiled.

Cut rows ``Q a = gamma`` act with ``Q^T lam``. With the whitened responses B of the tree, the zeta of least norm in
``B^T zeta = gamma - Q a_tree`` adds ``sqrt(D) zeta`` to the remaining joint forces, as in `formulations.recursive`.
"""

from __future__ import annotations

from consilience.reference import constraints, forces
from consilience.reference.compiled import inlined, inner, kernel
from consilience.reference.functions import evaluate as function_at
from consilience.reference.joint_rows import coordinate
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
    want,
)
from consilience.reference.relative.fronts import CHOOSE, KEEP, factorise, least_norm, respond, threshold
from consilience.reference.relative.kinematics import coordinate_rates, displace, normalise, place
from consilience.reference.relative.loops import CHOSEN, RANK, ROW, ROW_END, USED, Fronts, Loops
from consilience.reference.relative.model import Elements, Rest, Tree
from consilience.spatial import Array

_POSITION_STEPS = 3
_PASSING = 1e-4
"""Part of its largest value at which the least independent pivot counts as passing through zero."""
_SOUND = 0.01
"""The same, at which rounding of the pose counts: with 1e-4 a parallelogram loses two digits where it is flat."""
_PASSING_VIOLATION = 1e-11
"""Violation that rows left out on the way through a singular pose may have."""


@inlined
def cut_rows(rest: Rest, elements: Elements | None, t: float) -> None:
    """Value, wrenches, gamma and rate of the cut rows of the bodies as they are placed."""
    if elements is not None and elements.other_rows:
        constraints.evaluate(elements.cut, t, rest.y, elements.memory, elements.rows)
        gather(rest.loops.touched, rest.layout, elements.rows.Q, rest.A, rest.fronts.W)
    else:
        joint_rows(rest.joints, rest.fronts.wanted, rest.y, rest.A, rest.fronts.W, rest.value, rest.gamma)


@inlined
def _respond(loops: Loops, layout: Array, fronts: Fronts, link: Array, free: Array) -> float:
    """`respond` with the arrays of loops and fronts."""
    return respond(
        loops.group,
        loops.touched,
        loops.path,
        loops.home,
        fronts.order,
        fronts.state,
        layout,
        fronts.W,
        fronts.wrench,
        fronts.F,
        link,
        free,
    )


@inlined
def _least_norm(loops: Loops, fronts: Fronts, free: Array) -> None:
    """`least_norm` for the target of the fronts."""
    least_norm(
        loops.group,
        loops.batch,
        fronts.order,
        fronts.state,
        fronts.F,
        fronts.tau,
        fronts.x,
        fronts.y,
        fronts.target,
        free,
    )


@inlined
def _close(loops: Loops, layout: Array, link: Array, free: Array, fronts: Fronts, gamma: Array, size: float) -> None:
    """Joint forces that close the loops, for the accelerations of the links without them, added to the others."""
    state = fronts.state
    open_accelerations(loops.touched, fronts.W, link, gamma, fronts.target)
    for g in range(loops.group.shape[0]):
        state[g, USED] = state[g, CHOSEN]
    largest = _respond(loops, layout, fronts, link, free)
    factorise(loops.group, fronts.order, state, fronts.F, fronts.tau, threshold(size, largest), KEEP)
    _least_norm(loops, fronts, free)


@inlined
def _push(elements: Elements, layout: Array, y: Array, A: Array, t: float, z: Array, link: Array) -> None:
    """Biases of the forces of elements."""
    model, first = elements.model, elements.integrals
    for n in range(model.control.shape[0]):
        y[layout.shape[0] + n // 13, n % 13] = z[first + n]
    forces.evaluate(model, t, y, elements.memory, elements.rows)
    push_wrenches(layout, elements.rows.f, A, link)


@inlined
def accelerations(rest: Rest, elements: Elements | None, t: float, z: Array) -> None:
    """Fill ``rest.u``, accelerations of the free directions, and those of all links in their rows."""
    layout, link, free, u = rest.layout, rest.link, rest.free, rest.u
    place(layout, link, free, rest.speeds, z, rest.y, rest.A)
    inertias(link)
    if elements is not None and not elements.plain:
        _push(elements, layout, rest.y, rest.A, t, z, link)
    else:
        free_biases(link)
    sweep_in(link, free)
    sweep_out(link, free, u, 1.0)
    if rest.loops.group.shape[0] > 0:
        want(rest.loops.group, rest.fronts.order, rest.fronts.state, rest.fronts.wanted)
        cut_rows(rest, elements, t)
        _close(rest.loops, layout, link, free, rest.fronts, rest.gamma, rest.size[0])
        sweep_out(link, free, u, 1.0)


@inlined
def _control_errors(elements: Elements, y: Array, A: Array, t: float, dz: Array) -> None:
    """Derivatives of the integrals of controllers."""
    model, memory, first = elements.model, elements.memory, elements.integrals
    for n in range(model.control.shape[0]):
        target = function_at(model.functions, model.control[n, 1], t)[0]
        c = model.control[n, 0]
        dz[first + n] = target - coordinate(model, y, A, c, memory[c]).value


@inner
def derivative(rest: Rest, elements: Elements | None, t: float, z: Array, dz: Array) -> None:
    """State derivative, shape of z."""
    accelerations(rest, elements, t, z)
    coordinate_rates(rest.layout, rest.speeds, z, dz)
    for n in range(rest.u.shape[0]):
        dz[rest.speeds + n] = rest.u[n]
    if elements is not None:
        _control_errors(elements, rest.y, rest.A, t, dz)


@kernel
def free_derivative(index: Array, link: Array, free: Array, first_speed: int, z: Array, dz: Array) -> None:
    """`derivative` of a tree without elements."""
    free_accelerations(link, free, z, z[first_speed:], dz[first_speed:])
    coordinate_rates(index, first_speed, z, dz)


@inlined
def rates(tree: Tree, rest: Rest | None, elements: Elements | None, t: float, z: Array, dz: Array) -> None:
    """State derivative of any mechanism."""
    if rest is None:
        free_derivative(tree.layout, tree.link, tree.free, tree.speeds, z, dz)
    else:
        derivative(rest, elements, t, z, dz)


@kernel
def remember(elements: Elements, y: Array, A: Array) -> None:
    """Update the joint coordinates that elements read, turns counted, of the bodies as they are placed."""
    model, memory = elements.model, elements.memory
    for n in range(memory.shape[0]):
        memory[n] = coordinate(model, y, A, n, memory[n]).value


@kernel
def _largest(x: Array, count: int) -> float:
    """Largest size of the first numbers of an array."""
    found = 0.0
    for n in range(count):
        found = max(found, abs(x[n]))
    return found


@inlined
def _articulate(link: Array, free: Array) -> None:
    """Articulated inertias, bodies as they are placed."""
    inertias(link)
    articulate(link, free)


@inner
def _displacements(loops: Loops, fronts: Fronts, link: Array, free: Array, u: Array) -> None:
    """Displacements u of least M-norm that change the rows by the target of the fronts."""
    for n in range(free.shape[0]):
        free[n, REST] = 0.0
    _least_norm(loops, fronts, free)
    sweep_out(link, free, u, 0.0)


@inner
def _choose_rows(
    loops: Loops, layout: Array, fronts: Fronts, link: Array, free: Array, smallest: float, size: float
) -> tuple[int, float, float]:
    """Factorise the responses to all rows; rank, least pivot, and the square that counted as dependent."""
    group, state = loops.group, fronts.state
    for g in range(group.shape[0]):
        state[g, USED] = group[g, ROW_END] - group[g, ROW]
    largest = _respond(loops, layout, fronts, link, free)
    smallest = max(smallest, threshold(size, largest))
    least = factorise(group, fronts.order, state, fronts.F, fronts.tau, smallest, CHOOSE)
    rank = 0
    for g in range(group.shape[0]):
        rank += state[g, RANK]
    return rank, least, smallest


@kernel
def _work_with(loops: Loops, fronts: Fronts, rank: int, limit: Array) -> None:
    """Rows chosen until the next projection: those that are independent in the present factors."""
    for g in range(loops.group.shape[0]):
        fronts.state[g, CHOSEN] = fronts.state[g, RANK]
    limit[0] = rank


@inner
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
    _work_with(loops, fronts, rank, limit)


@kernel
def _keep(loops: Loops, fronts: Fronts, rank: int, least: float, best: Array, limit: Array) -> bool:
    """Go on with the factors of a pose that is apart by rounding, if they have the rank so far, far from losing it."""
    if rank != best[0] or least < _SOUND * best[1]:
        return False
    best[1] = max(best[1], least)
    _work_with(loops, fronts, rank, limit)
    return True


@inlined
def _measure(rest: Rest) -> None:
    """Size of the rows, once: what says which of them depend on others."""
    if rest.size[0] == 0.0:
        rest.size[0] = size_of_rows(
            rest.mass, rest.inertia_factor, rest.loops.touched, rest.layout, rest.fronts.W, rest.A
        )


@inner
def _opened(rest: Rest, elements: Elements | None, t: float) -> float:
    """Cut rows of the bodies as they are placed; their violation."""
    rest.fronts.wanted[:] = 1
    cut_rows(rest, elements, t)
    _measure(rest)
    return _largest(rest.value, rest.held) / max(1.0, rest.length)


@kernel
def _release(W: Array, held: int) -> None:
    """Take away the wrenches of the rows that hold no positions."""
    for row in range(held, W.shape[0]):
        for n in range(W.shape[1]):
            for r in range(W.shape[2]):
                W[row, n, r] = 0.0


@kernel
def find_rank(rest: Rest, elements: Elements | None, t: float, z: Array) -> None:
    """Independent rows of a state whose loops are closed, into ``rest.fronts``; places the bodies."""
    place(rest.layout, rest.link, rest.free, rest.speeds, z, rest.y, rest.A)
    if rest.loops.group.shape[0]:
        violation = _opened(rest, elements, t)
        _articulate(rest.link, rest.free)
        _choose(
            rest.loops, rest.layout, rest.fronts, rest.link, rest.free, rest.size[0], rest.best, rest.limit, violation
        )


@inner
def project(rest: Rest, elements: Elements | None, t: float, z: Array) -> None:
    """Bring z back to closed loops, in place: coordinates by Newton's method, then speeds, each of least M-norm.

    Newton's method goes on until rounding is reached: in a flat parallelogram, whose coordinates violate the rows by
    their square, a violation of 1e-14 is a coordinate that is wrong by 1e-7. Leaves the bodies placed at the state it
    ends with.
    """
    loops, layout, fronts, link, free, u = rest.loops, rest.layout, rest.fronts, rest.link, rest.free, rest.u
    speeds, held, size, y, A = rest.speeds, rest.held, rest.size, rest.y, rest.A
    W, target, value, rate = fronts.W, fronts.target, rest.value, rest.rate
    normalise(layout, z)
    place(layout, link, free, speeds, z, y, A)
    if loops.group.shape[0] == 0:
        return
    last, violation, rank, least = False, 0.0, 0, 0.0
    for step in range(_POSITION_STEPS + 1):
        violation = _opened(rest, elements, t)
        if last:
            break
        _articulate(link, free)
        if step == _POSITION_STEPS or violation <= 2e-16:
            break
        _release(W, held)
        rank, least, _ = _choose_rows(loops, layout, fronts, link, free, 0.0, size[0])
        for row in range(target.shape[0]):
            target[row] = -value[row] if row < held else 0.0
        _displacements(loops, fronts, link, free, u)
        last = _largest(u, u.shape[0]) < 1e-9
        displace(layout, z, u)
        place(layout, link, free, speeds, z, y, A)
    # where the first correction is that small, the speeds have as little to be corrected, and its factors will do
    if not (last and step == 1 and held == W.shape[0] and _keep(loops, fronts, rank, least, rest.best, rest.limit)):
        if last:
            _articulate(link, free)
        _choose(loops, layout, fronts, link, free, size[0], rest.best, rest.limit, violation)
    open_rates(loops.touched, layout, W, y, A, rate, target)
    _displacements(loops, fronts, link, free, u)
    for n in range(u.shape[0]):
        z[speeds + n] += u[n]
    place(layout, link, free, speeds, z, y, A)
