"""JSON: a run as one document with a published schema (`consilience export --schema`).

The record itself, ``report.jsonl``, also holds every answer, and its format may change with the harness; the format of
this document is stable. A field with a new meaning makes another `FORMAT`; a new field does not.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from consilience.compare import Verdict
from consilience.engine import Profile, Question
from consilience.report.record import Record
from consilience.report.selection import deciding, judged_largest, levels_of, method_of

FORMAT = 1
SCHEMA_ID = "urn:consilience:schema:results:1"


if TYPE_CHECKING:
    _QuestionName = Question
else:
    _QuestionName = StrEnum("Question", {name.upper(): str(name) for name in Question})
    _QuestionName.__doc__ = "What can be asked of an engine."


class _DocumentModel(BaseModel):
    model_config = ConfigDict(extra="forbid")


_T = TypeVar("_T", bound=_DocumentModel)


class EngineTable(_DocumentModel):
    """An engine that started."""

    version: str
    adapter: str = Field(description="Version or name of what translates for it.")
    remarks: str


class ExportedCase(_DocumentModel):
    """A case as it was asked."""

    __qualname__ = "CaseTable"  # name in the published schema
    model_config = ConfigDict(title="CaseTable")

    name: str
    title: str
    bodies: list[str]
    joints: list[str]
    tags: list[str]
    sources: list[str]
    duration: float = Field(description="Of the motion, s.")
    sample: float = Field(description="Interval of its samples, s.")
    digits: int = Field(description="Correct digits asked of the motion.")
    instants: int = Field(description="Number of states of the question `instant`.")


class QuantityTable(_DocumentModel):
    """A compared quantity."""

    name: str
    difference: float | None = Field(description="Relative to the reference; null where it is not finite.")
    bar: float | None = Field(description="What was asked.")
    count: int = Field(description="Number of values compared; 0 is no agreement but no comparison.")
    remark: str


class LevelTable(_DocumentModel):
    """A motion at one step size or tolerance."""

    step: float = Field(description="Step in s; of an adaptive method its tolerance.")
    largest: float | None = Field(description="Largest difference up to the horizon; null where nothing is judged.")
    rms: float | None = Field(description="Root mean square of the difference up to the horizon.")
    residual: float | None = Field(description="Largest violation of a joint, m or dimensionless.")
    cpu: float = Field(description="CPU time in s.")
    counters: dict[str, float] = Field(description="Work, as the engine counts it.")


class ComparisonTable(_DocumentModel):
    """One engine, question and method against the reference."""

    case: str
    engine: str
    question: _QuestionName
    method: str
    route: str | None = Field(description="How much of the answer is the engine's own; null without a method.")
    profile: Profile = Field(description="Only `matched` decides the exit code.")
    verdict: Verdict
    rule: str = Field(description="Rule that decided a motion; empty where bars decided.")
    why: str = Field(description="The decision in numbers.")
    digits: float | None = Field(description="Correct digits, of a motion at its finest level.")
    difference: float | None = Field(description="Of the quantity nearest to its bar; null: none, or not finite.")
    bar: float | None = Field(description="What was asked of that quantity.")
    declared_order: int | None
    order: float | None = Field(description="Observed order, against the reference.")
    band: float | None = Field(description="Uncertainty of the finest level (grid convergence index).")
    horizon: float | None = Field(description="Time in s up to which a motion is judged; null: its end.")
    cpu: float = Field(description="CPU time of its runs in s.")
    settings: dict[str, Any] = Field(description="Every knob that is not at the engine's default.")
    quantities: list[QuantityTable]
    levels: list[LevelTable] = Field(description="Coarse to fine.")


class Document(_DocumentModel):
    """What a run found out."""

    model_config = ConfigDict(extra="forbid", title="Results of Consilience", json_schema_extra={"$id": SCHEMA_ID})

    format: int = Field(description="Of this document.", json_schema_extra={"const": FORMAT})
    written: str = Field(description="ISO 8601, UTC.")
    platform: str
    python: str
    packages: dict[str, str]
    questions: list[_QuestionName]
    exit_code: int = Field(description="0 agree, 1 some differ in the model, 3 incomplete.")
    engines: dict[str, EngineTable]
    missing: dict[str, str] = Field(description="Engines that did not start, and why.")
    cases: list[ExportedCase]
    comparisons: list[ComparisonTable]


def render(record: Record) -> str:
    """Write the JSON document of a record."""
    return document(record).model_dump_json(indent=2) + "\n"


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the document."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Document.model_json_schema()}


def document(record: Record) -> Document:
    """Make the document of a record."""
    header, cases = record.header, {case["name"]: case for case in record.cases}
    return Document(
        format=FORMAT,
        exit_code=record.footer["exit_code"],
        engines={name: _same(EngineTable, info) for name, info in header["engines"].items()},
        cases=[_same(ExportedCase, case | {"joints": [joint[0] for joint in case["joints"]]}) for case in record.cases],
        comparisons=[_comparison(c, record, cases[c["case"]]) for c in record.comparisons],
        **{name: header[name] for name in ("written", "platform", "python", "packages", "questions", "missing")},
    )


def _comparison(comparison: dict[str, Any], record: Record, case: dict[str, Any]) -> ComparisonTable:
    runs, found = levels_of(record.runs_of(comparison)), deciding(comparison, case)
    own = {
        "difference": found.difference,
        "bar": found.bar,
        "cpu": sum(run["cpu"] for run in runs),
        "settings": method_of(runs).get("settings", {}),
        "quantities": [_same(QuantityTable, q) for q in comparison["quantities"]],
        "levels": [
            _same(LevelTable, level | {"largest": judged_largest(comparison, level)}) for level in comparison["levels"]
        ],
    }
    return _same(ComparisonTable, comparison | own)


def _same(table: type[_T], values: dict[str, Any]) -> _T:
    """Make a table from the values of its fields; other values are ignored."""
    return table.model_validate({name: values[name] for name in table.model_fields})
