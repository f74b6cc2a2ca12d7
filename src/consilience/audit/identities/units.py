"""A mechanism in other units, and with joint coordinates that count the other way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from consilience.mechanism import Body, Frame, Function, Mechanism, Table


def rescaled(function: Function, value: float, argument: float) -> Function:
    """Return ``value f(x / argument)``; the factors may be negative."""
    powers = argument ** np.arange(len(function.polynomial))
    table = function.table
    if table is not None:
        step = 1 if argument > 0 else -1
        table = Table(argument * table.x[::step], value * table.y[::step], table.periodic)
    return Function(value * function.polynomial / powers, function.harmonics * [value, 1.0 / argument, 1.0], table)


@dataclass(frozen=True)
class _Units:
    """Factors from old numbers to new numbers, for one element.

    Attributes
    ----------
    coordinate, effort : float
        Of the joint coordinate of the element, sign included, and of the effort in that coordinate. A load has its
        force or torque for effort.
    """

    length: float
    force: float
    time: float
    coordinate: float
    effort: float

    @property
    def stiffness(self) -> float:
        """Effort over coordinate."""
        return self.effort / self.coordinate


def _length(u: _Units) -> float:
    return u.length


def _coordinate(u: _Units) -> float:
    return u.coordinate


def _effort(u: _Units) -> float:
    return u.effort


def _damping(u: _Units) -> float:
    return u.stiffness * u.time


_FACTORS: dict[str, dict[str, Callable[[_Units], float]]] = {
    "springs": {
        "point_predecessor": _length,
        "point_successor": _length,
        "stiffness": lambda u: u.force / u.length,
        "damping": lambda u: u.force * u.time / u.length,
        "free_length": _length,
        "actuator": lambda u: u.force,
    },
    "joint_springs": {
        "stiffness": lambda u: u.stiffness,
        "damping": _damping,
        "rest": _coordinate,
        "actuator": _effort,
    },
    "loads": {"vector": _effort, "point": _length, "history": lambda _: 1.0},
    "frictions": {
        "viscous": _damping,
        "coulomb": lambda u: abs(u.effort),
        "speed": lambda u: abs(u.coordinate) / u.time,
    },
    "controls": {
        "target": _coordinate,
        "proportional": lambda u: u.stiffness,
        "integral": lambda u: u.stiffness / u.time,
        "derivative": _damping,
    },
    "drives": {"motion": _coordinate},
    "couplings": {"law": _coordinate},
    "rollings": {"center": _length, "point": _length, "radius": _length, "rounding": _length},
    "skates": {"point": _length},
}
"""Factor of each number, vector or function of each kind of element."""


def in_units(
    mechanism: Mechanism,
    length: float = 1.0,
    mass: float = 1.0,
    time: float = 1.0,
    sign: Mapping[str, float] | None = None,
) -> Mechanism:
    """Convert every number of a mechanism to other units.

    Parameters
    ----------
    length, mass, time : float
        New units in a metre, a kilogram, a second.
    sign : mapping of joint name to float, optional
        -1 for joints whose coordinates count the other way; the frames of these joints stay as they are.
    """
    force, signs = mass * length / time**2, sign or {}

    def frame(old: Frame) -> Frame:
        return Frame(length * old.p, old.R)

    def coordinate(joint: str, name: str) -> float:
        return signs.get(joint, 1.0) * (length if name == "distance" else 1.0)

    def convert(element: Any, factors: Mapping[str, Callable[[_Units], float]]) -> Any:
        """Convert one element; None stays None."""
        own = coordinate(element.joint, element.coordinate) if hasattr(element, "coordinate") else 1.0
        effort = force if getattr(element, "kind", "") == "force" else force * length / own
        is_coupling = hasattr(element, "driver_joint")
        argument = coordinate(element.driver_joint, element.driver_coordinate) if is_coupling else time
        units = _Units(length, force, time, own, effort)
        new: dict[str, Any] = {}
        for name, factor in factors.items():
            old = getattr(element, name)
            if isinstance(old, Function):
                new[name] = rescaled(old, factor(units), argument)
            elif old is not None:
                new[name] = old * factor(units)
        return replace(element, **new)

    elements: dict[str, Any] = {
        group: tuple(convert(x, factors) for x in getattr(mechanism, group)) for group, factors in _FACTORS.items()
    }
    return replace(
        mechanism,
        gravity=mechanism.gravity * length / time**2,
        bodies=tuple(
            Body(b.name, mass * b.mass, length * b.com, mass * length**2 * b.inertia, frame(b.drawing))
            for b in mechanism.bodies
        ),
        joints=tuple(
            replace(j, F=frame(j.F), M=frame(j.M), length=length * j.length, pitch=length * j.pitch)
            for j in mechanism.joints
        ),
        **elements,
    )
