"""Comparison of motions: verdict on the levels of a method, cause and power.

The levels are in `levels`, the rules in `rules`, the power of ladders that ended early in `stopped_early`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.compare import uncertainty
from consilience.compare.levels import Levels
from consilience.compare.motion import difference_over_time, kept_samples, size_of_motion
from consilience.compare.reference_motion import ReferenceMotion
from consilience.compare.result import Comparison, digits_of
from consilience.compare.rules import decide
from consilience.compare.stopped_early import powers
from consilience.engine import Question, Run, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism


def spread_over_time(mechanism: Mechanism, answers: Sequence[TrajectoryAnswer]) -> Array:
    """Return the largest difference of the other motions to the first up to each sample, shape (n_t,)."""
    size = size_of_motion(mechanism, answers[0])
    differences = [difference_over_time(a, answers[0], size) for a in answers[1:]]
    return np.maximum.accumulate(np.max([np.zeros(len(answers[0].time)), *differences], axis=0))


def reference_spread(mechanism: Mechanism, answers: Sequence[TrajectoryAnswer]) -> float:
    """Return the largest difference of the other motions to the first."""
    return float(spread_over_time(mechanism, answers)[-1])


@uncertainty.BLOWN_UP
def compare_trajectory(
    mechanism: Mechanism,
    runs: Sequence[Run],
    reference_motion: ReferenceMotion,
    softer: Sequence[Run] = (),
    earlier: str = "",
    lost: float = 0.0,
) -> Comparison:
    """Judge the levels of one method, coarse to fine.

    Parameters
    ----------
    runs : sequence of Run
        Answered runs of one case, engine and method; behind the levels those at coprime steps, if there are any.
    reference_motion : ReferenceMotion
    softer : sequence of Run
        Runs of the finest level at the scales of `softness.SCALES`, if the engine has a softness.
    earlier : str
        Difference of the engine at `model` or `instant`, in words.
    lost : float
        See `evidence.Evidence`.
    """
    levels, method = Levels(mechanism, runs, reference_motion, softer), runs[0].method
    assert method is not None
    ladder, reference, growth = levels.ladder, levels.reference, levels.reference_motion.growth
    evidence = levels.evidence(earlier, lost)
    rule, why = decide(evidence)
    samples = kept_samples(len(reference.time))
    return Comparison(
        case=runs[0].case,
        engine=runs[0].engine,
        question=Question.TRAJECTORY,
        method=method.name,
        route=method.route,
        profile=method.profile,
        verdict=rule.verdict,
        rule=rule.name,
        why=why,
        digits=digits_of(evidence.finest) if levels.judged > 1 else None,
        limit_digits=None if ladder.limit is None else digits_of(ladder.limit),
        declared_order=ladder.declared,
        order=ladder.order,
        self_order=ladder.self_order,
        band=ladder.band,
        reference_spread=evidence.reference,
        horizon=evidence.judged if levels.judged < len(reference_motion.answer.time) else None,
        softness=evidence.softness,
        observables=uncertainty.estimates(levels.answers, method, levels.steps, levels.scales),
        times=tuple(float(t) for t in reference.time[samples]),
        growth=() if growth is None else tuple(float(g) for g in growth[samples]),
        levels=levels.shown(samples),
        power=powers(levels, reference_motion, evidence, rule.verdict),
    )
