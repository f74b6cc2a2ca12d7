"""Accelerations of a linkage of few freedoms, by elimination of its rows [C4 (4.99)-(4.110)].

In the free directions the rows are ``J u = t``, with t the residual of the accelerations of the links for u = 0.
Gauss-Jordan elimination gives ``u = b + T alpha``, alpha being the accelerations of the f independent directions, and

    T^T M T alpha = -T^T (M b + h).

Neither the mass matrix M nor articulated inertias are formed: column e of T moves the links with V_e, b with a, and
``(T^T M T)_ed = sum V_e . I V_d``, ``(T^T (M b + h))_e = sum V_e . (I a + p)``. For small f this needs less work than
the whitened responses of the tree to all rows.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import Vector, add, cross, dot, load, put, scale, sub
from consilience.reference.tree.inertia import load_six, symmetric_times
from consilience.reference.tree.kinematics import load_vector, store_vector
from consilience.reference.tree.loop_groups import TOUCHED, EliminationArrays, Loops, MultifrontalQR

FREEDOMS = 6
"""Largest number f of independent directions."""

ONE_TARGET, TWO_TARGETS = np.array([1, 2])
"""Numbers of right sides, as NumPy integers: Numba compiles a kernel anew for each Python integer in a call."""

REGULAR_PIVOT = 0.01
"""Ratio of the least pivot to its largest value so far below which the fronts are used instead. A smaller ratio loses
digits in a flat parallelogram.
"""


@inner
def count_active_rows(group: Array, state: Array) -> int:
    """Return the number of active rows."""
    rank = 0
    for g in range(group.shape[0]):
        rank += state[g].active
    return rank


@kernel
def has_few_freedoms(group: Array, state: Array, independent: Array) -> bool:
    """Return whether the active rows leave few of few directions free."""
    return independent.shape[0] > 0 and independent.shape[0] - count_active_rows(group, state) <= FREEDOMS


@fused
def _solve_row(J: Array, rows: int, columns: int, row: int, column: int) -> None:
    """Solve a row for a direction, and substitute the solution into the other rows."""
    inverse = 1.0 / J[row, column]
    for c in range(columns):
        J[row, c] *= inverse
    for other in range(rows):
        factor = J[other, column]
        if other != row and factor != 0.0:
            for c in range(columns):
                J[other, c] -= factor * J[row, c]
            J[other, column] = 0.0


@fused
def gauss_jordan(J: Array, rows: int, columns: int, solved: Array, independent: Array) -> tuple[int, float]:
    """Solve each row for the direction of its largest entry.

    Parameters
    ----------
    J : ndarray, shape (q, N + 2)
        Rows in the free directions; columns behind N are right sides. Overwritten.
    rows, columns : int
        Rows in use; directions and right sides in use.
    solved : ndarray of int, shape (q,)
        Overwritten: direction that a row is solved for, -1 for a dependent row.
    independent : ndarray of int, shape (N,)
        Overwritten: the first f entries are the independent directions.

    Returns
    -------
    int, float
        f, and the least pivot: zero where a row depends on the rows before.
    """
    count, largest, least, freedoms = independent.shape[0], 0.0, np.inf, 0
    for r in range(rows):
        for c in range(count):
            largest = max(largest, abs(J[r, c]))
    for c in range(count):
        independent[c] = 0
    for r in range(rows):
        best, size = -1, RANK_TOLERANCE * largest
        for c in range(count):
            if abs(J[r, c]) > size:
                best, size = c, abs(J[r, c])
        solved[r] = best
        if best < 0:
            least = 0.0
            continue
        independent[best], least = 1, min(least, size)
        _solve_row(J, rows, columns, r, best)
    for c in range(count):
        if independent[c] == 0:
            independent[freedoms] = c
            freedoms += 1
    return freedoms, least


@fused
def _spread(J: Array, rows: int, solved: Array, column: int, factor: float, u: Array) -> None:
    """Set the solved directions in u to a column of J times a factor."""
    for r in range(rows):
        if solved[r] >= 0:
            u[solved[r]] = factor * J[r, column]


@inner
def particular_solution(J: Array, rows: int, solved: Array, u: Array) -> None:
    """Compute the solution b, with zero in the independent directions."""
    for n in range(u.shape[0]):
        u[n] = 0.0
    _spread(J, rows, solved, u.shape[0], 1.0, u)


@fused
def homogeneous_solution(J: Array, rows: int, solved: Array, direction: int, u: Array) -> None:
    """Compute the column of T of an independent direction.

    Parameters
    ----------
    J, rows, solved : see `gauss_jordan`
    direction : int
    u : ndarray, shape (N,)
        Overwritten.
    """
    for n in range(u.shape[0]):
        u[n] = 0.0
    u[direction] = 1.0
    _spread(J, rows, solved, direction, -1.0, u)


@fused
def _cholesky(G: Array, freedoms: int) -> None:
    """Factorise the reduced mass matrix in place."""
    for e in range(freedoms):
        for d in range(e):
            for c in range(d):
                G[e, d] -= G[e, c] * G[d, c]
            G[e, d] /= G[d, d]
        for c in range(e):
            G[e, e] -= G[e, c] * G[e, c]
        G[e, e] = np.sqrt(G[e, e])


@fused
def _cholesky_solve(G: Array, freedoms: int) -> None:
    """Solve the reduced equations in place; the right side stands behind the factor."""
    for e in range(freedoms):
        for c in range(e):
            G[e, freedoms] -= G[e, c] * G[c, freedoms]
        G[e, freedoms] /= G[e, e]
    for e in range(freedoms - 1, -1, -1):
        for c in range(e + 1, freedoms):
            G[e, freedoms] -= G[c, e] * G[c, freedoms]
        G[e, freedoms] /= G[e, e]


@fused
def add_homogeneous(J: Array, rows: int, solved: Array, independent: Array, G: Array, freedoms: int, u: Array) -> None:
    """Add ``T alpha`` to b in u.

    Parameters
    ----------
    J, rows, solved, independent : see `gauss_jordan`
    G : ndarray, shape (N, N + 1)
        Column `freedoms` holds alpha.
    freedoms : int
    u : ndarray, shape (N,)
        Updated.
    """
    for e in range(freedoms):
        alpha = G[e, freedoms]
        u[independent[e]] = alpha
        for r in range(rows):
            if solved[r] >= 0:
                u[solved[r]] -= alpha * J[r, independent[e]]


@inner
def link_motions(link: Array, free: Array, u: Array, velocity_terms: float, motion: Array) -> None:
    """Compute the motions of placed links for speeds or accelerations u of the free directions.

    Parameters
    ----------
    link, free, u, velocity_terms : see `arrays`
    motion : ndarray of `records.LINK` or `records.MOTION`, shape (n_b + 1,)
        The field acceleration is overwritten; its last row is the motion of the ground.
    """
    for k in range(link.shape[0] - 1):
        p = link[k].parent
        angular = load(motion[p].acceleration[1])
        linear = add(load(motion[p].acceleration[0]), cross(angular, load(link[k].offset)))
        linear = add(linear, scale(velocity_terms, load(link[k].velocity_product[0])))
        angular = add(angular, scale(velocity_terms, load(link[k].velocity_product[1])))
        for n in range(link[k].first, link[k].last):
            linear = add(linear, scale(u[n], load(free[n].s[0])))
            angular = add(angular, scale(u[n], load(free[n].s[1])))
        put(motion[k].acceleration[0], linear)
        put(motion[k].acceleration[1], angular)


@fused
def _subspace_at_origin(links: Array, free: Array, at: Array) -> None:
    """Compute the motions s of the free directions, shape (N, 6), at the centre of mass of the first link."""
    O = load(links[0].position)
    for k in range(links.shape[0] - 1):
        away = sub(load(links[k].position), O)
        for n in range(links[k].first, links[k].last):
            spin = load(free[n].s[1])
            store_vector(at, n, 0, sub(load(free[n].s[0]), cross(spin, away)))
            store_vector(at, n, 3, spin)


@inner
def _inertial_wrench(link: Array, k: int, velocity_terms: float) -> tuple[Vector, Vector]:
    """Return force and torque ``I a + p`` of a link."""
    a, alpha = load(link[k].acceleration[0]), load(link[k].acceleration[1])
    force = add(scale(link[k].mass, a), scale(velocity_terms, load(link[k].bias[0])))
    return force, add(symmetric_times(load_six(link[k].J), alpha), scale(velocity_terms, load(link[k].bias[1])))


@fused
def _reduced_forces(link: Array, freedoms: int, V: Array, G: Array) -> None:
    """Compute the reduced forces alone, without velocity terms."""
    for e in range(freedoms):
        G[e, freedoms] = 0.0
    for k in range(link.shape[0] - 1):
        force, torque = _inertial_wrench(link, k, 0.0)
        for e in range(freedoms):
            v = V[e, k].acceleration
            G[e, freedoms] -= dot(load(v[0]), force) + dot(load(v[1]), torque)


@fused
def _reduced_equations(link: Array, freedoms: int, V: Array, G: Array, velocity_terms: float) -> None:
    """Compute the reduced mass matrix and forces for the accelerations a of the links."""
    for e in range(freedoms):
        for d in range(freedoms + 1):
            G[e, d] = 0.0
    for k in range(link.shape[0] - 1):
        m, I = link[k].mass, load_six(link[k].J)
        force, torque = _inertial_wrench(link, k, velocity_terms)
        for e in range(freedoms):
            v, w = load(V[e, k].acceleration[0]), load(V[e, k].acceleration[1])
            x, y = scale(m, v), symmetric_times(I, w)
            G[e, freedoms] -= dot(v, force) + dot(w, torque)
            for d in range(e + 1):
                G[e, d] += dot(load(V[d, k].acceleration[0]), x) + dot(load(V[d, k].acceleration[1]), y)


@fused
def add_link_accelerations(link: Array, freedoms: int, V: Array, G: Array) -> None:
    """Add ``sum V_e alpha_e``, of `loop_groups.EliminationArrays`, to the accelerations of the links."""
    for e in range(freedoms):
        alpha = G[e, freedoms]
        for k in range(link.shape[0] - 1):
            for part in range(2):
                for r in range(3):
                    link[k].acceleration[part, r] += alpha * V[e, k].acceleration[part, r]


@inner
def store_targets(group: Array, order: Array, state: Array, target: Array, J: Array, column: int) -> None:
    """Copy the targets of the active rows into a column of J.

    Parameters
    ----------
    group, order, state, target : see `loop_groups.Loops`, `loop_groups.MultifrontalQR`
    J : ndarray, shape (q, N + 2)
    column : int
    """
    row = 0
    for g in range(group.shape[0]):
        for number in range(group[g].row, group[g].row + state[g].active):
            J[row, column] = target[order[number]]
            row += 1


@inner
def solve_rows(
    loops: Loops, qr: MultifrontalQR, elimination: EliminationArrays, links: Array, free: Array, targets: int
) -> tuple[int, int, float]:
    """Fill J with the active rows and eliminate; return the numbers of rows and freedoms, and the least pivot.

    Parameters
    ----------
    loops, qr, elimination, free : see `arrays`
    links : ndarray
        Table of the links.
    targets : int
        Number of right sides that J holds behind the directions.
    """
    group, touched, order, state, W, J = loops.group, loops.touched, qr.order, qr.state, qr.W, elimination.J
    rows, count, O = 0, free.shape[0], load(links[0].position)
    _subspace_at_origin(links, free, elimination.S_origin)
    for g in range(group.shape[0]):
        for number in range(group[g].row, group[g].row + state[g].active):
            row = order[number]
            for n in range(count):
                J[rows, n] = 0.0
            for slot in range(TOUCHED):
                k = touched[row, slot]
                if k < 0:
                    continue
                away = sub(load(links[k].position), O)
                force = W[row, slot, 0], W[row, slot, 1], W[row, slot, 2]
                torque = add((W[row, slot, 3], W[row, slot, 4], W[row, slot, 5]), cross(away, force))
                for n in range(count):
                    if elimination.moves[k, n]:
                        J[rows, n] += dot(force, load_vector(elimination.S_origin, n, 0)) + dot(
                            torque, load_vector(elimination.S_origin, n, 3)
                        )
            rows += 1
    freedoms, least = gauss_jordan(J, rows, count + targets, elimination.solved, elimination.independent)
    return rows, freedoms, least


@inner
def solve_reduced(
    elimination: EliminationArrays, rows: int, freedoms: int, link: Array, free: Array, u: Array, velocity_terms: float
) -> None:
    """Compute u after `solve_rows`: accelerations, or displacements of least M-norm without velocity terms.

    Parameters
    ----------
    elimination, link, free, u, velocity_terms : see `arrays`
    rows, freedoms : int
        Numbers from `solve_rows`.
    """
    for e in range(freedoms):
        homogeneous_solution(elimination.J, rows, elimination.solved, elimination.independent[e], u)
        link_motions(link, free, u, 0.0, elimination.V[e])
    particular_solution(elimination.J, rows, elimination.solved, u)
    link_motions(link, free, u, velocity_terms, link)
    _reduced_equations(link, freedoms, elimination.V, elimination.G, velocity_terms)
    _cholesky(elimination.G, freedoms)
    _cholesky_solve(elimination.G, freedoms)
    add_homogeneous(elimination.J, rows, elimination.solved, elimination.independent, elimination.G, freedoms, u)


@inner
def solve_reduced_again(
    elimination: EliminationArrays, rows: int, freedoms: int, link: Array, free: Array, u: Array
) -> None:
    """Compute displacements of least M-norm for the second right side, after `solve_reduced` for the first.

    Parameters
    ----------
    elimination, link, free, u : see `arrays`
    rows, freedoms : int
        Numbers from `solve_rows`.
    """
    for row in range(rows):
        elimination.J[row, u.shape[0]] = elimination.J[row, u.shape[0] + 1]
    particular_solution(elimination.J, rows, elimination.solved, u)
    link_motions(link, free, u, 0.0, link)
    _reduced_forces(link, freedoms, elimination.V, elimination.G)
    _cholesky_solve(elimination.G, freedoms)
    add_homogeneous(elimination.J, rows, elimination.solved, elimination.independent, elimination.G, freedoms, u)
