"""Adaptive explicit Runge-Kutta pairs of order 8.

    K_i = f(t + c_i h, z + h sum_j a_ij K_j),    z_1 = z + h sum_i b_i K_i         [Hairer, Norsett, Wanner, chapter II]

Error estimate of Dormand-Prince 8(5,3) [section II.10], each component scaled by the size of its kind:

    err = |h| |e5|^2 / sqrt(|e5|^2 + 0.01 |e3|^2),    e5 = sum E5_i K_i,  e3 = sum E3_i K_i.

Samples are taken from the dense output, a polynomial of degree seven that costs three or four evaluations in a step
with samples.

Stiffness: the last stage z_s of a step and its end z are two states at nearly one time, and ``|f(z) - f(z_s)| /
|z - z_s|`` estimates the fastest rate of decay |lambda| [Hairer and Wanner, section IV.2].
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators.coefficients import DORMAND_PRINCE, STAGES, Explicit
from consilience.reference.integrators.step_control import LARGEST, UNSUITABLE, factor_of
from consilience.reference.integrators.tsitouras import TSITOURAS
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.kernel.operation import Operation, array_of
from consilience.reference.kernel.record_type import INT, record_type
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers.driver import CompiledStepper
from consilience.reference.steppers.motion import (
    ATTEMPT,
    INTERPOLATE,
    PREPARE,
    MotionArrays,
    component_sizes,
    derivative,
    first_step_length,
)

STIFF_STEP, STIFF_STEPS, FEWEST_STEPS_LEFT = 3.5, 15, 100
"""Declare stiffness when h |lambda| exceeds 3.5 on 15 more steps than not, with more than 100 steps to go. The
stability limit of the pairs is about 6; steps that accuracy limits are shorter.
"""

LARGEST_FIRST = 1e4
"""Largest growth of the step after the first one, whose length is a guess from a single derivative."""

SAFETY = 0.8
"""Safety factor of the step size, chosen for few rejected steps."""

_STIFFNESS = record_type(("step", float), ("count", INT), ("knows_end", INT))
"""Length of the last step, zero once looked at; stiff steps so far; whether K holds the derivative at the end."""


class RungeKuttaPair(NamedTuple):
    """A pair of twelve stages; stage 12 is the end of the step, the s - 13 stages behind serve the dense output."""

    table: Array  # (s, s) weights of the stages; row 12 holds those of the step
    nodes: Array  # (s,)
    estimate: Array  # (2, 12) weights of the error estimate; the second row, if not zero, is of lower order
    power: float  # power of the estimate that is proportional to the eighth power of the step
    dense: Array  # (4, s) weights of F_3 and higher of the dense output


def _pair(method: Explicit, power: float) -> RungeKuttaPair:
    nodes = np.concatenate([method.c, [1.0], method.c_dense])
    table, estimate = np.zeros((len(nodes), len(nodes))), np.zeros((2, STAGES))
    table[:STAGES, :STAGES], table[STAGES, :STAGES], table[STAGES + 1 :] = method.A, method.b, method.A_dense
    estimate[: len(method.E)] = method.E
    return RungeKuttaPair(table, nodes, estimate, power, method.D)


DOP853 = _pair(DORMAND_PRINCE, 1.0)
"""Dormand-Prince 8(5,3)."""

TP86 = _pair(TSITOURAS, 8.0 / 7.0)
"""Tsitouras-Papakostas 8(6).

