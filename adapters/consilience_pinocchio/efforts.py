"""Efforts in joint coordinates, which Pinocchio lacks: springs, actuators, friction and control of joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from consilience.engine import axis_link
from consilience.mechanism import AXIS_COORDINATES, Array, Function, JointSpring, friction_law, spring_damper_law
from consilience_pinocchio.translate import Translation


@dataclass(frozen=True, eq=False)
class Axis:
    """Coordinate of a one-axis joint in terms of Pinocchio.

    Attributes
    ----------
    idx_q, idx_v : int
        Places in q and v.
    sign : float
        -1 where the tree passes the joint backwards: Pinocchio's coordinate is the negative one.
    slot : int
        Component of the effort in a wrench (force, torque) on the link behind the joint, in axes of the link.
    joint : int
        Pinocchio joint.
    subspace : ndarray, shape (6,)
        Motion (linear, angular) of the joint's moving frame at unit rate of the coordinate, in its own axes.
    """

    idx_q: int
    idx_v: int
    sign: float
    slot: int
    joint: int
    subspace: Array


def axis(translation: Translation, joint: str, coordinate: str) -> Axis:
    """Find a coordinate, ``angle`` or ``distance``, of a joint."""
    mechanism, slot = translation.mechanism, 5 if coordinate == "angle" else 2
    link, sign = axis_link(mechanism, translation.tree, joint, coordinate)
    index = translation.seats[link].joint
    model = translation.model.joints[index]
    subspace = np.zeros(6)
    subspace[slot] = sign
    subspace[2] += sign * mechanism.joints[mechanism.joint_index[joint]].pitch / (2.0 * math.pi)
    return Axis(model.idx_q, model.idx_v, sign, slot, index, subspace)


class Efforts:
    """Generalised forces of springs, actuators, friction and control in joint coordinates.

    Terms linear in q, v and the integrals of the controllers are kept as matrices, functions of time or speed as lists.

    Attributes
    ----------
    active : bool
        Whether there are efforts, so that `at` has to be called.
    control_count : int
    """

    def __init__(self, translation: Translation) -> None:
        mechanism, nv, nq = translation.mechanism, translation.model.nv, translation.model.nq
        self._constant, self._by_q, self._by_v = np.zeros(nv), np.zeros((nv, nq)), np.zeros((nv, nv))
        self._timed: list[tuple[int, float, float, Function]] = []
        self._coulomb: list[tuple[int, float, float]] = []
        self._springs: list[tuple[Axis, JointSpring]] = []
        for spring in mechanism.joint_springs:
            place = axis(translation, spring.joint, spring.coordinate)
            self._springs.append((place, spring))
            if spring.is_linear:
                self._constant[place.idx_v] += place.sign * spring.stiffness * spring.rest
                self._add_linear(place, spring.stiffness, spring.damping)
            if spring.actuator is not None:
                self._timed.append((place.idx_v, place.sign, 0.0, spring.actuator))
        for friction in mechanism.frictions:
            place = axis(translation, friction.joint, friction.coordinate)
            self._add_linear(place, 0.0, friction.viscous)
            self._coulomb.append((place.idx_v, friction.coulomb, friction.speed))  # odd: the same in both senses
        self._add_controls(translation)
        self._nonlinear = [(place, s.rest, *s.laws) for place, s in self._springs if not s.is_linear]
        self.active = bool(mechanism.joint_springs or mechanism.frictions or mechanism.controls)
        self._slots = [
            [axis(translation, joint.name, name) for name in AXIS_COORDINATES.get(joint.kind, ())]
            for joint in mechanism.joints
        ]

    def _add_linear(self, place: Axis, stiffness: float, damping: float) -> None:
        """Add the effort ``-k q - d q'``, which is the same for either sign of the coordinate."""
        self._by_q[place.idx_v, place.idx_q] -= stiffness
        self._by_v[place.idx_v, place.idx_v] -= damping

    def _add_controls(self, translation: Translation) -> None:
        controls = translation.mechanism.controls
        self.control_count = len(controls)
        self._by_integral = np.zeros((translation.model.nv, len(controls)))
        self._targets: list[tuple[Axis, Function]] = []
        for n, control in enumerate(controls):
            place, law = axis(translation, control.joint, control.coordinate), control.target
            self._targets.append((place, law))
            self._add_linear(place, control.proportional, control.derivative)
            gains = place.sign * control.proportional, place.sign * control.derivative
            self._timed.append((place.idx_v, *gains, law))
            self._by_integral[place.idx_v, n] = place.sign * control.integral

    def at(self, q: Array, v: Array, t: float, integrals: Array) -> Array:
        """Return the generalised forces, shape (nv,).

        Parameters
        ----------
        q, v : ndarray, shape (nq,) and (nv,)
        t : float, s
        integrals : ndarray, shape (n_controls,)
            Integrals of the controllers.
        """
        tau = self._constant + self._by_q @ q + self._by_v @ v
        if self.control_count:
            tau += self._by_integral @ integrals
        for i, gain, rate_gain, law in self._timed:
            value, slope, _ = law.jet(t)
            tau[i] += gain * value + rate_gain * slope
        for place, rest, spring, damper in self._nonlinear:
            x, rate = place.sign * q[place.idx_q] - rest, place.sign * v[place.idx_v]
            tau[place.idx_v] += place.sign * spring_damper_law(x, rate, spring, damper)[0]
        for i, coulomb, speed in self._coulomb:
            tau[i] += friction_law(v[i], 0.0, coulomb, speed)[0]
        return np.asarray(tau)

    def control_errors(self, q: Array, t: float) -> Array:
        """Return the rates of the integrals of the controllers, ``target(t) - q``, shape (n_controls,)."""
        return np.array([law.jet(t)[0] - place.sign * q[place.idx_q] for place, law in self._targets])

    def wrench(self, joint: int, tau: Array) -> Array:
        """Return the efforts in a joint of the mechanism as a wrench (force, torque) on the link behind the joint.

        The wrench, shape (6,), is in axes of the link, whose z is the axis of all coordinates of a one-axis joint.
        """
        wrench = np.zeros(6)
        for place in self._slots[joint]:
            wrench[place.slot] += tau[place.idx_v]
        return wrench

    def potential(self, q: Array) -> float:
        """Return the potential energy of the joint springs in J."""
        return sum(float(spring.potential(place.sign * float(q[place.idx_q]))) for place, spring in self._springs)
