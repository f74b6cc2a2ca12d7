"""Functions given by data (`consilience.mechanism.functions`), compiled: value, first and second derivative at a point.

A function is the sum of a polynomial, harmonics ``a sin(w x + phi)`` and a table of quintic pieces. All functions of a
mechanism lie one behind the other in the same arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array, Function
from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.vectors import Vector


class Functions(NamedTuple):
    """Flat arrays of n_f functions."""

    first: Array  # (n_f + 1, 3) first coefficient, first harmonic, first piece of each
    polynomial: Array  # (m,)
    harmonics: Array  # (m, 3)
    pieces: Array  # (m, 8) left end, right end, six coefficients
    period: Array  # (n_f,) of the table, zero if it has none


def flatten_functions(functions: Sequence[Function]) -> Functions:
    """Return the flat arrays of functions."""
    pieces = [f.table.pieces if f.table is not None else np.zeros((0, 8)) for f in functions]
    counts = [[len(f.polynomial), len(f.harmonics), len(p)] for f, p in zip(functions, pieces, strict=True)]
    return Functions(
        first=np.cumsum([[0, 0, 0], *counts], axis=0).astype(np.int64),
        polynomial=np.concatenate([np.zeros(0), *(f.polynomial for f in functions)]),
        harmonics=np.concatenate([np.zeros((0, 3)), *(f.harmonics for f in functions)]),
        pieces=np.concatenate([np.zeros((0, 8)), *pieces]),
        period=np.array([f.table.period if f.table is not None else 0.0 for f in functions]),
    )


@inner
def _table(functions: Functions, n: int, x: float) -> Vector:
    """Return value and two derivatives of the table of function n; NaN outside a table that is not periodic."""
    first, last = functions.first[n, 2], functions.first[n + 1, 2] - 1
    left = functions.pieces[first, 0]
    if functions.period[n] > 0.0:
        x = left + (x - left) % functions.period[n]
    if not left <= x <= functions.pieces[last, 1]:
        return np.nan, np.nan, np.nan
    while first < last:  # the piece whose right end is not below x
        middle = (first + last) // 2
        if functions.pieces[middle, 1] < x:
            first = middle + 1
        else:
            last = middle
    s = x - functions.pieces[first, 0]
    value = rate = acceleration = 0.0
    for k in range(7, 1, -1):
        acceleration = acceleration * s + 2.0 * rate
        rate = rate * s + value
        value = value * s + functions.pieces[first, k]
    return value, rate, acceleration


@kernel
def evaluate(functions: Functions, n: int, x: float) -> Vector:
    """Return value, first and second derivative of function n at x."""
    value = rate = acceleration = 0.0
    for k in range(functions.first[n + 1, 0] - 1, functions.first[n, 0] - 1, -1):
        acceleration = acceleration * x + 2.0 * rate
        rate = rate * x + value
        value = value * x + functions.polynomial[k]
    for k in range(functions.first[n, 1], functions.first[n + 1, 1]):
        a, w, phi = functions.harmonics[k, 0], functions.harmonics[k, 1], functions.harmonics[k, 2]
        s, c = np.sin(w * x + phi), np.cos(w * x + phi)
        value += a * s
        rate += a * w * c
        acceleration -= a * w * w * s
    if functions.first[n, 2] < functions.first[n + 1, 2]:
        v, r, b = _table(functions, n, x)
        value += v
        rate += r
        acceleration += b
    return value, rate, acceleration
