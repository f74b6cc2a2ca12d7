"""Minimal form, recursive along a spanning tree with cut joints [C4 (4.99)-(4.110)].

    a = J u + abar,   J^T M J u = J^T (f - M abar)

J and abar are not formed; they are the product, from the ground outwards, of one step per tree joint,

    a_k = X_k a_p + S_k u_k + c_k,     X_k = [1 -~r; 0 1],  r from the centre of mass of the parent p to that of k.

S_k holds the free directions of the joint, one a row, and c_k the terms quadratic in velocities. Accelerations and
wrenches of a body are (linear, angular) in **world** axes at its centre of mass.

Two algorithms for u. *Articulated bodies*: three sweeps, cost proportional to the number of bodies [Featherstone, Rigid
Body Dynamics Algorithms, 2008, table 7.1]. *Composite bodies*: joint-space mass matrix H [table 6.2], bias by recursive
Newton-Euler [table 5.1], Cholesky factorisation. Both factorise ``H = G G^T`` (articulated bodies implicitly, by the
blocks ``D = L L^T``) and compute **whitened** joint forces ``e = G^-1 tau``.

Cut joints keep their rows ``Q a = gamma`` and act by ``Q^T lam``. The response of the tree to a unit multiplier, by a
backward sweep, is a column of ``B = G^-1 J^T Q^T``, and the loop system is

    A lam = gamma - Q a_tree,     A = Q J (J^T M J)^-1 J^T Q^T = B^T B.

A is not formed: its condition number is the square of that of B. A rank-revealing QR of B gives ``zeta = B lam`` of
least norm, without dependent rows, and e + zeta are the whitened joint forces of the mechanism with closed loops.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.mass_metric import solve_factor
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.spanning_tree import (
    TreeModel,
    TreeState,
    kinematics,
    world_wrenches,
    write_accelerations,
)
from consilience.reference.kernel.cholesky import cholesky, solve_lower, solve_lower_transposed
from consilience.reference.kernel.compiled import allocating
from consilience.reference.kernel.factorisation import least_norm, pivoted_qr


class Articulated(NamedTuple):
    """Articulated inertias in whitened form."""

    L: Array  # (n_b, 6, 6) Cholesky factor of D = S^T I^A S, in the first rows and columns
    W: Array  # (N, 6) L^-1 S^T I^A
    inertia: Array  # (n_b, 6, 6) I^a = I^A - W^T W


# ---------------------------------------------------------------- articulated bodies


@allocating
def articulate(tree: TreeModel, links: TreeState) -> Articulated:
    """Compute articulated inertias from the tips to the ground, the force-free part of the second sweep."""
    n = tree.body.shape[0]
    art = Articulated(np.zeros((n, 6, 6)), np.zeros(links.S.shape), links.inertia.copy())
    for k in range(n - 1, -1, -1):
        first, last, p = tree.first_free[k], tree.first_free[k + 1], tree.parent[k]
        if first < last:
            S, L, W = links.S[first:last], art.L[k, : last - first, : last - first], art.W[first:last]
            W[:, :] = S @ art.inertia[k]  # U^T = S^T I^A
            L[:, :] = W @ S.T  # D = S^T U
            cholesky(L)
            for m in range(6):
                solve_lower(L, W[:, m])
            art.inertia[k] -= W.T @ W  # I^a = I^A - U D^-1 U^T
        if p >= 0:
            art.inertia[p] += links.X[k].T @ art.inertia[k] @ links.X[k]
    return art


@allocating
def innovations(tree: TreeModel, links: TreeState, art: Articulated, wrench: Array, c: Array) -> Array:
    """Compute the whitened joint forces e of wrenches on the links, shape (N,), the other part of the second sweep.

    ``p^A = -wrench``, ``L e = -S^T p^A``, ``p^a = p^A + I^a c + W^T e``, and ``X^T p^a`` is added to the parent.

    Parameters
    ----------
    tree : TreeModel
    links : TreeState
    art : Articulated
    wrench, c : ndarray, shape (n_b, 6)
        Wrenches and bias accelerations, world axes.
    """
    bias, e = -wrench, np.empty(links.S.shape[0])
    for k in range(tree.body.shape[0] - 1, -1, -1):
        first, last, p = tree.first_free[k], tree.first_free[k + 1], tree.parent[k]
        width = last - first
        if width > 0:
            e[first:last] = -(links.S[first:last] @ bias[k])
            solve_lower(art.L[k, :width, :width], e[first:last])
        if p >= 0:
            bias[k] += art.inertia[k] @ c[k]
            if width > 0:
                bias[k] += art.W[first:last].T @ e[first:last]
            bias[p] += links.X[k].T @ bias[k]
    return e


@allocating
def accelerate(tree: TreeModel, links: TreeState, art: Articulated, e: Array) -> Array:
    """Compute the accelerations of the links from the ground to the tips, shape (n_b, 6), the third sweep.

    ``a' = X a_p + c``, ``L^T u = e - W a'``, ``a = a' + S u``.
    """
    n = tree.body.shape[0]
    acc = links.c.copy()
    for k in range(n):
        first, last, p = tree.first_free[k], tree.first_free[k + 1], tree.parent[k]
        width = last - first
        if p >= 0:
            acc[k] += links.X[k] @ acc[p]
        if width > 0:
            u = e[first:last] - art.W[first:last] @ acc[k]
            solve_lower_transposed(art.L[k, :width, :width], u)
            acc[k] += links.S[first:last].T @ u
    return acc


# ---------------------------------------------------------------- composite bodies


@allocating
def composite_mass_matrix(tree: TreeModel, links: TreeState) -> Array:
    """Compute ``H = J^T M J`` by composite bodies, shape (N, N), lower triangle and diagonal blocks only.

    ``I^c_p += X^T I^c X``; ``F = I^c S``, transported towards the ground, gives ``H_kp = F^T S_p`` of every ancestor p.
    """
    inertia, H = links.inertia.copy(), np.zeros((links.S.shape[0], links.S.shape[0]))
    for k in range(tree.body.shape[0] - 1, -1, -1):
        first, last, p = tree.first_free[k], tree.first_free[k + 1], tree.parent[k]
        if p >= 0:
            inertia[p] += links.X[k].T @ inertia[k] @ links.X[k]
        if first == last:
            continue
        F = links.S[first:last] @ inertia[k]
        at = k
        while at >= 0:
            start, stop = tree.first_free[at], tree.first_free[at + 1]
            if start < stop:
                H[first:last, start:stop] = F @ links.S[start:stop].T
            F = F @ links.X[at]
            at = tree.parent[at]
    return H


@allocating
def joint_forces(tree: TreeModel, links: TreeState, wrench: Array) -> Array:
    """Compute ``tau = J^T wrench``, shape (N,), by summing wrenches from the tips to the ground."""
    total, tau = wrench.copy(), np.empty(links.S.shape[0])
    for k in range(tree.body.shape[0] - 1, -1, -1):
        first, last, p = tree.first_free[k], tree.first_free[k + 1], tree.parent[k]
        if first < last:
            tau[first:last] = links.S[first:last] @ total[k]
        if p >= 0:
            total[p] += links.X[k].T @ total[k]
    return tau


@allocating
def joint_motion(tree: TreeModel, links: TreeState, u: Array) -> Array:
    """Compute ``J u + abar``, shape (n_b, 6), from the ground to the tips."""
    acc = links.c.copy()
    for k in range(tree.body.shape[0]):
        first, last, p = tree.first_free[k], tree.first_free[k + 1], tree.parent[k]
        if p >= 0:
            acc[k] += links.X[k] @ acc[p]
        if first < last:
            acc[k] += links.S[first:last].T @ u[first:last]
    return acc


@allocating
def newton_euler(tree: TreeModel, links: TreeState, wrench: Array) -> Array:
    """Compute ``J^T (f - M abar)``, shape (N,), by recursive Newton-Euler at u = 0."""
    acc = joint_motion(tree, links, np.zeros(links.S.shape[0]))
    rest = wrench.copy()
    for k in range(tree.body.shape[0]):
        rest[k] -= links.inertia[k] @ acc[k]
    return joint_forces(tree, links, rest)


@allocating
def _from_whitened(tree: TreeModel, links: TreeState, G: Array, e: Array) -> Array:
    """Compute the accelerations of the links with ``u = G^-T e``."""
    u = e.copy()
    solve_lower_transposed(G, u)
    return joint_motion(tree, links, u)


# ---------------------------------------------------------------- loops


@allocating
def close_loops(B: Array, Q: Array, gamma: Array, a: Array, e: Array, size: float, limit: int) -> int:
    """Add to e the zeta of least norm with ``B^T zeta = gamma - Q a``; return the rank of B, which is overwritten.

    Parameters
    ----------
    B : ndarray, shape (N, q_cut)
    Q : ndarray, shape (q_cut, 6 n_b)
    gamma : ndarray, shape (q_cut,)
    a : ndarray, shape (6 n_b,)
        Accelerations (dv/dt, dw'/dt) of the tree without loops.
    e : ndarray, shape (N,)
    size, limit
        As in `factorisation.pivoted_qr`.
    """
    q = B.shape[1]
    tau, norms, zeta = np.zeros(min(B.shape)), np.zeros(q), np.zeros(B.shape[0])
    pivot = np.zeros(q, dtype=np.int64)
    rank = pivoted_qr(B, tau, pivot, norms, size, limit)
    least_norm(B, tau, pivot, rank, gamma - Q @ a, zeta)
    e += zeta
    return rank


@allocating
def _cut_rows(tree: TreeModel, t: float, y: Array, turns: Array, ws: Workspace) -> tuple[Array, Array]:
    """Evaluate Q, shape (q_cut, 6 n_b), and gamma of the cut rows; views of the workspace.

    Parameters
    ----------
    tree : TreeModel
    t, y, turns, ws
        As in `constraints.evaluate`.
    """
    constraints.evaluate(tree.cut, t, y, turns, ws)
    q = tree.cut_rows
    return ws.Q[:q], ws.gamma[:q]


@allocating
def largest_row(model: Model, Q: Array) -> float:
    """Return the largest ``|L^-1 q|`` of a row, for bodies without joints: an upper bound of its response in the tree.

    It scales the rank decision: if the tree satisfies all rows of the cut joints, their responses are rounding errors.
    """
    largest = 0.0
    for row in range(Q.shape[0]):
        z = Q[row].copy()
        solve_factor(model, z)
        largest = max(largest, np.sqrt(np.dot(z, z)))
    return largest


# ---------------------------------------------------------------- accelerations


@allocating
def accelerations(tree: TreeModel, model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array) -> int:
    """Compute accelerations (dv/dt, dw'/dt) by articulated bodies; return the rank of the constraints.

    Parameters
    ----------
    tree : TreeModel
    model, t, y, turns, ws, a
        As in `descriptor.accelerations`.
    """
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    links = kinematics(tree, model, y, ws.A)
    art = articulate(tree, links)
    e = innovations(tree, links, art, world_wrenches(tree, ws.A, ws.f), links.c)
    write_accelerations(tree, ws.A, accelerate(tree, links, art, e), a)
    tree_rank = a.shape[0] - e.shape[0]
    if tree.cut_rows == 0:
        return tree_rank
    Q, gamma = _cut_rows(tree, t, y, turns, ws)
    B, rest = np.empty((e.shape[0], Q.shape[0])), np.zeros(links.c.shape)
    for row in range(Q.shape[0]):
        B[:, row] = innovations(tree, links, art, world_wrenches(tree, ws.A, Q[row]), rest)
    rank = close_loops(B, Q, gamma, a, e, largest_row(model, Q), ws.limit[0] - tree_rank)
    write_accelerations(tree, ws.A, accelerate(tree, links, art, e), a)
    return tree_rank + rank


@allocating
def composite_accelerations(
    tree: TreeModel, model: Model, t: float, y: Array, turns: Array, ws: Workspace, a: Array
) -> int:
    """Compute accelerations (dv/dt, dw'/dt) by composite bodies; return the rank of the constraints.

    Parameters
    ----------
    tree, model, t, y, turns, ws, a
        As in `accelerations`.
    """
    rotations(y, ws.A)
    forces.evaluate(model, t, y, turns, ws)
    links = kinematics(tree, model, y, ws.A)
    G = composite_mass_matrix(tree, links)
    cholesky(G)
    e = newton_euler(tree, links, world_wrenches(tree, ws.A, ws.f))
    solve_lower(G, e)
    write_accelerations(tree, ws.A, _from_whitened(tree, links, G, e), a)
    tree_rank = a.shape[0] - e.shape[0]
    if tree.cut_rows == 0:
        return tree_rank
    Q, gamma = _cut_rows(tree, t, y, turns, ws)
    B = np.empty((e.shape[0], Q.shape[0]))
    for row in range(Q.shape[0]):
        B[:, row] = joint_forces(tree, links, world_wrenches(tree, ws.A, Q[row]))
        solve_lower(G, B[:, row])
    rank = close_loops(B, Q, gamma, a, e, largest_row(model, Q), ws.limit[0] - tree_rank)
    write_accelerations(tree, ws.A, _from_whitened(tree, links, G, e), a)
    return tree_rank + rank
