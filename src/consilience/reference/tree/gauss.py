"""Collocation at the Gauss points in the state z, of order 16: an integrator independent of `explicit_rk`.

With the nodes c of Gauss quadrature with eight points, the stages obey [Hairer, Norsett, Wanner, section II.7]

    K_i = f(t + c_i h, z + h sum_j a_ij K_j),     z_1 = z + h sum_i b_i K_i,

a_ij being the integral of Lagrange polynomial j up to c_i. The stages are found by Gauss-Seidel iteration from the
polynomial of the step before. The last divided difference of the stages, of order 7, measures how well a polynomial
follows the motion; the error of the step is proportional to its square. Steps end at samples, where the order is 16.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

from consilience.mechanism import Array
from consilience.reference.integrators.step_control import EVALUATIONS, REJECTED, STEPS
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.tree.arrays import KernelArguments, LoopClosure, TreeSystem
from consilience.reference.tree.projection import AT_SAMPLE
from consilience.reference.tree.step_control import component_sizes
from consilience.reference.tree.system import begin_motion, end_step, record_sample, state_derivative, step_limit

STAGES = 8
MOST_ITERATIONS = 14
"""Iterations after which the step is halved."""

LARGEST, SMALLEST, SAFETY = 3.0, 0.3, 0.9


class GaussScratch(NamedTuple):
    """Work arrays of an integration."""

    K: Array  # (8, n_z) stages of the last step
    guess: Array  # (8, n_z) stages of the next step
    trial: Array  # (n_z,) state of a stage
    found: Array  # (n_z,) derivative of a stage
    size: Array  # (5,) sizes of the kinds of components


def gauss_scratch(z: Array, arrays: TreeSystem, closure: LoopClosure | None) -> GaussScratch:
    """Return work arrays for a motion from the state z."""
    count = len(z)
    return GaussScratch(
        np.zeros((STAGES, count)), np.zeros((STAGES, count)), np.empty(count), np.empty(count), np.empty(5)
    )


def lagrange_integrals(x: Array, weights: Array) -> Array:
    """Return the integrals of the Lagrange polynomials from -1 to each node, by Legendre series."""
    P = legvander(x, len(x))
    total = np.outer(x + 1.0, np.ones_like(x))
    for k in range(1, len(x)):
        total += np.outer(P[:, k + 1] - P[:, k - 1], P[:, k])
    return np.asarray(0.5 * total * weights)


_NODES, _WEIGHTS = leggauss(STAGES)
C, B, A = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS, 0.5 * lagrange_integrals(_NODES, _WEIGHTS)
DIFFERENCE = np.array([1.0 / np.prod(C[j] - np.delete(C, j)) for j in range(STAGES)])
"""Weights of the last divided difference of the stages; their magnitudes sum to one."""
DIFFERENCE /= np.sum(np.abs(DIFFERENCE))
"""Weights of the last divided difference of the stages, scaled to a mean."""


@inner
def _extrapolate(K: Array, ratio: float, guess: Array) -> None:
    """Extrapolate the stages of the next step, `ratio` times as long, from the polynomial through the last ones."""
    for i in range(STAGES):
        x = 1.0 + C[i] * ratio
        guess[i, :] = 0.0
        for j in range(STAGES):
            weight = 1.0
            for m in range(STAGES):
                if m != j:
                    weight *= (x - C[m]) / (C[j] - C[m])
            for n in range(K.shape[1]):
                guess[i, n] += weight * K[j, n]


@inlined
def _iterate(system: KernelArguments, t: float, h: float, z: Array, counters: Array) -> bool:
    """Iterate the guessed stages of a step in place; return whether they converge to rounding.

    Parameters
    ----------
    system : KernelArguments
        With a GaussScratch.
    t, h : float, s
        Start and length of the step.
    z, counters : see `explicit_rk.integrate`
    """
    kind, scratch = system.tree.kind, system.scratch
    K, size, trial, found = scratch.guess, scratch.size, scratch.trial, scratch.found
    last = np.inf
    for _ in range(MOST_ITERATIONS):
        change = 0.0
        for i in range(STAGES):
            assign(trial, z)
            for j in range(STAGES):
                for n in range(z.shape[0]):
                    trial[n] += h * A[i, j] * K[j, n]
            state_derivative(system, t + C[i] * h, trial, found)
            for n in range(z.shape[0]):
                change = max(change, h * abs(found[n] - K[i, n]) / size[kind[n]])
                K[i, n] = found[n]
        counters[EVALUATIONS] += STAGES
        if change <= 1e-16 or (change <= 1e-13 and change > 0.5 * last):
            return True
        if not change < 1e3:
            return False
        last = change
    return False


@inner
def _roughness(kind: Array, K: Array, h: float, size: Array) -> float:
    """Return the scaled last divided difference of the stages."""
    largest = 0.0
    for n in range(K.shape[1]):
        total = 0.0
        for i in range(STAGES):
            total += DIFFERENCE[i] * K[i, n]
        largest = max(largest, h * abs(total) / size[kind[n]])
    return largest


@inner
def _integrate(
    system: KernelArguments, z: Array, times: Array, tolerance: float, longest: float, motion: Array, counters: Array
) -> int:
    """Integrate as `integrate_gauss`, compiled for each combination of arrays that are None."""
    tree, scratch = system.tree, system.scratch
    K, guess, size = scratch.K, scratch.guess, scratch.size
    begin_motion(system, times[0], z, motion, counters)
    allowed = np.sqrt(tolerance)
    t, h, before = times[0], 1e-3 * (times[-1] - times[0]), 0.0
    for sample in range(1, times.shape[0]):
        while t < times[sample]:
            remaining = times[sample] - t
            free = min(h, step_limit(system, longest))
            step = remaining if free >= remaining else min(free, 0.5 * remaining)
            if step < 1e-14 * max(1.0, abs(t)):
                return 1
            component_sizes(tree.kind, tree.length, z, size)
            if before > 0.0:
                _extrapolate(K, step / before, guess)
            if before == 0.0 or step > 2.0 * before:
                guess[:] = 0.0
            settled = _iterate(system, t, step, z, counters)
            rough = _roughness(tree.kind, guess, step, size) / allowed if settled else np.inf
            if rough > 1.0:
                counters[REJECTED] += 1
                h = step * (max(SMALLEST, SAFETY * rough ** (-1.0 / STAGES)) if settled else 0.5)
                continue
            counters[STEPS] += 1
            for i in range(STAGES):
                for n in range(z.shape[0]):
                    z[n] += step * B[i] * guess[i, n]
            for i in range(STAGES):
                assign(K[i], guess[i])
            before = step
            factor = LARGEST if rough == 0.0 else min(LARGEST, SAFETY * rough ** (-1.0 / STAGES))
            h = step * factor if step == free else max(h, step * factor)
            t = times[sample] if step == remaining else t + step
            end_step(system, t, z, AT_SAMPLE)
        record_sample(system, motion[sample])
    return 0


@kernel
def integrate_gauss(
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
    run, z, times, tolerance, longest, motion, counters, stop_if_stiff : see `explicit_rk.integrate`
        The last has no effect.

    Returns
    -------
    int
        Key of `integrators.step_control.STATUS`.
    """
    return _integrate(fields_of(run), z, times, tolerance, longest, motion, counters)
