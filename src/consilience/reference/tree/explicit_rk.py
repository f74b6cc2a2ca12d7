"""Adaptive explicit Runge-Kutta pairs of order 8 in the state z, with projection after every step.

The error estimate is that of `formulations.compiled_dop853`, each component scaled by the tolerance times the size of
its kind [Hairer, Norsett, Wanner, section II.10]. Samples do not shorten steps: they are taken from the dense output, a
polynomial of degree seven that costs three or four evaluations in a step with samples, and are projected.

Stiffness: the last stage z_s of a step and its end z are two states at nearly one time, and ``|f(z) - f(z_s)| /
|z - z_s|`` estimates the fastest rate of decay |lambda| [Hairer and Wanner, section IV.2].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators.coefficients import DORMAND_PRINCE, STAGES
from consilience.reference.integrators.step_control import EVALUATIONS, LARGEST, REJECTED, STEPS, factor_of
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.tree.arrays import KernelArguments, LoopClosure, TreeSystem
from consilience.reference.tree.dense_output import interpolate
from consilience.reference.tree.methods import BEGIN, END, SECOND, STAGES_AT_MOST, RungeKuttaPair
from consilience.reference.tree.step_control import component_sizes, first_step_length, step_length
from consilience.reference.tree.system import (
    begin_motion,
    end_recorded_step,
    record_samples_within,
    state_derivative,
    step_limit,
)

UNSUITABLE = 3
"""Status of a motion that another integrator has to take."""

STIFF_STEP, STIFF_STEPS, FEWEST_STEPS_LEFT = 3.5, 15, 100
"""Declare stiffness when h |lambda| exceeds 3.5 on 15 more steps than not, with more than 100 steps to go. The
stability limit of the pairs is about 6; steps that accuracy limits are shorter.
"""

LARGEST_FIRST = 1e4
"""Largest growth of the step after the first one, whose length is a guess from a single derivative."""

SAFETY = 0.8
"""Safety factor of the step size, chosen for few rejected steps."""


class ExplicitScratch(NamedTuple):
    """Work arrays of an integration."""

    K: Array  # (17, n_z) derivatives at the stages
    end: Array  # (n_z,) end of the step
    state: Array  # (n_z,) state of a stage or sample
    F: Array  # (7, n_z) dense output
    size: Array  # (5,) sizes of the kinds of components
    order: Array  # (q,) order of the rows at the end of the step, kept while samples are projected
    chosen: Array
    last_stage: Array  # (2, n_z) state and derivative of the last stage of the last step
    pair: RungeKuttaPair


def explicit_scratch(
    pair: RungeKuttaPair, z: Array, arrays: TreeSystem, closure: LoopClosure | None
) -> ExplicitScratch:
    """Return work arrays for a motion from the state z by a pair."""
    rows, groups = (0, 0) if closure is None else (len(closure.qr.order), len(closure.qr.state))
    return ExplicitScratch(
        K=np.zeros((STAGES_AT_MOST, len(z))),
        end=np.empty(len(z)),
        state=np.empty(len(z)),
        F=np.empty((3 + len(DORMAND_PRINCE.D), len(z))),
        size=np.empty(5),
        order=np.empty(rows, dtype=np.int64),
        chosen=np.empty(groups, dtype=np.int64),
        last_stage=np.empty((2, len(z))),
        pair=pair,
    )


@inner
def _error(kind: Array, K: Array, h: float, size: Array, estimate: Array, power: float) -> float:
    """Return the scaled error estimate of a step."""
    error = lower = 0.0
    count = K.shape[1]
    for n in range(count):
        one = two = 0.0
        for i in range(STAGES):
            one += estimate[0, i] * K[i, n]
            two += estimate[1, i] * K[i, n]
        scale = size[kind[n]]
        error += (one / scale) ** 2
        lower += (two / scale) ** 2
    if error == 0.0 and lower == 0.0:
        return 0.0
    return (abs(h) * error / np.sqrt((error + 0.01 * lower) * count)) ** power


@inner
def _stage(table: Array, z: Array, K: Array, h: float, i: int, trial: Array) -> None:
    """Compute the state at which a stage is evaluated."""
    for n in range(z.shape[0]):
        trial[n] = z[n]
    for j in range(i):
        weight = h * table[i, j]
        if weight != 0.0:
            for n in range(z.shape[0]):
                trial[n] += weight * K[j, n]


@inner
def _evaluate(system: KernelArguments, z: Array, t: float, h: float, first: int, last: int, counters: Array) -> None:
    """Evaluate stages `first` to `last` - 1 of a step from z; stage END is the end of the step in the scratch.

    Parameters
    ----------
    system : KernelArguments
        With an ExplicitScratch.
    z : ndarray, shape (n_z,)
    t, h : float, s
        Start and length of the step.
    first, last : int
    counters : ndarray of int, shape (3,)
    """
    scratch = system.scratch
    state, pair = scratch.state, scratch.pair
    for i in range(first, last):
        if i == END:
            assign(state, scratch.end)
        else:
            _stage(pair.table, z, scratch.K, h, i, state)
        state_derivative(system, t + pair.nodes[i] * h, state, scratch.K[i])
    counters[EVALUATIONS] += last - first


@inlined
def _attempt(system: KernelArguments, z: Array, t: float, step: float, first: int, last: int, counters: Array) -> float:
    """Evaluate stages as `_evaluate`; store the end of the step in the scratch and return its scaled error."""
    tree, scratch = system.tree, system.scratch
    pair, K, size = scratch.pair, scratch.K, scratch.size
    _evaluate(system, z, t, step, first, last, counters)
    _stage(pair.table, z, K, step, END, scratch.end)
    component_sizes(tree.kind, tree.length, z, size)
    return _error(tree.kind, K, step, size, pair.estimate, pair.power)


@inner
def _advance(z: Array, end: Array, K: Array, first: int) -> None:
    """Replace z by the end of a step; its derivative, where known, becomes the first stage of the next step."""
    for n in range(z.shape[0]):
        z[n] = end[n]
        if first == SECOND:
            K[0, n] = K[END, n]


@inner
def _decay_rate(kind: Array, z: Array, f: Array, last_stage: Array, size: Array, tolerance: float) -> float:
    """Return the rate of decay between the last stage of a step and its end; zero where they agree to rounding."""
    states = slopes = 0.0
    for n in range(z.shape[0]):
        states += ((z[n] - last_stage[0, n]) / size[kind[n]]) ** 2
        slopes += ((f[n] - last_stage[1, n]) / size[kind[n]]) ** 2
    least = max(1e-13, 1e-3 * tolerance)
    return np.sqrt(slopes / states) if states > least**2 * z.shape[0] else 0.0


@inner
def _integrate(
    system: KernelArguments,
    z: Array,
    times: Array,
    tolerance: float,
    longest: float,
    motion: Array,
    counters: Array,
    stop_if_stiff: bool,
) -> int:
    """Integrate as `integrate`, compiled for each combination of arrays that are None."""
    kind, scratch = system.tree.kind, system.scratch
    K, end, size, behind = scratch.K, scratch.end, scratch.size, scratch.pair.nodes.shape[0]
    t, last, sample = times[0], times[-1], SECOND
    begin_motion(system, t, z, motion, counters)
    if times.shape[0] == 1:
        return 0
    bound = step_limit(system, longest)
    _attempt(system, z, t, 0.0, BEGIN, SECOND, counters)
    h, first = first_step_length(kind, K[0], last - t, tolerance, size), SECOND
    finite, most, last_step, stiff_steps = np.isfinite(h), LARGEST_FIRST, 0.0, 0
    while sample < times.shape[0]:
        step = step_length(min(h, bound), last - t)
        if not step >= 1e-14 * max(1.0, abs(t)):
            return 1 if finite else 2
        error = _attempt(system, z, t, step, first, END, counters) / tolerance
        if stop_if_stiff and last_step > 0.0:
            long = last_step * _decay_rate(kind, z, K[0], scratch.last_stage, size, tolerance) > STIFF_STEP
            last_step, stiff_steps = 0.0, stiff_steps + 1 if long else max(0, stiff_steps - 1)
            if stiff_steps >= STIFF_STEPS and last - t > FEWEST_STEPS_LEFT * step:
                return UNSUITABLE
        finite = np.isfinite(error)  # a stage far from the motion may overflow; shorter steps end this
        factor = factor_of(error, SAFETY, most)
        if not error <= 1.0:
            counters[REJECTED] += 1
            h, first, most = step * factor, SECOND, 1.0  # the first stage stays valid
            continue
        counters[STEPS] += 1
        assign(scratch.last_stage[0], scratch.state)
        assign(scratch.last_stage[1], K[END - 1])
        after, left, at_sample = end_recorded_step(system, t, step, end, times, sample, motion)
        bound, first = step_limit(system, longest), BEGIN
        if sample < left:
            _evaluate(system, z, t, step, END, behind, counters)
            interpolate(scratch.pair.dense, z, end, K, step, scratch.F)
            record_samples_within(system, z, t, step, times[sample:left], motion[sample:left])
            first = SECOND
        _advance(z, end, K, first)
        sample = left + 1 if at_sample else left
        t, h, most, last_step = after, step * factor if step == h else max(h, step * factor), LARGEST, step
    return 0


@kernel
def integrate(
    run: KernelArguments,
    z: Array,
    times: Array,
    tolerance: float,
    longest: float,
    motion: Array,
    counters: Array,
    stop_if_stiff: bool,
) -> int:
    """Integrate from ``times[0]`` and record the bodies at all sample times.

    Parameters
    ----------
    run : KernelArguments
        As a record array (`record_array`), with an ExplicitScratch.
    z : ndarray, shape (n_z,)
        Initial state; overwritten by the last.
    times : ndarray, shape (n_t,), s
    tolerance : float
        Bound on the scaled local error.
    longest : float, s
        Bound on the steps.
    motion : ndarray, shape (n_t, n_b + n_e, 13)
        Overwritten: bodies as in `reference.bodies`.
    counters : ndarray of int, shape (3,)
        Overwritten: accepted steps, rejected steps, evaluations.
    stop_if_stiff : bool
        Whether to return UNSUITABLE once the motion is found stiff.

    Returns
    -------
    int
        Key of `integrators.step_control.STATUS`, or UNSUITABLE.
    """
    return _integrate(fields_of(run), z, times, tolerance, longest, motion, counters, stop_if_stiff)
