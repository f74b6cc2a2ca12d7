"""A case on the pages: what it is, how far its motion can be judged, and which of its reactions are open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare.horizon import EPS
from consilience.report.cells import REFERENCE, Cell, cell_view
from consilience.report.facts import Entry
from consilience.report.record import Record
from consilience.report.selection import growing_motion, mean_step, method_of, motions_of
from consilience.report.wording import DASH, anchor, number

COMPONENTS = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


@dataclass(frozen=True)
class Limits:
    """How far the motion of a case can be judged, in words."""

    horizon: str
    rounding: str
    uncertainty: str


@dataclass(frozen=True)
class OpenReactions:
    """Joints with the same reaction components that equilibrium leaves open."""

    joints: str
    components: str


@dataclass(frozen=True)
class CaseView:
    """A case: one row of the matrix, one section of the page."""

    anchor: str
    name: str
    title: str
    facts: tuple[Entry, ...]
    limits: Limits
    undetermined: tuple[OpenReactions, ...]
    undetermined_count: str
    bodies: tuple[str, ...]
    joints: tuple[tuple[str, str, str, str], ...]
    sources: tuple[str, ...]
    remarks: tuple[str, ...]
    tags: tuple[str, ...]
    command: str
    figures: tuple[str, ...]
    cells: tuple[Cell, ...]


def case_view(record: Record, case: dict[str, Any], engines: Sequence[str]) -> CaseView:
    """View of a case."""
    name = case["name"]
    reference = _reference_model(record, name)
    limits, count = _limits(record, case), _undetermined_count(case)
    return CaseView(
        anchor=anchor("case", name),
        name=name,
        title=case["title"],
        facts=tuple(_facts(case, reference, limits, count)),
        limits=limits,
        undetermined=tuple(_undetermined(case)),
        undetermined_count=count,
        bodies=tuple(case["bodies"]),
        joints=tuple((j[0], j[1], j[2], j[3]) for j in case["joints"]),
        sources=tuple(case["sources"]),
        remarks=tuple(unwrapped(p) for p in case["remarks"].split("\n\n") if p.strip()),
        tags=tuple(case["tags"]),
        command=record.again(case),
        figures=tuple(case_figures(record, case)),
        cells=tuple(cell_view(record, case, engine, reference) for engine in engines),
    )


def unwrapped(paragraph: str) -> str:
    """A paragraph without the line breaks of its file; indented lines keep theirs."""
    text = ""
    for line, before in zip((lines := paragraph.strip("\n").split("\n")), ["", *lines], strict=False):
        text += ("\n" if line.startswith(" ") or before.startswith(" ") else " ") + line.strip()
    return text.strip()


def case_figures(record: Record, case: dict[str, Any]) -> Iterator[str]:
    """Figures there is something to plot in, in the order of the page."""
    motions = motions_of(case["name"], record.of_case(case["name"])[1])
    if growing_motion(case["name"], record.of_case(case["name"])[1]) is not None:
        yield "horizon"
    if motions:
        yield "work"
    if any(mean_step(level, method_of(record.runs_of(c)), case["duration"]) for c in motions for level in c["levels"]):
        yield "steps"


def _reference_model(record: Record, case: str) -> dict[str, Any] | None:
    """The reference's own account of the model, if it was asked for."""
    found = (r["answer"] for r in record.of_case(case)[0] if (r["engine"], r["question"]) == (REFERENCE, "model"))
    return next((answer for answer in found if answer), None)


def _limits(record: Record, case: dict[str, Any]) -> Limits:
    motions = motions_of(case["name"], record.of_case(case["name"])[1])
    uncertainty = number(motions[0]["reference_spread"]) if motions else DASH
    growing = growing_motion(case["name"], record.of_case(case["name"])[1])
    if growing is None:
        return Limits(DASH, DASH, uncertainty)
    horizon = growing["horizon"]
    text = "beyond the motion" if horizon is None else f"{horizon:.3g} s of {case['duration']:g} s"
    return Limits(text, number(EPS * growing["growth"][-1]), uncertainty)


def _facts(case: dict[str, Any], reference: dict[str, Any] | None, limits: Limits, count: str) -> Iterator[Entry]:
    rows = case["rows"]
    if reference is not None:
        dependent = rows - (6 * len(case["bodies"]) - reference["freedom"])
        yield Entry("degrees of freedom", str(reference["freedom"]))
        yield Entry("constraint rows", str(rows), f"{dependent} of them dependent")
        yield Entry("total mass", f"{number(reference['mass'], 3)} kg")
    else:
        yield Entry("constraint rows", str(rows))
    yield Entry("trajectory", f"{case['duration']:g} s", f"sampled every {case['sample']:g} s")
    yield Entry("digits asked of a trajectory", str(case["digits"]))
    if limits.horizon != DASH:
        yield Entry("horizon", limits.horizon, f"one rounding error grows to {limits.rounding} at the end")
    if limits.uncertainty != DASH:
        yield Entry("uncertainty of the reference", limits.uncertainty, "of its motion, up to the horizon")
    yield Entry("states of the question instant", str(case["instants"]))
    if case["undetermined"]:
        yield Entry("reactions not determined", count, "by equilibrium: never compared; listed below")


def _undetermined_count(case: dict[str, Any]) -> str:
    """How many of the asked reaction values are open; a dash for none."""
    count = sum(sum(counts) for counts in case["undetermined"].values())
    return f"{count} of {6 * len(case['joints']) * case['instants']} values" if count else DASH


def _undetermined(case: dict[str, Any]) -> Iterator[OpenReactions]:
    """Joints by their open components."""
    joints: dict[str, list[str]] = {}
    for joint, counts in case["undetermined"].items():
        joints.setdefault(_components(counts, case["instants"]), []).append(joint)
    for components, names in joints.items():
        yield OpenReactions(", ".join(names), components)


def _components(counts: Sequence[int], states: int) -> str:
    """Open components by the number of states at which they are, the most frequent first."""
    parts = []
    for count in sorted({n for n in counts if n}, reverse=True):
        names = ", ".join(name for name, n in zip(COMPONENTS, counts, strict=True) if n == count)
        where = "all states" if count == states else f"{count} of {states} states"
        parts.append(f"{names} at {where}")
    return "; ".join(parts)
