"""Convex problem over second-order cones by the logarithmic barrier (Nesterov and Nemirovskii 1994), compiled.

Minimise ``cost . y + curvature y . y / 2`` with ``|v_i + V_i y| <= t_i + T_i y`` for each cone i, v_i in the plane
(zero for a half-space). For weights w of the cost that grow without bound the minimum of

    w (cost . y + curvature y . y / 2) - sum log((t_i + T_i y)^2 - |v_i + V_i y|^2)

runs along the central path to the solution, from which it is at most ``2 (number of cones)/w`` away. Along the path
y is nearly linear in 1/w, which predicts the next point.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.algebra import solve_small
from consilience.reference.kernel.compiled import allocating

_FASTER = 50.0
"""Factor between the weights of the cost along the central path."""

_CENTRED = 1e-2
"""Newton decrement, squared, that ends the centring."""

_SINGULAR = 1e-14
"""Pivots of the scaled Hessian below this belong to directions that the cones leave free: y does not move there."""

_NEWTON, _BINDS, _NEAR, _POLISHED = 4, 1e-6, 1e-4, 1e-11
"""Largest number of steps of Newton's method after the barrier; margins that count as equal; the largest change; the
change of a step, behind which another one changes rounding alone."""


@allocating
def minimise(t: Array, T: Array, v: Array, V: Array, cost: Array, curvature: float, y: Array, gap: float) -> Array:
    """Return the solution.

    Parameters
    ----------
    t, T : ndarray, shape (c,) and (c, k)
    v, V : ndarray, shape (c, 2) and (c, 2, k)
    cost : ndarray, shape (k,)
    curvature : float
    y : ndarray, shape (k,)
        Start, within all cones.
    gap : float
        Distance from the optimum at which to end, in units of the cost.
    """
    weight = 1.0
    y = _centre(t, T, v, V, cost, weight, curvature, y)
    while weight < 2.0 * len(t) / gap:
        slope = cost + curvature * y
        _, hessian = _derivatives(t, T, v, V, y, weight * curvature)
        ahead = (1.0 - 1.0 / _FASTER) * weight * _solve(hessian, slope)
        for _ in range(60):
            if np.isfinite(_value(t, T, v, V, cost, weight, curvature, y - ahead)):
                break
            ahead = 0.5 * ahead
        weight *= _FASTER
        y = _centre(t, T, v, V, cost, weight, curvature, y - ahead)
    return y


@allocating
def _value(t, T, v, V, cost, weight, curvature, y):  # type: ignore[no-untyped-def]
    """Return the barrier function; infinite outside."""
    total = weight * (np.dot(cost, y) + 0.5 * curvature * np.dot(y, y))
    for i in range(len(t)):
        along, first, second = t[i], v[i, 0], v[i, 1]
        for k in range(len(y)):
            along += T[i, k] * y[k]
            first += V[i, 0, k] * y[k]
            second += V[i, 1, k] * y[k]
        inside = along * along - first * first - second * second
        if along <= 0.0 or inside <= 0.0:
            return np.inf
        total -= np.log(inside)
    return total


@allocating
def _derivatives(t, T, v, V, y, curvature):  # type: ignore[no-untyped-def]
    """Return gradient and Hessian of the barrier, the Hessian with that of the quadratic."""
    n = len(y)
    gradient, hessian, half = np.zeros(n), np.zeros((n, n)), np.zeros(n)
    for k in range(n):
        hessian[k, k] = curvature
    for i in range(len(t)):
        along, first, second = t[i], v[i, 0], v[i, 1]
        for k in range(n):
            along += T[i, k] * y[k]
            first += V[i, 0, k] * y[k]
            second += V[i, 1, k] * y[k]
        inside = along * along - first * first - second * second
        for k in range(n):
            half[k] = 2.0 * (along * T[i, k] - first * V[i, 0, k] - second * V[i, 1, k]) / inside
            gradient[k] -= half[k]
        for k in range(n):
            for m in range(n):
                across = V[i, 0, k] * V[i, 0, m] + V[i, 1, k] * V[i, 1, m] - T[i, k] * T[i, m]
                hessian[k, m] += half[k] * half[m] + 2.0 * across / inside
    return gradient, hessian


@allocating
def _centre(t, T, v, V, cost, weight, curvature, y):  # type: ignore[no-untyped-def]
    """Newton's method with step halving on the barrier function."""
    for _ in range(50):
        gradient, hessian = _derivatives(t, T, v, V, y, weight * curvature)
        gradient = gradient + weight * (cost + curvature * y)
        step = -_solve(hessian, gradient)
        value, length = _value(t, T, v, V, cost, weight, curvature, y), 1.0
        while length > 1e-10 and not _value(t, T, v, V, cost, weight, curvature, y + length * step) <= value:
            length *= 0.5
        if length <= 1e-10:
            return y
        y = y + length * step
        if -np.dot(gradient, step) < _CENTRED:
            return y
    return y


