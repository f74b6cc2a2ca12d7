"""Minimal form by coordinate partitioning [Wehage and Haug, ASME J. Mech. Des. 104, 1982, 247-255].

The velocities are partitioned into dependent and independent ones, d and i, with a regular ``Q_d``:

    Q_d a_d + Q_i a_i = gamma,    a_d = Q_d^-1 gamma - Q_d^-1 Q_i a_i,

and with ``a = J a_i + abar``, ``J = [-Q_d^-1 Q_i; 1]``, ``abar = [Q_d^-1 gamma; 0]`` [C4 (4.99)-(4.110)],

    J^T M J a_i = J^T (f - M abar),
    J^T M J = M_ii - Q_i^T Q_d^-T M_dd Q_d^-1 Q_i    (+ terms of M_id where both are of one body).

**Choice.** Gaussian elimination of Q with full pivoting: the largest remaining entry is the pivot, and its column a
dependent velocity. Elimination ends where no entry exceeds `RANK_TOLERANCE` times the first pivot; the remaining rows
are dependent. Velocities are compared in m/s and rad/s. The partition is chosen at every evaluation. Wehage and Haug
integrate the independent coordinates alone and keep a partition until it is badly conditioned; here all velocities are
integrated and projected after every step, and accelerations do not depend on the partition.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.motion import rotations
from consilience.reference.formulations.null_space import selected_rows, solve_reduced
from consilience.reference.kernel.compiled import allocating, inner, kernel


@inner
def _largest(C: Array, first: int, columns: int) -> tuple[int, int]:
    """Return row and column of the largest entry of ``C[first:, first:columns]``."""
    row, column = first, first
    for r in range(first, C.shape[0]):
        for c in range(first, columns):
            if abs(C[r, c]) > abs(C[row, column]):
                row, column = r, c
    return row, column


@inner
def _exchange(C: Array, k: int, row: int, column: int, order: Array) -> None:
    """Move a pivot to (k, k) by exchanging rows and columns.

    Parameters
    ----------
    C : ndarray, shape (q, n + 1)
    k, row, column : int
        Pivots found so far, row and column of the next one.
    order : ndarray of int, shape (n,)
        Order of the columns, updated.
    """
    for c in range(C.shape[1]):
        C[k, c], C[row, c] = C[row, c], C[k, c]
    for r in range(C.shape[0]):
        C[r, k], C[r, column] = C[r, column], C[r, k]
    order[k], order[column] = order[column], order[k]


@kernel
def partition(C: Array, order: Array, limit: int) -> int:
    """Partition the columns of ``C = [Q gamma]`` and solve for the dependent velocities, in place.

    Parameters
    ----------
    C : ndarray, shape (q, n + 1)
        The first `rank` rows become ``[U, Q_d^-1 Q_i, Q_d^-1 gamma]``, columns of Q in the new order.
    order : ndarray of int, shape (n,)
        Overwritten by the new order of the columns: dependent ones first.
    limit : int
        Upper limit of the rank (see `factorisation.pivoted_qr`).

    Returns
    -------
    int
        Rank, the number of dependent velocities.
    """
    q, n = C.shape[0], C.shape[1] - 1
    for c in range(n):
        order[c] = c
    rank = 0
    while rank < min(q, n, limit):
        k = rank
        row, column = _largest(C, k, n)
        if abs(C[row, column]) <= RANK_TOLERANCE * abs(C[0, 0] if k > 0 else 0.0):
            break
        _exchange(C, k, row, column, order)
        for r in range(k + 1, q):
            factor = C[r, k] / C[k, k]
            if factor != 0.0:
                for c in range(k, n + 1):
                    C[r, c] -= factor * C[k, c]
        rank += 1
    for k in range(rank - 1, -1, -1):
        for c in range(rank, n + 1):
            s = C[k, c]
            for r in range(k + 1, rank):
                s -= C[k, r] * C[r, c]
            C[k, c] = s / C[k, k]
    return rank


@allocating
def basis(Q: Array, gamma: Array, limit: int) -> tuple[Array, Array]:
    """Return ``J = [-Q_d^-1 Q_i; 1]``, shape (6 n_b, freedom), and ``abar = [Q_d^-1 gamma; 0]``, in body order.

    The rows of the independent velocities in J form a unit matrix. The rank is at most `limit`.
    """
    q, n = Q.shape
    C, order = np.empty((q, n + 1)), np.empty(n, dtype=np.int64)
    C[:, :n] = Q
    C[:, n] = gamma
    rank = partition(C, order, limit)
    J, abar = np.zeros((n, n - rank)), np.zeros(n)
    for k in range(rank):
        J[order[k]] = -C[k, rank:n]
        abar[order[k]] = C[k, n]
    for k in range(rank, n):
        J[order[k], k - rank] = 1.0
    return J, abar


@allocating
def accelerations(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Compute accelerations (dv/dt, dw'/dt) in independent velocities; return the rank of the constraints.

    Parameters
    ----------
    model, t, y, turns, ws, a
        As in `descriptor.accelerations`.
    """
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    constraints.evaluate(model, t, y, turns, ws)
    Q, gamma = selected_rows(ws)
    J, abar = basis(Q, gamma, ws.limit[0])
    return solve_reduced(model, ws.f, J, abar, a)
