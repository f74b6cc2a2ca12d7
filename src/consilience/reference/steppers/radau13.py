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
from numpy.polynomial.legendre import legroots, legvander

from consilience.mechanism import Array
from consilience.reference.integrators.step_control import LARGEST, SMALLEST, factor_of
from consilience.reference.kernel.compiled import inlined, inner
from consilience.reference.kernel.operation import Operation, array_of
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers.driver import CompiledStepper
from consilience.reference.steppers.explicit import dense_output
from consilience.reference.steppers.gauss import lagrange_integrals
from consilience.reference.steppers.motion import (
    ATTEMPT,
    EVALUATE,
    PREPARE,
    MotionArrays,
    component_sizes,
    derivative,
    first_step_length,
)

STAGES = 7

SAFETY = 0.8
MOST_ITERATIONS = 12
"""Iterations after which the step is shortened."""

NEWTON_TOLERANCE = 1e-2
"""Error of the iterations, as part of the tolerance of a step."""

DIFFERENCE_STEP = np.sqrt(np.finfo(float).eps)
"""Relative step of the differences in the Jacobian."""

SLOWEST_RATE = 0.1
"""Convergence rate of the iterations that the step size aims at, at most."""


def _nodes() -> Array:
    """Return the right Radau nodes in (0, 1]: where the Legendre polynomials of degrees s and s - 1 are equal."""
    series = np.zeros(STAGES + 1)
    series[-2:] = -1.0, 1.0
    return 0.5 * (np.sort(legroots(series)) + 1.0)


def _weights(c: Array) -> Array:
    """Return the weights of the quadrature with these nodes."""
    moments = np.zeros(STAGES)
    moments[0] = 1.0
    return np.linalg.solve(legvander(2.0 * c - 1.0, STAGES - 1).T, moments)


def _nested(c: Array) -> Array:
    """Return the weights of the stages in the nested form of `explicit.dense_output`, shape (7, 7)."""
    factors = [c if i % 2 == 0 else 1.0 - c for i in range(STAGES)]
    return np.linalg.inv(np.cumprod(factors, axis=0).T)


C = _nodes()
B = _weights(C)
A = 0.5 * lagrange_integrals(2.0 * C - 1.0, 2.0 * B)
NESTED = _nested(C)

_EIGENVALUES, _VECTORS = np.linalg.eig(np.linalg.inv(A))
_UPPER = np.argsort(np.abs(_EIGENVALUES.imag))
_UPPER = _UPPER[_EIGENVALUES.imag[_UPPER] > -1e-9]
LAMBDA = _EIGENVALUES[_UPPER]
"""Eigenvalues of the inverse of A: the real one first, then one of each pair."""

OUT = _VECTORS[:, _UPPER] * np.where(np.arange(len(_UPPER)) == 0, 1.0, 2.0)
"""Eigenvectors, shape (7, 4); a pair contributes twice the real part of one of its vectors."""

IN = np.linalg.inv(_VECTORS)[_UPPER]
"""Rows of the inverse of the eigenvector matrix, shape (4, 7)."""

_POWERS = np.arange(STAGES)
_EMBEDDED = np.linalg.solve(
    (C ** _POWERS[:, None]), 1.0 / (_POWERS + 1.0) - np.where(_POWERS == 0, 1.0 / LAMBDA[0].real, 0.0)
)
ESTIMATE = LAMBDA[0].real * ((_EMBEDDED - B) @ np.linalg.inv(A))
"""Weights e of the stages in the error estimate."""


class RadauArrays(NamedTuple):
    """Record of the kernels of Radau IIA."""

    motion: MotionArrays
    Z: Array  # (7, n_z) stages less the start of the step
    K: Array  # (7, n_z) derivatives at the stages
    J: Array  # (n_z, n_z) Jacobian
    LU: Array  # (4, n_z, n_z) complex, factorised systems
    pivot: Array  # (4, n_z) rows of the pivots
    W: Array  # (4, n_z) complex, right sides and solutions
    f: Array  # (n_z,) derivative at the start
    perturbed: Array  # (n_z,) derivative at a perturbed state
    F: Array  # (7, n_z) dense output


