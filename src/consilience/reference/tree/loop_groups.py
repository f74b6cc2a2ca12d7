"""Groups of the rows that close loops, found once from the topology, and the arrays of their factorisation.

Rows that act on the same links form a group. In the whitened responses B of the tree (one row for each free direction,
one column for each constraint row), a group has entries only at the directions between its links and the ground.
Groups that share directions are numbered near each other (reverse Cuthill-McKee), and B is factorised group by group,
in fronts: see `multifrontal`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, all_rows
from consilience.reference.tree.records import FRONT, GROUP, MOTION

TOUCHED = 4
"""Largest number of links that a row acts on: those of the two joints of a coupling."""


class Loops(NamedTuple):
    """G groups of q rows in the order of elimination; N free directions."""

    group: Array  # (G,) of GROUP
    touched: Array  # (q, 4) links that a row acts on, -1 for none
    path: Array  # links between the links of a group and the ground, outermost first
    own_directions: Array  # directions at which a group is the first to have entries
    owner: Array  # (N, 2) that group of each direction, -1 for none, and the place among its own directions


class MultifrontalQR(NamedTuple):
    """Arrays of the factorisation by fronts, which kernels write."""

    W: Array  # (q, 4, 6 or 3) wrenches of a unit multiplier on the links that a row acts on
    wrench: Array  # (n_b, 6 or 3) wrenches on the links
    F: Array  # fronts one behind the other, each column by column
    tau: Array  # factors tau of the reflections
    x: Array  # a vector in the rows of the fronts
    y: Array  # (q,) a vector in the columns of the fronts
    order: Array  # (q,) rows, group by group, independent rows first
    state: Array  # (G + 1,) of FRONT
    active: Array  # (q,) 1 where a row is to be evaluated
    target: Array  # (q,) residual of the rows


def _touched(layout: Array, cut: Model) -> Array:
    """Return the links that each row acts on, shape (q, 4)."""
    link = np.full(len(cut.mass) + 1, -1)
    link[layout["body"]] = np.arange(len(layout))
    ends = [[int(link[i]), int(link[j])] for i, j in zip(cut.body_i, cut.body_j, strict=True)]
    joint_of = cut.coordinate["joint"]
    rolling = cut.rolling["body"]
    rows = [ends[k] for k in range(len(ends)) for _ in range(cut.first_row[k], cut.first_row[k + 1])]
    rows += [ends[joint_of[c]] for c in cut.drive["coordinate"]]
    rows += [ends[joint_of[one]] + ends[joint_of[two]] for one, two, _ in cut.coupling]
    rows += [[int(link[b])] for b in [*rolling, *np.repeat(rolling, 2), *cut.skate["body"]]]
    table = np.full((all_rows(cut), TOUCHED), -1)
    for row, links in enumerate(rows):
        table[row, : len(links)] = [n if n not in links[:at] else -1 for at, n in enumerate(links)]
    return table


def _path(layout: Array, links: Array) -> list[int]:
    """Return the links between some links and the ground, outermost first: a link stands behind its parent."""
    found = set[int]()
    for tip in links.tolist():
        link = tip
        while link >= 0 and link not in found:
            found.add(link)
            link = int(layout[link].parent)
    return sorted(found, reverse=True)


def find_loop_groups(layout: Array, free: int, cut: Model) -> Loops:
    """Return the groups of rows of a tree.

    Parameters
    ----------
    layout : ndarray of `records.LAYOUT`, shape (n_b,)
    free : int
        Number N of free directions.
    cut : Model
        The mechanism with only the rows that close loops.
    """
    touched = _touched(layout, cut)
    ends = [n for n in range(1, len(touched)) if set(touched[n]) != set(touched[n - 1])]
    ranges = list(zip([0, *ends], [*ends, len(touched)], strict=True)) if len(touched) else []
    paths = [_path(layout, touched[first]) for first, _ in ranges]
    directions = [[n for k in path for n in range(layout[k].free, layout[k].free_end)] for path in paths]
    order = _elimination_order(directions, free)
    group = np.zeros(len(ranges), GROUP)
    owner, last = np.full((free, 2), -1), np.zeros(free, dtype=np.int64)
    path, own_directions = list[int](), list[int]()
    for g, n in enumerate(order):
        new = [m for m in directions[n] if owner[m, 0] < 0]
        owner[new, 0], owner[new, 1], last[directions[n]] = g, np.arange(len(new)), g
        one = group[g]
        one.row, one.row_end = ranges[n]
        one.path, one.path_end = len(path), len(path) + len(paths[n])
        one.own, one.own_end = len(own_directions), len(own_directions) + len(new)
        path += paths[n]
        own_directions += new
    _front_sizes(group, own_directions, last)
    return Loops(group, touched, np.array(path, dtype=np.int64), np.array(own_directions, dtype=np.int64), owner)


def _elimination_order(directions: list[list[int]], free: int) -> list[int]:
    """Return an order of the groups in which groups that share directions are near each other."""
    if len(directions) < 3:
        return list(range(len(directions)))
    pointer = np.cumsum([0, *(len(d) for d in directions)])
    entries = np.concatenate([np.array(d, dtype=np.int64) for d in directions])
    at = scipy.sparse.csr_array((np.ones(len(entries)), entries, pointer), shape=(len(directions), free))
    order: list[int] = scipy.sparse.csgraph.reverse_cuthill_mckee(
        scipy.sparse.csr_array(at @ at.T), symmetric_mode=True
    ).tolist()
    return order


def _front_sizes(group: Array, own_directions: list[int], last: Array) -> None:
    """Fill in the fields last_reached to vector_start of the groups."""
    reach = height = at = shelf = 0
    for g, row in enumerate(group):
        kept = min(height, _columns(group, g, reach)) if reach >= g else 0
        reach = max([reach, g, *(int(last[n]) for n in own_directions[row.own : row.own_end])])
        height = kept + int(row.own_end - row.own)
        row.last_reached, row.front_rows, row.front_start, row.vector_start = reach, height, at, shelf
        at += height * _columns(group, g, reach)
        shelf += height


def _columns(group: Array, first: int, last: int) -> int:
    """Return the number of constraint rows of consecutive groups."""
    return int(np.sum(group["row_end"][first : last + 1] - group["row"][first : last + 1]))


def multifrontal_arrays(loops: Loops, bodies: int, width: int) -> MultifrontalQR:
    """Return new arrays for a factorisation; a wrench has `width` components."""
    G, q = len(loops.group), len(loops.touched)
    rows = int(np.sum(loops.group["front_rows"]))
    size = sum(int(one.front_rows) * _columns(loops.group, g, one.last_reached) for g, one in enumerate(loops.group))
    state = np.zeros(G + 1, FRONT)
    state["active"][:-1] = loops.group["row_end"] - loops.group["row"]
    return MultifrontalQR(
        W=np.zeros((q, TOUCHED, width)),
        wrench=np.zeros((bodies, width)),
        F=np.zeros(size),
        tau=np.zeros(rows),
        x=np.zeros(rows),
        y=np.zeros(q),
        order=np.arange(q),
        state=state,
        active=np.ones(q, dtype=np.int64),
        target=np.zeros(q),
    )


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
