"""Energies of a motion at many samples at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    joint_spring_coordinates,
    kinetic_energies,
    load_potentials,
    potential_energies,
    rotation_from_quaternion,
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
    """Return the coordinates of all joint springs at all samples, shape (n_joint_springs, n_t).

    Full turns are counted from the first sample on, as long as none is hidden between two samples.
    """
    if not mechanism.joint_springs:
        return np.zeros((0, len(answer.time)))
    quat = answer.quat_WB / np.linalg.norm(answer.quat_WB, axis=-1, keepdims=True)
    samples = zip(answer.p_WB, quat, answer.v_WB_W, answer.w_WB_W, strict=True)
    q = np.array([joint_spring_coordinates(mechanism, State(*sample)) for sample in samples]).T
    angular = [spring.coordinate == "angle" for spring in mechanism.joint_springs]
    q[angular] = np.unwrap(q[angular])
    return q
