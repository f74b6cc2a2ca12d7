"""Instants with closed contacts, stops and dry friction.

MuJoCo's rows have no velocity terms of contacts, its friction opposes ``a_t + b v_t``, and its cone is associated:
where it is hard, ``a_n = mu |a_t + b v_t|``. Here the callback writes `efc_aref` of these rows. A is the inverse
inertia along the normal of a contact, R its regularisation, gamma that of ``u' = J a + gamma``:

======  ==============  ====================================  ====================
state   R               aref of the normal                    aref of the tangents
======  ==============  ====================================  ====================
sticks  `HARD` times A  ``-gamma_n + R f_n``                  ``-gamma_t + R f_t``
slides  `SOFT` times A  ``R p - mu B``, so that p is about    ``-gamma_t - B d``
                        the normal force
======  ==============  ====================================  ====================

With the forces f of the evaluation before, ``u' = 0`` holds after some evaluations whatever R; the same is done for
stops, for dry friction that sticks, and for the constraints of joints, which then need no extreme stiffness. Sliding is
along d; B is so large that friction is along -d. The unknowns p are found by Newton's method from the condition
``g'' = 0``. A contact without friction sticks in this sense. One that would stick but reaches its cone starts to slide:
its direction is another unknown, with the condition that ``u_t'`` is along d. One that would pull is opened, and closed
again if the shapes would overlap once others have opened or slide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from consilience.mechanism import TOUCHING, Array, State, characteristic_length, nearest_points
from consilience_mujoco.callback import answering
from consilience_mujoco.contacts import Touch, set_inverse_inertia
from consilience_mujoco.evaluate import mass_matrix
from consilience_mujoco.messages import EngineWarningError
from consilience_mujoco.translate import Translation

HARD, SOFT = 1e-6, 1e12
"""Regularisation over the inverse inertia of a contact that sticks, and of one that slides."""

_HELD = 1e-12
"""Inverse inertia along a normal, over that of all bodies, up to which joints hold its gap."""

_GUESS = 10.0
"""First guess of a normal force times the inverse inertia, m/s^2."""

_PULL = 100.0
"""B over ``R p``: friction is along the direction of sliding to ``a / B``."""

_AT_REST = 1e-9
"""Velocity in m/s or rad/s below which a contact sticks; the same of a coordinate with dry friction."""

_FAST = 1e12
"""Reference acceleration of dry friction that slides: MuJoCo limits its effort to the bound."""

_EVALUATIONS = 3
"""Evaluations with the forces of the one before: errors of `HARD` to this power."""

_MARGIN, _NEVER = 1e-6, -1.0
"""Margin in m of a closed contact (MuJoCo makes no row of a distance of zero), and of an open one."""

_PASSES, _NEWTON = 20, 12
"""Largest number of changes of states, and of steps of Newton's method."""

_SETTLED, _ACCEPTED = 1e-13, 1e-8
"""Gap accelerations, over the largest acceleration of the contacts, at which Newton's method ends, and is refused."""

_ON_CONE, _MOVES = 1e-9, 1e-5
"""Relative distance to the cone, and acceleration over the largest one, at which a contact starts to slide: of several
contacts that stick together one may be on its cone and stay."""


@dataclass(eq=False)
class _Closed:
    """A closed contact.

    Attributes
    ----------
    touch : Touch
    J, gamma, normal, n_dot : ndarray
        Terms of ``u' = J a + gamma``, the normal and its rate, in world axes.
    A : float
        Inverse inertia along the normal.
    slip : ndarray, shape (3,), or None
        Direction of sliding; None where the contact sticks.
    starts : bool
        It is at rest and starts to slide.
    p : float
        Normal force of a contact that slides, N.
    place : int
        First row of the contact in MuJoCo's arrays.
    frame : ndarray, shape (3, 3)
        Normal and tangents of MuJoCo's rows for the velocity of `body`.
    """

    touch: Touch
    J: Array
    gamma: Array
    normal: Array
    n_dot: Array
    A: float
    slip: Array | None = None
    starts: bool = False
    p: float = 0.0
    place: int = -1
    frame: Array = field(default_factory=lambda: np.eye(3))

    def rates(self, data: Any, u: Array) -> tuple[float, float]:
        """Return ``g''``, and ``u_t'`` across the direction of sliding, of evaluated data; u is the velocity."""
        acceleration = self.J @ data.qacc + self.gamma
        across = 0.0 if self.slip is None else float(np.cross(self.normal, self.slip) @ acceleration)
        return float(self.normal @ acceleration + self.n_dot @ u), across


def _move(c: _Closed, turn: bool, step: float) -> None:
    """Change the direction of sliding by an angle in rad, or else the normal force, in N."""
    if turn and c.slip is not None:
        c.slip = np.cos(step) * c.slip + np.sin(step) * np.cross(c.normal, c.slip)
    else:
        c.p += step


