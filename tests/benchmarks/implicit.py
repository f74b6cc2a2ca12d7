"""Radau IIA of order 13 in NumPy, with the reference's step control, for the accelerations of an engine."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from consilience.mechanism import Array
from consilience.reference.steppers.radau13 import (
    DIFFERENCE_STEP,
    ESTIMATE,
    IN,
    LAMBDA,
    MOST_ITERATIONS,
    NEWTON_TOLERANCE,
    OUT,
    SAFETY,
    SLOWEST_RATE,
    STAGES,
    A,
    C,
)

Derivative = Callable[[float, Array], Array]
_WEIGHTS = np.linalg.inv(np.vander(np.append(0.0, C), STAGES + 1, increasing=True))


def _jacobian(derivative: Derivative, t: float, y: Array, f: Array, size: Array) -> Array:
    columns = []
    for n in range(len(y)):
        moved = y.copy()
        moved[n] += DIFFERENCE_STEP * size[n]
        columns.append((derivative(t, moved) - f) / (moved[n] - y[n]))
    return np.array(columns).T


def _step(
    derivative: Derivative, t: float, h: float, y: Array, f: Array, J: Array, Z: Array, size: Array, tolerance: float
) -> tuple[Array, float, float]:
    """Return stages, error over the tolerance (infinite if the Newton iterations diverge), and convergence rate."""
    systems = [lu_factor(shift / h * np.eye(len(y)) - J, check_finite=False) for shift in LAMBDA]
    last, rate = np.inf, 0.0
    for left in range(MOST_ITERATIONS, 0, -1):
        K = np.array([derivative(t + c * h, y + stage).copy() for c, stage in zip(C, Z, strict=True)])
        sides = (LAMBDA / h)[:, None] * (IN @ (h * A @ K - Z))
        solved = [lu_solve(lu, side, check_finite=False) for lu, side in zip(systems, sides, strict=True)]
        correction = (OUT @ np.array(solved)).real
        Z = Z + correction
        change = float(np.max(np.abs(correction) / size))
        if not change < np.inf:
            return Z, np.inf, 1.0
        rate, last = change / last, change
        if change * max(rate, SLOWEST_RATE) <= NEWTON_TOLERANCE * tolerance or (rate > 0.5 and change <= tolerance):
            scaled = lu_solve(systems[0], f + ESTIMATE @ Z / h, check_finite=False).real / size
            return Z, float(np.sqrt(scaled @ scaled / len(y))) / tolerance, rate
        if not change * rate**left <= tolerance:
            break
    return Z, np.inf, rate


def radau13(derivative: Derivative, y: Array, times: Array, tolerance: float) -> Array:
    """Integrate by Radau IIA with seven stages and the step control of the reference; return y at the times.

    Raises
    ------
    RuntimeError
        The step size became too small.
    """
    y, t, motion, before, most = np.array(y, dtype=float), float(times[0]), [np.array(y, dtype=float)], 0.0, 6.0
    powers, f = np.zeros((STAGES + 1, len(y))), derivative(t, y).copy()
    size = 1.0 + np.abs(y)
    h = tolerance**0.125 / max(float(np.sqrt(np.mean((f / size) ** 2))), 1.0 / (times[-1] - t))
    J = _jacobian(derivative, t, y, f, size)
    for target in times[1:].tolist():
        while t < target:
            remaining = target - t
            step = remaining if h >= remaining else min(h, 0.5 * remaining)
            if not step > 1e-14 * max(1.0, t):
                raise RuntimeError(f"radau13 gave up at {t} s")
            x = 1.0 + C * step / before if before else C
            guess = np.vander(x, STAGES + 1, increasing=True) @ powers - powers.sum(axis=0)
            Z, error, rate = _step(derivative, t, step, y, f, J, guess, size, tolerance)
            by_error = min(6.0, SAFETY * max(error, 1e-16) ** -0.125) if error < np.inf else 0.5
            factor = max(0.2, min(most, by_error, SLOWEST_RATE / max(rate, 1e-16)))
            if not error <= 1.0:
                h, most = step * factor, 1.0
                continue
            powers, before, most = _WEIGHTS @ np.vstack([np.zeros(len(y)), Z]), step, 6.0
            y, t = y + Z[-1], target if step == remaining else t + step
            h = max(h, step * factor) if step < h else step * factor
            f, size = derivative(t, y).copy(), 1.0 + np.abs(y)
            J = _jacobian(derivative, t, y, f, size)
        motion.append(y.copy())
    return np.array(motion)
