"""Kinetic and potential energy along a motion, for all samples at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import GROUND, Array, Mechanism, State, joint_spring_motion, rotation_from_quaternion


class _Samples:
    """Poses and velocities of all bodies at selected samples of a motion."""

    def __init__(self, mechanism: Mechanism, answer: TrajectoryAnswer, samples: Sequence[int]) -> None:
        kept = list(samples)
        quat = answer.quat_WB[kept]
        self.mechanism = mechanism
        self.p, self.v, self.w = answer.p_WB[kept], answer.v_WB_W[kept], answer.w_WB_W[kept]
        self.quat = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
        self.R = rotation_from_quaternion(self.quat)

    def point(self, body: str, point: Array) -> Array:
        """Return the world positions of a body-fixed point, shape (n_t, 3)."""
        if body == GROUND:
            return np.broadcast_to(point, (len(self.p), 3))
        b = self.mechanism.body_index[body]
        return np.asarray(self.p[:, b] + self.R[:, b] @ point)

    def state(self, n: int) -> State:
        """Return the state at a sample."""
        return State(self.p[n], self.quat[n], self.v[n], self.w[n])


def _kinetic(s: _Samples, arms: Array) -> Array:
    bodies = s.mechanism.bodies
    masses, inertias = np.array([b.mass for b in bodies]), np.array([b.inertia for b in bodies])
    v = s.v + np.cross(s.w, arms)
    w = np.einsum("tbji,tbj->tbi", s.R, s.w)  # body axes
    return np.asarray(0.5 * (np.sum(v * v, axis=2) @ masses + np.einsum("tbi,bij,tbj->t", w, inertias, w)))


def _elastic(s: _Samples) -> Array:
    energy = np.zeros(len(s.p))
    for spring in s.mechanism.springs:
        d = s.point(spring.successor, spring.point_successor) - s.point(spring.predecessor, spring.point_predecessor)
        energy += 0.5 * spring.stiffness * (np.linalg.norm(d, axis=1) - spring.free_length) ** 2
    for x in s.mechanism.joint_springs:
        of_joint = x.joint, x.coordinate
        q = np.array([joint_spring_motion(s.mechanism, s.state(n), *of_joint)[0] for n in range(len(s.p))])
        energy += 0.5 * x.stiffness * (q - x.rest) ** 2
    return energy


def _of_loads(s: _Samples) -> Array:
    energy = np.zeros(len(s.p))
    for load in s.mechanism.loads:
        if load.kind == "force" and load.frame == "world":
            energy -= s.point(load.body, load.point) @ load.vector
    return energy


def energies_over_time(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Sequence[int]) -> tuple[Array, Array]:
    """Return kinetic energy, and potential energy of gravity, springs and constant forces, shape (n_samples,), J.

    Angles of joint springs lie in (-pi, pi].
    """
    s = _Samples(mechanism, answer, samples)
    masses = np.array([b.mass for b in mechanism.bodies])
    arms = np.einsum("tbij,bj->tbi", s.R, np.array([b.com for b in mechanism.bodies]))
    weight = -np.einsum("b,tbi,i->t", masses, s.p + arms, mechanism.gravity)
    return _kinetic(s, arms), weight + _elastic(s) + _of_loads(s)
