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
    """Return kinetic energy, and potential energy of gravity, springs and constant forces, each (n_samples,), in J.

    Angles of joint springs are in (-pi, pi].
    """
    kept = list(samples)
    p, v, w = answer.p_WB[kept], answer.v_WB_W[kept], answer.w_WB_W[kept]
    quat = answer.quat_WB[kept] / np.linalg.norm(answer.quat_WB[kept], axis=-1, keepdims=True)
    motion = SampledMotion(p, rotation_from_quaternion(quat), v, w)
    q = np.zeros((0, len(kept)))
    if mechanism.joint_springs:
        states = [State(*of_state) for of_state in zip(p, quat, v, w, strict=True)]
        q = np.array([joint_spring_coordinates(mechanism, state) for state in states]).T
    potential = potential_energies(mechanism, motion, q) + load_potentials(mechanism, motion)
    return kinetic_energies(mechanism, motion), potential
