"""Facts about an answer: account of the model, orders, uncertainty, horizon, softness, CPU time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.engine import Question, load_named
from consilience.report.selection import softness_of
from consilience.report.wording import UNITS, digits_text, nested, number, order_text, seconds


@dataclass(frozen=True)
class Fact:
    """A named value with a note."""

    name: str
    value: str
    note: str = ""


def facts_of(
    comparison: dict[str, Any],
    levels: Sequence[dict[str, Any]],
    case: dict[str, Any],
    reference: dict[str, Any] | None,
) -> Iterator[Fact]:
    """List the facts about a comparison.

    Parameters
    ----------
    comparison, case : dict
        Lines of the record.
    levels : sequence of dict
        Runs at the method's own softness.
    reference : dict or None
        The reference's answer to the question `model`.
    """
    named = Question(comparison["question"]).facts
    yield from load_named(named)(comparison, levels, case, reference) if named else ()
    # the table of levels has the times of a motion
    if not comparison["levels"] and any(r["status"] == "answered" for r in levels):
        yield Fact("CPU time", seconds(sum(r["cpu"] for r in levels)))


def horizon_text(comparison: dict[str, Any], case: dict[str, Any]) -> str:
    """State the time up to which a motion is judged; empty if that is its end."""
    if comparison["horizon"] is None:
        return ""
    return (
        f"Judged up to {comparison['horizon']:.3g} s of {case['duration']:g} s: beyond, one rounding error has grown "
        f"to the {case['digits']} digits asked."
    )


def model_facts(
    comparison: dict[str, Any],
    levels: Sequence[dict[str, Any]],
    case: dict[str, Any],
    reference: dict[str, Any] | None,
) -> Iterator[Fact]:
    """Give mass properties and degrees of freedom beside those of the reference; arguments as of `facts_of`."""
    names = {"mass": "total mass", "com": "centre of mass", "inertia": "inertia", "freedom": "degrees of freedom"}
    answer = next((r["answer"] for r in levels if r["answer"]), None)
    if answer is None:
        return
    for key, name in names.items():
        value, expected = nested(answer[key]), nested(reference[key]) if reference else ""
        note = "as the reference" if value == expected else f"reference {expected}".strip()
        yield Fact(name, f"{value} {UNITS[key]}".strip(), note if expected else "")


def declared_text(comparison: dict[str, Any], method: dict[str, Any]) -> str:
    """Write the declared order, in the step or in the tolerance."""
    return f"{comparison['declared_order']}{' in the tolerance' if method.get('tolerances') else ''}"


def instant_facts(
    comparison: dict[str, Any],
    levels: Sequence[dict[str, Any]],
    case: dict[str, Any],
    reference: dict[str, Any] | None,
) -> Iterator[Fact]:
    """Give the number of states; arguments as of `facts_of`."""
    yield Fact("states", str(case["instants"]), "the initial state, then random consistent ones")


def trajectory_facts(
    comparison: dict[str, Any],
    levels: Sequence[dict[str, Any]],
    case: dict[str, Any],
    reference: dict[str, Any] | None,
) -> Iterator[Fact]:
    """Give digits, orders and uncertainty of a motion; arguments as of `facts_of`."""
    if not comparison["levels"]:
        return
    yield Fact("digits", digits_text(comparison["digits"]), f"at the finest level; asked {case['digits']}")
    if comparison["declared_order"] is not None:
        hidden = "hidden by rounding" if comparison["order"] is None else "the finest levels against the reference"
        among = "hidden by rounding" if comparison["self_order"] is None else "the levels, without the reference"
        yield Fact("declared order", declared_text(comparison, levels[0]["method"]))
        yield Fact("observed order", order_text(comparison["order"]), hidden)
        yield Fact("self order", order_text(comparison["self_order"]), among)
        yield Fact("limit digits", digits_text(comparison["limit_digits"]), "of the Richardson limit")
        yield Fact("band", number(comparison["band"]), "uncertainty of the finest level (grid convergence index)")
    spread = number(comparison["reference_spread"])
    yield Fact("uncertainty of the reference", spread, "spread over formulations, integrators and tolerances")


def softness_facts(comparison: dict[str, Any], probes: Sequence[dict[str, Any]]) -> Iterator[Fact]:
    """State how the answer depends on the engine's own softness; nothing if only one softness was asked."""
    softness = comparison["softness"]
    if not softness:
        return
    asked = sorted({1.0, *(s for p in probes if (s := softness_of(p)) is not None)})
    spent = sum(p["cpu"] for p in probes)
    yield Fact(
        "softness asked", ", ".join(f"{s:g}" for s in asked), f"times that of this method; CPU time {seconds(spent)}"
    )
    hidden = "the answer hardly depends on it" if softness["order"] is None else "in the softness, from all three"
    yield Fact("order in softness", order_text(softness["order"]), hidden)
    yield Fact("shift", number(softness["shift"]), "change of the answer between the two hardest")
    yield Fact("without softness", number(softness["limit"]), "difference of that limit to the reference")
