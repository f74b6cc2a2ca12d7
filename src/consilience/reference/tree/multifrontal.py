"""Rank-revealing QR of the whitened responses of a tree to the rows that close its loops, front by front.

The response to row n is the column ``B_n = D^(-1/2) S^T q`` of whitened joint forces, q being the wrenches of a unit
multiplier carried to the ground. Front g holds the directions that group g is the first to move and the rows passed on
by the front before; its columns are those of group g and of all groups up to last_reached. Householder reflections
[Golub and Van Loan, Matrix Computations, section 5.2] triangularise the columns of the group, then, where more rows
than columns remain, the columns behind; the remainder passes to the next front. This is the multifrontal method [Davis,
Direct Methods for Sparse Linear Systems, 2006, section 5.4] on a chain of fronts: the cost grows with the number of
loops times the square of the size of a front.

B itself is factorised, never ``B^T B``, whose condition number is the square.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import RANK_TOLERANCE, Array
from consilience.reference.kernel.compiled import fused, inner
from consilience.reference.kernel.vectors import add, cross, dot, load, scale
from consilience.reference.tree.arrays import LoopClosure
from consilience.reference.tree.kinematics import load_vector, store_vector
from consilience.reference.tree.loop_groups import TOUCHED

PIVOTING, KEEP_ORDER = np.array([True, False])
"""Whether `factorise` exchanges columns."""


@fused
def clear_fronts(group: Array, state: Array, F: Array) -> None:
    """Number the columns in use, and set their entries to zero."""
    for g in range(group.shape[0]):
        state[g + 1].start = state[g].start + state[g].used
    for g in range(group.shape[0]):
        at = group[g].front_start
        for n in range(at, at + (state[group[g].last_reached + 1].start - state[g].start) * group[g].front_rows):
            F[n] = 0.0


@fused
def _store_row(touched: Array, row: int, W: Array, path: Array, first: int, last: int, wrench: Array) -> None:
    """Set the wrenches on the links of a path to those of a row."""
    for m in range(first, last):
        for r in range(6):
            wrench[path[m], r] = 0.0
    for at in range(TOUCHED):
        link = touched[row, at]
        if link >= 0:
            for r in range(6):
                wrench[link, r] += W[row, at, r]


@inner
def whitened_responses(closure: LoopClosure) -> float:
    """Fill the fronts with the responses of the tree to the rows in use; return the largest squared norm of a column.

    Articulated inertias are swept.
    """
    loops, qr, free = closure.loops, closure.qr, closure.free
    group, state, order = loops.group, qr.state, qr.order
    clear_fronts(group, state, qr.F)
    for n in range(free.shape[0]):
        free[n].inverse_root = 1.0 / np.sqrt(free[n].pivot)
    largest = 0.0
    for g in range(group.shape[0]):
        first, last = group[g].path, group[g].path_end
        for column in range(state[g].used):
            row = order[group[g].row + column]
            _store_row(loops.touched, row, qr.W, loops.path, first, last, qr.wrench)
            largest = max(largest, _whitened_column(closure, first, last, state[g].start + column))
    return largest


@fused
def _whitened_column(closure: LoopClosure, first: int, last: int, column: int) -> float:
    """Fill a column of the fronts with the whitened joint forces of wrenches on a path; return the squared norm."""
    loops, qr, link, free = closure.loops, closure.qr, closure.link, closure.free
    path, group, owner, state, wrench, F = loops.path, loops.group, loops.owner, qr.state, qr.wrench, qr.F
    total = 0.0
    for m in range(first, last):
        k = path[m]
        p, force, torque = link[k].parent, load_vector(wrench, k, 0), load_vector(wrench, k, 3)
        for n in range(link[k].last - 1, link[k].first - 1, -1):
            root, f = free[n].inverse_root, owner[n, 0]
            white = root * (dot(load(free[n].s[0]), force) + dot(load(free[n].s[1]), torque))
            factor = -white * root
            force = add(force, scale(factor, load(free[n].U[0])))
            torque = add(torque, scale(factor, load(free[n].U[1])))
            total += white * white
            F[group[f].front_start + (column - state[f].start) * group[f].front_rows + owner[n, 1]] = white
        if p >= 0:
            store_vector(wrench, p, 0, add(load_vector(wrench, p, 0), force))
            moved = add(torque, cross(load(link[k].offset), force))
            store_vector(wrench, p, 3, add(load_vector(wrench, p, 3), moved))
    return total


@fused
def _square(F: Array, first: int, last: int) -> float:
    """Return the sum of squares of consecutive entries."""
    total = 0.0
    for n in range(first, last):
        total += F[n] * F[n]
    return total


@fused
def _reflect(F: Array, at: int, height: int, row: int, rows: int, column: int, columns: int, norm: float) -> float:
    """Zero a column of a front below a row, update the columns behind, and return the factor tau of the reflection."""
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


@fused
def _exchange(F: Array, one: int, two: int, count: int) -> None:
    """Exchange the first entries of two columns."""
    for n in range(count):
        F[one + n], F[two + n] = F[two + n], F[one + n]


@inner
def _pivot_longest(group: Array, order: Array, state: Array, F: Array, g: int, row: int, rows: int) -> None:
    """Exchange column number `row` of a front with the longest column behind it in its group."""
    at, height, used = group[g].front_start, group[g].front_rows, state[g].used
    best, longest = row, -1.0
    for c in range(row, used):
        total = _square(F, at + c * height + row, at + c * height + rows)
        if total > longest:
            best, longest = c, total
    if best == row:
        return
    first = group[g].row
    order[first + row], order[first + best] = order[first + best], order[first + row]
    _exchange(F, at + row * height, at + best * height, rows)
    # fronts before also hold rows of R in these columns; the vectors of reflections below them stay
    f = g - 1
    while f >= 0 and group[f].last_reached >= g:
        start = group[f].front_start + (state[g].start - state[f].start) * group[f].front_rows
        _exchange(F, start + row * group[f].front_rows, start + best * group[f].front_rows, state[f].rank)
        f -= 1


@inner
def factorise(group: Array, order: Array, state: Array, F: Array, tau: Array, smallest: float, pivoting: bool) -> float:
    """Factorise the fronts; return the least pivot.

    Parameters
    ----------
    group, order, state, F, tau : see `loop_groups.Loops`, `loop_groups.MultifrontalQR`
    smallest : float
        A column whose remaining squared norm is at most this counts as dependent.
    pivoting : bool
        Bring the longest column of a group first, and record the order. Without it the order stays, as in the stages of
        a step: off the manifold dependent rows contradict the others, and a new selection in each stage would make the
        accelerations jump from stage to stage.
    """
    least = np.inf
    for g in range(state.shape[0]):
        state[g].carried = 0
    for g in range(group.shape[0]):
        at, height, shelf = group[g].front_start, group[g].front_rows, group[g].vector_start
        rows = group[g].own_end - group[g].own + state[g].carried
        own, columns = state[g].used, state[group[g].last_reached + 1].start - state[g].start
        rank = 0
        while rank < min(own, rows):
            if pivoting:
                _pivot_longest(group, order, state, F, g, rank, rows)
            first = at + rank * height
            total = _square(F, first + rank, first + rows)
            if total <= smallest:  # false for NaN, which then shows in the result
                break
            norm = np.sqrt(total)
            least = min(least, norm)
            tau[shelf + rank] = _reflect(F, at, height, rank, rows, rank, columns, norm)
            rank += 1
        state[g].rank = rank
        _pass_remainder(group, state, F, tau, g, rows, columns)
    return least


@fused
def _pass_remainder(group: Array, state: Array, F: Array, tau: Array, g: int, rows: int, columns: int) -> None:
    """Copy the remainder of a front into the next one, reduced where it has more rows than columns."""
    rank, own = state[g].rank, state[g].used
    at, height, shelf = group[g].front_start, group[g].front_rows, group[g].vector_start
    behind, left = columns - own, rows - rank
    state[g].compressed = 0
    if behind == 0:
        return
    if left > behind:
        for c in range(behind):
            first = at + (own + c) * height
            norm = np.sqrt(_square(F, first + rank + c, first + rows))
            tau[shelf + rank + c] = 0.0
            if norm > 0.0:
                tau[shelf + rank + c] = _reflect(F, at, height, rank + c, rows, own + c, columns, norm)
        state[g].compressed = left = behind
    state[g + 1].carried = left
    to, tall = group[g + 1].front_start, group[g + 1].front_rows
    own_directions = group[g + 1].own_end - group[g + 1].own
    for c in range(behind):
        # below the diagonal a reduced front holds only the vectors of its reflections
        full = min(left, c + 1) if state[g].compressed else left
        for n in range(left):
            F[to + c * tall + own_directions + n] = F[at + (own + c) * height + rank + n] if n < full else 0.0


@inner
def least_norm_forces(closure: LoopClosure) -> None:
    """Add ``sqrt(D) zeta`` to the joint forces, zeta of least norm in ``B^T zeta = target`` on independent rows.

    ``R^T y = target`` from the first front to the last, then ``zeta = H [y; 0]`` backwards.
    """
    qr, free, group, own_directions = closure.qr, closure.free, closure.loops.group, closure.loops.own_directions
    state, x, y = qr.state, qr.x, qr.y
    _forward(group, qr.order, state, qr.F, qr.target, y)
    for g in range(group.shape[0] - 1, -1, -1):
        shelf, count = group[g].vector_start, group[g].own_end - group[g].own
        rows, rank = count + state[g].carried, state[g].rank
        for k in range(rows):
            x[shelf + k] = y[state[g].start + k] if k < rank else 0.0
        if g + 1 < group.shape[0]:
            back = group[g + 1].vector_start + group[g + 1].own_end - group[g + 1].own
            for n in range(state[g + 1].carried):
                x[shelf + rank + n] = x[back + n]
        _reflect_back(group, state, qr.F, qr.tau, x, g, rows)
        for n in range(count):
            direction = own_directions[group[g].own + n]
            free[direction].joint_force += x[shelf + n] / free[direction].inverse_root


@fused
def _forward(group: Array, order: Array, state: Array, F: Array, target: Array, y: Array) -> None:
    """Solve ``R^T y = target``."""
    for g in range(group.shape[0]):
        for column in range(state[g].used):
            y[state[g].start + column] = target[order[group[g].row + column]]
    for g in range(group.shape[0]):
        at, height, start = group[g].front_start, group[g].front_rows, state[g].start
        for k in range(state[g].rank):
            value = y[start + k] / F[at + k * height + k]
            y[start + k] = value
            for c in range(k + 1, state[group[g].last_reached + 1].start - start):
                y[start + c] -= F[at + c * height + k] * value


@inner
def multipliers(group: Array, order: Array, state: Array, F: Array, y: Array, lam: Array) -> None:
    """Solve ``R lam = y`` for the multipliers, with y from `least_norm_forces`; dependent rows get zero.

    Parameters
    ----------
    group, order, state, F, y : see `loop_groups.Loops`, `loop_groups.MultifrontalQR`
        y is overwritten.
    lam : ndarray, shape (q,)
        Overwritten: multipliers, N or N m.
    """
    for n in range(lam.shape[0]):
        lam[n] = 0.0
    for g in range(group.shape[0] - 1, -1, -1):
        at, height, start = group[g].front_start, group[g].front_rows, state[g].start
        for k in range(state[g].used - 1, -1, -1):
            value = y[start + k] if k < state[g].rank else 0.0
            for c in range(k + 1, state[group[g].last_reached + 1].start - start if k < state[g].rank else 0):
                value -= F[at + c * height + k] * y[start + c]
            y[start + k] = value / F[at + k * height + k] if k < state[g].rank else 0.0
            lam[order[group[g].row + k]] = y[start + k]


@fused
def _reflect_back(group: Array, state: Array, F: Array, tau: Array, x: Array, g: int, rows: int) -> None:
    """Compute ``x <- H x`` for one front."""
    shelf, rank, used = group[g].vector_start, state[g].rank, state[g].used
    for k in range(rank + state[g].compressed - 1, -1, -1):
        column = k if k < rank else used + k - rank
        at = group[g].front_start + column * group[g].front_rows
        s = x[shelf + k]
        for n in range(k + 1, rows):
            s += F[at + n] * x[shelf + n]
        s *= tau[shelf + k]
        x[shelf + k] -= s
        for n in range(k + 1, rows):
            x[shelf + n] -= s * F[at + n]


@inner
def rank_threshold(size: float, largest: float) -> float:
    """Return the squared norm below which a column is dependent, from the size of rows and the largest column."""
    return max(RANK_TOLERANCE * RANK_TOLERANCE * largest, (RANK_TOLERANCE * size) ** 2)