The estimate belongs to the method of order six and exceeds the error of the solution of order eight. With this power
the steps are about as long as those of DOP853 at the same tolerance. A node lies behind the end of the step, where a
table may be undefined.
"""


class ExplicitArrays(NamedTuple):
    """Record of the kernels of an explicit pair."""

    motion: MotionArrays
    pair: RungeKuttaPair
    K: Array  # (s, n_z) derivatives at the stages
    F: Array  # (7, n_z) dense output
    last_stage: Array  # (2, n_z) state and derivative of the last stage of the last step
    stiffness: Array  # (1,) of _STIFFNESS


def explicit_arrays(pair: RungeKuttaPair, motion: MotionArrays) -> ExplicitArrays:
    """Return the record of a pair for a motion."""
    n = len(motion.z)
    K, F = np.zeros((len(pair.nodes), n)), np.empty((3 + len(pair.dense), n))
    return ExplicitArrays(motion, pair, K, F, np.empty((2, n)), np.zeros(1, _STIFFNESS))


@inner
def _stage(table: Array, z: Array, K: Array, h: float, i: int, state: Array) -> None:
    """Compute the state at which stage i is evaluated."""
    for n in range(z.shape[0]):
        state[n] = z[n]
    for j in range(i):
        weight = h * table[i, j]
        if weight != 0.0:
            for n in range(z.shape[0]):
                state[n] += weight * K[j, n]


@inner
def _evaluate(arrays: ExplicitArrays, t: float, z: Array, first: int, last: int) -> None:
    """Evaluate stages `first` to `last` - 1 of a step from z."""
    motion, pair, K = arrays.motion, arrays.pair, arrays.K
    h = motion.run[0].step
    for i in range(first, last):
        _stage(pair.table, z, K, h, i, motion.state)
        derivative(motion, t + pair.nodes[i] * h, motion.state, K[i])


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
def _decay_rate(kind: Array, z: Array, f: Array, last_stage: Array, size: Array, tolerance: float) -> float:
    """Return the rate of decay between the last stage of a step and its end; zero where they agree to rounding."""
    states = slopes = 0.0
    for n in range(z.shape[0]):
        states += ((z[n] - last_stage[0, n]) / size[kind[n]]) ** 2
        slopes += ((f[n] - last_stage[1, n]) / size[kind[n]]) ** 2
    least = max(1e-13, 1e-3 * tolerance)
    return np.sqrt(slopes / states) if states > least**2 * z.shape[0] else 0.0


@inner
def _is_stiff(arrays: ExplicitArrays, z: Array) -> bool:
    """Count the last step, if it was stiff; return whether the motion is."""
    motion, stiff = arrays.motion, arrays.stiffness[0]
    run = motion.run[0]
    rate = _decay_rate(motion.kind, z, arrays.K[0], arrays.last_stage, motion.size, run.tolerance)
    stiff.count = stiff.count + 1 if stiff.step * rate > STIFF_STEP else max(0, stiff.count - 1)
    return stiff.count >= STIFF_STEPS and run.span > FEWEST_STEPS_LEFT * run.h


@inlined
def _prepare(arrays: ExplicitArrays, t: float, z: Array) -> None:
    """Compute the derivative and the sizes at a new state; in the first, propose a step."""
    motion, stiff, K = arrays.motion, arrays.stiffness[0], arrays.K
    run = motion.run[0]
    if run.h == 0.0:
        stiff.step, stiff.count, stiff.knows_end, run.step = 0.0, 0, 0, 0.0
    if stiff.knows_end:
        assign(K[0], K[STAGES])
    else:
        _evaluate(arrays, t, z, 0, 1)
    component_sizes(motion.kind, motion.length, z, motion.size)
    if run.h == 0.0:
        run.h = first_step_length(motion.kind, K[0], run.span, run.tolerance, motion.size)
        run.failure = 1 if np.isfinite(run.h) else 2
    if run.stop_if_stiff and stiff.step > 0.0 and _is_stiff(arrays, z):
        run.status = UNSUITABLE
    stiff.knows_end = 0


@inlined
def _attempt(arrays: ExplicitArrays, t: float, z: Array, end: Array) -> float:
    """Attempt a step; return its error over the tolerance."""
    motion, pair, K, stiff = arrays.motion, arrays.pair, arrays.K, arrays.stiffness[0]
    run = motion.run[0]
    _evaluate(arrays, t, z, 1, STAGES)
    _stage(pair.table, z, K, run.step, STAGES, end)
    error = _error(motion.kind, K, run.step, motion.size, pair.estimate, pair.power) / run.tolerance
    run.failure = 1 if np.isfinite(error) else 2  # a stage far from the motion may overflow; shorter steps end this
    first = run.steps + run.rejected == 0
    run.factor = factor_of(error, SAFETY, min(run.most, LARGEST_FIRST if first else LARGEST))
    if error <= 1.0:
        assign(arrays.last_stage[0], motion.state)
        assign(arrays.last_stage[1], K[STAGES - 1])
        stiff.step = run.step
    return error


@kernel
def interpolate(dense: Array, z: Array, end: Array, K: Array, h: float, F: Array) -> None:
    """Compute the dense output of a step in the nested form of `integrators.tableaus`.

    Parameters
    ----------
    dense : ndarray, shape (4, s)
        Coefficients of the dense output of the pair.
    z, end : ndarray, shape (n_z,)
        States at the start and the end of the step.
    K : ndarray, shape (s, n_z)
        Derivatives at the stages.
    h : float, s
    F : ndarray, shape (7, n_z)
        Overwritten.
    """
    for n in range(z.shape[0]):
        F[0, n] = end[n] - z[n]
        F[1, n] = h * K[0, n] - F[0, n]
        F[2, n] = 2.0 * F[0, n] - h * (K[0, n] + K[STAGES, n])
        for i in range(dense.shape[0]):
            total = 0.0
            for j in range(dense.shape[1]):
                total += dense[i, j] * K[j, n]
            F[3 + i, n] = h * total


@kernel
def dense_output(z: Array, F: Array, x: float, state: Array) -> None:
    """Evaluate the dense output F at the fraction x of a step."""
    for n in range(z.shape[0]):
        total = 0.0
        for i in range(F.shape[0] - 1, -1, -1):
            total = (total + F[i, n]) * (1.0 - x if i % 2 else x)
        state[n] = z[n] + total


@inlined
def _interpolate(arrays: ExplicitArrays, t: float, z: Array, end: Array) -> None:
    """Evaluate the stages behind the end of a step, and compute the dense output."""
    pair, K, h = arrays.pair, arrays.K, arrays.motion.run[0].step
    derivative(arrays.motion, t + h, end, K[STAGES])
    _evaluate(arrays, t, z, STAGES + 1, pair.nodes.shape[0])
    arrays.stiffness[0].knows_end = 1
    interpolate(pair.dense, z, end, K, h, arrays.F)


@Operation
def step(arrays: ExplicitArrays, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests of the driver: see `motion.PREPARE`.

    Parameters
    ----------
    arrays : ExplicitArrays
    request, t, z, out : see `motion.ask`
    """
    before, after = array_of(z), array_of(out)
    if request == PREPARE:
        _prepare(arrays, t, before)
    elif request == ATTEMPT:
        return _attempt(arrays, t, before, after)
    elif request == INTERPOLATE:
        _interpolate(arrays, t, before, after)
    else:
        dense_output(before, arrays.F, t / arrays.motion.run[0].step, after)
    return 0.0


PAIRS = {"tp86": TP86, "dop853": DOP853}
STEPPERS = {name: CompiledStepper(partial(explicit_arrays, pair), step) for name, pair in PAIRS.items()}
"""Explicit pairs by name, and their steppers."""
