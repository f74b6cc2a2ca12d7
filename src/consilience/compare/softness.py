"""Dependence of a difference on the softness of an engine's constraints, its own regularisation.

Answers to the same question at three softnesses s, each half the previous, form a ladder like answers at three steps
(`uncertainty`): if they converge with some order in s, they have a limit without softness. The order depends on the
engine and is observed; it must lie between `LEAST` and `MOST`. A ladder may be so hard that its answers only scatter:
the hardest is the limit, if three times the scatter is within the share `EXPLAINED` of what softness has moved. A
difference is due to regularisation if the limit is nearer to the reference by the factor `EXPLAINED`, or within what is
allowed. If softness changes an answer by as much as the difference, but not towards the reference, the cause stays
open.

Matched settings are at the hard end of the engine's range, and the ladder leads from softer settings to them. Default
settings are so soft that answers are no longer proportional to s: their ladder is at far harder settings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from consilience.compare.motion import Scales, difference_over_time, extrapolated
from consilience.compare.uncertainty import CAUTIOUS
from consilience.engine import Profile, TrajectoryAnswer
from consilience.mechanism import Array

_T = TypeVar("_T")

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
        Order observed in s; None if the answers of the ladder do not depend on s, or scatter too little to matter.
    shift : float
        Difference of the judged answer to the limit.
    limit : float
        Difference of the limit without softness to the reference.
    """

    order: float | None
    shift: float
    limit: float

    @property
    def observed(self) -> str:
        """Order in the softness, in words."""
        return "no order in it left" if self.order is None else f"order {self.order:.2f} in it"

    def explains(self, difference: float, allowed: float, hard_limit: float = np.inf) -> bool:
        """Whether a difference to the reference vanishes with the softness, up to the allowed difference.

        A smaller difference of the limit without softness and without steps, `hard_limit`, counts as well.
        """
        settled = self.order is None or LEAST <= self.order <= MOST
        return settled and min(self.limit, hard_limit) <= max(EXPLAINED * difference, allowed)

    def matters(self, difference: float) -> bool:
        """Whether softness changes the answer by at least `EXPLAINED` of a difference, in any direction."""
        return self.shift >= EXPLAINED * difference


def _dependence(
    answers: Sequence[_T],
    softness: Sequence[float],
    reference: _T,
    difference: Callable[[_T, _T], float],
    extrapolate: Callable[[_T, _T, float], _T],
) -> tuple[Softness, _T]:
    """Extrapolate a ladder of answers to no softness, and compare the limit with the reference; return both.

    Parameters
    ----------
    answers : sequence
        The judged answer, then those at other softness.
    softness : sequence of float
        Factors of the softness of the other answers.
    reference : answer
    difference : callable
        Largest relative difference of two answers.
    extrapolate : callable
        Function of a soft answer, a harder one and ``d = 2^p - 1``: ``hard + (hard - soft) / d``.
    """
    one, two, four = (answers[n] for n in np.argsort([1.0, *softness])[:3])  # the three hardest, hard to soft
    hard, soft = difference(one, two), difference(two, four)
    order = float(np.log2(soft / hard)) if hard > 0.0 and soft > 0.0 else None
    if order is not None and not LEAST <= order <= MOST:
        moved = difference(answers[0], one)
        order = None if CAUTIOUS * max(hard, soft) <= EXPLAINED * moved else order
    limit = one if order is None or order < LEAST else extrapolate(two, one, 2.0**order - 1.0)
    shift = difference(answers[0], limit) if one is not answers[0] or limit is not one else hard
    return Softness(order, shift, difference(limit, reference)), limit


def of_motions(
    answers: Sequence[TrajectoryAnswer],
    softness: Sequence[float],
    reference: TrajectoryAnswer,
    scales: Scales,
    judged: slice,
) -> tuple[Softness, TrajectoryAnswer]:
    """Return the dependence on softness from motions at several softnesses, and the limit without softness.

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
    return _dependence(
        answers,
        softness,
        reference,
        lambda a, b: float(np.max(difference_over_time(a, b, scales.size)[judged])),
        lambda soft, hard, d: extrapolated(soft, hard, 1.0 / d),
    )


def of_vectors(
    answers: Sequence[Sequence[Array] | Array],
    softness: Sequence[float],
    reference: Sequence[Array] | Array,
    sizes: Array,
) -> Softness:
    """Return the dependence on softness from vectors at several softnesses.

    Parameters
    ----------
    answers : sequence of sequence of ndarray
        The vectors that are judged, one at each state, then those at other softness.
    softness : sequence of float
        Factors of the softness of the other answers.
    reference : sequence of ndarray
    sizes : ndarray, shape (n_s,)
        Divisors of the differences at each state.
    """

    def difference(one: Sequence[Array] | Array, other: Sequence[Array] | Array) -> float:
        largest = [np.max(np.abs(a - b), initial=0.0) for a, b in zip(one, other, strict=True)]
        return float(np.max(np.array(largest) / sizes))

    def extrapolate(soft: Sequence[Array] | Array, hard: Sequence[Array] | Array, d: float) -> list[Array]:
        return [h + (h - s) / d for s, h in zip(soft, hard, strict=True)]

    return _dependence(answers, softness, reference, difference, extrapolate)[0]
