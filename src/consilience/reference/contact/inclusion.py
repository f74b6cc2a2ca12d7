"""Contact laws as inclusions: projections onto the sets of forces, and how far an answer is from satisfying all laws.

With any r > 0 (Moreau 1988; Leine and van de Wouw 2008)

    N = prox_{N >= 0}(N - r u_n),      T = prox_{(N + offset) mu D}(T - r u_t).

The residual of these equations knows nothing of modes: it verifies an answer however it was found.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.problem import ContactProblem, FrictionSet


def project(one: FrictionSet, radius: float, point: Array) -> Array:
    """Return the point of ``radius D`` nearest to a point, shape (d,)."""
    if radius <= 0.0:
        return np.zeros(len(point))
    vertices = one.vertices
    if vertices is None:
        length = float(np.linalg.norm(point))
        return point if length <= radius else point * (radius / length)
    if len(one.rows) == 1:
        return np.clip(point, -radius, radius)
    corners = radius * vertices
    sides = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    if np.all(np.sum(outward * (point - corners), axis=1) <= 0.0):
        return point
    squares = np.maximum(np.sum(sides**2, axis=1), np.finfo(float).tiny)
    along = np.clip(np.sum(sides * (point - corners), axis=1) / squares, 0.0, 1.0)
    nearest = corners + along[:, None] * sides
    return nearest[np.argmin(np.sum((nearest - point) ** 2, axis=1))]


def residual(problem: ContactProblem, force: Array, acceleration: Array) -> Array:
    """Return by how much each row violates its law beyond rounding, relative to the largest force, shape (m,).

    Friction that slides obeys its velocity; friction without velocity its acceleration. A set that does not move at all
    may reach its static bound.
    """
    weight = problem.row_scale()
    r, pull, missed = 1.0 / weight**2, np.abs(problem.free) / weight**2, np.zeros(len(force))
    unit = max(float(np.max(np.abs(force))), float(np.max(pull))) or 1.0
    for n in problem.normals:
        missed[n] = force[n] - max(force[n] - r[n] * acceleration[n], 0.0)
    for j, one in enumerate(problem.friction):
        rows = list(one.rows)
        bound = one.offset + (0.0 if one.load is None else float(force[one.load]))
        T, slip = force[rows], problem.slip(j)
        displaced = float(r[rows].sum()) / len(rows) * acceleration[rows]
        if np.any(slip):
            missed[rows] = _sliding_residual(one, bound, T, slip, displaced)
            continue
        moved = T - displaced
        kinetic = T - project(one, one.kinetic * bound, moved)
        held = T - project(one, one.static * bound, moved)
        at_rest = np.linalg.norm(moved - T) <= 1e-9 * unit
        missed[rows] = held if at_rest and np.linalg.norm(held) < np.linalg.norm(kinetic) else kinetic
    return np.asarray(np.maximum(np.abs(missed) - problem.rounding / weight, 0.0) / unit)


def _sliding_residual(one: FrictionSet, bound: float, T: Array, slip: Array, displaced: Array) -> Array:
    mode = one.sliding(slip)
    if not len(mode.held):
        return T - bound * mode.drag
    along = mode.held[0]
    x, reach = float(along @ T), mode.reach * bound
    off = x - float(np.clip(x - along @ displaced, -reach, reach))
    return T - bound * mode.drag - x * along + off * along
