"""What the lines of a record have to be before anything is made of them: types, ranges, and what refers to what.

A record may come from anybody. Fields that nothing is made of are let through as they are, so that a later version may
write more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from consilience.compare import Verdict
from consilience.engine import Profile, Question, Route, Status

FORMAT = 2

LARGEST_MATRIX = 20_000
"""Cases times engines at most: a page of more cells nobody can open."""

_HUGE = 1.7e308


def _moment(text: str) -> str:
    if datetime.fromisoformat(text).tzinfo is None:
        raise ValueError("the time has no zone")
    return text


def _question(name: str) -> Question:
    try:
        return Question(name)
    except ValueError:
        *names, last = (repr(str(question)) for question in Question)
        expected = f"{', '.join(names)} or {last}"
        raise PydanticCustomError("enum", "Input should be {expected}", {"expected": expected}) from None


QuestionField = Annotated[Question, PlainValidator(_question)]

# words of the format: JSON has them as strings, which is what members of these enumerations are
_WORD = Field(strict=False)
Judged = Annotated[Verdict, _WORD]
Way = Annotated[Route, _WORD]
Whose = Annotated[Profile, _WORD]
Ended = Annotated[Status, _WORD]

Short = Annotated[str, Field(max_length=1_000)]
Text = Annotated[str, Field(max_length=2_000_000)]
Number = Annotated[float, Field(ge=-_HUGE, le=_HUGE, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, le=1e30, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=1_000_000_000)]
Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, frozen=True)


class EngineTable(_Table):
    """An engine that started."""

    name: Short
    version: Short
    adapter: Short
    remarks: Text


class Header(_Table):
    """First line: versions and platform."""

    record: Literal["header"]
    format: Literal[FORMAT]  # type: ignore[valid-type]
    written: Annotated[Short, AfterValidator(_moment)]
    elapsed: Seconds
    platform: Short
    processor: Short
    python: Short
    packages: dict[Short, Short]
    engines: dict[Short, EngineTable]
    missing: dict[Short, Text]
    questions: list[QuestionField]
    quick: bool | None = None
    """Whether the headlines alone were asked, briefly; earlier records do not tell."""


class CaseLine(_Table):
    """A case."""

    record: Literal["case"]
    name: Short
    call: Short | None = None
    """What `consilience run` was given for it; earlier records do not tell."""

    title: Text
    bodies: list[Short]
    joints: list[Annotated[list[Short], Field(min_length=4, max_length=4)]]
    rows: Count
    duration: Annotated[Seconds, Field(gt=0)]
    sample: Annotated[Seconds, Field(gt=0)]
    digits: Annotated[int, Field(ge=0, le=16)]
    instants: Count
    undetermined: dict[Short, Annotated[list[Count], Field(min_length=6, max_length=6)]]
    sources: list[Text]
    remarks: Text
    tags: list[Text]


class MethodTable(_Table):
    """A method of an engine."""

    name: Short
    route: Way
    order: int | None
    substeps: list[Count]
    tolerances: list[Number]
    settings: dict[Short, Any]
    profile: Whose
    softness: Number | None


class ManifestTable(_Table):
    """What a translation kept."""

    exact: list[Text]
    approximated: list[Text]


class ModelTable(_Table):
    """An engine's own account of a model."""

    mass: Number
    com: Triple
    inertia: Annotated[list[Triple], Field(min_length=3, max_length=3)]
    freedom: Annotated[int, Field(ge=-1_000_000, le=1_000_000)]


class RunLine(_Table):
    """A run. Of the answers only those to `model` are shown."""

    record: Literal["run"]
    case: Short
    engine: Short
    question: QuestionField
    method: MethodTable | None
    level: Count
    step: Number | None
    status: Ended
    answer: dict[str, Any] | None
    reason: Text
    manifest: ManifestTable | None
    cpu: Seconds
    log: Text

    @model_validator(mode="after")
    def _account(self) -> RunLine:
        if self.question == Question.MODEL and self.answer is not None:
            ModelTable.model_validate(self.answer)
        return self


