"""`trajectory`: differences to the reference over time, observed order, Richardson limit and verdict.

The difference of two motions at a time is the largest, over the bodies, of the distance of the origins divided by the
size of the motion and of the angle between the orientations in rad. From levels h, h/2, h/4 (step sizes):

- observed order ``p = log2(rms_2 / rms_3)`` of the differences to the reference on the two finest levels that rounding
  does not hide, and ``log2(|x1 - x2| / |x2 - x3|)`` among the levels themselves;
- limit ``x = x3 + (x3 - x2) / (2^P - 1)`` with the declared order P [Richardson 1911];
- band ``u = F |x3 - x2| / (2^P - 1)``, F = 1.25 where the order is within 0.5 of the declared one, 3 elsewhere: the
  grid convergence index [Roache 1994], read as in ASME V&V 20.

Whether the levels are asymptotic is judged by the order among themselves (by the other one only where there are two
levels or rounding hides it): a plateau, levels that converge cleanly to something else, spoils the order against the
reference and must not pass for steps that are too coarse.

Rules, in this order:

=========================================================================  =======================
the spread of the reference is above 10^-digits                             unresolved
the finest level differs by no more than 10^-digits plus the spread         agrees
the limit differs by no more than the band plus the spread, order as said   differs: discretisation
the order is more than 0.5 off: not yet asymptotic                          unresolved
anything else                                                               differs: model
=========================================================================  =======================

The spread is that of the reference over its formulations and tolerances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from consilience.compare.result import Comparison, Level, Verdict, digits_of
from consilience.kinematics import constraint_residual, count_turns
from consilience.mechanism import Mechanism, State
from consilience.observe import kinetic_energy, load_potential, potential_energy, reach
from consilience.run import Method, Question, Run, TrajectoryAnswer
from consilience.spatial import Array, rotation_angle_between

ORDER_WINDOW = 0.5
ROUNDING = 1e-11
"""Differences below this are made of rounding, not of steps: no order can be read from them."""
KEPT_SAMPLES = 101
RESIDUAL_SAMPLES = 21


def size_of_motion(mechanism: Mechanism, answer: TrajectoryAnswer) -> float:
    """Largest distance between two positions of any one body along any axis, m; at least the reach of a body.

    The reach matters where origins hardly move, as on a fixed axis: their rounding is no motion to compare with.
    """
    return max(float(np.max(np.ptp(answer.p_WB, axis=0))), reach(mechanism))


def difference_over_time(a: TrajectoryAnswer, b: TrajectoryAnswer, size: float) -> Array:
    """Difference of two motions at every sample, shape (n_t,), dimensionless or rad."""
    distance = np.max(np.linalg.norm(a.p_WB - b.p_WB, axis=2), axis=1) / size
    angle = np.max(rotation_angle_between(a.quat_WB, b.quat_WB), axis=1)
    return np.maximum(distance, angle)


def _align(quat: Array, like: Array) -> Array:
    """Quaternions with the signs of `like`, so that they can be combined linearly."""
    return quat * np.where(np.sum(quat * like, axis=-1, keepdims=True) < 0, -1.0, 1.0)


def richardson(coarse: TrajectoryAnswer, fine: TrajectoryAnswer, order: int) -> TrajectoryAnswer:
    """Limit of two levels whose steps have the ratio two; quaternions are brought back to unit length."""
    weight = 1.0 / (2.0**order - 1.0)
    quat = fine.quat_WB + weight * (fine.quat_WB - _align(coarse.quat_WB, fine.quat_WB))
    return TrajectoryAnswer(
        fine.time,
        fine.p_WB + weight * (fine.p_WB - coarse.p_WB),
        quat / np.linalg.norm(quat, axis=-1, keepdims=True),
        fine.v_WB_W + weight * (fine.v_WB_W - coarse.v_WB_W),
        fine.w_WB_W + weight * (fine.w_WB_W - coarse.w_WB_W),
    )


def energy_over_time(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Sequence[int]) -> Array:
    """Change of the total energy since the start over the largest kinetic energy, recomputed from the motion."""
    kinetic, total = [], []
    for n in samples:
        quat = answer.quat_WB[n] / np.linalg.norm(answer.quat_WB[n], axis=-1, keepdims=True)
        state = State(answer.p_WB[n], quat, answer.v_WB_W[n], answer.w_WB_W[n])
        kinetic.append(kinetic_energy(mechanism, state))
        total.append(kinetic[-1] + potential_energy(mechanism, state) + load_potential(mechanism, state))
    return (np.array(total) - total[0]) / max(*kinetic, np.finfo(float).tiny)


def _largest_residual(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Sequence[int]) -> float:
    largest, angles, kept = 0.0, dict[str, float](), set(samples)
    for n in range(len(answer.time)) if mechanism.couplings else samples:
        quat = answer.quat_WB[n] / np.linalg.norm(answer.quat_WB[n], axis=-1, keepdims=True)
        state = State(answer.p_WB[n], quat, answer.v_WB_W[n], answer.w_WB_W[n])
        angles = count_turns(mechanism, state, angles)
        if n in kept:
            residual = constraint_residual(mechanism, state, float(answer.time[n]), angles)
            largest = max(largest, float(np.max(np.abs(residual), initial=0.0)))
    return largest


def kept_samples(count: int, most: int = KEPT_SAMPLES) -> list[int]:
    """Evenly spread sample indices for plots and for the costlier observers, first and last included."""
    return sorted({int(n) for n in np.linspace(0, count - 1, min(count, most))})


def reference_spread(mechanism: Mechanism, answers: Sequence[TrajectoryAnswer]) -> float:
    """Largest difference of the reference's other answers to its first one."""
    size = size_of_motion(mechanism, answers[0])
    return max((float(np.max(difference_over_time(a, answers[0], size))) for a in answers[1:]), default=0.0)


