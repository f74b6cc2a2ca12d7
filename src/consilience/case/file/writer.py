"""Writer of case files: tables and TOML text of a case, for `reader` and for people.

A case file draws every joint once: frames F and M coincide in the drawing (those of a rod are apart, with z along the
rod). A joint whose frames do not coincide is written with a frame on each body. Numbers keep all their digits, but
points and axes are converted from bodies to the drawing here and back by the reader, which may change last digits.
Where a file has to be exact, frames are written that the reader does not convert, where it would change a digit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from consilience.case.case import Case
from consilience.case.file.reader import joint_of
from consilience.case.file.schema import JointTable
from consilience.case.file.values import Orientation, TomlTable
from consilience.case.published import OF_A_JOINT, owner_of
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Array,
    Body,
    BoxPlane,
    CapsulePlane,
    Cone,
    Contact,
    DiscPlane,
    Frame,
    Function,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    PointPlane,
    SphereSphere,
    SurfaceLaw,
    quaternion_from_rotation,
)

_COINCIDE = 1e-9

_CORRECTIONS = 3
"""Corrections of a point in the drawing by what the conversion back is off."""

_WORLD = Frame(np.zeros(3), np.eye(3))
_INERTIA = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


def save_case(subject: Case | Mechanism, path: str | Path) -> Path:
    """Write a case, or a mechanism in its drawing, as a case file; return its path.

    Raises
    ------
    InvalidInput
        The subject is neither, or the file cannot be written.
    """
    target = Path(path)
    text = case_text(subject if isinstance(subject, Case) else Case.of(subject), exact=True)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InvalidInput(str(target), error.strerror or "it cannot be written", "Name another file.") from None
    return target


def case_text(case: Case, heading: str = "", exact: bool = False) -> str:
    """Return the text of a case file.

    Parameters
    ----------
    heading : str
        Remark for the first lines.
    exact : bool
        Whether frames of bodies and joints are to keep their last digits.
    """
    return table_text(case_table(case, exact), heading)


def table_text(table: TomlTable, heading: str = "") -> str:
    """Return the text of the tables of a case file."""
    lines = [f"# {line}".rstrip() for line in heading.splitlines()]
    return "\n".join([*lines, *_lines(table), ""])


def case_table(case: Case, exact: bool = False) -> TomlTable:
    """Return the tables of a case file, by the names of `schema`; arguments as in `case_text`."""
    mechanism = case.mechanism
    return {
        "title": case.title,
        **({"sources": list(case.sources)} if case.sources else {}),
        **({"remarks": case.remarks} if case.remarks else {}),
        **({"tags": list(case.tags)} if case.tags else {}),
        "gravity": mechanism.gravity.tolist(),
        "body": [_body(body, exact) for body in mechanism.bodies],
        "joint": [_joint(joint, mechanism, exact) for joint in mechanism.joints],
        **{name: group for name, group in _elements(mechanism).items() if group},
        "initial": _initial(case.initial),
        "trajectory": {"duration": case.duration, "sample": case.sample, "digits": case.digits},
        "instant": {"states": case.instants, "seed": case.seed},
        **({"published": _published(case)} if case.published else {}),
    }


# ---------------------------------------------------------------- bodies and joints


def _copied(element: Any, *names: str) -> TomlTable:
    """Fields of an element that a case file has under the same name and with the same value."""
    return {name: np.asarray(getattr(element, name)).tolist() for name in ("name", *names)}


def _orientation(R: Array, exact: bool) -> TomlTable:
    if np.array_equal(R, np.eye(3)):
        return {}
    quaternion = Orientation(quaternion=quaternion_from_rotation(R).tolist())
    if exact and not np.array_equal(quaternion.matrix(), R):
        return {"orientation": {"rows": R.tolist()}}
    return {"orientation": {"quaternion": quaternion.quaternion}}


def _frame(frame: Frame) -> TomlTable:
    return {"at": frame.p.tolist(), **_orientation(frame.R, True)}


def _body(body: Body, exact: bool) -> TomlTable:
    return {
        "name": body.name,
        "mass": body.mass,
        "at": body.drawing.p.tolist(),
        **_orientation(body.drawing.R, exact),
        "com": body.com.tolist(),
        "inertia": {name: float(body.inertia[place]) for name, place in _INERTIA.items()},
    }


def _place(mechanism: Mechanism, body: str) -> Frame:
    return _WORLD if body == GROUND else mechanism.bodies[mechanism.body_index[body]].drawing


def _point(mechanism: Mechanism, body: str, point: Array) -> list[float]:
    """Point of a body in the drawing, where possible one of which the reader makes the same digits."""
    place = _place(mechanism, body)
    drawn = place.p + place.R @ point
    for _ in range(_CORRECTIONS):
        drawn = drawn + place.R @ (point - place.R.T @ (drawn - place.p))
    return drawn.tolist()


def _direction(mechanism: Mechanism, body: str, direction: Array) -> list[float]:
    return (_place(mechanism, body).R @ direction).tolist()


def _joint(joint: Joint, mechanism: Mechanism, exact: bool) -> TomlTable:
    """Table of a joint, drawn; if exact, with frames on its bodies where the drawing would change them."""
    drawn, apart = _drawn_joint(joint, mechanism)
    if exact and (apart or not _keeps_digits(drawn, joint, mechanism)):
        frames = {"F": _frame(joint.F), "M": _frame(joint.M)}
        own = {"screw": {"pitch": joint.pitch}, "rod": {"length": joint.length}}.get(joint.kind, {})
        return _copied(joint, "kind", "predecessor", "successor") | own | frames
    if apart:
        what = f"its frames are {apart:.2g} apart in the drawing"
        raise InvalidInput(f"joint '{joint.name}'", what, "Draw it in an assembled pose.")
    return drawn


def _keeps_digits(drawn: TomlTable, joint: Joint, mechanism: Mechanism) -> bool:
    """Tell whether the reader makes the same frames of the table of a joint."""
    places = {name: _place(mechanism, name) for name in (joint.predecessor, joint.successor)}
    read = joint_of(JointTable.model_validate(drawn), places)
    pairs = (joint.F.p, read.F.p), (joint.F.R, read.F.R), (joint.M.p, read.M.p), (joint.M.R, read.M.R)
    return read.length == joint.length and all(np.array_equal(one, other) for one, other in pairs)


def _drawn_joint(joint: Joint, mechanism: Mechanism) -> tuple[TomlTable, float]:
    """Table of a joint in the drawing, a rod with two ends, and how far its frames are apart there, 0 for rounding."""
    start, end = _place(mechanism, joint.predecessor), _place(mechanism, joint.successor)
    at, to = start.p + start.R @ joint.F.p, end.p + end.R @ joint.M.p
    axes, others = start.R @ joint.F.R, end.R @ joint.M.R
    table = _copied(joint, "kind", "predecessor", "successor") | {"at": at.tolist()}
    if joint.kind == "rod":
        apart = abs(float(np.linalg.norm(to - at)) - joint.length)
        table["to"] = to.tolist()
        if np.linalg.norm(np.cross(axes[:, 0], to - at)) > _COINCIDE * joint.length:
            table["second_axis"] = axes[:, 0].tolist()
    else:
        apart = max(float(np.max(np.abs(to - at))), float(np.max(np.abs(axes - others))))
        if not np.array_equal(axes, np.eye(3)):
            table |= {"axis": axes[:, 2].tolist(), "second_axis": axes[:, 0].tolist()}
        elif joint.kind not in ("spherical", "free", "rigid"):
            table |= {"axis": [0.0, 0.0, 1.0], "second_axis": [1.0, 0.0, 0.0]}
    rounding = apart <= _COINCIDE * max(1.0, float(np.max(np.abs(at))))
    return table | ({"pitch": joint.pitch} if joint.kind == "screw" else {}), 0.0 if rounding else apart


# ---------------------------------------------------------------- elements


def function_table(function: Function) -> TomlTable:
    """Return a function as a table of a case file."""
    table: TomlTable = {}
    if len(function.polynomial):
        table["polynomial"] = function.polynomial.tolist()
    if len(function.harmonics):
        table["harmonics"] = function.harmonics.tolist()
    if function.table is not None:
        t = function.table
        table["table"] = {"x": t.x.tolist(), "y": t.y.tolist(), "periodic": t.periodic}
    return table or {"polynomial": [0.0]}


def _given(name: str, function: Function | None) -> TomlTable:
    return {} if function is None else {name: function_table(function)}


def _load(load: Load, mechanism: Mechanism) -> TomlTable:
    table = _copied(load, "body", "vector", "frame")
    if load.kind == "force":
        table["at"] = _point(mechanism, load.body, load.point)
    return table | _given("history", load.history)


def _powers(s: JointSpring) -> TomlTable:
    """Stiffness and damping, each a number, or a list where there are coefficients of higher degree."""
    given = {"stiffness": (s.stiffness, s.higher_stiffness), "damping": (s.damping, s.higher_damping)}
    return {name: [float(k), *higher] if higher else float(k) for name, (k, higher) in given.items()}


def _in_joint(element: Any, *names: str) -> TomlTable:
    return _copied(element, "joint", "coordinate", *names)


def _set(element: Any, *names: str) -> list[str]:
    """Names of the fields that are not None."""
    return [name for name in names if getattr(element, name) is not None]


def _elements(m: Mechanism) -> dict[str, list[TomlTable]]:
    """Tables of all elements by kind, with points and directions in the drawing."""
    return {
        "spring": [
            _copied(s, "predecessor", "successor")
            | {"at": _point(m, s.predecessor, s.point_predecessor), "to": _point(m, s.successor, s.point_successor)}
            | _copied(s, "stiffness", "damping", "free_length")
            | _given("actuator", s.actuator)
            for s in m.springs
        ],
        "joint_spring": [
            _in_joint(s) | _powers(s) | _copied(s, "rest") | _given("actuator", s.actuator) for s in m.joint_springs
        ],
        "force": [_load(load, m) for load in m.loads if load.kind == "force"],
        "torque": [_load(load, m) for load in m.loads if load.kind == "torque"],
        "friction": [_in_joint(f, "viscous", "coulomb", "speed") for f in m.frictions],
        "control": [
            _in_joint(c, "proportional", "integral", "derivative") | _given("target", c.target) for c in m.controls
        ],
        "drive": [_in_joint(d) | _given("motion", d.motion) for d in m.drives],
        "coupling": [_in_joint(c, "driver_joint", "driver_coordinate") | _given("law", c.law) for c in m.couplings],
        "rolling": [
            _copied(r, "body")
            | {"at": _point(m, r.body, r.center), "axis": _direction(m, r.body, r.axis)}
            | _copied(r, "radius", "rounding", "point", "normal")
            for r in m.rollings
        ],
        "skate": [
            _copied(s, "body") | {"at": _point(m, s.body, s.point), "lateral": _direction(m, s.body, s.lateral)}
            for s in m.skates
        ],
        "contact": [_contact(c, m) for c in m.contacts],
        "stop": [_in_joint(s, *_set(s, "lower", "upper"), "restitution") for s in m.stops],
        "dry_friction": [_in_joint(d, *_set(d, "bound", "coefficient", "radius")) for d in m.dry_frictions],
    }


def _contact(c: Contact, m: Mechanism) -> TomlTable:
    table = _copied(c, "body", "partner")
    if isinstance(c, CapsulePlane):
        table |= {"at": _point(m, c.body, c.start), "to": _point(m, c.body, c.end)}
    else:
        table |= {"at": _point(m, c.body, c.center)}
    if isinstance(c, BoxPlane):
        axes = _place(m, c.body).R @ c.orientation
        table |= {
            "half_sizes": c.half_sizes.tolist(),
            "orientation": {"quaternion": quaternion_from_rotation(axes).tolist()},
        }
    elif not isinstance(c, PointPlane):
        table["radius"] = c.radius
    if isinstance(c, DiscPlane):
        table["axis"] = _direction(m, c.body, c.axis)
    if isinstance(c, SphereSphere):
        table |= {"partner_at": _point(m, c.partner, c.partner_center), "partner_radius": c.partner_radius}
    else:
        table |= {"point": _point(m, c.partner, c.point), "normal": _direction(m, c.partner, c.normal)}
    return table | _surface(c, m)


def _surface(c: Contact, m: Mechanism) -> TomlTable:
    """Restitution and friction of a contact, and those of its other laws that are not at their defaults."""
    table: TomlTable = {"restitution": c.restitution, "friction": c.friction}
    for name in ("rebound_threshold", "static_friction", "associated", "impact_law", "torsional", "rolling"):
        if getattr(c, name) != getattr(SurfaceLaw(), name):
            table[name] = getattr(c, name)
    if c.cone != Cone():
        own = ("kind", "facets", "offset") if c.cone.kind == "pyramid" else ("kind",)
        table["cone"] = {name: getattr(c.cone, name) for name in own}
        if c.cone.tangent is not None and c.cone.kind != "circle":
            table["cone"]["tangent"] = _direction(m, c.partner, np.array(c.cone.tangent))
    if c.compliance is not None:
        table["compliance"] = {"stiffness": c.compliance.stiffness, "damping": c.compliance.damping}
    return table


# ---------------------------------------------------------------- initial state


def _held(values: Mapping[str, Any], rates: bool) -> TomlTable:
    table: TomlTable = {name: np.asarray(value, dtype=float).tolist() for name, value in values.items()}
    if "orientation" in table:
        orientation = table.pop("orientation")
        way = "quaternion" if len(orientation) == 4 else "rows"
        table |= {"angular_velocity": orientation} if rates else {"orientation": {way: orientation}}
    return table


def _initial(initial: Initial) -> TomlTable:
    bodies: dict[str, TomlTable] = {
        name: {"at": f.p.tolist(), "orientation": {"quaternion": quaternion_from_rotation(f.R).tolist()}}
        for name, f in initial.poses.items()
    }
    for name, (v, w) in initial.velocities.items():
        velocities = {"velocity": np.asarray(v).tolist(), "angular_velocity": np.asarray(w).tolist()}
        bodies.setdefault(name, {}).update(velocities)
    return {
        "joints": {name: _held(values, rates=False) for name, values in initial.coordinates.items()},
        "rates": {name: _held(values, rates=True) for name, values in initial.rates.items()},
        "bodies": bodies,
    }


def _published(case: Case) -> list[TomlTable]:
    """Tables of expected values, components of one vector together."""
    vectors: dict[tuple[object, ...], TomlTable] = {}
    for known in case.published:
        fields: TomlTable = {owner_of(known.observable): known.of}
        fields |= {name: getattr(known, name) for name in ("observable", "time", "uncertainty", "origin", "source")}
        fields |= {"second": known.second} if known.second else {}
        vector = vectors.setdefault(tuple(fields.values()), {**fields, "value": {}})
        if known.observable in OF_A_JOINT:
            vector["value"] = known.value
        else:
            vector["value"]["xyz"[known.component]] = known.value
    return list(vectors.values())


# ---------------------------------------------------------------- TOML


def _value(value: Any) -> str:
    """A value in one line (texts of several lines excepted); nested tables are inline."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {_value(entry)}" for name, entry in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(entry) for entry in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str) and "\n" in value:
        return "\n".join(['"""', *(json.dumps(line, ensure_ascii=False)[1:-1] for line in value.splitlines()), '"""'])
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value.item() if isinstance(value, np.generic) else value)


def _entries(table: TomlTable) -> Iterator[str]:
    return (f"{name} = {_value(value)}" for name, value in table.items())


def _lines(table: TomlTable) -> Iterator[str]:
    """Top-level values, then a paragraph for each table and each entry of a list of tables."""

    def entries(value: Any) -> bool:
        return isinstance(value, list) and bool(value) and isinstance(value[0], dict)

    yield from _entries({name: value for name, value in table.items() if not isinstance(value, dict | list)})
    yield from _entries({n: v for n, v in table.items() if isinstance(v, list) and not entries(v)})
    for name, value in table.items():
        if entries(value):
            for entry in value:
                yield from ("", f"[[{name}]]", *_entries(entry))
        elif isinstance(value, dict):
            nested = name == "initial"
            for key, entry in [(f"{name}.{k}", e) for k, e in value.items()] if nested else [(name, value)]:
                if entry:
                    yield from ("", f"[{key}]", *_entries(entry))
