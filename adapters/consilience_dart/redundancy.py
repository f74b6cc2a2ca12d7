"""Constraint rows that are dependent on the constraint manifold only, as those of an overconstrained spatial loop.

At a distance d from the manifold such rows are independent, with singular values of order d, and solving for all of
them locks the mechanism. The rank on the manifold tells how many combinations of rows to solve for.
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
    # sines of whole numbers: displacements that keep no symmetry of a mechanism
    model.skeleton.setPositions(q + off * np.sin(np.arange(1.0, len(q) + 1.0)))
    return constraint_rank(model)


def rank_limit(model: Model, state: State) -> int | None:
    """Return the rank of the rows on the manifold if it is less than the rank beside the manifold, else None.

    A singular pose has a lower rank too, but its neighbours on the manifold have not; they are examined as well.
    """
    beside = _rank_at(model, state, OFF_THE_MANIFOLD)
    if _rank_at(model, state) == beside:
        return None
    neighbours = displaced_states(model.mechanism, state, OFF_THE_MANIFOLD, 1)
    on = max(_rank_at(model, neighbour) for neighbour in (state, *neighbours))
    return on if on < beside else None


def strongest(J: Array, gamma: Array, count: int) -> tuple[Array, Array]:
    """Return the `count` combinations of rows with the largest singular values, orthonormal in the rows."""
    U = np.linalg.svd(J, full_matrices=False)[0][:, :count]
    return U.T @ J, U.T @ gamma
