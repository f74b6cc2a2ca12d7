"""Difference of two motions over time, and observables of one motion: energy, violation of joints.

The difference of two motions at a time is the largest value over the bodies of the distance of the origins divided by
the size of the motion, and of the angle between the orientations in rad. Each observable of `OBSERVABLES` has a
difference of its own; velocities are relative to the largest velocity, energies to the largest kinetic energy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from consilience.compare.energies import energies_over_time
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    characteristic_length,
    constraint_residual,
    count_turns,
    quaternion_product,
    rotation_angle_between,
    rotation_from_quaternion,
)
from consilience.mechanism.observables import SampledMotion

KEPT_SAMPLES = 101
"""Number of samples of a plot, and of observables that are costly."""

TINY = float(np.finfo(float).tiny)


def size_of_motion(mechanism: Mechanism, answer: TrajectoryAnswer) -> float:
    """Return the widest travel of a body along an axis, m, but at least the characteristic length of a body.

    The characteristic length matters where origins hardly move, as on a fixed axis, and their travel is rounding.
    """
    return max(float(np.max(np.ptp(answer.p_WB, axis=0))), characteristic_length(mechanism))


def displacements(a: TrajectoryAnswer, b: TrajectoryAnswer, size: float) -> Array:
    """Return displacements of the bodies from one motion to another: of origins over size, and of orientations.

    Parameters
    ----------
    a, b : TrajectoryAnswer
    size : float, m

    Returns
    -------
    ndarray, shape (2, n_t, n_b, 3)
        World axes; of an orientation the axis times twice the sine of half the angle.
    """
    turn = quaternion_product(b.quat_WB, a.quat_WB * np.array([1.0, -1.0, -1.0, -1.0]))
    return np.stack([(b.p_WB - a.p_WB) / size, np.copysign(2.0, turn[..., :1]) * turn[..., 1:]])


def difference_over_time(a: TrajectoryAnswer, b: TrajectoryAnswer, size: float) -> Array:
    """Return the difference of two motions at each sample, shape (n_t,), dimensionless or rad."""
    distance = np.max(np.linalg.norm(a.p_WB - b.p_WB, axis=2), axis=1) / size
    angle = np.max(rotation_angle_between(a.quat_WB, b.quat_WB), axis=1)
    return np.maximum(distance, angle)


def saturation(a: TrajectoryAnswer, b: TrajectoryAnswer, size: float, judged: slice) -> float:
    """Return the largest difference of two motions as a share of the most by which motions differ.

    Orientations differ by no more than pi, and positions in the region of the motion by no more than its size.
    """
    distance = np.linalg.norm(a.p_WB - b.p_WB, axis=2)[judged] / size
    angle = rotation_angle_between(a.quat_WB, b.quat_WB)[judged] / np.pi
    return float(max(np.max(distance, initial=0.0), np.max(angle, initial=0.0)))


@dataclass(frozen=True)
class Scales:
    """Divisors of the differences of observables, from the reference motion.

    Attributes
    ----------
    size : float, m
    speed : float, m/s
    spin : float, rad/s
    """

    size: float
    speed: float
    spin: float

    @classmethod
    def of(cls, mechanism: Mechanism, reference: TrajectoryAnswer) -> Scales:
        """Return the scales of a motion; a speed is at least the size of the motion divided by its duration."""
        size = size_of_motion(mechanism, reference)
        time = max(float(np.ptp(reference.time)), TINY)
        return cls(
            size,
            max(float(np.max(np.linalg.norm(reference.v_WB_W, axis=2))), size / time),
            max(float(np.max(np.linalg.norm(reference.w_WB_W, axis=2))), 1.0 / time),
        )


Observable = Callable[[TrajectoryAnswer, TrajectoryAnswer, Scales], Array]


def _largest_norm(difference: Array, scale: float) -> Array:
    return np.max(np.linalg.norm(difference, axis=2), axis=1) / scale


OBSERVABLES: dict[str, Observable] = {
    "position": lambda a, b, s: _largest_norm(a.p_WB - b.p_WB, s.size),
    "orientation": lambda a, b, _: np.max(rotation_angle_between(a.quat_WB, b.quat_WB), axis=1),
    "velocity": lambda a, b, s: _largest_norm(a.v_WB_W - b.v_WB_W, s.speed),
    "angular velocity": lambda a, b, s: _largest_norm(a.w_WB_W - b.w_WB_W, s.spin),
}
"""Difference of two motions at each sample, shape (n_t,), by observable."""


def _align(quat: Array, like: Array) -> Array:
    """Return quaternions with the signs of `like`, so that linear combinations are meaningful."""
    return quat * np.where(np.sum(quat * like, axis=-1, keepdims=True) < 0, -1.0, 1.0)


def extrapolated(
    coarse: TrajectoryAnswer, fine: TrajectoryAnswer, weight: float, onto: TrajectoryAnswer | None = None
) -> TrajectoryAnswer:
    """Return ``onto + weight (fine - coarse)``, with unit quaternions; `onto` is `fine` by default."""
    onto = fine if onto is None else onto
    quats = (_align(motion.quat_WB, onto.quat_WB) for motion in (fine, coarse))
    quat = onto.quat_WB + weight * np.subtract(*quats)
    return TrajectoryAnswer(
        fine.time,
        onto.p_WB + weight * (fine.p_WB - coarse.p_WB),
        quat / np.linalg.norm(quat, axis=-1, keepdims=True),
        onto.v_WB_W + weight * (fine.v_WB_W - coarse.v_WB_W),
        onto.w_WB_W + weight * (fine.w_WB_W - coarse.w_WB_W),
    )


def energy_over_time(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Sequence[int]) -> Array:
    """Return the change of the total energy since the start, relative to the largest kinetic energy."""
    kinetic, potential = energies_over_time(mechanism, answer, samples)
    total = kinetic + potential
    return np.asarray((total - total[0]) / max(float(np.max(kinetic)), TINY))


def state_at(answer: TrajectoryAnswer, n: int) -> State:
    """Return the state at a sample, with unit quaternions."""
    quat = answer.quat_WB[n] / np.linalg.norm(answer.quat_WB[n], axis=-1, keepdims=True)
    return State(answer.p_WB[n], quat, answer.v_WB_W[n], answer.w_WB_W[n])


def sampled_motion(answer: TrajectoryAnswer) -> SampledMotion:
    """Return the poses and velocities of all samples."""
    quat = answer.quat_WB / np.linalg.norm(answer.quat_WB, axis=-1, keepdims=True)
    return SampledMotion(answer.p_WB, rotation_from_quaternion(quat), answer.v_WB_W, answer.w_WB_W)


def largest_residual(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Sequence[int]) -> float:
    """Return the largest violation of a joint at the samples, m or dimensionless."""
    largest, angles, kept = 0.0, dict[str, float](), set(samples)
    for n in range(len(answer.time)) if mechanism.couplings else samples:
        state = state_at(answer, n)
        angles = count_turns(mechanism, state, angles)
        if n in kept:
            residual = constraint_residual(mechanism, state, float(answer.time[n]), angles)
            largest = max(largest, float(np.max(np.abs(residual), initial=0.0)))
    return largest


def kept_samples(count: int, most: int = KEPT_SAMPLES) -> list[int]:
    """Return evenly spread indices of samples, the first and the last included."""
    return sorted({int(n) for n in np.linspace(0, count - 1, min(count, most))})
