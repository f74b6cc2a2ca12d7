"""Minimal form by the null space of the constraint Jacobian, from a QR factorisation [C4 (4.99)-(4.110)].

    Q a = gamma,   a = J y'' + abar,   Q J = 0,
    J^T M J y'' = J^T (f - M abar).

Householder QR with column pivoting, ``Q^T P = H [R; 0]`` [Golub and Van Loan, Matrix Computations, section 5.5.6]: the
first r columns of the orthogonal H span the rows of Q, r being the numerical rank, and the others are J. abar is the
least-norm solution, ``R11^T x = (P^T gamma)[:r]``, ``abar = H [x; 0]``. They are the J and abar of the singular
value decomposition of `null_space`, up to a rotation of y'', at a fraction of the cost; both are chosen anew at every
evaluation. The descriptor form factorises ``L^-1 Q^T``, and so has its J in the metric of the masses.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.bodies.motion import rotations
from consilience.reference.kernel.compiled import allocating
from consilience.reference.kernel.factorisation import least_norm, pivoted_qr


@allocating
def complement(B: Array, tau: Array, rank: int) -> Array:
    """Orthonormal basis of what is orthogonal to the columns of a matrix factorised by `pivoted_qr`.

    The last columns of ``H = H_1 ... H_rank``, shape (n, n - rank).
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
    """Null-space basis J, shape (6 n_b, freedom), and least-norm solution abar of ``Q abar = gamma``.

    The rank is at most ``ws.limit`` (see `factorisation.pivoted_qr`). Overwrites ``ws.B``; Q and gamma stay.
    """
    ws.B[:, :] = ws.Q.T
    rank = pivoted_qr(ws.B, ws.tau, ws.pivot, ws.norms, 0.0, ws.limit[0])
    abar = np.empty(ws.Q.shape[1])
    least_norm(ws.B, ws.tau, ws.pivot, rank, ws.gamma, abar)
    return complement(ws.B, ws.tau, rank), abar


@allocating
def solve_reduced(model: Model, f: Array, J: Array, abar: Array, a: Array) -> int:
    """Solve ``J^T M J y'' = J^T (f - M abar)`` and leave ``J y'' + abar`` in a; the rank of the constraints."""
    freedom = J.shape[1]
    a[:] = abar
    if freedom > 0:
        M = mass_matrix(model)
        reduced, force = J.T @ (M @ J), J.T @ (f - M @ abar)
        if not (np.all(np.isfinite(reduced)) and np.all(np.isfinite(force))):
            a[:] = np.nan  # a solution would raise; the integrator reports it
            return 0
        a += J @ np.linalg.solve(reduced, force)
    return a.shape[0] - freedom


@allocating
def accelerations(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Accelerations (dv/dt, dw'/dt) of all bodies at a state; arguments and return as in `descriptor`."""
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    constraints.evaluate(model, t, y, turns, ws)
    if not np.all(np.isfinite(ws.Q)):
        a[:] = np.nan  # the factorisation would leave such rows out; the integrator reports it
        return 0
    J, abar = basis(ws)
    return solve_reduced(model, ws.f, J, abar, a)
