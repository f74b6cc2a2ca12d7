"""Linear complementarity by Lemke's method with lexicographic pivots (Cottle, Pang and Stone 1992, section 4.4)."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import allocating, inner

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
    tableau, z = np.hstack([np.eye(n), -matrix, -cover[:, None], constant[:, None]]), np.zeros(n)
    return z if _lemke(tableau, cover, z) else None


@inner
def _exchange(tableau: Array, row: int, entering: int) -> None:
    """Let a column enter the basis in a row."""
    pivot = tableau[row, entering]
    for j in range(tableau.shape[1]):
        tableau[row, j] /= pivot
    for i in range(tableau.shape[0]):
        factor = tableau[i, entering]
        for j in range(tableau.shape[1] if i != row else 0):
            tableau[i, j] -= factor * tableau[row, j]


@inner
def _allow(column: Array, allowed: Array) -> bool:
    """Mark the rows in which a column may enter; return whether there are some."""
    largest, some = 1.0, False
    for i in range(column.shape[0]):
        largest = max(largest, abs(column[i]))
    for i in range(column.shape[0]):
        allowed[i] = column[i] > _PIVOT * largest
        some = some or allowed[i]
    return some


@allocating
def _lemke(tableau: Array, cover: Array, z: Array) -> bool:
    """Write the solution z; return whether the method ends with one."""
    n = cover.shape[0]
    basis, allowed = np.arange(n), np.ones(n, dtype=np.bool_)
    row, entering = _lexicographic(tableau, allowed, cover, basis), 2 * n
    for _ in range(50 * n + 100):
        leaving = basis[row]
        _exchange(tableau, row, entering)
        basis[row] = entering
        if leaving == 2 * n:
            for i in range(n):
                if n <= basis[i] < 2 * n:
                    z[basis[i] - n] = max(tableau[i, 2 * n + 1], 0.0)
            return True
        entering = leaving + n if leaving < n else leaving - n
        column = tableau[:, entering].copy()
        if not _allow(column, allowed):
            return False
        row = _lexicographic(tableau, allowed, column, basis)
    return False


@inner
def _lexicographic(tableau: Array, allowed: Array, column: Array, basis: Array) -> int:
    """Return the allowed row of least ratio; ties end the method if they can, else the inverse of the basis decides."""
    n = basis.shape[0]
    first = -1
    for c in range(-1, n):
        k, least = c if c >= 0 else 2 * n + 1, np.inf
        for i in range(n):
            if allowed[i]:
                least = min(least, tableau[i, k] / column[i])
        count, first, last = 0, -1, -1
        for i in range(n):
            allowed[i] = allowed[i] and tableau[i, k] / column[i] <= least + _TIE * max(1.0, abs(least))
            if allowed[i]:
                count += 1
                first = i if first < 0 else first
                last = i if basis[i] == 2 * n else last
        if last >= 0:
            return last
        if count == 1:
            return first
    return first
