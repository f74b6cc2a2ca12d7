"""Figures along the motions of all engines: reactions of the joints, and violation of their constraints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from consilience.compare.judge import REFERENCE
from consilience.report.figure import COLOURS, GREY, TIME, Figure, figure, log_axis
from consilience.report.record import Record
from consilience.report.wording import anchor

DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
MOST_JOINTS = 12
"""Largest number of joints in a figure."""


def replay_figures(record: Record, replays: Mapping[str, dict[str, Any]]) -> dict[str, Figure]:
    """Draw the figures of all cases, by the identifier of their place on the page."""
    engines, found = list(record.header["engines"]), {}
    for case in record.cases:
        along = (replays.get(case["name"]) or {}).get("along")
        if along:
            found[anchor("drift", case["name"])] = drift(along, engines)
            if along["joints"]:
                found[anchor("reactions", case["name"])] = reactions(along, engines)
    return found


def reactions(along: dict[str, Any], engines: list[str]) -> Figure:
    """Draw the reaction force on the successor of every joint over time: a colour for each joint, dashes by engine."""
    yaxis = {"title": {"text": "reaction force in N"}, "rangemode": "tozero"}
    return figure(_series(along, engines), TIME, yaxis)


def _series(along: dict[str, Any], engines: list[str]) -> Iterator[Figure]:
    others = [name for name in engines if name != REFERENCE]
    for engine, series in along["engines"].items():
        # the reference is wide and pale, behind the lines of engines that agree
        own = engine == REFERENCE
        dash = "solid" if own else DASHES[(others.index(engine) if engine in others else 0) % len(DASHES)]
        for n, joint in enumerate(along["joints"][:MOST_JOINTS]):
            yield {
                "x": along["times"],
                "y": series["force"][n],
                "name": escape(joint),
                "legendgroup": escape(engine),
                "legendgrouptitle": {"text": escape(engine)},
                "mode": "lines",
                "line": {"color": COLOURS[n % len(COLOURS)], "dash": dash, "width": 5 if own else 1.4},
                "opacity": 0.4 if own else 1.0,
                "hovertemplate": "%{x:.3g} s: %{y:.5g} N",
            }


def drift(along: dict[str, Any], engines: list[str]) -> Figure:
    """Draw the largest violation of a joint constraint over time, a colour for each engine."""
    traces = [
        {
            "x": along["times"],
            "y": [v or None for v in series["drift"]],
            "name": escape(engine),
            "mode": "lines",
            "line": {
                "color": GREY if engine == REFERENCE else COLOURS[engines.index(engine) % len(COLOURS)],
                "dash": DASHES[engines.index(engine) % len(DASHES)],
                "width": 1.8,
            },
            "hovertemplate": "%{x:.3g} s: %{y:.2e}",
        }
        for engine, series in along["engines"].items()
        if engine in engines
    ]
    return figure(traces, TIME, log_axis("joint violation in m or rad"))
