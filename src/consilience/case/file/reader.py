"""Reader of case files: TOML, checked field by field.

The mechanism is drawn in the world in an assembled pose. A joint is one frame of the drawing: F and M coincide there
(those of a rod are apart), so that joint coordinates are zero in the drawing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from consilience.case.bounded_reading import bounded_text, toml_tables
from consilience.case.case import Case
from consilience.case.file.digest import case_digest
from consilience.case.file.elements import drawn, elements
from consilience.case.file.lines import field_lines, lines_by_name
from consilience.case.file.problems import checked_table, gathered, located
from consilience.case.file.schema import (
    BodyGuess,
    BodyTable,
    CaseTable,
    HeldTable,
    InitialTable,
    JointTable,
    PublishedTable,
    TrajectoryTable,
    VariantTable,
)
from consilience.case.file.values import Orientation
from consilience.case.published import ACCELERATIONS, OF_A_JOINT, REACTIONS, Published, has_coordinate, owner_of, owners
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Array,
    Body,
    Frame,
    Initial,
    Joint,
    Mechanism,
    quaternion_from_rotation,
    rotation_with_z_axis,
)

LARGEST_FILE = 1_000_000
"""Largest size of a case file in bytes: a thousand bodies and their joints take half of that."""


def load_file(path: Path) -> list[Case]:
    """Return the cases of one file: one, or one per variant.

    Raises
    ------
    InvalidInput
        With file, field, what is wrong and what would be right.
    """
    text = bounded_text(path, LARGEST_FILE)
    return cases_from_tables(path.stem, path.name, toml_tables(text, str(path)), text)


def cases_from_tables(name: str, file: str, raw: Mapping[str, Any], text: str = "") -> list[Case]:
    """Return the cases of the tables of a case file: one, or one per variant.

    Parameters
    ----------
    name : str
        Name of the case; variants append theirs.
    file : str
        Origin of the tables, for messages.
    text : str
        Text of the file, for the lines in messages.

    Raises
    ------
    InvalidCase
        With all problems that are found: file, line, field, what is wrong and what would be right.
    """
    problems: list[InvalidInput] = []
    table = checked_table(raw, problems)
    cases = [] if table is None else _cases(name, file, table, _names(raw), problems)
    if problems or table is None:
        raise located(file, problems, raw, text) from None
    variants = table.variants or [""]
    lines = lines_by_name(raw, field_lines(text))
    return [
        replace(case, file_digest=case_digest(raw, name), lines=lines)
        for case, name in zip(cases, variants, strict=True)
    ]


def _names(raw: Mapping[str, Any]) -> set[str]:
    """Names of all bodies, those with problems, too: what refers to them is right."""
    bodies = raw.get("body")
    names = [body.get("name") for body in bodies if isinstance(body, dict)] if isinstance(bodies, list) else []
    return {name for name in names if isinstance(name, str)}


def _cases(stem: str, file: str, table: CaseTable, names: set[str], problems: list[InvalidInput]) -> list[Case]:
    """Cases of valid tables; problems are added."""
    mechanism = _mechanism(stem, table, names, problems)
    if mechanism is None:
        return []
    own: list[tuple[str, CaseTable | VariantTable]] = list(table.variants.items()) or [("", table)]

    def made(variant: tuple[str, CaseTable | VariantTable]) -> Case:
        name, one = variant
        return _case(f"{stem}-{name}" if name else stem, file, table, mechanism, one, problems)

    return list(gathered(made, own, problems))


def _case(
    name: str,
    file: str,
    table: CaseTable,
    mechanism: Mechanism,
    own: CaseTable | VariantTable,
    problems: list[InvalidInput],
) -> Case:
    """Case of a file or of one of its variants.

    Parameters
    ----------
    name, file : str
        Names of the case and, for messages, of the file.
    table : CaseTable
    mechanism : Mechanism
    own : CaseTable or VariantTable
        Table with the title, initial state, span and expected values of the case.
    """
    span = own.trajectory or table.trajectory
    published = gathered(lambda known: _published(mechanism, *known, span), enumerate(own.published), problems)
    return Case(
        name=name,
        file=file,
        title=own.title,
        mechanism=mechanism,
        initial=_initial(mechanism, own.initial or table.initial, problems),
        duration=span.duration,
        sample=span.sample,
        digits=span.digits,
        instants=table.instant.states,
        seed=table.instant.seed,
        sources=tuple(table.sources),
        remarks=table.remarks.strip(),
        tags=tuple(table.tags),
        published=tuple(one for known in published for one in known),
    )


def _published(mechanism: Mechanism, n: int, table: PublishedTable, span: TrajectoryTable) -> list[Published]:
    where = f"published[{n}]"
    what = owner_of(table.observable)
    of = getattr(table, what)
    if of not in owners(mechanism, table.observable) or of == GROUND:
        raise InvalidInput(f"{where}.{what}", f"there is no {what} '{of}'", f"Name a {what} of the case.")
    if table.observable in OF_A_JOINT and not has_coordinate(mechanism, of, table.observable):
        kind = mechanism.joints[mechanism.joint_index[of]].kind
        raise InvalidInput(
            f"{where}.observable", f"a {kind} joint has no {table.observable}", "Name one of its coordinates."
        )
    samples = table.time / span.sample
    if table.time > span.duration or abs(samples - round(samples)) > 1e-9 * max(samples, 1.0):
        raise InvalidInput(
            f"{where}.time", f"{table.time:g} s is no sample of the trajectory", "Choose a time of its grid."
        )
    if table.time and table.observable in (*ACCELERATIONS, *REACTIONS):
        integrating = [c.name for c in mechanism.controls if c.integral]
        if integrating:
            what = f"{table.observable} at {table.time:g} s depends on the integral of control '{integrating[0]}'"
            raise InvalidInput(f"{where}.observable", what, "Expect positions or velocities, or give the time 0.")
    stated = table.model_dump(include={"observable", "time", "uncertainty", "source", "origin", "second"})
    return [Published(of=of, component=k, value=value, **stated) for k, value in table.components().items()]


def _matrix(orientation: Orientation | None, where: str) -> Array:
    try:
        return np.eye(3) if orientation is None else orientation.matrix()
    except ValueError as error:
        raise InvalidInput(where, str(error), "Give three points that span a plane.") from None


def _mechanism(name: str, table: CaseTable, names: set[str], problems: list[InvalidInput]) -> Mechanism | None:
    """Mechanism of a file; None if anything has a problem, which is added."""
    anywhere = Frame(np.zeros(3), np.eye(3))
    drawing = {GROUND: anywhere} | dict.fromkeys(sorted(names), anywhere)
    bodies = gathered(_body, table.body, problems)
    drawing |= {b.name: b.drawing for b in bodies}
    joints = gathered(lambda j: joint_of(j, drawing), table.joint, problems)
    groups = elements(table, drawing, problems)
    if problems:
        return None
    whole = partial(Mechanism, name, np.array(table.gravity), bodies, joints)
    try:
        return whole(**groups)
    except InvalidInput as first:
        problems.append(first)
    # each element alone, for the problem of each
    alone = [(group, element) for group, members in groups.items() for element in members]
    gathered(lambda one: whole(**{one[0]: (one[1],)}), alone, problems)
    return None


def _body(b: BodyTable) -> Body:
    orientation = _matrix(b.orientation, f"body '{b.name}': orientation.three_points")
    return Body(b.name, b.mass, np.array(b.com), b.inertia.tensor(), Frame(np.array(b.at), orientation))


def _rod_axis(at: Sequence[float], to: Sequence[float], where: str) -> list[float]:
    axis = [b - a for a, b in zip(at, to, strict=True)]
    if not any(axis):
        raise InvalidInput(f"{where}: to", "the ends of the rod coincide", "Draw the two ends of the rod apart.")
    return axis


def _joint_axes(j: JointTable, at: Sequence[float]) -> Array:
    """Axes of F and M in the world of the drawing."""
    where = f"joint '{j.name}'"
    axis = j.axis
    if j.kind == "rod":
        if j.to is None:
            raise InvalidInput(f"{where}: to", "the field is missing", "Give the other end of the rod in the drawing.")
        if j.axis is not None:
            raise InvalidInput(f"{where}: axis", "a rod has none", "Remove it: z of F is along the rod as drawn.")
        axis = _rod_axis(at, j.to, where)
    elif j.to is not None:
        raise InvalidInput(f"{where}: to", f"a {j.kind} joint has none", "Remove it: only a rod has a second end.")
    if axis is None:
        if j.kind in ("spherical", "free", "rigid"):
            return np.eye(3)
        raise InvalidInput(f"{where}: axis", "the field is missing", f"Give the axis (z of F) of the {j.kind} joint.")
    if j.kind == "universal" and j.second_axis is None:
        raise InvalidInput(f"{where}: second_axis", "the field is missing", "Give the axis fixed in the successor.")
    if j.kind == "universal" and abs(np.dot(axis, j.second_axis or axis)) > 1e-9 * float(
        np.linalg.norm(axis) * np.linalg.norm(j.second_axis or axis)
    ):
        raise InvalidInput(f"{where}: second_axis", "it is not at right angles to axis", "Draw the cross square.")
    try:
        return rotation_with_z_axis(axis, j.second_axis)
    except ValueError as error:
        raise InvalidInput(f"{where}: axis", str(error), "Give directions that span a frame.") from None


def _framed_joint(j: JointTable, where: str) -> Joint:
    """Joint whose frames are given on its two bodies."""
    for name in ("at", "axis", "second_axis", "to"):
        if getattr(j, name) is not None:
            raise InvalidInput(f"{where}: {name}", "it is drawn, and has frames", "Draw it, or give F and M.")
    if j.F is None or j.M is None:
        lacking = "F" if j.F is None else "M"
        raise InvalidInput(f"{where}: {lacking}", "the field is missing", "Give both frames, F and M.")
    if (j.kind == "rod") != (j.length is not None):
        raise InvalidInput(
            f"{where}: length", "a rod with frames has one, and no other joint", "Give a rod its length."
        )
    F, M = (
        Frame(np.array(f.at), _matrix(f.orientation, f"{where}: {n}.orientation")) for n, f in (("F", j.F), ("M", j.M))
    )
    return Joint(j.name, j.kind, j.predecessor, j.successor, F, M, j.length or 0.0, j.pitch or 0.0)


def joint_of(j: JointTable, drawing: Mapping[str, Frame]) -> Joint:
    """Joint whose frames F and M are drawn as one frame in the world (of a rod: as two), or given on its bodies."""
    where = f"joint '{j.name}'"
    if j.kind == "screw" and j.pitch is None:
        raise InvalidInput(f"{where}: pitch", "the field is missing", "Give the advance of the screw in a turn.")
    if j.kind != "screw" and j.pitch is not None:
        raise InvalidInput(f"{where}: pitch", f"a {j.kind} joint has none", "Remove it: only a screw has a pitch.")
    start, end = drawn(drawing, j.predecessor, where), drawn(drawing, j.successor, where)
    if j.F is not None or j.M is not None:
        return _framed_joint(j, where)
    if j.at is None:
        raise InvalidInput(f"{where}: at", "the field is missing", "Give the origin of its frames in the drawing.")
    if j.length is not None:
        raise InvalidInput(
            f"{where}: length", "it is drawn", "Remove it: the ends of a rod, as drawn, give its length."
        )
    axes = _joint_axes(j, j.at)
    at, to = np.array(j.at), np.array(j.at if j.to is None else j.to)
    return Joint(
        name=j.name,
        kind=j.kind,
        predecessor=j.predecessor,
        successor=j.successor,
        F=Frame(start.R.T @ (at - start.p), start.R.T @ axes),
        M=Frame(end.R.T @ (to - end.p), end.R.T @ axes),
        length=float(np.linalg.norm(to - at)),
        pitch=j.pitch or 0.0,
    )


def _held(table: HeldTable, where: str, rates: bool) -> dict[str, Any]:
    """Held coordinates, or rates, by the names of `JOINT_KINDS`; orientations as quaternions."""
    wrong = "orientation" if rates else "angular_velocity"
    if getattr(table, wrong) is not None:
        right = "angular_velocity" if rates else "orientation"
        raise InvalidInput(f"{where}.{wrong}", "it does not belong here", f"Use {right}.")
    held: dict[str, Any] = {n: v for n, v in table.model_dump(exclude={"orientation"}).items() if v is not None}
    if "angular_velocity" in held:
        held["orientation"] = held.pop("angular_velocity")
    if table.orientation is not None:
        held["orientation"] = quaternion_from_rotation(_matrix(table.orientation, f"{where}.orientation"))
    return held


def _check_held(mechanism: Mechanism, joint: str, coordinates: Mapping[str, Any], where: str) -> None:
    """Refuse a joint that the mechanism has not, and a coordinate that the joint has not."""
    if joint not in mechanism.joint_index:
        known = ", ".join(mechanism.joint_index)
        raise InvalidInput(where, f"there is no joint '{joint}'", f"Joints are: {known}.")
    kind = mechanism.joints[mechanism.joint_index[joint]].kind
    known = ", ".join(JOINT_KINDS[kind].coordinates) or "none"
    for name in coordinates:
        if name not in JOINT_KINDS[kind].coordinates:
            raise InvalidInput(f"{where}.{name}", f"a {kind} joint has no '{name}'", f"It has: {known}.")


def _guess(mechanism: Mechanism, name: str, guess: BodyGuess) -> tuple[str, Frame]:
    """Name and pose of a body before assembly; any pose for an unknown body, which assembly refuses."""
    if name not in mechanism.body_index or name == GROUND:
        return name, Frame(np.zeros(3), np.eye(3))
    drawn, given = mechanism.bodies[mechanism.body_index[name]].drawing, guess.orientation
    R = drawn.R if given is None else _matrix(given, f"initial.bodies.{name}.orientation")
    return name, Frame(drawn.p if guess.at is None else np.array(guess.at), R)


def _initial(mechanism: Mechanism, table: InitialTable, problems: list[InvalidInput]) -> Initial:
    def held(tables: Mapping[str, HeldTable], field: str) -> dict[str, dict[str, Any]]:
        def one(entry: tuple[str, HeldTable]) -> tuple[str, dict[str, Any]]:
            name, where = entry[0], f"initial.{field}.{entry[0]}"
            coordinates = _held(entry[1], where, field == "rates")
            _check_held(mechanism, name, coordinates, where)
            return name, coordinates

        return dict(gathered(one, tables.items(), problems))

    return Initial(
        coordinates=held(table.joints, "joints"),
        rates=held(table.rates, "rates"),
        poses=dict(gathered(lambda entry: _guess(mechanism, *entry), table.bodies.items(), problems)),
        velocities={n: (g.velocity, g.angular_velocity) for n, g in table.bodies.items()},
    )
