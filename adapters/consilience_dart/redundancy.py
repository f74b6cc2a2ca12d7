"""Constraint rows that depend on each other on the manifold only, as those of an overconstrained spatial loop.

A motion that drifts off the manifold by d makes such rows independent to d, and a solution that takes them so locks the
mechanism. Its rank on the manifold then says how many combinations of the rows are to be solved for.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array, State, displaced_states
from consilience_dart.dynamics import constraint_rank
from consilience_dart.state import from_state, send
from consilience_dart.translation import Model

OFF_THE_MANIFOLD = 1e-3  # rad and m: far above the tolerance of the rank, far below the size of a mechanism


def _rank_at(model: Model, state: State, off: float = 0.0) -> int:
    send(model, from_state(model, state))
    q = np.asarray(model.skeleton.getPositions())
    # no symmetry of a mechanism survives displacements in proportion to sines of whole numbers
    model.skeleton.setPositions(q + off * np.sin(np.arange(1.0, len(q) + 1.0)))
    return constraint_rank(model)


def rank_limit(model: Model, state: State) -> int | None:
    """Rank of the rows on the manifold if it is less than beside it, at a consistent state; None if it is the same.

    A state in a singular pose loses rank as well, but its neighbours on the manifold do not.
    """
    beside = _rank_at(model, state, OFF_THE_MANIFOLD)
    if _rank_at(model, state) == beside:
        return None
    neighbours = displaced_states(model.mechanism, state, OFF_THE_MANIFOLD, 1)
    on = max(_rank_at(model, neighbour) for neighbour in (state, *neighbours))
    return on if on < beside else None


def strongest(J: Array, gamma: Array, count: int) -> tuple[Array, Array]:
    """The combinations of rows with the largest singular values, as many as asked, orthonormal in the rows."""
    U = np.linalg.svd(J, full_matrices=False)[0][:, :count]
    return U.T @ J, U.T @ gamma
