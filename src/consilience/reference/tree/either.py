"""What is done alike in space and in a plane, by kernels of their own.

Where an argument is None, Numba leaves out what is done only where it is not: one of space and plane is None.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.bodies import constraints
from consilience.reference.kernel.compiled import inlined
from consilience.reference.tree import records
from consilience.reference.tree.arrays import Elements, Rest, Space
from consilience.reference.tree.articulated import articulate, inertias, sweep_out
from consilience.reference.tree.few_freedoms import ONE, move, put_targets, solve_rows
from consilience.reference.tree.kinematics import place_bodies, place_links
from consilience.reference.tree.loop_groups import Fronts, Loops
from consilience.reference.tree.loop_rows import gather, joint_rows, open_accelerations, open_rates, size_of_rows
from consilience.reference.tree.multifrontal import least_norm, respond
from consilience.reference.tree.planar import place_planar, respond_planar, sweep_in_planar, sweep_out_planar
from consilience.reference.tree.planar_rows import (
    open_planar_accelerations,
    open_planar_rates,
    planar_rows,
    size_of_planar_rows,
)
from consilience.reference.tree.plane import Plane
from consilience.reference.tree.reduced import Reduced


@inlined
def place_at(rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, z: Array) -> None:
    """Place the links at a state, and the bodies where elements read them."""
    if space is not None:
        place_links(rest.link, rest.free, z, z[rest.speeds :])
        if elements is not None:
            place_bodies(rest.layout, rest.link, space.y, space.A)
    if plane is not None:
        place_planar(rest.link, rest.free, z, z[rest.speeds :])


@inlined
def cut_rows(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array
) -> None:
    """Value, wrenches, gamma and rate of the cut rows of the links and bodies as they are placed."""
    touched, W, wanted, value, gamma = rest.loops.touched, rest.fronts.W, rest.fronts.wanted, rest.value, rest.gamma
    if plane is not None:
        planar_rows(plane, touched, wanted, rest.link, t, z, W, value, gamma, rest.rate)
    if space is not None:
        if elements is not None and elements.other_rows:
            constraints.evaluate(elements.cut, t, space.y, elements.memory, elements.rows)
            gather(touched, rest.layout, elements.rows.Q, space.A, W)
        else:
            joints = space.joints
            joint_rows(joints.joint, joints.kind, joints.target, wanted, rest.link, W, value, gamma)


@inlined
def respond_to_rows(
    loops: Loops, layout: Array, fronts: Fronts, space: Space | None, plane: Plane | None, link: Array, free: Array
) -> float:
    """`respond` with the arrays of loops and fronts."""
    group, touched, path, home, W, wrench, F = (
        loops.group,
        loops.touched,
        loops.path,
        loops.home,
        fronts.W,
        fronts.wrench,
        fronts.F,
    )
    order, state, largest = fronts.order, fronts.state, 0.0
    if space is not None:
        largest = respond(group, touched, path, home, order, state, layout, W, wrench, F, link, free)
    if plane is not None:
        largest = respond_planar(group, touched, path, home, order, state, layout, W, wrench, F, link, free)
    return largest


@inlined
def force_rows(loops: Loops, fronts: Fronts, free: Array) -> None:
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
def accelerate(space: Space | None, plane: Plane | None, link: Array, free: Array, u: Array, moving: float) -> None:
    """`sweep_out`, in space or in a plane."""
    if space is not None:
        sweep_out(link, free, u, moving)
    if plane is not None:
        sweep_out_planar(link, free, u, moving)


@inlined
def articulate_links(space: Space | None, plane: Plane | None, link: Array, free: Array) -> None:
    """Articulated inertias, links as they are placed, once for each placing."""
    if space is not None:
        inertias(link)
        articulate(link, free)
    if plane is not None:
        sweep_in_planar(link, free, False)


@inlined
def measure_rows(rest: Rest, space: Space | None, plane: Plane | None) -> None:
    """Size of the rows, once: what says which of them depend on others."""
    if rest.size[0] == 0.0:
        touched, W = rest.loops.touched, rest.fronts.W
        if space is not None:
            place_bodies(rest.layout, rest.link, space.y, space.A)
            rest.size[0] = size_of_rows(space.mass, space.inertia_factor, touched, rest.layout, W, space.A)
        if plane is not None:
            rest.size[0] = size_of_planar_rows(touched, W, rest.link)


@inlined
def open_speeds(rest: Rest, space: Space | None, plane: Plane | None) -> None:
    """What the rows lack of their rates, into the target of the fronts."""
    touched, W, target = rest.loops.touched, rest.fronts.W, rest.fronts.target
    if space is not None:
        open_rates(touched, W, rest.link, rest.rate, target)
    if plane is not None:
        open_planar_rates(touched, W, rest.link, rest.rate, target)


@inlined
def open_links(
    loops: Loops, fronts: Fronts, space: Space | None, plane: Plane | None, link: Array, gamma: Array
) -> None:
    """What the rows lack of gamma in the accelerations of the links, into the target of the fronts."""
    if space is not None:
        open_accelerations(loops.touched, fronts.W, link, gamma, fronts.target)
    if plane is not None:
        open_planar_accelerations(loops.touched, fronts.W, link, gamma, fronts.target)


@inlined
def coast(link: Array, free: Array, u: Array) -> None:
    """Accelerations of the links where u is zero."""
    for n in range(u.shape[0]):
        u[n] = 0.0
    move(link, free, u, 1.0, link, records.ACCELERATION)


@inlined
def eliminate(loops: Loops, fronts: Fronts, few: Reduced, link: Array, free: Array) -> tuple[int, int, float]:
    """Solve the rows chosen for directions; rows, directions left, least pivot."""
    put_targets(loops.group, fronts.order, fronts.state, fronts.target, few.J, free.shape[0])
    return solve_rows(loops, fronts, few, link, free, ONE)