def radau_arrays(motion: MotionArrays) -> RadauArrays:
    """Return the record for a motion."""
    n, systems = len(motion.z), len(LAMBDA)
    return RadauArrays(
        motion,
        Z=np.zeros((STAGES, n)),
        K=np.zeros((STAGES, n)),
        J=np.empty((n, n)),
        LU=np.empty((systems, n, n), dtype=complex),
        pivot=np.empty((systems, n), dtype=np.int64),
        W=np.empty((systems, n), dtype=complex),
        f=np.empty(n),
        perturbed=np.empty(n),
        F=np.zeros((STAGES, n)),
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
def _prepare(arrays: RadauArrays, t: float, z: Array) -> None:
    """Compute the derivative at a new state, and the Jacobian by differences; in the first, propose a step."""
    motion, f, found = arrays.motion, arrays.f, arrays.perturbed
    run, kind, state = motion.run[0], motion.kind, motion.state
    component_sizes(kind, motion.length, z, motion.size)
    derivative(motion, t, z, f)
    for m in range(z.shape[0]):
        assign(state, z)
        state[m] += DIFFERENCE_STEP * motion.size[kind[m]]
        derivative(motion, t, state, found)
        for n in range(z.shape[0]):
            arrays.J[n, m] = (found[n] - f[n]) / (state[m] - z[m])
    if run.h == 0.0:
        arrays.F[:] = 0.0
        run.h = first_step_length(kind, f, run.span, run.tolerance, motion.size)


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


@inner
def _iterate(arrays: RadauArrays, t: float, z: Array) -> tuple[bool, float]:
    """Iterate the guessed stages in place; return whether they converge, and the convergence rate."""
    motion, Z, K = arrays.motion, arrays.Z, arrays.K
    h, tolerance, state = motion.run[0].step, motion.run[0].tolerance, motion.state
    last, rate = np.inf, 0.0
    for left in range(MOST_ITERATIONS, 0, -1):
        for i in range(STAGES):
            for n in range(z.shape[0]):
                state[n] = z[n] + Z[i, n]
            derivative(motion, t + C[i] * h, state, K[i])
        _residuals(h, Z, K, arrays.W)
        for k in range(LAMBDA.shape[0]):
            _solve(arrays.LU[k], arrays.pivot[k], arrays.W[k])
        change = _correct(motion.kind, arrays.W, Z, motion.size)
        if not change < np.inf:
            return False, 1.0
        rate, last = change / last, change
        if change * max(rate, SLOWEST_RATE) <= NEWTON_TOLERANCE * tolerance or (rate > 0.5 and change <= tolerance):
            return True, rate
        if not change * rate**left <= tolerance:
            return False, rate
    return False, rate


@inner
def _error(kind: Array, h: float, arrays: RadauArrays) -> float:
    """Return the scaled error estimate of a step."""
    Z, W, size = arrays.Z, arrays.W, arrays.motion.size
    for n in range(Z.shape[1]):
        total = arrays.f[n]
        for i in range(STAGES):
            total += ESTIMATE[i] * Z[i, n] / h
        W[0, n] = total
    _solve(arrays.LU[0], arrays.pivot[0], W[0])
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


@inner
def _factor(error: float, rate: float, most: float) -> float:
    """Return the change of the step size from the error of the step, 0.5 where infinite, and the convergence rate."""
    by_error = factor_of(error, SAFETY, LARGEST) if error < np.inf else 0.5
    return max(SMALLEST, min(most, by_error, SLOWEST_RATE / rate))


@inner
def _polynomial(Z: Array, F: Array) -> None:
    """Compute the polynomial through the stages, from which the next step is guessed, too."""
    for n in range(Z.shape[1]):
        for i in range(STAGES):
            total = 0.0
            for j in range(STAGES):
                total += NESTED[i, j] * Z[j, n]
            F[i, n] = total


@inlined
def _attempt(arrays: RadauArrays, t: float, z: Array, end: Array) -> float:
    """Attempt a step; return its error over the tolerance."""
    run = arrays.motion.run[0]
    h = run.step
    _guess(z, arrays.F, h / run.before, arrays.Z)
    for k in range(LAMBDA.shape[0]):
        _factorise(arrays.J, LAMBDA[k] / h, arrays.LU[k], arrays.pivot[k])
    settled, rate = _iterate(arrays, t, z)
    error = np.inf
    if settled:
        for n in range(z.shape[0]):
            end[n] = z[n] + arrays.Z[STAGES - 1, n]
        error = _error(arrays.motion.kind, h, arrays) / run.tolerance
    run.factor = _factor(error, rate, min(run.most, LARGEST))
    if error <= 1.0:
        _polynomial(arrays.Z, arrays.F)
    return error


@Operation
def step(arrays: RadauArrays, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests of the driver: see `motion.PREPARE`; an accepted step has its polynomial.

    Parameters
    ----------
    arrays : RadauArrays
    request, t, z, out : see `motion.ask`
    """
    before, after = array_of(z), array_of(out)
    if request == PREPARE:
        _prepare(arrays, t, before)
    elif request == ATTEMPT:
        return _attempt(arrays, t, before, after)
    elif request == EVALUATE:
        dense_output(before, arrays.F, t / arrays.motion.run[0].step, after)
    return 0.0


STEPPERS = {"radau13": CompiledStepper(radau_arrays, step)}
"""The method by its name."""
