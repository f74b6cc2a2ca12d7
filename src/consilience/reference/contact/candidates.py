"""Modes worth trying: of the complementarity problem with pyramids for cones, and all there are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.complementarity import solve_lcp
from consilience.reference.contact.mode_system import active
from consilience.reference.contact.problem import ON_BISECTOR, ContactProblem, FrictionMode, FrictionSet, Modes

_FACETS, _FEWER, _MANY = 16, 8, 40
"""Vertices of the pyramid that stands for a circular cone where modes are guessed, and beyond so many sets."""

_STILL = 1e-8
"""Accelerations of a guess below this count as zero, relative to the largest."""


def undecided(problem: ContactProblem) -> tuple[int, ...]:
    """Return the friction sets whose velocity leaves a direction open: at rest, or sliding along a facet."""
    natural = problem.natural_modes().friction
    return tuple(j for j, mode in enumerate(natural) if len(mode.held))


def slips(one: FrictionSet, base: FrictionMode, heading: Array, on_bisector: float = ON_BISECTOR) -> FrictionMode:
    """Return the mode of a set that starts to slide, or that turns from a facet to one of its vertices."""
    if not base.reach:
        return one.sliding(heading, on_bisector)
    side = base.held[0]
    sign = -1.0 if float(side @ heading) > 0.0 else 1.0
    return FrictionMode(base.drag + sign * base.reach * side, np.zeros((0, len(side))))


def _directions(one: FrictionSet, base: FrictionMode, facets: int, outer: bool) -> Array:
    """Return extreme friction forces per unit of load along the undecided directions, shape (k, d)."""
    if base.reach:
        return np.array([[base.reach], [-base.reach]]) * base.held
    vertices = one.vertices
    if vertices is None:
        vertices = replace(one, facets=facets).vertices
        assert vertices is not None
        if outer:
            vertices = vertices / np.cos(np.pi / facets)
    return one.static * vertices


class PyramidProblem:
    """Linear complementarity problem of Stewart and Trinkle (1996), which guesses modes.

    Unknowns are the normal forces, the shares beta of the vertices of each undecided friction set, and its slip lambda:

        0 <= N _|_ u_n >= 0,   0 <= beta _|_ lambda + d . u_t >= 0,   0 <= lambda _|_ (N + offset) - sum beta >= 0.
    """

    def __init__(self, problem: ContactProblem, outer: bool = False) -> None:
        """Set up a problem; with `outer` the pyramids that stand for circles are circumscribed."""
        self._problem, self._sets = problem, undecided(problem)
        natural, m, normals = problem.natural_modes(), len(problem.free), list(problem.normals)
        P, self._constant = [np.eye(m)[normals]], np.zeros(m)
        for one, mode in zip(problem.friction, natural.friction, strict=True):
            self._constant[list(one.rows)] += one.offset * mode.drag
            if one.load is not None:
                P[0][normals.index(one.load), list(one.rows)] += mode.drag
        scales = [problem.row_scale()[normals]]
        facets = _FACETS if len(self._sets) <= _MANY else _FEWER
        for j in self._sets:
            one = problem.friction[j]
            directions = _directions(one, natural.friction[j], facets, outer)
            P.append(np.zeros((len(directions), m)))
            P[-1][:, list(one.rows)] = directions
            # one scale for all vertices of a set: they share the slip lambda
            scales.append(np.full(len(directions), np.mean(problem.row_scale()[list(one.rows)])))
        self._P, self._owner = np.vstack(P).T, np.repeat(np.arange(len(self._sets)), [len(part) for part in P[1:]])
        tests = self._P.copy()
        tests[:, : len(normals)] = np.eye(m)[:, normals]
        self._M, self._q = self._system(tests / np.concatenate(scales))

    def _system(self, tests: Array) -> tuple[Array, Array]:
        """Return matrix and constant for forces in units of `_unit`."""
        problem, n, k, s = self._problem, len(self._problem.normals), len(self._owner), len(self._sets)
        self._unit = float(np.max(np.abs(problem.free) / problem.row_scale(), initial=0.0)) or 1.0
        M, q = np.zeros((n + k + s, n + k + s)), np.zeros(n + k + s)
        M[: n + k, : n + k] = tests.T @ problem.delassus @ self._P
        q[: n + k] = tests.T @ problem.acceleration(self._constant) / self._unit
        vertices = np.arange(n, n + k)
        M[vertices, n + k + self._owner], M[n + k + self._owner, vertices] = 1.0, -1.0
        for c, j in enumerate(self._sets):
            one = problem.friction[j]
            if one.load is not None:
                M[n + k + c, problem.normals.index(one.load)] = 1.0
            q[n + k + c] = one.offset / self._unit
        return M, q

    def guess(self, covering: Array | None = None) -> Modes | None:
        """Guess modes; None where the method ends on a ray.

        Parameters
        ----------
        covering : ndarray, optional
            Shape (n + number of undecided sets,): weights of the covering vector, to look for other solutions.
        """
        problem, n, k = self._problem, len(self._problem.normals), len(self._owner)
        if not n + k:
            return problem.natural_modes()
        cover = np.ones(len(self._q))
        if covering is not None:
            cover[: n + k] = np.concatenate([covering[:n], covering[n + self._owner]])
        z = solve_lcp(self._M, self._q, cover)
        if z is None:
            return None
        return modes_of(problem, problem.acceleration(self._constant + self._unit * (self._P @ z[: n + k])))


def modes_of(problem: ContactProblem, acceleration: Array) -> Modes:
    """Return the modes that accelerations show: what does not move is held."""
    scaled = acceleration / problem.row_scale()
    still = _STILL * max(float(np.max(np.abs(scaled))), float(np.max(np.abs(problem.free) / problem.row_scale())))
    still = max(still, problem.rounding)
    closed = np.array([scaled[n] <= still for n in problem.normals], dtype=bool)
    modes = Modes(closed, problem.natural_modes().friction)
    for j in undecided(problem):
        one, base = problem.friction[j], modes.friction[j]
        w = base.held @ scaled[list(one.rows)]
        if active(problem, modes, j) and np.max(np.abs(w)) > still:
            heading = base.held.T @ (base.held @ acceleration[list(one.rows)])
            modes = modes.with_friction(j, slips(one, base, heading, still / float(np.linalg.norm(w))))
    return modes


def options(one: FrictionSet, base: FrictionMode, heading: Array) -> tuple[FrictionMode, ...]:
    """Return all modes of an undecided friction set; of a circle, one heading stands for all."""
    vertices = one.vertices
    if base.reach:
        return (base, slips(one, base, base.held[0]), slips(one, base, -base.held[0]))
    if vertices is None:
        return (base, one.sliding(heading))
    found = [base, *(one.sliding(-vertex) for vertex in vertices)]
    if len(one.rows) == 2:
        found += [one.sliding(-middle) for middle in vertices + np.roll(vertices, -1, axis=0)]
    return tuple(found)


def count(problem: ContactProblem) -> int:
    """Return a bound of the number of combinations of modes."""
    natural = problem.natural_modes().friction
    each = {n: 1.0 for n in problem.normals}
    rest = 1.0
    for j in undecided(problem):
        one = problem.friction[j]
        number = len(options(one, natural[j], np.ones(len(one.rows))))
        if one.load is None or one.offset > 0.0:
            rest *= number
        else:
            each[one.load] *= number
    return int(min(rest * float(np.prod([1.0 + number for number in each.values()])), 1e9))


def all_modes(problem: ContactProblem, headings: dict[int, Array]) -> Iterator[Modes]:
    """Yield all combinations of modes; `headings` of the undecided sets, for circles."""
    natural = problem.natural_modes().friction
    sets = undecided(problem)
    for closed in product((True, False), repeat=len(problem.normals)):
        modes = Modes(np.array(closed, dtype=bool), natural)
        able = [j for j in sets if active(problem, modes, j)]
        for choice in product(*(options(problem.friction[j], natural[j], headings[j]) for j in able)):
            combined = modes
            for j, mode in zip(able, choice, strict=True):
                combined = combined.with_friction(j, mode)
            yield combined
