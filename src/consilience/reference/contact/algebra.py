"""Linear algebra of rows, compiled: accelerations and changes of least norm in the mass metric, and small systems.

Instead of singular values, bases of rows come from Gram and Schmidt with pivoting, each vector twice, up to a given
rank.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.mass_metric import solve_factor, solve_factor_transposed
from consilience.reference.kernel.compiled import allocating, inner

RANK = 1e-9
"""Singular values of the scaled system of given modes below this count as zero: dependent contacts."""

NEARLY_HELD, HELD = 1e-2, 1e-12
"""Largest entries, or singular values, of a system whose rows joints all but hold: small ones are relative to them.

And those of rows that joints hold.
"""

REGULAR = 1e-4
"""Pivots above which no singular value comes near that."""


@inner
def dot_rows(a: Array, b: Array) -> float:
    """Return the scalar product of two arrays."""
    s = 0.0
    for i in range(a.shape[0]):
        s += a[i] * b[i]
    return s


@inner
def add_row(into: Array, factor: float, a: Array) -> None:
    """Compute ``into += factor a``."""
    for i in range(a.shape[0]):
        into[i] += factor * a[i]


@inner
def _bring_up(B: Array, R: Array, pivot: Array, k: int) -> float:
    """Exchange row k of B for the largest of the rows from k on; return its squared norm."""
    best, most = k, -1.0
    for c in range(k, B.shape[0]):
        total = dot_rows(B[c], B[c])
        if total > most:
            best, most = c, total
    if best != k:
        pivot[k], pivot[best] = pivot[best], pivot[k]
        for i in range(B.shape[1]):
            B[k, i], B[best, i] = B[best, i], B[k, i]
        for i in range(k):
            R[i, k], R[i, best] = R[i, best], R[i, k]
    return most


@inner
def _orthonormalise(B: Array, R: Array, pivot: Array, limit: int) -> int:
    """Orthonormalise rows of B in place, the largest first; return the rank.

    Parameters
    ----------
    B : ndarray, shape (q, n)
    R : ndarray, shape (q, q)
        Zero; then ``B[pivot[k]] = sum_i R[i, k] b_i`` with the basis b, the first rows of B afterwards.
    pivot : ndarray of int, shape (q,)
        0, 1, 2, ...; overwritten.
    limit : int
        Upper limit of the rank.
    """
    q, first = B.shape[0], 0.0
    rank = min(limit, B.shape[1], q)
    for k in range(rank):
        most = _bring_up(B, R, pivot, k)
        if k == 0:
            first = most
        if most <= RANK_TOLERANCE**2 * first:
            return k
        for j in range(k):  # once more against the basis: the row is what rounding has left of it
            s = dot_rows(B[j], B[k])
            R[j, k] += s
            add_row(B[k], -s, B[j])
        R[k, k] = np.sqrt(dot_rows(B[k], B[k]))
        for i in range(B.shape[1]):
            B[k, i] /= R[k, k]
        for c in range(k + 1, q):
            R[k, c] = dot_rows(B[k], B[c])
            add_row(B[c], -R[k, c], B[k])
    return rank


@inner
def project_out(B: Array, rank: int, x: Array) -> None:
    """Remove from x its part along the basis, twice."""
    for _ in range(2):
        for j in range(rank):
            add_row(x, -dot_rows(B[j], x), B[j])


@allocating
def satisfy(model: Model, B: Array, limit: int, wanted: Array, x: Array) -> int:
    """Replace the part of x along rows by that of least norm with which they have wanted values; return their rank.

    Parameters
    ----------
    model : Model
    B : ndarray, shape (q, 6 n_b)
        Rows on velocities; overwritten, its first rows by their basis in the mass metric.
    limit : int
        Upper limit of the rank.
    wanted : ndarray, shape (q,)
    x : ndarray, shape (6 n_b,)
        ``L^T`` times velocities or accelerations.
    """
    q = B.shape[0]
    R, pivot = np.zeros((q, q)), np.arange(q)
    for r in range(q):
        solve_factor(model, B[r])
    rank = _orthonormalise(B, R, pivot, limit)
    project_out(B, rank, x)
    along = np.zeros(rank)
    for k in range(rank):
        s = wanted[pivot[k]]
        for j in range(k):
            s -= R[j, k] * along[j]
        along[k] = s / R[k, k]
        add_row(x, along[k], B[k])
    return rank


@allocating
def least_change(model: Model, rows: Array, wanted: Array) -> Array:
    """Return the change of velocities of least M-norm with ``rows x = wanted``; the rows are overwritten."""
    x = np.zeros(rows.shape[1])
    satisfy(model, rows, rows.shape[0], wanted, x)
    solve_factor_transposed(model, x)
    return x


@inner
def _exchange_pivot(A: Array, b: Array, order: Array, k: int) -> tuple[float, float]:
    """Exchange rows and columns from k on so that the largest entry comes first; return its magnitude.

    And what the exchanges make of the determinant, -1 or 1.
    """
    n, row, column, most = b.shape[0], k, k, -1.0
    for i in range(k, n):
        for j in range(k, n):
            if abs(A[i, j]) > most:
                row, column, most = i, j, abs(A[i, j])
    order[k], order[column] = order[column], order[k]
    b[k], b[row] = b[row], b[k]
    for j in range(n):
        A[k, j], A[row, j] = A[row, j], A[k, j]
    for i in range(n):
        A[i, k], A[i, column] = A[i, column], A[i, k]
    return most, 1.0 if (row == k) == (column == k) else -1.0


@inner
def size_of_system(largest: float) -> float:
    """Return what singular values are relative to: one, or less where joints all but hold every row."""
    return min(max(largest, HELD) / NEARLY_HELD, 1.0)


@allocating
def _eliminate(system: Array, wanted: Array, x: Array) -> float:
    """Add the solution of a small system to x, by elimination with complete pivoting; return its determinant.

    Zero, and nothing is added, where the system is not regular.
    """
    A, b, n = system.copy(), wanted.copy(), wanted.shape[0]
    order, first, determinant = np.arange(n), 1.0, 1.0
    for k in range(n):
        most, turned = _exchange_pivot(A, b, order, k)
        first = max(size_of_system(most) if k == 0 else first, most)
        if not most > REGULAR * first:
            return 0.0
        determinant *= turned * A[k, k]
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            if factor != 0.0:  # most are zero where few contacts act on one another
                b[i] -= factor * b[k]
                add_row(A[i], -factor, A[k])
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= A[k, j] * b[j]
        b[k] /= A[k, k]
    for k in range(n):
        x[order[k]] += b[k]
    return determinant


@allocating
def solve_small(system: Array, wanted: Array, x: Array) -> float:
    """Add the solution of a small system to x, of least norm where it is singular; return the determinant or zero."""
    determinant = _eliminate(system, wanted, x)
    if determinant != 0.0:
        _eliminate(system, wanted - system @ x, x)
        return determinant
    U, singular, Vt = np.linalg.svd(system)
    for _ in range(2):
        left = wanted - system @ x
        least = RANK * max(size_of_system(singular[0]), singular[0])
        for k in range(singular.shape[0]):
            if singular[k] > least:
                s = 0.0
                for i in range(left.shape[0]):
                    s += U[i, k] * left[i]
                for i in range(x.shape[0]):
                    x[i] += Vt[k, i] * (s / singular[k])
    return 0.0


@inner
def _combine(factors: Array, rows: Array, into: Array) -> None:
    """Add a combination of rows, most of whose factors are zero."""
    for r in range(factors.shape[0]):
        if factors[r] != 0.0:
            add_row(into, factors[r], rows[r])


@allocating
def hold(bias: Array, load: Array, K: Array, a: Array, modes: tuple[Array, Array], p: Array) -> float:
    """Add the forces of what is closed and held to those of given bounds; return the determinant of the modes.

    With ``G = K K^T`` the system is ``(E K) (S K)^T``: E and S have one or two entries in a row.

    Parameters
    ----------
    bias : ndarray, shape (m,)
    load, K : ndarray, shape (m, 6 n_b)
        As of `response.Response`, `load` transposed.
    a : ndarray, shape (6 n_b,)
        ``L^T`` times the accelerations without forces on rows.
    modes : tuple of ndarray
        S and E, shape (r, m), overwritten by those over the scales of the rows.
    p : ndarray, shape (m,)
    """
    S, E = modes
    count, n = S.shape[0], a.shape[0]
    moves, pushes, given = np.zeros((count, n)), np.zeros((count, n)), np.zeros(n)
    wanted, x = np.zeros(count), np.zeros(count)
    _combine(p, K, given)
    for k in range(count):
        size = 0.0
        for r in range(p.shape[0]):
            if E[k, r] != 0.0:
                size += abs(E[k, r]) * np.sqrt(dot_rows(load[r], load[r]))
                wanted[k] -= E[k, r] * (dot_rows(load[r], a) + bias[r] + dot_rows(K[r], given))
        S[k] /= size
        E[k] /= size
        wanted[k] /= size
        _combine(E[k], K, moves[k])
        _combine(S[k], K, pushes[k])
    determinant = solve_small(moves @ pushes.T, wanted, x)
    for k in range(count):
        add_row(p, x[k], S[k])
    return determinant
