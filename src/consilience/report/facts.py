"""Facts about an answer: account of the model, orders, uncertainty, horizon, softness, CPU time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from consilience.compare.power import LARGEST
from consilience.engine import Question, load_named
from consilience.report.selection import AnswerLines, softness_of
from consilience.report.wording import UNITS, digits_text, error_text, nested, number, order_text, seconds


@dataclass(frozen=True)
class Fact:
    """A named value with a note."""

    name: str
    value: str
    note: str = ""


def facts_of(lines: AnswerLines) -> Iterator[Fact]:
    """List the facts about an answer: those of its question, then the CPU time."""
    named = Question(lines.comparison["question"]).facts
    yield from load_named(named)(lines) if named else ()
    # the table of levels has the times of a motion
    if not lines.comparison["levels"] and any(r["status"] == "answered" for r in lines.levels):
        yield Fact("CPU time", seconds(sum(r["cpu"] for r in lines.levels)))


def horizon_text(comparison: dict[str, Any], case: dict[str, Any]) -> str:
    """State the time up to which a motion is judged; empty if the whole motion is judged."""
    if comparison["horizon"] is None:
        return ""
    return (
        f"Judged up to {comparison['horizon']:.3g} s of {case['duration']:g} s: beyond, one rounding error has grown "
        f"to the {case['digits']} digits asked."
    )


def model_facts(lines: AnswerLines) -> Iterator[Fact]:
    """Give mass properties and degrees of freedom beside those of the reference."""
    names = {"mass": "total mass", "com": "centre of mass", "inertia": "inertia", "freedom": "degrees of freedom"}
    answer: dict[str, Any] = next((r["answer"] for r in lines.levels if r["answer"]), {})
    for key, name in names.items() if answer else ():
        value, expected = nested(answer[key]), nested(lines.reference[key]) if lines.reference else ""
        note = "as the reference" if value == expected else f"reference {expected}".strip()
        yield Fact(name, f"{value} {UNITS[key]}".strip(), note if expected else "")


def declared_text(lines: AnswerLines) -> str:
    """Write the declared order, in the step or in the tolerance."""
    return f"{lines.comparison['declared_order']}{' in the tolerance' if lines.method.get('tolerances') else ''}"


def instant_facts(lines: AnswerLines) -> Iterator[Fact]:
    """Give the number of states."""
    yield Fact("states", str(lines.case["instants"]), "the initial state, then random consistent ones")


def trajectory_facts(lines: AnswerLines) -> Iterator[Fact]:
    """Give digits, orders and uncertainty of a motion."""
    comparison = lines.comparison
    if not comparison["levels"]:
        return
    yield Fact("digits", digits_text(comparison["digits"]), f"at the finest level; asked {lines.case['digits']}")
    if comparison["declared_order"] is not None:
        hidden = "hidden by rounding" if comparison["order"] is None else "the finest levels against the reference"
        among = "hidden by rounding" if comparison["self_order"] is None else "the levels, without the reference"
        yield Fact("declared order", declared_text(lines))
        yield Fact("observed order", order_text(comparison["order"]), hidden)
        yield Fact("self order", order_text(comparison["self_order"]), among)
        yield Fact("limit digits", digits_text(comparison["limit_digits"]), "of the Richardson limit")
        yield Fact("band", number(comparison["band"]), "uncertainty of the finest level (grid convergence index)")
    spread = number(comparison["reference_spread"])
    yield Fact("uncertainty of the reference", spread, "spread over formulations, integrators and tolerances")


def power_facts(comparison: dict[str, Any]) -> Iterator[Fact]:
    """State the smallest error of each kind of parameter that would have been noticed."""
    for power in comparison["power"]:
        off = error_text(power["kind"], power["limit"])
        yield Fact(power["of"], f"off by {off}", "would pass" if would_pass(power) else "")


def would_pass(power: dict[str, Any]) -> bool:
    """Whether the largest error of a parameter would have passed; the record has None for an infinite error."""
    return power["limit"] is None or power["limit"] >= LARGEST


def softness_facts(lines: AnswerLines) -> Iterator[Fact]:
    """State how the answer depends on the engine's own softness; nothing if only one softness was asked."""
    softness = lines.comparison["softness"]
    if not softness:
        return
    asked = sorted({1.0, *(s for p in lines.probes if (s := softness_of(p)) is not None)})
    spent = sum(p["cpu"] for p in lines.probes)
    yield Fact(
        "softness asked", ", ".join(f"{s:g}" for s in asked), f"times that of this method; CPU time {seconds(spent)}"
    )
    hidden = "the answer hardly depends on it" if softness["order"] is None else "in the softness, from all three"
    yield Fact("order in softness", order_text(softness["order"]), hidden)
    yield Fact("shift", number(softness["shift"]), "change of the answer between the two hardest")
    yield Fact("without softness", number(softness["limit"]), "difference of that limit to the reference")
