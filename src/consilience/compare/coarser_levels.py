"""Differences of motions at longer steps than those of the levels that are judged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.compare import uncertainty
from consilience.compare.motion import difference_over_time, size_of_motion
from consilience.compare.reference_motion import ReferenceMotion
from consilience.compare.result import CoarserLevel
from consilience.engine import Run, TrajectoryAnswer
from consilience.mechanism import Mechanism

MOTION = ("time", "p_WB", "quat_WB", "v_WB_W", "w_WB_W")
"""Fields of the motion of the bodies alone, in the order of `TrajectoryAnswer`."""


@uncertainty.BLOWN_UP
def coarser_levels(
    mechanism: Mechanism, runs: Sequence[Run], reference_motion: ReferenceMotion
) -> tuple[CoarserLevel, ...]:
    """Compare motions at all or some samples of the reference motion with it, the longest step first."""
    whole, size = reference_motion.answer, size_of_motion(mechanism, reference_motion.answer)
    found = []
    for run in sorted(runs, key=lambda run: run.step or 0.0, reverse=True):
        largest = None
        if run.answer is not None:
            at = np.searchsorted(whole.time, run.answer.time)
            some = TrajectoryAnswer(*(getattr(whole, name)[at] for name in MOTION))
            off = difference_over_time(run.answer, some, size)[at < max(reference_motion.judged, 1)]
            largest = float(np.max(off)) if np.all(np.isfinite(off)) else None
        found.append(CoarserLevel(run.step or 0.0, run.cpu, largest))
    return tuple(found)
