"""Integration between events, step by step, with dense output; projection of states onto what lasts.

Steps are those of Dormand-Prince 8(5,3), compiled (`steppers.explicit`). Where the motion is stiff they are those of
SciPy's Radau IIA of order 5; where reactions bound friction, which is not compiled, of its Dormand-Prince 8(5,3). After
each step positions and velocities are projected, in the mass metric, onto the joints, the gaps of closed contacts and
the rates of sticking ones. Impulses of contacts and the energy that they lose are integrated along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import Array, State
from consilience.reference.bodies.arrays import pack, unpack
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.march import QuietSteps
from consilience.reference.contact.quiet_steps import SHORTEST, STRAIGHT
from consilience.reference.contact.response import Response, SampledRows
from consilience.reference.contact.row_modes import RowModes
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.kernel.operation import BoundOperation
from consilience.reference.steppers.explicit import DOP853, explicit_arrays, step
from consilience.reference.steppers.motion import (
    ANGLE,
    ATTEMPT,
    DISTANCE,
    INTEGRAL,
    INTERPOLATE,
    PREPARE,
    SPEED,
    SPIN,
    Kernel,
    new_motion,
)

_NUDGE = 1e-6
"""Step of difference quotients by velocities, over the slow slip."""

_DRIFT = 30.0
"""Turn of a slip along a line that errors of the integration bring about, rad, over the tolerance."""

_MOST_PIECES = 50
"""Largest number of steps that repeat one: where a slip that turns makes them short, others are to follow."""

_KINDS = np.repeat([DISTANCE, ANGLE, SPEED, SPIN], [3, 4, 3, 3])
"""Kinds of the components of a packed body."""

_ODD = np.arange(7) % 2 == 1
"""Powers of the dense output of a step that are multiplied by what is left of it (`explicit.interpolate`)."""

_Dense = Callable[[Array], Array]
"""States within a step at times (n,), shape (n, n_z)."""


class SlipTurns(NumericalFailure):
    """Slip turns, or stops, within what steps resolve."""


class Stepper:
    """Integrator of the motion between events.

    Attributes
    ----------
    t, started : float, s
        End and start of the last step.
    modes : RowModes
    longest : float, s
        Bound on the steps, over which event functions are looked at together.
    straight : float, rad
        Turn of a slip up to which it has kept to its line.
    fresh : bool
        Whether no compiled step has been taken in the present modes.
    slow : float, m/s
        Slip that makes the motion stiff, so that steps are implicit; zero where none does.
    drifts : bool
        Whether the forces that are chosen where the modes leave them open change along the last step.
    counters : dict of str to int
        Accepted steps and evaluations of the derivative.
    """

    def __init__(
        self,
        equations: ContactEquations,
        state: State,
        t: float,
        tolerance: float,
        modes: RowModes,
        longest: float = np.inf,
    ) -> None:
        self.equations, self.modes = equations, modes
        self._layout, self._model = equations.layout, equations.model
        self._tolerance, self.longest, self.straight = tolerance, longest, max(STRAIGHT, _DRIFT * tolerance)
        self._turns = np.zeros(len(self._model.coordinate))
        self.counters = {"steps": 0, "evaluations": 0}
        y = pack(self._layout.smooth, state)
        self._shape, self._count = y.shape, y.size
        bodies, length = len(self._model.mass), self._model.length
        self._pushed = slice(y.size, y.size + 3 * len(self._layout.mechanism.contacts))
        extra = y.size - 13 * bodies + self._layout.sums
        kind = np.concatenate([np.tile(_KINDS, bodies), np.full(extra, INTEGRAL)])
        self._absolute = tolerance * np.where(kind == DISTANCE, length, np.where(kind == SPEED, length, 1.0))
        self._motion = new_motion(kind, length, equations.kernel)
        self._arrays = record_of(explicit_arrays(DOP853, self._motion))
        self._explicit = BoundOperation(step, self._arrays)
        self._motion.run[0]["tolerance"] = tolerance
        self._Y = np.concatenate([y.ravel(), np.zeros(self._layout.sums)])
        self._bodies, self.t, self.started = bodies, t, t
        self._h, self.fresh = 0.0, True
        self.slow, self.drifts, self._chosen = 0.0, False, np.zeros(len(self._layout.names))
        self._pieces: list[tuple[float, _Dense]] = []
        equations.follow(self.y, self._turns)
        self._restart()

    def _restart(self) -> None:
        self._before = (self.t, self._Y.copy(), self._turns.copy())
        self._forget()

    def _forget(self) -> None:
        """Forget the derivative at the time t: the equations have changed, or the state."""
        self._solver: Any = None
        self._arrays.stiffness[0]["knows_end"] = 0

    # ------------------------------------------------------------------------------------------------------ states

    @property
    def y(self) -> Array:
        """Packed state at the time t, a view."""
        return self._Y[: self._count].reshape(self._shape)

    @property
    def turns(self) -> Array:
        """Joint coordinates that are read, full turns counted, at the time t."""
        return self._turns

    @property
    def impulse(self) -> Array:
        """Impulses of the contacts on their bodies since the start, shape (n_c, 3), N s."""
        return self.equations.sums[0] * self._Y[self._pushed].reshape(-1, 3)

    @property
    def loss(self) -> float:
        """Energy lost since the start, J."""
        return float(self.equations.sums[1] * self._Y[-1])

    def state(self) -> State:
        """Return the state at the time t."""
        return State(*unpack(self._layout.smooth, self.y))

    def between(self, times: Array) -> Array:
        """Return packed states at times within the last step, shape (n, ...), by the interpolant; not normalised."""
        return self._interpolated(times)[:, : self._count].reshape(-1, *self._shape)

    def _interpolated(self, times: Array) -> Array:
        """Return states at times within the last step, with impulses and loss, shape (n, ...)."""
        found = self._pieces[0][1](times)
        for start, dense in self._pieces[1:]:
            found[times >= start] = dense(times[times >= start])
        return found

    def sample(self, times: Array) -> tuple[SampledRows, Array]:
        """Return samples at times (n,) within the last step, or at its end, with impulses and losses in their units.

        They are projected as at the end of a step; what is summed over time has the shape (n, `RowLayout.sums`).
        """
        Y = self._Y[None].repeat(len(times), axis=0)
        if np.any(times < self.t):
            Y[times < self.t] = self._interpolated(times[times < self.t])
        rows = self.equations.sample(times, Y[:, : self._count].reshape(-1, *self._shape), self._turns)
        return rows, Y[:, self._count :]

    def turn(self, heading: tuple[Array | None, ...]) -> None:
        """Continue with other headings of what slides."""
        self.modes = replace(self.modes, heading=heading)
        self.equations.turn(heading)

    def choose(self, force: Array) -> None:
        """Continue with forces near others, shape (m,), where the modes leave them undetermined."""
        self._chosen, self.drifts = force, False
        self.equations.choose(self.t, force)
        self._forget()

    def choose_along(self, force: Array) -> None:
        """Repeat the last step with forces that go to others at its end, shape (m,), along with the time."""
        self.equations.choose(self.t, force, (force - self._chosen) / (self.t - self.started))
        self.drifts = True
        self.go_back_to(self.t, lambda: False)

    def forces(self) -> Array:
        """Return the forces on all rows at the time t, shape (m,)."""
        return self.equations.row_forces(self.t, self.y, self._turns)

    def place(self, y: Array, impulse: Array, loss: float) -> None:
        """Continue from another packed state, and with what an impact adds to impulses and loss."""
        self._Y = self._Y.copy()
        self.y[:] = y
        self._Y[self._pushed] += impulse.ravel() / self.equations.sums[0]
        self._Y[-1] += loss / self.equations.sums[1]
        self._restart()

    def step_by(self, h: float, impulse: Array, response: Response) -> None:
        """Take a step of Euler's method, with impulses on all rows, shape (m,), in place of the forces of the modes."""
        t, Y, force = self.t, self._Y, self.forces()
        u, end = self.equations.rows.u.copy(), Y + h * self._derivative(t, Y)
        instead = impulse - h * force
        more, mean = response.K.T @ instead, u + 0.5 * h * response.accelerations(impulse / h)
        end[: self._count].reshape(self._shape)[: self._bodies, 7:] += (self.equations.inverse.T @ more).reshape(-1, 6)
        end[self._pushed] += (self.contact_forces(instead) / self.equations.sums[0]).ravel()
        end[-1] = Y[-1] - impulse @ mean / self.equations.sums[1]
        self.t, self.started, self._Y = t + h, t, end
        self._pieces = [(t, lambda times: Y + ((times - t) / h)[:, None] * (end - Y))]
        self.equations.project(self.t, end, self._turns)
        self._restart()

    def halt(self, rows: Sequence[int]) -> None:
        """Continue with these rows at rest."""
        self._Y = self._Y.copy()
        self.equations.project(self.t, self._Y, self._turns, rows)
        self._restart()

    def change_modes(self, modes: RowModes, halted: Sequence[int] = ()) -> None:
        """Continue in other modes, from the state projected onto what lasts in them, and onto rows that have halted."""
        self.modes, self.drifts, self._chosen = modes, False, np.zeros(len(self._layout.names))
        self.fresh = True
        self.equations.activate(modes)
        self._Y = self._Y.copy()
        self.equations.project(self.t, self._Y, self._turns, halted)
        self._restart()

    # ------------------------------------------------------------------------------------------------------ steps

    def respond(self, t: float, y: Array) -> Response:
        """Evaluate rows and responses at a packed state near the last one."""
        return self.equations.respond(t, y, self._turns)

    def quiet_steps(self, times: Array, length: float, span: float, flat: float) -> QuietSteps:
        """Return the march of a motion: samples (n_t,), length of the mechanism, span of the motion, `Rims.least`."""
        stepper = Kernel(*self._explicit.addresses)
        return QuietSteps(
            self.equations, self._arrays, stepper, times, (length, span, self.longest, self.straight, flat)
        )

    def _derivative(self, t: float, Y: Array) -> Array:
        """Return ``dY/dt``."""
        self.counters["evaluations"] += 1
        return self.equations.rates(float(t), np.ascontiguousarray(Y), self._turns)

    def _jacobian(self, t: float, Y: Array) -> Array:
        """Return ``d(dY/dt)/dY`` by velocities, in which slow slip is stiff; Newton's method leaves out the rest."""
        rate, J, step = self._derivative(t, Y), np.zeros((Y.size, Y.size)), _NUDGE * self.slow
        for j in (13 * np.arange(self._bodies)[:, None] + np.arange(7, 13)).ravel():
            moved = Y.copy()
            moved[j] += max(step, 8.0 * np.spacing(abs(Y[j])))
            J[:, j] = (self._derivative(t, moved) - rate) / (moved[j] - Y[j])
        return J

    def contact_forces(self, force: Array) -> Array:
        """Return the forces of the declared contacts from those on all rows, world axes, shape (n_c, 3)."""
        layout = self._layout
        found = np.zeros((len(layout.mechanism.contacts), 3))
        for k in range(len(layout.parts)):
            found[layout.site[3 * k]] += force[3 * k : 3 * k + 3] @ self.equations.rows.frame[k]
        return found

    def advance(self, bound: float) -> None:
        """Take one accepted step, at most to the time `bound`.

        Raises
        ------
        NumericalFailure
            If the step size falls below the resolution of the time.
        """
        self._before = (self.t, self._Y, self._turns.copy())
        dense = self._by_scipy(bound) if self.slow or self.equations.reacting else self._by_kernel(bound)
        self.started = self._before[0]
        self._pieces = [(self.started, dense)]
        self.counters["steps"] += 1

    def march(self, quiet: QuietSteps, bound: float, speed: float, recorded: int) -> float:
        """Take the steps in which nothing happens, at most to the time `bound`; return the speed of the mechanism."""
        run, now, Y = self._motion.run[0], quiet.now[0], self._Y.copy()
        steps, evaluations = int(run["steps"]), int(run["evaluations"])
        now["bound"], now["h"], now["fresh"], now["speed"] = bound, self._h, self.fresh, speed
        self.equations.march(self._turns)
        t, self.t = self.t, quiet.march(self.t, Y, self._turns, recorded)
        self._Y, self._h, self.fresh = Y, float(now["h"]), bool(now["fresh"])
        self._solver = self._solver if self.t == t else None
        self.counters["steps"] += int(run["steps"]) - steps
        self.counters["evaluations"] += int(run["evaluations"]) - evaluations
        return float(now["speed"])

    def _by_kernel(self, bound: float) -> _Dense:
        """Take a step of the compiled pair; return its dense output."""
        start, t, run = self._Y, self.t, self._motion.run[0]
        end, ask = start.copy(), self._explicit
        run["t"], run["span"], run["most"] = t, bound - t, np.inf
        run["h"] = 0.0 if self.fresh else self._h  # zero: a first step is proposed
        evaluations = int(run["evaluations"])
        self.equations.turns[:] = self._turns
        ask(PREPARE, t, start, end)
        planned, self.fresh = max(float(run["h"]), self._h), False
        run["h"] = planned
        while True:
            left, h = bound - t, min(float(run["h"]), self.longest)
            h = left if h >= left else min(h, 0.5 * left)
            run["step"] = h
            accepted = ask(ATTEMPT, t, start, end) <= 1.0
            run["h"] = h * float(run["factor"])
            if accepted:
                break
            run["rejected"] += 1
            run["most"] = 1.0
            if not run["h"] >= SHORTEST * max(1.0, abs(t)):
                what = "steps fall below what the time resolves"
                raise NumericalFailure(f"reference with contacts, t = {t:.12g} s: {what}")
        run["steps"] += 1
        self.t, self._Y = bound if h == left else t + h, end
        self.equations.project(self.t, end, self._turns)
        ask(INTERPOLATE, t, start, end)
        self._h, self._solver = max(float(run["h"]), planned) if h == left else float(run["h"]), None
        self.counters["evaluations"] += int(run["evaluations"]) - evaluations
        F = self._arrays.F.copy()

        def dense(times: Array) -> Array:
            x = ((times - t) / h)[:, None]
            return start + np.cumprod(np.where(_ODD, 1.0 - x, x), axis=1) @ F

        return dense

    def _by_scipy(self, bound: float) -> _Dense:
        """Take a step of an integrator of SciPy; return its dense output."""
        method, given = scipy.integrate.DOP853, dict[str, Any]()
        if self.slow:
            method, given = scipy.integrate.Radau, {"jac": self._jacobian}
        if not isinstance(self._solver, method) or self._solver.t_bound != bound:
            self._solver = method(
                self._derivative,
                self.t,
                self._Y,
                bound,
                rtol=self._tolerance,
                atol=self._absolute,
                first_step=min(self._h, bound - self.t) if self._h else None,
                max_step=self.longest,
                **given,
            )
        solver = self._solver
        planned = solver.h_abs
        solver.step()
        if solver.status == "failed":
            what = "steps fall below what the time resolves: slip turns too fast"
            raise SlipTurns(f"reference with contacts, t = {solver.t:.12g} s: {what}")
        self.t, self._Y = float(solver.t), solver.y.copy()
        self.equations.project(self.t, self._Y, self._turns)
        solver.y = self._Y
        solver.f = self._derivative(solver.t, solver.y)
        self._h = max(solver.h_abs, planned) if solver.status == "finished" else solver.h_abs
        self._arrays.stiffness[0]["knows_end"] = 0
        dense = solver.dense_output()
        return lambda times: dense(times).T.copy()

    def shorten(self, t: float, ends: Callable[[], bool]) -> None:
        """Repeat the last step so that it ends at t, within it (see `go_back_to`).

        Raises
        ------
        NumericalFailure
            If the time resolves no such end.
        """
        if not self.started < t < self.t:
            what = "steps would have to end within what the time resolves: slip turns too fast"
            self.t, self._Y, self._turns = self._before
            self._restart()
            raise SlipTurns(f"reference with contacts, t = {t:.12g} s: {what}")
        self.go_back_to(t, ends)

    def go_back_to(self, t: float, ends: Callable[[], bool]) -> bool:
        """Repeat the last step so that it ends at t, between its start and its end; return whether it does.

        It ends before t where `ends` says so: slip that has stopped, or turned, has no direction to step on with.
        """
        start, Y, turns = self._before
        self.t, self._Y, self._turns = start, Y.copy(), turns.copy()
        self._forget()
        planned, self._h = self._h, t - start
        pieces: list[tuple[float, _Dense]] = []
        while self.t < t and len(pieces) < _MOST_PIECES and not (pieces and ends()):
            self.advance(t)
            pieces += self._pieces
        self._pieces, self._before, self.started = pieces, (start, Y, turns), start
        self._solver, self._h = None, planned
        return self.t == t
