"""Least squares of least norm, rank-revealing, for equations whose rows depend on one another.

Complete orthogonal factorisation [Golub and Van Loan, Matrix Computations, section 5.5.2]: with the pivoted factors
``B P = H [R; 0]`` of `factorisation.pivoted_qr`, R of shape (rank, q), and ``R^T = Z [T; 0]``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inner
from consilience.reference.kernel.factorisation import least_norm, ordered_qr, pivoted_qr


class LeastSquares(NamedTuple):
    """Work arrays for B of shape (n, q), with r = min(n, q)."""

    B: Array  # (n, q); overwritten by its factors
    tau: Array  # (r,)
    pivot: Array  # (q,)
    norms: Array  # (q,)
    C: Array  # (q, r) R^T and its factors
    tau_C: Array  # (r,)
    right: Array  # (max(n, q),)


def least_squares(n: int, q: int) -> LeastSquares:
    """Return the work arrays for matrices (n, q)."""
    r = min(n, q)
    pivot, norms = np.zeros(q, dtype=np.int64), np.zeros(q)
    return LeastSquares(np.zeros((n, q)), np.zeros(r), pivot, norms, np.zeros((q, r)), np.zeros(r), np.zeros(max(n, q)))


@inner
def reflect(factors: Array, tau: Array, rank: int, x: Array, back: bool) -> None:
    """Replace x by ``H^T x``, or by ``H x``, H the product of the first `rank` Householder reflections.

    Parameters
    ----------
    factors, tau : ndarray, shapes (n, m) and (min(n, m),)
        Reflections as `factorisation.pivoted_qr` leaves them.
    rank : int
    x : ndarray, shape (n,)
    back : bool
        Whether H is wanted, and not its transpose.
    """
    for step in range(rank):
        k = rank - 1 - step if back else step
        s = x[k]
        for r in range(k + 1, factors.shape[0]):
            s += factors[r, k] * x[r]
        s *= tau[k]
        x[k] -= s
        for r in range(k + 1, factors.shape[0]):
            x[r] -= s * factors[r, k]


@inner
def factorise_rows(by: LeastSquares) -> int:
    """Factorise ``by.B`` in place; return its numerical rank."""
    return pivoted_qr(by.B, by.tau, by.pivot, by.norms, 0.0, by.B.shape[1])


@inner
def factorise_remaining(B: Array, rank: int, by: LeastSquares) -> None:
    """Factorise ``R^T``, R the factor of rank `rank` in B; needed where rows depend on others."""
    for c in range(by.C.shape[0]):
        for k in range(rank):
            by.C[c, k] = B[k, c] if c >= k else 0.0
    ordered_qr(by.C, by.tau_C, 0.0, rank)


@inner
def solve_transposed(by: LeastSquares, rank: int, c: Array, z: Array) -> None:
    """Compute z of least norm that minimises ``|B^T z - c|``, from `factorise_rows`.

    Parameters
    ----------
    by : LeastSquares
    rank : int
    c : ndarray, shape (q,)
    z : ndarray, shape (n,)
        Overwritten.
    """
    q = by.B.shape[1]
    if rank == q:
        least_norm(by.B, by.tau, by.pivot, rank, c, z)
        return
    factorise_remaining(by.B, rank, by)
    for k in range(q):
        by.right[k] = c[by.pivot[k]]
    reflect(by.C, by.tau_C, rank, by.right, False)
    z[:] = 0.0
    for k in range(rank - 1, -1, -1):
        s = by.right[k]
        for r in range(k + 1, rank):
            s -= by.C[k, r] * z[r]
        z[k] = s / by.C[k, k]
    reflect(by.B, by.tau, rank, z, True)


@inner
def solve_factored(B: Array, tau: Array, pivot: Array, rank: int, c: Array, by: LeastSquares, x: Array) -> None:
    """Compute x of least norm that minimises ``|B x - c|``, from the factors of `factorisation.pivoted_qr`.

    Parameters
    ----------
    B, tau, pivot : ndarray
        Factors.
    rank : int
    c : ndarray, shape (n,)
        Overwritten.
    by : LeastSquares
        Its C, tau_C and right are overwritten.
    x : ndarray, shape (q,)
        Overwritten.
    """
    q, w = B.shape[1], by.right
    reflect(B, tau, rank, c, False)
    w[:] = 0.0
    if rank == q:
        for k in range(rank - 1, -1, -1):
            s = c[k]
            for r in range(k + 1, rank):
                s -= B[k, r] * w[r]
            w[k] = s / B[k, k]
    else:
        factorise_remaining(B, rank, by)
        for k in range(rank):
            s = c[k]
            for r in range(k):
                s -= by.C[r, k] * w[r]
            w[k] = s / by.C[k, k]
        reflect(by.C, by.tau_C, rank, w, True)
    for k in range(q):
        x[pivot[k]] = w[k]
