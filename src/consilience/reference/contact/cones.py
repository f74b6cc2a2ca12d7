"""Forces that modes leave undetermined: whether some of them lie in all friction cones, and by which margin.

Contacts that stick (and normals without friction) ask of a force f that it lies in a product of cones
``|across f + ...| <= along f + ...``. Modes are admissible if *some* force of the affine set that the equations leave
does; least norm is no criterion (Pfeiffer and Glocker 1996). The margin is

    max over the set of min over the cones of (along - |across|), for a sticking contact mu_s N - |T|,

a concave problem over second-order cones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.barrier import minimise, polish
from consilience.reference.contact.mode_system import ModeSolution, active, solve_with_modes
from consilience.reference.contact.problem import ContactProblem, Modes

_GAP = 1e-14
"""Distance from the optimum at which the barrier method ends, relative to the forces."""

_FURTHEST = 10.0
"""Largest margin that is looked for, relative to the forces of least norm: wedged contacts hold one another with forces
without bound."""


@dataclass(frozen=True, eq=False)
class StickingMargin:
    """How far the forces of given modes can stay from the boundaries of the cones.

    Attributes
    ----------
    value : float, N (N m)
        Least of `of_normal` and `of_friction`; infinite if no cone binds. The modes are admissible while it is not
        negative.
    force : ndarray, shape (m,)
        The force that attains it.
    of_normal : ndarray, shape (n,)
        Force N of each closed normal row; infinite for the others.
    of_friction : ndarray, shape (n_f,)
        Margin of each friction set with held directions; infinite for the others.
    wedged : bool
        Whether forces that are open keep a wider margin than the forces of least norm are large, as where contacts hold
        one another with forces without bound.
    """

    value: float
    force: Array
    of_normal: Array
    of_friction: Array
    wedged: bool


class _Cones:
    """Second-order cones ``|v + V f| <= t + T f``, and the normal or friction set that each belongs to."""

    def __init__(self, problem: ContactProblem, modes: Modes) -> None:
        self.m = len(problem.free)
        self._t: list[tuple[float, Array]] = []
        self._v: list[Array] = []
        self.of_normal: list[int] = []  # -1: of a friction set
        self.of_friction: list[int] = []
        for i, n in enumerate(problem.normals):
            if modes.closed[i]:
                self._add(0.0, self._unit((n,), np.ones(1)), None, (i, -1))
        for j in range(len(problem.friction)):
            if len(modes.friction[j].held) and active(problem, modes, j):
                self._add_friction(problem, modes, j)
        self.t = np.array([t for t, _ in self._t])
        self.T = np.array([row for _, row in self._t]).reshape(-1, self.m)
        self.V = np.array(self._v).reshape(-1, 2, self.m)

    def _unit(self, rows: tuple[int, ...], values: Array) -> Array:
        row = np.zeros(self.m)
        row[list(rows)] = values
        return row

    def _add(self, constant: float, along: Array, across: Array | None, owner: tuple[int, int]) -> None:
        self._t.append((constant, along))
        self._v.append(np.zeros((2, self.m)) if across is None else across)
        self.of_normal.append(owner[0])
        self.of_friction.append(owner[1])

    def _add_friction(self, problem: ContactProblem, modes: Modes, j: int) -> None:
        one, mode, owner = problem.friction[j], modes.friction[j], (-1, j)
        load = np.zeros(self.m)
        if one.load is not None:
            load[one.load] = 1.0
        if mode.reach:  # one facet of a pyramid
            for sign in (1.0, -1.0):
                row = self._unit(one.rows, sign * mode.held[0])
                self._add(mode.reach * one.offset, mode.reach * load - row, None, owner)
            return
        bound, vertices = one.static * load, one.vertices
        if vertices is None:
            across = np.array([self._unit(one.rows, axis) for axis in np.eye(2)])
            self._add(one.static * one.offset, bound, across, owner)
        elif len(one.rows) == 1:
            for vertex in vertices:
                self._add(one.static * one.offset, bound - self._unit(one.rows, vertex), None, owner)
        else:
            middles = 0.5 * (vertices + np.roll(vertices, -1, axis=0))
            for middle in middles / np.sum(middles**2, axis=1)[:, None]:
                self._add(one.static * one.offset, bound - self._unit(one.rows, middle), None, owner)

    def slack(self, force: Array) -> Array:
        """Return ``along - |across|`` of each cone."""
        return self.t + self.T @ force - np.linalg.norm(self.V @ force, axis=1)


def sticking_margin(problem: ContactProblem, modes: Modes, solution: ModeSolution | None = None) -> StickingMargin:
    """Return the margin of given modes over all forces that satisfy their equations."""
    solved = solve_with_modes(problem, modes) if solution is None else solution
    cones = _Cones(problem, modes)
    force, is_open = solved.force, bool(solved.undetermined.shape[1] and len(cones.t))
    if is_open:
        force = _widest(cones, solved)
    slack = cones.slack(force)
    of_normal, of_friction = np.full(len(problem.normals), np.inf), np.full(len(problem.friction), np.inf)
    for value, i, j in zip(slack, cones.of_normal, cones.of_friction, strict=True):
        if i >= 0:
            of_normal[i] = min(of_normal[i], value)
        else:
            of_friction[j] = min(of_friction[j], value)
    value = float(np.min(slack, initial=np.inf))
    wedged = is_open and value > _unit_of(solved, cones)
    return StickingMargin(value, force, of_normal, of_friction, wedged)


def admissible_force(
    problem: ContactProblem, solution: ModeSolution, margin_of: Callable[[], StickingMargin], room: float = 0.0
) -> Array:
    """Return the force of least norm in the cones; that of the widest margin where there is none but this.

    Parameters
    ----------
    problem : ContactProblem
    solution : ModeSolution
    margin_of : callable
        Returns the margin of the modes of the solution, which is not asked for where the force of least norm will do.
    room : float
        Margin that the force keeps, over the forces; half of the widest where that is less.
    """
    cones = _Cones(problem, solution.modes)
    k = solution.undetermined.shape[1]
    if k == 0 or (room == 0.0 and float(np.min(cones.slack(solution.force), initial=np.inf)) >= 0.0):
        return solution.force
    unit, margin = _unit_of(solution, cones), margin_of()
    cones.t -= min(room * unit, 0.5 * max(margin.value, 0.0))
    if float(np.min(cones.slack(solution.force), initial=np.inf)) >= 0.0:
        return solution.force
    if margin.value <= np.sqrt(_GAP) * unit:
        return margin.force
    Z = solution.undetermined
    start = Z.T @ (margin.force - solution.force)
    barrier = _Barrier(cones, solution.force / unit, Z, unit)
    y = barrier.minimise(np.zeros(k), 1.0, start / unit)
    return solution.force + unit * (Z @ y)


def _unit_of(solution: ModeSolution, cones: _Cones) -> float:
    """Return the size of the forces and of constant bounds."""
    sizes = (np.max(np.abs(part), initial=0.0) for part in (solution.force, cones.t))
    return float(max(sizes)) or 1.0


def _widest(cones: _Cones, solution: ModeSolution) -> Array:
    """Return the force of the widest margin."""
    Z, unit = solution.undetermined, _unit_of(solution, cones)
    k = Z.shape[1]
    barrier = _Barrier(cones, solution.force / unit, Z, unit, with_margin=True)
    start = np.zeros(k + 1)
    start[k] = min(float(np.min(cones.slack(solution.force))) / unit, _FURTHEST) - 1.0
    cost = np.zeros(k + 1)
    cost[k] = -1.0
    y, exact = barrier.minimise(cost, 0.0, start)[:k], _Barrier(cones, solution.force / unit, Z, unit)
    return solution.force + unit * (Z @ polish(exact.t, exact.T, exact.v, exact.V, y))


class _Barrier:
    """Cones over the undetermined forces y (in units of the forces), with the margin as last unknown or without."""

    def __init__(self, cones: _Cones, force: Array, Z: Array, unit: float, with_margin: bool = False) -> None:
        self.t, self.T = cones.t / unit + cones.T @ force, cones.T @ Z
        self.v, self.V = cones.V @ force, cones.V @ Z
        if with_margin:
            count, k = self.T.shape
            self.T = np.hstack([self.T, -np.ones((count, 1))])
            self.V = np.concatenate([self.V, np.zeros((count, 2, 1))], axis=2)
            # the margin and the sum of all loads are bounded, so that the central path ends
            loads, total = -np.sum(self.T[:, :k], axis=0), float(np.sum(self.t))
            self.t = np.append(self.t, [_FURTHEST, _FURTHEST * count + 2.0 * abs(total) - total])
            self.T = np.vstack([self.T, np.append(np.zeros(k), -1.0), np.append(loads, 0.0)])
            self.v = np.vstack([self.v, np.zeros((2, 2))])
            self.V = np.concatenate([self.V, np.zeros((2, 2, k + 1))])

    def minimise(self, cost: Array, curvature: float, y: Array) -> Array:
        """Minimise ``cost . y + curvature y . y / 2`` from a point within the cones."""
        return np.asarray(minimise(self.t, self.T, self.v, self.V, cost, curvature, y, _GAP))
