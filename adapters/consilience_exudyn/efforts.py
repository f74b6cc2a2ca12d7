"""Efforts in joint coordinates beside linear springs: what is not linear, actuators, friction and controllers.

Laws of efforts are user functions of Exudyn, with the coordinate and its rate as measured by Exudyn. Integrals of
controllers are rates of coordinates without mechanical meaning, so that Exudyn's integrators integrate them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from consilience.engine import nonlinear_part
from consilience.mechanism import (
    Array,
    Control,
    Friction,
    Function,
    JointSpring,
    Mechanism,
    friction_law,
    spring_damper_law,
)
from consilience_exudyn.library import add_coordinates, exu, items

Law = Callable[[float, float, float, Array], float]
"""Torque about, or force along, +z of F on the successor, from time, coordinate, rate and integrals of controllers."""

Coordinate = tuple[str, str]
"""Joint and name of the coordinate."""


def _actuator(motion: Function) -> Law:
    return lambda t, q, rate, integrals: motion.jet(t)[0]


def _higher(s: JointSpring) -> Law:
    """Return the law of a joint spring without its linear part, which is a connector of Exudyn."""
    spring, damper = nonlinear_part(s).laws
    return lambda t, q, rate, integrals: spring_damper_law(q - s.rest, rate, spring, damper)[0]


def _friction(f: Friction) -> Law:
    return lambda t, q, rate, integrals: friction_law(rate, f.viscous, f.coulomb, f.speed)[0]


def _control(c: Control) -> Law:
    def law(t: float, q: float, rate: float, integrals: Array) -> float:
        target, target_rate, _ = c.target.jet(t)
        return c.proportional * (target - q) + c.derivative * (target_rate - rate)

    return law


def _integral(gain: float, n: int) -> Law:
    return lambda t, q, rate, integrals: gain * integrals[n]


def efforts_of(mechanism: Mechanism) -> dict[Coordinate, list[Law]]:
    """Return the laws of all efforts but linear springs, by joint coordinate."""
    efforts: dict[Coordinate, list[Law]] = {}

    def add(element: Any, law: Law) -> None:
        efforts.setdefault((element.joint, element.coordinate), []).append(law)

    for spring in mechanism.joint_springs:
        if spring.actuator is not None:
            add(spring, _actuator(spring.actuator))
        if not spring.is_linear:
            add(spring, _higher(spring))
    for friction in mechanism.frictions:
        add(friction, _friction(friction))
    places = {c.name: n for n, c in enumerate(c for c in mechanism.controls if c.integral)}
    for control in mechanism.controls:
        add(control, _control(control))
        if control.integral:
            add(control, _integral(control.integral, places[control.name]))
    return efforts


class Integrals:
    """Integrals of the controllers in an Exudyn system, zero at the start: rates of coordinates ``y'' = e``.

    Exudyn's implicit integrators step the coordinates of an ObjectGenericODE1 with order one; coordinates of second
    order are used instead.

    Parameters
    ----------
    system : exudyn.MainSystem
        Not yet assembled; all other coordinates are added before.
    mechanism : Mechanism
    measure : callable
        Value of a joint coordinate in the configuration that Exudyn evaluates.
    """

    def __init__(self, system: Any, mechanism: Mechanism, measure: Callable[[Coordinate], float]) -> None:
        watched = [((c.joint, c.coordinate), c.target.jet) for c in mechanism.controls if c.integral]
        self._system, self._node = system, None
        self.count = len(watched)
        if not watched:
            return

        def errors(_system: Any, t: float, *_: Any) -> Array:
            return np.array([target(t)[0] - measure(coordinate) for coordinate, target in watched])

        self._node = add_coordinates(system, self.count)
        system.AddObject(
            items.ObjectGenericODE2(nodeNumbers=[self._node], massMatrix=np.eye(self.count), forceUserFunction=errors)
        )

    def current(self) -> Array:
        """Return the integrals in the configuration that Exudyn evaluates."""
        if self._node is None:
            return np.zeros(0)
        return np.atleast_1d(self._system.GetNodeOutput(self._node, exu.OutputVariableType.Coordinates_t))


def opposed(laws: list[Law], integrals: Integrals, sign: float = 1.0) -> Callable[..., float]:
    """Return the user function of a connector: Exudyn's force pulls the ends together, an effort acts on the successor.

    Parameters
    ----------
    laws : list of Law
        All efforts in the coordinate.
    integrals : Integrals
    sign : float
        -1 where Exudyn's coordinate is the negative one.
    """

    def force(_system: Any, t: float, _item: int, q: float, rate: float, *_: float) -> float:
        """Force or torque that pulls the ends together.

        Parameters
        ----------
        _system, _item
            System and number of the object; not used.
        t : float, s
        q, rate : float
            Coordinate and rate measured by Exudyn, in m or rad and per second.
        """
        now = integrals.current()
        return -sign * sum(law(t, sign * q, sign * rate, now) for law in laws)

    return force