@allocating
def _solve(hessian, right):  # type: ignore[no-untyped-def]
    """Solve by a Cholesky factorisation with unit diagonal, leaving out directions without curvature."""
    n = len(right)
    scale, L, x = np.ones(n), np.zeros((n, n)), np.zeros(n)
    for k in range(n):
        if hessian[k, k] > 0.0:
            scale[k] = np.sqrt(hessian[k, k])
    for k in range(n):
        pivot = hessian[k, k] / scale[k] ** 2 - np.dot(L[k, :k], L[k, :k])
        if pivot > _SINGULAR:
            L[k, k] = np.sqrt(pivot)
            for i in range(k + 1, n):
                L[i, k] = (hessian[i, k] / (scale[i] * scale[k]) - np.dot(L[i, :k], L[k, :k])) / L[k, k]
    for k in range(n):
        if L[k, k] > 0.0:
            x[k] = (right[k] / scale[k] - np.dot(L[k, :k], x[:k])) / L[k, k]
    for k in range(n - 1, -1, -1):
        if L[k, k] > 0.0:
            x[k] /= L[k, k]
            x[:k] -= L[k, :k] * x[k]
    return x / scale


@allocating
def _margins(t, T, v, V, y):  # type: ignore[no-untyped-def]
    """Return the margin ``t + T y - |v + V y|`` of each cone, its gradient, and the vector across with its length."""
    count, n = T.shape
    margin, gradient, across, size = t.copy(), T.copy(), v.copy(), np.zeros(count)
    for i in range(count):
        for k in range(n):
            margin[i] += T[i, k] * y[k]
            across[i, 0] += V[i, 0, k] * y[k]
            across[i, 1] += V[i, 1, k] * y[k]
        size[i] = max(np.sqrt(across[i, 0] ** 2 + across[i, 1] ** 2), np.finfo(np.float64).tiny)
        margin[i] -= size[i]
        across[i] /= size[i]
        for k in range(n):
            gradient[i, k] -= across[i, 0] * V[i, 0, k] + across[i, 1] * V[i, 1, k]
    return margin, gradient, across, size


@allocating
def polish(t: Array, T: Array, v: Array, V: Array, y: Array) -> Array:
    """Return the point of the widest margin by Newton's method, from that of the barrier: directions to rounding.

    Of the cones that bind, margins are equal and some positive combination of their gradients vanishes (Kuhn, Tucker).

    Parameters
    ----------
    t, T, v, V : see `minimise`
    y : ndarray, shape (k,)
        Near the point.
    """
    first, n = y, len(y)
    for _ in range(_NEWTON):
        margin, gradient, across, size = _margins(t, T, v, V, y)
        binding = np.flatnonzero(margin <= np.min(margin) + _BINDS)
        b = len(binding)
        share, normal = np.zeros(b), np.ones((b, b))
        system, wanted, change = np.zeros((b + n + 1, b + n + 1)), np.zeros(b + n + 1), np.zeros(b + n + 1)
        for i in range(b):
            for j in range(b):
                normal[i, j] += np.dot(gradient[binding[i]], gradient[binding[j]])
        solve_small(normal, np.ones(b), share)
        wanted[b + n] = 1.0 - np.sum(share)
        for i in range(b):
            c = binding[i]
            wanted[n + i], system[n + i, b + n], system[b + n, n + i] = -margin[c], -1.0, 1.0
            for k in range(n):
                wanted[k] -= share[i] * gradient[c, k]
                system[k, n + i] = system[n + i, k] = gradient[c, k]
                turn = across[c, 0] * V[c, 1, k] - across[c, 1] * V[c, 0, k]  # part of V across the vector
                for m in range(n):
                    system[k, m] -= share[i] * turn * (across[c, 0] * V[c, 1, m] - across[c, 1] * V[c, 0, m]) / size[c]
        solve_small(system, wanted, change)
        y = y + change[:n]
        if n == 0 or np.max(np.abs(change[:n])) <= _POLISHED:
            break
    return y if n == 0 or np.max(np.abs(y - first)) <= _NEAR else first
