"""Efforts in joint coordinates: actuators of joint springs, friction and control, as forces of DART's joints.

DART takes a joint's force explicitly and its damper implicitly in the time step. An effort ``f(q')`` that brakes,
``df/dq' = -c``, is split into the damper c and the rest ``f + c q'``: at time step zero the two are f again, and in
`World.step` friction is linearly implicit, stable also where it is much steeper than a step can follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from consilience.mechanism import Array, Control, Friction, JointSpring, friction_law
from consilience_dart.translation import Axis, Model

Law = Callable[[float, float, float], tuple[float, float]]
"""Effort and ``-df/dq'``, not below zero, from the time, the coordinate and its rate."""


@dataclass(frozen=True, eq=False)
class Effort:
    """An effort in one coordinate."""

    axis: Axis
    law: Law


@dataclass(frozen=True, eq=False)
class Controller:
    """A control with the coordinate it reads."""

    axis: Axis
    control: Control

    def error(self, t: float) -> float:
        """``target(t) - q``: the rate of its integral."""
        return float(self.control.target.at(t)[0]) - self.axis.value


def _actuator(spring: JointSpring) -> Law:
    motion = spring.actuator
    assert motion is not None
    return lambda t, q, rate: (float(motion.at(t)[0]), 0.0)


def _friction(friction: Friction) -> Law:
    return lambda t, q, rate: friction_law(rate, friction.viscous, friction.coulomb, friction.speed)


def _control(control: Control, integrals: Array, n: int) -> Law:
    def law(t: float, q: float, rate: float) -> tuple[float, float]:
        target, target_rate, _ = control.target.at(t)
        effort = control.proportional * (target - q) + control.integral * integrals[n]
        return effort + control.derivative * (target_rate - rate), max(control.derivative, 0.0)

    return law


def controllers(model: Model) -> list[Controller]:
    """Controls of the mechanism, in its order."""
    return [Controller(model.axes[c.joint, c.coordinate], c) for c in model.mechanism.controls]


def efforts(model: Model, integrals: Array) -> list[Effort]:
    """Efforts of all elements of joints that are not DART's own.

    Parameters
    ----------
    integrals : ndarray, shape (n_controls,)
        Integrals of the controllers, read whenever an effort is evaluated.
    """
    m = model.mechanism
    return [
        *(Effort(model.axes[s.joint, s.coordinate], _actuator(s)) for s in m.joint_springs if s.actuator is not None),
        *(Effort(model.axes[f.joint, f.coordinate], _friction(f)) for f in m.frictions),
        *(Effort(model.axes[c.joint, c.coordinate], _control(c, integrals, n)) for n, c in enumerate(m.controls)),
    ]


def dampers(model: Model, all_efforts: list[Effort]) -> dict[int, float]:
    """Damping coefficient that joint springs give each coordinate with an effort, by index in the skeleton.

    From the mechanism: DART's own may be those that another run has left.
    """
    own = {effort.axis.index: 0.0 for effort in all_efforts}
    for spring in model.mechanism.joint_springs:
        index = model.axes[spring.joint, spring.coordinate].index
        if index in own:
            own[index] += spring.damping
    return own


def exert(model: Model, all_efforts: list[Effort], own_dampers: dict[int, float], t: float) -> Array:
    """Give the joints the forces and dampers of all efforts at the skeleton's state; the forces, shape (n,).

    Parameters
    ----------
    own_dampers : dict
        See `dampers`.
    """
    forces = np.zeros(model.skeleton.getNumDofs())
    damping = dict(own_dampers)
    for effort in all_efforts:
        axis = effort.axis
        rate = axis.rate
        value, steepness = effort.law(t, axis.value, rate)
        forces[axis.index] += axis.sign * (value + steepness * rate)
        damping[axis.index] += steepness
    for effort in all_efforts:
        effort.axis.joint.setDampingCoefficient(0, damping[effort.axis.index])
    model.skeleton.setForces(forces)
    return forces
