"""Impulses of contacts by successive projections, row by row (Jourdan, Alart and Jean 1998), compiled.

Of a friction set with an associated cone, normal and tangential impulse are projected together: onto the cone

    abs(p_t) <= mu p_n,      p = prox_cone(p - r u),      that is      u_n >= mu abs(u_t),      p . u = 0,

so that what slides parts, ``u_n = mu abs(u_t)``: the convex law (Anitescu 2006; De Saxce and Feng 1998 have Coulomb's,
which adds ``mu abs(u_t)`` to u_n).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.problem import FrictionSet
from consilience.reference.kernel.compiled import allocating, inner

SWEEPS, PATIENT_SWEEPS = 2000, 200_000
_SOLVED = 1e-13
"""Change of the velocities in a sweep at which the problem is solved, over their size."""


def friction_table(friction: Sequence[FrictionSet], normals: Sequence[int]) -> tuple[Array, Array, Array, Array]:
    """Return rows (n_f, 2), loads (n_f,), vertices (n_f,) of all friction sets, and (mu, angle); -1 for none.

    An associated cone has -1 vertices.
    """
    rows, load, facets = np.full((len(friction), 2), -1), np.full(len(friction), -1), []
    numbers = np.zeros((len(friction), 2))
    for j, one in enumerate(friction):
        rows[j, : len(one.rows)], numbers[j] = one.rows, (one.kinetic, one.angle)
        load[j] = one.load if one.load in normals else -1
        facets.append(-1 if one.associated else one.facets)
    return rows, load, np.array(facets, dtype=np.int64), numbers


@inner
def _into_polygon(facets: int, angle: float, radius: float, x: float, y: float) -> tuple[float, float]:
    """Return the point of a regular polygon nearest to a point; its vertices have the distance `radius`."""
    inside, best, found_x, found_y = True, np.inf, x, y
    for k in range(facets):
        a, b = angle + 2 * np.pi * k / facets, angle + 2 * np.pi * (k + 1) / facets
        ax, ay, bx, by = radius * np.cos(a), radius * np.sin(a), radius * np.cos(b), radius * np.sin(b)
        dx, dy = bx - ax, by - ay
        inside = inside and dx * (y - ay) - dy * (x - ax) >= 0.0
        along = min(1.0, max(0.0, (dx * (x - ax) + dy * (y - ay)) / (dx * dx + dy * dy)))
        far = (x - ax - along * dx) ** 2 + (y - ay - along * dy) ** 2
        if far < best:
            best, found_x, found_y = far, ax + along * dx, ay + along * dy
    return (x, y) if inside else (found_x, found_y)


@inner
def _into_set(facets: int, angle: float, radius: float, x: float, y: float) -> tuple[float, float]:
    """Return the point of a friction set of two rows nearest to a point."""
    if radius <= 0.0:
        return 0.0, 0.0
    if facets:
        return _into_polygon(facets, angle, radius, x, y)
    size = np.sqrt(x * x + y * y)
    return (x, y) if size <= radius else (x * radius / size, y * radius / size)


@inner
def _push(G, row, change, u, p):  # type: ignore[no-untyped-def]
    """Change the impulse on one row."""
    p[row] += change
    for k in range(u.shape[0]):
        u[k] += G[k, row] * change


@inner
def _onto_cone(G, mu, n, a, b, closed, u, p):  # type: ignore[no-untyped-def]
    """Project the impulses of one contact onto its cone; return the change of velocity."""
    stiff = G[n, n] + G[a, a] + G[b, b]
    if n < 0 or not closed[n] or stiff <= 0.0:
        return 0.0
    x, y, z = p[n] - u[n] / stiff, p[a] - u[a] / stiff, p[b] - u[b] / stiff
    size = np.sqrt(y * y + z * z)
    if size > mu * x:
        x = max(0.0, (x + mu * size) / (1.0 + mu * mu))
        y, z = mu * x * y / size, mu * x * z / size
    dx, dy, dz = x - p[n], y - p[a], z - p[b]
    _push(G, n, dx, u, p)
    _push(G, a, dy, u, p)
    _push(G, b, dz, u, p)
    return np.sqrt(stiff * (dx * dx + dy * dy + dz * dz))


@inner
def _into_bounds(G, bound, facets, angle, a, b, u, p):  # type: ignore[no-untyped-def]
    """Project the friction of one set into its bound; return the change of velocity."""
    if b < 0:
        if G[a, a] <= 0.0:
            return 0.0
        x = min(bound, max(-bound, p[a] - u[a] / G[a, a])) - p[a]
        _push(G, a, x, u, p)
        return abs(x) * np.sqrt(G[a, a])
    stiff = 0.5 * (G[a, a] + G[b, b]) + np.sqrt(0.25 * (G[a, a] - G[b, b]) ** 2 + G[a, b] ** 2)
    if stiff <= 0.0:
        return 0.0
    x, y = _into_set(facets, angle, bound, p[a] - u[a] / stiff, p[b] - u[b] / stiff)
    x, y = x - p[a], y - p[b]
    _push(G, a, x, u, p)
    _push(G, b, y, u, p)
    return max(abs(x), abs(y)) * np.sqrt(stiff)


@allocating
def project_impulses(G, free, law, offsets, closed, sweeps, p):  # type: ignore[no-untyped-def]
    """Find impulses by successive projections, in place of p; return whether they have converged.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        ``u = free + G p``.
    free : ndarray, shape (m,)
    law : tuple
        Of `friction_table`.
    offsets : ndarray, shape (n_f,), N s
        Constant parts of the bounds.
    closed : ndarray of bool, shape (m,)
        Normals that may carry an impulse.
    sweeps : int
        Most sweeps.
    p : ndarray, shape (m,)
        First guess; overwritten.
    """
    rows, load, facets, numbers = law
    m, sets = free.shape[0], load.shape[0]
    u = free + G @ p
    joint = np.zeros(m, dtype=np.bool_)  # normals that are projected together with their friction
    for j in range(sets):
        if facets[j] < 0 and load[j] >= 0:
            joint[load[j]] = True
    size = 0.0
    for row in range(m):
        size = max(size, abs(free[row]) / max(np.sqrt(G[row, row]), 1e-300))
    for _ in range(sweeps):
        change = 0.0
        for row in range(m):
            if closed[row] and not joint[row] and G[row, row] > 0.0:
                new = max(0.0, p[row] - u[row] / G[row, row])
                change = max(change, abs(new - p[row]) * np.sqrt(G[row, row]))
                u += G[:, row] * (new - p[row])
                p[row] = new
        for j in range(sets):
            if facets[j] < 0:
                moved = _onto_cone(G, numbers[j, 0], load[j], rows[j, 0], rows[j, 1], closed, u, p)
            else:
                bound = numbers[j, 0] * (offsets[j] + (p[load[j]] if load[j] >= 0 else 0.0))
                moved = _into_bounds(G, bound, facets[j], numbers[j, 1], rows[j, 0], rows[j, 1], u, p)
            change = max(change, moved)
        if change <= _SOLVED * size:
            return True
    return False
