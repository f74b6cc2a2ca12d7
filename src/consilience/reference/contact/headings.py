"""Headings of circles that start to slide from rest: friction opposes the acceleration that it lets happen.

For the angles of the headings d, and the relative accelerations w that follow from them, ``d x w = 0`` (and
``d . w >= 0``, which the inclusions of the laws tell). Where a contact breaks away continuously w is zero, and the
heading is the one given: opposite to the last force.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from consilience.mechanism import Array
from consilience.reference.contact.algebra import solve_small
from consilience.reference.contact.mode_system import ModeSolution, active, columns_and_rows, solve_with_modes
from consilience.reference.contact.problem import ContactProblem, Modes
from consilience.reference.kernel.compiled import allocating

_AT_REST = 1e-13
"""Accelerations across the heading below this, relative to the largest, are zero."""

_SCAN = 24
"""Headings of one circle between which a root is looked for."""

_MOST_GUESSES = 3


class HeadingSystem(NamedTuple):
    """System of modes in which k circles start to slide; their friction, which headings change, is left out.

    Forces are ``constant + columns x + friction``, and ``system x`` is what they are to have on the rows E.
    """

    system: Array  # (r, r)
    size: Array  # (r,) scales of the rows E
    response: Array  # (r, 2 k) of the rows E over the scales to the friction
    wanted: Array  # (r,)
    column: Array  # (k,) index of the load of each among the columns; -1: none
    kinetic: Array  # (k,)
    offset: Array  # (k,)
    free: Array  # (2 k,) accelerations of the circles under the constant forces
    moved: Array  # (2 k, r) their response to x
    rubbed: Array  # (2 k, 2 k) and to the friction


class Headings:
    """Circles that start to slide in given modes."""

    def __init__(self, problem: ContactProblem, modes: Modes) -> None:
        self.problem, self.modes = problem, modes
        self.starting = [
            j
            for j, (one, mode) in enumerate(zip(problem.friction, modes.friction, strict=True))
            if one.vertices is None
            and one.kinetic > 0.0
            and not len(mode.held)
            and not np.any(problem.slip(j))
            and active(problem, modes, j)
        ]
        if self.starting:
            self._prepare()

    def _prepare(self) -> None:
        """Set up the system of these modes."""
        problem = self.problem
        self.unit = float(np.max(np.abs(problem.free) / problem.row_scale(), initial=0.0)) or 1.0
        drags = [self.modes.friction[j].drag for j in self.starting]
        self.given = np.array([np.arctan2(-drag[1], -drag[0]) for drag in drags])
        constant, S, E = columns_and_rows(problem, self.modes)
        size = np.abs(E) @ problem.row_scale()
        closed = [n for n, shut in zip(problem.normals, self.modes.closed, strict=True) if shut]
        starting = [problem.friction[j] for j in self.starting]
        rows = np.array([one.rows for one in starting]).ravel()
        constant[rows] = S[rows] = 0.0
        G, E, free = problem.delassus, E / size[:, None], problem.acceleration(constant)
        self._system = HeadingSystem(
            system=E @ G @ (S / size),
            size=size,
            response=np.ascontiguousarray(E @ G[:, rows]),
            wanted=-(E @ free),
            column=np.array([closed.index(one.load) if one.load in closed else -1 for one in starting]),
            kinetic=np.array([one.kinetic for one in starting]),
            offset=np.array([one.offset for one in starting]),
            free=free[rows],
            moved=G[rows] @ (S / size),
            rubbed=G[np.ix_(rows, rows)],
        )

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
        return np.asarray(_accelerations_across(self._system, angles)) / self.unit


@allocating
def _accelerations_across(one: HeadingSystem, angles: Array) -> Array:
    """Return the accelerations across headings."""
    system, wanted, count = one.system.copy(), one.wanted.copy(), len(angles)
    along, drag = np.empty(2 * count), np.empty(2 * count)  # friction over its bound
    for i in range(2 * count):
        k = i // 2
        along[i] = np.cos(angles[k]) if i % 2 == 0 else np.sin(angles[k])
        drag[i] = -one.kinetic[k] * along[i]
        c = one.column[k]
        for r in range(len(wanted)):
            wanted[r] -= one.response[r, i] * one.offset[k] * drag[i]
            if c >= 0:
                system[r, c] += one.response[r, i] * drag[i] / one.size[c]
    x = np.zeros(len(wanted))
    solve_small(system, wanted, x)
    for i in range(2 * count):
        k = i // 2
        c = one.column[k]
        drag[i] *= one.offset[k] + (x[c] / one.size[c] if c >= 0 else 0.0)
    w = one.free + one.moved @ x + one.rubbed @ drag
    return w[1::2] * along[::2] - w[::2] * along[1::2]
