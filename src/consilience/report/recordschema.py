"""Schema of the lines of a record, checked before a page is rendered: types, ranges and references.

A record may come from anybody. Unknown fields pass unchanged, so that a later version may write more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, PlainValidator, TypeAdapter, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from consilience.compare import Verdict
from consilience.engine import Profile, Question, Route, Status
from consilience.engine.failures import FailureClass
from consilience.report.annotations import cell_lines
from consilience.report.fields import NameField, StrictModel, first_problem

FORMAT = 3
"""Format of a written record; a field with a new meaning, or without which pages lack something, makes another."""

READABLE = (1, 2, 3)
"""Formats that are read: those before 3 have no annotations and no cells, and are annotated when they are read."""

ABSENT_IN_1: dict[str, dict[str, Any]] = {
    "case": {"undetermined": {}},
    "method": {"profile": str(Profile.MATCHED), "softness": None},
    "comparison": {
        **{"profile": str(Profile.MATCHED), "rule": "", "horizon": None},
        **{"softness": None, "observables": [], "growth": []},
    },
}
"""Fields that lines of format 1 do not have, and what they mean there, by kind of line; `method` is that of a run."""

LARGEST_MATRIX = 20_000
"""Largest product of cases and engines: no browser opens a page of more cells."""

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

# JSON holds members of these enumerations as strings
_WORD = Field(strict=False)
VerdictField = Annotated[Verdict, _WORD]
RouteField = Annotated[Route, _WORD]
ProfileField = Annotated[Profile, _WORD]
StatusField = Annotated[Status, _WORD]

TextField = Annotated[str, Field(max_length=2_000_000)]
NumberField = Annotated[float, Field(ge=-_HUGE, le=_HUGE, allow_inf_nan=False)]
SecondsField = Annotated[float, Field(ge=0, le=1e30, allow_inf_nan=False)]
CountField = Annotated[int, Field(ge=0, le=1_000_000_000)]
TripleField = Annotated[list[NumberField], Field(min_length=3, max_length=3)]


class _RecordModel(StrictModel):
    model_config = ConfigDict(extra="allow")


class EngineFields(_RecordModel):
    """An engine that started."""

    name: NameField
    version: NameField
    adapter: NameField
    remarks: TextField


class Header(_RecordModel):
    """First line: versions and platform."""

    record: Literal["header"]
    format: Literal[READABLE]  # type: ignore[valid-type]
    written: Annotated[NameField, AfterValidator(_moment)]
    elapsed: SecondsField
    platform: NameField
    processor: NameField
    python: NameField
    packages: dict[NameField, NameField]
    engines: dict[NameField, EngineFields]
    missing: dict[NameField, TextField]
    questions: list[QuestionField]
    quick: bool | None = None
    """Whether the run was quick; absent in earlier records."""


class CaseLine(_RecordModel):
    """A case."""

    record: Literal["case"]
    name: NameField
    call: NameField | None = None
    """Argument of `consilience run` for the case; absent in earlier records."""

    digest: NameField | None = None
    """Digest of what the file of the case asks; None without a file, and in earlier records."""

    title: TextField
    bodies: list[NameField]
    joints: list[Annotated[list[NameField], Field(min_length=4, max_length=4)]]
    rows: CountField
    duration: Annotated[SecondsField, Field(gt=0)]
    sample: Annotated[SecondsField, Field(gt=0)]
    digits: Annotated[int, Field(ge=0, le=16)]
    instants: CountField
    undetermined: dict[NameField, Annotated[list[CountField], Field(min_length=6, max_length=6)]]
    sources: list[TextField]
    remarks: TextField
    tags: list[TextField]


class MethodFields(_RecordModel):
    """A method of an engine."""

    name: NameField
    route: RouteField
    order: int | None
    substeps: list[CountField]
    tolerances: list[NumberField]
    settings: dict[NameField, Any]
    profile: ProfileField
    softness: NumberField | None


class ManifestFields(_RecordModel):
    """Manifest of a translation: exact and approximated features."""

    exact: list[TextField]
    approximated: list[TextField]


class ModelFields(_RecordModel):
    """An engine's own account of a model."""

    mass: NumberField
    com: TripleField
    inertia: Annotated[list[TripleField], Field(min_length=3, max_length=3)]
    freedom: Annotated[int, Field(ge=-1_000_000, le=1_000_000)]


class RunLine(_RecordModel):
    """A run; its answer is checked for the question `model` alone."""

    record: Literal["run"]
    case: NameField
    engine: NameField
    question: QuestionField
    method: MethodFields | None
    level: CountField
    step: NumberField | None
    status: StatusField
    answer: dict[str, Any] | None
    reason: TextField
    manifest: ManifestFields | None
    cpu: SecondsField
    log: TextField
    failure: Annotated[FailureClass, _WORD] | None = None
    """Class of a failure; absent in earlier records."""

    @model_validator(mode="after")
    def _account(self) -> RunLine:
        if self.question == Question.MODEL and self.answer is not None:
            ModelFields.model_validate(self.answer)
        return self


class QuantityFields(_RecordModel):
    """A compared quantity."""

    name: NameField
    difference: NumberField | None
    bar: NumberField | None
    count: CountField
    remark: TextField


class SoftnessFields(_RecordModel):
    """Results of a ladder of softness."""

    order: NumberField | None
    shift: NumberField | None
    limit: NumberField | None


