"""Efforts in joint coordinates that are no linear springs: actuators, friction and controllers.

Their laws are user functions of Exudyn, with the coordinate and its rate as Exudyn measures them. Integrals of
controllers are rates of coordinates without mechanical meaning, so that Exudyn's integrators integrate them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.mechanism import Array, Control, Friction, Jet, JointSpring, Mechanism, friction_law
from consilience_exudyn.library import exu, items

Law = Callable[[float], Jet]
"""`Function.jet` of a function."""

Coordinate = tuple[str, str]
"""Joint and name of the coordinate."""


@dataclass(frozen=True, eq=False)
class Effort:
    """Everything that acts in one joint coordinate.

    Attributes
    ----------
    actuators : tuple of Law
        Functions of time.
    frictions : tuple of Friction
    controls : tuple of (Control, Law, int)
        Controller, its target, and its place among the integrals; -1 without one.
    """

    actuators: tuple[Law, ...]
    frictions: tuple[Friction, ...]
    controls: tuple[tuple[Control, Law, int], ...]

    def on_successor(self, t: float, q: float, rate: float, integrals: Array) -> float:
        """Torque about, or force along, +z of F on the successor."""
        total = sum(actuator(t)[0] for actuator in self.actuators)
        for f in self.frictions:
            total += friction_law(rate, f.viscous, f.coulomb, f.speed)[0]
        for c, target, place in self.controls:
            wanted, wanted_rate, _ = target(t)
            total += c.proportional * (wanted - q) + c.derivative * (wanted_rate - rate)
            if place >= 0:
                total += c.integral * integrals[place]
        return total


def efforts_of(mechanism: Mechanism) -> dict[Coordinate, Effort]:
    """Efforts by joint coordinate, linear springs not among them."""
    places = {c.name: n for n, c in enumerate(c for c in mechanism.controls if c.integral)}
    sprung = [s for s in mechanism.joint_springs if s.actuator is not None]
    acting: tuple[JointSpring | Friction | Control, ...] = (*sprung, *mechanism.frictions, *mechanism.controls)
    efforts = {}
    for where in dict.fromkeys((x.joint, x.coordinate) for x in acting):
        efforts[where] = Effort(
            actuators=tuple(s.actuator.jet for s in sprung if (s.joint, s.coordinate) == where and s.actuator),
            frictions=tuple(f for f in mechanism.frictions if (f.joint, f.coordinate) == where),
            controls=tuple(
                (c, c.target.jet, places.get(c.name, -1))
                for c in mechanism.controls
                if (c.joint, c.coordinate) == where
            ),
        )
    return efforts


class Integrals:
    """Integrals of the controllers in an Exudyn system, zero at the start: rates of coordinates ``y'' = e``.

    They are no coordinates of an ObjectGenericODE1: Exudyn's implicit integrators step those with order one.

    Parameters
    ----------
    system : exudyn.MainSystem
        Not yet assembled; whatever has coordinates is in it already.
    measure : callable
        Value of a joint coordinate in the configuration that Exudyn evaluates.
    """

    def __init__(self, system: Any, mechanism: Mechanism, measure: Callable[[Coordinate], float]) -> None:
        watched = [((c.joint, c.coordinate), c.target.jet) for c in mechanism.controls if c.integral]
        self._system, self._node = system, None
        self.count = len(watched)
        if not watched:
            return

        def errors(_system: Any, t: float, _item: int, _q: Any, _q_t: Any) -> Array:
            return np.array([target(t)[0] - measure(coordinate) for coordinate, target in watched])

        zero = [0.0] * self.count
        self._node = system.AddNode(
            items.NodeGenericODE2(
                referenceCoordinates=zero,
                initialCoordinates=zero,
                initialCoordinates_t=zero,
                numberOfODE2Coordinates=self.count,
            )
        )
        system.AddObject(
            items.ObjectGenericODE2(nodeNumbers=[self._node], massMatrix=np.eye(self.count), forceUserFunction=errors)
        )

    def current(self) -> Array:
        """Integrals in the configuration that Exudyn evaluates."""
        if self._node is None:
            return np.zeros(0)
        return np.atleast_1d(self._system.GetNodeOutput(self._node, exu.OutputVariableType.Coordinates_t))


def opposed(effort: Effort, integrals: Integrals, sign: float = 1.0) -> Callable[..., float]:
    """Law of a connector for an effort: Exudyn's force pulls the ends together, an effort acts on the successor.

    Parameters
    ----------
    sign : float
        -1 where Exudyn's coordinate is the negative one.
    """

    def force(_system: Any, t: float, _item: int, q: float, rate: float, *_: float) -> float:
        return -sign * effort.on_successor(t, sign * q, sign * rate, integrals.current())

    return force