@dataclass(frozen=True)
class _Convergence:
    order: float | None
    self_order: float | None
    band: float
    limit: float

    @property
    def settled(self) -> float | None:
        """Order that says whether the levels are asymptotic: among themselves, so that a plateau does not hide it."""
        return self.order if self.self_order is None else self.self_order

    def asymptotic(self, declared: int) -> bool:
        return self.settled is not None and abs(self.settled - declared) <= ORDER_WINDOW


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _log2_ratio(coarse: float, fine: float) -> float | None:
    """Observed order, or None where rounding hides it."""
    return float(np.log2(coarse / fine)) if coarse > 2 * ROUNDING and fine > ROUNDING else None


def _finest_order(errors: Sequence[float]) -> float | None:
    """Observed order from the finest pair of levels that rounding does not hide."""
    orders = (_log2_ratio(coarse, fine) for coarse, fine in reversed(list(pairwise(errors))))
    return next((order for order in orders if order is not None), None)


def _convergence(
    answers: Sequence[TrajectoryAnswer],
    differences: Sequence[Array],
    reference: TrajectoryAnswer,
    size: float,
    order: int,
) -> _Convergence:
    observed = _finest_order([_rms(d) for d in differences])
    steps = [difference_over_time(a, b, size) for a, b in pairwise(answers)]
    among = _finest_order([_rms(s) for s in steps])
    limit = richardson(answers[-2], answers[-1], order)
    found = _Convergence(observed, among, 0.0, float(np.max(difference_over_time(limit, reference, size))))
    factor = 1.25 if found.asymptotic(order) else 3.0
    return replace(found, band=factor * float(np.max(steps[-1])) / (2.0**order - 1.0))


def compare_trajectory(
    mechanism: Mechanism, runs: Sequence[Run], reference: TrajectoryAnswer, spread: float, digits: int
) -> Comparison:
    """Judge the levels of one method, coarse to fine.

    Parameters
    ----------
    runs : sequence of Run
        All answered, of one case, engine and method.
    spread : float
        Uncertainty of the reference, see `reference_spread`.
    digits : int
        Digits the case asks.
    """
    answers = [run.answer for run in runs if isinstance(run.answer, TrajectoryAnswer)]
    method = runs[0].method
    assert method is not None
    assert len(answers) == len(runs)
    size = size_of_motion(mechanism, reference)
    differences = [difference_over_time(a, reference, size) for a in answers]
    samples = kept_samples(len(reference.time))
    few = kept_samples(len(reference.time), RESIDUAL_SAMPLES)
    levels = tuple(
        Level(
            step=run.step or 0.0,
            cpu=run.cpu,
            largest=float(np.max(d)),
            rms=_rms(d),
            difference=tuple(float(x) for x in d[samples]),
            energy=tuple(float(x) for x in energy_over_time(mechanism, answer, samples)),
            residual=_largest_residual(mechanism, answer, few),
            counters=answer.counters,
        )
        for run, answer, d in zip(runs, answers, differences, strict=True)
    )
    finest = levels[-1].largest
    convergence = None
    if method.order is not None and len(levels) > 1:
        convergence = _convergence(answers, differences, reference, size, method.order)
    verdict, why = _judge(method, finest, convergence, 10.0**-digits, spread)
    return Comparison(
        case=runs[0].case,
        engine=runs[0].engine,
        question=Question.TRAJECTORY,
        method=method.name,
        route=method.route,
        verdict=verdict,
        why=why,
        digits=digits_of(finest),
        limit_digits=digits_of(convergence.limit) if convergence else None,
        declared_order=method.order,
        order=convergence.order if convergence else None,
        self_order=convergence.self_order if convergence else None,
        band=convergence.band if convergence else None,
        reference_spread=spread,
        times=tuple(float(t) for t in reference.time[samples]),
        levels=levels,
    )


def _judge(
    method: Method, finest: float, convergence: _Convergence | None, asked: float, spread: float
) -> tuple[Verdict, str]:
    """Apply the rules of the module's table."""
    if not spread <= asked:
        return Verdict.UNRESOLVED, f"the reference itself is only certain to {spread:.2g}, asked {asked:.0e}"
    if finest <= asked + spread:
        return Verdict.AGREES, f"the finest level differs by {finest:.2g}, asked {asked:.0e}"
    if convergence is None or method.order is None:
        return Verdict.MODEL, f"the finest level differs by {finest:.2g}, asked {asked:.0e}; no order to read"
    order = "hidden by rounding" if convergence.settled is None else f"{convergence.settled:.2f}"
    if not convergence.asymptotic(method.order):
        return Verdict.UNRESOLVED, f"observed order {order}, declared {method.order}: not asymptotic at these steps"
    text = f"the limit differs by {convergence.limit:.2g}, band {convergence.band:.2g}, order {order}"
    if convergence.limit <= convergence.band + spread:
        return Verdict.DISCRETISATION, f"{text}: smaller steps lead to the reference"
    return Verdict.MODEL, f"{text}: smaller steps lead elsewhere"
