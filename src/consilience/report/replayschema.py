"""What ``replay.json`` has to be before a page is made of it: the folder of a report may come from anybody."""

from __future__ import annotations

from base64 import b64decode
from binascii import Error as NotBase64
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from consilience.case.bounded_reading import bounded_text
from consilience.errors import InvalidInput

FORMAT = 1
NAME = "replay.json"
LARGEST_FILE = 200_000_000

_Number = Annotated[float, Field(ge=-1e30, le=1e30, allow_inf_nan=False)]
_Triple = Annotated[list[_Number], Field(min_length=3, max_length=3)]
_Four = Annotated[list[_Number], Field(min_length=4, max_length=4)]
_Name = Annotated[str, Field(max_length=1_000)]
_Body = Annotated[int, Field(ge=-1, le=100_000)]


def _base64(text: str) -> str:
    try:
        b64decode(text, validate=True)
    except NotBase64 as error:
        raise ValueError(f"it is no base64 ({error})") from None
    return text


_Packed = Annotated[str, AfterValidator(_base64)]


class _Table(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


class BodyTable(_Table):
    """A centre of mass."""

    letter: _Name
    name: _Name
    body: _Body
    point: _Triple


class JointTable(BodyTable):
    """A joint."""

    kind: _Name
    axis: _Triple | None
    ground: bool
    between: Annotated[list[_Name], Field(min_length=2, max_length=2)]


class LineTable(_Table):
    """A line on a body."""

    body: _Body
    kind: _Name
    points: Annotated[list[_Triple], Field(min_length=1, max_length=1_000)]


class TieTable(_Table):
    """A line between two bodies."""

    kind: _Name
    ends: Annotated[list[_Body], Field(min_length=2, max_length=2)]
    points: Annotated[list[_Triple], Field(min_length=2, max_length=2)]


class SceneTable(_Table):
    """A mechanism as it is drawn."""

    gravity: _Triple
    p: list[_Triple]
    quat: list[_Four]
    bodies: list[BodyTable]
    joints: list[JointTable]
    lines: list[LineTable]
    ties: list[TieTable]


class PosesTable(_Table):
    """Poses of the reference."""

    middle: _Triple
    size: Annotated[float, Field(gt=0, le=1e30)]
    p: _Packed
    quat: _Packed
    how: _Name


class DifferenceTable(_Table):
    """Difference of an engine."""

    away: Annotated[float, Field(ge=0, le=1e30)]
    turn: Annotated[float, Field(ge=0, le=10)]
    p: _Packed
    r: _Packed
    how: _Name


class MotionTable(_Table):
    """A motion: `count` frames from `start` in steps of `step`, out of a motion until `end`."""

    start: _Number
    step: _Number
    end: _Number
    count: Annotated[int, Field(ge=1, le=1_000)]
    reference: PosesTable
    engines: dict[_Name, DifferenceTable]


class SeriesTable(_Table):
    """Reactions by the motion of one engine, joint by joint, and the violation of the joints."""

    force: list[list[_Number | None]]
    torque: list[list[_Number | None]]
    drift: list[_Number | None]


class AlongTable(_Table):
    """Values along the motions."""

    times: list[_Number]
    joints: list[_Name]
    engines: dict[_Name, SeriesTable]

    @model_validator(mode="after")
    def _as_many(self) -> AlongTable:
        for one in self.engines.values():
            rows = [*one.force, *one.torque, one.drift]
            if len(one.force) != len(self.joints) or len(one.torque) != len(self.joints):
                raise ValueError("values are not of as many joints")
            if any(len(row) != len(self.times) for row in rows):
                raise ValueError("values are not as many as times")
        return self


class ReplayTable(_Table):
    """A case in motion."""

    case: _Name
    seed: int
    scene: SceneTable
    motion: MotionTable | None
    along: AlongTable | None

    @model_validator(mode="after")
    def _sizes(self) -> ReplayTable:
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


class ReplayFile(_Table):
    """The file."""

    format: Literal[FORMAT]  # type: ignore[valid-type]
    cases: list[ReplayTable]


_FILE: TypeAdapter[ReplayFile] = TypeAdapter(ReplayFile)


def read_replay(folder: Path) -> dict[str, dict[str, Any]]:
    """Replays of a folder by case; none where the file is not there.

    Raises
    ------
    InvalidInput
        If the file is there and is not what `replay.replays` says.
    """
    path = folder / NAME
    if not path.exists():
        return {}
    try:
        found = _FILE.validate_json(bounded_text(path, LARGEST_FILE))
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InvalidInput(
            str(path), f"it is no replay of a report ({place}: {first['msg']})", "Run the suite again, or remove it."
        ) from None
    return {one.case: one.model_dump() for one in found.cases}
