"""Rank-revealing QR of the whitened responses of a tree to the rows that close its loops, front by front.

Front g holds the directions that group g is the first to move, and what the front before has left; its columns are
those of group g and of all groups up to its reach. Householder reflections [Golub and Van Loan, Matrix Computations,
section 5.2] triangularise the columns of the group, then, where more rows are left than columns, those behind them;
what is left goes into the next front. The multifrontal method [Davis, Direct Methods for Sparse Linear Systems, 2006,
section 5.4] on a chain of fronts: cost grows with the number of loops times the square of the size of a front.

It works on B itself, never on ``B^T B``, whose condition number is the square.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from consilience.kinematics import RANK_TOLERANCE
from consilience.reference.relative.columns import PIVOT, STEP, S, U
from consilience.reference.relative.kinematics import vector_at
from consilience.reference.relative.loops import (
    AT,
    BATCH,
    BATCH_END,
    HEIGHT,
    PATH,
    PATH_END,
    REACH,
    ROW,
    SHELF,
    TOUCHED,
    Fronts,
    Loops,
)
from consilience.reference.relative.model import FREE, FREE_END, PARENT
from consilience.spatial import Array


@njit(cache=True, error_model="numpy")
def respond(loops: Loops, layout: Array, fronts: Fronts, links: Array, free: Array) -> float:
    """Fill the fronts with the responses to the rows used; the largest squared norm of a column."""
    group, W, wrench, F, root, home = loops.group, fronts.W, fronts.wrench, fronts.F, fronts.root, loops.home
    start, used = fronts.start, fronts.used
    for g in range(group.shape[0]):
        start[g + 1] = start[g] + used[g]
    for g in range(group.shape[0]):
        at = group[g, AT]
        F[at : at + (start[group[g, REACH] + 1] - start[g]) * group[g, HEIGHT]] = 0.0
    for n in range(root.shape[0]):
        root[n] = 1.0 / np.sqrt(free[n, PIVOT])
    largest = 0.0
    for g in range(group.shape[0]):
        for column in range(used[g]):
            row = fronts.order[group[g, ROW] + column]
            path = loops.path[group[g, PATH] : group[g, PATH_END]]
            for k in path:
                wrench[k] = 0.0
            for at in range(TOUCHED):
                link = loops.touched[row, at]
                if link >= 0:
                    wrench[link] += W[row, at]
            total = _sweep(path, layout, group, home, start, start[g] + column, wrench, links, free, root, F)
            largest = max(largest, total)
    return largest


@njit(cache=True, error_model="numpy")
def _sweep(
    path: Array,
    layout: Array,
    group: Array,
    home: Array,
    start: Array,
    column: int,
    wrench: Array,
    links: Array,
    free: Array,
    root: Array,
    F: Array,
) -> float:
    """Whitened joint forces of wrenches on the links of a path, into a column of the fronts; their squared norm."""
    total = 0.0
    for k in path:
        own, p = wrench[k], layout[k, PARENT]
        for n in range(layout[k, FREE_END] - 1, layout[k, FREE] - 1, -1):
            rest = 0.0
            for r in range(6):
                rest += free[n, S + r] * own[r]
            factor = rest / free[n, PIVOT]
            for r in range(6):
                own[r] -= factor * free[n, U + r]
            rest *= root[n]
            total += rest * rest
            f = home[n, 0]
            F[group[f, AT] + (column - start[f]) * group[f, HEIGHT] + home[n, 1]] = rest
        if p >= 0:
            d = vector_at(links, k, STEP)
            wrench[p, 0] += own[0]
            wrench[p, 1] += own[1]
            wrench[p, 2] += own[2]
            wrench[p, 3] += own[3] + d[1] * own[2] - d[2] * own[1]
            wrench[p, 4] += own[4] + d[2] * own[0] - d[0] * own[2]
            wrench[p, 5] += own[5] + d[0] * own[1] - d[1] * own[0]
    return total


@njit(cache=True, error_model="numpy")
def _square(F: Array, first: int, last: int) -> float:
    """Sum of squares."""
    total = 0.0
    for n in range(first, last):
        total += F[n] * F[n]
    return total


@njit(cache=True, error_model="numpy")
def _reflect(F: Array, at: int, height: int, row: int, rows: int, column: int, columns: int, norm: float) -> float:
    """Zero a column of a front below a row, and update those behind it; the factor of the reflection."""
    head_at = at + column * height + row
    alpha = -norm if F[head_at] > 0 else norm
    head = F[head_at] - alpha
    tau = -head / alpha
    below = rows - row
    for n in range(1, below):
        F[head_at + n] /= head
    F[head_at] = alpha
    for c in range(column + 1, columns):
        here = at + c * height + row
        s = F[here]
        for n in range(1, below):
            s += F[head_at + n] * F[here + n]
        s *= tau
        F[here] -= s
        for n in range(1, below):
            F[here + n] -= s * F[head_at + n]
    return tau


@njit(cache=True, error_model="numpy")
def _bring_longest(F: Array, order: Array, at: int, height: int, row: int, rows: int, used: int, first: int) -> None:
    """Exchange column number `row` of a front with the longest of those behind it in its group."""
    best, longest = row, -1.0
    for c in range(row, used):
        total = _square(F, at + c * height + row, at + c * height + rows)
        if total > longest:
            best, longest = c, total
    if best != row:
        order[first + row], order[first + best] = order[first + best], order[first + row]
        for n in range(rows):
            one, two = at + row * height + n, at + best * height + n
            F[one], F[two] = F[two], F[one]


@njit(cache=True, error_model="numpy")
def factorise(loops: Loops, fronts: Fronts, smallest: float, choose: bool) -> float:
    """Factorise the fronts; the least pivot.

    Parameters
    ----------
    smallest : float
        Columns of which no more than this square is left count as dependent.
    choose : bool
        Bring the longest column of a group first, into ``fronts.order``. Otherwise they stay in that order, as in the
        stages of a step: off the manifold, rows that depend on others contradict them, and a choice made anew in each
        stage would make the accelerations jump from stage to stage.
    """
    group, F, tau, start, used = loops.group, fronts.F, fronts.tau, fronts.start, fronts.used
    least = np.inf
    fronts.carried[:] = 0
    for g in range(group.shape[0]):
        at, height, shelf = group[g, AT], group[g, HEIGHT], group[g, SHELF]
        rows = group[g, BATCH_END] - group[g, BATCH] + fronts.carried[g]
        own, columns = used[g], start[group[g, REACH] + 1] - start[g]
        rank = 0
        while rank < min(own, rows):
            if choose:
                _bring_longest(F, fronts.order, at, height, rank, rows, own, group[g, ROW])
            first = at + rank * height
            total = _square(F, first + rank, first + rows)
            if total <= smallest:  # and on with what is not a number, so that it shows
                break
            norm = np.sqrt(total)
            least = min(least, norm)
            tau[shelf + rank] = _reflect(F, at, height, rank, rows, rank, columns, norm)
            rank += 1
        fronts.rank[g] = rank
        _carry_on(loops, fronts, g, rank, rows, own, columns)
    return least


@njit(cache=True, error_model="numpy")
def _carry_on(loops: Loops, fronts: Fronts, g: int, rank: int, rows: int, own: int, columns: int) -> None:
    """Put what a front leaves into the next one, shortened where it has more rows than columns."""
    group, F = loops.group, fronts.F
    at, height, shelf = group[g, AT], group[g, HEIGHT], group[g, SHELF]
    behind, left = columns - own, rows - rank
    fronts.squeezed[g] = 0
    if behind == 0:
        return
    if left > behind:
        for c in range(behind):
            first = at + (own + c) * height
            norm = np.sqrt(_square(F, first + rank + c, first + rows))
            tau = 0.0
            if norm > 0.0:
                tau = _reflect(F, at, height, rank + c, rows, own + c, columns, norm)
            fronts.tau[shelf + rank + c] = tau
        fronts.squeezed[g] = left = behind
    fronts.carried[g + 1] = left
    to, tall = group[g + 1, AT], group[g + 1, HEIGHT]
    batch = group[g + 1, BATCH_END] - group[g + 1, BATCH]
    for c in range(behind):
        # below the diagonal of a shortened front there are only the vectors of its reflections
        full = min(left, c + 1) if fronts.squeezed[g] else left
        for n in range(left):
            F[to + c * tall + batch + n] = F[at + (own + c) * height + rank + n] if n < full else 0.0


@njit(cache=True, error_model="numpy")
def least_norm(loops: Loops, fronts: Fronts, target: Array, extra: Array) -> None:
    """Joint forces ``extra = sqrt(D) zeta`` with zeta of least norm in ``B^T zeta = target`` on the independent rows.

    ``R^T y = target`` from the first front to the last, then ``zeta = H [y; 0]`` back again.
    """
    group, y, x, start = loops.group, fronts.y, fronts.x, fronts.start
    _forward(group, fronts, target)
    extra[:] = 0.0
    for g in range(group.shape[0] - 1, -1, -1):
        shelf, batch = group[g, SHELF], group[g, BATCH_END] - group[g, BATCH]
        rows, rank = batch + fronts.carried[g], fronts.rank[g]
        x[shelf : shelf + rows] = 0.0
        for k in range(rank):
            x[shelf + k] = y[start[g] + k]
        if g + 1 < group.shape[0]:
            back = group[g + 1, SHELF] + group[g + 1, BATCH_END] - group[g + 1, BATCH]
            for n in range(fronts.carried[g + 1]):
                x[shelf + rank + n] = x[back + n]
        _reflect_back(group[g], fronts, g, rows)
        for n in range(batch):
            direction = loops.batch[group[g, BATCH] + n]
            extra[direction] = x[shelf + n] / fronts.root[direction]


@njit(cache=True, error_model="numpy")
def _forward(group: Array, fronts: Fronts, target: Array) -> None:
    """The solution y of ``R^T y = target``."""
    F, y, start = fronts.F, fronts.y, fronts.start
    for g in range(group.shape[0]):
        for column in range(fronts.used[g]):
            y[start[g] + column] = target[fronts.order[group[g, ROW] + column]]
    for g in range(group.shape[0]):
        at, height, columns = group[g, AT], group[g, HEIGHT], start[group[g, REACH] + 1] - start[g]
        for k in range(fronts.rank[g]):
            value = y[start[g] + k] / F[at + k * height + k]
            y[start[g] + k] = value
            for c in range(k + 1, columns):
                y[start[g] + c] -= F[at + c * height + k] * value


@njit(cache=True, error_model="numpy")
def _reflect_back(group: Array, fronts: Fronts, g: int, rows: int) -> None:
    """``x <- H x`` for one front."""
    F, x, shelf, rank = fronts.F, fronts.x, group[SHELF], fronts.rank[g]
    for k in range(rank + fronts.squeezed[g] - 1, -1, -1):
        column = k if k < rank else fronts.used[g] + k - rank
        at = group[AT] + column * group[HEIGHT]
        s = x[shelf + k]
        for n in range(k + 1, rows):
            s += F[at + n] * x[shelf + n]
        s *= fronts.tau[shelf + k]
        x[shelf + k] -= s
        for n in range(k + 1, rows):
            x[shelf + n] -= s * F[at + n]


@njit(cache=True, error_model="numpy")
def threshold(size: float, largest: float) -> float:
    """Square below which a column counts as dependent, from the size of rows that count and the largest column."""
    return max(RANK_TOLERANCE * RANK_TOLERANCE * largest, (RANK_TOLERANCE * size) ** 2)
