"""The tables of a case file, field by field, with the checks of single fields and tables.

The JSON Schema of these classes is the published one (``consilience schema case``).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, Strict, model_validator

from consilience.case.file.contact_schema import ContactTable, DryFrictionTable, StopTable
from consilience.case.file.values import (
    AxisCoordinate,
    Finite,
    FunctionTable,
    InJoint,
    Name,
    Orientation,
    Positive,
    Powers,
    TableModel,
    Text,
    Triple,
)
from consilience.case.published import ACCELERATIONS, CONTACT_FORCE, OF_A_BODY, OF_A_JOINT, REACTIONS, Origin, owner_of
from consilience.mechanism import JOINT_KINDS, Array

_MANY = Field(max_length=2_000)
"""Largest number of joints or elements of a kind: with `MOST_BODIES` bodies the equations fill a few hundred MB."""

MOST_BODIES = 1_000
MOST_SAMPLES = 1_000_000


class InertiaTable(TableModel):
    """Inertia tensor about the centre of mass in body axes, kg m^2. Products are tensor entries: xy = -sum m x y."""

    xx: Finite
    yy: Finite
    zz: Finite
    xy: Finite = 0.0
    xz: Finite = 0.0
    yz: Finite = 0.0

    @model_validator(mode="before")
    @classmethod
    def _no_list(cls, given: object) -> object:
        if isinstance(given, list):
            raise ValueError("a list is no inertia of a file; give a table, { xx = 0.1, yy = 0.1, zz = 0.2 }")
        return given

    def tensor(self) -> Array:
        """Return the tensor, shape (3, 3), kg m^2."""
        return np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])


class BodyTable(TableModel):
    """A rigid body."""

    name: Name
    mass: Finite = Field(description="kg, positive.")
    inertia: InertiaTable
    at: Triple = Field(description="Origin of the body in the drawing, m.")
    orientation: Orientation | None = Field(None, description="Axes of the body in the drawing; default: the world's.")
    com: Triple = Field([0.0, 0.0, 0.0], description="Centre of mass from the origin, in body axes, m.")


class FrameTable(TableModel):
    """A frame fixed to a body."""

    at: Triple = Field(description="Origin from that of the body, in body axes, m.")
    orientation: Orientation | None = Field(None, description="Axes in those of the body; default: the same.")


class JointTable(TableModel):
    """A joint, drawn as a frame in the world, or with a frame on each of its bodies."""

    name: Name
    kind: Literal[tuple(JOINT_KINDS)]  # type: ignore[valid-type]
    predecessor: Name
    successor: Name
    at: Triple | None = Field(None, description="Origin of F (and of M, but for the rod) in the drawing, m.")
    axis: Triple | None = Field(None, description="z of F and M in the drawing; universal: the axis fixed in F.")
    second_axis: Triple | None = Field(None, description="x of F and M; universal: the axis fixed in M.")
    to: Triple | None = Field(None, description="Rod only: its other end, on the successor, in the drawing, m.")
    pitch: Finite | None = Field(
        None, description="Screw only: advance along the axis in a turn, m; positive for a right-handed one."
    )
    F: FrameTable | None = Field(None, description="In place of a drawing, with M: the frame on the predecessor.")
    M: FrameTable | None = Field(None, description="In place of a drawing, with F: the frame on the successor.")
    length: Positive | None = Field(None, description="Rod with F and M only: its length, m.")


class SpringTable(TableModel):
    """Spring-damper-actuator between two points."""

    name: Name
    predecessor: Name
    successor: Name
    at: Triple = Field(description="Point on the predecessor in the drawing, m.")
    to: Triple = Field(description="Point on the successor in the drawing, m.")
    stiffness: Finite = Field(description="N/m.")
    damping: Finite = Field(0.0, description="N s/m.")
    free_length: Finite = Field(description="m.")
    actuator: FunctionTable | None = Field(None, description="Force over time that pushes the points apart, N.")


class JointSpringTable(InJoint):
    """Spring-damper-actuator about or along the axis of a joint, linear or with polynomials of degree three.

    ``-(k x + k1 x^2 + k2 x^3) - (c + c1 |v| + c2 v^2) v + f(t)``, x: coordinate less the rest, v: its rate.
    """

    stiffness: Powers = Field(description="k, N m/rad or N/m; or [k, k1, k2], each per a further rad or m.")
    damping: Powers = Field(
        0.0,  # checked, and then a list
        validate_default=True,
        description="c, N m s/rad or N s/m; or [c, c1, c2], each per a further rad/s or m/s.",
    )
    rest: Finite = Field(0.0, description="Coordinate at which the spring is free, rad or m.")
    actuator: FunctionTable | None = Field(None, description="Effort on the successor over time, N m or N.")


class FrictionTable(InJoint):
    """Viscous and regularised Coulomb friction in a joint, ``-(viscous q' + coulomb tanh(q' / speed))``."""

    viscous: Finite = Field(0.0, description="N m s/rad or N s/m.")
    coulomb: Finite = Field(0.0, description="Friction of sliding, N m or N.")
    speed: Finite | None = Field(None, description="Speed that regularises the Coulomb part, rad/s or m/s.")


class ControlTable(InJoint):
    """PID control of a joint coordinate, ``P e + I int e dt + D e'`` with ``e = target(t) - q``."""

    target: FunctionTable = Field(description="Over time, rad or m.")
    proportional: Finite = Field(description="N m/rad or N/m.")
    integral: Finite = 0.0
    derivative: Finite = 0.0


