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
from consilience.reference.tree.arrays import KernelArguments, LoopClosure, Planar, Spatial, TreeArrays, TreeElements
from consilience.reference.tree.dense_output import dense_output, record_samples_within
from consilience.reference.tree.dynamics import state_derivative
from consilience.reference.tree.methods import SECOND
from consilience.reference.tree.projection import begin_motion, end_step, record_sample, step_limit
from consilience.reference.tree.radau_coefficients import ESTIMATE, IN, LAMBDA, NESTED, OUT, STAGES, A, C
from consilience.reference.tree.step_control import component_sizes, first_step_length, next_sample, step_length

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


def radau_scratch(z: Array, closure: LoopClosure | None) -> RadauScratch:
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


@inner
def _derivative(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    dz: Array,
) -> None:
    """Compute the state derivative; a kernel of its own, because the code is long."""
    state_derivative(tree, closure, spatial, elements, planar, t, z, dz)


@inlined
def _linearise(
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    z: Array,
    counters: Array,
    scratch: RadauScratch,
) -> None:
    """Compute the derivative at the start of a step, and the Jacobian by differences.

    A single call in the loop evaluates all of them, so that the derivative is compiled into this kernel once.
    """
    f, found, state = scratch.f, scratch.perturbed, scratch.state
    component_sizes(tree.kind, tree.length, z, scratch.size)
    for m in range(-1, z.shape[0]):
        assign(state, z)
        if m >= 0:
            state[m] += DIFFERENCE_STEP * scratch.size[tree.kind[m]]
        _derivative(tree, closure, spatial, elements, planar, t, state, found)
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
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    h: float,
    z: Array,
    tolerance: float,
    counters: Array,
    scratch: RadauScratch,
) -> tuple[bool, float]:
    """Iterate the guessed stages in place; return whether they converge, and the convergence rate."""
    Z, K, state, last, rate = scratch.Z, scratch.K, scratch.state, np.inf, 0.0
    for left in range(MOST_ITERATIONS, 0, -1):
        for i in range(STAGES):
            for n in range(z.shape[0]):
                state[n] = z[n] + Z[i, n]
            _derivative(tree, closure, spatial, elements, planar, t + C[i] * h, state, K[i])
        counters[EVALUATIONS] += STAGES
        _residuals(h, Z, K, scratch.W)
        for k in range(LAMBDA.shape[0]):
            _solve(scratch.LU[k], scratch.pivot[k], scratch.W[k])
        change = _correct(tree.kind, scratch.W, Z, scratch.size)
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
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    t: float,
    h: float,
    z: Array,
    tolerance: float,
    counters: Array,
    scratch: RadauScratch,
) -> tuple[float, float]:
    """Attempt a step: store its end in the scratch; return its error over the tolerance, and the convergence rate."""
    for k in range(LAMBDA.shape[0]):
        _factorise(scratch.J, LAMBDA[k] / h, scratch.LU[k], scratch.pivot[k])
    settled, rate = _iterate(tree, closure, spatial, elements, planar, t, h, z, tolerance, counters, scratch)
    if not settled:
        return np.inf, rate
    for n in range(z.shape[0]):
        scratch.end[n] = z[n] + scratch.Z[STAGES - 1, n]
    return _error(tree.kind, h, scratch) / tolerance, rate


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
    tree: TreeArrays,
    closure: LoopClosure | None,
    spatial: Spatial,
    elements: TreeElements | None,
    planar: Planar,
    scratch: RadauScratch,
    z: Array,
    times: Array,
    tolerance: float,
    longest: float,
    motion: Array,
    counters: Array,
) -> int:
    """Integrate as `integrate_radau`, compiled for each combination of arguments that are None."""
    t, last, sample = times[0], times[-1], SECOND
    counters[:], scratch.F[:] = 0, 0.0
    begin_motion(tree, closure, spatial, elements, planar, t, z)
    record_sample(tree, spatial, planar, motion[0])
    if times.shape[0] == 1:
        return 0
    bound, h, before, most, accepted = step_limit(tree, elements, longest), 0.0, np.inf, LARGEST, True
    while sample < times.shape[0]:
        if accepted:
            _linearise(tree, closure, spatial, elements, planar, t, z, counters, scratch)
            h = h if h > 0.0 else first_step_length(tree.kind, scratch.f, last - t, tolerance, scratch.size)
        step = step_length(min(h, bound), last - t)
        if not step >= 1e-14 * max(1.0, abs(t)):
            return 1
        _guess(z, scratch.F, step / before, scratch.Z)
        error, rate = _attempt(tree, closure, spatial, elements, planar, t, step, z, tolerance, counters, scratch)
        factor, accepted = _factor(error, rate, most), error <= 1.0
        if not accepted:
            counters[REJECTED] += 1
            h, most = step * factor, 1.0
            continue
        counters[STEPS] += 1
        after = last if step == last - t else t + step
        left = next_sample(times, sample, after)
        at_sample = left < times.shape[0] and times[left] == after
        _interpolate(scratch.Z, scratch.F)
        end_step(tree, closure, spatial, elements, planar, after, scratch.end, at_sample)
        bound = step_limit(tree, elements, longest)
        if at_sample:
            record_sample(tree, spatial, planar, motion[left])
        if sample < left:
            record_samples_within(
                tree, closure, spatial, elements, planar, z, t, step, times[sample:left], motion[sample:left], scratch
            )
        sample = left + 1 if at_sample else left
        assign(z, scratch.end)
        t, h, before, most = after, step * factor if step == h else max(h, step * factor), step, LARGEST
    return 0


@kernel
def integrate_radau(
    run: KernelArguments, z: Array, times: Array, tolerance: float, longest: float, motion: Array, counters: Array
) -> int:
    """Integrate from ``times[0]`` and record the bodies at all sample times.

    Parameters
    ----------
    run, z, times, tolerance, longest, motion, counters : see `explicit_rk.integrate`

    Returns
    -------
    int
        Key of `integrators.step_control.STATUS`.
    """
    on = fields_of(run)
    tree, closure, spatial, elements, planar = on.tree, on.closure, on.spatial, on.elements, on.planar
    return _integrate(
        tree, closure, spatial, elements, planar, on.scratch, z, times, tolerance, longest, motion, counters
    )
