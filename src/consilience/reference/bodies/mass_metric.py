"""Mass metric of all bodies: ``M = diag(m 1, I') = L L^T``, constant in body axes.

The rank-revealing QR of the constraint Jacobian in this metric, ``B = L^-1 Q^T``, gives corrections of least M-norm.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.kernel.compiled import allocating, inner, kernel
from consilience.reference.kernel.factorisation import ordered_qr, pivoted_qr
from consilience.reference.kernel.vectors import assign


@allocating
def mass_matrix(model: Model) -> Array:
    """Assemble ``M = diag(m 1, I')`` of all bodies, shape (6 n_b, 6 n_b)."""
    n = model.mass.shape[0]
    M = np.zeros((6 * n, 6 * n))
    for b in range(n):
        o = 6 * b
        for k in range(3):
            M[o + k, o + k] = model.mass[b]
            for j in range(3):  # slice assignment compiles slowly
                M[o + 3 + k, o + 3 + j] = model.inertia[b, k, j]
    return M


@inner
def solve_factor(model: Model, x: Array) -> None:
    """Solve ``x <- L^-1 x`` in place for generalised forces x, shape (6 n_b,)."""
    for b in range(model.mass.shape[0]):
        s = 1.0 / np.sqrt(model.mass[b])
        F = model.inertia_factor[b]
        o = 6 * b
        for k in range(3):
            x[o + k] *= s
        x[o + 3] = x[o + 3] / F[0, 0]
        x[o + 4] = (x[o + 4] - F[1, 0] * x[o + 3]) / F[1, 1]
        x[o + 5] = (x[o + 5] - F[2, 0] * x[o + 3] - F[2, 1] * x[o + 4]) / F[2, 2]


@inner
def solve_factor_transposed(model: Model, x: Array) -> None:
    """Solve ``x <- L^-T x`` in place, shape (6 n_b,)."""
    for b in range(model.mass.shape[0]):
        s = 1.0 / np.sqrt(model.mass[b])
        F = model.inertia_factor[b]
        o = 6 * b
        for k in range(3):
            x[o + k] *= s
        x[o + 5] = x[o + 5] / F[2, 2]
        x[o + 4] = (x[o + 4] - F[2, 1] * x[o + 5]) / F[1, 1]
        x[o + 3] = (x[o + 3] - F[1, 0] * x[o + 4] - F[2, 0] * x[o + 5]) / F[0, 0]


@kernel
def factorise(model: Model, ws: Workspace) -> int:
    """Factorise ``B = L^-1 Q^T`` of ``ws.Q`` by pivoted QR; return the numerical rank."""
    q = ws.Q.shape[0]
    for row in range(q):
        assign(ws.z, ws.Q[row])
        solve_factor(model, ws.z)
        assign(ws.B[:, row], ws.z)
    return pivoted_qr(ws.B, ws.tau, ws.pivot, ws.norms, 0.0, ws.limit[0])


@inner
def factorise_as_projected(model: Model, ws: Workspace) -> int:
    """Factorise B with the independent rows of the last projection, in its order, if that projection lost rank."""
    if ws.best[0].rank == 0 or ws.limit[0] == ws.Q.shape[0]:
        return factorise(model, ws)
    for k in range(ws.limit[0]):
        assign(ws.z, ws.Q[ws.pivot[k]])
        solve_factor(model, ws.z)
        assign(ws.B[:, k], ws.z)
    return ordered_qr(ws.B, ws.tau, 0.0, ws.limit[0])
