"""Schema of ``replay.json``, checked before a page is rendered: the folder of a report may come from anybody."""

from __future__ import annotations

from base64 import b64decode
from binascii import Error as NotBase64
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, model_validator

from consilience.case.bounded_reading import bounded_text
from consilience.errors import InvalidInput
from consilience.report.fields import NameField, StrictModel, first_problem

FORMAT = 1
NAME = "replay.json"
LARGEST_FILE = 200_000_000

_Number = Annotated[float, Field(ge=-1e30, le=1e30, allow_inf_nan=False)]
_Triple = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_Four = Annotated[list[_Number], Field(min_length=4, max_length=4)]
_Body = Annotated[int, Field(ge=-1, le=100_000)]


def _base64(text: str) -> str:
    try:
        b64decode(text, validate=True)
    except NotBase64 as error:
        raise ValueError(f"it is no base64 ({error})") from None
    return text


_Mode = Literal["separated", "sliding", "sticking", "closed"]
_Packed = Annotated[str, AfterValidator(_base64)]


class ReplayBody(StrictModel):
    """A centre of mass."""

    letter: NameField
    name: NameField
    body: _Body
    point: _Triple


class ReplayJoint(ReplayBody):
    """A joint."""

    kind: NameField
    axis: _Triple | None
    ground: bool
    between: Annotated[list[NameField], Field(min_length=2, max_length=2)]


class ReplayLine(StrictModel):
    """A line fixed to a body."""

    body: _Body
    kind: NameField
    points: Annotated[list[_Triple], Field(min_length=1, max_length=1_000)]


class ReplayTie(StrictModel):
    """A line between two bodies."""

    kind: NameField
    ends: Annotated[list[_Body], Field(min_length=2, max_length=2)]
    points: Annotated[list[_Triple], Field(min_length=2, max_length=2)]


class ReplayScene(StrictModel):
    """A mechanism as lines and labelled places."""

    gravity: _Triple
    p: list[_Triple]
    quat: list[_Four]
    bodies: list[ReplayBody]
    joints: list[ReplayJoint]
    lines: list[ReplayLine]
    ties: list[ReplayTie]


class ReplayPoses(StrictModel):
    """Poses of the reference."""

    middle: _Triple
    size: Annotated[float, Field(gt=0, le=1e30)]
    p: _Packed
    quat: _Packed
    how: NameField


class ReplayDifference(StrictModel):
    """Difference of the motion of an engine to the reference."""

    away: Annotated[float, Field(ge=0, le=1e30)]
    turn: Annotated[float, Field(ge=0, le=10)]
    p: _Packed
    r: _Packed
    how: NameField


class ReplayContact(StrictModel):
    """A contact at the frames: nearest points on both sides, gap, mean force on the body since the frame before."""

    name: NameField
    body: list[_Triple]
    partner: list[_Triple]
    gap: list[_Number]
    force: list[_Triple]
    mode: list[_Mode]
    open: list[bool] = Field(default_factory=list)
    """Whether equilibrium leaves the force open; absent in earlier files, as the next."""

    together: list[_Triple | None] = Field(default_factory=list)
    """Sum over all contacts of the two bodies, on `body`, where it is determined."""


class ReplayMotion(StrictModel):
    """A motion: `count` frames from time `start` in steps of `step`; the whole motion ends at `end`."""

    start: _Number
    step: _Number
    end: _Number
    count: Annotated[int, Field(ge=1, le=1_000)]
    reference: ReplayPoses
    engines: dict[NameField, ReplayDifference]
    contacts: list[ReplayContact] = Field(default_factory=list)
    """Of the reference; absent in earlier files."""

    @model_validator(mode="after")
    def _as_many(self) -> ReplayMotion:
        for c in self.contacts:
            newer = [x for x in (c.open, c.together) if x]
            if {len(x) for x in (c.body, c.partner, c.gap, c.force, c.mode, *newer)} != {self.count}:
                raise ValueError("values of a contact are not as many as frames")
        return self


