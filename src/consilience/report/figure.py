"""Parts shared by all figures: colours, dashes, markers, compact numbers, axes, lines of the digits asked.

Figures are dictionaries in Plotly's format; the script of the page adds the theme, and draws a figure when its page is
opened.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from math import isfinite
from textwrap import wrap
from typing import Any

import numpy as np

from consilience.compare.judge import REFERENCE
from consilience.report.selection import is_matched
from consilience.report.wording import method_title

# Okabe and Ito's colours, distinct for colour-blind readers; yellow and black would vanish in one of the page themes
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C8C8C")
GREY = "#8C8C8C"
SHADE = "rgba(140,140,140,0.22)"
DASHES = ("2px,5px", "longdashdot", "dashdot", "dot", "dash", "solid")
"""Dashes of the six finest levels, coarse to fine; those before are drawn as the first of them."""

MARKERS = ("circle", "square", "diamond", "triangle-up", "x", "star")

LEGEND = 50
"""Largest number of characters in a line of a legend: what a phone has room for."""

TIME = {"title": {"text": "time in s"}}
"""Axis of time."""

Figure = dict[str, Any]


def compact(values: Sequence[float | None]) -> list[float | None]:
    """Round magnitudes to four digits; zero and infinity, which a logarithmic axis cannot show, become gaps."""
    return [float(f"{abs(v):.4g}") if v and isfinite(v) else None for v in values]


def grid(times: Sequence[float]) -> Figure:
    """Return sample times; start and interval alone if the samples are evenly spread."""
    steps = np.diff(times)
    if len(times) > 1 and np.allclose(steps, steps[0], rtol=1e-9):
        return {"x0": times[0], "dx": float(f"{steps[0]:.10g}")}
    return {"x": [float(f"{t:.6g}") for t in times]}


def title_of(comparison: dict[str, Any], more: str = "") -> str:
    """Name a method in a legend: escaped, in lines that a phone has room for; a default method is labelled."""
    title = method_title(comparison["method"], is_matched(comparison)) + more
    return "<br>".join(escape(line, quote=False) for line in wrap(title, LEGEND))


def colour_of(engine: str, engines: Sequence[str]) -> str:
    """Return the colour of an engine on all plots of a report; the reference is grey."""
    return GREY if engine == REFERENCE else COLOURS[engines.index(engine) % len(COLOURS)]


def marker_of(method: int, comparison: dict[str, Any]) -> str:
    """Return the marker of a method by its place among those of its engine; hollow at the engine's defaults."""
    marker = MARKERS[method % len(MARKERS)]
    return marker if is_matched(comparison) else f"{marker}-open"


def log_axis(title: str) -> Figure:
    """Return a logarithmic axis with powers of ten."""
    return {"title": {"text": title}, "type": "log", "exponentformat": "power"}


def figure(traces: Iterable[Figure], xaxis: Figure, yaxis: Figure | str) -> Figure:
    """Make a figure; an ordinate given by its title alone is logarithmic, and labels all powers."""
    if isinstance(yaxis, str):
        yaxis = {**log_axis(yaxis), "showexponent": "all"}
    layout: Figure = {"xaxis": xaxis, "yaxis": yaxis, "shapes": [], "annotations": []}
    return {"data": [{"type": "scatter", **trace} for trace in traces], "layout": layout}


def add_asked(given: Figure, digits: int) -> None:
    """Draw a horizontal line at the digits asked."""
    level = 10.0**-digits
    line = {"color": GREY, "dash": "longdash", "width": 1}
    given["layout"]["shapes"].append(
        {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": level, "y1": level, "line": line}
    )
    _note(given, "asked", xref="paper", x=0, xanchor="left", y=-digits, yanchor="bottom")


def add_horizon(given: Figure, comparison: dict[str, Any]) -> None:
    """Draw the horizon as a vertical line, and shade the time beyond; nothing without a horizon within the motion."""
    times, horizon = comparison["times"], comparison["horizon"]
    if horizon is None:
        return
    at = float(f"{times[0] + horizon:.6g}")
    line = {"color": GREY, "width": 2}
    across = {"yref": "paper", "y0": 0, "y1": 1}
    given["layout"]["shapes"] += [
        {"type": "rect", "x0": at, "x1": times[-1], **across}
        | {"fillcolor": SHADE, "line": {"width": 0}, "layer": "below"},
        {"type": "line", "x0": at, "x1": at, **across, "line": line},
    ]
    _note(given, f"horizon {at:.3g} s", x=at, xanchor="right", yref="paper", y=1, yanchor="top")


def _note(given: Figure, text: str, **place: Any) -> None:
    given["layout"]["annotations"].append({"showarrow": False, "text": text, **place})
