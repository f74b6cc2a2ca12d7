"""Power of a ladder that another model would have ended at an earlier level.

An error of a parameter changes the motions of all levels alike. A ladder ends at the first level that a rule passes;
what changes the limit of an earlier level to the reference passes there, though the levels that were asked without the
error would have noticed it. Such an error is found by least squares, and judged as an engine with it would be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from consilience.compare import uncertainty
from consilience.compare.levels import Levels
from consilience.compare.motion import displacements
from consilience.compare.power import LARGEST, MotionSensitivity, Power
from consilience.compare.prospect import Prospect
from consilience.compare.reference_motion import ReferenceMotion
from consilience.compare.result import Verdict
from consilience.engine import Run
from consilience.mechanism import Mechanism

PASSED = (Verdict.AGREES, Verdict.DISCRETISATION)

CLAIMED = 1.5
"""Least ratio of an error that passes at an earlier level to the stated one, for which the stated one is raised."""

FURTHER = 1.25
"""Ratio of errors that are tried beyond one that passes."""


@uncertainty.BLOWN_UP
def powers(
    mechanism: Mechanism, runs: Sequence[Run], reference_motion: ReferenceMotion, passes: float, verdict: Verdict
) -> tuple[Power, ...]:
    """Return the smallest error of each parameter that acts which the levels would have noticed.

    Parameters
    ----------
    mechanism : Mechanism
    runs : sequence of Run
        Answered levels, coarse to fine.
    reference_motion : ReferenceMotion
    passes : float
        Largest difference that passes at the finest level.
    verdict : Verdict
        Of these levels.
    """
    judged = Levels(mechanism, runs, reference_motion).judged
    found = [s.power(passes, judged) for s in reference_motion.sensitivities]
    if verdict not in PASSED or len(runs) <= uncertainty.LEAST_LEVELS:
        return tuple(found)
    earlier = [Levels(mechanism, runs[:n], reference_motion) for n in range(uncertainty.LEAST_LEVELS, len(runs))]
    return tuple(
        replace(power, limit=_raised(earlier, runs, reference_motion, acting, power.limit))
        for acting, power in zip(reference_motion.sensitivities, found, strict=True)
    )


def _raised(
    earlier: Sequence[Levels],
    runs: Sequence[Run],
    reference_motion: ReferenceMotion,
    acting: MotionSensitivity,
    limit: float,
) -> float:
    """Return the largest error that an earlier level would pass, or the limit of the finest if larger."""
    for least in _cancelling(earlier, acting):
        error = least
        while CLAIMED * limit < abs(error) < LARGEST and _passes(earlier, runs, reference_motion, acting, error):
            limit, error = abs(error), FURTHER * error
    return limit


def _cancelling(earlier: Sequence[Levels], acting: MotionSensitivity) -> Iterator[float]:
    """Yield for each earlier level the error that brings its limit nearest to the reference."""
    for levels in earlier:
        limit, count = levels.declared_limit, levels.judged
        if limit is None or acting.pair is None or count < 2:
            continue
        size = levels.scales.size
        off = displacements(levels.reference, limit, size)[:, :count]
        change = displacements(*acting.pair, size)[:, :count] / acting.error
        square = float(np.sum(change**2))
        if square > 0.0 and np.isfinite(square):
            yield -float(np.sum(off * change)) / square


def _passes(
    earlier: Sequence[Levels],
    runs: Sequence[Run],
    reference_motion: ReferenceMotion,
    acting: MotionSensitivity,
    error: float,
) -> bool:
    """Whether an engine with an error of the parameter would pass at an earlier level."""
    other = replace(reference_motion, answer=acting.without(reference_motion.answer, error))
    for levels in earlier:
        prospect = Prospect.of(levels.mechanism, runs[: len(levels.runs)], other)
        if prospect.decided:
            return prospect.verdict in PASSED
    return False
