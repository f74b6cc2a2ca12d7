"""The motion between the ends of steps: one polynomial a step, together a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import InvalidInput
from consilience.mechanism import Array

Piece = Callable[[Array], Array]
"""Dense output of one step: of times of shape (n,) to coordinates of shape (n, n_u)."""


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

    Between two ends it is as smooth as its polynomial; at the end of a step it belongs to the step that ends there,
    before settling, and jumps by as much as settling has moved the coordinates or changed the chart.

    Attributes
    ----------
    ends : ndarray, shape (n_s + 1,), s
        Start of the first step and the ends of all.
    pieces : tuple of Piece
    charts : tuple
        Chart in which the polynomial of each step is to be read; None for a formulation that has one chart.
    """

    ends: Array
    pieces: tuple[Piece, ...]
    charts: tuple[object, ...]

    def step(self, t: ArrayLike) -> Array:
        """Index of the step that a time falls into, of the shape of `t`.

        Raises
        ------
        InvalidInput
            If a time is outside the interval of integration.
        """
        t = np.asarray(t, dtype=float)
        if len(self.pieces) == 0 or not np.all((t >= self.ends[0]) & (t <= self.ends[-1])):
            where = f"[{self.ends[0]:g}, {self.ends[-1]:g}] s" if self.pieces else "a single instant"
            raise InvalidInput("dense output", "a time is outside the motion", f"It covers {where}.")
        return np.maximum(np.searchsorted(self.ends, t, side="left") - 1, 0)

    def __call__(self, t: ArrayLike) -> Array:
        """Coordinates u at a time, shape (n_u,), or at times of shape (n,) in any order, shape (n, n_u)."""
        times = np.atleast_1d(np.asarray(t, dtype=float))
        steps = self.step(times)
        u = np.empty((len(times), self.pieces[0](self.ends[:1]).shape[1]))
        for k in np.unique(steps):
            u[steps == k] = self.pieces[k](times[steps == k])
        return u if np.ndim(t) else u[0]
