"""Taylor coefficients of the rows that close the loops of a planar mechanism: see `taylor_series`.

Two rows that hold two points together (a pin) may be written in constant axes: those of the state at which the series
begin. A row that keeps two links parallel (a lock) is linear in their angles. A row that keeps a point on a line of a
link is the product ``u . d`` of an axis of the link and the vector to the point; its force is ``u lam``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused
from consilience.reference.tree.planar import Pair, pair
from consilience.reference.tree.planar_detection import ROUNDING_LENGTH
from consilience.reference.tree.records import AXIS_DISPLACEMENT, AXIS_PRODUCT, ROW_SERIES
from consilience.reference.tree.taylor_series import add_moment

PIN, LOCK, LINE = np.arange(3)
"""Kinds of rows."""


class RowSeries(NamedTuple):
    """Coefficients of q rows by order, the last index."""

    kind: Array  # (q,)
    row_table: Array  # (q,) of `records.PLANAR_ROW`
    coef: Array  # (q,) of ROW_SERIES


def knows_rows(row_table: Array) -> bool:
    """Return whether all rows are of these kinds."""
    return bool(np.all(np.isin(row_table["kind"], (AXIS_PRODUCT, AXIS_DISPLACEMENT))))


def row_series(row_table: Array, length: float) -> RowSeries:
    """Return new arrays of the rows of a mechanism of some length, m."""
    kinds, ends = np.where(row_table["kind"] == AXIS_PRODUCT, LOCK, LINE), ["i", "j", "arm_i", "arm_j"]
    for n in range(len(row_table) - 1):
        one, two = row_table[n], row_table[n + 1]
        across = one.axis_i[0] * two.axis_i[1] - one.axis_i[1] * two.axis_i[0]
        together = one[ends] == two[ends] and max(abs(one.target), abs(two.target)) <= ROUNDING_LENGTH * length
        if together and one.kind == two.kind == AXIS_DISPLACEMENT and abs(across) > 0.5:
            kinds[n : n + 2] = PIN
    return RowSeries(kinds, row_table, np.zeros(len(row_table), ROW_SERIES))


@fused
def _arm(coef: Array, k: int, arm: Array, m: int) -> Pair:
    """Return the coefficient of order m of an arm or axis of a link."""
    a, c, s = pair(arm), coef[k].c[m], coef[k].s[m]
    return c * a[0] - s * a[1], s * a[0] + c * a[1]


@fused
def _between_arms(coef: Array, i: int, j: int, row_table: Array, n: int, m: int) -> tuple[float, float]:
    """Return the coefficient of order m of the arm on j less the arm on i."""
    s_i, s_j = _arm(coef, i, row_table[n].arm_i, m), _arm(coef, j, row_table[n].arm_j, m)
    return s_j[0] - s_i[0], s_j[1] - s_i[1]


@fused
def _put_line(row_coef: Array, n: int, m: int, u: tuple[float, float], d: tuple[float, float]) -> None:
    """Store the coefficients of axis and vector of a line."""
    row_coef[n].u_x[m], row_coef[n].u_y[m] = u
    row_coef[n].d_x[m], row_coef[n].d_y[m] = d


@fused
def begin_rows(kind: Array, row_table: Array, row_coef: Array, link: Array, coef: Array) -> None:
    """Set the coefficients that are known from a state, at placed links.

    Parameters
    ----------
    kind, row_table, row_coef : ndarray
        Fields kind, row_table and coef of `RowSeries`; row_coef is updated.
    link : see `arrays`
    coef : ndarray
        Field link of `taylor_series.Series`.
    """
    for n in range(kind.shape[0]):
        if kind[n] == LINE:
            i, j = row_table[n].i, row_table[n].j
            for m in range(2):
                r_i, r_j = (link[i].velocity, link[j].velocity) if m else (link[i].position, link[j].position)
                d = _between_arms(coef, i, j, row_table, n, m)
                d = d[0] + r_j[0] - r_i[0], d[1] + r_j[1] - r_i[1]
                _put_line(row_coef, n, m, _arm(coef, i, row_table[n].axis_i, m), d)


@fused
def _add_row_force(row_table: Array, n: int, coef: Array, m: int, x: float, y: float) -> None:
    """Add a force on link j, and its opposite on link i, to the series F and P."""
    i, j = row_table[n].i, row_table[n].j
    coef[j].F_x[m] -= x
    coef[j].F_y[m] -= y
    coef[i].F_x[m] += x
    coef[i].F_y[m] += y
    add_moment(coef, j, m, pair(row_table[n].arm_j), -x, -y)
    add_moment(coef, i, m, pair(row_table[n].arm_i), x, y)


@fused
def known_row_forces(
    kind: Array, row_table: Array, row_coef: Array, active: Array, coef: Array, m: int, torque: Array
) -> None:
    """Add the known parts of the row forces of order m, and the torques that F and P do not contain.

    Parameters
    ----------
    kind, row_table, row_coef, coef : see `begin_rows`
        row_coef and coef are updated.
    active : ndarray of int, shape (q,)
    m : int
    torque : ndarray, shape (n_b + 1,)
        Updated.
    """
    for n in range(kind.shape[0]):
        if kind[n] == LINE and active[n]:
            x = y = turn = 0.0
            for a in range(1, m + 1):
                x += row_coef[n].u_x[a] * row_coef[n].lam[m - a]
                y += row_coef[n].u_y[a] * row_coef[n].lam[m - a]
            row_coef[n].h_x[m], row_coef[n].h_y[m] = x, y
            for a in range(m + 1):
                turn += row_coef[n].d_x[a] * row_coef[n].h_y[m - a] - row_coef[n].d_y[a] * row_coef[n].h_x[m - a]
            _add_row_force(row_table, n, coef, m, x, y)
            torque[row_table[n].i] += turn


@fused
def known_row_accelerations(
    kind: Array, row_table: Array, row_coef: Array, active: Array, W: Array, coef: Array, m: int, gamma: Array
) -> None:
    """Compute the right sides ``gamma = Q a`` of order m.

    Parameters
    ----------
    kind, row_table, row_coef, coef : see `begin_rows`
    active, W : see `loop_groups.MultifrontalQR`
    m : int
    gamma : ndarray, shape (q,)
        Overwritten.
    """
    scale = (m + 1.0) * (m + 2.0)
    for n in range(kind.shape[0]):
        gamma[n] = 0.0
        if active[n] and kind[n] != LOCK:
            i, j = row_table[n].i, row_table[n].j
            d = _between_arms(coef, i, j, row_table, n, m + 2)
            total = W[n, 1, 0] * d[0] + W[n, 1, 1] * d[1]
            if kind[n] == LINE:
                _put_line(row_coef, n, m + 2, _arm(coef, i, row_table[n].axis_i, m + 2), d)
                for a in range(1, m + 3):
                    total += (
                        row_coef[n].u_x[a] * row_coef[n].d_x[m + 2 - a]
                        + row_coef[n].u_y[a] * row_coef[n].d_y[m + 2 - a]
                    )
            gamma[n] = -scale * total


@fused
def row_forces(rows: RowSeries, active: Array, W: Array, link: Array, coef: Array, m: int, lam: Array) -> None:
    """Add the forces of the multipliers of order m to F and P, and complete the series of lines.

    Parameters
    ----------
    rows : RowSeries
        Its coefficients are updated.
    active, W : see `loop_groups.MultifrontalQR`
    link : see `arrays`
    coef : ndarray
        Field link of `taylor_series.Series`; updated.
    m : int
    lam : ndarray, shape (q,)
        Multipliers of order m.
    """
    kind, row_table, row_coef = rows.kind, rows.row_table, rows.coef
    scale = 1.0 / ((m + 1.0) * (m + 2.0))
    for n in range(kind.shape[0]):
        if not active[n] or kind[n] == LOCK:
            continue
        i, j = row_table[n].i, row_table[n].j
        x, y = W[n, 1, 0] * lam[n], W[n, 1, 1] * lam[n]
        if kind[n] == LINE:
            row_coef[n].lam[m] = lam[n]
            row_coef[n].h_x[m] += x
            row_coef[n].h_y[m] += y
            a_i, a_j = pair(link[i].acceleration), pair(link[j].acceleration)
            d = _between_arms(coef, i, j, row_table, n, m + 2)
            d = d[0] + scale * (a_j[0] - a_i[0]), d[1] + scale * (a_j[1] - a_i[1])
            _put_line(row_coef, n, m + 2, _arm(coef, i, row_table[n].axis_i, m + 2), d)
        _add_row_force(row_table, n, coef, m, x, y)
