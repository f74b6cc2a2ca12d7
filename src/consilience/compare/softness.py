"""Dependence of a difference on the softness of an engine's constraints, its own regularisation.

Answers to the same question at three softnesses s, each half the previous, form a ladder like answers at three steps
(`uncertainty`): if they converge with some order in s, they have a limit without softness. The order depends on the
engine and is observed; it must lie between `LEAST` and `MOST`. A difference is due to regularisation if the limit is
nearer to the reference by the factor `EXPLAINED`, or within what is allowed. If softness changes an answer by as much
as the difference, but not towards the reference, the cause stays open.

Matched settings are at the hard end of the engine's range, and the ladder leads from softer settings to them. Default
settings are so soft that answers are no longer proportional to s: their ladder is at far harder settings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from consilience.compare.motion import Scales, difference_over_time, extrapolated
from consilience.engine import InstantAnswer, Profile, TrajectoryAnswer
from consilience.mechanism import Array

SCALES: dict[Profile, tuple[float, ...]] = {Profile.MATCHED: (2.0, 4.0), Profile.DEFAULT: (0.01, 0.005, 0.0025)}
"""Factors of the softness of a method, which itself has the factor one. The three hardest answers form the ladder."""

LEAST, MOST = 0.5, 3.5
"""Range of believable orders in s: below, answers do not converge as s decreases; above, they hardly depend on s."""

EXPLAINED = 0.25
"""Share of a difference that may remain in the limit, if softness is its cause: a safety factor of 1.25 allows as much
for a Richardson limit. Softness that changes an answer by a smaller share of the difference is no cause."""


@dataclass(frozen=True)
class Softness:
    """Result of a ladder of softness.

    Attributes
    ----------
    order : float or None
        Order observed in s; None if answers do not depend on s.
    shift : float
        Difference of the judged answer to the limit.
    limit : float
        Difference of the limit without softness to the reference.
    """

    order: float | None
    shift: float
    limit: float

    def explains(self, difference: float, allowed: float) -> bool:
        """Whether a difference to the reference vanishes with the softness, up to what is allowed."""
        settled = self.order is not None and LEAST <= self.order <= MOST
        return settled and self.limit <= max(EXPLAINED * difference, allowed)

    def matters(self, difference: float) -> bool:
        """Whether softness changes the answer by a good share of a difference, in any direction."""
        return self.shift >= EXPLAINED * difference


def _order(hard: float, soft: float) -> float | None:
    """Return the order in s from the changes between the two hardest and the two softest answers."""
    return float(np.log2(soft / hard)) if hard > 0.0 and soft > 0.0 else None


def _ladder(scales: Sequence[float]) -> list[int]:
    """Return the indices of the three hardest answers among those at the scales 1 and `scales`, hard to soft."""
    return [int(n) for n in np.argsort([1.0, *scales])[:3]]


def of_motions(
    answers: Sequence[TrajectoryAnswer],
    softness: Sequence[float],
    reference: TrajectoryAnswer,
    scales: Scales,
    judged: slice,
) -> Softness:
    """Return the dependence on softness from motions at several softnesses.

    Parameters
    ----------
    answers : sequence of TrajectoryAnswer
        The judged motion, then those at other softness.
    softness : sequence of float
        Factors of the softness of the other motions.
    reference : TrajectoryAnswer
    scales : Scales
    judged : slice
        Samples before the horizon.
    """

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
    """Return the dependence on softness from accelerations at several softnesses.

    Parameters
    ----------
    answers : sequence of InstantAnswer
        The judged answer, then those at other softness.
    softness : sequence of float
        Factors of the softness of the other answers.
    reference : InstantAnswer
    sizes : ndarray, shape (n_s,)
        Divisors of the differences at each state.
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
