"""Selections of independent constraint rows that a formulation keeps within a step, as its chart.

Off the manifold, in the stages of a step, dependent rows contradict the others. Rows that were selected anew in each
stage would make accelerations jump from stage to stage, and motions would no longer follow their tolerance. Rows are
selected where the constraints hold, and kept as long as they stay independent: integrators start anew with a new chart.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array

RowSelection = tuple[int, ...]
"""Indices of independent rows, as many as the rank; none: to be selected at each evaluation."""

_KEPT = 0.1
"""Least singular value of the kept rows over that of newly selected ones, below which the new ones take their place."""


def selection(Q: Array, found: Array, known: RowSelection = ()) -> RowSelection:
    """Return the selection to go on with: the known one while it has the rank and is not badly conditioned.

    Parameters
    ----------
    Q : ndarray, shape (q, 6 n_b)
        All rows, at a consistent state.
    found : ndarray of int, shape (rank,)
        Independent rows found there.
    known : tuple of int
        Selection kept so far.
    """
    new: RowSelection = tuple(found.tolist())
    if len(known) != len(new) or not new:
        return new
    least = [np.linalg.svd(Q[list(rows)], compute_uv=False)[-1] for rows in (known, new)]
    return known if least[0] >= _KEPT * least[1] else new
