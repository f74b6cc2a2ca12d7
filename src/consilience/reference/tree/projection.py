"""Projection of the state z onto what closes the loops, and the choice of the rows that do, compiled.

In space or in a plane: the steps are the same, the kernels that take them are not. See `dynamics`.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.tree.arrays import (
    LARGEST_RANK,
    LEAST_FRONT_PIVOT,
    LoopClosure,
    Planar,
    Spatial,
    TreeArrays,
    TreeElements,
)
from consilience.reference.tree.closing import (
    NEGLIGIBLE,
    NEWTON_STEPS,
    largest_entry,
    project_by_elimination,
    record_pivot,
    row_violation,
)
from consilience.reference.tree.dynamics import count_turns
from consilience.reference.tree.either import (
    add_row_forces,
    articulate_tree,
    loop_velocity_residual,
    place_state,
    row_responses,
    sweep_accelerations,
)
from consilience.reference.tree.few_freedoms import REGULAR_PIVOT
from consilience.reference.tree.kinematics import (
    copy_sample,
    displace,
    normalise,
    place_bodies,
    place_links,
    place_links_and_bodies,
)
from consilience.reference.tree.loop_groups import ACTIVE, RANK, ROW, ROW_END, USED, Loops, MultifrontalQR
from consilience.reference.tree.multifrontal import PIVOTING, factorise, rank_threshold
from consilience.reference.tree.planar import place_planar_bodies, place_planar_links
from consilience.reference.tree.records import JOINT_FORCE

_SINGULAR_PIVOT = 1e-4
"""Part of its largest value at which the least independent pivot counts as passing through zero."""
_LARGEST_TURN = 1.5
"""Most that an angle whose turns are counted may change in a step, rad: well below half a turn."""

AT_SAMPLE = np.array([True])[0]
"""Of a state that is a sample, or that is kept."""

_SINGULAR_VIOLATION = 1e-11
"""Violation that rows left out on the way through a singular pose may have."""


@inner
def _least_norm_displacements(
    loops: Loops, qr: MultifrontalQR, spatial: Spatial, planar: Planar, link: Array, free: Array, u: Array
) -> None:
    """Displacements u of least M-norm that change the rows by the target of the fronts."""
    for n in range(free.shape[0]):
        free[n, JOINT_FORCE] = 0.0
    add_row_forces(loops, qr, free)
    sweep_accelerations(spatial, planar, link, free, u, 0.0)


@inner
def _factorise_all_rows(
    loops: Loops,
    layout: Array,
    qr: MultifrontalQR,
    spatial: Spatial,
    planar: Planar,
    link: Array,
    free: Array,
    smallest: float,
    size: float,
) -> tuple[int, float, float]:
    """Factorise the responses to all rows; rank, least pivot, and the square that counted as dependent."""
    group, state = loops.group, qr.state
    for g in range(group.shape[0]):
        state[g, USED] = group[g, ROW_END] - group[g, ROW]
    largest_entry = row_responses(loops, layout, qr, spatial, planar, link, free)
    smallest = max(smallest, rank_threshold(size, largest_entry))
    least = factorise(group, qr.order, state, qr.F, qr.tau, smallest, PIVOTING)
    rank = 0
    for g in range(group.shape[0]):
        rank += state[g, RANK]
    return rank, least, smallest


@inner
def _set_active_rows(loops: Loops, qr: MultifrontalQR, rank: int, rank_limit: Array) -> None:
    """Rows chosen until the next projection: those that are independent in the present factors."""
    for g in range(loops.group.shape[0]):
        qr.state[g, ACTIVE] = qr.state[g, RANK]
    rank_limit[0] = rank


@inner
def _select_rows(
    loops: Loops,
    layout: Array,
    qr: MultifrontalQR,
    spatial: Spatial,
    planar: Planar,
    link: Array,
    free: Array,
    size: float,
    best: Array,
    rank_limit: Array,
    violation: float,
) -> None:
    """Choose the rows to work with until the next projection, and factorise the responses.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Close to it they have the
    full rank still, but what they say of the accelerations drowns in rounding. There the rows that are about to become
    dependent are left out, as in the pose itself: the motion so far has satisfied them, and does so on the way
    through. Where it does not, in a linkage that comes near such a pose and turns, they are taken back.
    """
    rank, least, smallest = _factorise_all_rows(loops, layout, qr, spatial, planar, link, free, 0.0, size)
    if rank > best[LARGEST_RANK]:
        best[LARGEST_RANK], best[LEAST_FRONT_PIVOT] = rank, least
    elif rank == best[LARGEST_RANK]:
        best[LEAST_FRONT_PIVOT] = max(best[LEAST_FRONT_PIVOT], least)
    if violation <= _SINGULAR_VIOLATION and least < _SINGULAR_PIVOT * best[LEAST_FRONT_PIVOT]:
        passing = (_SINGULAR_PIVOT * best[LEAST_FRONT_PIVOT]) ** 2
        fewer = _factorise_all_rows(loops, layout, qr, spatial, planar, link, free, passing, size)[0]
        if fewer:
            rank = fewer
        else:
            _factorise_all_rows(loops, layout, qr, spatial, planar, link, free, smallest, size)
    _set_active_rows(loops, qr, rank, rank_limit)


@inner
def _accept_factors(loops: Loops, qr: MultifrontalQR, rank: int, least: float, best: Array, rank_limit: Array) -> bool:
    """Go on with the factors of a pose that is apart by rounding, if they have the rank so far, far from losing it."""
    if rank != best[LARGEST_RANK] or least < REGULAR_PIVOT * best[LEAST_FRONT_PIVOT]:
        return False
    best[LEAST_FRONT_PIVOT] = max(best[LEAST_FRONT_PIVOT], least)
    _set_active_rows(loops, qr, rank, rank_limit)
    return True


@inner
def _clear_velocity_rows(W: Array, position_rows: int) -> None:
    """Take away the wrenches of the rows that hold no positions."""
    for row in range(position_rows, W.shape[0]):
        for n in range(W.shape[1]):
            for r in range(W.shape[2]):
                W[row, n, r] = 0.0


@kernel
def find_rank(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Independent rows of a state whose loops are closed, into ``rest.fronts``; places the bodies."""
    place_state(closure, spatial, elements, planar, z)
    if closure.loops.group.shape[0]:
        violation = row_violation(closure, spatial, elements, planar, t, z)
        articulate_tree(spatial, planar, closure.link, closure.free)
        loops, qr, link, free = closure.loops, closure.qr, closure.link, closure.free
        _select_rows(
            loops,
            closure.layout,
            qr,
            spatial,
            planar,
            link,
            free,
            closure.row_norm[0],
            closure.best,
            closure.rank_limit,
            violation,
        )


