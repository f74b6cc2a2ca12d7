"""Arrays of `few_freedoms`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array

DIRECTIONS = 24
"""Largest number of free directions of a tree whose rows are eliminated by `few_freedoms`."""


class EliminationArrays(NamedTuple):
    """Arrays that the kernels of `few_freedoms` write; empty for a tree of more than `DIRECTIONS` free directions."""

    moves: Array  # (n_b, N) whether a direction moves a link
    S_origin: Array  # (N, 6) S of the directions at a point that is the same for all
    J: Array  # (q, N + 2) rows, and t of one problem or two
    solved: Array  # (q,) direction that a row gives, -1 where it depends on others
    independent: Array  # (N,) directions left, the first f
    V: Array  # (N, n_b + 1, 6) motions of the links; the last row is the ground
    G: Array  # (N, N + 1) reduced masses and forces


def elimination_arrays(rows: int, layout: Array, directions: int) -> EliminationArrays:
    """Return new arrays for some number of rows and free directions."""
    if directions > DIRECTIONS:
        rows = directions = 0
        layout = layout[:0]
    moves = np.zeros((len(layout) + 1, directions), dtype=np.int64)
    for k, row in enumerate(layout):
        moves[k] = moves[row[0]]  # of the ground: the last one, which nothing moves
        moves[k, row[7] : row[8]] = 1
    return EliminationArrays(
        moves=moves,
        S_origin=np.zeros((directions, 6)),
        J=np.zeros((rows, directions + 2)),
        solved=np.zeros(rows, dtype=np.int64),
        independent=np.zeros(directions, dtype=np.int64),
        V=np.zeros((directions, len(layout) + 1, 6)),
        G=np.zeros((directions, directions + 1)),
    )
