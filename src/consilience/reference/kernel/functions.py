"""Functions given by data (`consilience.mechanism.functions`), compiled: value, first and second derivative at a point.

A function is the sum of a polynomial, harmonics ``a sin(w x + phi)`` and a table of quintic pieces. All functions of a
mechanism lie one behind the other in the same arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import Array, Function
from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.record_type import INT, record_type
from consilience.reference.kernel.vectors import Vector

_FIRST = record_type(("coefficient", INT), ("harmonic", INT), ("piece", INT))
"""First coefficient of the polynomial, first harmonic and first piece of a function."""

_HARMONIC = record_type(("amplitude", float), ("frequency", float), ("phase", float))
_PIECE = record_type(("left", float), ("right", float), ("coefficients", float, 6))
"""Piece of a table: its ends, and the coefficients of powers of the distance from the left one."""


class Functions(NamedTuple):
    """Flat arrays of n_f functions."""

    first: Array  # (n_f + 1,) of _FIRST
    polynomial: Array  # (m,)
    harmonics: Array  # (m,) of _HARMONIC
    pieces: Array  # (m,) of _PIECE
    period: Array  # (n_f,) of the table, zero if it has none


def _rows(table: Array, kind: np.dtype[Any]) -> Array:
    """Return the rows of a table as records of the same numbers."""
    numbers = np.ascontiguousarray(table, np.int64 if kind is _FIRST else float)
    return numbers.reshape(-1).view(kind)


def flatten_functions(functions: Sequence[Function]) -> Functions:
    """Return the flat arrays of functions."""
    pieces = [f.table.pieces if f.table is not None else np.zeros((0, 8)) for f in functions]
    counts = [[len(f.polynomial), len(f.harmonics), len(p)] for f, p in zip(functions, pieces, strict=True)]
    return Functions(
        first=_rows(np.cumsum([[0, 0, 0], *counts], axis=0), _FIRST),
        polynomial=np.concatenate([np.zeros(0), *(f.polynomial for f in functions)]),
        harmonics=_rows(np.concatenate([np.zeros((0, 3)), *(f.harmonics for f in functions)]), _HARMONIC),
        pieces=_rows(np.concatenate([np.zeros((0, 8)), *pieces]), _PIECE),
        period=np.array([f.table.period if f.table is not None else 0.0 for f in functions]),
    )


@inner
def _table(functions: Functions, n: int, x: float) -> Vector:
    """Return value and two derivatives of the table of function n; NaN outside a table that is not periodic."""
    first, last = functions.first[n].piece, functions.first[n + 1].piece - 1
    left = functions.pieces[first].left
    if functions.period[n] > 0.0:
        x = left + (x - left) % functions.period[n]
    if not left <= x <= functions.pieces[last].right:
        return np.nan, np.nan, np.nan
    while first < last:  # the piece whose right end is not below x
        middle = (first + last) // 2
        if functions.pieces[middle].right < x:
            first = middle + 1
        else:
            last = middle
    s = x - functions.pieces[first].left
    value = rate = acceleration = 0.0
    for k in range(5, -1, -1):
        acceleration = acceleration * s + 2.0 * rate
        rate = rate * s + value
        value = value * s + functions.pieces[first].coefficients[k]
    return value, rate, acceleration


@kernel
def evaluate(functions: Functions, n: int, x: float) -> Vector:
    """Return value, first and second derivative of function n at x."""
    value = rate = acceleration = 0.0
    for k in range(functions.first[n + 1].coefficient - 1, functions.first[n].coefficient - 1, -1):
        acceleration = acceleration * x + 2.0 * rate
        rate = rate * x + value
        value = value * x + functions.polynomial[k]
    for k in range(functions.first[n].harmonic, functions.first[n + 1].harmonic):
        a, w = functions.harmonics[k].amplitude, functions.harmonics[k].frequency
        angle = w * x + functions.harmonics[k].phase
        s, c = np.sin(angle), np.cos(angle)
        value += a * s
        rate += a * w * c
        acceleration -= a * w * w * s
    if functions.first[n].piece < functions.first[n + 1].piece:
        v, r, b = _table(functions, n, x)
        value += v
        rate += r
        acceleration += b
    return value, rate, acceleration
