"""A mechanism in other units, and with joint coordinates that count the other way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from consilience.mechanism import Body, Frame, Function, Mechanism, Table


def rescaled(function: Function, value: float, argument: float) -> Function:
    """``value f(x / argument)``; the factors may be negative."""
    powers = argument ** np.arange(len(function.polynomial))
    table = function.table
    if table is not None:
        step = 1 if argument > 0 else -1
        table = Table(argument * table.x[::step], value * table.y[::step], table.periodic)
    return Function(value * function.polynomial / powers, function.harmonics * [value, 1.0 / argument, 1.0], table)


def _in_time(function: Function | None, value: float, time: float) -> Function | None:
    return None if function is None else rescaled(function, value, time)


@dataclass(frozen=True)
class _Units:
    """Factors from one description to another.

    Attributes
    ----------
    sign : mapping of joint name to float
        Minus one for joints whose coordinates count the other way.
    """

    length: float
    mass: float
    time: float
    sign: Mapping[str, float] = field(default_factory=dict)

    @property
    def force(self) -> float:
        return self.mass * self.length / self.time**2

    def coordinate(self, element: Any) -> float:
        """Factor of the joint coordinate of an element, its sign included."""
        return self.of(element.joint, element.coordinate)

    def of(self, joint: str, coordinate: str) -> float:
        return self.sign.get(joint, 1.0) * (self.length if coordinate == "distance" else 1.0)

    def effort(self, element: Any) -> float:
        """Factor of the effort in that coordinate: power has no direction."""
        power = self.force * self.length / self.time
        return power / (self.coordinate(element) / self.time)


def in_units(
    mechanism: Mechanism,
    length: float = 1.0,
    mass: float = 1.0,
    time: float = 1.0,
    sign: Mapping[str, float] | None = None,
) -> Mechanism:
    """Every number of a mechanism in other units: `length` of the new ones make a metre, and so on.

    `sign` names joints whose coordinates count the other way (-1); their frames are the caller's business.
    """
    u = _Units(length, mass, time, sign or {})
    return replace(
        mechanism,
        gravity=mechanism.gravity * length / time**2,
        bodies=tuple(
            Body(b.name, mass * b.mass, length * b.com, mass * length**2 * b.inertia, _frame(b.drawing, u))
            for b in mechanism.bodies
        ),
        joints=tuple(
            replace(j, F=_frame(j.F, u), M=_frame(j.M, u), length=length * j.length, pitch=length * j.pitch)
            for j in mechanism.joints
        ),
        **_forces(mechanism, u),
        **_constraints(mechanism, u),
    )


def _frame(frame: Frame, u: _Units) -> Frame:
    return Frame(u.length * frame.p, frame.R)


def _forces(mechanism: Mechanism, u: _Units) -> dict[str, Any]:
    springs = [
        replace(
            s,
            point_predecessor=u.length * s.point_predecessor,
            point_successor=u.length * s.point_successor,
            stiffness=s.stiffness * u.force / u.length,
            damping=s.damping * u.force * u.time / u.length,
            free_length=s.free_length * u.length,
            actuator=_in_time(s.actuator, u.force, u.time),
        )
        for s in mechanism.springs
    ]
    joint_springs = [
        replace(
            s,
            stiffness=s.stiffness * u.effort(s) / u.coordinate(s),
            damping=s.damping * u.effort(s) * u.time / u.coordinate(s),
            rest=s.rest * u.coordinate(s),
            actuator=_in_time(s.actuator, u.effort(s), u.time),
        )
        for s in mechanism.joint_springs
    ]
    loads = [
        replace(
            x,
            vector=x.vector * (u.force if x.kind == "force" else u.force * u.length),
            point=u.length * x.point,
            history=_in_time(x.history, 1.0, u.time),
        )
        for x in mechanism.loads
    ]
    frictions = [
        replace(
            f,
            viscous=f.viscous * u.effort(f) * u.time / u.coordinate(f),
            coulomb=f.coulomb * abs(u.effort(f)),
            speed=f.speed * abs(u.coordinate(f)) / u.time,
        )
        for f in mechanism.frictions
    ]
    controls = [
        replace(
            c,
            target=rescaled(c.target, u.coordinate(c), u.time),
            proportional=c.proportional * u.effort(c) / u.coordinate(c),
            integral=c.integral * u.effort(c) / u.coordinate(c) / u.time,
            derivative=c.derivative * u.effort(c) / u.coordinate(c) * u.time,
        )
        for c in mechanism.controls
    ]
    return {
        "springs": tuple(springs),
        "joint_springs": tuple(joint_springs),
        "loads": tuple(loads),
        "frictions": tuple(frictions),
        "controls": tuple(controls),
    }


def _constraints(mechanism: Mechanism, u: _Units) -> dict[str, Any]:
    drives = [replace(d, motion=rescaled(d.motion, u.coordinate(d), u.time)) for d in mechanism.drives]
    couplings = [
        replace(c, law=rescaled(c.law, u.coordinate(c), u.of(c.driver_joint, c.driver_coordinate)))
        for c in mechanism.couplings
    ]
    rollings = [
        replace(
            r,
            center=u.length * r.center,
            point=u.length * r.point,
            radius=u.length * r.radius,
            rounding=u.length * r.rounding,
        )
        for r in mechanism.rollings
    ]
    skates = [replace(s, point=u.length * s.point) for s in mechanism.skates]
    return {
        "drives": tuple(drives),
        "couplings": tuple(couplings),
        "rollings": tuple(rollings),
        "skates": tuple(skates),
    }
