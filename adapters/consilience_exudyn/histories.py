"""Functions of the mechanism as plain Python, for the user functions that Exudyn calls at every evaluation.

The same sums as `consilience.functions.Function.at`, without arrays: a step of an integrator calls them many times.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable

from consilience.functions import Function, Table

Values = tuple[float, float, float]
"""Value, first and second derivative."""

Scalar = Callable[[float], Values]


def scalar(function: Function) -> Scalar:
    """Value and two derivatives of a function at a number."""
    powers = [float(c) for c in function.polynomial[::-1]]
    waves = [(float(a), float(w), float(phi)) for a, w, phi in function.harmonics]
    table = _table(function.table) if function.table is not None else None

    def at(x: float) -> Values:
        f, f_1, f_2 = _horner(powers, x)
        for a, w, phi in waves:
            s, c = a * math.sin(w * x + phi), a * math.cos(w * x + phi)
            f, f_1, f_2 = f + s, f_1 + w * c, f_2 - w * w * s
        if table is not None:
            g, g_1, g_2 = table(x)
            f, f_1, f_2 = f + g, f_1 + g_1, f_2 + g_2
        return f, f_1, f_2

    return at


def _horner(descending: list[float], x: float) -> Values:
    f = f_1 = half = 0.0
    for c in descending:
        half = half * x + f_1
        f_1 = f_1 * x + f
        f = f * x + c
    return f, f_1, 2.0 * half


def _table(table: Table) -> Scalar:
    pieces = table.pieces.tolist()
    ends = [piece[1] for piece in pieces]
    descending = [piece[:1:-1] for piece in pieces]
    first, last, period = float(table.x[0]), float(table.x[-1]), table.period

    def at(x: float) -> Values:
        if period:
            x = first + (x - first) % period
        if not first <= x <= last:
            return math.nan, math.nan, math.nan
        n = min(bisect_left(ends, x), len(ends) - 1)
        return _horner(descending[n], x - pieces[n][0])

    return at
