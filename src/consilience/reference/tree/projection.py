"""Projection of a state z onto the constraint manifold, and selection of independent rows, in space or in a plane.

Coordinates by Newton's method, ``J u = -g(z)``, then speeds, ``J du' = rate - Q v``, both of least M-norm [MASS,
"assembling during integration"]. The rank is found where the constraints hold and kept until the next projection:
docs/formulations.md, "Constraints along a motion".
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
"""Ratio of the least independent pivot to its largest value below which a pose counts as singular."""
_LARGEST_TURN = 1.5
"""Largest change in a step, rad, of an angle whose turns are counted: well below half a turn."""

AT_SAMPLE = np.array([True])[0]
"""Argument `at_sample` for a state that is a sample or is kept."""

_SINGULAR_VIOLATION = 1e-11
"""Largest violation of rows that are left out near a singular pose."""


@inner
def _least_norm_displacements(
    loops: Loops, qr: MultifrontalQR, spatial: Spatial, planar: Planar, link: Array, free: Array, u: Array
) -> None:
    """Compute the displacements u of least M-norm that change the rows by the target of the fronts."""
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
    """Factorise the responses to all rows; return rank, least pivot, and the squared norm that counted as dependent."""
    group, state = loops.group, qr.state
    for g in range(group.shape[0]):
        state[g, USED] = group[g, ROW_END] - group[g, ROW]
    largest = row_responses(loops, layout, qr, spatial, planar, link, free)
    smallest = max(smallest, rank_threshold(size, largest))
    least = factorise(group, qr.order, state, qr.F, qr.tau, smallest, PIVOTING)
    rank = 0
    for g in range(group.shape[0]):
        rank += state[g, RANK]
    return rank, least, smallest


@inner
def _set_active_rows(loops: Loops, qr: MultifrontalQR, rank: int, rank_limit: Array) -> None:
    """Make the rows that are independent in the present factors active until the next projection."""
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
    """Select the active rows until the next projection, and factorise the responses.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Close to this pose the rows
    still have full rank, but their effect on the accelerations is lost in rounding. Rows about to become dependent are
    therefore left out, as in the pose itself, as long as the motion satisfies them. A linkage that comes near such a
    pose and turns back violates them; they then become active again.
    """
    rank, least, smallest = _factorise_all_rows(loops, layout, qr, spatial, planar, link, free, 0.0, size)
    if rank > best[LARGEST_RANK]:
        best[LARGEST_RANK], best[LEAST_FRONT_PIVOT] = rank, least
    elif rank == best[LARGEST_RANK]:
        best[LEAST_FRONT_PIVOT] = max(best[LEAST_FRONT_PIVOT], least)
    if violation <= _SINGULAR_VIOLATION and least < _SINGULAR_PIVOT * best[LEAST_FRONT_PIVOT]:
        singular = (_SINGULAR_PIVOT * best[LEAST_FRONT_PIVOT]) ** 2
        fewer = _factorise_all_rows(loops, layout, qr, spatial, planar, link, free, singular, size)[0]
        if fewer:
            rank = fewer
        else:
            _factorise_all_rows(loops, layout, qr, spatial, planar, link, free, smallest, size)
    _set_active_rows(loops, qr, rank, rank_limit)


@inner
def _accept_factors(loops: Loops, qr: MultifrontalQR, rank: int, least: float, best: Array, rank_limit: Array) -> bool:
    """Keep the factors of a pose that differs by rounding, if they have the full rank and a regular least pivot."""
    if rank != best[LARGEST_RANK] or least < REGULAR_PIVOT * best[LEAST_FRONT_PIVOT]:
        return False
    best[LEAST_FRONT_PIVOT] = max(best[LEAST_FRONT_PIVOT], least)
    _set_active_rows(loops, qr, rank, rank_limit)
    return True


@inner
def _clear_velocity_rows(W: Array, position_rows: int) -> None:
    """Set the wrenches of rows that hold no positions to zero."""
    for row in range(position_rows, W.shape[0]):
        for n in range(W.shape[1]):
            for r in range(W.shape[2]):
                W[row, n, r] = 0.0


@kernel
def find_rank(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Select the active rows of a state whose loops are closed, and place the bodies.

    Parameters
    ----------
    closure, spatial, elements, planar, t, z : see `arrays`
    """
    place_state(closure, spatial, elements, planar, z)
    if closure.loops.group.shape[0]:
        violation = row_violation(closure, spatial, elements, planar, t, z)
        articulate_tree(spatial, planar, closure.link, closure.free)
        loops, layout, qr, link, free = closure.loops, closure.layout, closure.qr, closure.link, closure.free
        norm, best, rank_limit = closure.row_norm[0], closure.best, closure.rank_limit
        _select_rows(loops, layout, qr, spatial, planar, link, free, norm, best, rank_limit, violation)


@inlined
def _project_by_factorisation(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Project a state by the fronts, whatever its rows and violations."""
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
    # after a negligible correction the factors of the first pose also serve the speeds
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
    """Project z onto the constraint manifold in place, coordinates before speeds, and place the bodies.

    Newton's method continues down to rounding: in a flat parallelogram, where the violation is the square of the error
    of a coordinate, a violation of 1e-14 means an error of 1e-7. Between samples a residual remains that the next step
    removes, and bodies are placed only where elements read them.

    Parameters
    ----------
    closure, spatial, elements, planar, t, z, at_sample : see `arrays`
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
    """Project the state of any mechanism, and place its links: see `project`.

    Parameters
    ----------
    tree, closure, spatial, elements, planar, t, z, at_sample : see `arrays`
    """
    if closure is not None:
        project(closure, spatial, elements, planar, t, z, at_sample)
    elif planar is not None:
        place_planar_links(tree.link, tree.free, z, z[tree.first_speed :])
    elif spatial is not None:
        normalise(tree.layout, z)
        place_links(tree.link, tree.free, z, z[tree.first_speed :])


@inlined
def record_sample(tree: TreeArrays, spatial: Spatial, planar: Planar, motion: Array) -> None:
    """Record the bodies of placed links as a sample of a motion."""
    if planar is not None:
        place_planar_bodies(planar.body, tree.link, tree.y, tree.A)
    if spatial is not None:
        place_bodies(tree.layout, tree.link, tree.y, tree.A)
    copy_sample(tree.A, tree.y, motion)


@inlined
def _turn_limit(model: Model, y: Array, A: Array, turns: Array) -> float:
    """Return the longest step, s, in which turns can be counted, from the rates of the placed bodies."""
    rate = 0.0
    for n in range(turns.shape[0]):
        if model.counted[n]:
            rate = max(rate, abs(coordinate(model, y, A, n, turns[n]).rate))
    return _LARGEST_TURN / rate if rate > 0.0 else np.inf


@inlined
def step_limit(tree: TreeArrays, elements: TreeElements | None, longest: float) -> float:
    """Return the longest step, s, from the state at which the bodies are placed."""
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
    """Project a state at the end of a step, and count the turns that elements read.

    Parameters
    ----------
    tree, closure, spatial, elements, planar, t, z, at_sample : see `arrays`
    """
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
    """Project the first state of a motion; angles that elements read are within half a turn of zero.

    Parameters
    ----------
    tree, closure, spatial, elements, planar, t, z : see `arrays`
    """
    if elements is not None:
        place_links_and_bodies(tree.layout, tree.link, tree.free, tree.first_speed, z, tree.y, tree.A)
        count_turns(elements, tree.y, tree.A)
    end_step(tree, closure, spatial, elements, planar, t, z, AT_SAMPLE)
