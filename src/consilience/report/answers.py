"""View of the answer of one engine to one question by one method."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log10
from typing import Any

from consilience.compare import Verdict
from consilience.compare.rules import RULES
from consilience.report.annotations import counts
from consilience.report.facts import Fact, facts_of, horizon_text, power_facts, softness_facts, would_pass
from consilience.report.selection import AnswerLines, is_matched, judged_largest, softness_of
from consilience.report.wording import (
    DASH,
    PROFILES,
    ROUTES,
    Look,
    cause_of,
    counted,
    difference_text,
    digits_text,
    level_text,
    look_of,
    method_title,
    number,
    order_text,
    plain,
    seconds,
    step_name,
    step_text,
)

CONDITIONS = {rule.name: rule.when.replace("`", "") for rule in RULES}


@dataclass(frozen=True)
class QuantityRow:
    """A compared quantity; `state` is ``met``, ``missed`` or ``absent``, `undetermined` counts values left out."""

    name: str
    difference: str
    bar: str
    count: str
    state: str
    remark: str
    undetermined: str = ""

    @property
    def verdict(self) -> str:
        """The state in words."""
        return {"met": "\N{CHECK MARK} met", "missed": "\N{NOT EQUAL TO} missed", "absent": "not compared"}[self.state]


@dataclass(frozen=True)
class Gauge:
    """A difference with its uncertainty and its bar on a logarithmic scale.

    Positions are percentages of the width, which extends from 1e-17 to 10.
    """

    name: str
    at: float
    low: float
    high: float
    bar: float
    met: bool
    label: str


@dataclass(frozen=True)
class NumberTable:
    """A table of numbers with heads and a caption."""

    caption: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Trouble:
    """A run without an answer: its name, the reason, and the output of the engine."""

    run: str
    reason: str
    log: str


@dataclass(frozen=True)
class AnswerView:
    """The answer to one question by one method.

    Attributes
    ----------
    lines : AnswerLines
        Lines of the record that the view is made from.
    matched : bool
        Whether the engine ran with matched settings; else with its own defaults.
    best, counts : bool
        Whether the method is the engine's best at the question, and whether the answer counts for its cell.
    rule, condition : str
        The rule that decided, and its condition; empty where bars decided.
    cause : str
        Cause of the verdict in a sentence without numbers; `why` has the numbers.
    judged : str
        Time up to which a motion is judged; empty if the whole motion is judged.
    power : tuple of Fact
        Smallest errors that would have been noticed.
    blind : bool
        Whether an error of 10 % in a parameter that acts would have passed.
    """

    lines: AnswerLines
    question: str
    method: str
    route: str
    route_sentence: str
    matched: bool
    best: bool
    counts: bool
    profile: str
    look: Look
    rule: str
    condition: str
    cause: str
    why: str
    judged: str
    digits: str
    quantities: tuple[QuantityRow, ...]
    gauges: tuple[Gauge, ...]
    tables: tuple[NumberTable, ...]
    facts: tuple[Fact, ...]
    softness: tuple[Fact, ...]
    power: tuple[Fact, ...]
    blind: bool
    settings: tuple[tuple[str, str], ...]
    troubles: tuple[Trouble, ...]
    unsupported: tuple[str, ...]
    log: str

    @property
    def title(self) -> str:
        """Name of the method; a default method is labelled."""
        return method_title(self.method, self.matched)

    @property
    def settings_count(self) -> str:
        """Number of settings, in words."""
        return counted(len(self.settings), "setting")


def answer_view(lines: AnswerLines) -> AnswerView:
    """Make the view of an answer."""
    comparison, case, method = lines.comparison, lines.case, lines.method
    verdict, rule = Verdict(comparison["verdict"]), comparison["rule"]
    short, sentence = ROUTES.get(comparison["route"], ("no method", "the engine offered none"))
    return AnswerView(
        lines=lines,
        question=comparison["question"],
        method=comparison["method"],
        route=short,
        route_sentence=sentence,
        matched=is_matched(comparison),
        best=bool(comparison["best"]),
        counts=is_matched(comparison) and counts(comparison),
        profile=PROFILES[comparison["profile"]],
        look=look_of(verdict, rule, is_matched(comparison)),
        rule=rule,
        condition=CONDITIONS.get(rule, ""),
        cause=cause_of(comparison["cause"], verdict),
        why=comparison["why"],
        judged=horizon_text(comparison, case),
        digits=digits_text(comparison["digits"]),
        quantities=tuple(_quantity(q, case) for q in comparison["quantities"]),
        gauges=tuple(_gauges(comparison, case)),
        tables=tuple(t for t in (_levels(comparison, method), _observables(comparison)) if t.rows),
        facts=tuple(facts_of(lines)),
        softness=tuple(softness_facts(lines)),
        power=tuple(power_facts(comparison)),
        blind=any(map(would_pass, comparison["power"])),
        settings=tuple((str(k), plain(v)) for k, v in method.get("settings", {}).items()),
        troubles=tuple(_trouble(r, method) for r in (*lines.levels, *lines.probes) if r["status"] == "failed"),
        unsupported=tuple(comparison["why"].split("; ")) if verdict is Verdict.UNSUPPORTED else (),
        log="" if verdict is Verdict.FAILED else "\n".join(r["log"].strip() for r in lines.levels if r["log"].strip()),
    )


def _gauges(comparison: dict[str, Any], case: dict[str, Any]) -> Iterator[Gauge]:
    """Draw every difference with a bar; the finest level of a motion with its band plus the reference's uncertainty."""
    for q in comparison["quantities"]:
        if q["count"] and q["difference"] is not None and q["bar"]:
            yield _gauge(q["name"], q["difference"], 0.0, q["bar"])
    if comparison["levels"]:
        largest = judged_largest(comparison, comparison["levels"][-1])
        if largest is not None:
            uncertain = (comparison["band"] or 0.0) + (comparison["reference_spread"] or 0.0)
            yield _gauge("motion, finest level", largest, uncertain, 10.0 ** -case["digits"])


