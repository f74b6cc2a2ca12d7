"""Rank-revealing factorisation for constrained accelerations.

Householder QR with column pivoting, ``B P = H R`` [Golub and Van Loan, Matrix Computations, section 5.5.6], of
``B = L^-1 Q^T``; never of ``Q M^-1 Q^T``, whose condition number is the square.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.kernel.compiled import inner, kernel


@kernel
def pivoted_qr(B: Array, tau: Array, pivot: Array, norms: Array, size: float, limit: int) -> int:
    """Factorise B in place: R on and above the diagonal, Householder vectors below (first entry 1 implied).

    Parameters
    ----------
    B : ndarray, shape (n, q)
    tau : ndarray, shape (min(n, q),)
    pivot : ndarray of int, shape (q,)
    norms : ndarray, shape (q,)
        Work array: squared norms of the remaining columns.
    size : float
        Norm of columns that count: the rank is measured against the first diagonal entry, or against this if larger.
    limit : int
        Largest number of columns to take: the rank, where known. Columns that are dependent on the constraint manifold
        appear independent slightly off it.

    Returns
    -------
    int
        Numerical rank: diagonal entries of R above `RANK_TOLERANCE` times the first, or times `size`.
    """
    n, q = B.shape
    smallest = (RANK_TOLERANCE * size) ** 2
    for c in range(q):
        pivot[c] = c
    most = min(n, q, limit)
    for k in range(most):
        best = k
        for c in range(k, q):
            total = 0.0
            for r in range(k, n):
                total += B[r, c] * B[r, c]
            norms[c] = total
            if total > norms[best]:
                best = c
        if k == 0:
            smallest = max(smallest, RANK_TOLERANCE**2 * norms[best])
        if norms[best] <= smallest:  # false for NaN, which then shows in the result
            return k
        if best != k:
            pivot[k], pivot[best] = pivot[best], pivot[k]
            for r in range(n):
                B[r, k], B[r, best] = B[r, best], B[r, k]
        _reflect(B, tau, k, np.sqrt(norms[best]), q)
    return most


@inner
def ordered_qr(B: Array, tau: Array, size: float, count: int) -> int:
    """Factorise the first `count` columns of B in place, without pivoting; returns and `size` as in `pivoted_qr`.

    For rows that a projection has found independent. Off the manifold, in the stages of a step, dependent rows
    contradict them, and a new selection in each stage would make the accelerations jump from stage to stage.
    """
    smallest = (RANK_TOLERANCE * size) ** 2
    for k in range(count):
        total = 0.0
        for r in range(k, B.shape[0]):
            total += B[r, k] * B[r, k]
        if k == 0:
            smallest = max(smallest, RANK_TOLERANCE**2 * total)
        if total <= smallest:
            return k
        _reflect(B, tau, k, np.sqrt(total), count)
    return count


@inner
def _reflect(B: Array, tau: Array, k: int, norm: float, q: int) -> None:
    """Zero column k below the diagonal, and update the columns behind it up to q (Householder step k)."""
    n = B.shape[0]
    alpha = -norm if B[k, k] > 0 else norm
    head = B[k, k] - alpha
    tau[k] = -head / alpha
    for r in range(k + 1, n):
        B[r, k] /= head
    B[k, k] = alpha
    for c in range(k + 1, q):
        s = B[k, c]
        for r in range(k + 1, n):
            s += B[r, k] * B[r, c]
        s *= tau[k]
        B[k, c] -= s
        for r in range(k + 1, n):
            B[r, c] -= s * B[r, k]


@kernel
def least_norm(B: Array, tau: Array, pivot: Array, rank: int, c: Array, z: Array) -> None:
    """Compute z of least norm with ``B^T z = c`` on the independent rows, from `pivoted_qr`.

    ``R11^T y = (P^T c)[:rank]``, then ``z = H [y; 0]``. Dependent rows are satisfied because c is consistent.

    Parameters
    ----------
    B, tau, pivot : ndarray
        Factors from `pivoted_qr`.
    rank : int
    c : ndarray, shape (q,)
    z : ndarray, shape (n,)
        Overwritten.
    """
    n = B.shape[0]
    z[:] = 0.0
    for k in range(rank):
        s = c[pivot[k]]
        for r in range(k):
            s -= B[r, k] * z[r]
        z[k] = s / B[k, k]
    for k in range(rank - 1, -1, -1):
        s = z[k]
        for r in range(k + 1, n):
            s += B[r, k] * z[r]
        s *= tau[k]
        z[k] -= s
        for r in range(k + 1, n):
            z[r] -= s * B[r, k]
