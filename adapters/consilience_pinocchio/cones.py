"""Forces of contacts, stops and dry friction by Pinocchio's `ADMMConstraintSolver`.

The solver finds f with ``G f + y`` in the dual of a product of sets, complementary to f in the sets. G is the Delassus
matrix ``J M^-1 J^T`` of the adapter's rows; constraint models of Pinocchio give the sets alone: a point contact the
cone of Coulomb, joint friction an interval, a point anchor three constraints. With ``solve_ncp`` the solver adds de
Saxce's term, so that sliding does not lift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.mechanism import Array

TOLERANCE = 1e-13
"""Tolerances of the solver, relative to the data and absolute in m/s^2 and N; the defaults are 1e-6."""

FEW_ITERATIONS, MANY_ITERATIONS, MOST_ITERATIONS = 300, 5000, 50_000

ENOUGH, ENOUGH_AT_INSTANT = 1e-9, 1e-11
"""Residual relative to the data at which few iterations are enough: dependent rows do not get to the tolerance."""

_ADAPTED, _KEPT = pin.ADMMUpdateRule.SPECTRAL, pin.ADMMUpdateRule.CONSTANT
"""Rules of the solver's penalty. The one that adapts it may go round without end near a jam, where a constant ends."""

ACCEPTED = 1e-7
"""Largest residual of an answer, relative to the data."""

_RANK = 1e-10
"""Least size over the largest of what rounding leaves of rows and data that constraints hold."""

_DEPENDENT = 1e-8
"""Largest eigenvalue over the largest of dependent rows: an error of the pose leaves its square."""

USUAL = 1e-3, 1e5
"""Largest diagonal of G in 1/kg outside of which forces are counted in another unit of mass, which makes it four."""

SETTINGS: dict[str, Any] = {
    "tolerances": TOLERANCE,
    "max_iterations": f"{FEW_ITERATIONS}, up to {MOST_ITERATIONS} where the residual is large",
    "admm_update_rule": "SPECTRAL, CONSTANT where it does not converge",
    "solve_ncp": True,
}


REASONS = {
    "rebound threshold": "Pinocchio's solver has no restitution, and that of the adapter has no threshold",
    "pyramid cone": "Pinocchio's cone of friction is a circle",
    "box cone": "Pinocchio's cone of friction is a circle",
    "Poisson impact": "an impact is one solution of Pinocchio's solver, which is Moreau's law",
    "torsional friction": "Pinocchio's point contacts exert no moments",
    "rolling friction": "Pinocchio's point contacts exert no moments",
    "compliant contact": "the adapter gives Pinocchio's solver rigid contacts alone",
    "dry friction of a reaction": "the bound of Pinocchio's joint friction is a constant",
}
"""Features of contacts, stops and dry friction that Pinocchio cannot represent, and why."""


@dataclass(frozen=True)
class Interval:
    """Set of one force: at least `lower`, at most `upper`."""

    lower: float
    upper: float


@dataclass(frozen=True)
class Circle:
    """Coulomb's cone of three forces: two tangents, then the normal."""

    friction: float


@dataclass(frozen=True)
class Anchor:
    """All forces of three rows: constraints."""


ForceSet = Interval | Circle | Anchor

ONE_SIDED = Interval(0.0, np.inf)


@lru_cache(maxsize=16)
def _without_tangents(sets: tuple[ForceSet, ...]) -> tuple[Array, tuple[ForceSet, ...]]:
    """Return the rows of sets, and the sets, without tangents of no friction: a cone that is a line is solved badly."""
    rows: list[int] = []
    found: list[ForceSet] = []
    start = 0
    for one in sets:
        end = start + (1 if isinstance(one, Interval) else 3)
        smooth = isinstance(one, Circle) and one.friction == 0.0
        rows += range(end - 1 if smooth else start, end)
        found.append(ONE_SIDED if smooth else one)
        start = end
    return np.array(rows, dtype=int), tuple(found)


