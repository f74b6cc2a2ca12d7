"""Figures of the HTML page: differences and energies over time, and the horizon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from consilience.compare.horizon import EPS
from consilience.report.cases import case_figures
from consilience.report.choice import choice_figure
from consilience.report.figure import (
    DASHES,
    GREY,
    TIME,
    Figure,
    add_asked,
    add_horizon,
    colour_of,
    compact,
    figure,
    grid,
    marker_of,
    title_of,
)
from consilience.report.plots_work import step_precision, work_precision
from consilience.report.record import Record
from consilience.report.selection import method_of
from consilience.report.wording import anchor, level_text

DISPLAYED = 8
"""Largest number of markers of a curve."""


def figures(record: Record) -> dict[str, Figure]:
    """Draw all figures of a record, by the identifier of their place on the page."""
    choice = choice_figure(record)
    found: dict[str, Figure] = {"figure.choice": choice} if choice["data"] else {}
    for case in record.cases:
        name, motions = case["name"], record.motions(case["name"])
        found |= {anchor(kind, name): OF_CASE[kind](record, case) for kind in case_figures(record, case)}
        for engine in record.header["engines"]:
            own = [c for c in motions if c["engine"] == engine]
            if own:
                found[anchor("difference", name, engine)] = differences(own, record, case["digits"])
                found[anchor("energy", name, engine)] = energies(own, record)
    return found


def horizon(record: Record, case: dict[str, Any]) -> Figure:
    """Draw the growth of a rounding error along the reference, against the digits asked."""
    comparison = record.growing_motion(case["name"])
    assert comparison is not None  # as `case_figures` has found
    grown = {
        **grid(comparison["times"]),
        "y": compact([EPS * g for g in comparison["growth"]]),
        "name": "one rounding error, grown",
        "mode": "lines",
        "line": {"color": GREY, "width": 1.8},
        "hovertemplate": "%{x:.3g} s: %{y:.2e}",
    }
    found = figure([grown, *_uncertainty(comparison)], TIME, "difference to the reference")
    add_asked(found, case["digits"])
    add_horizon(found, comparison)
    return found


OF_CASE = {"horizon": horizon, "work": work_precision, "steps": step_precision}
"""Functions that draw the figures of a case, by the names that `case_figures` lists."""


def differences(compared: Sequence[dict[str, Any]], record: Record, digits: int) -> Figure:
    """Draw differences to the reference, the band of each finest level, and the uncertainty of the reference."""
    traces = [
        *_over_time(compared, record, "difference"),
        *_bands(compared, list(record.header["engines"])),
        *_uncertainty(compared[0]),
    ]
    found = figure(traces, TIME, "difference to the reference")
    add_asked(found, digits)
    add_horizon(found, compared[0])
    return found


def energies(compared: Sequence[dict[str, Any]], record: Record) -> Figure:
    """Draw the energy change of every level."""
    found = figure(_over_time(compared, record, "energy"), TIME, "|energy change| / largest kinetic energy")
    add_horizon(found, compared[0])
    return found


def _over_time(compared: Sequence[dict[str, Any]], record: Record, name: str) -> list[Figure]:
    """Draw a field of every level over time: markers for each method, a dash for each level, the finest solid."""
    traces = []
    for n, comparison in enumerate(compared):
        colour = colour_of(comparison["engine"], list(record.header["engines"]))
        method, levels = method_of(record.runs_of(comparison)), comparison["levels"]
        for k, level in enumerate(levels):
            dash = DASHES[max(0, len(DASHES) - len(levels) + k)]
            traces.append(
                {
                    **grid(comparison["times"]),
                    "y": compact(level[name]),
                    "name": level_text(level["step"], method),
                    "mode": "lines+markers",
                    "legendgroup": str(n),
                    "legendgrouptitle": {"text": title_of(comparison)},
                    "line": {"color": colour, "dash": dash, "width": 1.6},
                    "marker": _markers(n, comparison, colour),
                    "hovertemplate": "%{x:.3g} s: %{y:.2e}",
                }
            )
    return traces


def _level_line(comparison: dict[str, Any], value: float, **more: Any) -> Figure:
    """Draw a horizontal line up to the horizon."""
    start, end = comparison["times"][0], comparison["times"][-1]
    judged = end if comparison["horizon"] is None else start + comparison["horizon"]
    (height,) = compact([value])
    return {"x": [start, judged], "y": [height, height], "mode": "lines", "hovertemplate": "%{y:.2e}", **more}


def _markers(method: int, comparison: dict[str, Any], colour: str) -> Figure:
    """Return the markers of a method, as in the plots of work and precision, at some samples of a curve."""
    return {"symbol": marker_of(method, comparison), "size": 7, "color": colour, "maxdisplayed": DISPLAYED}


def _bands(compared: Sequence[dict[str, Any]], engines: list[str]) -> list[Figure]:
    """Draw the uncertainty of the finest level of each method, between the markers of the method."""
    return [
        _level_line(
            comparison,
            comparison["band"],
            name="band of the finest",
            legendgroup=str(n),
            mode="lines+markers",
            line={"color": (colour := colour_of(comparison["engine"], engines)), "dash": "1px,3px", "width": 2.2},
            marker=_markers(n, comparison, colour),
        )
        for n, comparison in enumerate(compared)
        if comparison["band"]
    ]


def _uncertainty(comparison: dict[str, Any]) -> list[Figure]:
    """Draw the uncertainty of the reference."""
    if not comparison["reference_spread"]:
        return []
    line = {"color": GREY, "dash": "1px,3px", "width": 2.2}
    return [_level_line(comparison, comparison["reference_spread"], name="uncertainty of the reference", line=line)]
