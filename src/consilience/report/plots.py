"""Figures of the HTML page as compact JSON: differences and energy over time, work against precision.

Plain dictionaries in Plotly's format; the script of the page adds the theme and draws a figure when it is opened.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from consilience.report.answers import step_name, step_text
from consilience.report.record import Record
from consilience.report.wording import anchor

# Okabe and Ito's colours, told apart with every kind of colour blindness, without yellow and black: both page themes
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C8C8C")
DASHES = ("dashdot", "dot", "dash", "solid")
MARKERS = ("circle", "square", "diamond", "triangle-up", "x", "star")

Figure = dict[str, Any]


def figures(record: Record) -> dict[str, Figure]:
    """All figures by the identifier of their place on the page."""
    found: dict[str, Figure] = {}
    for case in record.cases:
        compared = [c for c in record.comparisons if c["case"] == case["name"] and c["levels"]]
        if compared:
            found[anchor("work", case["name"])] = work_precision(compared, record, case["digits"])
        for engine in record.header["engines"]:
            own = [c for c in compared if c["engine"] == engine]
            if own:
                found[anchor("difference", case["name"], engine)] = _over_time(
                    own, record, "difference", case["digits"]
                )
                found[anchor("energy", case["name"], engine)] = _over_time(own, record, "energy", None)
    return found


def compact(values: Sequence[float | None]) -> list[float | None]:
    """Four significant digits; a gap for what a logarithmic axis cannot show."""
    return [float(f"{abs(v):.4g}") if v else None for v in values]


def _method(record: Record, comparison: dict[str, Any]) -> dict[str, Any]:
    key = ("case", "engine", "question")
    for run in record.runs:
        if (
            all(run[k] == comparison[k] for k in key)
            and run["method"]
            and run["method"]["name"] == comparison["method"]
        ):
            return dict(run["method"])
    return {}


def _grid(times: Sequence[float]) -> Figure:
    """Sample times; start and interval suffice where they are evenly spread."""
    steps = np.diff(times)
    if len(times) > 1 and np.allclose(steps, steps[0], rtol=1e-9):
        return {"x0": times[0], "dx": float(f"{steps[0]:.10g}")}
    return {"x": [float(f"{t:.6g}") for t in times]}


def _over_time(compared: Sequence[dict[str, Any]], record: Record, name: str, digits: int | None) -> Figure:
    """One colour a method, one dash a level: the finest is solid."""
    traces = []
    for n, comparison in enumerate(compared):
        method = _method(record, comparison)
        levels = comparison["levels"]
        for k, level in enumerate(levels):
            dash = DASHES[max(0, len(DASHES) - len(levels) + k)]
            traces.append(
                {
                    **_grid(comparison["times"]),
                    "y": compact(level[name]),
                    "name": f"{step_name(method)} {step_text(level['step'], method)}",
                    "mode": "lines",
                    "legendgroup": str(n),
                    "legendgrouptitle": {"text": escape(comparison["method"])},
                    "line": {"color": COLOURS[n % len(COLOURS)], "dash": dash, "width": 1.6},
                    "hovertemplate": "%{x:.3g} s: %{y:.2e}",
                }
            )
    titles = {"difference": "difference to the reference", "energy": "|energy change| / largest kinetic energy"}
    return _figure(traces, {"title": {"text": "time in s"}}, titles[name], digits)


def work_precision(compared: Sequence[dict[str, Any]], record: Record, digits: int) -> Figure:
    """Largest difference against CPU time: one colour an engine, one shape a method, one marker a level."""
    engines = list(record.header["engines"])
    traces, seen = [], dict.fromkeys(engines, 0)
    for comparison in compared:
        engine, method = comparison["engine"], _method(record, comparison)
        marker = MARKERS[seen[engine] % len(MARKERS)]
        seen[engine] += 1
        colour = COLOURS[engines.index(engine) % len(COLOURS)]
        traces.append(
            {
                "x": compact([level["cpu"] for level in comparison["levels"]]),
                "y": compact([level["largest"] for level in comparison["levels"]]),
                "text": [f"{step_name(method)} {step_text(level['step'], method)}" for level in comparison["levels"]],
                "name": escape(comparison["method"]),
                "legendgroup": escape(engine),
                "legendgrouptitle": {"text": escape(engine)},
                "mode": "lines+markers",
                "line": {"color": colour, "width": 1.2},
                "marker": {"symbol": marker, "size": 8, "color": colour},
                "hovertemplate": "%{text}<br>%{x:.2g} s, %{y:.2e}",
            }
        )
    axis = {"title": {"text": "CPU time in s"}, "type": "log"}
    return _figure(traces, axis, "largest difference to the reference", digits)


def _figure(traces: list[Figure], xaxis: Figure, title: str, digits: int | None) -> Figure:
    layout: Figure = {
        "xaxis": xaxis,
        "yaxis": {"title": {"text": title}, "type": "log", "exponentformat": "power", "showexponent": "all"},
    }
    if digits is not None:
        line = {"color": "#8C8C8C", "dash": "longdash", "width": 1}
        layout["shapes"] = [
            {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 10.0**-digits, "y1": 10.0**-digits, "line": line}
        ]
        layout["annotations"] = [
            {
                "xref": "paper",
                "x": 1,
                "xanchor": "right",
                "y": -digits,
                "yanchor": "bottom",
                "showarrow": False,
                "text": "asked",
            }
        ]
    return {"data": [{"type": "scatter", **trace} for trace in traces], "layout": layout}
