"""The tables of a case file, field by field, with the checks one field or table can make on its own.

The JSON Schema of these classes is the published one (``consilience schema case``).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from consilience.functions import Function, Table
from consilience.mechanism import JOINT_KINDS
from consilience.spatial import (
    Array,
    rotation_from_bryant_xyz,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
    rotation_from_three_points,
)

Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Finite], Field(min_length=4, max_length=4)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]


_MANY = Field(max_length=20_000)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=False, frozen=True)


class Orientation(_Table):
    """Orientation, in exactly one of four ways."""

    quaternion: Quaternion | None = Field(
        None, description="Unit quaternion, scalar first; unit to 1e-9, the rounding of its digits is removed."
    )
    euler_zxz: Vector | None = Field(
        None, description="Euler angles (phi, theta, psi) in rad: Rz(phi) Rx(theta) Rz(psi)."
    )
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


class CurveTable(_Table):
    """A smooth curve through points, a spline of degree five; it ends with them or is periodic."""

    x: Annotated[list[Finite], Field(min_length=6, max_length=10_000)] = Field(description="Increasing.")
    y: Annotated[list[Finite], Field(min_length=6, max_length=10_000)] = Field(description="As many as x.")
    periodic: bool = Field(False, description="It repeats with the period x[-1] - x[0]; then y[-1] = y[0].")

    @model_validator(mode="after")
    def _pairs(self) -> CurveTable:
        if len(self.x) != len(self.y):
            raise ValueError(f"there are {len(self.x)} values of x and {len(self.y)} of y; give as many")
        return self


class FunctionTable(_Table):
    """Sum of ``c_k x^k``, ``a sin(w x + phi)`` and a curve; x is the time in s, or a joint coordinate."""

    polynomial: Annotated[list[Finite], Field(min_length=1, max_length=32)] | None = Field(
        None, description="Coefficients of 1, x, x^2, ..."
    )
    harmonics: Annotated[list[Vector], Field(min_length=1, max_length=1_000)] | None = Field(
        None, description="Amplitude, angular frequency and phase (rad) of each sine."
    )
    table: CurveTable | None = None

    @model_validator(mode="after")
    def _something(self) -> FunctionTable:
        if self.polynomial is None and self.harmonics is None and self.table is None:
            raise ValueError("the function is empty; give polynomial, harmonics, table, or several of them")
        return self

    def function(self) -> Function:
        """Function of the core; raises InvalidInput for points no curve goes through."""
        t = self.table
        return Function(
            np.array(self.polynomial or []),
            np.array(self.harmonics or []),
            None if t is None else Table(np.array(t.x), np.array(t.y), t.periodic),
        )


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
    pitch: Finite | None = Field(
        None, description="Screw only: advance along the axis in a turn, m; positive for a right-handed one."
    )


AxisCoordinate = Literal["angle", "distance"]


class SpringTable(_Table):
    """Spring-damper-actuator between two points."""

    name: Name
    predecessor: str
    successor: str
    at: Vector = Field(description="Point on the predecessor in the drawing, m.")
    to: Vector = Field(description="Point on the successor in the drawing, m.")
    stiffness: Finite = Field(description="N/m.")
    damping: Finite = Field(0.0, description="N s/m.")
    free_length: Finite = Field(description="m.")
    actuator: FunctionTable | None = Field(None, description="Force over time that pushes the points apart, N.")


class JointSpringTable(_Table):
    """Spring-damper-actuator about or along the axis of a joint."""

    name: Name
    joint: str
    coordinate: AxisCoordinate
    stiffness: Finite = Field(description="N m/rad or N/m.")
    damping: Finite = Field(0.0, description="N m s/rad or N s/m.")
    rest: Finite = Field(0.0, description="Coordinate at which the spring is free, rad or m.")
    actuator: FunctionTable | None = Field(None, description="Effort on the successor over time, N m or N.")


class FrictionTable(_Table):
    """Viscous and regularised Coulomb friction in a joint, ``-(viscous q' + coulomb tanh(q' / speed))``."""

    name: Name
    joint: str
    coordinate: AxisCoordinate
    viscous: Finite = Field(0.0, description="N m s/rad or N s/m.")
    coulomb: Finite = Field(0.0, description="Friction of sliding, N m or N.")
    speed: Finite | None = Field(None, description="Speed that regularises the Coulomb part, rad/s or m/s.")


class ControlTable(_Table):
    """PID control of a joint coordinate, ``P e + I int e dt + D e'`` with ``e = target(t) - q``."""

    name: Name
    joint: str
    coordinate: AxisCoordinate
    target: FunctionTable = Field(description="Over time, rad or m.")
    proportional: Finite = Field(description="N m/rad or N/m.")
    integral: Finite = 0.0
    derivative: Finite = 0.0


class DriveTable(_Table):
    """A joint coordinate as a function of time."""

    name: Name
    joint: str
    coordinate: AxisCoordinate
    motion: FunctionTable = Field(description="Over time, rad or m.")


