"""How a difference moves with an engine's own regularisation of constraints.

The same question at three softnesses s, each half the one before, is a ladder as steps are (`uncertainty`): answers
that converge with some order in s have a limit without softness. The order is not declared, it depends on what the
engine softens; it has to be seen, between `LEAST` and `MOST`. A difference is put down to regularisation if the limit
is nearer to the reference by the factor `EXPLAINED`, or as near as is asked. If softness moves an answer by as much,
but not there, nothing can be said.

Settings that are matched stand at the hard end of the engine's knob, and the ladder leads from softer ones to them.
Defaults are so soft that answers are not in proportion to s any more: the ladder stands at far harder ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from consilience.compare.motion import Scales, difference_over_time, extrapolated
from consilience.engine import InstantAnswer, Profile, TrajectoryAnswer
from consilience.mechanism import Array

SCALES: dict[Profile, tuple[float, ...]] = {Profile.MATCHED: (2.0, 4.0), Profile.DEFAULT: (0.01, 0.005, 0.0025)}
"""Softness asked besides that of the method, which is one. Three make a ladder: the hardest of all answers."""

LEAST, MOST = 0.5, 3.5
"""Orders in s that are believed: below, answers do not settle as s shrinks; above, they hardly depend on it."""

EXPLAINED = 0.25
"""Part of a difference that may remain without softness, if softness is to be its cause: what a safety factor of 1.25
grants a Richardson limit. Softness that moves an answer by less than this part has no say in it."""


@dataclass(frozen=True)
class Softness:
    """What a ladder of softness says.

    Attributes
    ----------
    order : float or None
        Observed in s; None where answers do not change with it.
    shift : float
        Difference of the answer in question to the limit.
    limit : float
        Difference of the limit without softness to the reference.
    """

    order: float | None
    shift: float
    limit: float

    def explains(self, difference: float, allowed: float) -> bool:
        """Whether a difference to the reference goes away with the softness, up to what is allowed."""
        settled = self.order is not None and LEAST <= self.order <= MOST
        return settled and self.limit <= max(EXPLAINED * difference, allowed)

    def matters(self, difference: float) -> bool:
        """Whether softness moves the answer by a good part of a difference, wherever to."""
        return self.shift >= EXPLAINED * difference


def _order(hard: float, soft: float) -> float | None:
    """Order in s from the changes between the two hardest and the two softest answers."""
    return float(np.log2(soft / hard)) if hard > 0.0 and soft > 0.0 else None


def _ladder(scales: Sequence[float]) -> list[int]:
    """Positions of the three hardest answers among those at one and at these scales, hard to soft."""
    return [int(n) for n in np.argsort([1.0, *scales])[:3]]


def of_motions(
    answers: Sequence[TrajectoryAnswer],
    softness: Sequence[float],
    reference: TrajectoryAnswer,
    scales: Scales,
    judged: slice,
) -> Softness:
    """Softness from the motion in question, the first, and those at these scales."""

    def largest(a: TrajectoryAnswer, b: TrajectoryAnswer) -> float:
        return float(np.max(difference_over_time(a, b, scales.size)[judged]))

    one, two, four = (answers[n] for n in _ladder(softness))
    order = _order(largest(one, two), largest(two, four))
    limit = one if order is None or order <= 0 else extrapolated(two, one, 1.0 / (2.0**order - 1.0))
    moved = largest(answers[0], limit) if one is not answers[0] or limit is not one else largest(one, two)
    return Softness(order, moved, largest(limit, reference))


def of_accelerations(
    answers: Sequence[InstantAnswer], softness: Sequence[float], reference: InstantAnswer, sizes: Array
) -> Softness:
    """Softness from the accelerations in question, the first, and those at these scales.

    Parameters
    ----------
    sizes : ndarray, shape (n_s,)
        What differences at each state are relative to.
    """
    found, expected = [_accelerations(a) for a in answers], _accelerations(reference)

    def largest(difference: Array) -> float:
        return float(np.max(np.max(np.abs(difference), axis=(1, 2)) / sizes))

    one, two, four = (found[n] for n in _ladder(softness))
    order = _order(largest(two - one), largest(four - two))
    limit = one if order is None or order <= 0 else one + (one - two) / (2.0**order - 1.0)
    moved = found[0] - limit if one is not found[0] or limit is not one else two - one
    return Softness(order, largest(moved), largest(limit - expected))


def _accelerations(answer: InstantAnswer) -> Array:
    return np.concatenate([answer.a_WB_W, answer.alpha_WB_W], axis=2)
