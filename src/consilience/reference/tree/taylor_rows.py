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
from consilience.reference.tree.planar import pair_at
from consilience.reference.tree.planar_detection import LEVEL
from consilience.reference.tree.plane import (
    ACCELERATION,
    ARM_I,
    ARM_J,
    AXIS_I,
    KIND,
    ON_I,
    ON_J,
    POINT,
    POSITION,
    TARGET,
)
from consilience.reference.tree.plane import SQUARE as PARALLEL
from consilience.reference.tree.taylor_series import FX, FY, MOST, SN, C, press

PIN, LOCK, LINE = np.arange(3)
"""Kinds of rows."""

LAM, UX, UY, DX, DY, HX, HY, ROW_SLOTS = np.arange(8)
"""Series of a row: its multiplier; of a line also the axis, the way, and the force."""


class RowSeries(NamedTuple):
    """Coefficients of q rows by order, the last index."""

    kind: Array  # (q,)
    form: Array  # (q, FORM_WIDTH) of `plane.Plane`
    of: Array  # (q, ROW_SLOTS, MOST + 3)


def knows_rows(form: Array) -> bool:
    """Whether rows, shape (q, FORM_WIDTH), are of these kinds alone."""
    return bool(np.all((form[:, KIND] == PARALLEL) | (form[:, KIND] == POINT)))


def row_series(form: Array, length: float) -> RowSeries:
    """Arrays of the rows of a mechanism of some length, m."""
    kinds = np.where(form[:, KIND] == PARALLEL, LOCK, LINE)
    ends = [ON_I, ON_J, *range(ARM_I, AXIS_I)]
    for n in range(len(form) - 1):
        one, two = form[n], form[n + 1]
        across = one[AXIS_I] * two[AXIS_I + 1] - one[AXIS_I + 1] * two[AXIS_I]
        together = np.array_equal(one[ends], two[ends]) and max(abs(one[TARGET]), abs(two[TARGET])) <= LEVEL * length
        if together and one[KIND] == two[KIND] == POINT and abs(across) > 0.5:
            kinds[n : n + 2] = PIN
    return RowSeries(kinds, form, np.zeros((len(form), int(ROW_SLOTS), MOST + 3)))


@fused
def _arm(of: Array, k: int, form: Array, n: int, at: int, m: int) -> tuple[float, float]:
    """Coefficient of an arm or axis of a link."""
    a, c, s = pair_at(form, n, at), of[k, C, m], of[k, SN, m]
    return c * a[0] - s * a[1], s * a[0] + c * a[1]


@fused
def _between_arms(of: Array, i: int, j: int, form: Array, n: int, m: int) -> tuple[float, float]:
    """Coefficient of the arm on j less that on i."""
    s_i, s_j = _arm(of, i, form, n, ARM_I, m), _arm(of, j, form, n, ARM_J, m)
    return s_j[0] - s_i[0], s_j[1] - s_i[1]


@fused
def _put_line(rows: Array, n: int, m: int, u: tuple[float, float], d: tuple[float, float]) -> None:
    """Coefficients of the axis and of the way of a line."""
    rows[n, UX, m], rows[n, UY, m] = u
    rows[n, DX, m], rows[n, DY, m] = d


@fused
def begin_rows(kind: Array, form: Array, rows: Array, link: Array, of: Array) -> None:
    """Coefficients that a state says, of links placed there."""
    for n in range(kind.shape[0]):
        if kind[n] == LINE:
            i, j = int(form[n, ON_I]), int(form[n, ON_J])
            for m in range(2):
                at = POSITION + 2 * m  # then the velocity
                r_i, r_j, d = pair_at(link, i, at), pair_at(link, j, at), _between_arms(of, i, j, form, n, m)
                d = d[0] + r_j[0] - r_i[0], d[1] + r_j[1] - r_i[1]
                _put_line(rows, n, m, _arm(of, i, form, n, AXIS_I, m), d)


@fused
def _pull(form: Array, n: int, of: Array, m: int, x: float, y: float) -> None:
    """Add a force on j, and its opposite on i, to what the joints have to bring there, and to P."""
    i, j = int(form[n, ON_I]), int(form[n, ON_J])
    of[j, FX, m] -= x
    of[j, FY, m] -= y
    of[i, FX, m] += x
    of[i, FY, m] += y
    press(of, j, m, pair_at(form, n, ARM_J), -x, -y)
    press(of, i, m, pair_at(form, n, ARM_I), x, y)


@fused
def known_row_forces(kind: Array, form: Array, rows: Array, wanted: Array, of: Array, m: int, torque: Array) -> None:
    """What is known of the forces of rows of order m, and torques on links that neither they nor P say."""
    for n in range(kind.shape[0]):
        if kind[n] == LINE and wanted[n]:
            x = y = turn = 0.0
            for a in range(1, m + 1):
                x += rows[n, UX, a] * rows[n, LAM, m - a]
                y += rows[n, UY, a] * rows[n, LAM, m - a]
            rows[n, HX, m], rows[n, HY, m] = x, y
            for a in range(m + 1):
                turn += rows[n, DX, a] * rows[n, HY, m - a] - rows[n, DY, a] * rows[n, HX, m - a]
            _pull(form, n, of, m, x, y)
            torque[int(form[n, ON_I])] += turn


@fused
def known_openings(
    kind: Array, form: Array, rows: Array, wanted: Array, W: Array, of: Array, m: int, gamma: Array
) -> None:
    """Accelerations ``Q a`` of order m that keep the rows closed."""
    scale = (m + 1.0) * (m + 2.0)
    for n in range(kind.shape[0]):
        gamma[n] = 0.0
        if wanted[n] and kind[n] != LOCK:
            i, j = int(form[n, ON_I]), int(form[n, ON_J])
            d = _between_arms(of, i, j, form, n, m + 2)
            total = W[n, 1, 0] * d[0] + W[n, 1, 1] * d[1]
            if kind[n] == LINE:
                _put_line(rows, n, m + 2, _arm(of, i, form, n, AXIS_I, m + 2), d)
                for a in range(1, m + 3):
                    total += rows[n, UX, a] * rows[n, DX, m + 2 - a] + rows[n, UY, a] * rows[n, DY, m + 2 - a]
            gamma[n] = -scale * total


@fused
def row_forces(
    kind: Array, form: Array, rows: Array, wanted: Array, W: Array, link: Array, of: Array, m: int, lam: Array
) -> None:
    """Forces of order m that multipliers bring to the links, into F and P; what then is known of lines."""
    scale = 1.0 / ((m + 1.0) * (m + 2.0))
    for n in range(kind.shape[0]):
        if not wanted[n] or kind[n] == LOCK:
            continue
        i, j = int(form[n, ON_I]), int(form[n, ON_J])
        x, y = W[n, 1, 0] * lam[n], W[n, 1, 1] * lam[n]
        if kind[n] == LINE:
            rows[n, LAM, m] = lam[n]
            rows[n, HX, m] += x
            rows[n, HY, m] += y
            a_i, a_j = pair_at(link, i, ACCELERATION), pair_at(link, j, ACCELERATION)
            d = _between_arms(of, i, j, form, n, m + 2)
            d = d[0] + scale * (a_j[0] - a_i[0]), d[1] + scale * (a_j[1] - a_i[1])
            _put_line(rows, n, m + 2, _arm(of, i, form, n, AXIS_I, m + 2), d)
        _pull(form, n, of, m, x, y)
