"""Figures of a motion: its curves by the reference, reactions on all engines upon them, violation of constraints.

Grey is the reference, every other colour an engine, as in all figures of a page.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

from consilience.compare.judge import REFERENCE
from consilience.report.curves import FLOOR, CurveSet
from consilience.report.figure import GREY, MARKERS, TIME, Figure, colour_of, figure, log_axis
from consilience.report.record import Record
from consilience.report.wording import anchor

DASHES = ("solid", "dash", "dot", "dashdot", "longdash")


def replay_figures(record: Record, replays: Mapping[str, dict[str, Any]]) -> dict[str, Figure]:
    """Draw the figures of all cases, by the identifier of their place on the page."""
    engines, found = list(record.header["engines"]), {}
    for case in record.cases:
        replay = replays.get(case["name"]) or {}
        along = replay.get("along")
        sets = [CurveSet.of(one) for one in replay.get("curves", [])]
        for curves in sets:
            found[anchor(curves.what, case["name"])] = motion_figure(curves, along, engines)
        for joint, _, _, _ in case["joints"]:
            panels = joint_panels(sets, joint)
            if panels:
                found[anchor("joint", case["name"], joint)] = _stacked(panels, along, engines)
        if along:
            found[anchor("drift", case["name"])] = drift(along, engines)
    return found


class CurvePanel(NamedTuple):
    """A panel of a figure: curves, their name among the panels of the curves, and the title that is shown."""

    curves: CurveSet
    name: str
    title: str


def motion_figure(curves: CurveSet, along: dict[str, Any] | None, engines: Sequence[str]) -> Figure:
    """Draw curves of the reference in panels above one another, and reactions on the engines as markers upon them."""
    found = _stacked([CurvePanel(curves, panel, panel) for panel in curves.by_panel()], along, engines)
    count = len(curves.by_panel())
    if curves.panels > count:
        found["layout"]["xaxis"]["title"] = {"text": f"time in s; the first {count} of {curves.panels} panels"}
    return found


def joint_panels(sets: Sequence[CurveSet], joint: str) -> list[CurvePanel]:
    """List the panels of one joint: coordinates, rates, reactions."""
    words = {"coordinates": "{}", "rates": "rate of {}", "reactions": "reaction {}"}
    return [
        CurvePanel(curves, panel, words[curves.what].format(panel.rpartition(": ")[2]))
        for curves in sets
        if curves.what in words
        for panel in curves.by_panel()
        if panel.rpartition(": ")[0] == joint
    ]


def _stacked(panels: Sequence[CurvePanel], along: dict[str, Any] | None, engines: Sequence[str]) -> Figure:
    """Draw panels above one another, with a legend for all."""
    count, traces = len(panels), list[Figure]()
    layout: Figure = {"height": 90 + 130 * count, "shapes": [], "annotations": []}
    layout["xaxis"] = {**TIME, "anchor": f"y{count}" if count > 1 else "y"}
    for k, (curves, panel, words) in enumerate(panels):
        own, marks = curves.by_panel()[panel], curves.marks
        axis, top = "" if k == 0 else str(k + 1), 1.0 - k / count
        title = escape(words) + (f" ({marks[panel]})" if panel in marks else "")
        layout[f"yaxis{axis}"] = {
            "domain": [top - 0.76 / count, top - 0.2 / count],
            "title": {"text": curves.names[own[0]].unit},
        }
        place = {"xref": "paper", "x": 0, "xanchor": "left", "yref": "paper", "y": top, "yanchor": "top"}
        layout["annotations"].append({"text": title, "showarrow": False, **place})
        traces += _lines(curves, own, f"y{axis}")
        traces += _markers(along or {}, panel, f"y{axis}", engines, FLOOR * float(np.max(np.abs(curves.values))))
    named = set[str]()
    for trace in traces:  # an entry of the legend for each name
        trace["showlegend"] = trace["name"] not in named
        named.add(trace["name"])
    return {"data": [{"type": "scatter", **trace} for trace in traces], "layout": layout}


def _lines(curves: CurveSet, own: Sequence[int], axis: str) -> Iterator[Figure]:
    """Draw the curves of a panel by the reference, in its grey: a dash for each component."""
    for n, k in enumerate(own):
        name = curves.names[k]
        yield {
            "x": curves.time.tolist(),
            "y": curves.values[:, k].tolist(),
            "name": escape(f"reference, {name.label}" if len(own) > 1 else REFERENCE),
            "yaxis": axis,
            "mode": "lines",
            "line": {"color": GREY, "dash": DASHES[n % len(DASHES)], "width": 2},
            "hovertemplate": f"%{{x:.4g}} s: %{{y:.5g}} {name.unit}",
        }


def _markers(along: dict[str, Any], panel: str, axis: str, engines: Sequence[str], rounding: float) -> Iterator[Figure]:
    """Draw a reaction on the engines at their samples, in the colours of the engines; zero where it is rounding."""
    joint, _, part = panel.rpartition(": ")
    if part not in ("force", "torque") or joint not in along.get("joints", ()):
        return
    n = along["joints"].index(joint)
    for engine, series in along["engines"].items():
        if engine in engines and engine != REFERENCE:
            k = engines.index(engine)
            yield {
                "x": along["times"],
                "y": [0.0 if v is not None and abs(v) < rounding else v for v in series[part][n]],
                "name": escape(engine),
                "yaxis": axis,
                "mode": "markers",
                "marker": {"color": colour_of(engine, engines), "symbol": MARKERS[k % len(MARKERS)], "size": 5},
                "hovertemplate": f"%{{x:.3g}} s: %{{y:.5g}} {'N' if part == 'force' else 'N m'}",
            }


def drift(along: dict[str, Any], engines: list[str]) -> Figure:
    """Draw the largest violation of a joint constraint over time, a colour for each engine."""
    traces = [
        {
            "x": along["drift_times"] or along["times"],
            "y": [v or None for v in series["drift"]],
            "name": escape(engine),
            "mode": "lines",
            "line": {
                "color": colour_of(engine, engines),
                "dash": DASHES[engines.index(engine) % len(DASHES)],
                "width": 1.8,
            },
            "hovertemplate": "%{x:.3g} s: %{y:.2e}",
        }
        for engine, series in along["engines"].items()
        if engine in engines
    ]
    return figure(traces, TIME, log_axis("joint violation in m or rad"))
