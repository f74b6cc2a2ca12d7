"""Projection of a state z onto the constraint manifold, and selection of independent rows, in space or in a plane.

Coordinates by Newton's method, ``J u = -g(z)``, then speeds, ``J du' = rate - Q v``, both of least M-norm [MASS,
"assembling during integration"]. Where few freedoms are left, in space, by elimination (`few_freedoms`); where that is
singular or does not close the loops, and elsewhere, by the fronts (`multifrontal`). The rank is found where the
constraints hold and kept until the next projection: docs/formulations.md, "Constraints along a motion".
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inlined, inner, kernel
from consilience.reference.tree.arrays import LoopClosure, Planar, Spatial, SpatialArrays, TreeElements
from consilience.reference.tree.articulated import rigid_inertias
from consilience.reference.tree.either import (
    articulate_tree,
    eliminate_rows,
    evaluate_rows,
    loop_velocity_residual,
    measure_largest_row,
    place_state,
    row_responses,
    sweep_accelerations,
)
from consilience.reference.tree.few_freedoms import (
    REGULAR_PIVOT,
    TWO_TARGETS,
    count_active_rows,
    has_few_freedoms,
    solve_reduced,
    solve_reduced_again,
    solve_rows,
    store_targets,
)
from consilience.reference.tree.kinematics import displace, normalise
from consilience.reference.tree.multifrontal import PIVOTING, factorise, least_norm_forces, rank_threshold

_SINGULAR_PIVOT = 1e-4
"""Ratio of the least independent pivot to its largest value below which a pose counts as singular."""

_SINGULAR_VIOLATION = 1e-11
"""Largest violation of rows that are left out near a singular pose."""


NEWTON_STEPS = 3
"""Largest number of Newton steps."""

NEGLIGIBLE = 1e-9
"""Correction, rad or m, whose square is lost in rounding: another Newton step would change nothing."""


@inner
def largest_entry(x: Array, count: int) -> float:
    """Return the largest magnitude of the first entries of an array."""
    found = 0.0
    for n in range(count):
        found = max(found, abs(x[n]))
    return found


@inner
def row_violation(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> float:
    """Evaluate all rows at the placed links; return the largest violation over the length of the mechanism.

    Parameters
    ----------
    closure, spatial, elements, planar, t, z : see `arrays`
    """
    closure.qr.active[:] = 1
    evaluate_rows(closure, spatial, elements, planar, t, z)
    measure_largest_row(closure, spatial, planar)
    return largest_entry(closure.value, closure.position_rows) / max(1.0, closure.length)


@inlined
def _is_regular(closure: LoopClosure, spatial: SpatialArrays) -> bool:
    """Return whether elimination may project: few freedoms, and only position rows, all independent so far.

    Dependent rows are excluded because their independent subset is selected anew after each step.
    """
    group, state, count = closure.loops.group, closure.qr.state, closure.qr.W.shape[0]
    return (
        has_few_freedoms(group, state, spatial.elimination.independent)
        and count_active_rows(group, state) == count
        and closure.best[0].rank == count
        and closure.position_rows == count
    )


@inlined
def record_pivot(closure: LoopClosure, spatial: SpatialArrays) -> None:
    """Record the least pivot of the rows once."""
    if closure.best[0].elimination_pivot == 0.0 and _is_regular(closure, spatial):
        closure.best[0].elimination_pivot = eliminate_rows(closure, spatial.elimination)[2]


@inner
def _is_regular_pivot(least: float, best: Array) -> bool:
    """Return whether the least pivot is about as large as it has been."""
    return REGULAR_PIVOT * best[0].elimination_pivot <= least <= best[0].elimination_pivot


@fused
def project_by_elimination(
    closure: LoopClosure, spatial: SpatialArrays, elements: TreeElements | None, t: float, z: Array, at_sample: bool
) -> bool:
    """Project coordinates and speeds together, as `projection.project`; return whether the loops are closed.

    Speeds are projected with the Jacobian of the pose before its correction u; the error is O(u v). At a sample another
    step removes this error, elsewhere the next time step does. Returns False, with z as close as it came, where the
    rows are not `_is_regular` or the least pivot is not `_is_regular_pivot`.

    Parameters
    ----------
    closure, spatial, elements, t, z, at_sample : see `arrays`
    """
    loops, qr, elimination = closure.loops, closure.qr, spatial.elimination
    link, free, u = closure.link, closure.free, closure.u
    group, order, state, value, target = loops.group, qr.order, qr.state, closure.value, qr.target
    if closure.best[0].elimination_pivot == 0.0 or not _is_regular(closure, spatial):
        return False
    closed = False
    for _ in range(NEWTON_STEPS + 1):
        rigid_inertias(link)
        row_violation(closure, spatial, elements, None, t, z)
        loop_velocity_residual(closure, spatial, None)
        store_targets(group, order, state, target, elimination.J, u.shape[0] + 1)
        for row in range(target.shape[0]):
            target[row] = -value[row]
        store_targets(group, order, state, target, elimination.J, u.shape[0])
        rows, freedoms, least = solve_rows(loops, qr, elimination, link, free, TWO_TARGETS)
        if not _is_regular_pivot(least, closure.best):
            # the fronts, which project instead, then update their largest least pivot, too
            closure.best[0].elimination_pivot = max(closure.best[0].elimination_pivot, least)
            return False
        solve_reduced(elimination, rows, freedoms, link, free, u, 0.0)
        displace(closure.layout, z, u)
        last = closed or not at_sample
        closed = largest_entry(u, u.shape[0]) < NEGLIGIBLE
        solve_reduced_again(elimination, rows, freedoms, link, free, u)
        for n in range(u.shape[0]):
            z[closure.first_speed + n] += u[n]
        done = closed and last
        moved = at_sample or not done
        if elements is not None:
            moved = moved or elements.read_bodies
        if moved:
            place_state(closure, spatial, elements, None, z)
        if done:
            return True
    return False


@inner
def _least_norm_displacements(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Compute the displacements u of least M-norm that change the rows by the target of the fronts."""
    for n in range(closure.free.shape[0]):
        closure.free[n].joint_force = 0.0
    least_norm_forces(closure)
    sweep_accelerations(closure, spatial, planar, 0.0)


