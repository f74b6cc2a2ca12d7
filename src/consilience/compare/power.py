"""Power of a comparison: the smallest error of a parameter that would have moved its verdict.

The reference is asked about the mechanism with one parameter off by a small size e (`mechanism.perturbation`). Its
answer changes by S e; S is the sensitivity of what is compared. A comparison that lets a difference d pass would have
noticed an error of d / S in the parameter. d follows from the rule that decides (`Evidence.passes`) or from the bars of
the quantities; S does not depend on the engine. Errors are small enough for linearity: a limit above `LARGEST` is not
measured, and means that the error would pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from consilience.compare.horizon import LINEAR
from consilience.compare.motion import difference_over_time, extrapolated, size_of_motion
from consilience.compare.uncertainty import ROUNDING
from consilience.engine import Question, Run, Status, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism

LARGEST = 0.1
"""Error that no verdict may pass over, of any parameter that acts at the digits asked."""

SIZE = 1e-5
"""Size of an error at first: its square, which linearity neglects, is as small as the rounding of an answer."""

LEAST = 100.0 * ROUNDING
"""Smallest change of a motion that gives a sensitivity to two digits; `LINEAR` is the largest."""

NOISE = 10.0
"""A parameter acts if it changes the motion by this many times as much as another tolerance does."""

STATES = 3
"""Number of states, for errors after which states are assembled again, of the sensitivity of answers to `instant`."""

MEASURED = (Question.MODEL, Question.INSTANT, Question.TRAJECTORY)
"""Questions whose comparisons have a power."""

__all__ = ["LARGEST", "LEAST", "LINEAR", "MEASURED", "SIZE", "STATES", "MotionSensitivity", "Power", "sensitivities"]


@dataclass(frozen=True)
class Power:
    """Smallest error of a parameter that a comparison would have noticed.

    Attributes
    ----------
    kind : str
        Kind of parameter, one of `mechanism.perturbation.KINDS`.
    of : str
        The parameter in words.
    limit : float
        Relative error; of the place of a joint over the characteristic length of a body, of an axis in rad. Infinite
        where the parameter does not act before the horizon.
    """

    kind: str
    of: str
    limit: float

    @property
    def missed(self) -> bool:
        """Whether the largest error passes."""
        return not self.limit < LARGEST


def powerless(found: Sequence[Power]) -> bool:
    """Whether every parameter that acts may be wrong by the largest error; False where none acts."""
    return bool(found) and all(power.missed for power in found)


@dataclass(frozen=True, eq=False)
class MotionSensitivity:
    """Change of a motion for an error of a parameter.

    Attributes
    ----------
    kind, of : str
        As in `Power`.
    effect : ndarray, shape (n_t,)
        Largest difference of the motions up to each sample, over the size of the error.
    pair : tuple of two TrajectoryAnswer, or None
        The motions without and with the error.
    error : float
        Its size.
    """

    kind: str
    of: str
    effect: Array
    pair: tuple[TrajectoryAnswer, TrajectoryAnswer] | None = None
    error: float = 0.0

    def power(self, passes: float, judged: int) -> Power:
        """Return the smallest error that changes the motion by more than `passes` in the judged samples."""
        effect = float(self.effect[judged - 1]) if judged else 0.0
        return Power(self.kind, self.of, passes / effect if effect > 0.0 else np.inf)

    def without(self, motion: TrajectoryAnswer, error: float) -> TrajectoryAnswer:
        """Return a motion less the change that an error of the parameter makes, by linearity."""
        assert self.pair is not None
        changed = extrapolated(*self.pair, -error / self.error, motion)
        poses = {name: getattr(changed, name) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")}
        return replace(motion, **poses)


def largest_difference(mechanism: Mechanism, a: TrajectoryAnswer, b: TrajectoryAnswer) -> float:
    """Return the largest difference of two motions over all samples, relative to the size of the second."""
    return float(np.max(difference_over_time(a, b, size_of_motion(mechanism, b))))


def sensitivities(mechanism: Mechanism, runs: Sequence[Run]) -> tuple[MotionSensitivity, ...]:
    """Return the sensitivities of a motion to the parameters that act on it.

    Parameters
    ----------
    mechanism : Mechanism
    runs : sequence of Run
        Runs of the reference, of one method: levels, and motions with a parameter off at the tolerance of one of them.
    """
    levels = {r.step: r.answer for r in runs if r.perturbation is None and r.answer is not None}
    found = []
    for run in runs:
        error, undisturbed = run.perturbation, levels.get(run.step)
        if error is None or undisturbed is None or run.status is not Status.ANSWERED:
            continue
        size = size_of_motion(mechanism, undisturbed)
        change = np.maximum.accumulate(difference_over_time(run.answer, undisturbed, size))
        noise = max(ROUNDING, *(NOISE * largest_difference(mechanism, a, undisturbed) for a in levels.values()))
        if change[-1] > noise:
            effect = np.where(change > ROUNDING, change, 0.0) / error.size
            found.append(MotionSensitivity(error.kind, error.of, effect, (undisturbed, run.answer), error.size))
    return tuple(found)
