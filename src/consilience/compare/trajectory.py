"""Comparison of motions: differences to the reference over time, uncertainty of the levels, verdict and cause.

Differences are in `motion`, the uncertainty of the levels in `uncertainty`, the horizon in `horizon`, the rules in
`rules`.

Whether the levels are asymptotic follows from the order among themselves, or from the order against the reference with
two levels only or below rounding. Levels that converge to another motion have no clear order against the reference, and
must not be taken for too coarse steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from consilience.compare import softness, uncertainty
from consilience.compare.horizon import judged_samples
from consilience.compare.motion import (
    OBSERVABLES,
    Scales,
    difference_over_time,
    energy_over_time,
    extrapolated,
    kept_samples,
    largest_residual,
    size_of_motion,
)
from consilience.compare.result import Comparison, Level, Verdict, digits_of
from consilience.compare.rules import Evidence, decide
from consilience.engine import Question, Run, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism

RESIDUAL_SAMPLES = 21


def spread_over_time(mechanism: Mechanism, answers: Sequence[TrajectoryAnswer]) -> Array:
    """Return the largest difference of the other motions to the first up to each sample, shape (n_t,)."""
    size = size_of_motion(mechanism, answers[0])
    differences = [difference_over_time(a, answers[0], size) for a in answers[1:]]
    return np.maximum.accumulate(np.max([np.zeros(len(answers[0].time)), *differences], axis=0))


def reference_spread(mechanism: Mechanism, answers: Sequence[TrajectoryAnswer]) -> float:
    """Return the largest difference of the other motions to the first."""
    return float(spread_over_time(mechanism, answers)[-1])


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """Reference motion of a case with its uncertainty and horizon.

    Attributes
    ----------
    answer : TrajectoryAnswer
    spread : ndarray, shape (n_t,)
        Uncertainty up to each sample: the spread over formulations, integrators and tolerances.
    digits : int
        Digits the case asks.
    growth : ndarray, shape (n_t,), or None
        Growth of perturbations (`horizon.growth`); None if unknown: then there is no horizon.
    dispute : str
        Published value that contradicts the reference beyond both uncertainties; empty if none does.
    """

    answer: TrajectoryAnswer
    spread: Array
    digits: int
    growth: Array | None = field(default=None)
    dispute: str = ""

    @property
    def judged(self) -> int:
        """Number of samples before the horizon."""
        if self.growth is None:
            return len(self.answer.time)
        return judged_samples(self.growth, self.spread, self.digits)


@dataclass(frozen=True)
class _Ladder:
    order: float | None = None
    self_order: float | None = None
    band: float | None = None
    limit: float | None = None
    declared: int | None = None

    @property
    def settled(self) -> float | None:
        """Order that decides whether the levels are asymptotic: preferably the order among themselves."""
        return self.order if self.self_order is None else self.self_order

    @property
    def asymptotic(self) -> bool:
        return self.declared is not None and uncertainty.settled(self.settled, self.declared)


def _ladder(
    runs: Sequence[Run], answers: Sequence[TrajectoryAnswer], size: float, reference_motion: ReferenceMotion
) -> _Ladder:
    method = runs[0].method
    assert method is not None
    declared, judged = uncertainty.declared_order(method), slice(reference_motion.judged)
    if declared is None or len(answers) < 2 or reference_motion.judged < 1:
        return _Ladder()
    ratio = uncertainty.ratio_of([run.step for run in runs])
    errors = [difference_over_time(a, reference_motion.answer, size)[judged] for a in answers]
    changes = [difference_over_time(a, b, size)[judged] for a, b in pairwise(answers)]
    limit = uncertainty.richardson(answers[-2], answers[-1], declared, ratio)
    found = _Ladder(
        order=uncertainty.finest_order([uncertainty.rms(e) for e in errors], ratio),
        self_order=uncertainty.finest_order([uncertainty.rms(c) for c in changes], ratio),
        limit=float(np.max(difference_over_time(limit, reference_motion.answer, size)[judged])),
        declared=declared,
    )
    wide = uncertainty.band(float(np.max(changes[-1])), found.settled, declared, ratio, 0.0)
    return _Ladder(found.order, found.self_order, wide, found.limit, declared)


# squares of a motion that diverges overflow: they are compared as infinite
_BLOWN_UP = np.errstate(over="ignore", invalid="ignore")


@_BLOWN_UP
def compare_trajectory(
    mechanism: Mechanism,
    runs: Sequence[Run],
    reference_motion: ReferenceMotion,
    softer: Sequence[Run] = (),
    earlier: str = "",
) -> Comparison:
    """Judge the levels of one method, coarse to fine.

    Parameters
    ----------
    runs : sequence of Run
        Answered runs of one case, engine and method.
    reference_motion : Yardstick
    softer : sequence of Run
        Runs of the finest level at the scales of `softness.SCALES`, if the engine has a softness.
    earlier : str
        Difference of the engine at `model` or `instant`, in words.
    """
    answers = [run.answer for run in runs]
    method, reference = runs[0].method, reference_motion.answer
    assert method is not None
    scales = Scales.of(mechanism, reference)
    ladder = _ladder(runs, answers, scales.size, reference_motion)
    levels = _levels(mechanism, runs, answers, reference_motion, scales.size)
    soft = _softness(answers[-1], softer, reference_motion, scales)
    evidence = replace(_evidence(runs, answers, reference_motion, scales, ladder), softness=soft, earlier=earlier)
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
        digits=digits_of(evidence.finest) if reference_motion.judged > 1 else None,
        limit_digits=None if ladder.limit is None else digits_of(ladder.limit),
        declared_order=ladder.declared,
        order=ladder.order,
        self_order=ladder.self_order,
        band=ladder.band,
        reference_spread=evidence.reference,
        horizon=evidence.judged if reference_motion.judged < len(reference.time) else None,
        softness=soft,
        observables=uncertainty.estimates(answers, method, [run.step for run in runs], scales),
        times=tuple(float(t) for t in reference.time[samples]),
        growth=() if reference_motion.growth is None else tuple(float(g) for g in reference_motion.growth[samples]),
        levels=levels,
    )


@dataclass(frozen=True)
class Prospect:
    """Effect of further levels of a method on its verdict.

    Attributes
    ----------
    decided : bool
        Neither finer levels nor other softness would change the verdict.
    next_agrees : bool
        The levels converge to the reference, and the next level is expected to agree.
    """

    decided: bool
    next_agrees: bool

    @classmethod
    @_BLOWN_UP
    def of(cls, mechanism: Mechanism, runs: Sequence[Run], reference_motion: ReferenceMotion) -> Prospect:
        """Return the prospect of answered levels."""
        answers = [run.answer for run in runs]
        scales = Scales.of(mechanism, reference_motion.answer)
        evidence = _evidence(
            runs, answers, reference_motion, scales, _ladder(runs, answers, scales.size, reference_motion)
        )
        rule, _ = decide(evidence)
        if rule.verdict is not Verdict.DISCRETISATION:
            return cls(rule.final, False)
        assert evidence.declared is not None
        ratio = uncertainty.ratio_of([run.step for run in runs])
        near = evidence.finest / ratio**evidence.declared <= evidence.allowed
        return cls(not near, near)


def _evidence(
    runs: Sequence[Run],
    answers: Sequence[TrajectoryAnswer],
    reference_motion: ReferenceMotion,
    scales: Scales,
    ladder: _Ladder,
) -> Evidence:
    """Return the evidence of the levels, without softness and earlier differences."""
    reference = reference_motion.answer
    return Evidence(
        asked=10.0**-reference_motion.digits,
        judged=float(reference.time[max(reference_motion.judged - 1, 0)] - reference.time[0]),
        duration=float(np.ptp(reference.time)),
        reference=float(reference_motion.spread[max(reference_motion.judged - 1, 0)]),
        dispute=reference_motion.dispute,
        finest=float(
            np.max(difference_over_time(answers[-1], reference, scales.size)[: reference_motion.judged], initial=0.0)
        ),
        limit=ladder.limit,
        band=ladder.band,
        order=ladder.settled,
        declared=ladder.declared,
        asymptotic=ladder.asymptotic,
        velocities=_velocities(runs, answers, reference_motion, scales),
    )


def _velocities(
    runs: Sequence[Run], answers: Sequence[TrajectoryAnswer], reference_motion: ReferenceMotion, scales: Scales
) -> float:
    """Return the difference of the velocities of the finest level, or of the limit at order one if smaller."""
    candidates = [answers[-1]]
    steps = [run.step for run in runs[-2:]]
    if len(steps) == 2 and steps[0] and steps[1] and steps[0] > steps[1]:
        candidates.append(extrapolated(answers[-2], answers[-1], steps[1] / (steps[0] - steps[1])))
    names = ("velocity", "angular velocity")
    return min(
        max(
            float(
                np.max(
                    OBSERVABLES[name](motion, reference_motion.answer, scales)[: reference_motion.judged], initial=0.0
                )
            )
            for name in names
        )
        for motion in candidates
    )


def _softness(
    finest: TrajectoryAnswer, softer: Sequence[Run], reference_motion: ReferenceMotion, scales: Scales
) -> softness.Softness | None:
    answers = [finest, *(run.answer for run in softer)]
    if len(answers) < 3 or reference_motion.judged < 2:
        return None
    found = [run.method.softness or 1.0 for run in softer if run.method is not None]
    return softness.of_motions(answers, found, reference_motion.answer, scales, slice(reference_motion.judged))


def _levels(
    mechanism: Mechanism,
    runs: Sequence[Run],
    answers: Sequence[TrajectoryAnswer],
    reference_motion: ReferenceMotion,
    size: float,
) -> tuple[Level, ...]:
    reference, judged = reference_motion.answer, slice(max(reference_motion.judged, 1))
    samples = kept_samples(len(reference.time))
    few = kept_samples(len(reference.time), RESIDUAL_SAMPLES)
    differences = [difference_over_time(a, reference, size) for a in answers]
    return tuple(
        Level(
            step=run.step or 0.0,
            cpu=run.cpu,
            largest=float(np.max(d[judged])),
            rms=uncertainty.rms(d[judged]),
            difference=tuple(float(x) for x in d[samples]),
            energy=tuple(float(x) for x in energy_over_time(mechanism, answer, samples)),
            residual=largest_residual(mechanism, answer, few),
            counters=answer.counters,
        )
        for run, answer, d in zip(runs, answers, differences, strict=True)
    )
