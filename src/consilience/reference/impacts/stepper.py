"""Integration between impacts with dense output, and constraint rows at a state, by the compiled kernels.

Steps are those of SciPy's Dormand-Prince 8(5,3); after each step positions and velocities are projected onto the
constraints, and the interpolant connects the projected ends.
"""

from __future__ import annotations

import numpy as np
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import Array, Mechanism, State
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import Model, flatten, pack, unpack, workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.projection import normalise, project
from consilience.reference.formulations.compiled_choice import FORMULATIONS, derivative


def constraint_rows(mechanism: Mechanism, state: State, t: float, turns: Array | None) -> tuple[Model, Array, Array]:
    """Return model, packed state (n_b, 13), and Jacobian Q (q, 6 n_b) of all rows.

    Parameters
    ----------
    turns : ndarray, shape (n_c,), or None
        Joint coordinates that elements read, full turns counted; None: angles within half a turn of zero.
    """
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    if turns is None:
        turns = np.zeros(len(model.coordinate))
    count_turns(model, y, ws, turns)
    rotations(y, ws.A)
    constraints.evaluate(model, t, y, turns, ws)
    return model, y[: len(mechanism.bodies)], ws.Q


class Stepper:
    """Integrator of the motion between impacts, step by step.

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
        """Continue from another state, for example after an impact."""
        self.t = self.started = t
        y, count = pack(self._mechanism, state), len(self._mechanism.bodies)
        y[count:] = self._y[count:]  # integrals of controllers are continuous
        self._y = y
        count_turns(self._model, self._y, self._ws, self._turns)
        self._before = (t, self._y.copy(), self._turns.copy())
        self._solver: scipy.integrate.DOP853 | None = None
        self._h: float | None = None

    def _derivative(self, t: float, y: Array) -> Array:
        """Return ``dy/dt``, flat."""
        dy = np.zeros_like(self._y)
        y = np.ascontiguousarray(y).reshape(dy.shape)
        derivative(FORMULATIONS["descriptor"], self._model, float(t), y, self._turns, self._ws, self._a, dy)
        self.counters["evaluations"] += 1
        return dy.ravel()

    def advance(self, bound: float) -> None:
        """Take one accepted step, at most to the time `bound`.

        Raises
        ------
        NumericalFailure
            If the step size falls below the resolution of the time.
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
        """Repeat the last step so that it ends at t, between its start and its end."""
        start, y, turns = self._before
        self.t, self._y, self._turns, self._solver = start, y.copy(), turns.copy(), None
        while self.t < t:
            self.advance(t)
        self._before, self.started = (start, y, turns), start
        self._solver = None

    @property
    def turns(self) -> Array:
        """Joint coordinates that elements read, full turns counted, at the time t."""
        return self._turns.copy()

    def state(self) -> State:
        """Return the state at the time t."""
        return State(*unpack(self._mechanism, self._y))

    def between(self, t: float) -> State:
        """Return a state within the last step by the interpolant of order 7."""
        y = np.array(self._dense(t)).reshape(self._y.shape)
        normalise(y, len(self._mechanism.bodies))
        return State(*unpack(self._mechanism, y))
