"""Prospect of a ladder: whether further levels, or other softness, would change the verdict on a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from consilience.compare import softness, uncertainty
from consilience.compare.levels import Levels
from consilience.compare.reference_motion import ReferenceMotion
from consilience.compare.result import Verdict
from consilience.compare.rules import BY_CHANCE, ELSEWHERE, NO_POWER, WITHIN_PHASE, decide
from consilience.engine import Run
from consilience.mechanism import Mechanism

_SCATTERED = frozenset({"wide band", "impacts unclear", "not asymptotic"})
"""Rules by which levels differ too much, or are too few, for any cause."""

_OPEN = _SCATTERED | {BY_CHANCE}
"""Rules after which a finer level may tell."""


@dataclass(frozen=True)
class Prospect:
    """Effect of further levels of a method on its verdict.

    Attributes
    ----------
    verdict : Verdict
        Of the levels as they are.
    decided : bool
        Neither finer levels nor other softness would change the verdict.
    finer : bool
        A finer level is expected to agree, to tell steps from model, or to have power.
    rate : float, 1/s
        Rate that no level resolves; zero if the finest level resolves all.
    steady : bool
        Whether the last levels differ by less than `softness.EXPLAINED` of what the finest differs from the reference.
        Errors of order 1/2 in the step, the least that is believed, differ by 0.41 of it: another cause makes most of
        the difference.
    scattered : bool
        Whether the levels decide nothing, and motions at coprime steps may.
    """

    verdict: Verdict
    decided: bool
    finer: bool
    rate: float = 0.0
    steady: bool = False
    scattered: bool = False

    @classmethod
    @uncertainty.BLOWN_UP
    def of(
        cls, mechanism: Mechanism, runs: Sequence[Run], reference_motion: ReferenceMotion, softer: Sequence[Run] = ()
    ) -> Prospect:
        """Return the prospect of answered levels, and of runs of the finest at other softness if there are any."""
        levels = Levels(mechanism, runs, reference_motion, softer)
        evidence = levels.evidence()
        rule, _ = decide(evidence)
        chance = not evidence.clean and len(levels.steps) <= uncertainty.LEAST_LEVELS  # three have an order by chance
        just_beyond = rule.name == ELSEWHERE and (chance or evidence.just_beyond)
        just_within = rule.name == WITHIN_PHASE and (evidence.by_scatter or _stalls(levels, evidence.impact_passes))
        if rule.name == NO_POWER or just_beyond or just_within:
            return cls(rule.verdict, False, True)  # a finer level has a narrower band
        if rule.verdict is not Verdict.DISCRETISATION:
            steady = levels.ladder.change <= softness.EXPLAINED * evidence.finest
            scattered = rule.name in _SCATTERED and not evidence.untried and evidence.unresolved_rate == 0.0
            return cls(rule.verdict, rule.final, rule.name in _OPEN, evidence.unresolved_rate, steady, scattered)
        assert evidence.declared is not None
        near = evidence.finest / uncertainty.ratio_of(levels.steps) ** evidence.declared <= evidence.allowed
        return cls(rule.verdict, not near, near)


def _stalls(levels: Levels, excused: float) -> bool:
    """Whether the difference is more than half of what impacts excuse, and has not fallen with the last step.

    Errors of impacts fall with the step, at any phase in the long run. What does not is soon beyond their bound.
    """
    before, last = (float(np.max(error[: levels.judged], initial=0.0)) for error in levels.errors[-2:])
    fallen = before / uncertainty.ratio_of(levels.steps) ** uncertainty.LEAST_ORDER
    return last > max(fallen, excused / 2.0)
