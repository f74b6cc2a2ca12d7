"""Motion with contacts by time stepping at velocity level: the second formulation, which bounds the first.

The scheme of Moreau (1988) and Jean (1999), with the midpoint ``q_m = q + h v / 2``, projected onto the joints. Rows
whose gap is closed at q_m take part in one problem for the impulses p of a step of length h,

    M (v+ - v) = h f + Q^T Lam + J^T p,     Q v+ = nu,     u+ = J v+,
    0 <= p_n _|_ u_n+ + e u_n >= 0,         p_t = prox_{mu p_n D}(p_t - r u_t+),         q+ = q + h (v + v+) / 2,

with f, Q and J at q_m. It knows no modes, no accelerations of contacts, no events and no headings: impacts, sliding and
sticking are the same problem. Its impacts are Moreau's (`impulse`): e is zero of what approaches no faster than the
forces of one step make it, and where friction jams under the rebound; a row that parts faster takes no part. Errors
are of order one in h; between impacts they have an expansion in h, and an impact comes at a random place within a step.

The problem is solved by successive projections (`projections`). Where they converge slowly, a search for modes takes
their place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State
from consilience.reference.bodies.arrays import all_rows, holonomic_rows, pack, unpack
from consilience.reference.bodies.projection import normalise
from consilience.reference.contact.decision import decide
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.joint_friction import with_offsets
from consilience.reference.contact.layout import layout_of
from consilience.reference.contact.projections import PATIENT_SWEEPS, SWEEPS, friction_table, project_impulses
from consilience.reference.contact.response import HELD, Response
from consilience.reference.contact.search import JammedFriction

_PROJECTIONS = 2
_CLOSED = 1e-13
"""Gap of a closed contact, over the length of the mechanism."""

_PARTS = 1e-9
"""Rate, over the largest, from which a closed contact parts."""


@dataclass(frozen=True, eq=False)
class SteppedMotion:
    """Motion by time stepping, canonical, at the samples.

    Attributes
    ----------
    p_WB, quat_WB, v_WB_W, w_WB_W : ndarray, shape (n_t, n_b, 3 or 4)
    impulse : ndarray, shape (n_t, m)
        Impulses on all rows since the start.
    """

    p_WB: Array
    quat_WB: Array
    v_WB_W: Array
    w_WB_W: Array
    impulse: Array


def step_with_contacts(mechanism: Mechanism, state: State, times: Array, steps: int) -> SteppedMotion:
    """Step a mechanism with contacts, stops and dry friction.

    Parameters
    ----------
    mechanism : Mechanism
        No controllers; no friction that a reaction bounds.
    state : State
        Consistent state at ``times[0]``.
    times : ndarray, shape (n_t,), s
    steps : int
        Steps between two samples.

    Raises
    ------
    NumericalFailure
        If no impulses satisfy the laws in a step.
    """
    scheme = _Scheme(mechanism, state)
    states, impulses = [scheme.y.copy()], [scheme.impulse.copy()]
    for start, end in pairwise(times.tolist()):
        for k in range(steps):
            scheme.step(start + (end - start) * k / steps, (end - start) / steps)
        states.append(scheme.y.copy())
        impulses.append(scheme.impulse.copy())
    return SteppedMotion(*unpack(scheme.equations.layout.smooth, np.array(states)), np.array(impulses))


class _Scheme:
    """State of a motion by time stepping."""

    def __init__(self, mechanism: Mechanism, state: State) -> None:
        self.equations = ContactEquations(layout_of(mechanism))
        layout, self._model = self.equations.layout, self.equations.model
        self.y, self.bodies = pack(layout.smooth, state), len(mechanism.bodies)
        self.impulse, self._p = np.zeros(len(layout.names)), np.zeros(len(layout.names))
        self._turns = np.zeros(len(self._model.coordinate))
        self.equations.follow(self.y, self._turns)
        self._normals, self._law = (
            np.array(layout.normals, dtype=np.int64),
            friction_table(layout.friction, layout.normals),
        )
        self._rests = np.zeros(len(layout.normals), dtype=bool)  # what lasts, whatever gap rounding and drift leave it

    def step(self, t: float, h: float) -> None:
        """Take one step from the time t."""
        equations, y = self.equations, self.y
        middle = y.copy()
        velocity = y[: self.bodies, 7:13].copy()
        _move_bodies(middle, 0.5 * h * velocity)
        self._project(t + 0.5 * h, middle)
        equations.move(t + 0.5 * h, middle, self._turns)
        equations.press(0.0)
        response = equations.respond(t + 0.5 * h, middle, self._turns)
        free, after = equations.free_velocities(response, velocity.ravel(), h)
        held = np.linalg.norm(response.K, axis=1) <= HELD * np.linalg.norm(response.load, axis=0)
        response = replace(response, K=np.where(held[:, None], 0.0, response.K))
        free[held] = 0.0
        rows, layout = equations.rows, equations.layout
        before = equations.free_velocities(response, velocity.ravel(), 0.0)[0][self._normals]
        made = np.abs(free[self._normals] - before)  # by the forces of one step: beyond it, what approaches strikes
        touches = (rows.gap[layout.gaps] <= _CLOSED * self._model.length) | self._rests
        closed = touches & (before <= made)
        rebound = np.zeros(len(free))
        rebound[self._normals] = np.where(before < -made, layout.rebounds(-before) * before, 0.0)
        act = np.zeros(len(free), dtype=np.bool_)
        act[self._normals[closed]] = True
        try:
            p = self._impulses(response, free + rebound, h * equations.offsets, act, closed)
        except JammedFriction:  # under the rebound; there are impulses without it
            if not np.any(rebound):
                raise
            p = self._impulses(response, free, h * equations.offsets, act, closed)
        after_rows = free + response.K @ (response.K.T @ p)
        parts = after_rows[self._normals] > _PARTS * float(np.max(np.abs(free), initial=0.0))
        self._rests = closed & ~parts
        self._p, self.impulse = p, self.impulse + p + h * response.given
        y[: self.bodies, 7:13] = (after + equations.inverse.T @ (response.K.T @ p)).reshape(-1, 6)
        _move_bodies(y, 0.5 * h * (velocity + y[: self.bodies, 7:13]))
        self._project(t + h, y)
        equations.follow(y, self._turns)

    def _impulses(self, response: Response, free: Array, offsets: Array, act: Array, closed: Array) -> Array:
        """Return the impulses of a step."""
        G, p = response.K @ response.K.T, np.where(act, self._p, 0.0)
        if project_impulses(G, free, self._law, offsets, act, SWEEPS, p):
            return p
        try:
            if not any(one.associated for one in self.equations.layout.friction):
                return self._decided(response, free, offsets, closed)
        except NumericalFailure:
            if not project_impulses(G, free, self._law, offsets, act, PATIENT_SWEEPS, p):
                raise
            return p
        if not project_impulses(G, free, self._law, offsets, act, PATIENT_SWEEPS, p):
            raise NumericalFailure("time stepping with associated cones: the projections of a step do not converge")
        return p

    def _decided(self, response: Response, free: Array, offsets: Array, closed: Array) -> Array:
        """Return the impulses of a step that satisfy the laws as inclusions, by a search for modes (`decide`)."""
        size = float(np.sqrt(2.0 * self.equations.energy(self.y)))
        given = replace(response, free=free, pull=size)
        problem, rows, sets = self.equations.problem(given, closed, np.zeros(len(free)))
        p = np.zeros(len(free))
        p[rows] = decide(with_offsets(problem, {k: float(offsets[j]) for k, j in enumerate(sets)})).force
        return p

    def _project(self, t: float, y: Array) -> None:
        """Project positions onto the joints: off them, joints let contacts of their bodies move that they hold."""
        equations = self.equations
        holonomic = holonomic_rows(self._model)
        for _ in range(_PROJECTIONS if all_rows(self._model) else 0):
            Q, value, _ = equations.joint_rows(t, y, self._turns)
            change, _ = _least_change(equations.inverse, Q[:holonomic], -value[:holonomic])
            _move_bodies(y, change.reshape(-1, 6))
            equations.rank[0] = _least_change(equations.inverse, Q, np.zeros(len(Q)))[1]


def _least_change(inverse: Array, rows: Array, wanted: Array) -> tuple[Array, int]:
    """Return the change of least M-norm with ``rows x = wanted``, and the rank of the rows."""
    U, singular, Vt = np.linalg.svd(inverse @ rows.T, full_matrices=False)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0])) if len(singular) else 0
    along = (Vt[:rank] @ wanted) / singular[:rank]
    return inverse.T @ (U[:, :rank] @ along), rank


def _move_bodies(y: Array, step: Array) -> None:
    """Move all bodies by small steps (displacement, rotation vector in body axes), shape (n_b, 6)."""
    n = len(step)
    y[:n, 0:3] += step[:, :3]
    h, e = 0.5 * step[:, 3:], y[:n, 3:7].copy()
    y[:n, 3] -= np.sum(e[:, 1:] * h, axis=1)
    y[:n, 4:7] += e[:, :1] * h + np.cross(e[:, 1:], h)
    normalise(y, n)
