"""Minimal form by the null space of the constraint Jacobian [C4 (4.99)-(4.110)].

    Q a = gamma,   a = J y'' + abar,   Q J = 0,
    J^T M J y'' = J^T (f - M abar).

J is an orthonormal basis of the null space and abar the least-norm solution of ``Q abar = gamma``, both from a singular
value decomposition of Q at every evaluation. M is assembled, and the metric is Euclidean: the formulation shares rows
and forces with the descriptor form, but not the solution.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.bodies.motion import rotations
from consilience.reference.kernel.cholesky import cholesky, solve_lower, solve_lower_transposed
from consilience.reference.kernel.compiled import allocating


@allocating
def selected_rows(ws: Workspace) -> tuple[Array, Array]:
    """Return Q and gamma of the rows that the last projection found independent; of all rows if it lost no rank.

    Off the manifold dependent rows contradict these (see `factorisation.ordered_qr`).
    """
    if ws.best[0].rank == 0 or ws.limit[0] == ws.Q.shape[0]:
        return ws.Q, ws.gamma
    rows = ws.pivot[: ws.limit[0]]
    return ws.Q[rows], ws.gamma[rows]


@allocating
def basis(Q: Array, gamma: Array, limit: int) -> tuple[Array, Array]:
    """Return a null-space basis J, shape (6 n_b, freedom), and the least-norm solution abar of ``Q abar = gamma``.

    The rank is at most `limit` (see `factorisation.pivoted_qr`).
    """
    if Q.shape[0] == 0:
        return np.eye(Q.shape[1]), np.zeros(Q.shape[1])
    U, s, Vt = np.linalg.svd(Q)
    rank = 0
    for k in range(min(limit, s.shape[0])):
        if s[k] > RANK_TOLERANCE * s[0]:
            rank += 1
    along = np.ascontiguousarray(U[:, :rank].T) @ gamma
    abar = np.ascontiguousarray(Vt[:rank].T) @ (along / s[:rank])
    return np.ascontiguousarray(Vt[rank:].T), abar


@allocating
def solve_reduced(model: Model, f: Array, J: Array, abar: Array, a: Array) -> int:
    """Solve ``J^T M J y'' = J^T (f - M abar)``, write ``a = J y'' + abar``; return the rank of the constraints.

    Parameters
    ----------
    model : Model
    f, abar, a : ndarray, shape (6 n_b,)
    J : ndarray, shape (6 n_b, freedom)
    """
    freedom = J.shape[1]
    a[:] = abar
    if freedom > 0:
        M = mass_matrix(model)
        reduced, force = J.T @ (M @ J), J.T @ (f - M @ abar)
        cholesky(reduced)
        solve_lower(reduced, force)
        solve_lower_transposed(reduced, force)
        a += J @ force
    return a.shape[0] - freedom


@allocating
def accelerations(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Compute accelerations (dv/dt, dw'/dt) with a null space by singular values; return the rank of the constraints.

    Parameters
    ----------
    model, t, y, turns, ws, a
        As in `descriptor.accelerations`.
    """
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    constraints.evaluate(model, t, y, turns, ws)
    if not (np.all(np.isfinite(ws.Q)) and np.all(np.isfinite(ws.f))):
        a[:] = np.nan  # LAPACK would raise; the integrator reports NaN
        return 0
    J, abar = basis(ws.Q, ws.gamma, ws.limit[0])
    return solve_reduced(model, ws.f, J, abar, a)
