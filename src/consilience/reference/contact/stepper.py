"""Integration between events, step by step, with dense output; projection of states onto what lasts.

Steps are those of SciPy's Dormand-Prince 8(5,3); where the motion is stiff, of its Radau IIA of order 5. After each
step positions and velocities are projected, in the mass metric, onto the joints, the gaps of closed contacts and the
rates of sticking ones. Impulses of contacts and the energy that they lose are integrated along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, State
from consilience.reference.bodies.arrays import all_rows, holonomic_rows, pack, unpack
from consilience.reference.bodies.projection import normalise
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.response import Response
from consilience.reference.contact.row_modes import RowModes

_NUDGE = 1e-6
"""Step of difference quotients by velocities, over the slow slip."""


class Stepper:
    """Integrator of the motion between events.

    Attributes
    ----------
    t, started : float, s
        End and start of the last step.
    modes : RowModes
    slow : float, m/s
        Slip that makes the motion stiff, so that steps are implicit; zero where none does.
    counters : dict of str to int
        Accepted steps and evaluations of the derivative.

    The longest step, s, bounds how far event functions are looked at together.
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
        self._tolerance, self._longest = tolerance, longest
        self._turns = np.zeros(len(self._model.coordinate))
        self.counters = {"steps": 0, "evaluations": 0}
        y = pack(self._layout.smooth, state)
        self._shape, self._count = y.shape, y.size
        length, bodies = self._model.length, len(self._model.mass)
        contacts = len(self._layout.mechanism.contacts)
        weight = float(np.sum(self._model.mass)) * max(float(np.linalg.norm(self._model.gravity)), length)
        sizes = np.tile(np.repeat([length, 1.0, length, 1.0], [3, 4, 3, 3]), self._shape[0])
        extra = np.append(np.full(3 * contacts, weight), weight * length)
        self._absolute = tolerance * np.concatenate([sizes, extra])
        self._Y = np.concatenate([y.ravel(), np.zeros(3 * contacts + 1)])
        self._bodies, self.t, self.started = bodies, t, t
        self._h: float | None = None
        self.slow = 0.0
        self._pieces: list[tuple[float, Any]] = []
        equations.follow(self.y, self._turns)
        self._restart()

    def _restart(self) -> None:
        self._before = (self.t, self._Y.copy(), self._turns.copy())
        self._solver: Any = None

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
        """Impulses of the contacts on their bodies since the start, shape (n_c, 3), N s; a view."""
        return self._Y[self._count : -1].reshape(-1, 3)

    @property
    def loss(self) -> float:
        """Energy lost since the start, J."""
        return float(self._Y[-1])

    def state(self) -> State:
        """Return the state at the time t."""
        return State(*unpack(self._layout.smooth, self.y))

    def between(self, times: Array) -> Array:
        """Return packed states at times within the last step, shape (n, ...), by the interpolant."""
        states = self._interpolated(times)[:, : self._count].reshape(-1, *self._shape)
        for y in states:
            normalise(y, self._bodies)
        return states

    def _interpolated(self, times: Array) -> Array:
        """Return states at times within the last step, with impulses and loss, shape (n, ...)."""
        found = self._pieces[0][1](times).T.copy()
        for start, dense in self._pieces[1:]:
            found[times >= start] = dense(times[times >= start]).T
        return np.asarray(found)

    def sample(self, t: float) -> tuple[Array, Array, float, Array]:
        """Return state, impulses, loss and turns within the last step, projected as at its end."""
        if t == self.t:
            return self.y.copy(), self.impulse.copy(), self.loss, self.turns
        Y, turns = self._interpolated(np.array([t]))[0], self._turns.copy()
        y = Y[: self._count].reshape(self._shape)
        self._project(t, y, turns)
        return y, Y[self._count : -1].reshape(-1, 3), float(Y[-1]), turns

    def turn(self, heading: tuple[Array | None, ...]) -> None:
        """Continue with other headings of what slides."""
        self.modes = replace(self.modes, heading=heading)
        self.equations.turn(heading)

    def choose(self, force: Array) -> None:
        """Continue with forces near others, shape (m,), where the modes leave them undetermined."""
        self.equations.choose(force)
        if self._solver is not None:
            self._solver.f = self._derivative(self.t, self._Y)

    def forces(self) -> Array:
        """Return the forces on all rows at the time t, shape (m,)."""
        return self.equations.row_forces(self.t, self.y, self._turns)

    def place(self, velocity: Array, impulse: Array, loss: float) -> None:
        """Continue with other velocities (v, w'), shape (6 n_b,), and what an impact adds to impulses and loss."""
        self._Y = self._Y.copy()
        self.y[: self._bodies, 7:13] = velocity.reshape(-1, 6)
        self.impulse[...] += impulse
        self._Y[-1] += loss
        self._restart()

    def halt(self, rows: Sequence[int]) -> None:
        """Continue with these rows at rest."""
        self._Y = self._Y.copy()
        Q, _, rate = self.equations.joint_rows(self.t, self.y, self._turns)
        self.equations.move(self.t, self.y, self._turns)
        self._project_velocity(self.y, (Q, rate), rows)
        self._restart()

    def change_modes(self, modes: RowModes, halted: Sequence[int] = ()) -> None:
        """Continue in other modes, from the state projected onto what lasts in them, and onto rows that have halted."""
        self.modes = modes
        self.equations.activate(modes)
        self._Y = self._Y.copy()
        self._project(self.t, self.y, self._turns, halted)
        self._restart()

    # ------------------------------------------------------------------------------------------------------ steps

    def respond(self, t: float, y: Array) -> Response:
        """Evaluate rows and responses at a packed state near the last one."""
        return self.equations.respond(t, y, self._turns)

    def _derivative(self, t: float, Y: Array) -> Array:
        """Return ``dY/dt``."""
        self.counters["evaluations"] += 1
        return self.equations.rates(float(t), np.ascontiguousarray(Y), self._turns)

    def _jacobian(self, t: float, Y: Array) -> Array:
        """Return ``d(dY/dt)/dY`` by velocities, in which slow slip is stiff; Newton's method leaves out the rest."""
        rate, J, step = self._derivative(t, Y), np.zeros((Y.size, Y.size)), _NUDGE * self.slow
        for j in (13 * np.arange(self._bodies)[:, None] + np.arange(7, 13)).ravel():
            moved = Y.copy()
            moved[j] += step
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
        method, given = scipy.integrate.DOP853, dict[str, Any]()
        if self.slow:
            method, given = scipy.integrate.Radau, {"jac": self._jacobian}
        if not isinstance(self._solver, method) or self._solver.t_bound != bound:
            first = None if self._h is None else min(self._h, bound - self.t)
            self._solver = method(
                self._derivative,
                self.t,
                self._Y,
                bound,
                rtol=self._tolerance,
                atol=self._absolute,
                first_step=first,
                max_step=self._longest,
                **given,
            )
        solver = self._solver
        self._before = (self.t, self._Y, self._turns.copy())
        planned = solver.h_abs
        message = solver.step()
        if solver.status == "failed":
            raise NumericalFailure(f"reference with contacts, t = {solver.t:.12g} s: {message}")
        self.started, self.t = self._before[0], float(solver.t)
        self._Y = solver.y.copy()
        self._project(self.t, self.y, self._turns)
        solver.y = self._Y
        solver.f = self._derivative(solver.t, solver.y)
        self._h = max(solver.h_abs, planned) if solver.status == "finished" else solver.h_abs
        self._pieces = [(self.started, solver.dense_output())]
        self.counters["steps"] += 1

    def go_back_to(self, t: float, ended: Callable[[], object | None]) -> bool:
        """Repeat the last step so that it ends at t, between its start and its end; return whether it does.

        It ends before t where `ended` returns something: slip that has stopped has no direction to step on with.
        """
        start, Y, turns = self._before
        self.t, self._Y, self._turns, self._solver = start, Y.copy(), turns.copy(), None
        planned, self._h = self._h, t - start
        pieces: list[tuple[float, Any]] = []
        while self.t < t and not (pieces and ended() is not None):
            self.advance(t)
            pieces += self._pieces
        self._pieces, self._before, self.started, self._solver, self._h = (
            pieces,
            (start, Y, turns),
            start,
            None,
            planned,
        )
        return self.t == t

    # ------------------------------------------------------------------------------------------------- projection

    def _project(self, t: float, y: Array, turns: Array, halted: Sequence[int] = ()) -> None:
        """Project a state onto the joints, closed gaps, sticking and halted rows, in the mass metric; count turns."""
        inverse, n, holonomic = self.equations.inverse, self._bodies, holonomic_rows(self._model)
        normalise(y, n)
        closed = np.flatnonzero(self.modes.closed)
        normals = np.array(self._layout.normals, dtype=np.int64)[closed]
        if all_rows(self._model) or len(closed) or any(mode is not None for mode in self.modes.friction):
            for _ in range(4):
                Q, value, rate = self.equations.joint_rows(t, y, turns)
                rows = self.equations.move(t, y, turns)
                left = np.concatenate([value[:holonomic], rows.gap[self._layout.gaps[closed]]])
                if not len(left) or np.max(np.abs(left)) <= 2e-16 * max(1.0, self._model.length):
                    break
                step = least_change(inverse, np.vstack([Q[:holonomic], rows.J[normals]]), -left)[0]
                move_bodies(y, step.reshape(-1, 6))
            else:
                Q, _, rate = self.equations.joint_rows(t, y, turns)
                self.equations.move(t, y, turns)
            self._project_velocity(y, (Q, rate), halted)
        self.equations.follow(y, turns)

    def _held_rows(self) -> Array:
        """Return the rows of closed normals and of held friction at the last evaluated state."""
        J = self.equations.rows.J
        held = [J[[n for n, closed in zip(self._layout.normals, self.modes.closed, strict=True) if closed]]]
        for one, mode in zip(self._layout.friction, self.modes.friction, strict=True):
            if mode is not None and len(mode.held):
                held.append(mode.held @ J[list(one.rows)])
        return np.vstack(held)

    def _project_velocity(self, y: Array, joints: tuple[Array, Array], halted: Sequence[int]) -> None:
        """Project velocities onto rows of joints with their rates, and rows of contacts, evaluated at the positions."""
        Q, rate = joints
        if len(Q):
            self.equations.rank[0] = least_change(self.equations.inverse, Q, np.zeros(len(Q)))[1]
        held = np.vstack([self._held_rows(), self.equations.rows.J[list(halted)]])
        both, v = np.vstack([Q, held]), y[: self._bodies, 7:13].ravel()
        wanted = np.concatenate([rate, np.zeros(len(held))]) - both @ v
        y[: self._bodies, 7:13] += least_change(self.equations.inverse, both, wanted)[0].reshape(-1, 6)


def least_change(inverse: Array, rows: Array, wanted: Array) -> tuple[Array, int]:
    """Return the change of least M-norm with ``rows x = wanted``, and the rank of the rows."""
    U, singular, Vt = np.linalg.svd(inverse @ rows.T, full_matrices=False)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0])) if len(singular) else 0
    along = (Vt[:rank] @ wanted) / singular[:rank]
    return inverse.T @ (U[:, :rank] @ along), rank


def move_bodies(y: Array, step: Array) -> None:
    """Move all bodies by small steps (displacement, rotation vector in body axes), shape (n_b, 6)."""
    n = len(step)
    y[:n, 0:3] += step[:, :3]
    h, e = 0.5 * step[:, 3:], y[:n, 3:7].copy()
    y[:n, 3] -= np.sum(e[:, 1:] * h, axis=1)
    y[:n, 4:7] += e[:, :1] * h + np.cross(e[:, 1:], h)
    normalise(y, n)
