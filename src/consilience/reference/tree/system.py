"""A mechanism as integrators see it: state derivative, projection, samples, longest step.

Integrators hand on one record, `arrays.KernelArguments`. Here its fields become arguments, because Numba leaves out
the branches of what is None only for arguments.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.kernel.compiled import inlined, inner
from consilience.reference.kernel.vectors import assign
from consilience.reference.tree.arrays import KernelArguments, LoopClosure, Planar, Spatial, TreeArrays, TreeElements
from consilience.reference.tree.dense_output import dense_output
from consilience.reference.tree.dynamics import count_turns, loop_derivative, planar_derivative, tree_derivative
from consilience.reference.tree.kinematics import (
    copy_sample,
    normalise,
    place_bodies,
    place_links,
    place_links_and_bodies,
)
from consilience.reference.tree.planar import place_planar_bodies, place_planar_links
from consilience.reference.tree.projection import AT_SAMPLE, project
from consilience.reference.tree.step_control import next_sample

_LARGEST_TURN = 1.5
"""Largest change in a step, rad, of an angle whose turns are counted: well below half a turn."""


@inner
def _state_derivative(
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


@inlined
def state_derivative(system: KernelArguments, t: float, z: Array, dz: Array) -> None:
    """Compute the state derivative of any mechanism."""
    tree, closure, spatial = system.tree, system.closure, system.spatial
    _state_derivative(tree, closure, spatial, system.elements, system.planar, t, z, dz)


@inner
def _project_state(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    at_sample: bool,
) -> None:
    if closure is not None:
        project(closure, spatial, elements, planar, t, z, at_sample)
    elif planar is not None:
        place_planar_links(tree.link, tree.free, z, z[tree.first_speed :])
    elif spatial is not None:
        normalise(tree.layout, z)
        place_links(tree.link, tree.free, z, z[tree.first_speed :])


@inlined
def project_state(system: KernelArguments, t: float, z: Array, at_sample: bool) -> None:
    """Project the state of any mechanism, and place its links: see `projection.project`."""
    tree, closure, spatial = system.tree, system.closure, system.spatial
    _project_state(tree, closure, spatial, system.elements, system.planar, t, z, at_sample)


@inner
def _place_sample(tree: TreeArrays, spatial: Spatial, planar: Planar) -> None:
    """Place the bodies of placed links."""
    if planar is not None:
        place_planar_bodies(planar.body, tree.link, tree.y, tree.A)
    if spatial is not None:
        place_bodies(tree.layout, tree.link, tree.y, tree.A)


@inlined
def record_sample(system: KernelArguments, sample: Array) -> None:
    """Record the bodies of placed links as a sample of a motion, shape (n_b + n_e, 13)."""
    _place_sample(system.tree, system.spatial, system.planar)
    copy_sample(system.tree.A, system.tree.y, sample)


@inner
def _turn_limit(tree: TreeArrays, elements: TreeElements | None) -> float:
    """Return the longest step, s, in which turns can be counted, from the rates of the placed bodies."""
    rate = 0.0
    if elements is not None:
        model, turns = elements.model, elements.turns
        for n in range(turns.shape[0]):
            if model.counted[n]:
                rate = max(rate, abs(coordinate(model, tree.y, tree.A, n, turns[n]).rate))
    return _LARGEST_TURN / rate if rate > 0.0 else np.inf


@inlined
def step_limit(system: KernelArguments, longest: float) -> float:
    """Return the longest step, s, from the state at which the bodies are placed."""
    return min(longest, _turn_limit(system.tree, system.elements))


@inner
def _count_turns(tree: TreeArrays, elements: TreeElements | None) -> None:
    if elements is not None:
        count_turns(elements, tree.y, tree.A)


@inlined
def end_step(system: KernelArguments, t: float, z: Array, at_sample: bool) -> None:
    """Project a state at the end of a step, and count the turns that elements read."""
    project_state(system, t, z, at_sample)
    _count_turns(system.tree, system.elements)


@inner
def _place_first(tree: TreeArrays, elements: TreeElements | None, z: Array) -> None:
    """Place links and bodies where elements read them; angles are within half a turn of zero."""
    if elements is not None:
        place_links_and_bodies(tree.layout, tree.link, tree.free, tree.first_speed, z, tree.y, tree.A)
        count_turns(elements, tree.y, tree.A)


@inlined
def begin_motion(system: KernelArguments, t: float, z: Array, motion: Array, counters: Array) -> None:
    """Project the first state of a motion, record it as the first sample, and set the counters to zero."""
    counters[:] = 0
    _place_first(system.tree, system.elements, z)
    end_step(system, t, z, AT_SAMPLE)
    record_sample(system, motion[0])


@inlined
def end_recorded_step(
    system: KernelArguments, t: float, step: float, end: Array, times: Array, sample: int, motion: Array
) -> tuple[float, int, bool]:
    """End a step, and record the end where it is a sample.

    Parameters
    ----------
    system : KernelArguments
    t, step : float, s
        Start and length of the step.
    end : ndarray, shape (n_z,)
        State at the end of the step; projected in place.
    times, motion : see `explicit_rk.integrate`
    sample : int
        First sample after t.

    Returns
    -------
    after : float, s
        Time of the end.
    left : int
        First sample that is not before the end.
    at_sample : bool
        Whether the end is that sample.
    """
    last = times[-1]
    after = last if step == last - t else t + step
    left = next_sample(times, sample, after)
    at_sample = left < times.shape[0] and times[left] == after
    end_step(system, after, end, at_sample)
    if at_sample:
        record_sample(system, motion[left])
    return after, left, at_sample


@inner
def _keep_rows(closure: LoopClosure | None, order: Array, chosen: Array, back: bool) -> None:
    """Store the active rows and their order, or set them back."""
    if closure is not None:
        if back:
            assign(closure.qr.order, order)
            assign(closure.qr.state["active"], chosen)
        else:
            assign(order, closure.qr.order)
            assign(chosen, closure.qr.state["active"])


@inlined
def record_samples_within(
    system: KernelArguments, z: Array, t: float, step: float, times: Array, motion: Array
) -> None:
    """Record the bodies at times within a step, each state of the dense output projected.

    The projection of a sample selects rows; the next step needs those of the end of this step.

    Parameters
    ----------
    system : KernelArguments
        With an ExplicitScratch or RadauScratch, which holds the dense output F.
    z : ndarray, shape (n_z,)
        State at the start of the step.
    t, step : float, s
        Start and length of the step.
    times : ndarray, shape (n,), s
    motion : ndarray, shape (n, n_b + n_e, 13)
        Overwritten.
    """
    scratch = system.scratch
    _keep_rows(system.closure, scratch.order, scratch.chosen, False)
    for n in range(times.shape[0]):
        dense_output(z, scratch.F, (times[n] - t) / step, scratch.state)
        project_state(system, times[n], scratch.state, AT_SAMPLE)
        record_sample(system, motion[n])
    _keep_rows(system.closure, scratch.order, scratch.chosen, True)
