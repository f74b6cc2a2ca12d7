"""Constraint solver and integrator of the harness, for engines that have none.

Answers by `solve_constrained` have the route `Route.HARNESS_SOLVE`, those by `runge_kutta_4` the route
`Route.HARNESS_INTEGRATOR`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array

STABLE_RATE = 2.785
"""Real axis of the stability region of the classical method of order four: decay rate times step."""


def numerical_rank(J: Array) -> int:
    """Return the number of singular values of J, shape (r, n), above `RANK_TOLERANCE` times the largest."""
    if J.size == 0:
        return 0
    singular = np.linalg.svd(J, compute_uv=False)
    return int(np.sum(singular > RANK_TOLERANCE * singular[0]))


def solve_constrained(M: Array, f: Array, J: Array, gamma: Array) -> tuple[Array, Array]:
    """Solve ``M a = f + J^T lam``, ``J a = gamma`` with dependent rows allowed, by rows of unit length in any units.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        Symmetric positive definite mass matrix.
    f : ndarray, shape (n,)
    J : ndarray, shape (r, n)
    gamma : ndarray, shape (r,)

    Returns
    -------
    a : ndarray, shape (n,)
        Unique, whatever the rank of J.
    lam : ndarray, shape (r,)
        Multipliers of least norm, each times the length of its row over M.
    """
    L = np.linalg.cholesky(M)
    free = np.linalg.solve(L, f)
    Y = np.linalg.solve(L, J.T)
    lengths = np.linalg.norm(Y, axis=0)
    rounding = 1e-10 * np.max(lengths, initial=0.0)  # units of 1e-6 m leave more to an angle
    lengths[lengths <= rounding] = np.inf  # such a row holds nothing
    U, s, Vt = np.linalg.svd(Y / lengths, full_matrices=False)
    rank = int(np.sum(s > RANK_TOLERANCE * s[0])) if len(s) else 0
    along = (Vt[:rank] @ ((gamma - Y.T @ free) / lengths)) / s[:rank]
    a = np.linalg.solve(L.T, free + U[:, :rank] @ along)
    return a, Vt[:rank].T @ (along / s[:rank]) / lengths


def require_stable(values: Array, step: float) -> None:
    """Refuse values of an explicit method of order four that are not finite, and name the rates that the step resolves.

    Raises
    ------
    FloatingPointError
    """
    if not np.all(np.isfinite(values)):
        raise FloatingPointError(
            f"the motion is not finite by steps of {step:g} s: an explicit method of order four is stable at rates "
            f"below {STABLE_RATE / step:.3g} 1/s, and the mechanism has faster ones or a singular pose"
        )


def runge_kutta_4(
    derivative: Callable[[Array], Array], y: Array, step: float, count: int, record: Callable[[Array], None], every: int
) -> Array:
    """Integrate ``y' = derivative(y)`` by the classical fourth-order method with a fixed step.

    Parameters
    ----------
    derivative : callable
    y : ndarray, shape (n,)
        Initial value.
    step : float
    count : int
        Number of steps.
    record : callable
        Called with y at the start and after every `every` steps.
    every : int

    Returns
    -------
    ndarray
        Final value of y.

    Raises
    ------
    FloatingPointError
        A recorded y is not finite.
    """
    record(y)
    for n in range(1, count + 1):
        k1 = derivative(y)
        k2 = derivative(y + 0.5 * step * k1)
        k3 = derivative(y + 0.5 * step * k2)
        k4 = derivative(y + step * k3)
        y = y + (step / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
        if n % every == 0:
            require_stable(y, step)
            record(y)
    return y
