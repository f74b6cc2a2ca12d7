"""Functions of time or of a coordinate as plain Python, many times faster than `Function.at`: a callback asks often."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence

from consilience.functions import Function, Table

Jet = tuple[float, float, float]
"""Value, first and second derivative."""

_SLACK = 1e-9
"""How far beyond the ends of a table, of its length, it has values: a clock that sums up its steps runs so far over."""

_NOWHERE = (math.nan, math.nan, math.nan)


def _horner(coefficients: Sequence[float], x: float) -> Jet:
    """Polynomial with its coefficients from the highest power down."""
    value = rate = bend = 0.0
    for c in coefficients:
        bend = bend * x + 2.0 * rate
        rate = rate * x + value
        value = value * x + c
    return value, rate, bend


def _curve(table: Table) -> Callable[[float], Jet]:
    rows = table.pieces.tolist()
    ends, first, last = [row[1] for row in rows], rows[0][0], rows[-1][1]
    pieces = [(row[0], row[:1:-1]) for row in rows]
    slack = _SLACK * (last - first)

    def at(x: float) -> Jet:
        if table.periodic:
            x = first + (x - first) % table.period
        if not first - slack <= x <= last + slack:
            return _NOWHERE
        left, coefficients = pieces[min(bisect_left(ends, x), len(pieces) - 1)]
        return _horner(coefficients, x - left)

    return at


def jet_of(function: Function) -> Callable[[float], Jet]:
    """Value and two derivatives of a function, as a function of its argument; NaN outside a table."""
    powers = function.polynomial.tolist()[::-1]
    harmonics = function.harmonics.tolist()
    curve = None if function.table is None else _curve(function.table)

    def at(x: float) -> Jet:
        value, rate, bend = _horner(powers, x)
        for amplitude, frequency, phase in harmonics:
            s, c = math.sin(frequency * x + phase), math.cos(frequency * x + phase)
            value += amplitude * s
            rate += amplitude * frequency * c
            bend -= amplitude * frequency**2 * s
        if curve is not None:
            more = curve(x)
            value, rate, bend = value + more[0], rate + more[1], bend + more[2]
        return value, rate, bend

    return at
