"""Efforts in joint coordinates (what DART lacks of joint springs, friction, control) as forces of DART's joints.

DART treats the force of a joint explicitly and its damper implicitly in the time step. An effort ``f(q')`` with the
slope ``df/dq' = -c`` is split into the damper c and the force ``f + c q'``. At time step zero the two sum to f; in
`World.step` friction is linearly implicit, and stable where its slope is too steep for an explicit step.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from consilience.mechanism import Array, Control, Friction, Function, JointSpring, friction_law, spring_damper_law
from consilience_dart.translation import Axis, Model, own_part, remainder

Law = Callable[[float, float, float], tuple[float, float]]
"""Effort f and slope ``-df/dq'`` (not below zero), from time, coordinate and rate."""

Effort = tuple[Axis, Law]


def _actuator(motion: Function) -> Law:
    return lambda t, q, rate: (float(motion.at(t)[0]), 0.0)


def _higher(spring: JointSpring) -> Law:
    """Return the law of a joint spring without the part that DART has."""
    stiffness, damping = remainder(spring).laws

    def law(t: float, q: float, rate: float) -> tuple[float, float]:
        effort, slope = spring_damper_law(q - spring.rest, rate, stiffness, damping)
        return effort, max(slope, 0.0)

    return law


def _friction(friction: Friction) -> Law:
    return lambda t, q, rate: friction_law(rate, friction.viscous, friction.coulomb, friction.speed)


def _control(control: Control, integrals: Array, n: int) -> Law:
    def law(t: float, q: float, rate: float) -> tuple[float, float]:
        target, target_rate, _ = control.target.at(t)
        effort = control.proportional * (target - q) + control.integral * integrals[n]
        return effort + control.derivative * (target_rate - rate), max(control.derivative, 0.0)

    return law


def efforts(model: Model, integrals: Array) -> list[Effort]:
    """Return the efforts of all joint elements for which DART has no means of its own.

    Parameters
    ----------
    model : Model
    integrals : ndarray, shape (n_controls,)
        Integrals of the controllers, read at each evaluation of an effort.
    """
    m = model.mechanism
    return [
        *((model.axes[s.joint, s.coordinate], _actuator(s.actuator)) for s in m.joint_springs if s.actuator),
        *((model.axes[s.joint, s.coordinate], _higher(s)) for s in m.joint_springs if not s.is_linear),
        *((model.axes[f.joint, f.coordinate], _friction(f)) for f in m.frictions),
        *((model.axes[c.joint, c.coordinate], _control(c, integrals, n)) for n, c in enumerate(m.controls)),
    ]


def nonlinear_energy(model: Model) -> float:
    """Return the potential energy in J of what DART lacks of joint springs, at the skeleton's present state."""
    springs = (s for s in model.mechanism.joint_springs if not s.is_linear)
    return sum(float(remainder(s).potential(model.axes[s.joint, s.coordinate].value)) for s in springs)


def dampers(model: Model, all_efforts: list[Effort]) -> dict[int, float]:
    """Return the damping of joint springs in each coordinate with an effort, by index in the skeleton.

    The damping is read from the mechanism: DART's joints may still hold the dampers of another run.
    """
    own = {axis.index: 0.0 for axis, _ in all_efforts}
    for spring in model.mechanism.joint_springs:
        index = model.axes[spring.joint, spring.coordinate].index
        if index in own:
            own[index] += own_part(spring).damping
    return own


def exert(model: Model, all_efforts: list[Effort], own_dampers: dict[int, float], t: float) -> Array:
    """Set forces and dampers of the joints from all efforts at the skeleton's state; return the forces, shape (n,).

    Parameters
    ----------
    model : Model
    all_efforts : list of Effort
    own_dampers : dict
        Result of `dampers`.
    t : float, s
    """
    forces = np.zeros(model.skeleton.getNumDofs())
    damping = dict(own_dampers)
    for axis, law in all_efforts:
        rate = axis.rate
        value, steepness = law(t, axis.value, rate)
        forces[axis.index] += axis.sign * (value + steepness * rate)
        damping[axis.index] += steepness
    for axis, _ in all_efforts:
        axis.joint.setDampingCoefficient(0, damping[axis.index])
    model.skeleton.setForces(forces)
    return forces