class QuantityTable(_Table):
    """A compared quantity."""

    name: Short
    difference: Number | None
    bar: Number | None
    count: Count
    remark: Text


class SoftnessTable(_Table):
    """What a ladder of softness says."""

    order: Number | None
    shift: Number | None
    limit: Number | None


class ObservableTable(_Table):
    """What a ladder says of one observable."""

    name: Short
    order: Number | None
    band: Number | None
    change: Number | None


class LevelTable(_Table):
    """A level of a motion."""

    step: Number | None
    cpu: Seconds
    largest: Number | None
    rms: Number | None
    difference: list[Number | None]
    energy: list[Number | None]
    residual: Number | None
    counters: dict[Short, Count | Number | None]


class ComparisonLine(_Table):
    """A comparison."""

    record: Literal["comparison"]
    case: Short
    engine: Short
    question: QuestionField
    method: Short
    route: Way | None
    verdict: Judged
    why: Text
    digits: Number | None
    limit_digits: Number | None
    declared_order: Annotated[int, Field(ge=0, le=100)] | None
    order: Number | None
    self_order: Number | None
    band: Number | None
    reference_spread: Number | None
    rule: Short
    profile: Whose
    horizon: Seconds | None
    softness: SoftnessTable | None
    observables: list[ObservableTable]
    growth: list[Number]
    quantities: list[QuantityTable]
    times: list[Seconds]
    levels: list[LevelTable]

    @model_validator(mode="after")
    def _one_grid(self) -> ComparisonLine:
        sizes = {len(v) for level in self.levels for v in (level.difference, level.energy)}
        if self.growth:
            sizes.add(len(self.growth))
        if sizes - {len(self.times)}:
            raise ValueError("values over time are not as many as times")
        if (self.levels or self.growth) and not self.times:
            raise ValueError("there are levels and no times")
        return self


class Footer(_Table):
    """Last line: it counts the others, and is missing where a record was cut off."""

    record: Literal["footer"]
    cases: Count
    runs: Count
    comparisons: Count
    exit_code: Literal[0, 1, 3]


Line = Annotated[Header | CaseLine | RunLine | ComparisonLine | Footer, Field(discriminator="record")]
_LINE: TypeAdapter[Line] = TypeAdapter(Line)

Records = Sequence[dict[str, Any]]


def checked(line: object) -> dict[str, Any]:
    """Record of a line, its numbers as Python's floats where the format has numbers.

    Raises
    ------
    ValueError
        With the field, and what is wrong with it.
    """
    try:
        return _LINE.validate_python(line).model_dump()
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        # the first part of the place is the kind of the record
        place = ".".join(str(part) for part in first["loc"][1:])
        raise ValueError(f"{place}: {first['msg']}".removeprefix(": ")) from None


def contradictions(header: dict[str, Any], cases: Records, runs: Records, comparisons: Records) -> Iterator[str]:
    """What lines that are sound by themselves say against one another."""
    names, engines = {case["name"] for case in cases}, set(header["engines"])
    if len(names) < len(cases):
        yield "two cases have one name"
    if len(cases) * len(engines) > LARGEST_MATRIX:
        yield f"cases times engines are more than {LARGEST_MATRIX}"
    for kind, found in (("run", runs), ("comparison", comparisons)):
        if any(one["case"] not in names for one in found):
            yield f"a {kind} is of no case of the report"
        if any(one["engine"] not in engines for one in found):
            yield f"a {kind} is of no engine of the report"
    judged = [(c["case"], c["engine"], c["question"], c["method"]) for c in comparisons]
    if len(set(judged)) < len(judged):
        yield "two comparisons are of the same answer"
    # only levels at a method's own softness are levels of a motion
    known = {
        (r["case"], r["engine"], r["question"], r["method"]["name"])
        for r in runs
        if r["method"] and r["method"]["softness"] in (None, 1.0)
    }
    if any(c["levels"] and key not in known for c, key in zip(comparisons, judged, strict=True)):
        yield "a motion was compared that no run holds"
