"""Accelerations and state derivative of a mechanism in joint coordinates, in space or in a plane.

Rows ``Q a = gamma`` act on the tree with ``Q^T lam`` [C4 (4.84)-(4.97)]. With the whitened responses B of the tree, the
zeta of least norm in ``B^T zeta = gamma - Q a_tree`` adds ``sqrt(D) zeta`` to the remaining joint forces, as in
`formulations.recursive`. Linkages of few freedoms are solved by elimination instead: see `few_freedoms`.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.bodies import forces
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.kernel.compiled import fused, inlined, inner, kernel
from consilience.reference.kernel.functions import evaluate as function_at
from consilience.reference.tree.arrays import LoopClosure, Planar, PlanarArrays, Spatial, SpatialArrays, TreeElements
from consilience.reference.tree.articulated import (
    force_biases,
    gravity_biases,
    inward_sweep,
    rigid_inertias,
    tree_accelerations,
)
from consilience.reference.tree.either import (
    bias_accelerations,
    eliminate_rows,
    evaluate_rows,
    loop_acceleration_residual,
    place_state,
    row_responses,
    sweep_accelerations,
)
from consilience.reference.tree.few_freedoms import (
    REGULAR_PIVOT,
    add_link_accelerations,
    has_few_freedoms,
    solve_reduced,
)
from consilience.reference.tree.kinematics import coordinate_rates
from consilience.reference.tree.loop_rows import mark_active_rows
from consilience.reference.tree.multifrontal import KEEP_ORDER, factorise, least_norm_forces, rank_threshold
from consilience.reference.tree.planar import place_planar_links, planar_inward_sweep, planar_outward_sweep
from consilience.reference.tree.planar_rows import add_force_biases, planar_coordinate_rates


@inlined
def factorise_rows(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Factorise the responses of the tree to the active rows, articulated inertias swept."""
    group, qr = closure.loops.group, closure.qr
    for g in range(group.shape[0]):
        qr.state[g].used = qr.state[g].active
    smallest = rank_threshold(closure.row_norm[0], row_responses(closure, spatial, planar))
    factorise(group, qr.order, qr.state, qr.F, qr.tau, smallest, KEEP_ORDER)