class DriveTable(InJoint):
    """A joint coordinate as a function of time."""

    motion: FunctionTable = Field(description="Over time, rad or m.")


class CouplingTable(TableModel):
    """A joint coordinate as a function of another one: gear, rack and pinion, cam."""

    name: Name
    driver_joint: Name
    driver_coordinate: AxisCoordinate
    joint: Name
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


class RollingTable(TableModel):
    """A disc, torus or ball that rolls without slipping on a plane of the world."""

    name: Name
    body: Name
    at: Triple = Field(description="Centre of the circle, or of the ball, in the drawing, m.")
    axis: Triple | None = Field(None, description="Normal of the circle in the drawing; a ball needs none.")
    radius: Finite = Field(0.0, description="Of the circle, m; zero for a ball.")
    rounding: Finite = Field(0.0, description="Radius of the tube about the circle, m: zero for a sharp edge.")
    point: Triple = Field(description="A point of the plane, in the world, m.")
    normal: Triple = Field(description="Normal of the plane towards the body, in the world.")


class SkateTable(TableModel):
    """A knife edge: a point of a body does not move along a direction of the body."""

    name: Name
    body: Name
    at: Triple = Field(description="The point in the drawing, m.")
    lateral: Triple = Field(description="Direction in the drawing in which it does not move; it turns with the body.")


class ForceTable(TableModel):
    """Force on a body."""

    name: Name
    body: Name
    vector: Triple = Field(description="N, in the axes that `frame` names.")
    frame: Literal["world", "body"]
    at: Triple = Field(description="Point of application in the drawing, m; it moves with the body.")
    history: FunctionTable | None = Field(None, description="Factor of `vector` over time; default: one.")


class TorqueTable(TableModel):
    """Torque on a body."""

    name: Name
    body: Name
    vector: Triple = Field(description="N m, in the axes that `frame` names.")
    frame: Literal["world", "body"]
    history: FunctionTable | None = Field(None, description="Factor of `vector` over time; default: one.")


class HeldTable(TableModel):
    """Held joint coordinates (or, under `rates`, their rates)."""

    angle: Finite | None = None
    distance: Finite | None = None
    x: Finite | None = None
    y: Finite | None = None
    angle1: Finite | None = None
    angle2: Finite | None = None
    position: Triple | None = None
    orientation: Orientation | None = Field(None, description="Of M in F (coordinates only).")
    angular_velocity: Triple | None = Field(None, description="Of M relative to F, in axes of F (rates only), rad/s.")


class BodyGuess(TableModel):
    """Where a body starts, before assembly, in place of its pose in the drawing."""

    at: Triple | None = None
    orientation: Orientation | None = None
    velocity: Triple = Field([0.0, 0.0, 0.0], description="Of the origin, world axes, m/s.")
    angular_velocity: Triple = Field([0.0, 0.0, 0.0], description="World axes, rad/s.")


class InitialTable(TableModel):
    """Initial state: held coordinates and rates, guesses for bodies; the rest is assembled."""

    joints: dict[Name, HeldTable] = Field(default_factory=dict)
    rates: dict[Name, HeldTable] = Field(default_factory=dict)
    bodies: dict[Name, BodyGuess] = Field(default_factory=dict)


