"""Power of a ladder that another model would have ended at an earlier level.

An error of a parameter changes the motions of all levels alike. A ladder ends at the first level that a rule passes;
what brings the limit of an earlier level to the reference passes there, though the levels that were asked without the
error would have noticed it. Errors of several sizes, and those that bring a limit nearest by least squares, are judged
as an engine with them would be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from consilience.compare import uncertainty
from consilience.compare.evidence import Evidence
from consilience.compare.levels import Levels
from consilience.compare.motion import displacements
from consilience.compare.power import LARGEST, MotionSensitivity, Power
from consilience.compare.prospect import Prospect
from consilience.compare.reference_motion import ReferenceMotion
from consilience.compare.result import Verdict
from consilience.compare.softness import EXPLAINED
from consilience.engine import Run
from consilience.mechanism import Mechanism

PASSED = (Verdict.AGREES, Verdict.DISCRETISATION)

CLAIMED = 1.5
"""Least ratio of an error that passes at an earlier level to the stated one, for which the stated one is raised."""

FURTHER = 1.25
"""Ratio of errors that are tried beyond one that passes."""


@uncertainty.BLOWN_UP
def powers(
    levels: Levels, reference_motion: ReferenceMotion, evidence: Evidence, verdict: Verdict
) -> tuple[Power, ...]:
    """Return the smallest error of each parameter that acts which the levels would have noticed.

    Parameters
    ----------
    levels : Levels
    reference_motion : ReferenceMotion
        To the end of the motion.
    evidence : Evidence
        Of the levels.
    verdict : Verdict
        Of the levels.
    """
    found = [s.power(evidence.passes, levels.judged) for s in reference_motion.sensitivities]
    if verdict not in PASSED or len(levels.runs) <= uncertainty.LEAST_LEVELS or levels.judged < 2:
        return tuple(found)
    earlier = _Earlier(levels.mechanism, levels.runs, reference_motion, evidence.allowed)
    return tuple(
        power if acting.pair is None else replace(power, limit=earlier.raised(acting, power.limit))
        for acting, power in zip(reference_motion.sensitivities, found, strict=True)
    )


class _Earlier:
    """Levels at which a ladder did not end, and could have with another model."""

    def __init__(
        self, mechanism: Mechanism, runs: Sequence[Run], reference_motion: ReferenceMotion, allowed: float
    ) -> None:
        counts = range(uncertainty.LEAST_LEVELS, len(runs))
        self.ends = [Levels(mechanism, runs[:n], reference_motion) for n in counts]
        self.reference_motion, self.allowed = reference_motion, allowed

    def raised(self, acting: MotionSensitivity, limit: float) -> float:
        """Return the largest error that an earlier level would pass, or the limit of the finest if larger."""
        for least in (*self._cancelling(acting), *_multiples(limit)):
            if abs(least) < CLAIMED * limit:
                continue
            error = least
            while abs(error) < LARGEST and self._pass(acting, error):
                limit, error = abs(error), FURTHER * error
        return limit

    def _cancelling(self, acting: MotionSensitivity) -> Iterator[float]:
        """Yield for each level the error that brings its limit nearest to the reference."""
        assert acting.pair is not None
        for levels in self.ends:
            if (limit := levels.declared_limit) is None:
                continue
            size, judged = levels.scales.size, slice(levels.judged)
            off = displacements(levels.reference, limit, size)[:, judged]
            change = displacements(*acting.pair, size)[:, judged] / acting.error
            square = float(np.sum(change**2))
            if square > 0.0 and np.isfinite(square):
                yield -float(np.sum(off * change)) / square

    def _pass(self, acting: MotionSensitivity, error: float) -> bool:
        """Whether an engine with an error of the parameter would end at a level and pass there."""
        change = abs(error) * float(acting.effect[self.ends[-1].judged - 1])
        if not any(self._in_reach(levels, change) for levels in self.ends):
            return False
        other = replace(self.reference_motion, answer=acting.without(self.reference_motion.answer, error))
        for levels in self.ends:
            prospect = Prospect.of(levels.mechanism, levels.runs, other)
            if prospect.decided:
                return prospect.verdict in PASSED
        return False

    def _in_reach(self, levels: Levels, change: float) -> bool:
        """Whether a change of the motion may bring the limit of a level within what passes there."""
        ladder, finest = levels.ladder, float(np.max(levels.errors[-1][: levels.judged]))
        passes = max(EXPLAINED * (finest + change), self.allowed)
        limit = np.inf if ladder.limit is None else ladder.limit
        return min(limit, ladder.remains) - passes <= change <= limit + passes


def _multiples(limit: float) -> list[float]:
    """Return errors of both signs from `CLAIMED` times a limit up to the largest."""
    count = math.ceil(math.log2(LARGEST / limit)) if 0.0 < limit < LARGEST else 0
    return [sign * CLAIMED * limit * 2.0**n for n in range(count) for sign in (1.0, -1.0)]
