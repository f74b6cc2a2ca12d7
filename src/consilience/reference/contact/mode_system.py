"""Contact problem with known modes: one linear system, and the forces that it leaves undetermined.

With the columns S and the rows E of the modes, ``f = constant + S x``:

    E G S x = -E (free + G constant).

Columns that depend on one another leave forces undetermined, not accelerations: ``G S y = 0`` wherever
``E G S y = 0``. Where that fails the modes are singular: sliding friction is on the verge of Painleve's paradox
(Genot and Brogliato 1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.algebra import HELD, NEARLY_HELD
from consilience.reference.contact.problem import ContactProblem, Modes

RANK = 1e-10
"""Singular values of the scaled system below this count as zero: dependent contacts, or contacts that joints hold.

Where joints all but hold every row, of the share of the largest one.
"""

_CONSISTENT = 1e-10
"""Largest residual of the equations, relative to the accelerations of the problem."""


@dataclass(frozen=True, eq=False)
class ModeSolution:
    """Forces and accelerations of given modes.

    Attributes
    ----------
    modes : Modes
    force, acceleration : ndarray, shape (m,)
        Of least norm where forces are undetermined.
    undetermined : ndarray, shape (m, k)
        Orthonormal changes of the force without effect on any acceleration.
    consistent : bool
        Whether the accelerations that the modes ask for are attained.
    singular : bool
        Whether the accelerations are not unique for these modes.
    """

    modes: Modes
    force: Array
    acceleration: Array
    undetermined: Array
    consistent: bool
    singular: bool


def active(problem: ContactProblem, modes: Modes, index: int) -> bool:
    """Return whether a friction set can carry a force in given modes."""
    one = problem.friction[index]
    return one.load is None or one.offset > 0.0 or bool(modes.closed[problem.normals.index(one.load)])


def columns_and_rows(problem: ContactProblem, modes: Modes) -> tuple[Array, Array, Array]:
    """Return what modes say of forces and accelerations.

    Returns
    -------
    constant : ndarray, shape (m,)
        Friction of constant bounds that slides.
    columns : ndarray, shape (m, r)
        S, of the closed normals, then of the held directions.
    rows : ndarray, shape (r, m)
        E, in the same order.
    """
    m = len(problem.free)
    constant, columns, rows = np.zeros(m), [], []
    for i, n in enumerate(problem.normals):
        if modes.closed[i]:
            column, row = np.zeros(m), np.zeros(m)
            column[n] = row[n] = 1.0
            for one, mode in zip(problem.friction, modes.friction, strict=True):
                if one.load == n:
                    column[list(one.rows)] += mode.drag
            columns.append(column)
            rows.append(row)
    for j, (one, mode) in enumerate(zip(problem.friction, modes.friction, strict=True)):
        if active(problem, modes, j):
            constant[list(one.rows)] += one.offset * mode.drag
            for direction in mode.held:
                row = np.zeros(m)
                row[list(one.rows)] = direction
                columns.append(row)
                rows.append(row)
    return constant, np.array(columns).reshape(-1, m).T, np.array(rows).reshape(-1, m)


def solve_with_modes(problem: ContactProblem, modes: Modes) -> ModeSolution:
    """Solve a contact problem in given modes; inequalities are not looked at."""
    constant, S, E = columns_and_rows(problem, modes)
    m, G, weight = len(problem.free), problem.delassus, problem.row_scale()
    if not len(E):
        return ModeSolution(modes, constant, problem.acceleration(constant), np.zeros((m, 0)), True, False)
    of_row = np.abs(E) @ weight
    wanted = -(E @ problem.acceleration(constant)) / of_row
    scaled = S / of_row
    system = (E @ G @ scaled) / of_row[:, None]
    U, singular, Vt = np.linalg.svd(system)
    rank = int(np.sum(singular > least_singular(singular[0])))
    inverse = Vt[:rank].T / singular[:rank] @ U[:, :rank].T
    x = inverse @ wanted
    x += inverse @ (wanted - system @ x)
    missed = float(np.max(np.abs(system @ x - wanted)))
    force = constant + scaled @ x
    free = scaled @ Vt[rank:].T
    effect = (G @ free) / weight[:, None]
    return ModeSolution(
        modes,
        force,
        problem.acceleration(force),
        np.linalg.qr(free)[0] if free.shape[1] else free,
        consistent=missed <= max(_CONSISTENT * float(np.max(np.abs(problem.free) / weight)), problem.rounding),
        singular=bool(np.max(np.abs(effect), initial=0.0) > np.sqrt(RANK)),
    )


def least_singular(largest: float) -> float:
    """Return the singular value below which one of a scaled system counts as zero, given its largest one."""
    return RANK * min(max(largest, HELD) / NEARLY_HELD, 1.0)


def sliding_indicator(delassus: Array, scale: Array, S: Array, E: Array) -> float:
    """Return the determinant of the system of given modes with sliding friction, relative to that without.

    One where nothing slides or friction does not load the normals; it falls to zero where sliding friction jams, and is
    negative beyond (for one contact, ``A/G_nn`` of ``g'' = A N + B``). Directions that joints or other contacts hold
    are left out.

    Parameters
    ----------
    delassus : ndarray, shape (m, m)
    scale : ndarray, shape (m,)
        Of each row, as `ContactProblem.row_scale`.
    S, E : ndarray, shape (m, r) and (r, m)
        As of `columns_and_rows`.
    """
    if not len(E):
        return 1.0
    weight = np.abs(E) @ scale
    values, U = np.linalg.eigh((E @ delassus @ E.T) / np.outer(weight, weight))
    kept = values > least_singular(values[-1])
    system = (E @ delassus @ S) / np.outer(weight, weight)
    return float(np.linalg.det((U[:, kept].T @ system @ U[:, kept]) / values[kept]))
