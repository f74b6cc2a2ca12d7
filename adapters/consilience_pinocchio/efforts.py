"""Efforts in joint coordinates, which Pinocchio does not have: springs, actuators, friction and control of joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from consilience.mechanism import AXIS_COORDINATES, Array, Function, friction_law
from consilience_pinocchio.translate import Translation


@dataclass(frozen=True, eq=False)
class Axis:
    """Where a coordinate of a one-axis joint stands in Pinocchio's q and v.

    Attributes
    ----------
    idx_q, idx_v : int
    sign : float
        -1 where the tree passes the joint backwards: Pinocchio's coordinate is the opposite one.
    slot : int
        Component of a wrench (force, torque) on the link behind the joint, in its axes, that is the effort.
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
    tree, k = translation.tree, translation.mechanism.joint_index[joint]
    elementary, slot = ("R", 5) if coordinate == "angle" else ("P", 2)
    link = next(i for i, li in enumerate(tree.links) if li.joint == k and li.elementary == elementary)
    index, sign = translation.seats[link].joint, -1.0 if tree.links[link].reversed else 1.0
    model = translation.model.joints[index]
    subspace = np.zeros(6)
    subspace[slot] = sign
    subspace[2] += sign * translation.mechanism.joints[k].pitch / (2.0 * math.pi)
    return Axis(model.idx_q, model.idx_v, sign, slot, index, subspace)


class Efforts:
    """Efforts of springs, actuators, friction and control, as generalised forces.

    All that is linear in q, v and the integrals of the controllers stands in matrices; what is a function of time or
    of a speed is added one by one.

    Attributes
    ----------
    active : bool
        Whether there is any, so that `at` is worth a call.
    control_count : int
    """

    def __init__(self, translation: Translation) -> None:
        mechanism, nv, nq = translation.mechanism, translation.model.nv, translation.model.nq
        self._constant, self._by_q, self._by_v = np.zeros(nv), np.zeros((nv, nq)), np.zeros((nv, nv))
        self._timed: list[tuple[int, float, float, Function]] = []
        self._coulomb: list[tuple[int, float, float]] = []
        self._springs: list[tuple[Axis, float, float]] = []
        for spring in mechanism.joint_springs:
            place = axis(translation, spring.joint, spring.coordinate)
            self._springs.append((place, spring.stiffness, spring.rest))
            self._constant[place.idx_v] += place.sign * spring.stiffness * spring.rest
            self._add_linear(place, spring.stiffness, spring.damping)
            if spring.actuator is not None:
                self._timed.append((place.idx_v, place.sign, 0.0, spring.actuator))
        for friction in mechanism.frictions:
            place = axis(translation, friction.joint, friction.coordinate)
            self._add_linear(place, 0.0, friction.viscous)
            self._coulomb.append((place.idx_v, friction.coulomb, friction.speed))  # odd: the same in both senses
        self._add_controls(translation)
        self.active = bool(mechanism.joint_springs or mechanism.frictions or mechanism.controls)
        self._slots = [
            [axis(translation, joint.name, name) for name in AXIS_COORDINATES.get(joint.kind, ())]
            for joint in mechanism.joints
        ]

    def _add_linear(self, place: Axis, stiffness: float, damping: float) -> None:
        """Effort ``-k q - d q'``: quadratic in the sense of the coordinate, which drops out."""
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
        """Generalised forces, shape (nv,), at the time t and the integrals of the controllers, shape (n_controls,)."""
        tau = self._constant + self._by_q @ q + self._by_v @ v
        if self.control_count:
            tau += self._by_integral @ integrals
        for i, gain, rate_gain, law in self._timed:
            value, slope, _ = law.jet(t)
            tau[i] += gain * value + rate_gain * slope
        for i, coulomb, speed in self._coulomb:
            tau[i] += friction_law(v[i], 0.0, coulomb, speed)[0]
        return np.asarray(tau)

    def control_errors(self, q: Array, t: float) -> Array:
        """Rates of the integrals of the controllers, ``target(t) - q``, shape (n_controls,)."""
        return np.array([law.jet(t)[0] - place.sign * q[place.idx_q] for place, law in self._targets])

    def wrench(self, joint: int, tau: Array) -> Array:
        """Part of the wrench through a joint of the mechanism that is an effort, shape (6,): force, torque.

        It acts on the link behind the joint, in that link's axes: all coordinates of a one-axis joint share z.
        """
        wrench = np.zeros(6)
        for place in self._slots[joint]:
            wrench[place.slot] += tau[place.idx_v]
        return wrench

    def potential(self, q: Array) -> float:
        """Potential energy of the joint springs in J."""
        return sum(0.5 * k * (place.sign * float(q[place.idx_q]) - rest) ** 2 for place, k, rest in self._springs)
