"""Dense output of a motion: one polynomial for each step, together a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import InvalidInput
from consilience.mechanism import Array

StepPolynomial = Callable[[Array], Array]
"""Dense output of one step: from times of shape (n,) to coordinates of shape (n, n_u)."""


@dataclass(frozen=True, eq=False)
class Nested:
    """Polynomial of one step in the nested form of `tableaus`.

    Attributes
    ----------
    start, length : float, s
    u : ndarray, shape (n_u,)
        At the start of the step.
    F : ndarray, shape (n, n_u)
    """

    start: float
    length: float
    u: Array
    F: Array

    def __call__(self, t: Array) -> Array:
        """Coordinates at times of shape (n,), shape (n, n_u)."""
        x = ((t - self.start) / self.length)[:, None]
        total = np.zeros((len(x), len(self.u)))
        for i in reversed(range(len(self.F))):
            total = (total + self.F[i]) * (1.0 - x if i % 2 else x)
        return self.u + total


@dataclass(frozen=True, eq=False)
class Dense:
    """Dense output of all accepted steps.

    A polynomial within each step. At the end of a step the dense output has the value before settling, and jumps by the
    change of the coordinates, or of the chart, in settling.

    Attributes
    ----------
    ends : ndarray, shape (n_s + 1,), s
        Start of the first step and the ends of all steps.
    pieces : tuple of StepPolynomial
    charts : tuple
        Chart of the polynomial of each step; None for a formulation with a single chart.
    """

    ends: Array
    pieces: tuple[StepPolynomial, ...]
    charts: tuple[object, ...]

    def step(self, t: ArrayLike) -> Array:
        """Return the index of the step that contains a time, of the shape of `t`.

        Raises
        ------
        InvalidInput
            A time is outside the interval of integration.
        """
        t = np.asarray(t, dtype=float)
        if len(self.pieces) == 0 or not np.all((t >= self.ends[0]) & (t <= self.ends[-1])):
            where = f"[{self.ends[0]:g}, {self.ends[-1]:g}] s" if self.pieces else "a single instant"
            raise InvalidInput("dense output", "a time is outside the motion", f"It covers {where}.")
        return np.maximum(np.searchsorted(self.ends, t, side="left") - 1, 0)

    def __call__(self, t: ArrayLike) -> Array:
        """Return coordinates u at a time, shape (n_u,), or at times of shape (n,) in any order, shape (n, n_u)."""
        times = np.atleast_1d(np.asarray(t, dtype=float))
        steps = self.step(times)
        u = np.empty((len(times), self.pieces[0](self.ends[:1]).shape[1]))
        for k in np.unique(steps):
            u[steps == k] = self.pieces[k](times[steps == k])
        return u if np.ndim(t) else u[0]
