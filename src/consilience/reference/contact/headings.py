"""Headings of circles that start to slide from rest: friction opposes the acceleration that it lets happen.

For the angles of the headings d, and the relative accelerations w that follow from them, ``d x w = 0`` (and
``d . w >= 0``, which the inclusions of the laws tell). Where a contact breaks away continuously w is zero, and the
heading is the one given: opposite to the last force.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
import scipy

from consilience.mechanism import Array
from consilience.reference.contact.mode_system import RANK, ModeSolution, active, columns_and_rows, solve_with_modes
from consilience.reference.contact.problem import ContactProblem, Modes

_AT_REST = 1e-13
"""Accelerations across the heading below this, relative to the largest, are zero."""

_SCAN = 24
"""Headings of one circle between which a root is looked for."""

_MOST_GUESSES = 3


class Headings:
    """Circles that start to slide in given modes."""

    def __init__(self, problem: ContactProblem, modes: Modes) -> None:
        self.problem, self.modes = problem, modes
        self.unit = float(np.max(np.abs(problem.free) / problem.row_scale(), initial=0.0)) or 1.0
        self.starting = [
            j
            for j, (one, mode) in enumerate(zip(problem.friction, modes.friction, strict=True))
            if one.vertices is None
            and one.kinetic > 0.0
            and not len(mode.held)
            and not np.any(problem.slip(j))
            and active(problem, modes, j)
        ]
        drags = [modes.friction[j].drag for j in self.starting]
        self.given = np.array([np.arctan2(-drag[1], -drag[0]) for drag in drags])
        if self.starting:
            self._prepare()

    def _prepare(self) -> None:
        """Set up the system of these modes, in which a heading changes one column and the constant force."""
        problem = self.problem
        self._constant, self._columns, E = columns_and_rows(problem, self.modes)
        self._size = np.abs(E) @ problem.row_scale()
        self._response = (E @ problem.delassus) / self._size[:, None]
        self._wanted = -(E @ problem.free) / self._size
        closed = [n for n, shut in zip(problem.normals, self.modes.closed, strict=True) if shut]
        self._rows = np.array([problem.friction[j].rows for j in self.starting])
        self._kinetic = np.array([problem.friction[j].kinetic for j in self.starting])
        self._offset = np.array([problem.friction[j].offset for j in self.starting])
        loads = [problem.friction[j].load for j in self.starting]
        self._column = [closed.index(load) if load in closed else -1 for load in loads]
        self._moved = problem.delassus[self._rows.ravel()]

    def solved(self) -> ModeSolution:
        """Solve with the headings found from the given ones."""
        if not self.starting or np.max(np.abs(self._across(self.given))) <= _AT_REST:
            return solve_with_modes(self.problem, self.modes)
        return self._from(self.given)

    def all(self) -> Iterator[ModeSolution]:
        """Yield the solutions of all headings found: of one circle by a scan, of several from some starts."""
        count = len(self.starting)
        if count == 0:
            yield self.solved()
        elif count == 1:
            angles = self.given[0] + np.linspace(0.0, 2.0 * np.pi, _SCAN + 1)
            values = [self._one(angle) for angle in angles]
            for k in range(_SCAN):
                if values[k] * values[k + 1] <= 0.0:
                    yield self._from(np.array([scipy.optimize.brentq(self._one, angles[k], angles[k + 1], xtol=1e-6)]))
        else:
            offsets = list(product(2.0 * np.pi / 3.0 * np.arange(3), repeat=count))
            for offset in offsets[:: max(1, len(offsets) // _MOST_GUESSES)]:
                yield self._from(self.given + np.array(offset))

    def _one(self, angle: float) -> float:
        return float(self._across(np.array([angle]))[0])

    def _from(self, angles: Array) -> ModeSolution:
        found = scipy.optimize.root(self._across, angles, tol=1e-14).x
        return solve_with_modes(self.problem, self._turned(found))

    def _turned(self, angles: Array) -> Modes:
        modes = self.modes
        for j, angle in zip(self.starting, angles, strict=True):
            heading = np.array([np.cos(angle), np.sin(angle)])
            modes = modes.with_friction(j, self.problem.friction[j].sliding(heading))
        return modes

    def _across(self, angles: Array) -> Array:
        """Return the accelerations across the headings, relative to the largest."""
        along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        drags = -self._kinetic[:, None] * along
        S, constant = self._columns.copy(), self._constant.copy()
        for rows, column, drag, offset in zip(self._rows, self._column, drags, self._offset, strict=True):
            constant[rows] = offset * drag
            if column >= 0:
                S[rows, column] = drag
        S /= self._size
        x = np.linalg.lstsq(self._response @ S, self._wanted - self._response @ constant, rcond=RANK)[0]
        w = self.problem.free[self._rows] + (self._moved @ (constant + S @ x)).reshape(-1, 2)
        across: Array = (w[:, 1] * along[:, 0] - w[:, 0] * along[:, 1]) / self.unit
        return across
