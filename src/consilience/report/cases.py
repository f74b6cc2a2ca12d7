"""View of a case: facts, limits of judgement of its motion, undetermined reactions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare.horizon import EPS
from consilience.compare.judge import REFERENCE
from consilience.report.anatomy import COMPONENTS
from consilience.report.cells import Cell, cell_view
from consilience.report.facts import Fact
from consilience.report.record import Record
from consilience.report.selection import grouped, mean_step, method_of
from consilience.report.wording import DASH, anchor, number


@dataclass(frozen=True)
class Limits:
    """Limits of judgement of a motion, in words: horizon, growth of rounding, uncertainty of the reference."""

    horizon: str
    rounding: str
    uncertainty: str


@dataclass(frozen=True)
class OpenReactions:
    """Joints with the same reaction components that equilibrium does not determine."""

    joints: str
    components: str


@dataclass(frozen=True)
class CaseView:
    """A case: a row of the matrix, and a page; `line` is the line of the record."""

    line: dict[str, Any]
    anchor: str
    name: str
    title: str
    facts: tuple[Fact, ...]
    limits: Limits
    undetermined: tuple[OpenReactions, ...]
    undetermined_count: str
    remarks: tuple[str, ...]
    tags: tuple[str, ...]
    command: str
    figures: tuple[str, ...]
    cells: tuple[Cell, ...]


def case_view(record: Record, case: dict[str, Any], engines: Sequence[str]) -> CaseView:
    """Make the view of a case."""
    name = case["name"]
    reference = _reference_model(record, name)
    limits, count = _limits(record, case), _undetermined_count(case)
    return CaseView(
        line=case,
        anchor=anchor("case", name),
        name=name,
        title=case["title"],
        facts=tuple(_facts(case, reference, limits, count)),
        limits=limits,
        undetermined=tuple(_undetermined(case)),
        undetermined_count=count,
        remarks=tuple(unwrapped(p) for p in case["remarks"].split("\n\n") if p.strip()),
        tags=tuple(case["tags"]),
        command=record.again(case),
        figures=tuple(case_figures(record, case)),
        cells=tuple(cell_view(record, case, engine, reference) for engine in engines),
    )


def unwrapped(paragraph: str) -> str:
    """Join the lines of a paragraph; indented lines stay lines."""
    text = ""
    for line, before in zip((lines := paragraph.strip("\n").split("\n")), ["", *lines], strict=False):
        text += ("\n" if line.startswith(" ") or before.startswith(" ") else " ") + line.strip()
    return text.strip()


def case_figures(record: Record, case: dict[str, Any]) -> Iterator[str]:
    """List the kinds of figures that have data, in the order of the page."""
    motions = record.motions(case["name"])
    if record.growing_motion(case["name"]) is not None:
        yield "horizon"
    if motions:
        yield "work"
    if any(mean_step(level, method_of(record.runs_of(c)), case["duration"]) for c in motions for level in c["levels"]):
        yield "steps"


def _reference_model(record: Record, case: str) -> dict[str, Any] | None:
    """Return the answer of the reference to the question `model`; None if the question was not asked."""
    found = (r["answer"] for r in record.of_case(case)[0] if (r["engine"], r["question"]) == (REFERENCE, "model"))
    return next((answer for answer in found if answer), None)


def _limits(record: Record, case: dict[str, Any]) -> Limits:
    motions, growing = record.motions(case["name"]), record.growing_motion(case["name"])
    uncertainty = number(motions[0]["reference_spread"]) if motions else DASH
    if growing is None:
        return Limits(DASH, DASH, uncertainty)
    horizon = growing["horizon"]
    text = "beyond the motion" if horizon is None else f"{horizon:.3g} s of {case['duration']:g} s"
    return Limits(text, number(EPS * growing["growth"][-1]), uncertainty)


def _facts(case: dict[str, Any], reference: dict[str, Any] | None, limits: Limits, count: str) -> Iterator[Fact]:
    rows = str(case["rows"])
    if reference is None:
        yield Fact("constraint rows", rows)
    else:
        dependent = case["rows"] - (6 * len(case["bodies"]) - reference["freedom"])
        yield Fact("degrees of freedom", str(reference["freedom"]))
        yield Fact("constraint rows", rows, f"{dependent} of them dependent")
        yield Fact("total mass", f"{number(reference['mass'], 3)} kg")
    yield Fact("trajectory", f"{case['duration']:g} s", f"sampled every {case['sample']:g} s")
    yield Fact("digits asked of a trajectory", str(case["digits"]))
    if limits.horizon != DASH:
        yield Fact("horizon", limits.horizon, f"one rounding error grows to {limits.rounding} at the end")
    if limits.uncertainty != DASH:
        yield Fact("uncertainty of the reference", limits.uncertainty, "of its motion, up to the horizon")
    yield Fact("states of the question instant", str(case["instants"]))
    if case["undetermined"]:
        yield Fact("reactions not determined", count, "by equilibrium: never compared; listed below")


def _undetermined_count(case: dict[str, Any]) -> str:
    """Count the reaction values that equilibrium does not determine; a dash for none."""
    count = sum(sum(counts) for counts in case["undetermined"].values())
    return f"{count} of {6 * len(case['joints']) * case['instants']} values" if count else DASH


def _undetermined(case: dict[str, Any]) -> Iterator[OpenReactions]:
    """Group the joints by their undetermined components."""
    joints = grouped((_components(counts, case["instants"]), joint) for joint, counts in case["undetermined"].items())
    for components, names in joints.items():
        yield OpenReactions(", ".join(names), components)


def _components(counts: Sequence[int], states: int) -> str:
    """Name undetermined components by the number of states, the most frequent first."""
    parts = []
    for count in sorted({n for n in counts if n}, reverse=True):
        names = ", ".join(name for name, n in zip(COMPONENTS, counts, strict=True) if n == count)
        where = "all states" if count == states else f"{count} of {states} states"
        parts.append(f"{names} at {where}")
    return "; ".join(parts)
