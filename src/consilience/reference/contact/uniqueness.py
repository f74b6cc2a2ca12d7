"""Sufficient conditions under which a contact problem has one solution for the accelerations.

With the columns S and rows E of the modes in which all is closed and what does not slide is held, ``M = E G S`` and two
solutions that differ by x: each normal row contributes ``dN du <= 0`` to ``x . M x``, and each friction set that does
not slide at most ``mu |dN| |dw|``, w being its acceleration, by maximal dissipation. So there is one solution if

- no friction depends on a force that itself depends on friction (M symmetric, or no entry from friction to normals),
  nor on one that M leaves open, or
- only normals are open and M is a P-matrix (Cottle, Pang and Stone 1992), or
- the symmetric part H of M is positive definite and ``sum mu |dN| |dw| < x . H x`` for all x, by norms of the
  factors ``mu N H^-1/2`` and ``M_w H^-1/2``.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.mode_system import RANK, columns_and_rows, solve_with_modes
from consilience.reference.contact.problem import ContactProblem

_MOST = 8
"""Largest number of sliding contacts of which all principal minors are computed."""


def proven_unique(problem: ContactProblem) -> bool:
    """Return whether a sufficient condition for unique accelerations holds."""
    modes = problem.natural_modes()
    _, S, E = columns_and_rows(problem, modes)
    if not len(E):
        return True
    size = np.abs(E) @ problem.row_scale()
    M = (E @ problem.delassus @ S) / np.outer(size, size)
    n = len(problem.normals)
    held = [j for j, mode in enumerate(modes.friction) if len(mode.held) and problem.friction[j].kinetic > 0.0]
    if any(problem.friction[j].static > problem.friction[j].kinetic for j in held):
        return False
    loaded = [j for j in held if problem.friction[j].load is not None]
    least = float(np.linalg.eigvalsh(M)[0]) if np.max(np.abs(M - M.T)) <= RANK else -np.inf
    if least > -RANK and (not loaded or np.max(np.abs(M[:n, n:])) < RANK):
        return least > RANK or (not loaded and not solve_with_modes(problem, modes).singular)
    if not loaded and len(E) == n:
        return _is_p_matrix(M)
    return _gain(problem, M, size, held) < 1.0


def _is_p_matrix(M: Array) -> bool:
    n = len(M)
    if n > _MOST:
        return False
    kept = (np.flatnonzero([bits >> i & 1 for i in range(n)]) for bits in range(1, 2**n))
    return all(np.linalg.det(M[np.ix_(rows, rows)]) > RANK for rows in kept)


def _gain(problem: ContactProblem, M: Array, size: Array, held: list[int]) -> float:
    """Return a bound of ``sum mu |dN| |dw|`` relative to ``x . H x``."""
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    if values[0] < RANK:
        return float(np.inf)
    root = vectors / np.sqrt(values)
    modes, first, loads, rates = problem.natural_modes(), len(problem.normals), [], []
    for j in held:
        one, count = problem.friction[j], len(modes.friction[j].held)
        if one.load is not None:
            load = problem.normals.index(one.load)
            own = range(first, first + count)
            a = one.kinetic / size[load] * root[load]
            b = size[own][:, None] * (M[own] @ root)
            balance = np.sqrt(np.linalg.norm(b) / np.linalg.norm(a))
            loads.append(balance * a)
            rates.append(b / balance)
        first += count
    if not loads:  # what is held has constant bounds
        return 0.0
    return float(np.linalg.norm(np.array(loads), 2) * np.linalg.norm(np.vstack(rates), 2))