class ReplayPhases(StrictModel):
    """Phases of a contact, of a stop or of a dry friction: pieces from start to end in a mode, and times of impacts."""

    name: NameField
    bodies: list[NameField]
    joint: NameField
    pieces: Annotated[list[tuple[_Number, _Number, _Mode]], Field(min_length=1)]
    impacts: list[_Number]


class ReplaySeries(StrictModel):
    """Reactions of each joint over time by the motion of one engine, and the violation of the joints."""

    force: list[list[_Number | None]]
    torque: list[list[_Number | None]]
    drift: list[_Number | None]


class ReplayCurves(StrictModel):
    """Values over time along the motions of all engines."""

    times: list[_Number]
    drift_times: list[_Number] = Field(default_factory=list)
    """Times of the violation; absent in earlier files, where they are `times`."""

    joints: list[NameField]
    engines: dict[NameField, ReplaySeries]

    @model_validator(mode="after")
    def _as_many(self) -> ReplayCurves:
        for one in self.engines.values():
            rows = [*one.force, *one.torque, *([] if self.drift_times else [one.drift])]
            if len(one.force) != len(self.joints) or len(one.torque) != len(self.joints):
                raise ValueError("values are not of as many joints")
            if any(len(row) != len(self.times) for row in rows):
                raise ValueError("values are not as many as times")
            if self.drift_times and len(one.drift) != len(self.drift_times):
                raise ValueError("violations are not as many as their times")
        return self


class ReplayCurveSet(StrictModel):
    """Curves of one kind, as `curves.CurveSet`: a row of values for each."""

    what: Literal["coordinates", "rates", "positions", "velocities", "energies", "reactions"]
    names: list[Annotated[list[NameField], Field(min_length=3, max_length=3)]]
    time: list[_Number]
    values: list[list[_Number]]
    open: list[_Number]
    panels: Annotated[int, Field(ge=0)]

    @model_validator(mode="after")
    def _as_many(self) -> ReplayCurveSet:
        if len({len(self.names), len(self.values), len(self.open)}) > 1:
            raise ValueError("curves are not as many as names")
        if any(len(row) != len(self.time) for row in self.values):
            raise ValueError("values of a curve are not as many as times")
        return self


class ReplayCase(StrictModel):
    """A case in motion."""

    case: NameField
    seed: int
    scene: ReplayScene
    motion: ReplayMotion | None
    along: ReplayCurves | None
    curves: list[ReplayCurveSet] = Field(default_factory=list)
    phases: dict[NameField, list[ReplayPhases]] = Field(default_factory=dict)
    """By engine; absent in earlier files."""

    @model_validator(mode="after")
    def _sizes(self) -> ReplayCase:
        count = len(self.scene.p)
        if count != len(self.scene.quat):
            raise ValueError("positions and orientations are not as many")
        held = [m.body for m in (*self.scene.bodies, *self.scene.joints)] + [m.body for m in self.scene.lines]
        if any(body >= count for body in (*held, *(i for tie in self.scene.ties for i in tie.ends))):
            raise ValueError("something is fixed to a body that is not there")
        if self.motion is not None:
            m = self.motion
            parts = [(m.reference.p, 3), (m.reference.quat, 4)]
            parts += [(text, 3) for engine in m.engines.values() for text in (engine.p, engine.r)]
            if any(len(b64decode(text)) != 2 * n * count * m.count for text, n in parts):
                raise ValueError("a motion has another number of values than frames, bodies and components make")
        return self


class ReplayFile(StrictModel):
    """The file."""

    format: Literal[FORMAT]  # type: ignore[valid-type]
    cases: list[ReplayCase]


_FILE: TypeAdapter[ReplayFile] = TypeAdapter(ReplayFile)


def read_replay(folder: Path) -> dict[str, dict[str, Any]]:
    """Read the replays of a folder, by case; empty if there is no file.

    Raises
    ------
    InvalidInput
        If the file violates the schema.
    """
    path = folder / NAME
    if not path.exists():
        return {}
    try:
        found = _FILE.validate_json(bounded_text(path, LARGEST_FILE))
    except ValidationError as error:
        what = f"it is no replay of a report ({first_problem(error)})"
        raise InvalidInput(str(path), what, "Run the suite again, or remove it.") from None
    return {one.case: one.model_dump() for one in found.cases}
