"""Comparison of the reference with closed forms and published values, each with its uncertainty.

A value that differs by more than both uncertainties together disputes the reference, which then fails no engine.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.case import Published, read_motion, read_start, scale_of
from consilience.compare.instant import Bars, Instants
from consilience.compare.motion import Scales
from consilience.compare.result import Quantity
from consilience.engine import InstantAnswer, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism


def against_published(
    mechanism: Mechanism, published: Sequence[Published], motion: TrajectoryAnswer, spread: Array
) -> tuple[Quantity, ...]:
    """Compare a motion with all published values; the bar is the sum of both uncertainties, in its unit."""
    scales = Scales.of(mechanism, motion)
    found = []
    for known in published:
        if known.at_start:
            continue
        n = int(abs(motion.time - motion.time[0] - known.time).argmin())
        scale = scale_of(known.observable)
        bar = known.uncertainty + float(spread[n]) * (getattr(scales, scale) if scale else 1.0)
        found.append(_quantity(known, read_motion(mechanism, known, motion), bar))
    return tuple(found)


def start_against_published(
    mechanism: Mechanism, published: Sequence[Published], answer: InstantAnswer, instants: Instants
) -> tuple[Quantity, ...]:
    """Compare the answer at the initial state with all published values; their uncertainty is added to the bar."""
    found = []
    for known in published:
        if not known.at_start:
            continue
        vector = read_start(mechanism, known, answer)
        bars = Bars().acceleration if known.observable.startswith("a") else Bars().reaction
        bar = known.uncertainty + bars * float(instants.rounding[0]) * float(np.max(np.abs(vector)))
        found.append(_quantity(known, float(vector[known.component]), bar))
    return tuple(found)


def _quantity(known: Published, value: float, bar: float) -> Quantity:
    remark = f"{known.value:.15g}, uncertain by {known.uncertainty:.2g}, {known.origin}: {known.source}"
    return Quantity(known.name, known.off(value), bar, 1, f"{value:.15g}, expected {remark}")


def dispute(quantities: Sequence[Quantity]) -> str:
    """Describe the first value that contradicts the reference; empty if none does."""
    missed = next((q for q in quantities if not q.met), None)
    if missed is None:
        return ""
    return f"{missed.name} differs by {missed.difference:.2g}, both uncertainties together {missed.bar:.2g}"
