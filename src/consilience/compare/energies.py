"""Energies of a motion at many samples at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    joint_spring_motion,
    kinetic_energies,
    load_potentials,
    potential_energies,
    rotation_from_quaternion,
    with_full_turns,
)
from consilience.mechanism.observables import SampledMotion


def energies_over_time(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Sequence[int]) -> tuple[Array, Array]:
    """Return kinetic energy, and potential energy of gravity, springs and constant forces, each (n_samples,), in J."""
    kept = list(samples)
    p, v, w = answer.p_WB[kept], answer.v_WB_W[kept], answer.w_WB_W[kept]
    quat = answer.quat_WB[kept] / np.linalg.norm(answer.quat_WB[kept], axis=-1, keepdims=True)
    motion = SampledMotion(p, rotation_from_quaternion(quat), v, w)
    q = turned_springs(mechanism, answer)[:, kept]
    potential = potential_energies(mechanism, motion, q) + load_potentials(mechanism, motion)
    return kinetic_energies(mechanism, motion), potential


def turned_springs(mechanism: Mechanism, answer: TrajectoryAnswer) -> Array:
    """Return the coordinates of all joint springs at all samples, shape (n_joint_springs, n_t), with full turns."""
    if not mechanism.joint_springs:
        return np.zeros((0, len(answer.time)))
    quat = answer.quat_WB / np.linalg.norm(answer.quat_WB, axis=-1, keepdims=True)
    samples = zip(answer.p_WB, quat, answer.v_WB_W, answer.w_WB_W, strict=True)
    of_springs = [(spring.joint, spring.coordinate) for spring in mechanism.joint_springs]
    states = [State(*sample) for sample in samples]
    found = np.array([[joint_spring_motion(mechanism, state, *one) for state in states] for one in of_springs])
    q, rates = found[..., 0], found[..., 1]
    pitches = {joint.name: joint.pitch for joint in mechanism.joints}
    turning = [c.startswith("angle") and not pitches[joint] for joint, c in of_springs]
    q[turning] = with_full_turns(q[turning], rates[turning], answer.time)
    return q
