"""The reference against what is known from elsewhere: closed forms and published values, each with its uncertainty.

A value may contradict the reference only beyond both uncertainties together. Then the reference is disputed, and may
not fail an engine.
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
    """Difference of a motion to every value known of it; the bar is the sum of both uncertainties, in its unit."""
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
    """Difference of the answer at the initial state to every value known of it; bars of `instant` beside its own."""
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
    """First value that contradicts the reference, in words; empty if none does."""
    missed = next((q for q in quantities if not q.met), None)
    if missed is None:
        return ""
    return f"{missed.name} differs by {missed.difference:.2g}, both uncertainties together {missed.bar:.2g}"