def _gauge(name: str, difference: float, uncertain: float, bar: float) -> Gauge:
    def at(value: float) -> float:
        return round((min(max(log10(max(value, 1e-300)), -17.0), 1.0) + 17.0) / 18.0 * 100.0, 2)

    spread = f" \N{PLUS-MINUS SIGN} {number(uncertain)}" if uncertain else ""
    met = difference <= bar
    return Gauge(
        name,
        at(difference),
        at(difference - uncertain),
        at(difference + uncertain),
        at(bar),
        met,
        f"{number(difference)}{spread}, bar {number(bar)}: {'within' if met else 'beyond'}",
    )


def _quantity(q: dict[str, Any], case: dict[str, Any]) -> QuantityRow:
    """Make the row of a quantity; its difference is None in the record where it was not finite."""
    joints = case["undetermined"] if q["name"] == "reactions" else {}
    count = sum(sum(counts) for counts in joints.values())
    if q["count"] == 0 and count < 6 * len(case["joints"]) * case["instants"]:
        joints = {}  # the method gives no reactions: nothing was compared, though some values are determined
    remark = f"{q['remark']}: {', '.join(joints)}" if joints else q["remark"]
    undetermined = f"{count} undetermined" if joints else ""
    if q["count"] == 0:
        return QuantityRow(q["name"], DASH, number(q["bar"]), DASH, "absent", remark, undetermined)
    difference, bar = q["difference"], q["bar"]
    state = "met" if difference is not None and bar is not None and difference <= bar else "missed"
    text = difference_text(difference)
    return QuantityRow(q["name"], text, number(bar), str(q["count"]), state, remark, undetermined)


def _levels(comparison: dict[str, Any], method: dict[str, Any]) -> NumberTable:
    """Tabulate the levels of a motion, coarse to fine."""
    levels = comparison["levels"]
    counters = list(dict.fromkeys(name for level in levels for name in level["counters"]))
    horizon = comparison["horizon"] is not None
    heads = (
        step_name(method),
        *(("largest up to the horizon",) if horizon else ()),
        "largest difference",
        "rms difference",
        "CPU time",
        "joint violation",
        *(name.replace("_", " ") for name in counters),
    )
    rows = tuple(
        (
            step_text(level["step"], method),
            *((number(judged_largest(comparison, level), 3),) if horizon else ()),
            number(level["largest"], 3),
            number(level["rms"], 3),
            seconds(level["cpu"]),
            number(level["residual"]),
            *(_counter(level["counters"].get(name)) for name in counters),
        )
        for level in levels
    )
    return NumberTable("Levels, coarse to fine", heads, rows)


def _observables(comparison: dict[str, Any]) -> NumberTable:
    """Tabulate order and band of each observable, from the levels alone."""
    return NumberTable(
        "Observables at the finest level, without the reference",
        ("observable", "change from the level before", "observed order", "band"),
        tuple(
            (o["name"], number(o["change"]), order_text(o["order"]), number(o["band"]))
            for o in comparison["observables"]
        ),
    )


def _counter(value: float | None) -> str:
    """Write an integer in full, another number to three digits."""
    return str(value) if isinstance(value, int) else number(value, 3)


def _trouble(run: dict[str, Any], method: dict[str, Any]) -> Trouble:
    name = run["question"] if run["step"] is None else level_text(run["step"], method)
    softness = softness_of(run)
    if softness not in (None, 1.0):
        name += f", softness {softness:g}"
    return Trouble(name, run["reason"], run["log"].strip())
