"""The reference against what is known from elsewhere: closed forms and published values, each with its uncertainty.

A value may contradict the reference only beyond both uncertainties together. Then the reference is disputed, and may
not fail an engine.
"""

from __future__ import annotations

from collections.abc import Sequence

from consilience.case import Published
from consilience.compare.motion import Scales
from consilience.compare.result import Quantity
from consilience.mechanism import Mechanism
from consilience.run import TrajectoryAnswer
from consilience.spatial import Array

_UNITS = {"p_WB": "size", "v_WB_W": "speed", "w_WB_W": "spin"}
"""Scale that the spread of the reference, a pure number, has in each observable."""


def against_published(
    mechanism: Mechanism, published: Sequence[Published], motion: TrajectoryAnswer, spread: Array
) -> tuple[Quantity, ...]:
    """Difference of a motion to every known value; the bar is the sum of both uncertainties, in its unit."""
    scales = Scales.of(mechanism, motion)
    found = []
    for known in published:
        n = int(abs(motion.time - motion.time[0] - known.time).argmin())
        value = float(getattr(motion, known.observable)[n, mechanism.body_index[known.body], known.component])
        unit = getattr(scales, _UNITS[known.observable])
        name = f"{known.observable} of {known.body}, {'xyz'[known.component]} at {known.time:g} s"
        remark = f"{known.value:.15g}, uncertain by {known.uncertainty:.2g}: {known.source}"
        bar = known.uncertainty + float(spread[n]) * unit
        found.append(Quantity(name, abs(value - known.value), bar, 1, remark))
    return tuple(found)


def dispute(quantities: Sequence[Quantity]) -> str:
    """First value that contradicts the reference, in words; empty if none does."""
    missed = next((q for q in quantities if not q.met), None)
    if missed is None:
        return ""
    return f"{missed.name} differs by {missed.difference:.2g}, both uncertainties together {missed.bar:.2g}"
