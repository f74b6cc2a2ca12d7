"""Calls of the kernels of space or of a plane: the steps of the equations are the same.

Numba prunes ``is not None`` branches, not ``is None`` ones; one of `spatial` and `planar` is None.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.bodies import constraints
from consilience.reference.kernel.compiled import inlined
from consilience.reference.tree.arrays import LoopClosure, Planar, Spatial, TreeElements
from consilience.reference.tree.articulated import articulated_inertias, outward_sweep, rigid_inertias
from consilience.reference.tree.few_freedoms import ONE_TARGET, link_motions, solve_rows, store_targets
from consilience.reference.tree.kinematics import place_bodies, place_links
from consilience.reference.tree.loop_groups import EliminationArrays
from consilience.reference.tree.loop_rows import (
    acceleration_residual,
    evaluate_joint_rows,
    largest_row,
    velocity_residual,
    wrenches_of_rows,
)
from consilience.reference.tree.multifrontal import whitened_responses
from consilience.reference.tree.planar import (
    place_planar_links,
    planar_inward_sweep,
    planar_outward_sweep,
    planar_responses,
)
from consilience.reference.tree.planar_rows import (
    evaluate_planar_rows,
    largest_planar_row,
    planar_acceleration_residual,
    planar_velocity_residual,
)


@inlined
def place_state(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, z: Array
) -> None:
    """Place the links at a state, and the bodies where elements read them.

    Parameters
    ----------
    closure, spatial, elements, planar, z : see `arrays`
    """
    if spatial is not None:
        place_links(closure.link, closure.free, z, z[closure.first_speed :])
        if elements is not None and elements.read_bodies:
            place_bodies(closure.layout, closure.link, spatial.y, spatial.A)
    if planar is not None:
        place_planar_links(closure.link, closure.free, z, z[closure.first_speed :])


@inlined
def evaluate_rows(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Evaluate values, wrenches, gamma and rates of the active rows at the placed links and bodies.

    Parameters
    ----------
    closure, spatial, elements, planar, t, z : see `arrays`
    """
    touched, W, active = closure.loops.touched, closure.qr.W, closure.qr.active
    value, gamma = closure.value, closure.gamma
    if planar is not None:
        evaluate_planar_rows(planar, closure, t, z)
    if spatial is not None:
        if elements is not None and elements.other_rows:
            constraints.evaluate(elements.cut, t, spatial.y, elements.turns, elements.rows)
            wrenches_of_rows(touched, closure.layout, elements.rows.Q, spatial.A, W)
        else:
            joints = spatial.joints
            evaluate_joint_rows(joints.joint, joints.kind, joints.target, active, closure.link, W, value, gamma)


@inlined
def row_responses(closure: LoopClosure, spatial: Spatial, planar: Planar) -> float:
    """Fill the fronts with the whitened responses to the rows in use; return the largest squared norm of a column."""
    largest = 0.0
    if spatial is not None:
        largest = whitened_responses(closure)
    if planar is not None:
        largest = planar_responses(closure)
    return largest


@inlined
def sweep_accelerations(closure: LoopClosure, spatial: Spatial, planar: Planar, velocity_terms: float) -> None:
    """Compute the accelerations of links and free directions by the outward sweep."""
    if spatial is not None:
        outward_sweep(closure.link, closure.free, closure.u, velocity_terms)
    if planar is not None:
        planar_outward_sweep(closure.link, closure.free, closure.u, velocity_terms)


@inlined
def articulate_tree(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Compute the articulated inertias of placed links."""
    if spatial is not None:
        rigid_inertias(closure.link)
        articulated_inertias(closure.link, closure.free)
    if planar is not None:
        planar_inward_sweep(closure.link, closure.free, False)


@inlined
def measure_largest_row(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Set ``closure.row_norm`` once: the scale below which rows count as dependent."""
    if closure.row_norm[0] == 0.0:
        touched, W = closure.loops.touched, closure.qr.W
        if spatial is not None:
            place_bodies(closure.layout, closure.link, spatial.y, spatial.A)
            closure.row_norm[0] = largest_row(
                spatial.mass, spatial.inertia_factor, touched, closure.layout, W, spatial.A
            )
        if planar is not None:
            closure.row_norm[0] = largest_planar_row(touched, W, closure.link)


@inlined
def loop_velocity_residual(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Compute the velocity residual of the rows, ``rate - Q v``, into the target of the fronts."""
    touched, W, target = closure.loops.touched, closure.qr.W, closure.qr.target
    if spatial is not None:
        velocity_residual(touched, W, closure.link, closure.rate, target)
    if planar is not None:
        planar_velocity_residual(touched, W, closure.link, closure.rate, target)


@inlined
def loop_acceleration_residual(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Compute the acceleration residual of the rows, ``gamma - Q a``, into the target of the fronts."""
    touched, W, target = closure.loops.touched, closure.qr.W, closure.qr.target
    if spatial is not None:
        acceleration_residual(touched, W, closure.link, closure.gamma, target)
    if planar is not None:
        planar_acceleration_residual(touched, W, closure.link, closure.gamma, target)


@inlined
def bias_accelerations(closure: LoopClosure) -> None:
    """Compute the accelerations of the links for u = 0."""
    closure.u[:] = 0.0
    link_motions(closure.link, closure.free, closure.u, 1.0, closure.link)


@inlined
def eliminate_rows(closure: LoopClosure, elimination: EliminationArrays) -> tuple[int, int, float]:
    """Solve the active rows by elimination; return the numbers of rows and freedoms, and the least pivot."""
    loops, qr, free = closure.loops, closure.qr, closure.free
    store_targets(loops.group, qr.order, qr.state, qr.target, elimination.J, free.shape[0])
    return solve_rows(loops, qr, elimination, closure.link, free, ONE_TARGET)
