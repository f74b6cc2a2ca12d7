"""Singular poses: rows that depend on one another at a pose, and not at the poses nearby.

At a regular pose a small displacement in a free direction keeps the rank of the rows: it leaves the constraints by the
square of its size, and dependent rows stay dependent as far. At a singular pose (a change point, a dead centre, a
mechanism that locks) the rank grows with the displacement itself.

Displacements are (dr / L, phi) with the characteristic length L, and rows are divided by their norms: nothing depends
on units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from consilience.mechanism.constraints import RANK_TOLERANCE, constraint_jacobian, velocity_sizes
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.spatial import Array, quaternion_from_rotation_vector, quaternion_product

_DISPLACEMENT = 1e-5
"""Its square is far below `RANK_TOLERANCE`, times the curvature of rows."""

_DIRECTIONS = 3
"""Random free directions; a single one could be that of a branch on which the rank stays."""

_CONTINUES = 0.25
"""Least product of the cosines by which both singular vectors may turn between states; others cannot be followed."""


def move(state: State, increments: Array) -> State:
    """Displace every body by ``(dr, phi)``, m and rad in world axes; `increments` has shape (6 n_b,)."""
    steps = increments.reshape(-1, 6)
    quats = quaternion_product(quaternion_from_rotation_vector(steps[:, 3:]), state.quat_WB)
    unit = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    return State(state.p_WB + steps[:, :3], unit, state.v_WB_W, state.w_WB_W)


def free_displacements(mechanism: Mechanism, state: State, rows: Array) -> tuple[Array, int]:
    """Return the directions that rows allow, in unit displacements, shape (6 n_b, freedom), and the rank of the rows.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    rows : ndarray, shape (q, 6 n_b)
        Of `constraint_jacobian`.
    """
    scaled = rows * velocity_sizes(mechanism)
    _, singular, Vt = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=1, keepdims=True))
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0])) if len(singular) else 0
    return Vt[rank:].T, rank


def is_singular(
    mechanism: Mechanism, state: State, t: float = 0.0, rows: Callable[[State], Array] | None = None
) -> bool:
    """Tell whether rows depend on one another at a pose and not at the poses nearby.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent pose; its velocities do not matter.
    t : float, s
        Time at which drives are evaluated.
    rows : callable, optional
        Rows at a state, shape (q, 6 n_b); default: the holonomic rows of the mechanism, drives included.
    """

    def own(at: State) -> Array:
        return constraint_jacobian(mechanism, at, t=t)[: mechanism.holonomic_count]

    if not mechanism.holonomic_count:
        return False
    free, _ = free_displacements(mechanism, state, own(state))
    rows = rows or own
    here = rows(state)
    rank = free_displacements(mechanism, state, here)[1]
    if rank == len(here) or not free.shape[1]:
        return False
    trials = np.random.default_rng(0).normal(size=(_DIRECTIONS, free.shape[1]))
    steps = _DISPLACEMENT * trials / np.linalg.norm(trials, axis=1, keepdims=True) @ free.T
    near = [rows(move(state, step * velocity_sizes(mechanism))) for step in steps]
    return any(free_displacements(mechanism, state, there)[1] > rank for there in near)


def first_singular(mechanism: Mechanism, states: Sequence[State], times: Array) -> int | None:
    """Return the first of the states along a motion that is at or behind a singular pose; None if none is.

    The least singular value of the independent rows passes through zero there: its sign, as its two vectors continue
    from state to state, changes.

    Parameters
    ----------
    mechanism : Mechanism
    states : sequence of State
        So close that singular vectors turn by far less than a right angle.
    times : ndarray, shape (n_t,), s
    """
    found = [_least(mechanism, state, t) for state, t in zip(states, times.tolist(), strict=True)]
    rank, before = max((len(singular) for _, singular, _ in found), default=0), None
    if not rank:
        return None
    for n, (U, singular, V) in enumerate(found):
        if len(singular) < rank:
            return n
        now = U[:, rank - 1], V[rank - 1]
        if before is not None:
            turned = [float(one @ other) for one, other in zip(now, before, strict=True)]
            if turned[0] * turned[1] < -_CONTINUES:
                return n
        before = now
    return None


def _least(mechanism: Mechanism, state: State, t: float) -> tuple[Array, Array, Array]:
    """Return the singular value decomposition of the scaled holonomic rows, without the values that count as zero."""
    rows = constraint_jacobian(mechanism, state, t=t)[: mechanism.holonomic_count] * velocity_sizes(mechanism)
    U, singular, Vt = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True), full_matrices=False)
    return U, singular[singular > RANK_TOLERANCE * singular[:1]], Vt