class TrajectoryTable(TableModel):
    """What to ask of a trajectory."""

    duration: Positive = Field(5.0, description="s.")
    sample: Positive = Field(0.05, description="s; divides the duration.")
    digits: Annotated[int, Strict(), Field(ge=1, le=12)] = 8

    @model_validator(mode="after")
    def _sample_divides(self) -> TrajectoryTable:
        count = min(self.duration / self.sample, 2.0 * MOST_SAMPLES)
        if abs(count - round(count)) > 1e-9 * count or not 1 <= round(count) <= MOST_SAMPLES:
            raise ValueError(f"the sample must divide the duration into 1 to {MOST_SAMPLES} intervals")
        return self


class InstantTable(TableModel):
    """What to ask at single instants."""

    states: Annotated[int, Strict(), Field(ge=1, le=10_000)] = 20
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**63)] = 1


class Components(TableModel):
    """The components of a vector that are known."""

    x: Finite | None = None
    y: Finite | None = None
    z: Finite | None = None


class PublishedTable(TableModel):
    """Expected values at one time, with their uncertainty: vectors of bodies and contacts, coordinates of joints.

    Reactions at times after the start are those of least norm where equilibrium leaves them open.
    """

    body: Name | None = None
    joint: Name | None = None
    contact: Name | None = None
    observable: Literal[(*OF_A_BODY, *ACCELERATIONS, *OF_A_JOINT, *REACTIONS, CONTACT_FORCE)]  # type: ignore[valid-type]
    time: Annotated[Finite, Field(ge=0)] = Field(description="s; on the sample grid.")
    value: Finite | Triple | Components = Field(description="SI units; vectors in world axes, reactions in those of F.")
    uncertainty: Positive = Field(description="Of each component.")
    origin: Origin = Field(description="Who knows it: a source that prints it, a formula, two computations.")
    source: Text = Field(description="Publication and place, formula, or first computation.")
    second: Text = Field("", description="Second, independent computation of a value that no source prints.")

    @model_validator(mode="after")
    def _fits(self) -> PublishedTable:
        owner = owner_of(self.observable)
        given = [name for name in ("body", "joint", "contact") if getattr(self, name) is not None]
        if given != [owner]:
            raise ValueError(f"{self.observable} is an observable of a {owner}; name the {owner} and nothing else")
        if owner == "contact" and self.time:
            raise ValueError("a contact force is expected at the start; give the time 0")
        if (self.observable in OF_A_JOINT) != isinstance(self.value, float | int):
            right = "one number" if self.observable in OF_A_JOINT else "three numbers, or those of x, y and z known"
            raise ValueError(f"{self.observable} has another shape; give {right}")
        if not self.components():
            raise ValueError("the value has no component; give x, y or z")
        if (self.origin == "computed") != bool(self.second):
            raise ValueError("a computed value has a second, independent computation, and no other has one")
        return self

    def components(self) -> dict[int, float]:
        """Return the known components by index; a scalar has the index 0."""
        if isinstance(self.value, Components):
            return {k: v for k, v in enumerate((self.value.x, self.value.y, self.value.z)) if v is not None}
        return dict(enumerate(self.value if isinstance(self.value, list) else [self.value]))


class VariantTable(TableModel):
    """Changes of a variant; a file with variants has no case but the variants."""

    title: Text
    initial: InitialTable | None = None
    trajectory: TrajectoryTable | None = None
    published: Annotated[list[PublishedTable], _MANY] = Field(default_factory=list)


class CaseTable(TableModel):
    """A case file. SI units, radians, right-handed frames."""

    title: Text
    sources: Annotated[list[Text], Field(max_length=100)] = Field(default_factory=list)
    remarks: Text = ""
    tags: Annotated[list[Text], Field(max_length=100)] = Field(default_factory=list)
    gravity: Triple = Field(description="m/s^2, in world axes.")
    body: Annotated[list[BodyTable], Field(min_length=1, max_length=MOST_BODIES)]
    joint: Annotated[list[JointTable], Field(min_length=1), _MANY]
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
    contact: Annotated[list[ContactTable], _MANY] = Field(default_factory=list)
    stop: Annotated[list[StopTable], _MANY] = Field(default_factory=list)
    dry_friction: Annotated[list[DryFrictionTable], _MANY] = Field(default_factory=list)
    initial: InitialTable = Field(default_factory=InitialTable)
    trajectory: TrajectoryTable = Field(default_factory=TrajectoryTable)
    instant: InstantTable = Field(default_factory=InstantTable)
    published: Annotated[list[PublishedTable], _MANY] = Field(default_factory=list)
    variants: Annotated[dict[Name, VariantTable], Field(max_length=100)] = Field(default_factory=dict)


def case_schema() -> dict[str, Any]:
    """Return the JSON Schema of a case file."""
    schema = CaseTable.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "Consilience case file"}
