"""The compiled solver as this package uses it: constraint rows at a state, and steps with dense output.

The only place here that calls the compiled kernels. Steps are those of SciPy's Dormand-Prince 8(5,3); after each,
positions and velocities are projected onto the constraints and the interpolant is taken between the projected ends.
"""

from __future__ import annotations

import numpy as np
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import Array, Mechanism, State, reaction_map
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import Model, flatten, pack, unpack, workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.projection import normalise, project
from consilience.reference.formulations.compiled_choice import FORMULATIONS, derivative


def constraint_rows(mechanism: Mechanism, state: State, t: float, turns: Array | None) -> tuple[Model, Array, Array]:
    """Model, solver state y (n_b, 13), and Jacobian Q (q, 6 n_b) of all rows in the velocities (v, w').

    Parameters
    ----------
    turns : ndarray, shape (n_c,), or None
        Joint coordinates that elements read, turns counted; None: angles within half a turn of zero.
    """
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    if turns is None:
        turns = np.zeros(len(model.coordinate))
    count_turns(model, y, ws, turns)
    rotations(y, ws.A)
    constraints.evaluate(model, t, y, turns, ws)
    return model, y[: len(mechanism.bodies)], ws.Q


def joint_wrenches(mechanism: Mechanism, state: State, lam: Array) -> Array:
    """Wrenches of multipliers of all rows: on the successor, at the origin of M, axes of F, shape (n_j, 6)."""
    wrenches, start = np.zeros((len(mechanism.joints), 6)), 0
    for k, joint in enumerate(mechanism.joints):
        end = start + len(joint.rows)
        wrenches[k] = reaction_map(mechanism, state, joint) @ lam[start:end]
        start = end
    return wrenches


class Stepper:
    """Motion between impacts, step by step.

    Attributes
    ----------
    t : float, s
    started : float, s
        Start of the last step.
    counters : dict of str to int
        Accepted steps and evaluations of the derivative.
    """

    def __init__(self, mechanism: Mechanism, state: State, t: float, tolerance: float) -> None:
        self._mechanism = mechanism
        self._model = flatten(mechanism)
        self._ws = workspace(self._model)
        self._a = np.empty(6 * len(mechanism.bodies))
        self._tolerance = tolerance
        self._turns = np.zeros(len(self._model.coordinate))
        self.counters = {"steps": 0, "evaluations": 0}
        length = self._model.length
        sizes = np.repeat([length, 1.0, length, 1.0], [3, 4, 3, 3])
        self._y = pack(mechanism, state)
        self._absolute = tolerance * np.tile(sizes, len(self._y))
        self.place(state, t)

    def place(self, state: State, t: float) -> None:
        """Go on from another state, for example the one after an impact."""
        self.t = self.started = t
        y, count = pack(self._mechanism, state), len(self._mechanism.bodies)
        y[count:] = self._y[count:]  # integrals of controllers go on
        self._y = y
        count_turns(self._model, self._y, self._ws, self._turns)
        self._before = (t, self._y.copy(), self._turns.copy())
        self._solver: scipy.integrate.DOP853 | None = None
        self._h: float | None = None

    def _derivative(self, t: float, y: Array) -> Array:
        dy = np.zeros_like(self._y)
        y = np.ascontiguousarray(y).reshape(dy.shape)
        derivative(FORMULATIONS["descriptor"], self._model, float(t), y, self._turns, self._ws, self._a, dy)
        self.counters["evaluations"] += 1
        return dy.ravel()

    def advance(self, bound: float) -> None:
        """Take one accepted step, not past the time `bound`.

        Raises
        ------
        NumericalFailure
            If the step size falls below what the time resolves.
        """
        if self._solver is None or self._solver.t_bound != bound:
            first = None if self._h is None else min(self._h, bound - self.t)
            self._solver = scipy.integrate.DOP853(
                self._derivative,
                self.t,
                self._y.ravel(),
                bound,
                rtol=self._tolerance,
                atol=self._absolute,
                first_step=first,
            )
        solver = self._solver
        self._before = (self.t, self._y, self._turns.copy())
        planned = solver.h_abs
        message = solver.step()
        if solver.status == "failed":
            raise NumericalFailure(f"reference with impacts, t = {solver.t:.12g} s: {message}")
        self._y = solver.y.reshape(self._y.shape).copy()
        project(self._model, float(solver.t), self._y, self._turns, self._ws)
        count_turns(self._model, self._y, self._ws, self._turns)
        solver.y = self._y.ravel()
        solver.f = self._derivative(solver.t, solver.y)
        self.started, self.t = self._before[0], float(solver.t)
        self._h = max(solver.h_abs, planned) if solver.status == "finished" else solver.h_abs
        self._dense = solver.dense_output()
        self.counters["steps"] += 1

    def go_back_to(self, t: float) -> None:
        """Undo the last step and end a shorter one at t, between its start and its end."""
        start, y, turns = self._before
        self.t, self._y, self._turns, self._solver = start, y.copy(), turns.copy(), None
        while self.t < t:
            self.advance(t)
        self._before, self.started = (start, y, turns), start
        self._solver = None

    @property
    def turns(self) -> Array:
        """Joint coordinates that elements read, turns counted, at the time t."""
        return self._turns.copy()

    def state(self) -> State:
        """State at the time t."""
        return State(*unpack(self._mechanism, self._y))

    def between(self, t: float) -> State:
        """State within the last step, from the interpolant of order 7."""
        y = np.array(self._dense(t)).reshape(self._y.shape)
        normalise(y, len(self._mechanism.bodies))
        return State(*unpack(self._mechanism, y))
