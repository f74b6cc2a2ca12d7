"""Levels of a motion: differences to the reference over time, order, uncertainty and limit of the ladder.

Differences are in `motion`, the uncertainty of the levels in `uncertainty`, the horizon in `horizon`, the rules in
`rules`.

Whether the levels are asymptotic follows from the order among themselves, or from the order against the reference with
two levels only or below rounding. Levels that converge to another motion have no clear order against the reference, and
must not be taken for too coarse steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from consilience.compare import coprime_steps, softness, uncertainty
from consilience.compare.evidence import Evidence
from consilience.compare.motion import (
    OBSERVABLES,
    Scales,
    difference_over_time,
    displacements,
    energy_over_time,
    extrapolated,
    kept_samples,
    largest_residual,
    sampled_motion,
    saturation,
)
from consilience.compare.other_laws import COMPLIANCE
from consilience.compare.reference_motion import ReferenceMotion, first_samples, up_to_shortest
from consilience.compare.result import Level
from consilience.engine import Run, TrajectoryAnswer
from consilience.mechanism import Mechanism, turning_rate

RESIDUAL_SAMPLES = 21
RATE_SAMPLES = 3


@dataclass(frozen=True)
class Ladder:
    """Orders of the levels against the reference and among themselves; band of the finest level; Richardson limit.

    `change` is the largest of the last two differences of consecutive levels, infinite with fewer than three levels;
    `settled_limit` the difference of the limit along which levels draw together; `uneven` the largest last change of
    positions or of orientations whose own order is not the declared one.
    """

    order: float | None = None
    self_order: float | None = None
    band: float | None = None
    limit: float | None = None
    remains: float = np.inf
    saturation: float = 0.0
    change: float = np.inf
    spread: float = np.inf
    envelope: float | None = None
    settled_limit: float = np.inf
    uneven: float = 0.0
    declared: int | None = None

    @property
    def settled(self) -> float | None:
        """Order that decides whether the levels are asymptotic: preferably the order among themselves."""
        return self.order if self.self_order is None else self.self_order

    @property
    def asymptotic(self) -> bool:
        """Whether the order that decides is near the declared one."""
        return self.declared is not None and uncertainty.settled(self.settled, self.declared)


class Levels:
    """Answered runs of one method, coarse to fine, compared with a reference motion; behind them coprime steps."""

    def __init__(
        self, mechanism: Mechanism, runs: Sequence[Run], reference_motion: ReferenceMotion, softer: Sequence[Run] = ()
    ) -> None:
        self.mechanism, self.runs, self.softer = mechanism, [run for run in runs if not run.coprime], softer
        self.coprime = [run for run in runs if run.coprime]
        self.duration = float(np.ptp(reference_motion.answer.time))
        answers = up_to_shortest([run.answer for run in (*self.runs, *softer)])
        self.reference_motion = reference_motion.up_to(len(answers[0].time))
        self.answers, self.soft_answers = answers[: len(self.runs)], answers[len(self.runs) :]
        self.steps = [run.step for run in self.runs]
        self.reference, self.judged = self.reference_motion.answer, self.reference_motion.judged
        self.scales = Scales.of(mechanism, self.reference)
        self.errors = [difference_over_time(a, self.reference, self.scales.size) for a in self.answers]
        self.ladder = self._ladder()

    def _ladder(self) -> Ladder:
        """Return orders, band and limit up to the horizon; all None without two levels of a declared order."""
        method, judged = self.runs[0].method, slice(self.judged)
        assert method is not None
        declared = uncertainty.declared_order(method)
        if declared is None or len(self.answers) < 2 or self.judged < 1:
            return Ladder()
        ratio, size = uncertainty.ratio_of(self.steps), self.scales.size
        changes = [difference_over_time(a, b, size)[judged] for a, b in pairwise(self.answers)]
        largest = [float(np.max(change)) for change in changes]
        limit = self._limit(declared)
        chain = self.answers[-3:] if len(self.answers) > 2 else [*self.answers, self.reference]
        found = Ladder(
            order=uncertainty.finest_order([uncertainty.rms(e[judged]) for e in self.errors], ratio),
            self_order=uncertainty.finest_order([uncertainty.rms(c) for c in changes], ratio),
            limit=self._off(limit),
            settled_limit=uncertainty.off_where_closing(self.answers, limit, self.reference, size, judged, ratio),
            saturation=max(saturation(a, b, size, judged) for a, b in pairwise(chain)),
            change=max(largest[-2:]) if len(largest) > 1 else np.inf,
            spread=_spread(largest),
            envelope=uncertainty.envelope(largest, self.steps, 10.0**-self.reference_motion.digits),
            uneven=self._uneven(declared, ratio),
            declared=declared,
        )
        band = uncertainty.band(largest[-1], found.settled, declared, ratio, 0.0)
        orders = [declared] if found.settled is None or not found.asymptotic else [declared, found.settled]
        return replace(found, band=band, remains=min(self._off(self._limit(order)) for order in orders))

    def _uneven(self, declared: int, ratio: float) -> float:
        """Return the last change of positions or of orientations whose own order is not the declared one.

        Where modes change, three levels have an order by chance, though positions and orientations seldom both.
        """
        found, m = 0.0, self.mechanism
        for name in ("position", "orientation") if m.contacts or m.stops or m.dry_frictions else ():
            apart = [OBSERVABLES[name](a, b, self.scales)[: self.judged] for a, b in pairwise(self.answers)]
            order = uncertainty.finest_order([uncertainty.rms(one) for one in apart], ratio)
            if not uncertainty.settled(order, declared):
                found = max(found, float(np.max(apart[-1])))
        return found

    @property
    def declared_limit(self) -> TrajectoryAnswer | None:
        """Richardson limit at the declared order; None without a ladder."""
        return None if self.ladder.declared is None else self._limit(self.ladder.declared)

    def _limit(self, order: float) -> TrajectoryAnswer:
        """Return the Richardson limit of the two finest levels at an order."""
        return uncertainty.richardson(self.answers[-2], self.answers[-1], order, uncertainty.ratio_of(self.steps))

    def _off(self, motion: TrajectoryAnswer) -> float:
        """Return the largest difference of a motion to the reference up to the horizon."""
        return float(np.max(difference_over_time(motion, self.reference, self.scales.size)[: self.judged]))

    @property
    def _native_step(self) -> float:
        """Step of the finest level; zero for tolerances."""
        method = self.runs[-1].method
        return (self.steps[-1] or 0.0) if method is not None and method.substeps else 0.0

    def evidence(self, earlier: str = "", lost: float = 0.0) -> Evidence:
        """Return the numbers by which the levels are judged."""
        last, time, ladder = max(self.judged - 1, 0), self.reference.time, self.ladder
        soft, hard_limit, method = *self._dependence(), self.runs[-1].method
        found = Evidence(
            asked=10.0**-self.reference_motion.digits,
            judged=float(time[last] - time[0]),
            duration=self.duration,
            reference=float(self.reference_motion.spread[last]),
            dispute=self.reference_motion.dispute,
            singular=self.reference_motion.singular is not None,
            finest=float(np.max(self.errors[-1][: self.judged], initial=0.0)),
            limit=ladder.limit,
            band=ladder.band,
            order=ladder.settled,
            declared=ladder.declared,
            asymptotic=ladder.asymptotic,
            softness=soft,
            earlier=earlier,
            lost=lost,
            effects={s.of: float(s.effect[last]) for s in self.reference_motion.sensitivities},
            velocities=self._velocities(),
            remains=ladder.remains,
            saturation=ladder.saturation,
            spread=ladder.spread,
            hard_limit=hard_limit,
            cut=self._cut(),
            impacts=bool(np.any(self.reference_motion.impacts <= time[last])),
            together=self.reference_motion.joint_impact,
            phase=self._phase(float(time[last])),
            jumps=self._jumps(float(time[last])),
            untried=method is not None and method.softness is not None and not self.softer,
            envelope=ladder.envelope,
            scatter=self._scatter(),
            settled=ladder.settled_limit,
            uneven=ladder.uneven,
            touching=bool(self.mechanism.contacts),
            off_soft=self._off_soft(),
            coprime=self._coprime(),
            **self._other_law(),
        )
        return found if found.finest <= found.allowed or found.converges_here else self._with_rates(found)

    def _scatter(self) -> float:
        """Return the error of the finest level by envelope and band; infinite for few levels or without an envelope.

        Errors at random phases have an order by chance, so that the band is that of a doubtful ladder.
        """
        envelope, band = self.ladder.envelope, self.ladder.band
        if envelope is None or band is None or len(self.runs) < uncertainty.UNLIKE_LEVELS:
            return np.inf
        return max(envelope, band * uncertainty.CAUTIOUS / uncertainty.SAFE if self.ladder.asymptotic else band)

    def _coprime(self) -> coprime_steps.CoprimeLimit | None:
        """Return the limit of the motions at coprime steps; None where one is missing, at another softness too."""
        method, judged, size, reference = self.runs[0].method, slice(self.judged), self.scales.size, self.reference
        assert method is not None
        sets = 2 if method.softness is not None or method.soft_at_rest else 1
        enough = all(len(run.answer.time) >= len(reference.time) for run in self.coprime)
        if len(self.coprime) != sets * coprime_steps.COUNT or not enough or self.judged < 1:
            return None
        answers = [first_samples(run.answer, len(reference.time)) for run in self.coprime]
        off = np.array([displacements(reference, answer, size)[:, judged].ravel() for answer in answers])
        steps = [run.step or 0.0 for run in self.coprime[: coprime_steps.COUNT]]
        largest = max(saturation(answer, reference, size, judged) for answer in answers)
        allowed = 10.0**-self.reference_motion.digits + float(self.reference_motion.spread[self.judged - 1])
        return coprime_steps.coprime_limit(np.split(off, sets), steps, allowed, largest)

    def _with_rates(self, found: Evidence) -> Evidence:
        """Add the rates that the finest step has to resolve; zero for tolerances."""
        if not (step := self._native_step) or self.judged < 1:
            return found
        answer, mechanism = self.reference, self.mechanism
        rate = max(self.reference_motion.fastest_rate(mechanism, n) for n in kept_samples(self.judged, RATE_SAMPLES))
        turning = turning_rate(mechanism, sampled_motion(answer), answer.time)
        return replace(found, step=step, rate=rate, turning=turning)

    def _cut(self) -> str:
        """Say why the ladder ended before its last level, and which step it would need."""
        run, step = self.runs[-1], self.steps[-1]
        if run.method is None or uncertainty.declared_order(run.method) is None:
            return ""
        if not step or len(self.runs) >= uncertainty.MOST_LEVELS or uncertainty.affordable(run.cpu):
            return ""
        return f"; the next level, at {step / 2.0:.2g} s, would take {2.0 * run.cpu:.1f} s of CPU time"

    def _velocities(self) -> float:
        """Return the difference of the velocities of the finest level, or of the limit at order one if smaller."""
        candidates, steps = [self.answers[-1]], self.steps[-2:]
        if len(steps) == 2 and steps[0] and steps[1] and steps[0] > steps[1]:
            candidates.append(extrapolated(self.answers[-2], self.answers[-1], steps[1] / (steps[0] - steps[1])))

        near = 2.0 * (self.steps[-1] or 0.0)  # a velocity jumps at an impact, which a level has a step earlier or later
        times = self.reference.time[: self.judged, None]
        smooth = np.all(np.abs(times - self.reference_motion.impacts) > near, axis=1)

        def largest(motion: TrajectoryAnswer) -> float:
            found = [OBSERVABLES[n](motion, self.reference, self.scales) for n in ("velocity", "angular velocity")]
            return max(float(np.max(difference[: self.judged][smooth], initial=0.0)) for difference in found)

        return min(map(largest, candidates))

    def _phase(self, end: float) -> float:
        """Return the largest displacement by impacts up to a time that come up to a step early or late."""
        if not (step := self._native_step):
            return 0.0
        rate = max(self.scales.speed / self.scales.size, self.scales.spin)
        return 2.0 * rate * step * float(np.sum(self.reference_motion.impacts <= end))

    def _jumps(self, end: float) -> float:
        """Return the largest displacement by jumps of the acceleration up to a time that come a step early or late.

        A contact that opens, or a slip that reverses, leaves the speed that its last step had: the displacement grows.
        """
        changes = np.sum(self.reference_motion.mode_changes <= end)
        if not (step := self._native_step) or not changes:
            return 0.0
        over = np.diff(self.reference.time)[:, None, None]
        speeds, spins = (np.diff(v, axis=0) / over for v in (self.reference.v_WB_W, self.reference.w_WB_W))
        rate = max(
            float(np.max(np.abs(speeds), initial=0.0)) / self.scales.size, float(np.max(np.abs(spins), initial=0.0))
        )
        return 2.0 * rate * step * (step * float(changes) + self.reference_motion.since_departures(end))

    def _other_law(self) -> dict[str, Any]:
        """Return the law of contact that the method solves, and the differences of its motion."""
        other = self.reference_motion.other_law
        if other is None:
            return {}
        off = difference_over_time(self.answers[-1], other.answer, self.scales.size)[: self.judged]
        off_hard = 0.0
        if other.cause == COMPLIANCE:
            off_hard = np.inf if other.hard is None else self._off(other.hard)
        found = {"off_law": float(np.max(off, initial=0.0)), "law_apart": self._off(other.answer), "off_hard": off_hard}
        return {"law": other.name, "law_cause": other.cause, **found}

    def _off_soft(self) -> float:
        """Return the difference of the finest level, or of the limit of the steps, to the motion with soft contacts."""
        soft, limit = self.reference_motion.soft, self.declared_limit
        if soft is None:
            return np.inf
        motions = [self.answers[-1], *([] if limit is None else [limit])]
        off = [difference_over_time(motion, soft, self.scales.size)[: self.judged] for motion in motions]
        return min(float(np.max(one, initial=0.0)) for one in off)

    def _dependence(self) -> tuple[softness.Softness | None, float]:
        """Return the dependence on softness, and the difference of the limit without softness and steps.

        None and infinity without runs of the finest level at other softness; infinity without asymptotic levels.
        """
        answers = [self.answers[-1], *self.soft_answers]
        if len(answers) < 3 or self.judged < 2:
            return None, np.inf
        found = [run.method.softness or 1.0 for run in self.softer if run.method is not None]
        soft, limit = softness.of_motions(answers, found, self.reference, self.scales, slice(self.judged))
        declared = self.ladder.declared
        if declared is None or not self.ladder.asymptotic:
            return soft, np.inf
        weight = 1.0 / (uncertainty.ratio_of(self.steps) ** declared - 1.0)
        return soft, self._off(extrapolated(self.answers[-2], self.answers[-1], weight, limit))

    def shown(self, samples: Sequence[int]) -> tuple[Level, ...]:
        """Return the levels as the record shows them, with differences and energies at some samples."""
        few, judged = kept_samples(len(self.reference.time), RESIDUAL_SAMPLES), slice(max(self.judged, 1))
        return tuple(
            Level(
                step=run.step or 0.0,
                cpu=run.cpu,
                largest=float(np.max(error[judged])),
                rms=uncertainty.rms(error[judged]),
                difference=tuple(float(x) for x in error[samples]),
                energy=tuple(float(x) for x in energy_over_time(self.mechanism, run.answer, samples)),
                residual=largest_residual(self.mechanism, run.answer, few),
                counters=run.answer.counters,
            )
            for run, error in zip(self.runs, self.errors, strict=True)
        )


def _spread(changes: Sequence[float]) -> float:
    """Return the largest of the last two changes after a third, or of changes that are rounding; infinity otherwise."""
    if max(changes) <= uncertainty.ROUNDING:
        return max(changes)
    return max(changes[-2:]) if len(changes) > 2 else np.inf
