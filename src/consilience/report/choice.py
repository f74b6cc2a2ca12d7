"""Which engine for which work: digits and CPU time by class of mechanism, digits at defaults, missing features."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from statistics import median
from typing import Any, NamedTuple

from consilience.compare.judge import REFERENCE
from consilience.report.annotations import is_own
from consilience.report.defaults import own_digits
from consilience.report.engines import EngineView
from consilience.report.figure import COLOURS, MARKERS, Figure, log_axis
from consilience.report.record import Record
from consilience.report.selection import grouped, is_matched
from consilience.report.wording import DASH, anchor, digits_text, number

CLASSES = (("contact", "contact"), ("stiff", "stiff"), ("loop", "loop"), ("tree", ""))
"""Classes of mechanisms, and the tag of their cases; the first that holds, and `tree` without any."""


NAMED = re.compile(r" '[^']*'(?=[:,])")
"""Name of an element before the reason for which it is refused."""

QUANTITY = re.compile(r"\b\d+(\.\d+)?(e[+-]?\d+)?(?= (m|s|N|rad|kg)\b)")
"""Number before a unit: a feature is the same, whatever its size."""


@dataclass(frozen=True)
class ClassRow:
    """Medians of an engine over the cases of a class: cases, digits, CPU time, digits at defaults."""

    engine: str
    anchor: str
    name: str
    values: tuple[str, str, str, str]


@dataclass(frozen=True)
class MissingFeature:
    """A feature that an engine does not represent, with the reason of its adapter, and the number of cases."""

    engine: str
    anchor: str
    reason: str
    count: int


@dataclass(frozen=True)
class Choice:
    """The section: rows by engine and class, and missing features."""

    rows: tuple[ClassRow, ...]
    missing: tuple[MissingFeature, ...]


def class_of(case: dict[str, Any]) -> str:
    """Return the class of a case by its tags."""
    return next(name for name, tag in CLASSES if not tag or tag in case["tags"])


def choice_view(record: Record, engines: Sequence[EngineView]) -> Choice:
    """Make the view of all motions and refusals of a record."""
    refused = grouped(
        ((engine.name, engine.anchor, _feature(group.text)), len(group.cells))
        for engine in engines
        for group in engine.unsupported
    )
    missing = tuple(MissingFeature(*told, sum(counts)) for told, counts in refused.items())
    return Choice(tuple(_rows(record)), missing)


def _feature(reason: str) -> str:
    """Leave the names of elements and sizes out of a reason."""
    return QUANTITY.sub("\N{HORIZONTAL ELLIPSIS}", NAMED.sub("", reason))


def _motions(record: Record, engine: str, matched: bool) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """List each case with the best motion of an engine, or the first at its defaults."""
    for case in record.cases:
        own = [c for c in record.motions(case["name"]) if c["engine"] == engine and c["digits"] is not None]
        chosen = [c for c in own if (c["best"] if matched else not is_matched(c))]
        yield from ((case, c) for c in chosen[:1])


def _rows(record: Record) -> Iterator[ClassRow]:
    for engine in (name for name in record.header["engines"] if name != REFERENCE):
        best, stock = (list(_motions(record, engine, matched)) for matched in (True, False))
        for name, _ in CLASSES:
            own = [(case, c) for case, c in best if class_of(case) == name]
            if own:
                at_defaults = [d for case, c in stock if class_of(case) == name and (d := own_digits(c)) is not None]
                values = (
                    str(len(own)),
                    digits_text(median(c["digits"] for _, c in own)),
                    number(median(_cost(case, c) for case, c in own)),
                    digits_text(median(at_defaults)) if at_defaults else DASH,
                )
                yield ClassRow(engine, anchor("page", "engine", engine), name, values)


class ChoicePoint(NamedTuple):
    """Best motion of an engine on a case: its class, CPU time over simulated time, digits, whose integrator."""

    engine: str
    group: str
    case: str
    method: str
    cost: float
    digits: float
    own: bool


def choice_points(record: Record) -> list[ChoicePoint]:
    """List the best motions of all engines."""
    return [
        ChoicePoint(
            *(engine, class_of(case), case["name"], c["method"]),
            *(float(f"{_cost(case, c):.3g}"), round(c["digits"], 2), is_own(c)),
        )
        for engine in record.header["engines"]
        if engine != REFERENCE
        for case, c in _motions(record, engine, True)
    ]


def _cost(case: dict[str, Any], motion: dict[str, Any]) -> float:
    """Return the CPU time of the finest level of a motion over its duration."""
    return float(motion["levels"][-1]["cpu"] / case["duration"])


def choice_figure(record: Record) -> Figure:
    """Draw digits over CPU time, a panel for each class, a marker for each case, in the colour of its engine."""
    points = choice_points(record)
    classes = [name for name, _ in CLASSES if name in {point.group for point in points}]
    count = len(classes)
    layout: Figure = {"height": 90 + 210 * count, "shapes": [], "annotations": []}
    layout["xaxis"] = log_axis("CPU time over simulated time") | {"anchor": f"y{count}" if count > 1 else "y"}
    traces, named = [], set[str]()
    for k, name in enumerate(classes):
        axis, top = "" if k == 0 else str(k + 1), 1.0 - k / count
        domain = [top - 0.85 / count, top - 0.12 / count]
        layout[f"yaxis{axis}"] = {"domain": domain, "title": {"text": "digits"}, "rangemode": "tozero"}
        place = {"xref": "paper", "x": 0, "xanchor": "left", "yref": "paper", "y": top, "yanchor": "top"}
        layout["annotations"].append({"text": name, "showarrow": False, **place})
        for n, engine in enumerate(record.header["engines"]):
            found = [point for point in points if (point.engine, point.group) == (engine, name)]
            if not found:
                continue
            symbol = MARKERS[n % len(MARKERS)]
            look = {"color": COLOURS[n % len(COLOURS)], "size": 8}
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": [point.cost for point in found],
                    "y": [point.digits for point in found],
                    "text": [escape(f"{point.case}: {point.method}") for point in found],
                    "name": escape(engine),
                    "legendgroup": escape(engine),
                    "showlegend": engine not in named,
                    "yaxis": f"y{axis}",
                    "marker": look | {"symbol": [symbol if point.own else f"{symbol}-open" for point in found]},
                    "hovertemplate": "%{text}<br>%{x:.2g}, %{y:.1f} digits",
                }
            )
            named.add(engine)
    return {"data": traces, "layout": layout}
