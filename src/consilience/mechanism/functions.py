"""Functions given by data: of time for drives and loads, of a joint coordinate for gears and cams.

    f(x) = sum_k c_k x^k + sum_n a_n sin(w_n x + phi_n) + table(x)

Functions are data: a case file holds them and a compiled kernel evaluates them. A table is interpolated by a spline of
degree five through its points, continuous to the fourth derivative, so that driven accelerations are smooth.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from functools import cached_property
from math import cos, factorial, nan, sin

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import InvalidInput
from consilience.mechanism.spatial import Array, fixed_array, float_array

_DEGREE = 5

Jet = tuple[float, float, float]
"""Value, first and second derivative."""


def _horner(powers: list[float], x: float) -> Jet:
    """Value and two derivatives of a polynomial of coefficients from the highest power down."""
    value = rate = bend = 0.0
    for coefficient in powers:
        bend = bend * x + 2.0 * rate
        rate = rate * x + value
        value = value * x + coefficient
    return value, rate, bend


@dataclass(frozen=True, eq=False)
class Table:
    """A smooth curve through points.

    Attributes
    ----------
    x, y : ndarray, shape (n,)
        Points, at least six, x increasing.
    periodic : bool
        The curve repeats with the period ``x[-1] - x[0]``; then ``y[-1] = y[0]`` but for rounding. Otherwise the
        curve has no value (NaN) outside the table.
    """

    x: Array
    y: Array
    periodic: bool = False

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(np.asarray(self.x)))
        object.__setattr__(self, "x", fixed_array(self.x, (n,)))
        object.__setattr__(self, "y", fixed_array(self.y, (n,)))
        if n < _DEGREE + 1:
            raise InvalidInput("table", f"{n} points", f"Give at least {_DEGREE + 1} points: the spline has degree 5.")
        if np.any(np.diff(self.x) <= 0):
            raise InvalidInput("table: x", "the values do not increase", "Give increasing abscissas.")
        if self.periodic:
            if abs(self.y[0] - self.y[-1]) > 1e-12 * np.max(np.abs(self.y)):
                ends = f"it starts at {self.y[0]:g} and ends at {self.y[-1]:g}"
                raise InvalidInput("table: y", ends, "End a period where it starts.")
            object.__setattr__(self, "y", fixed_array([*self.y[:-1], self.y[0]], (n,)))

    @property
    def period(self) -> float:
        """Period; zero of a curve that is not periodic."""
        return float(self.x[-1] - self.x[0]) if self.periodic else 0.0

    @cached_property
    def pieces(self) -> Array:
        """Polynomials of the spline as rows: left end, right end, coefficients of ``(x - left)^0..5``.

        One polynomial from each point to the next, in powers of the distance to the left point: terms of polynomials
        over longer pieces cancel, and the curve misses the points by more.
        """
        from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - a worker has no SciPy

        spline = make_interp_spline(self.x, self.y, _DEGREE, bc_type="periodic" if self.periodic else None)
        left, right = self.x[:-1], self.x[1:]
        terms = [spline(left, k) / factorial(k) for k in range(1, _DEGREE)]
        # the fifth derivative is constant in a piece and jumps at the points: evaluate it in the middle of the piece
        terms.append(spline((left + right) / 2, _DEGREE) / factorial(_DEGREE))
        return np.column_stack([left, right, self.y[:-1], *terms])

    @cached_property
    def _rows(self) -> tuple[list[float], list[list[float]]]:
        rows = self.pieces.tolist()
        return [row[1] for row in rows], [[row[0], *row[:1:-1]] for row in rows]

    def jet(self, x: float) -> Jet:
        """Return value, first and second derivative; NaN outside a table that is not periodic."""
        ends, rows = self._rows
        first = float(self.x[0])
        if self.periodic:
            x = first + (x - first) % self.period
        if not first <= x <= self.x[-1]:
            return nan, nan, nan
        left, *powers = rows[min(bisect_left(ends, x), len(rows) - 1)]
        return _horner(powers, x - left)

    def at(self, x: float) -> Array:
        """Return value, first and second derivative, shape (3,)."""
        return np.array(self.jet(x))


@dataclass(frozen=True, eq=False)
class Function:
    """A sum of powers, sines and a table.

    Attributes
    ----------
    polynomial : ndarray, shape (n,)
        Coefficients of 1, x, x^2, ...
    harmonics : ndarray, shape (m, 3)
        Amplitude, angular frequency and phase of each ``a sin(w x + phi)``.
    table : Table or None
    """

    polynomial: Array = field(default_factory=lambda: np.zeros(0))
    harmonics: Array = field(default_factory=lambda: np.zeros((0, 3)))
    table: Table | None = None

    def __post_init__(self) -> None:
        c = np.atleast_1d(float_array(self.polynomial, "function: polynomial", "Give numbers."))
        h = float_array(self.harmonics, "function: harmonics", "Give numbers.").reshape(-1, 3)
        object.__setattr__(self, "polynomial", fixed_array(c, c.shape))
        object.__setattr__(self, "harmonics", fixed_array(h, h.shape))

    @cached_property
    def _terms(self) -> tuple[list[float], list[list[float]]]:
        return self.polynomial.tolist()[::-1], self.harmonics.tolist()

    def jet(self, x: float) -> Jet:
        """Return value, first and second derivative as numbers; adapters evaluate functions at every step."""
        polynomial, harmonics = self._terms
        value, rate, bend = _horner(polynomial, x)
        for a, w, phi in harmonics:
            s, c = a * sin(w * x + phi), a * w * cos(w * x + phi)
            value, rate, bend = value + s, rate + c, bend - w * w * s
        if self.table is not None:
            v, r, b = self.table.jet(x)
            value, rate, bend = value + v, rate + r, bend + b
        return value, rate, bend

    def at(self, x: float) -> Array:
        """Return value, first and second derivative, shape (3,)."""
        return np.array(self.jet(x))


def constant(value: float) -> Function:
    """Return ``f(x) = value``."""
    return Function(polynomial=np.array([value]))


def linear(ratio: float, offset: float = 0.0) -> Function:
    """Return ``f(x) = offset + ratio x``: a gear pair, or a rack (ratio: the radius) and pinion."""
    return Function(polynomial=np.array([offset, ratio]))


def sine(amplitude: float, frequency: float, phase: float = 0.0) -> Function:
    """Return ``f(x) = amplitude sin(frequency x + phase)``, the frequency in rad/s for a function of time."""
    return Function(harmonics=np.array([[amplitude, frequency, phase]]))


def through(x: ArrayLike, y: ArrayLike, periodic: bool = False) -> Function:
    """Return a smooth curve through points, such as the profile of a cam."""
    x, y = (float_array(values, f"table: {name}", "Give numbers.") for name, values in (("x", x), ("y", y)))
    return Function(table=Table(x, y, periodic))
