"""Linear complementarity by Lemke's method with lexicographic pivots (Cottle, Pang and Stone 1992, section 4.4)."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import allocating, inner

_PIVOT = 1e-11
"""Smallest pivot, relative to the largest entry of the column when it enters."""

_ROUNDED = 1e-11
"""Error of w that the pivots may leave."""

_SPARSE = 2
"""Share of the entries of a row, one in so many, up to which those that are not zero are taken alone."""

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
    return _corrected(matrix, constant, z) if _lemke(tableau, cover, z) else None


def _corrected(matrix: Array, constant: Array, z: Array) -> Array:
    """Return a solution whose basis is solved once more, where many pivots have left errors."""
    basic = np.flatnonzero(z > 0.0)
    left = (matrix @ z + constant)[basic]
    if np.max(np.abs(left), initial=0.0) > _ROUNDED:
        z[basic] -= np.linalg.lstsq(matrix[np.ix_(basic, basic)], left)[0]
    return z


@inner
def _exchange(tableau: Array, row: int, entering: int, some: Array) -> None:
    """Let a column enter the basis in a row; `some` is overwritten by the columns in which the row is not zero."""
    pivot, count, width = tableau[row, entering], 0, tableau.shape[1]
    for j in range(width):
        tableau[row, j] /= pivot
        if tableau[row, j] != 0.0:
            some[count] = j
            count += 1
    for i in range(tableau.shape[0]):
        factor = tableau[i, entering]
        if i == row or factor == 0.0:
            continue
        if _SPARSE * count > width:
            for j in range(width):
                tableau[i, j] -= factor * tableau[row, j]
        else:
            for c in range(count):
                tableau[i, some[c]] -= factor * tableau[row, some[c]]


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
    basis, allowed, some = np.arange(n), np.ones(n, dtype=np.bool_), np.arange(2 * n + 2)
    row, entering = _lexicographic(tableau, allowed, cover, basis, some), 2 * n
    for _ in range(50 * n + 100):
        leaving = basis[row]
        _exchange(tableau, row, entering, some)
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
        row = _lexicographic(tableau, allowed, column, basis, some)
    return False


@inner
def _lexicographic(tableau: Array, allowed: Array, column: Array, basis: Array, some: Array) -> int:
    """Return the allowed row of least ratio; ties end the method if they can, else the inverse of the basis decides.

    `some` is overwritten by the rows that are left.
    """
    n, count = basis.shape[0], 0
    for i in range(n):
        if allowed[i]:
            some[count] = i
            count += 1
    for c in range(-1, n):
        k, least = c if c >= 0 else 2 * n + 1, np.inf
        for i in some[:count]:
            least = min(least, tableau[i, k] / column[i])
        kept, last = 0, -1
        for i in some[:count]:
            if tableau[i, k] / column[i] <= least + _TIE * max(1.0, abs(least)):
                some[kept] = i
                kept += 1
                last = i if basis[i] == 2 * n else last
        count = kept
        if last >= 0:
            return last
        if count == 1:
            break
    return some[0]
