"""Projection of a state onto the constraint manifold by elimination (`few_freedoms`), in space.

Newton's method with displacements u of least M-norm, ``J u = -g(z)``, and speeds of least M-norm, ``J du' = rate - Q
v`` [MASS, "assembling during integration"]. Where elimination is singular or does not close the loops,
`projection.project` continues with the fronts.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inlined, inner
from consilience.reference.tree.arrays import (
    ELIMINATION_PIVOT,
    LARGEST_RANK,
    LoopClosure,
    Planar,
    Spatial,
    SpatialArrays,
    TreeElements,
)
from consilience.reference.tree.articulated import rigid_inertias
from consilience.reference.tree.either import (
    eliminate_rows,
    evaluate_rows,
    loop_velocity_residual,
    measure_largest_row,
    place_state,
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
from consilience.reference.tree.kinematics import displace

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
        and closure.best[LARGEST_RANK] == count
        and closure.position_rows == count
    )


@inlined
def record_pivot(closure: LoopClosure, spatial: SpatialArrays) -> None:
    """Record the least pivot of the rows once."""
    if closure.best[ELIMINATION_PIVOT] == 0.0 and _is_regular(closure, spatial):
        closure.best[ELIMINATION_PIVOT] = eliminate_rows(closure, spatial.elimination)[2]


@inner
def _is_regular_pivot(least: float, best: Array) -> bool:
    """Return whether the least pivot is about as large as it has been."""
    return REGULAR_PIVOT * best[ELIMINATION_PIVOT] <= least <= best[ELIMINATION_PIVOT]


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
    if closure.best[ELIMINATION_PIVOT] == 0.0 or not _is_regular(closure, spatial):
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
            closure.best[ELIMINATION_PIVOT] = max(closure.best[ELIMINATION_PIVOT], least)
            return False
        solve_reduced(elimination, rows, freedoms, link, free, u, 0.0)
        displace(closure.layout, z, u)
        last = closed or not at_sample
        closed = largest_entry(u, u.shape[0]) < NEGLIGIBLE
        solve_reduced_again(elimination, rows, freedoms, link, free, u)
        for n in range(u.shape[0]):
            z[closure.first_speed + n] += u[n]
        done = closed and last
        if at_sample or elements is not None or not done:
            place_state(closure, spatial, elements, None, z)
        if done:
            return True
    return False
