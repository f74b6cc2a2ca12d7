"""Comparison of the reference with closed forms and published values, each with its uncertainty.

A value that differs by more than both uncertainties together disputes the reference, which then fails no engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from consilience.case import ACCELERATIONS, Published, later_equations, read_motion, read_start, sample_of, scale_of
from consilience.compare.instants import Bars, Instants
from consilience.compare.motion import Scales
from consilience.compare.result import Quantity
from consilience.engine import InstantAnswer, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism


@dataclass(frozen=True)
class Measured:
    """An expected value beside that of the reference.

    Attributes
    ----------
    known : Published
    value : float
        Of the reference.
    bar : float
        Sum of both uncertainties, in the unit of the value.
    """

    known: Published
    value: float
    bar: float

    @property
    def off(self) -> float:
        """Difference, of angles within half a turn modulo full turns."""
        return self.known.off(self.value)

    @property
    def quantity(self) -> Quantity:
        """The comparison as a quantity of the record."""
        known = self.known
        remark = f"{known.value:.15g}, uncertain by {known.uncertainty:.2g}, {known.origin}: {known.source}"
        return Quantity(known.name, self.off, self.bar, 1, f"{self.value:.15g}, expected {remark}")


def measure_motion(
    mechanism: Mechanism, published: Sequence[Published], motions: Sequence[TrajectoryAnswer], spread: Array
) -> list[Measured]:
    """Read the values of a motion that are expected.

    Parameters
    ----------
    mechanism : Mechanism
    published : sequence of Published
    motions : sequence of TrajectoryAnswer
        The best motion of the reference, and those that bound its uncertainty.
    spread : ndarray, shape (n_t,)
        Uncertainty of the best motion at each sample, relative to the scales of the motion. That of an acceleration or
        reaction is the largest difference between the motions, and rounding as at an instant.
    """
    motion = motions[0]
    scales, found = Scales.of(mechanism, motion), list[Measured]()
    for known in published:
        if known.at_start:
            continue
        n, value = sample_of(known, motion), read_motion(mechanism, known, motion)
        if known.of_equations:
            others = [read_motion(mechanism, known, other) for other in motions[1:]]
            largest = max(abs(value), float(np.max(np.abs(later_equations(mechanism, motion, n)[known.observable]))))
            bar = max((abs(other - value) for other in others), default=0.0)
            bar += _rounding(known) * float(Instants.of(mechanism, [motion.state(n)]).rounding[0]) * largest
        else:
            scale = scale_of(known.observable)
            bar = float(spread[n]) * (getattr(scales, scale) if scale else 1.0)
        found.append(Measured(known, value, known.uncertainty + bar))
    return found


def measure_start(
    mechanism: Mechanism, published: Sequence[Published], answer: InstantAnswer, instants: Instants
) -> list[Measured]:
    """Read the accelerations and reactions of the initial state that are expected."""
    found = []
    for known in published:
        if not known.at_start:
            continue
        vector = read_start(mechanism, known, answer)
        bar = known.uncertainty + _rounding(known) * float(instants.rounding[0]) * float(np.max(np.abs(vector)))
        found.append(Measured(known, float(vector[known.component]), bar))
    return found


def _rounding(known: Published) -> float:
    return Bars().acceleration if known.observable in ACCELERATIONS else Bars().reaction


def against_published(
    mechanism: Mechanism, published: Sequence[Published], motions: Sequence[TrajectoryAnswer], spread: Array
) -> tuple[Quantity, ...]:
    """Compare motions with all expected values (`measure_motion`)."""
    return tuple(measured.quantity for measured in measure_motion(mechanism, published, motions, spread))


def start_against_published(
    mechanism: Mechanism, published: Sequence[Published], answer: InstantAnswer, instants: Instants
) -> tuple[Quantity, ...]:
    """Compare the answer at the initial state with all expected values (`measure_start`)."""
    return tuple(measured.quantity for measured in measure_start(mechanism, published, answer, instants))


def dispute(quantities: Sequence[Quantity]) -> str:
    """Describe the first value that contradicts the reference; empty if none does."""
    missed = next((q for q in quantities if not q.met), None)
    if missed is None:
        return ""
    return f"{missed.name} differs by {missed.difference:.2g}, both uncertainties together {missed.bar:.2g}"