@fused
def _element_biases(elements: TreeElements, layout: Array, y: Array, A: Array, t: float, z: Array, link: Array) -> None:
    """Set the biases of the links to the forces of all elements."""
    model, first = elements.model, elements.first_integral
    for n in range(model.control.shape[0]):
        y[layout.shape[0] + n // 13, n % 13] = z[first + n]
    forces.evaluate(model, t, y, elements.turns, elements.rows)
    force_biases(layout, elements.rows.f, A, link)


@inlined
def _place_with_biases(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Place the links at a state, and set inertias and biases."""
    link = closure.link
    place_state(closure, spatial, elements, planar, z)
    if planar is not None and planar.force_table.shape[0]:
        add_force_biases(planar, link, t, z)
    if spatial is not None:
        rigid_inertias(link)
        if elements is not None and not elements.gravity_only:
            _element_biases(elements, closure.layout, spatial.y, spatial.A, t, z, link)
        else:
            gravity_biases(link)


@inlined
def _solve_articulated(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Compute accelerations by articulated bodies and, with loops, by the fronts."""
    if planar is not None:
        planar_inward_sweep(closure.link, closure.free, True)
    if spatial is not None:
        inward_sweep(closure.link, closure.free)
    sweep_accelerations(closure, spatial, planar, 1.0)
    if closure.loops.group.shape[0] > 0:
        loop_acceleration_residual(closure, spatial, planar)
        factorise_rows(closure, spatial, planar)
        least_norm_forces(closure)
        sweep_accelerations(closure, spatial, planar, 1.0)


@inner
def _solve_articulated_apart(closure: LoopClosure, spatial: SpatialArrays) -> None:
    """Call `_solve_articulated` as a kernel of its own: most linkages in space are solved by elimination."""
    _solve_articulated(closure, spatial, None)


@inlined
def _solve_by_elimination(closure: LoopClosure, spatial: SpatialArrays) -> bool:
    """Compute accelerations by elimination, if freedoms are few and the least pivot is regular; return whether."""
    link, group, elimination = closure.link, closure.loops.group, spatial.elimination
    found = (
        group.shape[0] > 0
        and closure.best[0].elimination_pivot > 0.0
        and has_few_freedoms(group, closure.qr.state, elimination.independent)
    )
    if found:
        bias_accelerations(closure)
        loop_acceleration_residual(closure, spatial, None)
        rows, freedoms, least = eliminate_rows(closure, elimination)
        found = least >= REGULAR_PIVOT * closure.best[0].elimination_pivot
        if found:
            solve_reduced(elimination, rows, freedoms, link, closure.free, closure.u, 1.0)
            add_link_accelerations(link, freedoms, elimination.V, elimination.G)
    return found


@inlined
def accelerations(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Compute the accelerations of the free directions (``closure.u``) and of all links.

    Parameters
    ----------
    closure, spatial, elements, planar, t, z : see `arrays`
    """
    loops, qr = closure.loops, closure.qr
    _place_with_biases(closure, spatial, elements, planar, t, z)
    if loops.group.shape[0] > 0:
        mark_active_rows(loops.group, qr.order, qr.state, qr.active)
        evaluate_rows(closure, spatial, elements, planar, t, z)
    if planar is not None:
        _solve_articulated(closure, None, planar)
    if spatial is not None and not _solve_by_elimination(closure, spatial):
        _solve_articulated_apart(closure, spatial)


@fused
def _control_errors(elements: TreeElements, y: Array, A: Array, t: float, dz: Array) -> None:
    """Compute the derivatives of the integrals of controllers."""
    model, turns, first = elements.model, elements.turns, elements.first_integral
    for n in range(model.control.shape[0]):
        target = function_at(model.functions, model.control[n].target, t)[0]
        c = model.control[n].coordinate
        dz[first + n] = target - coordinate(model, y, A, c, turns[c]).value


@inlined
def loop_derivative(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array, dz: Array
) -> None:
    """Compute the state derivative of a mechanism with loops or elements.

    Parameters
    ----------
    closure, spatial, elements, planar, t, z, dz : see `arrays`
    """
    accelerations(closure, spatial, elements, planar, t, z)
    for n in range(closure.u.shape[0]):
        dz[closure.first_speed + n] = closure.u[n]
    if planar is not None:
        planar_coordinate_rates(planar, closure.link, closure.first_speed, t, z, dz)
    if spatial is not None:
        coordinate_rates(closure.layout, closure.first_speed, z, dz)
        if elements is not None:
            _control_errors(elements, spatial.y, spatial.A, t, dz)


@fused
def tree_derivative(layout: Array, link: Array, free: Array, first_speed: int, z: Array, dz: Array) -> None:
    """Compute the state derivative of a tree with gravity alone.

    Parameters
    ----------
    layout, link, free, first_speed, z, dz : see `arrays`
    """
    tree_accelerations(link, free, z, z[first_speed:], dz[first_speed:])
    coordinate_rates(layout, first_speed, z, dz)


@fused
def planar_derivative(
    planar: PlanarArrays, link: Array, free: Array, first_speed: int, t: float, z: Array, dz: Array
) -> None:
    """Compute the state derivative of a tree in a plane.

    Parameters
    ----------
    planar, link, free, first_speed, t, z, dz : see `arrays`
    """
    place_planar_links(link, free, z, z[first_speed:])
    if planar.force_table.shape[0]:
        add_force_biases(planar, link, t, z)
    planar_inward_sweep(link, free, True)
    planar_outward_sweep(link, free, dz[first_speed:], 1.0)
    planar_coordinate_rates(planar, link, first_speed, t, z, dz)


@kernel
def count_turns(elements: TreeElements, y: Array, A: Array) -> None:
    """Update the joint coordinates that elements read, turns counted, from the placed bodies."""
    model, turns = elements.model, elements.turns
    for n in range(turns.shape[0]):
        turns[n] = coordinate(model, y, A, n, turns[n]).value
