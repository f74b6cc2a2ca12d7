"""Motions with contacts, stops and dry friction: gains that follow the step, and what is read at every step.

A contact without restitution is a spring and damper between the bodies, far softer than they (`SOFT`), whose friction
is far harder (impratio): friction then is Coulomb's on a circle, and does not push the bodies apart. The load keeps it
closed where its place curves within a step; a hard one would hop. Contacts with restitution, stops and dry friction are
hard (`HARD`): MuJoCo gives them ``a = -k r - b v`` whatever the mass. The gains follow the step h, with a relaxation
time T:

==========================  ================================================================
friction, dry friction      ``b = 1 / h``
no restitution              ``b = 0.6 / h``, ``k = b / T``: no rebound as h vanishes
restitution e               k fixed, b by the damping ratio of which the rebound is e
==========================  ================================================================
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import Array, Mechanism, State, contact_gap
from consilience_mujoco.contact_instant import HARD, SOFT, ContactInstant
from consilience_mujoco.contacts import IMPEDANCE, Touch, set_inverse_inertia
from consilience_mujoco.evaluate import mass_matrix
from consilience_mujoco.messages import EngineWarningError
from consilience_mujoco.translate import Translation

RELAXATION, RELAXATION_OF_STOPS = 0.2, 1.0
"""Time in which an overlap without restitution decays, over the sample interval: slowly means small rebounds."""

_SLIDING, _NORMAL = 1.0, 0.6
"""Damping of friction and of the normal direction, times the step: RK4 is stable below 2.78."""

BOUNCE, BOUNCE_OF_STOPS = 1e6, 2e6
"""Stiffness of contacts and stops with restitution over the inertia, 1/s^2: half a period is 3 ms, and 2 ms."""

_ON_CONE = 1e-9
"""Relative distance to the cone at which a contact counts as sliding."""


def damping_ratio(restitution: float) -> float:
    """Return the damping ratio of a spring and damper that may not pull, whose rebound is a restitution above zero.

    The rebound is ``exp(-z/s (pi - atan2(2 z s, 1 - 2 z^2)))``, ``s = sqrt(1 - z^2)``; above z = 1 its continuation.
    """
    low, high = 0.0, 1.0
    while rebound(high) > restitution:
        high *= 2.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rebound(middle) > restitution else (low, middle)
    return 0.5 * (low + high)


def rebound_gains(restitution: float, stiffness: float) -> tuple[float, float]:
    """Return damping and stiffness over the inertia, of a restitution above zero."""
    return 2.0 * damping_ratio(restitution) * float(np.sqrt(stiffness)), stiffness


def rebound(z: float) -> float:
    """Return the restitution of a damping ratio z."""
    s = float(np.sqrt(abs(1.0 - z * z)))
    if s < 1e-6:
        return float(np.exp(-2.0))
    if z < 1.0:
        return float(np.exp(-z / s * (np.pi - np.arctan2(2.0 * z * s, 1.0 - 2.0 * z * z))))
    tau = np.log((z + s) / (z - s)) / s
    return float(((z - s) * np.exp(-(z - s) * tau) - (z + s) * np.exp(-(z + s) * tau)) / (2.0 * s))


def set_gains(translation: Translation, state: State, interval: float, softness: float) -> None:
    """Set gains and regularisation of contacts, stops and dry friction for a motion with the step of the model.

    Parameters
    ----------
    translation : Translation
        Its data hold the state.
    state : State
        At the start.
    interval : float, s
        Sample interval.
    softness : float
        Factor on the square root of the compliance of contacts and stops with restitution.
    """
    t, model = translation, translation.model
    normal = _normal_forces(t, state)
    inertia = _inverse_inertias(t)
    step = float(model.opt.timestep)
    damping = _NORMAL / step
    slow = damping, damping / (RELAXATION * interval)
    model.pair_margin[:] = model.jnt_margin[:] = 0.0
    for touch, A in zip(t.touches, inertia, strict=True):
        presses = touch.part.restitution == 0.0
        ratio = SOFT if presses else HARD
        set_inverse_inertia(model, touch, ratio * A)
        b, k = _gains(touch.part.restitution, slow, BOUNCE / softness**2)
        model.pair_solref[touch.pair] = _solref(k, b, ratio if presses else 1.0)
        model.pair_solreffriction[touch.pair] = _solref(0.0, _SLIDING / step, 1.0)
        if presses:  # the overlap under the force at the start is at a gap of zero
            model.pair_margin[touch.pair] = normal.get(touch.pair, 0.0) * A / k
    for limit in t.limits:
        slow = damping, damping / (RELAXATION_OF_STOPS * interval)
        b, k = _gains(limit.restitution, slow, BOUNCE_OF_STOPS / softness**2)
        model.jnt_solref[limit.joint] = _solref(k, b, 1.0)
    model.dof_solref[:] = _solref(0.0, _SLIDING / step, 1.0)


def soften_defaults(model: Any, softness: float) -> None:
    """Scale the time constant of dry friction at MuJoCo's defaults by the root of the softness.

    What rests on contacts sinks and creeps by their regularisation, which is in proportion to the softness
    (`methods.configured`). Dry friction creeps by the time constant, even without regularisation.
    """
    model.dof_solref[:, 0] *= float(np.sqrt(softness))


def _gains(restitution: float, slow: tuple[float, float], stiffness: float) -> tuple[float, float]:
    """Damping and stiffness over the inertia: those of no rebound, or of a restitution by a given stiffness."""
    return slow if restitution == 0.0 else rebound_gains(restitution, stiffness)


def _solref(k: float, b: float, ratio: float) -> list[float]:
    """MuJoCo's numbers for ``aref = -ratio (k r + b v)`` at the impedance `IMPEDANCE`, as negative numbers."""
    return [-k * ratio * IMPEDANCE, -b * ratio * IMPEDANCE]


