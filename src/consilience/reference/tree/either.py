"""What is done alike in space and in a plane, by kernels of their own.

Where an argument is None, Numba leaves out what is done only where it is not: one of space and plane is None.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.bodies import constraints
from consilience.reference.kernel.compiled import inlined
from consilience.reference.tree import records
from consilience.reference.tree.arrays import LoopClosure, Planar, Spatial, TreeElements
from consilience.reference.tree.articulated import articulated_inertias, outward_sweep, rigid_inertias
from consilience.reference.tree.few_freedoms import ONE_TARGET, link_motions, solve_rows, store_targets
from consilience.reference.tree.kinematics import place_bodies, place_links
from consilience.reference.tree.loop_groups import Loops, MultifrontalQR
from consilience.reference.tree.loop_rows import (
    acceleration_residual,
    evaluate_joint_rows,
    largest_row,
    velocity_residual,
    wrenches_of_rows,
)
from consilience.reference.tree.multifrontal import least_norm_forces, whitened_responses
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
from consilience.reference.tree.reduced import EliminationArrays


@inlined
def place_state(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, z: Array
) -> None:
    """Place the links at a state, and the bodies where elements read them."""
    if spatial is not None:
        place_links(closure.link, closure.free, z, z[closure.first_speed :])
        if elements is not None:
            place_bodies(closure.layout, closure.link, spatial.y, spatial.A)
    if planar is not None:
        place_planar_links(closure.link, closure.free, z, z[closure.first_speed :])


@inlined
def evaluate_rows(
    closure: LoopClosure, spatial: Spatial, elements: TreeElements | None, planar: Planar, t: float, z: Array
) -> None:
    """Value, wrenches, gamma and rate of the cut rows of the links and bodies as they are placed."""
    touched, W, active, value, gamma = (
        closure.loops.touched,
        closure.qr.W,
        closure.qr.active,
        closure.value,
        closure.gamma,
    )
    if planar is not None:
        evaluate_planar_rows(planar, touched, active, closure.link, t, z, W, value, gamma, closure.rate)
    if spatial is not None:
        if elements is not None and elements.other_rows:
            constraints.evaluate(elements.cut, t, spatial.y, elements.turns, elements.rows)
            wrenches_of_rows(touched, closure.layout, elements.rows.Q, spatial.A, W)
        else:
            joints = spatial.joints
            evaluate_joint_rows(joints.joint, joints.kind, joints.target, active, closure.link, W, value, gamma)


@inlined
def row_responses(
    loops: Loops, layout: Array, qr: MultifrontalQR, spatial: Spatial, planar: Planar, link: Array, free: Array
) -> float:
    """`respond` with the arrays of loops and fronts."""
    group, touched, path, owner, W, wrench, F = (
        loops.group,
        loops.touched,
        loops.path,
        loops.owner,
        qr.W,
        qr.wrench,
        qr.F,
    )
    order, state, largest = qr.order, qr.state, 0.0
    if spatial is not None:
        largest = whitened_responses(group, touched, path, owner, order, state, layout, W, wrench, F, link, free)
    if planar is not None:
        largest = planar_responses(group, touched, path, owner, order, state, layout, W, wrench, F, link, free)
    return largest


@inlined
def add_row_forces(loops: Loops, qr: MultifrontalQR, free: Array) -> None:
    """`least_norm` for the target of the fronts."""
    least_norm_forces(loops.group, loops.own_directions, qr.order, qr.state, qr.F, qr.tau, qr.x, qr.y, qr.target, free)


@inlined
def sweep_accelerations(
    spatial: Spatial, planar: Planar, link: Array, free: Array, u: Array, velocity_terms: float
) -> None:
    """`sweep_out`, in space or in a plane."""
    if spatial is not None:
        outward_sweep(link, free, u, velocity_terms)
    if planar is not None:
        planar_outward_sweep(link, free, u, velocity_terms)


@inlined
def articulate_tree(spatial: Spatial, planar: Planar, link: Array, free: Array) -> None:
    """Articulated inertias, links as they are placed, once for each placing."""
    if spatial is not None:
        rigid_inertias(link)
        articulated_inertias(link, free)
    if planar is not None:
        planar_inward_sweep(link, free, False)


@inlined
def measure_largest_row(closure: LoopClosure, spatial: Spatial, planar: Planar) -> None:
    """Size of the rows, once: what says which of them depend on others."""
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
    """What the rows lack of their rates, into the target of the fronts."""
    touched, W, target = closure.loops.touched, closure.qr.W, closure.qr.target
    if spatial is not None:
        velocity_residual(touched, W, closure.link, closure.rate, target)
    if planar is not None:
        planar_velocity_residual(touched, W, closure.link, closure.rate, target)


@inlined
def loop_acceleration_residual(
    loops: Loops, qr: MultifrontalQR, spatial: Spatial, planar: Planar, link: Array, gamma: Array
) -> None:
    """What the rows lack of gamma in the accelerations of the links, into the target of the fronts."""
    if spatial is not None:
        acceleration_residual(loops.touched, qr.W, link, gamma, qr.target)
    if planar is not None:
        planar_acceleration_residual(loops.touched, qr.W, link, gamma, qr.target)


@inlined
def bias_accelerations(link: Array, free: Array, u: Array) -> None:
    """Accelerations of the links where u is zero."""
    for n in range(u.shape[0]):
        u[n] = 0.0
    link_motions(link, free, u, 1.0, link, records.ACCELERATION)


@inlined
def eliminate_rows(
    loops: Loops, qr: MultifrontalQR, elimination: EliminationArrays, link: Array, free: Array
) -> tuple[int, int, float]:
    """Solve the rows chosen for directions; rows, directions left, least pivot."""
    store_targets(loops.group, qr.order, qr.state, qr.target, elimination.J, free.shape[0])
    return solve_rows(loops, qr, elimination, link, free, ONE_TARGET)
