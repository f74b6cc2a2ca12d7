"""A mechanism as integrators see it: the kernel that `steppers` call by address, and its record.

In kernels the fields of the record become arguments, because Numba leaves out the branches of what is None only for
arguments.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.kernel.compiled import fused, inlined, inner
from consilience.reference.kernel.operation import Operation, array_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers.motion import BEGIN, DERIVATIVE, SAMPLE
from consilience.reference.tree.arrays import LoopClosure, Planar, Spatial, TreeArrays, TreeElements, TreeSystem
from consilience.reference.tree.dynamics import count_turns, loop_derivative, planar_derivative, tree_derivative
from consilience.reference.tree.kinematics import (
    copy_sample,
    normalise,
    place_bodies,
    place_links,
    place_links_and_bodies,
)
from consilience.reference.tree.planar import place_planar_bodies, place_planar_links
from consilience.reference.tree.projection import project

_LARGEST_TURN = 1.5
"""Largest change in a step, rad, of an angle whose turns are counted: well below half a turn."""


class KeptRows(NamedTuple):
    """Active rows at the end of a step, kept while samples within the step are projected, which select their own."""

    order: Array  # (q,) order of the rows
    active: Array  # (G,) number of active rows in each group
    rank: Array  # (1,)


class SystemRecord(NamedTuple):
    """Record of `serve`."""

    tree: TreeArrays
    closure: LoopClosure | None
    spatial: Spatial
    elements: TreeElements | None
    planar: Planar
    kept: KeptRows


def system_record(arrays: TreeSystem, tree_alone: bool) -> SystemRecord:
    """Return the record of a mechanism; elements that it does not have are left out, with `tree_alone` its loops."""
    tree, closure, spatial, elements, planar = arrays
    kept = KeptRows(closure.qr.order.copy(), np.zeros(len(closure.qr.state), np.int64), np.zeros(1, np.int64))
    joints_alone = elements is None or not elements.read_bodies
    return SystemRecord(
        tree, None if tree_alone else closure, spatial, None if joints_alone else elements, planar, kept
    )


@fused
def _differentiate(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    dz: Array,
) -> None:
    if closure is not None:
        loop_derivative(closure, spatial, elements, planar, t, z, dz)
    elif planar is not None:
        planar_derivative(planar, tree.link, tree.free, tree.first_speed, t, z, dz)
    elif spatial is not None:
        tree_derivative(tree.layout, tree.link, tree.free, tree.first_speed, z, dz)


@inner
def _project(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    at_sample: bool,
) -> None:
    """Project a state, and place its links: see `projection.project`."""
    if closure is not None:
        project(closure, spatial, elements, planar, t, z, at_sample)
    elif planar is not None:
        place_planar_links(tree.link, tree.free, z, z[tree.first_speed :])
    elif spatial is not None:
        normalise(tree.layout, z)
        place_links(tree.link, tree.free, z, z[tree.first_speed :])


@inner
def _record(tree: TreeArrays, spatial: Spatial, planar: Planar, sample: Array) -> None:
    """Place the bodies of placed links, and record them as a sample, shape (13 (n_b + n_e),)."""
    if planar is not None:
        place_planar_bodies(planar.body, tree.link, tree.y, tree.A)
    if spatial is not None:
        place_bodies(tree.layout, tree.link, tree.y, tree.A)
    copy_sample(tree.A, tree.y, sample)


@inner
def _count_turns(tree: TreeArrays, elements: TreeElements | None) -> float:
    """Count the turns that elements read; return the longest step, s, in which turns can be counted."""
    rate = 0.0
    if elements is not None:
        model, turns = elements.model, elements.turns
        count_turns(elements, tree.y, tree.A)
        for n in range(turns.shape[0]):
            if model.counted[n]:
                rate = max(rate, abs(coordinate(model, tree.y, tree.A, n, turns[n]).rate))
    return _LARGEST_TURN / rate if rate > 0.0 else np.inf


@inner
def _place_first(tree: TreeArrays, elements: TreeElements | None, z: Array) -> None:
    """Place links and bodies where elements read them; angles are within half a turn of zero."""
    if elements is not None:
        place_links_and_bodies(tree.layout, tree.link, tree.free, tree.first_speed, z, tree.y, tree.A)
        count_turns(elements, tree.y, tree.A)


@inner
def _keep_rows(closure: LoopClosure | None, kept: KeptRows, back: bool) -> None:
    """Store the active rows and their order, or set them back."""
    if closure is not None:
        if back:
            assign(closure.qr.order, kept.order)
            assign(closure.qr.state["active"], kept.active)
            assign(closure.rank_limit, kept.rank)
        else:
            assign(kept.order, closure.qr.order)
            assign(kept.active, closure.qr.state["active"])
            assign(kept.rank, closure.rank_limit)


@inlined
def _serve_states(system: SystemRecord, request: int, t: float, state: Array, result: Array) -> float:
    """Project and record a state. The rows that a sample selects are not those that the next step needs."""
    tree, closure, spatial = system.tree, system.closure, system.spatial
    elements, planar, kept, longest = system.elements, system.planar, system.kept, np.inf
    if request == BEGIN:
        _place_first(tree, elements, state)
    if request == SAMPLE:
        _keep_rows(closure, kept, False)
    _project(tree, closure, spatial, elements, planar, t, state, result.shape[0] > 0)
    if request == SAMPLE:
        _keep_rows(closure, kept, True)
    else:
        longest = _count_turns(tree, elements)
    if result.shape[0]:
        _record(tree, spatial, planar, result)
    return longest


@Operation
def serve(system: SystemRecord, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests of integrators: see `steppers.motion.BEGIN`.

    Parameters
    ----------
    system : SystemRecord
    request, t, z, out : see `steppers.motion.ask`
    """
    state, result = array_of(z), array_of(out)
    if request == DERIVATIVE:
        _differentiate(system.tree, system.closure, system.spatial, system.elements, system.planar, t, state, result)
        return np.inf
    return _serve_states(system, request, t, state, result)


@Operation
def serve_states(system: SystemRecord, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests of an integrator that asks for no derivative: `serve` without what takes long to compile.

    Parameters
    ----------
    system, request, t, z, out : see `serve`
    """
    return _serve_states(system, request, t, array_of(z), array_of(out))
