"""Arrays of `few_freedoms`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.tree.records import MOTION

DIRECTIONS = 24
"""Largest number of free directions of a tree whose rows are eliminated by `few_freedoms`."""


class EliminationArrays(NamedTuple):
    """Arrays that the kernels of `few_freedoms` write; empty for a tree of more than `DIRECTIONS` free directions."""

    moves: Array  # (n_b + 1, N) 1 where a direction moves a link
    S_origin: Array  # (N, 6) motions s of the directions at the centre of mass of the first link
    J: Array  # (q, N + 2) rows in the free directions, and one or two right sides
    solved: Array  # (q,) direction that a row is solved for, -1 for a dependent row
    independent: Array  # (N,) the first f entries are the independent directions
    V: Array  # (N, n_b + 1) of MOTION: motions of the links for the columns of T; the ground is last
    G: Array  # (N, N + 1) reduced mass matrix and forces


def elimination_arrays(rows: int, layout: Array, directions: int) -> EliminationArrays:
    """Return new arrays for some number of rows and free directions."""
    if directions > DIRECTIONS:
        rows = directions = 0
        layout = layout[:0]
    moves = np.zeros((len(layout) + 1, directions), dtype=np.int64)
    for k, row in enumerate(layout):
        moves[k] = moves[row.parent]  # the ground is the last row, all zero
        moves[k, row.free : row.free_end] = 1
    return EliminationArrays(
        moves=moves,
        S_origin=np.zeros((directions, 6)),
        J=np.zeros((rows, directions + 2)),
        solved=np.zeros(rows, dtype=np.int64),
        independent=np.zeros(directions, dtype=np.int64),
        V=np.zeros((directions, len(layout) + 1), dtype=MOTION),
        G=np.zeros((directions, directions + 1)),
    )
