"""Collocation at the Gauss points in the state z, of order 16: an integrator independent of the others.

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
from consilience.reference.kernel.compiled import inlined, inner
from consilience.reference.kernel.operation import Operation, array_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers.driver import CompiledStepper
from consilience.reference.steppers.motion import PREPARE, MotionArrays, component_sizes, derivative

STAGES = 8
MOST_ITERATIONS = 14
"""Iterations after which the step is halved."""

LARGEST, SMALLEST, SAFETY = 3.0, 0.3, 0.9

FIRST_STEP = 1e-3
"""First step, as part of the motion."""


class GaussArrays(NamedTuple):
    """Record of the kernels of Gauss collocation."""

    motion: MotionArrays
    K: Array  # (8, n_z) stages of the last step
    guess: Array  # (8, n_z) stages of the next step
    found: Array  # (n_z,) derivative of a stage


def gauss_arrays(motion: MotionArrays) -> GaussArrays:
    """Return the record for a motion."""
    K, guess = np.zeros((2, STAGES, len(motion.z)))
    return GaussArrays(motion, K, guess, np.empty(len(motion.z)))


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


@inner
def _iterate(arrays: GaussArrays, t: float, z: Array) -> bool:
    """Iterate the guessed stages of a step in place; return whether they converge to rounding."""
    motion, K, found = arrays.motion, arrays.guess, arrays.found
    h, state, kind, size = motion.run[0].step, motion.state, motion.kind, motion.size
    last = np.inf
    for _ in range(MOST_ITERATIONS):
        change = 0.0
        for i in range(STAGES):
            assign(state, z)
            for j in range(STAGES):
                for n in range(z.shape[0]):
                    state[n] += h * A[i, j] * K[j, n]
            derivative(motion, t + C[i] * h, state, found)
            for n in range(z.shape[0]):
                change = max(change, h * abs(found[n] - K[i, n]) / size[kind[n]])
                K[i, n] = found[n]
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
def _advance(arrays: GaussArrays, h: float, z: Array, end: Array) -> None:
    """Compute the end of a step, and keep its stages."""
    for n in range(z.shape[0]):
        end[n] = z[n]
        for i in range(STAGES):
            end[n] += h * B[i] * arrays.guess[i, n]
    for i in range(STAGES):
        assign(arrays.K[i], arrays.guess[i])


@inlined
def _prepare(arrays: GaussArrays, z: Array) -> None:
    """Compute the sizes at a new state; in the first, propose a step."""
    motion = arrays.motion
    component_sizes(motion.kind, motion.length, z, motion.size)
    if motion.run[0].h == 0.0:
        motion.run[0].h = FIRST_STEP * motion.run[0].span


@inlined
def _attempt(arrays: GaussArrays, t: float, z: Array, end: Array) -> float:
    """Attempt a step; return the roughness of its stages over the allowed one."""
    motion, guess = arrays.motion, arrays.guess
    run = motion.run[0]
    if run.step > 2.0 * run.before or run.before == np.inf:
        guess[:] = 0.0
    else:
        _extrapolate(arrays.K, run.step / run.before, guess)
    if not _iterate(arrays, t, z):
        run.factor = 0.5
        return np.inf
    rough = _roughness(motion.kind, guess, run.step, motion.size) / np.sqrt(run.tolerance)
    factor = LARGEST if rough == 0.0 else SAFETY * rough ** (-1.0 / STAGES)
    run.factor = max(SMALLEST, factor) if rough > 1.0 else min(LARGEST, factor)
    if rough <= 1.0:
        _advance(arrays, run.step, z, end)
    return rough


@Operation
def step(arrays: GaussArrays, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests of the driver: see `motion.PREPARE`.

    Parameters
    ----------
    arrays : GaussArrays
    request, t, z, out : see `motion.ask`
    """
    if request == PREPARE:
        _prepare(arrays, array_of(z))
        return 0.0
    return _attempt(arrays, t, array_of(z), array_of(out))


STEPPERS = {"gauss": CompiledStepper(gauss_arrays, step, lands=True)}
"""The method by its name."""
