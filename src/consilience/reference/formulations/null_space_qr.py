"""Minimal form by the null space of the constraint Jacobian, from a QR factorisation [C4 (4.99)-(4.110)].

    Q a = gamma,   a = J y'' + abar,   Q J = 0,
    J^T M J y'' = J^T (f - M abar).

Householder QR with column pivoting at every evaluation, ``Q^T P = H [R; 0]`` [Golub and Van Loan, Matrix Computations,
section 5.5.6]: the first r columns of the orthogonal H span the rows of Q, r the numerical rank; the others are J. The
least-norm solution is ``abar = H [x; 0]``, ``R11^T x = (P^T gamma)[:r]``. J and abar are those of `null_space` up to a
rotation of y''. The metric is Euclidean; the descriptor form factorises ``L^-1 Q^T`` instead.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.motion import rotations
from consilience.reference.formulations.null_space import selected_rows, solve_reduced
from consilience.reference.kernel.compiled import allocating
from consilience.reference.kernel.factorisation import least_norm, pivoted_qr


@allocating
def complement(B: Array, tau: Array, rank: int) -> Array:
    """Return an orthonormal basis, shape (n, n - rank), of the complement of the columns factorised by `pivoted_qr`.

    These are the last columns of ``H = H_1 ... H_rank``.
    """
    n = B.shape[0]
    J = np.zeros((n, n - rank))
    for column in range(n - rank):
        J[rank + column, column] = 1.0
        for k in range(rank - 1, -1, -1):
            s = J[k, column]
            for r in range(k + 1, n):
                s += B[r, k] * J[r, column]
            s *= tau[k]
            J[k, column] -= s
            for r in range(k + 1, n):
                J[r, column] -= s * B[r, k]
    return J


@allocating
def basis(ws: Workspace) -> tuple[Array, Array]:
    """Return a null-space basis J, shape (6 n_b, freedom), and the least-norm solution abar of ``Q abar = gamma``.

    The rank is at most ``ws.limit``.
    """
    Q, gamma = selected_rows(ws)
    B, abar = Q.T.copy(), np.empty(Q.shape[1])
    order = np.empty(Q.shape[0], dtype=np.int64)
    rank = pivoted_qr(B, ws.tau, order, ws.norms, 0.0, ws.limit[0])
    least_norm(B, ws.tau, order, rank, gamma, abar)
    return complement(B, ws.tau, rank), abar


@allocating
def accelerations(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Compute accelerations (dv/dt, dw'/dt) with a null space by pivoted QR; return the rank of the constraints.

    Parameters
    ----------
    model, t, y, turns, ws, a
        As in `descriptor.accelerations`.
    """
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    constraints.evaluate(model, t, y, turns, ws)
    if not np.all(np.isfinite(ws.Q)):
        a[:] = np.nan  # QR would leave out rows that are NaN; the integrator reports NaN
        return 0
    J, abar = basis(ws)
    return solve_reduced(model, ws.f, J, abar, a)
