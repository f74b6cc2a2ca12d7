"""Minimal form by the null space of the constraint Jacobian [C4 (4.99)-(4.110)].

    Q a = gamma,   a = J y'' + abar,   Q J = 0,
    J^T M J y'' = J^T (f - M abar).

J is an orthonormal basis of the null space and abar the least-norm solution of ``Q abar = gamma``, both from one
singular value decomposition of Q, chosen anew at every evaluation. Unlike the descriptor form, M is assembled and
its constraint space is found in the plain (not the mass) metric: the two share rows and forces, not the solution.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.bodies.motion import rotations
from consilience.reference.kernel.compiled import allocating


@allocating
def basis(Q: Array, gamma: Array, limit: int) -> tuple[Array, Array]:
    """Null-space basis J, shape (6 n_b, freedom), and least-norm solution abar of ``Q abar = gamma``.

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
def accelerations(model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Accelerations (dv/dt, dw'/dt) of all bodies at a state; arguments and return as in `descriptor`."""
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    constraints.evaluate(model, t, y, turns, ws)
    if not (np.all(np.isfinite(ws.Q)) and np.all(np.isfinite(ws.f))):
        a[:] = np.nan  # a decomposition would raise; the integrator reports it
        return 0
    J, abar = basis(ws.Q, ws.gamma, ws.limit[0])
    M = mass_matrix(model)
    freedom = J.shape[1]
    if freedom == 0:
        a[:] = abar
    else:
        y_dd = np.linalg.solve(J.T @ (M @ J), J.T @ (ws.f - M @ abar))
        a[:] = J @ y_dd + abar
    return a.shape[0] - freedom
