"""Select lines of a record: runs of a comparison, levels and probes, matched and default methods, what decides."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

from consilience.engine import Profile

_Key = TypeVar("_Key", bound=Hashable)
_Value = TypeVar("_Value")


def grouped(pairs: Iterable[tuple[_Key, _Value]]) -> dict[_Key, list[_Value]]:
    """Collect values by key, keys and values in the order of the pairs."""
    found: dict[_Key, list[_Value]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


def is_matched(comparison: dict[str, Any]) -> bool:
    """Whether the engine ran with matched settings, which alone decide the verdict of a cell and the exit code."""
    return bool(comparison["profile"] == Profile.MATCHED)


def softness_of(run: dict[str, Any]) -> float | None:
    """Return the scale of the engine's own softness; None for hard constraints."""
    softness: float | None = run["method"]["softness"] if run["method"] else None
    return softness


def levels_of(runs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Choose the runs of a method at its own softness, coarse to fine."""
    return [run for run in runs if softness_of(run) in (None, 1.0)]


def probes_of(runs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Choose the runs of a method at other softness, hard to soft; these are no levels."""
    found = {s: run for run in runs if (s := softness_of(run)) is not None and s != 1.0}
    return [found[s] for s in sorted(found)]


def method_of(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the method of some runs; empty if the engine offered none."""
    return next((run["method"] for run in levels_of(runs) if run["method"]), None) or {}


def judged_largest(comparison: dict[str, Any], level: dict[str, Any]) -> float | None:
    """Return the largest difference of a level up to the horizon; None where nothing is judged."""
    times, horizon = comparison["times"], comparison["horizon"]
    if horizon is None:
        largest: float | None = level["largest"]
        return largest
    if horizon <= 0.0:
        return None
    end = times[0] + horizon * (1.0 + 1e-9)
    judged = [d for t, d in zip(times, level["difference"], strict=True) if t <= end]
    return None if any(d is None for d in judged) else max(judged, default=0.0)


def tried_levels(comparison: dict[str, Any]) -> list[tuple[dict[str, Any], float | None]]:
    """List all steps that were tried with their largest difference up to the horizon, coarse to fine.

    The first are those that are not judged.
    """
    coarser = [(level, level["largest"]) for level in comparison["coarser"]]
    return coarser + [(level, judged_largest(comparison, level)) for level in comparison["levels"]]


@dataclass(frozen=True)
class Deciding:
    """The quantity with the largest ratio of difference to bar; None for a number that is absent or not finite."""

    name: str
    difference: float | None
    bar: float | None


def deciding(comparison: dict[str, Any], case: dict[str, Any]) -> Deciding:
    """Return the quantity that decides a comparison.

    For a motion: the largest difference of the finest level up to the horizon, and the digits asked.
    """
    if comparison["levels"]:
        return Deciding("motion", judged_largest(comparison, comparison["levels"][-1]), 10.0 ** -case["digits"])
    counted = [q for q in comparison["quantities"] if q["count"]]
    if not counted:
        return Deciding("", None, None)
    worst = max(counted, key=_nearness)
    return Deciding(worst["name"], worst["difference"], worst["bar"])


def _nearness(quantity: dict[str, Any]) -> float:
    """Return difference over bar; infinite if the difference is not finite, or if a bar of 0 is missed."""
    difference, bar = quantity["difference"], quantity["bar"]
    if difference is None:
        return float("inf")
    if not bar:
        return float("inf") if difference else 0.0
    return float(difference / bar)


def mean_step(level: dict[str, Any], method: dict[str, Any], duration: float) -> float | None:
    """Return the step of a level, s; the mean step of an adaptive method, None if the engine does not count steps."""
    if method.get("substeps"):
        step: float | None = level["step"]
        return step
    steps = level["counters"].get("steps")
    return duration / steps if steps else None


@dataclass(frozen=True)
class AnswerLines:
    """Lines of a record about one answer.

    Attributes
    ----------
    comparison, case : dict
    runs : sequence of dict
        All runs of the method.
    reference : dict or None
        Answer of the reference to the question `model`.
    """

    comparison: dict[str, Any]
    runs: Sequence[dict[str, Any]]
    case: dict[str, Any]
    reference: dict[str, Any] | None

    @cached_property
    def method(self) -> dict[str, Any]:
        """The method; empty if the engine offered none."""
        return method_of(self.runs)

    @cached_property
    def levels(self) -> list[dict[str, Any]]:
        """Runs at the method's own softness, coarse to fine."""
        return levels_of(self.runs)

    @cached_property
    def probes(self) -> list[dict[str, Any]]:
        """Runs at other softness, hard to soft."""
        return probes_of(self.runs)
