"""Linear complementarity by Lemke's method with lexicographic pivots (Cottle, Pang and Stone 1992, section 4.4)."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array

_PIVOT = 1e-11
"""Smallest pivot, relative to the largest entry of the column when it enters."""

_TIE = 1e-12
"""Ratios that differ by less count as equal, and the next column of the tableau decides."""


def solve_lcp(matrix: Array, constant: Array, covering: Array | None = None) -> Array | None:
    """Solve ``z >= 0, w = M z + q >= 0, z . w = 0``.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        M; entries of order one serve the tolerances best.
    constant : ndarray, shape (n,)
        q.
    covering : ndarray, shape (n,), optional
        Positive vector; ones if left out. Where there are several solutions another vector can find another.

    Returns
    -------
    ndarray, shape (n,), or None
        z; none if the method ends on a ray, which for a matrix that is copositive on the rays means that there is no
        solution, and otherwise means nothing.
    """
    n = len(constant)
    if np.all(constant >= 0.0):
        return np.zeros(n)
    cover = np.ones(n) if covering is None else covering
    # columns: w (first the identity, later the inverse of the basis), z, z0, right side
    tableau = np.hstack([np.eye(n), -matrix, -cover[:, None], constant[:, None]])
    basis = np.arange(n)
    row = _lexicographic(tableau, np.arange(n), cover, basis)
    entering = 2 * n
    for _ in range(50 * n + 100):
        leaving = int(basis[row])
        tableau[row] /= tableau[row, entering]
        column = tableau[:, entering].copy()
        column[row] = 0.0
        tableau -= np.outer(column, tableau[row])
        basis[row] = entering
        if leaving == 2 * n:
            z = np.zeros(2 * n)
            z[basis[basis < 2 * n]] = tableau[basis < 2 * n, -1]
            return np.maximum(z[n:], 0.0)
        entering = leaving + n if leaving < n else leaving - n
        column = tableau[:, entering]
        allowed = np.flatnonzero(column > _PIVOT * max(1.0, float(np.max(np.abs(column)))))
        if not len(allowed):
            return None
        row = _lexicographic(tableau, allowed, column, basis)
    return None


def _lexicographic(tableau: Array, allowed: Array, column: Array, basis: Array) -> int:
    """Return the row of least ratio; ties end the method if they can, else the inverse of the basis decides."""
    n = len(basis)
    for k in (-1, *range(n)):
        ratios = tableau[allowed, k] / column[allowed]
        least = float(np.min(ratios))
        allowed = allowed[ratios <= least + _TIE * max(1.0, abs(least))]
        last = allowed[basis[allowed] == 2 * n]
        if len(allowed) == 1 or len(last):
            return int([*last, *allowed][0])
    return int(allowed[0])
