"""Taylor coefficients of the rows that close the loops of a mechanism in a plane: see `series`.

Two rows that hold two points together hold them whatever axes they are written in: those of the state that the series
begin at, which do not turn. A row that keeps two links parallel is linear in their angles. One that leads a point along
a line of a link is the product ``u . d`` of an axis of that link and of the way to the point, and its force ``u lam``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused
from consilience.reference.tree import plane as col
from consilience.reference.tree.planar import load_pair
from consilience.reference.tree.planar_detection import ROUNDING_LENGTH
from consilience.reference.tree.taylor_series import FX, FY, LARGEST_ORDER, SN, C, add_moment

PIN, LOCK, LINE = np.arange(3)
"""Kinds of rows."""

LAM, UX, UY, DX, DY, HX, HY, ROW_SLOTS = np.arange(8)
"""Series of a row: its multiplier; of a line also the axis, the way, and the force."""


class RowSeries(NamedTuple):
    """Coefficients of q rows by order, the last index."""

    kind: Array  # (q,)
    row_table: Array  # (q, FORM_WIDTH) of `plane.Plane`
    coef: Array  # (q, ROW_SLOTS, MOST + 3)


def knows_rows(row_table: Array) -> bool:
    """Whether rows, shape (q, FORM_WIDTH), are of these kinds alone."""
    return bool(np.all(np.isin(row_table[:, col.KIND], (col.AXIS_PRODUCT, col.AXIS_DISPLACEMENT))))


def row_series(row_table: Array, length: float) -> RowSeries:
    """Arrays of the rows of a mechanism of some length, m."""
    kinds = np.where(row_table[:, col.KIND] == col.AXIS_PRODUCT, LOCK, LINE)
    ends = [col.LINK_I, col.LINK_J, *range(col.ARM_I, col.AXIS_I)]
    for n in range(len(row_table) - 1):
        one, two = row_table[n], row_table[n + 1]
        across = one[col.AXIS_I] * two[col.AXIS_I + 1] - one[col.AXIS_I + 1] * two[col.AXIS_I]
        together = (
            np.array_equal(one[ends], two[ends])
            and max(abs(one[col.TARGET]), abs(two[col.TARGET])) <= ROUNDING_LENGTH * length
        )
        if together and one[col.KIND] == two[col.KIND] == col.AXIS_DISPLACEMENT and abs(across) > 0.5:
            kinds[n : n + 2] = PIN
    return RowSeries(kinds, row_table, np.zeros((len(row_table), int(ROW_SLOTS), LARGEST_ORDER + 3)))


@fused
def _arm(coef: Array, k: int, row_table: Array, n: int, at: int, m: int) -> tuple[float, float]:
    """Coefficient of an arm or axis of a link."""
    a, c, s = load_pair(row_table, n, at), coef[k, C, m], coef[k, SN, m]
    return c * a[0] - s * a[1], s * a[0] + c * a[1]


@fused
def _between_arms(coef: Array, i: int, j: int, row_table: Array, n: int, m: int) -> tuple[float, float]:
    """Coefficient of the arm on j less that on i."""
    s_i, s_j = _arm(coef, i, row_table, n, col.ARM_I, m), _arm(coef, j, row_table, n, col.ARM_J, m)
    return s_j[0] - s_i[0], s_j[1] - s_i[1]


@fused
def _put_line(row_coef: Array, n: int, m: int, u: tuple[float, float], d: tuple[float, float]) -> None:
    """Coefficients of the axis and of the way of a line."""
    row_coef[n, UX, m], row_coef[n, UY, m] = u
    row_coef[n, DX, m], row_coef[n, DY, m] = d


@fused
def begin_rows(kind: Array, row_table: Array, row_coef: Array, link: Array, coef: Array) -> None:
    """Coefficients that a state says, of links placed there."""
    for n in range(kind.shape[0]):
        if kind[n] == LINE:
            i, j = int(row_table[n, col.LINK_I]), int(row_table[n, col.LINK_J])
            for m in range(2):
                at = col.POSITION + 2 * m  # then the velocity
                r_i, r_j, d = load_pair(link, i, at), load_pair(link, j, at), _between_arms(coef, i, j, row_table, n, m)
                d = d[0] + r_j[0] - r_i[0], d[1] + r_j[1] - r_i[1]
                _put_line(row_coef, n, m, _arm(coef, i, row_table, n, col.AXIS_I, m), d)


@fused
def _add_row_force(row_table: Array, n: int, coef: Array, m: int, x: float, y: float) -> None:
    """Add a force on j, and its opposite on i, to what the joints have to bring there, and to P."""
    i, j = int(row_table[n, col.LINK_I]), int(row_table[n, col.LINK_J])
    coef[j, FX, m] -= x
    coef[j, FY, m] -= y
    coef[i, FX, m] += x
    coef[i, FY, m] += y
    add_moment(coef, j, m, load_pair(row_table, n, col.ARM_J), -x, -y)
    add_moment(coef, i, m, load_pair(row_table, n, col.ARM_I), x, y)


@fused
def known_row_forces(
    kind: Array, row_table: Array, row_coef: Array, active: Array, coef: Array, m: int, torque: Array
) -> None:
    """What is known of the forces of rows of order m, and torques on links that neither they nor P say."""
    for n in range(kind.shape[0]):
        if kind[n] == LINE and active[n]:
            x = y = turn = 0.0
            for a in range(1, m + 1):
                x += row_coef[n, UX, a] * row_coef[n, LAM, m - a]
                y += row_coef[n, UY, a] * row_coef[n, LAM, m - a]
            row_coef[n, HX, m], row_coef[n, HY, m] = x, y
            for a in range(m + 1):
                turn += row_coef[n, DX, a] * row_coef[n, HY, m - a] - row_coef[n, DY, a] * row_coef[n, HX, m - a]
            _add_row_force(row_table, n, coef, m, x, y)
            torque[int(row_table[n, col.LINK_I])] += turn


@fused
def known_row_accelerations(
    kind: Array, row_table: Array, row_coef: Array, active: Array, W: Array, coef: Array, m: int, gamma: Array
) -> None:
    """Accelerations ``Q a`` of order m that keep the rows closed."""
    scale = (m + 1.0) * (m + 2.0)
    for n in range(kind.shape[0]):
        gamma[n] = 0.0
        if active[n] and kind[n] != LOCK:
            i, j = int(row_table[n, col.LINK_I]), int(row_table[n, col.LINK_J])
            d = _between_arms(coef, i, j, row_table, n, m + 2)
            total = W[n, 1, 0] * d[0] + W[n, 1, 1] * d[1]
            if kind[n] == LINE:
                _put_line(row_coef, n, m + 2, _arm(coef, i, row_table, n, col.AXIS_I, m + 2), d)
                for a in range(1, m + 3):
                    total += (
                        row_coef[n, UX, a] * row_coef[n, DX, m + 2 - a]
                        + row_coef[n, UY, a] * row_coef[n, DY, m + 2 - a]
                    )
            gamma[n] = -scale * total


@fused
def row_forces(
    kind: Array,
    row_table: Array,
    row_coef: Array,
    active: Array,
    W: Array,
    link: Array,
    coef: Array,
    m: int,
    lam: Array,
) -> None:
    """Forces of order m that multipliers bring to the links, into F and P; what then is known of lines."""
    scale = 1.0 / ((m + 1.0) * (m + 2.0))
    for n in range(kind.shape[0]):
        if not active[n] or kind[n] == LOCK:
            continue
        i, j = int(row_table[n, col.LINK_I]), int(row_table[n, col.LINK_J])
        x, y = W[n, 1, 0] * lam[n], W[n, 1, 1] * lam[n]
        if kind[n] == LINE:
            row_coef[n, LAM, m] = lam[n]
            row_coef[n, HX, m] += x
            row_coef[n, HY, m] += y
            a_i, a_j = load_pair(link, i, col.ACCELERATION), load_pair(link, j, col.ACCELERATION)
            d = _between_arms(coef, i, j, row_table, n, m + 2)
            d = d[0] + scale * (a_j[0] - a_i[0]), d[1] + scale * (a_j[1] - a_i[1])
            _put_line(row_coef, n, m + 2, _arm(coef, i, row_table, n, col.AXIS_I, m + 2), d)
        _add_row_force(row_table, n, coef, m, x, y)
