"""Elements of a mechanism from the tables of a case file.

A case file draws points and directions in the world; an element has both in the axes of its body, from the body's
origin. Fields of a table that have the name and the value of a field of the element are copied.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from consilience.case.file.contact_schema import ConeTable, ContactTable
from consilience.case.file.problems import gathered
from consilience.case.file.schema import (
    CaseTable,
    CouplingTable,
    ForceTable,
    FrictionTable,
    JointSpringTable,
    RollingTable,
    SkateTable,
    SpringTable,
)
from consilience.case.file.values import FunctionTable, TableModel
from consilience.errors import InvalidInput
from consilience.mechanism import (
    Array,
    BoxPlane,
    CapsulePlane,
    Compliance,
    Cone,
    Contact,
    Control,
    Coupling,
    DiscPlane,
    Drive,
    DryFriction,
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
    Stop,
    SurfaceLaw,
    linear,
)

DrawnFrames = Mapping[str, Frame]
"""Poses of the bodies and of the ground in the drawing, by name."""


def drawn(drawing: DrawnFrames, body: str, where: str) -> Frame:
    """Return the pose of a body in the drawing.

    Raises
    ------
    InvalidInput
        There is no such body.
    """
    if body not in drawing:
        raise InvalidInput(where, f"there is no body '{body}'", f"Bodies are: {', '.join(drawing)}.")
    return drawing[body]


def elements(table: CaseTable, drawing: DrawnFrames, problems: list[InvalidInput]) -> dict[str, Any]:
    """Return the fields of `Mechanism` that hold elements; problems are added with the table, its name, and the field.

    Parameters
    ----------
    problems : list of InvalidInput
        Is extended; an element with a problem is left out.
    """

    def made(make: Callable[[Any], Any], given: Sequence[TableModel]) -> tuple[Any, ...]:
        return gathered(make, given, problems)

    return {
        "springs": made(lambda s: _spring(s, drawing), table.spring),
        "joint_springs": made(_joint_spring, table.joint_spring),
        "loads": (
            *made(lambda f: _force(f, drawing), table.force),
            *made(lambda t: _element(Load, "torque", t, kind="torque", point=np.zeros(3)), table.torque),
        ),
        "frictions": made(_friction, table.friction),
        "controls": made(lambda c: _element(Control, "control", c), table.control),
        "drives": made(lambda d: _element(Drive, "drive", d), table.drive),
        "couplings": made(_coupling, table.coupling),
        "rollings": made(lambda r: _rolling(r, drawing), table.rolling),
        "skates": made(lambda s: _skate(s, drawing), table.skate),
        "contacts": made(lambda c: _contact(c, drawing), table.contact),
        "stops": made(lambda s: _element(Stop, "stop", s), table.stop),
        "dry_frictions": made(lambda d: _element(DryFriction, "dry friction", d), table.dry_friction),
    }


def _element(cls: Any, what: str, table: TableModel, /, **converted: Any) -> Any:
    """Element of a class of the mechanism: fields converted by the caller, the others copied from the table."""
    values = dict(converted)
    for name in (field.name for field in fields(cls)):
        if name not in values:
            value = getattr(table, name)
            is_function = isinstance(value, FunctionTable)
            values[name] = _function(value, f"{what} '{values['name']}': {name}") if is_function else value
    return cls(**values)


def _function(table: FunctionTable, where: str) -> Function:
    try:
        return table.function()
    except InvalidInput as error:
        raise InvalidInput(f"{where}.{error.where}", error.what, error.remedy) from None


def _point(drawing: DrawnFrames, body: str, point: list[float], where: str) -> Array:
    """A point of the drawing in the axes of a body, from its origin."""
    frame = drawn(drawing, body, where)
    return frame.R.T @ (np.array(point) - frame.p)


def _force(f: ForceTable, drawing: DrawnFrames) -> Any:
    point = _point(drawing, f.body, f.at, f"force '{f.name}': body")
    return _element(Load, "force", f, kind="force", point=point)


def _spring(s: SpringTable, drawing: DrawnFrames) -> Any:
    where = f"spring '{s.name}'"
    return _element(
        Spring,
        "spring",
        s,
        point_predecessor=_point(drawing, s.predecessor, s.at, f"{where}: predecessor"),
        point_successor=_point(drawing, s.successor, s.to, f"{where}: successor"),
    )


def _joint_spring(s: JointSpringTable) -> Any:
    (k, *higher_stiffness), (c, *higher_damping) = s.stiffness, s.damping
    higher = {"higher_stiffness": tuple(higher_stiffness), "higher_damping": tuple(higher_damping)}
    return _element(JointSpring, "joint spring", s, stiffness=k, damping=c, **higher)


def _friction(f: FrictionTable) -> Any:
    if f.speed is None and f.coulomb != 0.0:
        raise InvalidInput(
            f"friction '{f.name}': speed", "the field is missing", "Give the speed that regularises Coulomb's part."
        )
    speed = 1.0 if f.speed is None else f.speed  # without Coulomb's part the speed has no effect
    return _element(Friction, "friction", f, speed=speed)


def _coupling(c: CouplingTable) -> Any:
    if c.law is not None:
        return _element(Coupling, "coupling", c)
    assert c.ratio is not None
    return _element(Coupling, "coupling", c, law=linear(c.ratio, c.offset or 0.0))


def _rolling(r: RollingTable, drawing: DrawnFrames) -> Any:
    where = f"rolling '{r.name}'"
    frame = drawn(drawing, r.body, f"{where}: body")
    if r.axis is None and r.radius != 0.0:
        raise InvalidInput(f"{where}: axis", "the field is missing", "Give the normal of the circle in the drawing.")
    axis = np.array(r.axis or [0.0, 0.0, 1.0])  # a ball has no axis: any will do
    return _element(Rolling, "rolling", r, center=_point(drawing, r.body, r.at, where), axis=frame.R.T @ axis)


def _skate(s: SkateTable, drawing: DrawnFrames) -> Any:
    where = f"skate '{s.name}'"
    frame = drawn(drawing, s.body, f"{where}: body")
    point = _point(drawing, s.body, s.at, where)
    return _element(Skate, "skate", s, point=point, lateral=frame.R.T @ np.array(s.lateral))


def _contact(c: ContactTable, drawing: DrawnFrames) -> Contact:
    """Contact of the class that the fields of the table stand for."""
    where = f"contact '{c.name}'"
    own, partner = drawn(drawing, c.body, f"{where}: body"), drawn(drawing, c.partner, f"{where}: partner")
    at, law = _point(drawing, c.body, c.at, where), _surface(c, partner, where)
    if c.partner_at is not None and c.partner_radius is not None:
        other = _point(drawing, c.partner, c.partner_at, where)
        return SphereSphere(c.name, c.body, at, c.radius, c.partner, other, c.partner_radius, **law)
    assert c.point is not None
    plane = (c.partner, _point(drawing, c.partner, c.point, where), partner.R.T @ np.array(c.normal))
    if c.half_sizes is not None:
        axes = own.R if c.orientation is None else c.orientation.matrix()
        return BoxPlane(c.name, c.body, at, np.array(c.half_sizes), *plane, orientation=own.R.T @ axes, **law)
    if c.to is not None:
        return CapsulePlane(c.name, c.body, at, _point(drawing, c.body, c.to, where), c.radius, *plane, **law)
    if c.axis is not None:
        return DiscPlane(c.name, c.body, at, own.R.T @ np.array(c.axis), c.radius, *plane, **law)
    if c.radius == 0.0:
        return PointPlane(c.name, c.body, at, *plane, **law)
    return SpherePlane(c.name, c.body, at, c.radius, *plane, **law)


def _surface(c: ContactTable, partner: Frame, where: str) -> dict[str, Any]:
    """Return the fields of the laws of a contact; the tangent of the drawing in axes of the partner."""
    law = {one.name: getattr(c, one.name) for one in fields(SurfaceLaw)}
    try:
        cone = Cone() if c.cone is None else Cone(c.cone.kind, c.cone.facets, c.cone.offset, _tangent(c.cone, partner))
        compliance = c.compliance and Compliance(c.compliance.stiffness, c.compliance.damping)
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error.where}", error.what, error.remedy) from None
    return law | {"cone": cone, "compliance": compliance}


def _tangent(cone: ConeTable, partner: Frame) -> tuple[float, float, float] | None:
    if cone.tangent is None:
        return None
    x, y, z = partner.R.T @ np.array(cone.tangent)
    return float(x), float(y), float(z)