class ContactInstant:
    """Solver of instants with closed contacts, stops or dry friction, for one translation with its own model."""

    def __init__(self, translation: Translation) -> None:
        self.translation = translation
        self._slack = TOUCHING * characteristic_length(translation.mechanism)
        self._closed: list[_Closed] = []
        self._opened: list[_Closed] = []
        self._before = np.zeros(0)

    def solve(self, state: State) -> Array:
        """Evaluate the data, which hold the state, and return the forces of all contacts on `body`, shape (n_c, 3).

        Raises
        ------
        EngineWarningError
            A contact or stop closes with a velocity, or no states of the contacts are consistent.
        """
        self._find_closed(state)
        self._mark_limits()
        for _ in range(_PASSES):
            self._balance()
            if not self._changed():
                self._check_started()
                return self._forces()
        raise EngineWarningError(f"the states of the contacts do not settle in {_PASSES} passes")

    def normal_forces(self) -> dict[int, float]:
        """Return the normal force in N of every closed contact of the last instant, by its pair."""
        return {c.touch.pair: float(self.translation.data.efc_force[c.place]) for c in self._closed}

    def _find_closed(self, state: State) -> None:
        """Find the contacts that are closed and do not separate."""
        t = self.translation
        model, data = t.model, t.data
        model.pair_margin[:] = model.jnt_margin[:] = _NEVER
        with answering(t):
            mujoco.mj_forward(model, data)
        M, self._closed, self._opened = mass_matrix(model, data), [], []
        for touch in t.touches:
            nearest = nearest_points(t.mechanism, state, touch.part)
            J, n = touch.jacobian(model, data), nearest.normal
            u = touch.velocity(model, data)
            rate = float(n @ u)
            if nearest.gap > self._slack or rate > _AT_REST:
                continue
            if rate < -_AT_REST:
                raise EngineWarningError(f"contact '{touch.part.name}' closes at {-rate:.3g} m/s: that is an impact")
            A = float(n @ J @ np.linalg.solve(M, n @ J))
            if _HELD / float(np.sum(model.body_mass)) >= A:
                continue  # the joints hold its gap: its force is open, and moves nothing
            u = u - rate * n
            slides = touch.part.friction > 0.0 and np.linalg.norm(u) > _AT_REST
            slip = u / np.linalg.norm(u) if slides else None
            self._closed.append(_Closed(touch, J, *touch.convection(model, data), A, slip, p=_GUESS / A))
            model.pair_margin[touch.pair] = _MARGIN

    def _mark_limits(self) -> None:
        """Activate the limits of joints at a stop that do not separate."""
        t = self.translation
        for limit in t.limits:
            low, high = t.model.jnt_range[limit.joint]
            q, rate = float(t.data.qpos[limit.qpos]), float(t.data.qvel[limit.dof])
            for room, opening in ((q - low, rate), (high - q, -rate)):
                if room <= self._slack and opening <= _AT_REST:
                    if opening < -_AT_REST:
                        name = t.model.joint(limit.joint).name
                        raise EngineWarningError(
                            f"a stop of joint '{name}' is hit at {-opening:.3g}: that is an impact"
                        )
                    t.model.jnt_margin[limit.joint] = _MARGIN

    def _balance(self) -> None:
        """Find normal forces and directions of the contacts that slide, and leave the data at the solution."""
        unknown = [
            (c, turn) for c in self._closed if c.slip is not None for turn in ((False, True) if c.starts else (False,))
        ]
        residual = self._evaluate(unknown)
        for n in range(_NEWTON):
            scale = max(1.0, float(np.max(np.abs(self.translation.data.qacc), initial=0.0)))
            size = float(np.max(np.abs(residual), initial=0.0)) / scale
            if size <= _SETTLED or (n >= _NEWTON // 2 and size <= _ACCEPTED):
                return
            slopes = np.empty((len(unknown), len(unknown)))
            for column, (c, turn) in zip(slopes.T, unknown, strict=True):
                kept, step = (c.p, c.slip), 1e-3 * (1.0 if turn else c.p)
                _move(c, turn, step)
                column[:] = (self._evaluate(unknown) - residual) / step
                c.p, c.slip = kept
            change = np.linalg.lstsq(slopes, residual, rcond=1e-9)[0]
            for (c, turn), step in zip(unknown, change, strict=True):
                _move(c, turn, -step)
            if any(c.p <= 0.0 for c, _ in unknown):
                return
            residual = self._evaluate(unknown)
        raise EngineWarningError(f"accelerations of contacts stay at {np.max(np.abs(residual)):.1e} m/s^2")

    def _evaluate(self, unknown: Sequence[tuple[_Closed, bool]]) -> Array:
        """Evaluate MuJoCo with the present states and unknowns, and return the residuals."""
        t = self.translation
        for c in self._closed:
            set_inverse_inertia(t.model, c.touch, (HARD if c.slip is None else SOFT) * c.A)
        for _ in range(_EVALUATIONS):
            with answering(t, last=self._write):
                mujoco.mj_forward(t.model, t.data)
            self._before = np.array(t.data.efc_force)
        return np.array([self._rates(c)[turn] for c, turn in unknown])

    def _rates(self, c: _Closed) -> tuple[float, float]:
        return c.rates(self.translation.data, c.touch.velocity(self.translation.model, self.translation.data))

    def _write(self, data: Any) -> None:
        """Write `efc_aref` of the rows of constraints, dry friction, limits and contacts."""
        if len(self._before) != data.nefc:
            self._before = np.zeros(data.nefc)
        data.efc_aref[: data.ne] += data.efc_R[: data.ne] * self._before[: data.ne]
        rows = slice(data.ne, data.ne + data.nf + data.nl)
        data.efc_aref[rows] = data.efc_R[rows] * self._before[rows]
        dry = slice(data.ne, data.ne + data.nf)
        rates = data.qvel[data.efc_id[dry]]
        slide = np.abs(rates) > _AT_REST
        data.efc_aref[dry] = np.where(slide, -np.sign(rates) * _FAST, data.efc_aref[dry])
        at = {frozenset(contact.geom): contact for contact in data.contact[: data.ncon]}
        for c in self._closed:
            contact = at[frozenset(c.touch.geoms)]
            c.place, R = int(contact.efc_address), contact.frame.reshape(3, 3)
            c.frame = R if contact.geom[1] == c.touch.geoms[0] else -R
            self._write_contact(data, c)

    def _write_contact(self, data: Any, c: _Closed) -> None:
        count = 3 if c.touch.part.friction > 0.0 else 1
        aref = -(c.frame @ c.gamma)[:count]
        aref[0] -= float(c.n_dot @ c.touch.velocity(self.translation.model, data))
        if c.slip is not None:
            Rp = SOFT * c.A * c.p
            B = _PULL * (1.0 + c.touch.part.friction) * Rp
            aref[0] = Rp - c.touch.part.friction * B
            aref[1:] -= B * (c.frame[1:] @ c.slip)
        else:
            rows = slice(c.place, c.place + count)
            aref += data.efc_R[rows] * self._before[rows]
        data.efc_aref[c.place : c.place + count] = aref

    def _changed(self) -> bool:
        """Open contacts that pull, let contacts on their cone start to slide, close one that would overlap again.

        Return whether there was any; one of these kinds at a time, in this order.
        """
        data = self.translation.data
        pulling = [c for c in self._closed if c.slip is not None and c.p <= 0.0]
        for c in pulling:
            self._closed.remove(c)
            self._opened.append(c)
            self.translation.model.pair_margin[c.touch.pair] = _NEVER
        if pulling:
            return True
        starting = [c for c in self._closed if c.slip is None and self._on_cone(c)]
        for c in starting:
            acceleration = c.J @ data.qacc + c.gamma
            tangential = acceleration - c.normal * (c.normal @ acceleration)
            c.starts, c.slip, c.p = True, tangential / np.linalg.norm(tangential), float(data.efc_force[c.place])
        return bool(starting) or self._closes_again()

    def _closes_again(self) -> bool:
        """Close the opened contact that would overlap most; one that had started to slide sticks at first."""
        rates = [self._rates(c)[0] for c in self._opened]
        if min(rates, default=0.0) >= -_ACCEPTED * max(1.0, float(np.max(np.abs(self.translation.data.qacc)))):
            return False
        c = self._opened.pop(int(np.argmin(rates)))
        c.p = _GUESS / c.A
        if c.starts:
            c.starts, c.slip = False, None
        self._closed.append(c)
        self.translation.model.pair_margin[c.touch.pair] = _MARGIN
        return True

    def _on_cone(self, c: _Closed) -> bool:
        """Whether a contact that sticks has reached its cone."""
        mu = c.touch.part.friction
        if mu == 0.0:
            return False
        data = self.translation.data
        normal, *tangents = data.efc_force[c.place : c.place + 3]
        if normal <= 0.0 or np.linalg.norm(tangents) < mu * normal * (1.0 - _ON_CONE):
            return False
        across = np.cross(c.normal, c.J @ data.qacc + c.gamma)
        return bool(np.linalg.norm(across) > _MOVES * max(1.0, float(np.max(np.abs(data.qacc)))))

    def _check_started(self) -> None:
        """Refuse a solution in which a contact slides against its acceleration."""
        for c in self._closed:
            if c.starts and c.slip is not None and c.slip @ (c.J @ self.translation.data.qacc + c.gamma) < 0.0:
                raise EngineWarningError(f"contact '{c.touch.part.name}' neither sticks nor slides")

    def _forces(self) -> Array:
        t = self.translation
        forces = np.zeros((len(t.mechanism.contacts), 3))
        for c in self._closed:
            count = 3 if c.touch.part.friction > 0.0 else 1
            forces[c.touch.contact] += t.data.efc_force[c.place : c.place + count] @ c.frame[:count]
        return forces
