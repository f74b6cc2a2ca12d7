"""Functions given by data, evaluated one number at a time: they stand in the innermost loop of an integration."""

from __future__ import annotations

import math
from bisect import bisect_left

from consilience.functions import Function


class Law:
    """A `consilience.functions.Function` by Horner's scheme on plain floats."""

    def __init__(self, function: Function) -> None:
        self._powers = tuple(float(c) for c in function.polynomial[::-1])
        self._harmonics = tuple((float(a), float(w), float(phi)) for a, w, phi in function.harmonics)
        table = function.table
        self._pieces = [] if table is None else [tuple(float(c) for c in piece) for piece in table.pieces]
        self._ends = [piece[1] for piece in self._pieces]
        self._period = 0.0 if table is None else table.period

    def at(self, x: float) -> tuple[float, float, float]:
        """Value, first and second derivative; NaN outside a table that is not periodic."""
        value, slope, bend = _horner(self._powers, x)
        for a, w, phi in self._harmonics:
            sine, cosine = a * math.sin(w * x + phi), a * math.cos(w * x + phi)
            value, slope, bend = value + sine, slope + w * cosine, bend - w * w * sine
        if self._pieces:
            v, s, b = self._table(x)
            value, slope, bend = value + v, slope + s, bend + b
        return value, slope, bend

    def _table(self, x: float) -> tuple[float, float, float]:
        left, right = self._pieces[0][0], self._ends[-1]
        if self._period:
            x = left + (x - left) % self._period
        if not left <= x <= right:
            return math.nan, math.nan, math.nan
        piece = self._pieces[bisect_left(self._ends, x)]
        return _horner(piece[:1:-1], x - piece[0])


def _horner(powers: tuple[float, ...], x: float) -> tuple[float, float, float]:
    """Value and two derivatives of a polynomial, its highest coefficient first."""
    value = slope = half = 0.0
    for c in powers:
        half = half * x + slope
        slope = slope * x + value
        value = value * x + c
    return value, slope, 2.0 * half
