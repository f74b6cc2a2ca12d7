"""View of phases of contact over time: a strip of rectangles for each contact and engine, and the same in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any

from consilience.compare.judge import REFERENCE

WIDTH = 1000.0
"""Width of a strip, in units of its view."""

TICKS, WORDS = 6, 8
"""Most intervals of the axis of time, and most phases that are told in words."""


@dataclass(frozen=True)
class Strip:
    """Phases on one engine: rectangles from left to right with mode and tooltip, impacts, and all of it in words."""

    engine: str
    pieces: tuple[tuple[float, float, str, str], ...]
    impacts: tuple[float, ...]
    words: str


@dataclass(frozen=True)
class PhaseChart:
    """Strips by contact, stop or dry friction; ticks of the common axis of time, by place in per cent and label.

    What is apart throughout on all engines has no strips, but is named.
    """

    groups: tuple[tuple[str, tuple[Strip, ...]], ...]
    ticks: tuple[tuple[float, str], ...]
    apart: tuple[str, ...]


def phase_chart(
    phases: dict[str, Any], engines: Sequence[str], chosen: Callable[[dict[str, Any]], bool] = lambda _: True
) -> PhaseChart | None:
    """Make the chart of the phases of a replay; None where nothing is told.

    Parameters
    ----------
    phases : dict
        Engine to list of phases, as `replayschema.ReplayPhases`.
    engines : sequence of str
        Engines that are shown besides the reference.
    chosen : callable
        Whether a contact, stop or dry friction is shown.
    """
    shown = [engine for engine in dict.fromkeys((REFERENCE, *engines)) if engine in phases]
    found = [(engine, one) for engine in shown for one in phases[engine] if chosen(one)]
    if not found:
        return None
    start = min(one["pieces"][0][0] for _, one in found)
    end = max(one["pieces"][-1][1] for _, one in found)
    acting = {one["name"] for _, one in found if _acts(one)}
    groups = {name: [_strip(e, o, start, end) for e, o in found if o["name"] == name] for name in _names(found)}
    return PhaseChart(
        tuple((name, tuple(strips)) for name, strips in groups.items() if name in acting),
        tuple(_ticks(start, end)),
        tuple(name for name in groups if name not in acting),
    )


def _names(found: Sequence[tuple[str, dict[str, Any]]]) -> list[str]:
    return list(dict.fromkeys(one["name"] for _, one in found))


def _acts(one: dict[str, Any]) -> bool:
    return bool(one["impacts"]) or any(mode != "separated" for _, _, mode in one["pieces"])


def _strip(engine: str, one: dict[str, Any], start: float, end: float) -> Strip:
    def place(t: float) -> float:
        return round(WIDTH * (t - start) / ((end - start) or 1.0), 2)

    pieces = tuple(
        (place(a), round(place(b) - place(a), 2), mode, f"{mode}, {a:.4g} to {b:.4g} s") for a, b, mode in one["pieces"]
    )
    return Strip(engine, pieces, tuple(map(place, one["impacts"])), _words(one))


def _words(one: dict[str, Any]) -> str:
    """Tell phases and impacts in words."""
    first, last = one["pieces"][:WORDS], one["pieces"][-1]
    told = [f"{mode} to {end:.4g} s" for _, end, mode in first]
    if len(first) < len(one["pieces"]):
        told.append(f"{len(one['pieces']) - len(first)} more")
    elif len(told) > 1:
        told[-1] = f"then {last[2]}"
    else:
        told = [f"{last[2]} throughout"]
    times = one["impacts"]
    if len(times) > 1:
        told[-1] += f"; {len(times)} impacts from {times[0]:.4g} s to {times[-1]:.4g} s"
    elif times:
        told[-1] += f"; an impact at {times[0]:.4g} s"
    return ", ".join(told)


def _ticks(start: float, end: float) -> list[tuple[float, str]]:
    """Choose round times, 1, 2 or 5 times a power of ten apart."""
    span = end - start
    if span <= 0.0:
        return [(0.0, f"{start:g} s")]
    power = 10.0 ** floor(log10(span / TICKS))
    step = next(n * power for n in (1.0, 2.0, 5.0, 10.0) if n * power * TICKS >= span)
    times = [k * step for k in range(ceil(start / step - 1e-9), floor(end / step + 1e-9) + 1)]
    return [(100.0 * (t - start) / span, f"{t:.6g}") for t in times]