@inlined
def _project_by_factorisation(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """`project` by the fronts, whatever the rows are and however far they are open."""
    loops, layout, qr, link, free, u = closure.loops, closure.layout, closure.qr, closure.link, closure.free, closure.u
    first_speed, position_rows, size = closure.first_speed, closure.position_rows, closure.row_norm
    W, target, value = qr.W, qr.target, closure.value
    last, violation, rank, least = False, 0.0, 0, 0.0
    for step in range(NEWTON_STEPS + 1):
        violation = row_violation(closure, spatial, elements, planar, t, z)
        if last:
            break
        articulate_tree(spatial, planar, link, free)
        if step == NEWTON_STEPS or violation <= 2e-16:
            break
        _clear_velocity_rows(W, position_rows)
        rank, least, _ = _factorise_all_rows(loops, layout, qr, spatial, planar, link, free, 0.0, size[0])
        for row in range(target.shape[0]):
            target[row] = -value[row] if row < position_rows else 0.0
        _least_norm_displacements(loops, qr, spatial, planar, link, free, u)
        last = largest_entry(u, u.shape[0]) < NEGLIGIBLE
        displace(layout, z, u)
        place_state(closure, spatial, elements, planar, z)
    # where the first correction is that small, the speeds have as little to be corrected, and its factors will do
    if not (
        last
        and step == 1
        and position_rows == W.shape[0]
        and _accept_factors(loops, qr, rank, least, closure.best, closure.rank_limit)
    ):
        if last:
            articulate_tree(spatial, planar, link, free)
        _select_rows(
            loops, layout, qr, spatial, planar, link, free, size[0], closure.best, closure.rank_limit, violation
        )
    if spatial is not None:
        record_pivot(closure, spatial)
    loop_velocity_residual(closure, spatial, planar)
    _least_norm_displacements(loops, qr, spatial, planar, link, free, u)
    for n in range(u.shape[0]):
        z[first_speed + n] += u[n]
    place_state(closure, spatial, elements, planar, z)


@inner
def project(
    closure: LoopClosure,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    at_sample: bool,
) -> None:
    """Bring z back to closed loops, in place: coordinates by Newton's method, then speeds, each of least M-norm.

    Newton's method goes on until rounding is reached: in a flat parallelogram, whose coordinates violate the rows by
    their square, a violation of 1e-14 is a coordinate that is wrong by 1e-7. Leaves the bodies placed at the state it
    ends with. A state that is not seen, no sample and nothing that is kept, may stay open by what the next step will
    take away, and its bodies are placed only where elements read them.
    """
    normalise(closure.layout, z)
    place_state(closure, spatial, elements, planar, z)
    if closure.loops.group.shape[0] == 0:
        return
    closed = False
    if spatial is not None:
        closed = project_by_elimination(closure, spatial, elements, t, z, at_sample)
    if not closed:
        _project_by_factorisation(closure, spatial, elements, planar, t, z)


@inlined
def project_state(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    at_sample: bool,
) -> None:
    """Bring a state back to closed loops, in place, and place the links at it: see `project`."""
    if closure is not None:
        project(closure, spatial, elements, planar, t, z, at_sample)
    elif planar is not None:
        place_planar_links(tree.link, tree.free, z, z[tree.first_speed :])
    elif spatial is not None:
        normalise(tree.layout, z)
        place_links(tree.link, tree.free, z, z[tree.first_speed :])


@inlined
def record_sample(tree: TreeArrays, spatial: Spatial, planar: Planar, motion: Array) -> None:
    """Record the bodies of links that are placed, as a sample of a motion."""
    if planar is not None:
        place_planar_bodies(planar.body, tree.link, tree.y, tree.A)
    if spatial is not None:
        place_bodies(tree.layout, tree.link, tree.y, tree.A)
    copy_sample(tree.A, tree.y, motion)


@inlined
def _turn_limit(model: Model, y: Array, A: Array, turns: Array) -> float:
    """Longest step in which turns can be counted, from the rates of the bodies as they are placed."""
    rate = 0.0
    for n in range(turns.shape[0]):
        if model.counted[n]:
            rate = max(rate, abs(coordinate(model, y, A, n, turns[n]).rate))
    return _LARGEST_TURN / rate if rate > 0.0 else np.inf


@inlined
def step_limit(tree: TreeArrays, elements: TreeElements | None, longest: float) -> float:
    """Longest step from where the bodies are placed."""
    if elements is None:
        return longest
    return min(longest, _turn_limit(elements.model, tree.y, tree.A, elements.turns))


@inlined
def end_step(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    at_sample: bool,
) -> None:
    """`settle` at the end of a step, and count the turns that elements read."""
    project_state(tree, closure, spatial, elements, planar, t, z, at_sample)
    if elements is not None:
        count_turns(elements, tree.y, tree.A)


@inlined
def begin_motion(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
) -> None:
    """`arrive` at the start of a motion, where angles that elements read are within half a turn of zero."""
    if elements is not None:
        place_links_and_bodies(tree.layout, tree.link, tree.free, tree.first_speed, z, tree.y, tree.A)
        count_turns(elements, tree.y, tree.A)
    end_step(tree, closure, spatial, elements, planar, t, z, AT_SAMPLE)
