"""Equations of motion in the state z, compiled, in space or in a plane.

Cut rows ``Q a = gamma`` act with ``Q^T lam``. With the whitened responses B of the tree, the zeta of least norm in
``B^T zeta = gamma - Q a_tree`` adds ``sqrt(D) zeta`` to the remaining joint forces, as in `formulations.recursive`.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.bodies import forces
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.kernel.compiled import fused, inlined, inner, kernel
from consilience.reference.kernel.functions import evaluate as function_at
from consilience.reference.tree import records
from consilience.reference.tree.arrays import PIVOT, Elements, Rest, Space, Tree
from consilience.reference.tree.articulated import free_accelerations, free_biases, inertias, push_wrenches, sweep_in
from consilience.reference.tree.either import (
    accelerate,
    coast,
    cut_rows,
    eliminate,
    force_rows,
    open_links,
    place_at,
    respond_to_rows,
)
from consilience.reference.tree.few_freedoms import SOUND, add_to_links, is_small, reduce_links
from consilience.reference.tree.kinematics import coordinate_rates
from consilience.reference.tree.loop_groups import CHOSEN, USED, Fronts, Loops
from consilience.reference.tree.loop_rows import want
from consilience.reference.tree.multifrontal import KEEP, factorise, threshold
from consilience.reference.tree.planar import place_planar, sweep_in_planar, sweep_out_planar
from consilience.reference.tree.planar_rows import planar_rates, push_efforts
from consilience.reference.tree.plane import Plane


@inlined
def factorise_rows(
    loops: Loops,
    layout: Array,
    link: Array,
    free: Array,
    fronts: Fronts,
    space: Space | None,
    plane: Plane | None,
    size: float,
) -> None:
    """Factors of the responses to the rows chosen, in a tree whose inertias are swept."""
    state = fronts.state
    for g in range(loops.group.shape[0]):
        state[g, USED] = state[g, CHOSEN]
    largest = respond_to_rows(loops, layout, fronts, space, plane, link, free)
    factorise(loops.group, fronts.order, state, fronts.F, fronts.tau, threshold(size, largest), KEEP)


@fused
def _push(elements: Elements, layout: Array, y: Array, A: Array, t: float, z: Array, link: Array) -> None:
    """Biases of the forces of elements."""
    model, first = elements.model, elements.integrals
    for n in range(model.control.shape[0]):
        y[layout.shape[0] + n // 13, n % 13] = z[first + n]
    forces.evaluate(model, t, y, elements.memory, elements.rows)
    push_wrenches(layout, elements.rows.f, A, link)


@inlined
def _place_and_push(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array
) -> None:
    """Links at a state, their inertias, and biases of all forces."""
    link = rest.link
    place_at(rest, space, elements, plane, z)
    if plane is not None and plane.effort.shape[0]:
        push_efforts(plane, link, t, z)
    if space is not None:
        inertias(link)
        if elements is not None and not elements.plain:
            _push(elements, rest.layout, space.y, space.A, t, z, link)
        else:
            free_biases(link)


@inlined
def _sweep(rest: Rest, space: Space | None, plane: Plane | None) -> None:
    """Accelerations by articulated bodies and, where there are rows, by the fronts."""
    link, free, u, fronts = rest.link, rest.free, rest.u, rest.fronts
    if plane is not None:
        sweep_in_planar(link, free, True)
    if space is not None:
        sweep_in(link, free)
    accelerate(space, plane, link, free, u, 1.0)
    if rest.loops.group.shape[0] > 0:
        open_links(rest.loops, fronts, space, plane, link, rest.gamma)
        factorise_rows(rest.loops, rest.layout, link, free, fronts, space, plane, rest.size[0])
        force_rows(rest.loops, fronts, free)
        accelerate(space, plane, link, free, u, 1.0)


@inner
def _sweep_apart(rest: Rest, space: Space) -> None:
    """`_sweep`, not written out where it is called: most linkages in space go the other way."""
    _sweep(rest, space, None)


@inlined
def _eliminate(rest: Rest, space: Space) -> bool:
    """Accelerations by elimination, if few directions are left and the least pivot is far from zero; whether it is."""
    link, free, u, loops, fronts, few = rest.link, rest.free, rest.u, rest.loops, rest.fronts, space.reduced
    found = loops.group.shape[0] > 0 and rest.best[PIVOT] > 0.0 and is_small(loops.group, fronts.state, few.left)
    if found:
        coast(link, free, u)
        open_links(loops, fronts, space, None, link, rest.gamma)
        rows, freedoms, least = eliminate(loops, fronts, few, link, free)
        found = least >= SOUND * rest.best[PIVOT]
        if found:
            reduce_links(few, rows, freedoms, link, free, u, 1.0)
            add_to_links(link, records.ACCELERATION, freedoms, few.V, few.G)
    return found


@fused
def accelerations(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array
) -> None:
    """Fill ``rest.u``, accelerations of the free directions, and those of all links in their rows.

    In a plane, elimination would be a tenth faster than the fronts, and take a third longer to compile.
    """
    loops, fronts = rest.loops, rest.fronts
    _place_and_push(rest, space, elements, plane, t, z)
    if loops.group.shape[0] > 0:
        want(loops.group, fronts.order, fronts.state, fronts.wanted)
        cut_rows(rest, space, elements, plane, t, z)
    if plane is not None:
        _sweep(rest, None, plane)
    if space is not None and not _eliminate(rest, space):
        _sweep_apart(rest, space)


@fused
def _control_errors(elements: Elements, y: Array, A: Array, t: float, dz: Array) -> None:
    """Derivatives of the integrals of controllers."""
    model, memory, first = elements.model, elements.memory, elements.integrals
    for n in range(model.control.shape[0]):
        target = function_at(model.functions, model.control[n, 1], t)[0]
        c = model.control[n, 0]
        dz[first + n] = target - coordinate(model, y, A, c, memory[c]).value


@inlined
def derivative(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array, dz: Array
) -> None:
    """State derivative, shape of z."""
    accelerations(rest, space, elements, plane, t, z)
    for n in range(rest.u.shape[0]):
        dz[rest.speeds + n] = rest.u[n]
    if plane is not None:
        planar_rates(plane, rest.link, rest.speeds, t, z, dz)
    if space is not None:
        coordinate_rates(rest.layout, rest.speeds, z, dz)
        if elements is not None:
            _control_errors(elements, space.y, space.A, t, dz)


@inner
def free_derivative(index: Array, link: Array, free: Array, first_speed: int, z: Array, dz: Array) -> None:
    """`derivative` of a tree without elements."""
    free_accelerations(link, free, z, z[first_speed:], dz[first_speed:])
    coordinate_rates(index, first_speed, z, dz)


@inner
def planar_derivative(plane: Plane, link: Array, free: Array, speeds: int, t: float, z: Array, dz: Array) -> None:
    """`derivative` of a tree in a plane."""
    place_planar(link, free, z, z[speeds:])
    if plane.effort.shape[0]:
        push_efforts(plane, link, t, z)
    sweep_in_planar(link, free, True)
    sweep_out_planar(link, free, dz[speeds:], 1.0)
    planar_rates(plane, link, speeds, t, z, dz)


@inlined
def rates(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    t: float,
    z: Array,
    dz: Array,
) -> None:
    """State derivative of any mechanism."""
    if rest is not None:
        derivative(rest, space, elements, plane, t, z, dz)
    elif plane is not None:
        planar_derivative(plane, tree.link, tree.free, tree.speeds, t, z, dz)
    elif space is not None:
        free_derivative(tree.layout, tree.link, tree.free, tree.speeds, z, dz)


@kernel
def remember(elements: Elements, y: Array, A: Array) -> None:
    """Update the joint coordinates that elements read, turns counted, of the bodies as they are placed."""
    model, memory = elements.model, elements.memory
    for n in range(memory.shape[0]):
        memory[n] = coordinate(model, y, A, n, memory[n]).value
