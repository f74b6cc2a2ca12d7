"""Hops of what slides under associated cones: each contact with its plane is an impact, and between them it flies.

The law asks ``u_n >= mu abs(u_t)`` of a closed contact, with equality where a force acts and ``u_t`` is not zero. So
nothing slides and stays: a body thrown along its plane leaves it at once. A body that only translates at the speed u_0
leaves with ``u = u_0/(1 + mu^2)`` along the plane and ``mu u`` across it, and each later impact leaves it the share
``(1 - mu^2)/(1 + mu^2)`` of its speed. The hops add up to the time ``u_0/(mu g)`` and the way ``u_0^2/(2 mu g)`` of
Coulomb's law, since all impulses are on the boundary of the cone.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.equations import ContactEquations


def _slips(equations: ContactEquations) -> Iterator[tuple[int, list[int], float]]:
    """Yield the normal, the rows and the lifting slip ``mu abs(u_t)`` of each associated cone, at the last state."""
    for one in equations.layout.friction:
        if one.associated and one.load is not None:
            slip = float(np.linalg.norm(equations.rows.u[list(one.rows)]))
            yield equations.layout.normals.index(one.load), [one.load, *one.rows], one.kinetic * slip


def what_lifts(equations: ContactEquations, rate: Array, least: float) -> Array:
    """Return which normals slide faster than they part, by more than `least`, m/s; shape of the rates of normals."""
    found = np.zeros(len(rate), dtype=bool)
    for n, _, lift in _slips(equations):
        found[n] = lift - rate[n] > least
    return found


def rows_at_rest(equations: ContactEquations, strikes: Array, touching: Array, slow: float) -> list[int]:
    """Return the rows of associated cones whose hops have ended: that touch where one strikes slower than `slow`, m/s.

    Those that move ten times as fast come to rest with it, since they have one body.
    """
    u = equations.rows.u
    slips = [(n, at, float(np.linalg.norm(u[at]))) for n, at, _ in _slips(equations)]
    if not any(strikes[n] and size < slow for n, _, size in slips):
        return []
    return [row for n, at, size in slips if touching[n] and size < 10.0 * slow for row in at]