class ObservableFields(_RecordModel):
    """Results of a ladder of steps for one observable."""

    name: NameField
    order: NumberField | None
    band: NumberField | None
    change: NumberField | None


class PowerFields(_RecordModel):
    """Smallest error of a parameter that a comparison would have noticed; None where any error would pass."""

    kind: NameField
    of: NameField
    limit: NumberField | None


class LevelFields(_RecordModel):
    """A level of a motion."""

    step: NumberField | None
    cpu: SecondsField
    largest: NumberField | None
    rms: NumberField | None
    difference: list[NumberField | None]
    energy: list[NumberField | None]
    residual: NumberField | None
    counters: dict[NameField, CountField | NumberField | None]


class CoarserFields(_RecordModel):
    """A motion at a longer step than those of the levels; `largest` is None without a motion."""

    step: SecondsField
    cpu: SecondsField
    largest: NumberField | None


class ComparisonLine(_RecordModel):
    """A comparison."""

    record: Literal["comparison"]
    case: NameField
    engine: NameField
    question: QuestionField
    method: NameField
    route: RouteField | None
    verdict: VerdictField
    why: TextField
    digits: NumberField | None
    limit_digits: NumberField | None
    declared_order: Annotated[int, Field(ge=0, le=100)] | None
    order: NumberField | None
    self_order: NumberField | None
    band: NumberField | None
    reference_spread: NumberField | None
    rule: NameField
    profile: ProfileField
    horizon: SecondsField | None
    softness: SoftnessFields | None
    observables: list[ObservableFields]
    growth: list[NumberField]
    quantities: list[QuantityFields]
    times: list[SecondsField]
    levels: list[LevelFields]
    coarser: list[CoarserFields] = Field(default_factory=list)
    power: list[PowerFields] = Field(default_factory=list)
    """These two are absent in earlier records."""

    cause: NameField | None = None
    """Key of the cause of the verdict; this and the fields below are absent in earlier records."""

    best: bool | None = None
    """Whether the method is the best of the engine at the question, see `annotations.annotated`."""

    digits_asked: NumberField | None = None
    finding: NameField | None = None
    """Name of the known finding that shows."""

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


class CellLine(_RecordModel):
    """A cell of the matrix, see `annotations.cell_lines`; absent in earlier records."""

    record: Literal["cell"]
    case: NameField
    engine: NameField
    verdict: VerdictField
    cause: NameField
    model: VerdictField | None
    motion: VerdictField | None
    digits: NumberField | None
    digits_asked: NumberField | None
    method: NameField | None
    own: bool | None
    findings: list[NameField]


class Footer(_RecordModel):
    """Last line: the number of the other lines; absent in a record that was cut off."""

    record: Literal["footer"]
    cases: CountField
    runs: CountField
    comparisons: CountField
    exit_code: Literal[0, 1, 3]


RecordLine = Annotated[Header | CaseLine | RunLine | ComparisonLine | CellLine | Footer, Field(discriminator="record")]
_LINE: TypeAdapter[RecordLine] = TypeAdapter(RecordLine)

Records = Sequence[dict[str, Any]]


def record_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a line of ``report.jsonl``."""
    about = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"Record of a run, format {FORMAT}"}
    return about | _LINE.json_schema()


def checked(line: object, form: int = FORMAT) -> dict[str, Any]:
    """Check a line of a record of a format, and return it with Python floats for all numbers of the format.

    Raises
    ------
    ValueError
        If the line violates the schema; the message names the field and the problem.
    """
    if form == 1 and isinstance(line, dict):
        line = ABSENT_IN_1.get(str(line.get("record")), {}) | line
        if isinstance(line.get("method"), dict):
            line["method"] = ABSENT_IN_1["method"] | line["method"]
    try:
        return _LINE.validate_python(line).model_dump()
    except ValidationError as error:
        # the first part of the place is the kind of the line
        raise ValueError(first_problem(error, skip=1).removeprefix(": ")) from None


def contradictions(
    header: dict[str, Any], cases: Records, runs: Records, comparisons: Records, cells: Records
) -> Iterator[str]:
    """List the contradictions between lines that are each valid.

    Parameters
    ----------
    header : dict
    cases, runs, comparisons, cells : list of dict
        Lines by kind.
    """
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
    # runs at another softness are no levels
    known = {
        (r["case"], r["engine"], r["question"], r["method"]["name"])
        for r in runs
        if r["method"] and r["method"]["softness"] in (None, 1.0)
    }
    if any(c["levels"] and key not in known for c, key in zip(comparisons, judged, strict=True)):
        yield "a motion was compared that no run holds"
    if header["format"] == FORMAT:
        yield from _cell_contradictions(comparisons, cells)


def _cell_contradictions(comparisons: Records, cells: Records) -> Iterator[str]:
    """List cells that are not what their comparisons make them, and comparisons without annotations."""
    if any(c["cause"] is None or c["best"] is None for c in comparisons):
        yield "a comparison has no cause, or does not say whether it is the engine's best"
    else:
        expected = {(line["case"], line["engine"]): line["verdict"] for line in cell_lines(comparisons)}
        found = {(cell["case"], cell["engine"]): cell["verdict"] for cell in cells}
        if found != expected or len(cells) > len(found):
            yield "the cells are not those of the comparisons"
