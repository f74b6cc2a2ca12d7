"""Work-precision figures: the difference of every engine over CPU time, and over the step."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

from consilience.report.figure import Figure, add_asked, colour_of, compact, figure, log_axis, marker_of, title_of
from consilience.report.record import Record
from consilience.report.selection import mean_step, method_of, tried_levels
from consilience.report.wording import level_text, order_text


def work_precision(record: Record, case: dict[str, Any]) -> Figure:
    """Draw the largest difference over CPU time."""
    return _precision(record, case, "CPU time in s", lambda level, _: level["cpu"])


def step_precision(record: Record, case: dict[str, Any]) -> Figure:
    """Draw the largest difference over the step; over the mean step of an adaptive method."""
    duration = case["duration"]
    return _precision(record, case, "step in s", lambda level, method: mean_step(level, method, duration), orders=True)


def _precision(
    record: Record,
    case: dict[str, Any],
    axis: str,
    abscissa: Callable[[dict[str, Any], dict[str, Any]], float | None],
    orders: bool = False,
) -> Figure:
    """Draw the largest differences of all levels of a case.

    Engines differ by colour, methods by the shape of the marker; markers of default methods are hollow. Longer steps,
    which are not judged, are drawn where at least one digit is right.

    Parameters
    ----------
    record : Record
    case : dict
    axis : str
        Title of the abscissa.
    abscissa : callable
        Function from a level and its method to the abscissa; None for no marker.
    orders : bool
        Whether the legend has the observed orders.
    """
    engines = list(record.header["engines"])
    traces, seen = [], dict.fromkeys(engines, 0)
    for comparison in sorted(record.motions(case["name"]), key=lambda c: engines.index(c["engine"])):
        engine, method = comparison["engine"], method_of(record.runs_of(comparison))
        marker = marker_of(seen[engine], comparison)
        seen[engine] += 1
        placed = [
            (x, level, largest)
            for level, largest in tried_levels(comparison)
            if (x := abscissa(level, method)) and (level in comparison["levels"] or (largest or 1.0) < 1.0)
        ]
        if not placed:
            continue
        colour = colour_of(engine, engines)
        stated = orders and method.get("substeps") and comparison["order"] is not None
        own = f", order {order_text(comparison['order'])}" if stated else ""
        traces.append(
            {
                "x": compact([x for x, _, _ in placed]),
                "y": compact([largest for _, _, largest in placed]),
                "text": [level_text(level["step"], method) for _, level, _ in placed],
                "name": title_of(comparison, own),
                "legendgroup": escape(engine),
                "legendgrouptitle": {"text": escape(engine)},
                "mode": "lines+markers",
                "line": {"color": colour, "width": 1.2},
                "marker": {"symbol": marker, "size": 9, "color": colour},
                "hovertemplate": "%{text}<br>%{x:.2g} s, %{y:.2e}",
            }
        )
    found = figure(traces, log_axis(axis), "largest difference to the reference")
    add_asked(found, case["digits"])
    return found