def _moving(sets: Sequence[ForceSet], moves: Array) -> tuple[Array, list[ForceSet]]:
    """Return the rows of sets of which some row moves, and these sets."""
    rows, found, start = list[int](), list[ForceSet](), 0
    for one in sets:
        end = start + (1 if isinstance(one, Interval) else 3)
        if np.any(moves[start:end]):
            rows += range(start, end)
            found.append(one)
        start = end
    return np.array(rows, dtype=int), found


@lru_cache(maxsize=1)
def _hinge() -> tuple[Any, Any]:
    """Return a model of one hinge, which sets need and do not use."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    joints = pin.StdVec_Index()
    joints.append(1)
    return model, joints


def _model(of: ForceSet, unit: float) -> Any:
    """Return the constraint model of a set, of forces in a unit."""
    model, joints = _hinge()
    if isinstance(of, Interval):
        bounds = np.array([of.lower]) / unit, np.array([of.upper]) / unit
        return pin.JointFrictionConstraintModel(model, joints, *bounds)
    ends = model, 0, pin.SE3.Identity(), 1, pin.SE3.Identity()
    if isinstance(of, Anchor):
        return pin.PointAnchorConstraintModel(*ends)
    contact = pin.PointContactConstraintModel(*ends)
    contact.setFriction(of.friction)
    return contact


def _models(sets: Sequence[ForceSet], unit: float) -> tuple[Any, Any]:
    """Return the constraint models of sets, of forces in a unit, and their data."""
    models, data = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for one in sets:
        models.append(_model(one, unit))
    for model in models:
        data.append(model.createData())
    return models, data


def _complementarity(f: Array, u: Array, sets: Sequence[ForceSet]) -> float:
    """Return the largest power of forces in cones and intervals over the largest force, with de Saxce's term."""
    start, found = 0, 0.0
    for one in sets:
        end = start + (1 if isinstance(one, Interval) else 3)
        of, along = f[start:end], u[start:end]
        start = end
        if isinstance(one, Circle):
            along = along + np.array([0.0, 0.0, one.friction * np.hypot(*along[:2])])
        elif isinstance(one, Interval):
            bound = one.lower if along[0] > 0.0 else one.upper
            of = of - bound if np.isfinite(bound) else of
        found = max(found, abs(float(of @ along)))
    return found / max(float(np.max(np.abs(f))), np.finfo(float).tiny)


