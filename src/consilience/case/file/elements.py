"""Elements of a case file, drawn in the world, as those of a mechanism, in the axes of their bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from consilience.case.file.schema import (
    CaseTable,
    ContactTable,
    CouplingTable,
    ForceTable,
    FrictionTable,
    RollingTable,
    SkateTable,
    SpringTable,
)
from consilience.case.file.values import FunctionTable
from consilience.errors import InvalidInput
from consilience.mechanism import (
    Array,
    Contact,
    Control,
    Coupling,
    Drive,
    Frame,
    Friction,
    Function,
    JointSpring,
    Load,
    PointPlane,
    Rolling,
    Skate,
    SpherePlane,
    SphereSphere,
    Spring,
    linear,
)

Drawing = Mapping[str, Frame]
"""Poses of the bodies and of the ground in the drawing, by name."""


def drawn(drawing: Drawing, body: str, where: str) -> Frame:
    """Pose of a body in the drawing.

    Raises
    ------
    InvalidInput
        There is no such body.
    """
    if body not in drawing:
        raise InvalidInput(where, f"there is no body '{body}'", f"Bodies are: {', '.join(drawing)}.")
    return drawing[body]


def elements(table: CaseTable, drawing: Drawing) -> dict[str, Any]:
    """Fields of `Mechanism` that hold elements.

    Raises
    ------
    InvalidInput
        With the table, its name, and the field.
    """
    loads = [_force(f, drawing) for f in table.force]
    loads += [
        Load(
            t.name,
            "torque",
            t.body,
            np.array(t.vector),
            t.frame,
            history=_function(t.history, f"torque '{t.name}': history"),
        )
        for t in table.torque
    ]
    return {
        "springs": tuple(_spring(s, drawing) for s in table.spring),
        "joint_springs": tuple(
            JointSpring(
                s.name,
                s.joint,
                s.coordinate,
                s.stiffness,
                s.damping,
                s.rest,
                _function(s.actuator, f"joint spring '{s.name}': actuator"),
            )
            for s in table.joint_spring
        ),
        "loads": tuple(loads),
        "frictions": tuple(_friction(f) for f in table.friction),
        "controls": tuple(
            Control(
                c.name,
                c.joint,
                c.coordinate,
                _given(c.target, f"control '{c.name}': target"),
                c.proportional,
                c.integral,
                c.derivative,
            )
            for c in table.control
        ),
        "drives": tuple(
            Drive(d.name, d.joint, d.coordinate, _given(d.motion, f"drive '{d.name}': motion")) for d in table.drive
        ),
        "couplings": tuple(_coupling(c) for c in table.coupling),
        "rollings": tuple(_rolling(r, drawing) for r in table.rolling),
        "skates": tuple(_skate(s, drawing) for s in table.skate),
        "contacts": tuple(_contact(c, drawing) for c in table.contact),
    }


def _given(table: FunctionTable, where: str) -> Function:
    try:
        return table.function()
    except InvalidInput as error:
        raise InvalidInput(f"{where}.{error.where}", error.what, error.remedy) from None


def _function(table: FunctionTable | None, where: str) -> Function | None:
    return None if table is None else _given(table, where)


def _point(drawing: Drawing, body: str, point: list[float], where: str) -> Array:
    """A point of the drawing in the axes of a body, from its origin."""
    frame = drawn(drawing, body, where)
    return frame.R.T @ (np.array(point) - frame.p)


def _force(f: ForceTable, drawing: Drawing) -> Load:
    where = f"force '{f.name}'"
    point = _point(drawing, f.body, f.at, f"{where}: body")
    return Load(f.name, "force", f.body, np.array(f.vector), f.frame, point, _function(f.history, f"{where}: history"))


def _spring(s: SpringTable, drawing: Drawing) -> Spring:
    where = f"spring '{s.name}'"
    return Spring(
        s.name,
        s.predecessor,
        s.successor,
        _point(drawing, s.predecessor, s.at, f"{where}: predecessor"),
        _point(drawing, s.successor, s.to, f"{where}: successor"),
        s.stiffness,
        s.damping,
        s.free_length,
        _function(s.actuator, f"{where}: actuator"),
    )


def _friction(f: FrictionTable) -> Friction:
    speed = f.speed
    if speed is None:
        if f.coulomb != 0.0:
            raise InvalidInput(
                f"friction '{f.name}': speed", "the field is missing", "Give the speed that regularises Coulomb's part."
            )
        speed = 1.0  # without meaning where nothing is regularised
    return Friction(f.name, f.joint, f.coordinate, f.viscous, f.coulomb, speed)


def _coupling(c: CouplingTable) -> Coupling:
    if c.law is not None:
        law = _given(c.law, f"coupling '{c.name}': law")
    else:
        assert c.ratio is not None
        law = linear(c.ratio, c.offset or 0.0)
    return Coupling(c.name, c.driver_joint, c.driver_coordinate, c.joint, c.coordinate, law)


def _rolling(r: RollingTable, drawing: Drawing) -> Rolling:
    where = f"rolling '{r.name}'"
    frame = drawn(drawing, r.body, f"{where}: body")
    if r.axis is None and r.radius != 0.0:
        raise InvalidInput(f"{where}: axis", "the field is missing", "Give the normal of the circle in the drawing.")
    axis = np.array(r.axis or [0.0, 0.0, 1.0])  # a ball has no axis: any does
    return Rolling(
        r.name,
        r.body,
        _point(drawing, r.body, r.at, where),
        frame.R.T @ axis,
        r.radius,
        np.array(r.point),
        np.array(r.normal),
        r.rounding,
    )


def _skate(s: SkateTable, drawing: Drawing) -> Skate:
    where = f"skate '{s.name}'"
    frame = drawn(drawing, s.body, f"{where}: body")
    return Skate(s.name, s.body, _point(drawing, s.body, s.at, where), frame.R.T @ np.array(s.lateral))


def _contact(c: ContactTable, drawing: Drawing) -> Contact:
    where = f"contact '{c.name}'"
    center, law = _point(drawing, c.body, c.at, f"{where}: body"), (c.restitution, c.friction)
    partner = drawn(drawing, c.partner, f"{where}: partner")
    if c.partner_at is not None and c.partner_radius is not None:
        other = _point(drawing, c.partner, c.partner_at, where)
        return SphereSphere(c.name, c.body, center, c.radius, c.partner, other, c.partner_radius, *law)
    assert c.point is not None
    plane = (c.partner, _point(drawing, c.partner, c.point, where), partner.R.T @ np.array(c.normal))
    if c.radius == 0.0:
        return PointPlane(c.name, c.body, center, *plane, *law)
    return SpherePlane(c.name, c.body, center, c.radius, *plane, *law)
