"""Case files: TOML a person can read top to bottom, checked field by field.

The mechanism is drawn in the world in an assembled pose. A joint is written once, as a frame in the drawing; F and M
coincide there, so joint coordinates are zero in the drawing. The schema below is the published one
(``consilience schema case``).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from consilience.assembly import Initial
from consilience.case import Case
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Body,
    Frame,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Spring,
)
from consilience.spatial import (
    Array,
    rotation_from_bryant_xyz,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
    rotation_from_three_points,
    rotation_with_z_axis,
)

Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Finite], Field(min_length=4, max_length=4)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=False, frozen=True)


class Orientation(_Table):
    """Orientation, in exactly one of four ways."""

    quaternion: Quaternion | None = Field(
        None, description="Unit quaternion, scalar first; unit to 1e-9, the rounding of its digits is removed."
    )
    euler_zxz: Vector | None = Field(None, description="Euler angles (phi, theta, psi) in rad: Rz(phi) Rx(theta) Rz(psi).")
    bryant_xyz: Vector | None = Field(None, description="Bryant angles (alpha, beta, gamma) in rad: Rx Ry Rz.")
    three_points: Annotated[list[Vector], Field(min_length=3, max_length=3)] | None = Field(
        None, description="Points O, P, Q in the world: origin, a point on x, a point in the xy plane."
    )

    @model_validator(mode="after")
    def _exactly_one(self) -> Orientation:
        given = [n for n in ("quaternion", "euler_zxz", "bryant_xyz", "three_points") if getattr(self, n) is not None]
        if len(given) != 1:
            raise ValueError(
                f"{len(given)} ways given; give exactly one of quaternion, euler_zxz, bryant_xyz, three_points"
            )
        if self.quaternion is not None and abs(np.linalg.norm(self.quaternion) - 1.0) > 1e-9:
            norm = np.linalg.norm(self.quaternion)
            raise ValueError(f"the quaternion has norm {norm:.9g}; give a unit quaternion, scalar first")
        return self

    def matrix(self) -> Array:
        """Rotation matrix; raises ValueError for three points on one line."""
        if self.quaternion is not None:
            return rotation_from_quaternion(np.array(self.quaternion) / np.linalg.norm(self.quaternion))
        if self.euler_zxz is not None:
            return rotation_from_euler_zxz(self.euler_zxz)
        if self.bryant_xyz is not None:
            return rotation_from_bryant_xyz(self.bryant_xyz)
        assert self.three_points is not None
        return rotation_from_three_points(*self.three_points)


class InertiaTable(_Table):
    """Inertia tensor about the centre of mass in body axes, kg m^2. Products are tensor entries: xy = -sum m x y."""

    xx: Finite
    yy: Finite
    zz: Finite
    xy: Finite = 0.0
    xz: Finite = 0.0
    yz: Finite = 0.0

    def tensor(self) -> Array:
        """3 x 3 tensor."""
        return np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])


class BodyTable(_Table):
    """A rigid body."""

    name: Name
    mass: Finite = Field(description="kg, positive.")
    inertia: InertiaTable
    at: Vector = Field(description="Origin of the body in the drawing, m.")
    orientation: Orientation | None = Field(None, description="Axes of the body in the drawing; default: the world's.")
    com: Vector = Field([0.0, 0.0, 0.0], description="Centre of mass from the origin, in body axes, m.")


class JointTable(_Table):
    """A joint, drawn as a frame in the world."""

    name: Name
    kind: Literal[tuple(JOINT_KINDS)]  # type: ignore[valid-type]
    predecessor: str
    successor: str
    at: Vector = Field(description="Origin of F (and of M, but for the rod) in the drawing, m.")
    axis: Vector | None = Field(None, description="z of F and M in the drawing; universal: the axis fixed in F.")
    second_axis: Vector | None = Field(None, description="x of F and M; universal: the axis fixed in M.")
    to: Vector | None = Field(None, description="Rod only: its other end, on the successor, in the drawing, m.")


class SpringTable(_Table):
    """Spring-damper between two points."""

    name: Name
    predecessor: str
    successor: str
    at: Vector = Field(description="Point on the predecessor in the drawing, m.")
    to: Vector = Field(description="Point on the successor in the drawing, m.")
    stiffness: Finite = Field(description="N/m.")
    damping: Finite = Field(0.0, description="N s/m.")
    free_length: Finite = Field(description="m.")


class JointSpringTable(_Table):
    """Spring-damper about or along the axis of a joint."""

    name: Name
    joint: str
    coordinate: Literal["angle", "distance"]
    stiffness: Finite = Field(description="N m/rad or N/m.")
    damping: Finite = Field(0.0, description="N m s/rad or N s/m.")
    rest: Finite = Field(0.0, description="Coordinate at which the spring is free, rad or m.")


class ForceTable(_Table):
    """Constant force on a body."""

    name: Name
    body: str
    vector: Vector = Field(description="N, in the axes that `frame` names.")
    frame: Literal["world", "body"]
    at: Vector = Field(description="Point of application in the drawing, m; it moves with the body.")


class TorqueTable(_Table):
    """Constant torque on a body."""

    name: Name
    body: str
    vector: Vector = Field(description="N m, in the axes that `frame` names.")
    frame: Literal["world", "body"]


class HeldTable(_Table):
    """Held joint coordinates (or, under `rates`, their rates)."""

    angle: Finite | None = None
    distance: Finite | None = None
    x: Finite | None = None
    y: Finite | None = None
    angle1: Finite | None = None
    angle2: Finite | None = None
    position: Vector | None = None
    orientation: Orientation | None = Field(None, description="Of M in F (coordinates only).")
    angular_velocity: Vector | None = Field(None, description="Of M relative to F, in axes of F (rates only), rad/s.")


class BodyGuess(_Table):
    """Where a body starts, before assembly, in place of its pose in the drawing."""

    at: Vector | None = None
    orientation: Orientation | None = None
    velocity: Vector = Field([0.0, 0.0, 0.0], description="Of the origin, world axes, m/s.")
    angular_velocity: Vector = Field([0.0, 0.0, 0.0], description="World axes, rad/s.")


class InitialTable(_Table):
    """Initial state: held coordinates and rates, guesses for bodies; the rest is assembled."""

    joints: dict[str, HeldTable] = Field(default_factory=dict)
    rates: dict[str, HeldTable] = Field(default_factory=dict)
    bodies: dict[str, BodyGuess] = Field(default_factory=dict)


class TrajectoryTable(_Table):
    """What to ask of a trajectory."""

    duration: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(5.0, description="s.")
    sample: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(0.05, description="s; divides the duration.")
    digits: Annotated[int, Field(ge=1, le=12)] = 8

    @model_validator(mode="after")
    def _sample_divides(self) -> TrajectoryTable:
        count = self.duration / self.sample
        if abs(count - round(count)) > 1e-9 * count or not 1 <= round(count) <= 1_000_000:
            raise ValueError("the sample must divide the duration into 1 to 1000000 intervals")
        return self


class InstantTable(_Table):
    """What to ask at single instants."""

    states: Annotated[int, Field(ge=1, le=100_000)] = 20
    seed: int = 1


class VariantTable(_Table):
    """What a variant changes; a file with variants stands for them alone."""

    title: str
    initial: InitialTable | None = None
    trajectory: TrajectoryTable | None = None


class CaseTable(_Table):
    """A case file. SI units, radians, right-handed frames."""

    title: str
    sources: Annotated[list[str], Field(min_length=1)]
    remarks: str = ""
    tags: list[str] = Field(default_factory=list)
    gravity: Vector = Field(description="m/s^2, in world axes.")
    body: Annotated[list[BodyTable], Field(min_length=1, max_length=10_000)]
    joint: Annotated[list[JointTable], Field(min_length=1, max_length=20_000)]
    spring: list[SpringTable] = Field(default_factory=list)
    joint_spring: list[JointSpringTable] = Field(default_factory=list)
    force: list[ForceTable] = Field(default_factory=list)
    torque: list[TorqueTable] = Field(default_factory=list)
    initial: InitialTable = Field(default_factory=InitialTable)
    trajectory: TrajectoryTable = Field(default_factory=TrajectoryTable)
    instant: InstantTable = Field(default_factory=InstantTable)
    variants: dict[Name, VariantTable] = Field(default_factory=dict)


def case_schema() -> dict[str, Any]:
    """JSON Schema of a case file."""
    schema = CaseTable.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "Consilience case file"}


def load_file(path: Path) -> list[Case]:
    """Cases of one file: itself, or one per variant.

    Raises
    ------
    InvalidInput
        With file, field, what is wrong and what would be right.
    """
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidInput(str(path), f"it cannot be read ({error.strerror})", "Give the path of a case file.") from None
    except UnicodeDecodeError:
        raise InvalidInput(str(path), "it is not UTF-8 text", "Give a TOML file.") from None
    except tomllib.TOMLDecodeError as error:
        raise InvalidInput(str(path), f"it is not valid TOML: {error}", "Mend the syntax there.") from None
    try:
        table = CaseTable.model_validate(raw)
    except ValidationError as error:
        raise _first_problem(path.name, raw, error) from None
    return _in_file(path.name, lambda: _cases(path.stem, table))


def _first_problem(file: str, raw: Mapping[str, Any], error: ValidationError) -> InvalidInput:
    problem = error.errors(include_url=False)[0]
    where = _location(raw, problem["loc"])
    more = error.error_count() - 1
    also = f" ({more} more problem{'s' * (more > 1)} in this file.)" if more else ""
    if problem["type"] == "extra_forbidden":
        remedy = "Remove it or correct its spelling; `consilience schema case` lists the fields."
        return InvalidInput(f"{file}: {where}", "unknown field", remedy + also)
    if problem["type"] == "missing":
        return InvalidInput(f"{file}: {where}", "the field is missing", "Add it." + also)
    message = problem["msg"].removeprefix("Value error, ")
    given = "" if isinstance(problem["input"], dict) else f" (given: {str(problem['input'])[:60]})"
    return InvalidInput(f"{file}: {where}", message[0].lower() + message[1:] + given, "See `consilience schema case`." + also)


def _location(raw: Any, loc: tuple[int | str, ...]) -> str:
    """Path of a field as a reader finds it: list entries by their name."""
    text = ""
    for part in loc:
        if isinstance(part, int):
            entry = raw[part] if isinstance(raw, list) and part < len(raw) else None
            name = entry.get("name") if isinstance(entry, dict) else None
            text += f" '{name}'" if isinstance(name, str) else f"[{part}]"
            raw = entry
        else:
            text += f".{part}" if text else part
            raw = raw.get(part) if isinstance(raw, dict) else None
    return text


def _in_file(file: str, build: Any) -> Any:
    try:
        return build()
    except InvalidInput as error:
        raise type(error)(f"{file}: {error.where}", error.what, error.remedy) from None


def _cases(stem: str, table: CaseTable) -> list[Case]:
    mechanism = _mechanism(stem, table)
    if not table.variants:
        return [_case(stem, table.title, table, mechanism, table.initial, table.trajectory)]
    return [
        _case(f"{stem}-{name}", v.title, table, mechanism, v.initial or table.initial, v.trajectory or table.trajectory)
        for name, v in table.variants.items()
    ]


def _case(
    name: str, title: str, table: CaseTable, mechanism: Mechanism, initial: InitialTable, span: TrajectoryTable
) -> Case:
    return Case(
        name=name,
        title=title,
        mechanism=mechanism,
        initial=_initial(mechanism, initial),
        duration=span.duration,
        sample=span.sample,
        digits=span.digits,
        instants=table.instant.states,
        seed=table.instant.seed,
        sources=tuple(table.sources),
        remarks=table.remarks.strip(),
        tags=tuple(table.tags),
    )


def _matrix(orientation: Orientation | None, where: str) -> Array:
    try:
        return np.eye(3) if orientation is None else orientation.matrix()
    except ValueError as error:
        raise InvalidInput(where, str(error), "Give three points that span a plane.") from None


def _mechanism(name: str, table: CaseTable) -> Mechanism:
    bodies = tuple(
        Body(
            b.name,
            b.mass,
            np.array(b.com),
            b.inertia.tensor(),
            Frame(np.array(b.at), _matrix(b.orientation, f"body '{b.name}': orientation.three_points")),
        )
        for b in table.body
    )
    drawing = {GROUND: Frame(np.zeros(3), np.eye(3))} | {b.name: b.drawing for b in bodies}
    loads = [_force(f, drawing) for f in table.force]
    loads += [Load(t.name, "torque", t.body, np.array(t.vector), t.frame) for t in table.torque]
    return Mechanism(
        name=name,
        gravity=np.array(table.gravity),
        bodies=bodies,
        joints=tuple(_joint(j, drawing) for j in table.joint),
        springs=tuple(_spring(s, drawing) for s in table.spring),
        joint_springs=tuple(
            JointSpring(s.name, s.joint, s.coordinate, s.stiffness, s.damping, s.rest) for s in table.joint_spring
        ),
        loads=tuple(loads),
    )


def _drawn(drawing: Mapping[str, Frame], body: str, where: str) -> Frame:
    if body not in drawing:
        raise InvalidInput(where, f"there is no body '{body}'", f"Bodies are: {', '.join(drawing)}.")
    return drawing[body]


def _point_in(drawing: Mapping[str, Frame], body: str, point: list[float], where: str) -> Array:
    frame = _drawn(drawing, body, where)
    return frame.R.T @ (np.array(point) - frame.p)


def _force(f: ForceTable, drawing: Mapping[str, Frame]) -> Load:
    point = _point_in(drawing, f.body, f.at, f"force '{f.name}': body")
    return Load(f.name, "force", f.body, np.array(f.vector), f.frame, point)


def _spring(s: SpringTable, drawing: Mapping[str, Frame]) -> Spring:
    where = f"spring '{s.name}'"
    return Spring(
        s.name,
        s.predecessor,
        s.successor,
        _point_in(drawing, s.predecessor, s.at, f"{where}: predecessor"),
        _point_in(drawing, s.successor, s.to, f"{where}: successor"),
        s.stiffness,
        s.damping,
        s.free_length,
    )


def _joint_axes(j: JointTable) -> Array:
    """Axes of F and M in the world of the drawing."""
    where = f"joint '{j.name}'"
    axis = j.axis
    if j.kind == "rod":
        if j.to is None:
            raise InvalidInput(f"{where}: to", "the field is missing", "Give the other end of the rod in the drawing.")
        if j.axis is not None:
            raise InvalidInput(f"{where}: axis", "a rod has none", "Remove it: z of F is along the rod as drawn.")
        axis = [b - a for a, b in zip(j.at, j.to, strict=True)]
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


def _joint(j: JointTable, drawing: Mapping[str, Frame]) -> Joint:
    where = f"joint '{j.name}'"
    axes = _joint_axes(j)
    start, end = _drawn(drawing, j.predecessor, where), _drawn(drawing, j.successor, where)
    at, to = np.array(j.at), np.array(j.at if j.to is None else j.to)
    return Joint(
        name=j.name,
        kind=j.kind,
        predecessor=j.predecessor,
        successor=j.successor,
        F=Frame(start.R.T @ (at - start.p), start.R.T @ axes),
        M=Frame(end.R.T @ (to - end.p), end.R.T @ axes),
        length=float(np.linalg.norm(to - at)),
    )


def _held(table: HeldTable, where: str, rates: bool) -> dict[str, Any]:
    wrong = "orientation" if rates else "angular_velocity"
    if getattr(table, wrong) is not None:
        right = "angular_velocity" if rates else "orientation"
        raise InvalidInput(f"{where}.{wrong}", "it does not belong here", f"Use {right}.")
    held: dict[str, Any] = {n: v for n, v in table.model_dump(exclude={"orientation"}).items() if v is not None}
    if "angular_velocity" in held:
        held["orientation"] = held.pop("angular_velocity")
    if table.orientation is not None:
        from consilience.spatial import quaternion_from_rotation

        held["orientation"] = quaternion_from_rotation(_matrix(table.orientation, f"{where}.orientation"))
    return held


def _initial(mechanism: Mechanism, table: InitialTable) -> Initial:
    poses = {}
    for name, guess in table.bodies.items():
        if name in mechanism.body_index and name != GROUND:
            drawn = mechanism.bodies[mechanism.body_index[name]].drawing
            R = drawn.R if guess.orientation is None else _matrix(guess.orientation, f"initial.bodies.{name}.orientation")
            poses[name] = Frame(drawn.p if guess.at is None else np.array(guess.at), R)
        else:
            poses[name] = Frame(np.zeros(3), np.eye(3))  # assembly names the unknown body
    return Initial(
        coordinates={n: _held(t, f"initial.joints.{n}", rates=False) for n, t in table.joints.items()},
        rates={n: _held(t, f"initial.rates.{n}", rates=True) for n, t in table.rates.items()},
        poses=poses,
        velocities={n: (g.velocity, g.angular_velocity) for n, g in table.bodies.items()},
    )
