"""Errors in what an engine says: answers read from the wrong place, in the wrong axes, at the wrong time.

The magnitude is the fraction of the whole error where nothing else is said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from consilience.audit.mutate.inputs import moved
from consilience.audit.mutate.mutated import InstantChange, InstantRequest, MethodChange
from consilience.engine import InstantAnswer, Method, ModelAnswer, Question, TrajectoryAnswer
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Array,
    Frame,
    Joint,
    Mechanism,
    determinate_reactions,
    joint_frames,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_from_quaternion,
)

# ---------------------------------------------------------------- accelerations


def _velocities(asked: InstantRequest) -> tuple[Array, Array]:
    return np.array([s.v_WB_W for s in asked.states]), np.array([s.w_WB_W for s in asked.states])


def acceleration_spatial(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Linear part of the spatial acceleration, ``a - w x v``, where the classical one belongs."""
    v, w = _velocities(asked)
    return replace(answer, a_WB_W=answer.a_WB_W - magnitude * np.cross(w, v))


def acceleration_of_centre(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Accelerations of the centres of mass and not of the origins."""
    R = np.array([rotation_from_quaternion(s.quat_WB) for s in asked.states])
    c = np.einsum("sbij,bj->sbi", R, np.array([b.com for b in asked.mechanism.bodies]))
    w = _velocities(asked)[1]
    extra = np.cross(answer.alpha_WB_W, c) + np.cross(w, np.cross(w, c))
    return replace(answer, a_WB_W=answer.a_WB_W + magnitude * extra)


def answer_of_step_end(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Accelerations and reactions that belong to the end of a step of `magnitude` seconds, energies to its start."""
    later = []
    for n, state in enumerate(asked.states):
        on = moved(state, magnitude)
        v = state.v_WB_W + magnitude * answer.a_WB_W[n]
        later.append(replace(on, v_WB_W=v, w_WB_W=state.w_WB_W + magnitude * answer.alpha_WB_W[n]))
    end = asked.engine.instant(asked.mechanism, later, asked.method)
    return replace(end, kinetic=answer.kinetic, potential=answer.potential)


def constraints_half_ignored(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """A fraction of the accelerations without any joint: bodies that fall, each on its own."""
    free = _falling(asked)
    a = answer.a_WB_W + magnitude * (free.a_WB_W - answer.a_WB_W)
    alpha = answer.alpha_WB_W + magnitude * (free.alpha_WB_W - answer.alpha_WB_W)
    return replace(answer, a_WB_W=a, alpha_WB_W=alpha)


def _falling(asked: InstantRequest) -> InstantAnswer:
    m = asked.mechanism
    at = Frame(np.zeros(3), np.eye(3))
    joints = tuple(Joint(f"free {b.name}", "free", GROUND, b.name, at, at) for b in m.bodies)
    alone = replace(m, joints=joints, springs=(), joint_springs=(), loads=())
    return asked.engine.instant(alone, asked.states, asked.engine.methods(alone, Question.INSTANT)[0])


# ---------------------------------------------------------------- reactions


def _holding(mechanism: Mechanism) -> int:
    """First joint that holds anything."""
    return next(k for k, joint in enumerate(mechanism.joints) if JOINT_KINDS[joint.kind].rows)


def _of_reactions(change: Callable[[InstantRequest, Array, Array, float], tuple[Array, Array]]) -> InstantChange:
    """Change forces and torques of an answer; a method that gives none cannot give wrong ones."""

    def of_answer(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
        if answer.force_F is None or answer.torque_F is None:
            return answer
        force, torque = change(asked, answer.force_F.copy(), answer.torque_F.copy(), magnitude)
        return replace(answer, force_F=force, torque_F=torque)

    return of_answer


def _sign(asked: InstantRequest, force: Array, torque: Array, magnitude: float) -> tuple[Array, Array]:
    """The reaction of one joint turned towards the one on its predecessor: at 1 it is that, at 0.5 nothing."""
    k = _holding(asked.mechanism)
    force[:, k] *= 1.0 - 2.0 * magnitude
    torque[:, k] *= 1.0 - 2.0 * magnitude
    return force, torque


def _cleared(asked: InstantRequest, force: Array, torque: Array, magnitude: float) -> tuple[Array, Array]:
    """A fraction of the reactions is lost after the first state, as where an engine clears its forces."""
    kept = np.where(np.arange(len(asked.states)) > 0, 1.0 - magnitude, 1.0)[:, None, None]
    return kept * force, kept * torque


def _in_world(asked: InstantRequest, force: Array, torque: Array, magnitude: float) -> tuple[Array, Array]:
    """Components in world axes and not in those of F."""
    U = np.array([[joint_frames(asked.mechanism, s, j).U for j in asked.mechanism.joints] for s in asked.states])
    both = (x + magnitude * (np.einsum("sjab,sjb->sja", U, x) - x) for x in (force, torque))
    return next(both), next(both)


def _about_centre(asked: InstantRequest, force: Array, torque: Array, magnitude: float) -> tuple[Array, Array]:
    """Torques about the successor's centre of mass and not about M."""
    m = asked.mechanism
    for n, state in enumerate(asked.states):
        for k, joint in enumerate(m.joints):
            i = m.body_index[joint.successor]
            if i >= 0:
                arm = rotation_from_quaternion(state.quat_WB[i]) @ (joint.M.p - m.bodies[i].com)
                torque[n, k] += magnitude * np.cross(joint_frames(m, state, joint).U.T @ arm, force[n, k])
    return force, torque


def _undetermined(asked: InstantRequest, force: Array, torque: Array, magnitude: float) -> tuple[Array, Array]:
    """Other values where equilibrium leaves reactions open: another solution of the same equations, and no error."""
    both = np.concatenate([force, torque], axis=2)
    for n, state in enumerate(asked.states):
        both[n][~determinate_reactions(asked.mechanism, state)] += magnitude
    return both[:, :, :3], both[:, :, 3:]


reaction_sign = _of_reactions(_sign)
reactions_cleared = _of_reactions(_cleared)
reactions_in_world = _of_reactions(_in_world)
reactions_about_centre = _of_reactions(_about_centre)
undetermined_reactions = _of_reactions(_undetermined)


# ---------------------------------------------------------------- loads, forms, models


def loads_cleared(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Loads are there at the first state only, as where an engine clears its external forces after a step."""
    weaker = tuple(replace(load, vector=(1.0 - magnitude) * load.vector) for load in asked.mechanism.loads)
    later = asked.engine.instant(replace(asked.mechanism, loads=weaker), asked.states, asked.method)
    mixed = {
        name: np.concatenate([first[:1], getattr(later, name)[1:]])
        for name, first in vars(answer).items()
        if first is not None
    }
    return replace(answer, **mixed)


def name_gone(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """A name of the engine's interface that its next version no longer has."""
    del answer, magnitude
    gone: InstantAnswer = asked.engine.accelerations_of_old  # type: ignore[attr-defined]
    return gone


def array_transposed(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """An array that the next version of the engine gives the other way round."""
    del asked, magnitude
    return replace(answer, a_WB_W=np.swapaxes(answer.a_WB_W, 1, 2))


def freedom_off(answer: ModelAnswer, magnitude: float) -> ModelAnswer:
    """Degrees of freedom counted without looking at dependent rows: off by a whole number."""
    return replace(answer, freedom=answer.freedom + round(magnitude))


def order_declared(order: int) -> MethodChange:
    """Methods of a fixed step that declare another order than they have."""

    def declare(method: Method, magnitude: float) -> Method:
        del magnitude
        return replace(method, order=order) if method.substeps else method

    return declare


# ---------------------------------------------------------------- motions


def motion_late(mechanism: Mechanism, answer: TrajectoryAnswer, magnitude: float) -> TrajectoryAnswer:
    """Poses of `magnitude` seconds earlier, velocities of now: a state read before it was brought up to date."""
    del mechanism
    p = answer.p_WB - magnitude * answer.v_WB_W
    steps = -magnitude * answer.w_WB_W.reshape(-1, 3)
    turned = [
        quaternion_product(quaternion_from_rotation_vector(step), q)
        for step, q in zip(steps, answer.quat_WB.reshape(-1, 4), strict=True)
    ]
    quat = np.array(turned).reshape(answer.quat_WB.shape)
    return replace(answer, p_WB=p, quat_WB=quat / np.linalg.norm(quat, axis=-1, keepdims=True))


def motion_conjugate(mechanism: Mechanism, answer: TrajectoryAnswer, magnitude: float) -> TrajectoryAnswer:
    """``R_BW`` where ``R_WB`` belongs."""
    del mechanism, magnitude
    return replace(answer, quat_WB=answer.quat_WB * [1.0, -1.0, -1.0, -1.0])


def motion_other_sign(mechanism: Mechanism, answer: TrajectoryAnswer, magnitude: float) -> TrajectoryAnswer:
    """Quaternions of the other sign, which are the same rotations: no error."""
    del mechanism, magnitude
    return replace(answer, quat_WB=-answer.quat_WB)


def motion_velocities_in_body(mechanism: Mechanism, answer: TrajectoryAnswer, magnitude: float) -> TrajectoryAnswer:
    """Velocities in axes of the bodies, poses as they are."""
    del mechanism
    R = rotation_from_quaternion(answer.quat_WB)
    v, w = (np.einsum("tbji,tbj->tbi", R, x) for x in (answer.v_WB_W, answer.w_WB_W))
    return replace(
        answer,
        v_WB_W=answer.v_WB_W + magnitude * (v - answer.v_WB_W),
        w_WB_W=answer.w_WB_W + magnitude * (w - answer.w_WB_W),
    )