def _normal_forces(translation: Translation, state: State) -> dict[int, float]:
    """Normal forces at the start by pair; none where the state has no solution, as at an impact."""
    options, kept = translation.model.opt, translation.model.opt.impratio
    options.impratio = 1.0
    instant = ContactInstant(translation)
    try:
        instant.solve(state)
    except EngineWarningError:
        return {}
    finally:
        options.impratio = kept
    return instant.normal_forces()


def _inverse_inertias(translation: Translation) -> Array:
    """Bounds of the inverse inertia that the normal force of each contact sees together with all others.

    Without friction a contact slips off under bodies that tilt: the bound is that of all directions of its normal, or
    the contact gets unstable where it sees less inertia later.
    """
    model, data = translation.model, translation.data
    rows = [
        touch.point_and_normal(data)[1][None] @ touch.jacobian(model, data)
        if touch.part.friction > 0.0
        else touch.jacobian(model, data, central=True)
        for touch in translation.touches
    ]
    W = np.linalg.inv(mass_matrix(model, data))
    return np.array([sum(np.linalg.norm(one @ W @ two.T, 2) for two in rows) for one in rows])


class ContactRecord:
    """Impulses and modes of contacts, read at every step and at every sample of a motion."""

    def __init__(self, count: int) -> None:
        self._impulse = np.zeros((count, 3))
        self.impulses: list[Array] = []
        self.modes: list[Array] = []

    def add_step(self, translation: Translation) -> None:
        """Add the impulse of a step, by the forces of its last stage."""
        for touch, force, _, _ in _acting(translation):
            self._impulse[touch.contact] += translation.model.opt.timestep * force

    def add_sample(self, translation: Translation) -> None:
        """Keep impulses since the sample before, and the modes of the evaluated data."""
        modes = np.zeros(len(self._impulse), dtype=int)
        pyramid = translation.model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
        for touch, _, normal, tangents in _acting(translation):
            friction = np.linalg.norm(tangents, 1 if pyramid else 2)
            slides = friction >= (1.0 - _ON_CONE) * touch.part.friction * normal
            modes[touch.contact] = 1 if slides or modes[touch.contact] == 1 else 2
        self.modes.append(modes)
        self.impulses.append(self._impulse)
        self._impulse = np.zeros_like(self._impulse)

    def complete(self, mechanism: Mechanism, answer: TrajectoryAnswer) -> TrajectoryAnswer:
        """Return a motion with gaps, impulses and modes of contacts."""
        states = [answer.state(n) for n in range(len(answer.time))]
        gaps = [[contact_gap(mechanism, state, contact) for contact in mechanism.contacts] for state in states]
        return replace(
            answer,
            contact_gap=np.array(gaps),
            contact_impulse=np.array(self.impulses),
            contact_mode=np.array(self.modes),
        )


def _acting(translation: Translation) -> Iterator[tuple[Touch, Array, float, Array]]:
    """Touches with a force: touch, force on `body` in world axes, its normal part, its tangential parts."""
    model, data = translation.model, translation.data
    if not data.ncon:
        return
    touches, six = {touch.geoms: touch for touch in translation.touches}, np.zeros(6)
    frames = data.contact.frame.reshape(-1, 3, 3)
    for number, (first, second) in enumerate(data.contact.geom.tolist()):
        mujoco.mj_contactForce(model, data, number, six)
        if six[0] > 0.0:
            sign = -1.0 if (first, second) in touches else 1.0
            touch = touches.get((first, second)) or touches[second, first]
            yield touch, sign * (six[:3] @ frames[number]), float(six[0]), six[1:3].copy()