@inner
def _factorise_all_rows(
    closure: LoopClosure, spatial: Spatial, planar: Planar, smallest: float
) -> tuple[int, float, float]:
    """Factorise the responses to all rows; return rank, least pivot, and the squared norm that counted as dependent."""
    group, qr = closure.loops.group, closure.qr
    for g in range(group.shape[0]):
        qr.state[g].used = group[g].row_end - group[g].row
    smallest = max(smallest, rank_threshold(closure.row_norm[0], row_responses(closure, spatial, planar)))
    least = factorise(group, qr.order, qr.state, qr.F, qr.tau, smallest, PIVOTING)
    rank = 0
    for g in range(group.shape[0]):
        rank += qr.state[g].rank
    return rank, least, smallest


@inner
def _set_active_rows(closure: LoopClosure, rank: int) -> None:
    """Make the rows that are independent in the present factors active until the next projection."""
    state = closure.qr.state
    for g in range(state.shape[0]):
        state[g].active = state[g].rank
    closure.rank_limit[0] = rank


@inner
def _select_rows(closure: LoopClosure, spatial: Spatial, planar: Planar, violation: float) -> None:
    """Select the active rows until the next projection, and factorise the responses.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Close to this pose the rows
    still have full rank, but their effect on the accelerations is lost in rounding. Rows about to become dependent are
    therefore left out, as in the pose itself, as long as the motion satisfies them. A linkage that comes near such a
    pose and turns back violates them; they then become active again.
    """
    best = closure.best[0]
    rank, least, smallest = _factorise_all_rows(closure, spatial, planar, 0.0)
    if best.first == 0:
        best.first = rank
    if rank > best.rank:
        best.rank, best.pivot = rank, least
    elif rank == best.rank:
        best.pivot = max(best.pivot, least)
    if violation <= _SINGULAR_VIOLATION and least < _SINGULAR_PIVOT * best.pivot:
        singular = (_SINGULAR_PIVOT * best.pivot) ** 2
        fewer = _factorise_all_rows(closure, spatial, planar, singular)[0]
        if fewer:
            rank = fewer
        else:
            _factorise_all_rows(closure, spatial, planar, smallest)
    _set_active_rows(closure, rank)


@inner
def _accept_factors(closure: LoopClosure, rank: int, least: float) -> bool:
    """Keep the factors of a pose that differs by rounding, if they have the full rank and a regular least pivot."""
    best = closure.best[0]
    if rank != best.rank or least < REGULAR_PIVOT * best.pivot:
        return False
    best.pivot = max(best.pivot, least)
    _set_active_rows(closure, rank)
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
        articulate_tree(closure, spatial, planar)
        _select_rows(closure, spatial, planar, violation)


@inlined
def _project_by_factorisation(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Project a state by the fronts, whatever its rows and violations."""
    u, position_rows, value = closure.u, closure.position_rows, closure.value
    W, target = closure.qr.W, closure.qr.target
    last, violation, rank, least = False, 0.0, closure.best[0].rank, 0.0
    for step in range(NEWTON_STEPS + 1):
        violation = row_violation(closure, spatial, elements, planar, t, z)
        if last:
            break
        articulate_tree(closure, spatial, planar)
        if step == NEWTON_STEPS or violation <= 2e-16:
            break
        _clear_velocity_rows(W, position_rows)
        rank, least, _ = _factorise_all_rows(closure, spatial, planar, 0.0)
        for row in range(target.shape[0]):
            target[row] = -value[row] if row < position_rows else 0.0
        _least_norm_displacements(closure, spatial, planar)
        last = largest_entry(u, u.shape[0]) < NEGLIGIBLE
        displace(closure.layout, z, u)
        place_state(closure, spatial, elements, planar, z)
    # after a negligible correction the factors of the first pose also serve the speeds
    if not (last and step == 1 and position_rows == W.shape[0] and _accept_factors(closure, rank, least)):
        if last:
            articulate_tree(closure, spatial, planar)
        _select_rows(closure, spatial, planar, violation)
    if spatial is not None:
        record_pivot(closure, spatial)
    loop_velocity_residual(closure, spatial, planar)
    _least_norm_displacements(closure, spatial, planar)
    for n in range(u.shape[0]):
        z[closure.first_speed + n] += u[n]
    place_state(closure, spatial, elements, planar, z)


@inlined
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