class CouplingTable(_Table):
    """A joint coordinate as a function of another one: gear, rack and pinion, cam."""

    name: Name
    driver_joint: str
    driver_coordinate: AxisCoordinate
    joint: str
    coordinate: AxisCoordinate
    ratio: Finite | None = Field(None, description="Coordinate per driving coordinate.")
    offset: Finite | None = Field(None, description="With ratio only: coordinate where the driving one is zero.")
    law: FunctionTable | None = Field(None, description="Of the driving coordinate, in place of ratio.")

    @model_validator(mode="after")
    def _exactly_one(self) -> CouplingTable:
        if (self.ratio is None) == (self.law is None):
            count = 0 if self.law is None else 2
            raise ValueError(f"{count} of ratio and law given; give exactly one of them")
        if self.law is not None and self.offset is not None:
            raise ValueError("an offset goes with a ratio; put it into the polynomial of the law")
        return self


class RollingTable(_Table):
    """A disc, torus or ball that rolls without slipping on a plane of the world."""

    name: Name
    body: str
    at: Vector = Field(description="Centre of the circle, or of the ball, in the drawing, m.")
    axis: Vector | None = Field(None, description="Normal of the circle in the drawing; a ball needs none.")
    radius: Finite = Field(0.0, description="Of the circle, m; zero for a ball.")
    rounding: Finite = Field(0.0, description="Radius of the tube about the circle, m: zero for a sharp edge.")
    point: Vector = Field(description="A point of the plane, in the world, m.")
    normal: Vector = Field(description="Normal of the plane towards the body, in the world.")


class SkateTable(_Table):
    """A knife edge: a point of a body does not move along a direction of the body."""

    name: Name
    body: str
    at: Vector = Field(description="The point in the drawing, m.")
    lateral: Vector = Field(description="Direction in the drawing in which it does not move; it turns with the body.")


class ForceTable(_Table):
    """Force on a body."""

    name: Name
    body: str
    vector: Vector = Field(description="N, in the axes that `frame` names.")
    frame: Literal["world", "body"]
    at: Vector = Field(description="Point of application in the drawing, m; it moves with the body.")
    history: FunctionTable | None = Field(None, description="Factor of `vector` over time; default: one.")


class TorqueTable(_Table):
    """Torque on a body."""

    name: Name
    body: str
    vector: Vector = Field(description="N m, in the axes that `frame` names.")
    frame: Literal["world", "body"]
    history: FunctionTable | None = Field(None, description="Factor of `vector` over time; default: one.")


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


class PublishedTable(_Table):
    """Values of the motion known from elsewhere, at one time, with their own uncertainty."""

    body: Name
    observable: Literal["p_WB", "v_WB_W", "w_WB_W"]
    time: Annotated[float, Field(ge=0, allow_inf_nan=False)] = Field(description="s; on the sample grid.")
    value: Vector = Field(description="World axes; m, m/s or rad/s.")
    uncertainty: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(description="Of each component.")
    source: str


class VariantTable(_Table):
    """What a variant changes; a file with variants stands for them alone."""

    title: str
    initial: InitialTable | None = None
    trajectory: TrajectoryTable | None = None
    published: list[PublishedTable] = Field(default_factory=list)


class CaseTable(_Table):
    """A case file. SI units, radians, right-handed frames."""

    title: str
    sources: Annotated[list[str], Field(min_length=1)]
    remarks: str = ""
    tags: list[str] = Field(default_factory=list)
    gravity: Vector = Field(description="m/s^2, in world axes.")
    body: Annotated[list[BodyTable], Field(min_length=1, max_length=10_000)]
    joint: Annotated[list[JointTable], Field(min_length=1, max_length=20_000)]
    spring: Annotated[list[SpringTable], _MANY] = Field(default_factory=list)
    joint_spring: Annotated[list[JointSpringTable], _MANY] = Field(default_factory=list)
    force: Annotated[list[ForceTable], _MANY] = Field(default_factory=list)
    torque: Annotated[list[TorqueTable], _MANY] = Field(default_factory=list)
    friction: Annotated[list[FrictionTable], _MANY] = Field(default_factory=list)
    control: Annotated[list[ControlTable], _MANY] = Field(default_factory=list)
    drive: Annotated[list[DriveTable], _MANY] = Field(default_factory=list)
    coupling: Annotated[list[CouplingTable], _MANY] = Field(default_factory=list)
    rolling: Annotated[list[RollingTable], _MANY] = Field(default_factory=list)
    skate: Annotated[list[SkateTable], _MANY] = Field(default_factory=list)
    initial: InitialTable = Field(default_factory=InitialTable)
    trajectory: TrajectoryTable = Field(default_factory=TrajectoryTable)
    instant: InstantTable = Field(default_factory=InstantTable)
    published: list[PublishedTable] = Field(default_factory=list)
    variants: dict[Name, VariantTable] = Field(default_factory=dict)


def case_schema() -> dict[str, Any]:
    """JSON Schema of a case file."""
    schema = CaseTable.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "Consilience case file"}
