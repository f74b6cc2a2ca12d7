"""Cholesky factorisation ``H = G G^T`` of small matrices, and triangular systems."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import inner


@inner
def cholesky(H: Array) -> None:
    """Replace the lower triangle of H by its Cholesky factor."""
    for r in range(H.shape[0]):
        for s in range(r + 1):
            total = H[r, s]
            for k in range(s):
                total -= H[r, k] * H[s, k]
            H[r, s] = np.sqrt(total) if r == s else total / H[s, s]


@inner
def solve_lower(G: Array, x: Array) -> None:
    """Solve ``x <- G^-1 x`` in place."""
    for r in range(x.shape[0]):
        for k in range(r):
            x[r] -= G[r, k] * x[k]
        x[r] /= G[r, r]


@inner
def solve_lower_transposed(G: Array, x: Array) -> None:
    """Solve ``x <- G^-T x`` in place."""
    for r in range(x.shape[0] - 1, -1, -1):
        for k in range(r + 1, x.shape[0]):
            x[r] -= G[k, r] * x[k]
        x[r] /= G[r, r]