class ConeSolver:
    """The solver for rows in given sets; it keeps the models of the last call's sets.

    Every call starts without a guess: of forces that are open, those found do not depend on the steps before.

    Parameters
    ----------
    associated : bool
        Leave out de Saxce's term: the convex cone, which sliding lifts.

    Attributes
    ----------
    enough : float
        Residual relative to the data at which few iterations are enough.
    iterations : int
        Sum over all solutions.
    """

    def __init__(self, associated: bool = False) -> None:
        self.enough = ENOUGH
        self._sets: tuple[float | ForceSet, ...] | None = None
        self._settings = pin.ADMMSolverSettings()
        self._settings.solve_ncp = not associated
        for kind in ("feasibility", "complementarity"):
            for scale in ("absolute", "relative"):
                setattr(self._settings, f"{scale}_{kind}_tol", TOLERANCE)
        self.iterations = 0

    def forces(self, G: Array, y: Array, sets: Sequence[ForceSet]) -> Array:
        """Return the forces f (n,) of rows in sets.

        Parameters
        ----------
        G : ndarray, shape (n, n)
        y : ndarray, shape (n,)
            Accelerations along the rows without the forces.
        sets : sequence of ForceSet
            Of consecutive rows: one row for an interval, three for others; anchors first.

        Raises
        ------
        ArithmeticError
            The solver does not converge.
        """
        rows, pushing = _without_tangents(tuple(sets))
        if len(rows) == len(y):
            return self._pushed(G, y, pushing)
        f = np.zeros(len(y))
        f[rows] = self._pushed(G[np.ix_(rows, rows)], y[rows], pushing)
        return f

    def _pushed(self, G: Array, y: Array, sets: Sequence[ForceSet]) -> Array:
        """Return the forces; where the solver stops, those of the contacts alone, the anchors solved for."""
        try:
            return self._solved(G, y, sets)
        except ArithmeticError:
            others = [one for one in sets if not isinstance(one, Anchor)]
            if len(others) == len(sets):
                raise
        # rows of constraints and contacts that depend on one another slow it down without end; of constraints alone,
        # whose data agree no better than the step keeps them, it then finds no forces
        held = 3 * (len(sets) - len(others))
        size, axes = np.linalg.eigh(G[:held, :held])
        kept = size > _DEPENDENT * size[-1]
        by_held = (axes[:, kept] / size[kept]) @ axes[:, kept].T
        rounding = max(_RANK, 100.0 * np.finfo(float).eps * size[-1] / np.min(size[kept], initial=size[-1]))
        across = by_held @ G[:held, held:]
        left, free = y[held:] - across.T @ y[:held], G[held:, held:] - G[held:, :held] @ across
        left[np.abs(left) <= rounding * np.max(np.abs(y))] = 0.0  # what anchors hold already
        moves = (np.diag(free) > rounding * np.diag(G)[held:]) | (left != 0.0)
        f, (rows, moving) = np.zeros(len(left)), _moving(others, moves)
        f[rows] = self._solved(free[np.ix_(rows, rows)], left[rows], moving)
        return np.concatenate([-by_held @ y[:held] - across @ f, f])

    def _solved(self, G: Array, y: Array, sets: Sequence[ForceSet]) -> Array:
        """Return the forces by Pinocchio's solver, in three numbers of iterations, two units and two penalty rules."""
        scale, moved = float(np.abs(y).max(initial=0.0)), float(np.max(G.diagonal(), initial=0.0))
        if scale == 0.0:
            return np.zeros(len(y))
        if moved == 0.0:
            raise ArithmeticError(f"contacts close by {scale:.1e} m/s^2 against joints that hold all of them")
        # the solver adds an absolute 1e-6 to the diagonal; a power of two rounds nothing
        mass = 1.0 if USUAL[0] < moved < USUAL[1] else 2.0 ** (2.0 - float(np.rint(np.log2(moved))))
        if self._sets != (own := (mass, *sets)):
            self._sets, self._kept = own, _models(sets, mass)
        # beside data far from one, dependent rows can end with no finite residual
        attempts = [
            (FEW_ITERATIONS, 1.0, _ADAPTED),
            (MANY_ITERATIONS, 1.0, _ADAPTED),
            (MANY_ITERATIONS, scale, _ADAPTED),
        ]
        if not any(isinstance(one, Anchor) for one in sets):  # of anchors beside contacts no number is enough
            attempts += [(MANY_ITERATIONS, scale, _KEPT), (MOST_ITERATIONS, scale, _ADAPTED)]
        for most, unit, rule in attempts:
            self._settings.max_iterations, self._settings.admm_update_rule = most, rule
            result = pin.ADMMSolverResult()
            models, data = self._kept if unit == 1.0 else _models(sets, mass * unit)
            # the operator keeps the solver's penalty on its diagonal: a new one for each call
            operator, solver = pin.DelassusOperatorDense(mass * G), pin.ADMMConstraintSolver()
            met = solver.solve(operator, y / unit, models, data, self._settings, result)
            self.iterations += int(result.iterations)
            f = mass * unit * np.array(result.retrieveConstraintImpulses())
            across = unit * result.complementarity
            if unit == scale and not (np.isfinite(across) or any(isinstance(one, Anchor) for one in sets)):
                # infinite for a force without bound whose acceleration is negative, if only by rounding; in units of
                # the data it mostly is finite
                across = _complementarity(f, G @ f + y, sets)
            worst = max(unit * result.primal_feasibility, unit * result.dual_feasibility, across)
            if met or worst <= (self.enough if most == FEW_ITERATIONS else ACCEPTED) * scale:
                return f
        raise ArithmeticError(f"ADMMConstraintSolver stops at a residual of {worst:.1e}, data of {scale:.1e}")
