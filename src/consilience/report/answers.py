"""The answer of one engine to one question by one method, as the drill-down shows it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from consilience.compare import Verdict
from consilience.report.wording import (
    DASH,
    LOOKS,
    ROUTES,
    UNITS,
    Look,
    counted,
    digits_text,
    nested,
    number,
    order_text,
    plain,
    seconds,
)


@dataclass(frozen=True)
class Entry:
    """A named value with a note."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class QuantityRow:
    """A compared quantity. `state` is ``met``, ``missed`` or ``absent``."""

    name: str
    difference: str
    bar: str
    count: str
    state: str
    remark: str

    @property
    def verdict(self) -> str:
        """Whether the bar is met, in words."""
        return {"met": "\N{CHECK MARK} met", "missed": "\N{NOT EQUAL TO} missed", "absent": "not compared"}[self.state]


@dataclass(frozen=True)
class LevelTable:
    """Levels of a trajectory, coarse to fine."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Trouble:
    """A run without an answer: which, why, and what the engine printed."""

    run: str
    reason: str
    log: str


@dataclass(frozen=True)
class AnswerView:
    """One question by one method."""

    question: str
    method: str
    route: str
    route_sentence: str
    look: Look
    why: str
    digits: str
    quantities: tuple[QuantityRow, ...]
    levels: LevelTable
    facts: tuple[Entry, ...]
    settings: tuple[tuple[str, str], ...]
    troubles: tuple[Trouble, ...]
    unsupported: tuple[str, ...]
    log: str

    @property
    def settings_count(self) -> str:
        """Number of settings, in words."""
        return counted(len(self.settings), "setting")


def answer_view(
    comparison: dict[str, Any],
    runs: Sequence[dict[str, Any]],
    case: dict[str, Any],
    reference: dict[str, Any] | None,
) -> AnswerView:
    """View of a comparison.

    Parameters
    ----------
    runs : sequence of dict
        The runs it judges, coarse to fine.
    reference : dict or None
        The reference's answer to the question `model`.
    """
    method = next((r["method"] for r in runs if r["method"]), None) or {}
    short, sentence = ROUTES.get(comparison["route"], ("no method", "the engine offered none"))
    by_question = {"model": _model_facts, "instant": _instant_facts, "trajectory": _trajectory_facts}
    failed = comparison["verdict"] == Verdict.FAILED
    return AnswerView(
        question=comparison["question"],
        method=comparison["method"],
        route=short,
        route_sentence=sentence,
        look=LOOKS[Verdict(comparison["verdict"])],
        why=comparison["why"],
        digits=digits_text(comparison["digits"]),
        quantities=tuple(_quantity(q) for q in comparison["quantities"]),
        levels=_levels(comparison["levels"], method),
        facts=tuple(by_question[comparison["question"]](comparison, runs, case, reference)),
        settings=tuple((str(k), plain(v)) for k, v in method.get("settings", {}).items()),
        troubles=tuple(_trouble(r, method) for r in runs if r["status"] == "failed"),
        unsupported=tuple(comparison["why"].split("; ")) if comparison["verdict"] == Verdict.UNSUPPORTED else (),
        log="" if failed else "\n".join(r["log"].strip() for r in runs if r["log"].strip()),
    )


def _quantity(q: dict[str, Any]) -> QuantityRow:
    """A row; `difference` is None where the record could not write it, as it was not finite."""
    if q["count"] == 0:
        return QuantityRow(q["name"], DASH, number(q["bar"]), DASH, "absent", "not given by this method")
    difference, bar = q["difference"], q["bar"]
    state = "met" if difference is not None and bar is not None and difference <= bar else "missed"
    text = "not finite" if difference is None else number(difference)
    return QuantityRow(q["name"], text, number(bar), str(q["count"]), state, q["remark"])


def step_name(method: dict[str, Any]) -> str:
    """What distinguishes the levels: steps of a fixed-step method, tolerances of an adaptive one."""
    return "step" if method.get("substeps") else "tolerance"


def step_text(step: float | None, method: dict[str, Any]) -> str:
    """A level in words, with its unit."""
    unit = " s" if step_name(method) == "step" else ""
    return DASH if step is None else f"{step:.3g}{unit}"


def _levels(levels: Sequence[dict[str, Any]], method: dict[str, Any]) -> LevelTable:
    counters = list(dict.fromkeys(name for level in levels for name in level["counters"]))
    heads = (
        step_name(method),
        "largest difference",
        "rms difference",
        "CPU time",
        "joint violation",
        *(name.replace("_", " ") for name in counters),
    )
    rows = tuple(
        (
            step_text(level["step"], method),
            number(level["largest"], 3),
            number(level["rms"], 3),
            seconds(level["cpu"]),
            number(level["residual"]),
            *(_counter(level["counters"].get(name)) for name in counters),
        )
        for level in levels
    )
    return LevelTable(heads, rows)


def _counter(value: float | None) -> str:
    """Counts in full, other numbers to three digits."""
    return str(value) if isinstance(value, int) else number(value, 3)


def _trouble(run: dict[str, Any], method: dict[str, Any]) -> Trouble:
    name = run["question"] if run["step"] is None else f"{step_name(method)} {step_text(run['step'], method)}"
    return Trouble(name, run["reason"], run["log"].strip())


def _cpu(runs: Sequence[dict[str, Any]]) -> Iterator[Entry]:
    if any(r["status"] == "answered" for r in runs):
        yield Entry("CPU time", seconds(sum(r["cpu"] for r in runs)))


def _model_facts(
    _comparison: dict[str, Any],
    runs: Sequence[dict[str, Any]],
    _case: dict[str, Any],
    reference: dict[str, Any] | None,
) -> Iterator[Entry]:
    """The engine's own account beside the reference's."""
    names = {"mass": "total mass", "com": "centre of mass", "inertia": "inertia", "freedom": "degrees of freedom"}
    answer = next((r["answer"] for r in runs if r["answer"]), None)
    if answer is None:
        return
    for key, name in names.items():
        value, expected = nested(answer[key]), nested(reference[key]) if reference else ""
        note = "as the reference" if value == expected else f"reference {expected}".strip()
        yield Entry(name, f"{value} {UNITS[key]}".strip(), note if expected else "")
    yield from _cpu(runs)


def _instant_facts(
    _comparison: dict[str, Any],
    runs: Sequence[dict[str, Any]],
    case: dict[str, Any],
    _reference: dict[str, Any] | None,
) -> Iterator[Entry]:
    yield Entry("states", str(case["instants"]), "the initial state, then random consistent ones")
    yield from _cpu(runs)


def _trajectory_facts(
    comparison: dict[str, Any],
    _runs: Sequence[dict[str, Any]],
    case: dict[str, Any],
    _reference: dict[str, Any] | None,
) -> Iterator[Entry]:
    if not comparison["levels"]:
        return
    yield Entry("digits", digits_text(comparison["digits"]), f"at the finest level; asked {case['digits']}")
    if comparison["declared_order"] is not None:
        hidden = "hidden by rounding" if comparison["order"] is None else "the two finest levels against the reference"
        among = "hidden by rounding" if comparison["self_order"] is None else "three levels, without the reference"
        yield Entry("declared order", str(comparison["declared_order"]))
        yield Entry("observed order", order_text(comparison["order"]), hidden)
        yield Entry("self order", order_text(comparison["self_order"]), among)
        yield Entry("limit digits", digits_text(comparison["limit_digits"]), "of the Richardson limit")
        yield Entry("band", number(comparison["band"]), "uncertainty of the finest level (grid convergence index)")
    yield Entry("reference spread", number(comparison["reference_spread"]), "over formulations and tolerances")
