"""Radau IIA of seven stages, of order 13, in the state z, for stiff motions.

With the right Radau nodes c, the stages ``Z_i = z_i - z`` obey [Hairer and Wanner, section IV.8]

    Z_i = h sum_j a_ij f(t + c_j h, z + Z_j),      z_1 = z + Z_7,

a_ij being the integral of Lagrange polynomial j up to c_i. They are solved by Newton's method with the Jacobian J of f
at the start of the step, by differences. As ``a^-1 = T diag(lambda) T^-1``, an iteration solves four systems of size
n_z,

    (lambda_k / h - J) W_k = lambda_k / h (T^-1 R)_k,   R_i = h sum_j a_ij f_j - Z_i,   Z += T W,

for the real eigenvalue and one of each of three pairs. The step is controlled by the difference to a method of order
seven that uses the derivative at the start [section IV.8],

    (lambda_0 / h - J) err = f(t, z) + sum_i e_i Z_i / h,

and samples come from the polynomial through the stages, also of order seven.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators.step_control import EVALUATIONS, LARGEST, REJECTED, SMALLEST, STEPS, factor_of
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.tree.arrays import KernelArguments, LoopClosure, TreeSystem
from consilience.reference.tree.dense_output import dense_output
from consilience.reference.tree.methods import SECOND
from consilience.reference.tree.radau_coefficients import ESTIMATE, IN, LAMBDA, NESTED, OUT, STAGES, A, C
from consilience.reference.tree.step_control import component_sizes, first_step_length, step_length
from consilience.reference.tree.system import (
    begin_motion,
    end_recorded_step,
    record_samples_within,
    state_derivative,
    step_limit,
)

SAFETY = 0.8
MOST_ITERATIONS = 12
"""Iterations after which the step is shortened."""

NEWTON_TOLERANCE = 1e-2
"""Error of the iterations, as part of the tolerance of a step."""

DIFFERENCE_STEP = np.sqrt(np.finfo(float).eps)
"""Relative step of the differences in the Jacobian."""

SLOWEST_RATE = 0.1
"""Convergence rate of the iterations that the step size aims at, at most."""


class RadauScratch(NamedTuple):
    """Work arrays of an integration."""

    Z: Array  # (7, n_z) stages less the start of the step
    K: Array  # (7, n_z) derivatives at the stages
    J: Array  # (n_z, n_z) Jacobian
    LU: Array  # (4, n_z, n_z) complex, factorised systems
    pivot: Array  # (4, n_z) rows of the pivots
    W: Array  # (4, n_z) complex, right sides and solutions
    f: Array  # (n_z,) derivative at the start
    perturbed: Array  # (n_z,) derivative at a perturbed state
    end: Array  # (n_z,) end of the step
    state: Array  # (n_z,) state of a stage or sample
    F: Array  # (7, n_z) dense output
    size: Array  # (5,) sizes of the kinds of components
    order: Array  # (q,) order of the rows at the end of the step, kept while samples are projected
    chosen: Array


def radau_scratch(z: Array, arrays: TreeSystem, closure: LoopClosure | None) -> RadauScratch:
    """Return work arrays for a motion from the state z."""
    rows, groups = (0, 0) if closure is None else (len(closure.qr.order), len(closure.qr.state))
    n, systems = len(z), len(LAMBDA)
    return RadauScratch(
        Z=np.zeros((STAGES, n)),
        K=np.zeros((STAGES, n)),
        J=np.empty((n, n)),
        LU=np.empty((systems, n, n), dtype=complex),
        pivot=np.empty((systems, n), dtype=np.int64),
        W=np.empty((systems, n), dtype=complex),
        f=np.empty(n),
        perturbed=np.empty(n),
        end=np.empty(n),
        state=np.empty(n),
        F=np.zeros((STAGES, n)),
        size=np.empty(5),
        order=np.empty(rows, dtype=np.int64),
        chosen=np.empty(groups, dtype=np.int64),
    )


@inner
def _exchange(LU: Array, k: int) -> int:
    """Bring the largest entry of column k, on or below the diagonal, into row k; return its former row."""
    best = k
    for i in range(k + 1, LU.shape[0]):
        if abs(LU[i, k]) > abs(LU[best, k]):
            best = i
    if best != k:
        for j in range(LU.shape[0]):
            LU[k, j], LU[best, j] = LU[best, j], LU[k, j]
    return best


@inner
def _factorise(J: Array, shift: complex, LU: Array, pivot: Array) -> None:
    """Factorise ``shift - J`` with partial pivoting."""
    count = J.shape[0]
    for i in range(count):
        for j in range(count):
            LU[i, j] = -J[i, j]
        LU[i, i] += shift
    for k in range(count):
        pivot[k] = _exchange(LU, k)
        for i in range(k + 1, count):
            LU[i, k] /= LU[k, k]
            if LU[i, k] != 0.0:
                for j in range(k + 1, count):
                    LU[i, j] -= LU[i, k] * LU[k, j]


@inner
def _solve(LU: Array, pivot: Array, x: Array) -> None:
    """Solve a factorised system in place."""
    count = LU.shape[0]
    for k in range(count):
        best = pivot[k]
        x[k], x[best] = x[best], x[k]
    for i in range(1, count):
        for j in range(i):
            x[i] -= LU[i, j] * x[j]
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, count):
            x[i] -= LU[i, j] * x[j]
        x[i] /= LU[i, i]


@inlined
def _linearise(system: KernelArguments, t: float, z: Array, counters: Array) -> None:
    """Compute the derivative at the start of a step, and the Jacobian by differences.

    A single call in the loop evaluates all of them, so that the derivative is compiled into this kernel once.
    """
    tree, scratch = system.tree, system.scratch
    f, found, state = scratch.f, scratch.perturbed, scratch.state
    component_sizes(tree.kind, tree.length, z, scratch.size)
    for m in range(-1, z.shape[0]):
        assign(state, z)
        if m >= 0:
            state[m] += DIFFERENCE_STEP * scratch.size[tree.kind[m]]
        state_derivative(system, t, state, found)
        if m < 0:
            assign(f, found)
        else:
            for n in range(z.shape[0]):
                scratch.J[n, m] = (found[n] - f[n]) / (state[m] - z[m])
    counters[EVALUATIONS] += z.shape[0] + 1


@inner
def _residuals(h: float, Z: Array, K: Array, W: Array) -> None:
    """Compute the right sides of the systems."""
    W[:, :] = 0.0
    for n in range(Z.shape[1]):
        for i in range(STAGES):
            residual = -Z[i, n]
            for j in range(STAGES):
                residual += h * A[i, j] * K[j, n]
            for k in range(W.shape[0]):
                W[k, n] += LAMBDA[k] / h * IN[k, i] * residual


@inner
def _correct(kind: Array, W: Array, Z: Array, size: Array) -> float:
    """Correct the stages by the solutions of the systems; return the largest scaled change."""
    largest = 0.0
    for n in range(Z.shape[1]):
        for i in range(STAGES):
            change = 0.0
            for k in range(W.shape[0]):
                change += (OUT[i, k] * W[k, n]).real
            Z[i, n] += change
            if not abs(change) <= largest * size[kind[n]]:  # true for NaN, too
                largest = abs(change) / size[kind[n]]
    return largest


@inlined
def _iterate(
    system: KernelArguments, t: float, h: float, z: Array, tolerance: float, counters: Array
) -> tuple[bool, float]:
    """Iterate the guessed stages in place; return whether they converge, and the convergence rate.

    Parameters
    ----------
    system : KernelArguments
        With a RadauScratch.
    t, h : float, s
        Start and length of the step.
    z, tolerance, counters : see `explicit_rk.integrate`
    """
    scratch = system.scratch
    Z, K, state, last, rate = scratch.Z, scratch.K, scratch.state, np.inf, 0.0
    for left in range(MOST_ITERATIONS, 0, -1):
        for i in range(STAGES):
            for n in range(z.shape[0]):
                state[n] = z[n] + Z[i, n]
            state_derivative(system, t + C[i] * h, state, K[i])
        counters[EVALUATIONS] += STAGES
        _residuals(h, Z, K, scratch.W)
        for k in range(LAMBDA.shape[0]):
            _solve(scratch.LU[k], scratch.pivot[k], scratch.W[k])
        change = _correct(system.tree.kind, scratch.W, Z, scratch.size)
        if not change < np.inf:
            return False, 1.0
        rate, last = change / last, change
        if change * max(rate, SLOWEST_RATE) <= NEWTON_TOLERANCE * tolerance or (rate > 0.5 and change <= tolerance):
            return True, rate
        if not change * rate**left <= tolerance:
            return False, rate
    return False, rate


@inner
def _error(kind: Array, h: float, scratch: RadauScratch) -> float:
    """Return the scaled error estimate of a step."""
    Z, W, size = scratch.Z, scratch.W, scratch.size
    for n in range(Z.shape[1]):
        total = scratch.f[n]
        for i in range(STAGES):
            total += ESTIMATE[i] * Z[i, n] / h
        W[0, n] = total
    _solve(scratch.LU[0], scratch.pivot[0], W[0])
    error = 0.0
    for n in range(Z.shape[1]):
        error += (W[0, n].real / size[kind[n]]) ** 2
    return np.sqrt(error / Z.shape[1])


@inner
def _guess(z: Array, F: Array, ratio: float, Z: Array) -> None:
    """Guess the stages of a step `ratio` times as long as the last one, from the polynomial of the last one."""
    for i in range(STAGES):
        dense_output(z, F, 1.0 + ratio * C[i], Z[i])
        for n in range(z.shape[0]):
            Z[i, n] -= z[n] + F[0, n]


@inlined
def _attempt(
    system: KernelArguments, t: float, h: float, z: Array, tolerance: float, counters: Array
) -> tuple[float, float]:
    """Attempt a step: store its end in the scratch; return its error over the tolerance, and the convergence rate.

    Parameters
    ----------
    system, t, h, z, tolerance, counters : see `_iterate`
    """
    scratch = system.scratch
    for k in range(LAMBDA.shape[0]):
        _factorise(scratch.J, LAMBDA[k] / h, scratch.LU[k], scratch.pivot[k])
    settled, rate = _iterate(system, t, h, z, tolerance, counters)
    if not settled:
        return np.inf, rate
    for n in range(z.shape[0]):
        scratch.end[n] = z[n] + scratch.Z[STAGES - 1, n]
    return _error(system.tree.kind, h, scratch) / tolerance, rate


@inner
def _factor(error: float, rate: float, most: float) -> float:
    """Return the change of the step size from the error of the step, 0.5 where infinite, and the convergence rate."""
    by_error = factor_of(error, SAFETY, LARGEST) if error < np.inf else 0.5
    return max(SMALLEST, min(most, by_error, SLOWEST_RATE / rate))


@inner
def _interpolate(Z: Array, F: Array) -> None:
    """Compute the dense output of a step."""
    for n in range(Z.shape[1]):
        for i in range(STAGES):
            total = 0.0
            for j in range(STAGES):
                total += NESTED[i, j] * Z[j, n]
            F[i, n] = total


@inner
def _integrate(
    system: KernelArguments, z: Array, times: Array, tolerance: float, longest: float, motion: Array, counters: Array
) -> int:
    """Integrate as `integrate_radau`, compiled for each combination of arrays that are None."""
    scratch = system.scratch
    t, last, sample = times[0], times[-1], SECOND
    scratch.F[:] = 0.0
    begin_motion(system, t, z, motion, counters)
    if times.shape[0] == 1:
        return 0
    bound, h, before, most, accepted = step_limit(system, longest), 0.0, np.inf, LARGEST, True
    while sample < times.shape[0]:
        if accepted:
            _linearise(system, t, z, counters)
            h = h if h > 0.0 else first_step_length(system.tree.kind, scratch.f, last - t, tolerance, scratch.size)
        step = step_length(min(h, bound), last - t)
        if not step >= 1e-14 * max(1.0, abs(t)):
            return 1
        _guess(z, scratch.F, step / before, scratch.Z)
        error, rate = _attempt(system, t, step, z, tolerance, counters)
        factor, accepted = _factor(error, rate, most), error <= 1.0
        if not accepted:
            counters[REJECTED] += 1
            h, most = step * factor, 1.0
            continue
        counters[STEPS] += 1
        _interpolate(scratch.Z, scratch.F)
        after, left, at_sample = end_recorded_step(system, t, step, scratch.end, times, sample, motion)
        bound = step_limit(system, longest)
        if sample < left:
            record_samples_within(system, z, t, step, times[sample:left], motion[sample:left])
        sample = left + 1 if at_sample else left
        assign(z, scratch.end)
        t, h, before, most = after, step * factor if step == h else max(h, step * factor), step, LARGEST
    return 0


@kernel
def integrate_radau(
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
