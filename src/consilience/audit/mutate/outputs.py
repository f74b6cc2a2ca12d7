"""Errors in the answers of an engine: values from the wrong place, in the wrong axes, at the wrong time.

The magnitude is the fraction of the whole error, unless the docstring says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from consilience.audit.mutate.inputs import blend, moved
from consilience.audit.mutate.mutated import InstantChange, InstantRequest, MethodChange
from consilience.engine import InstantAnswer, Method, ModelAnswer, Question, TrajectoryAnswer
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Array,
    Frame,
    Joint,
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
    """Give the linear part of the spatial acceleration, ``a - w x v``, where the classical acceleration belongs."""
    v, w = _velocities(asked)
    return replace(answer, a_WB_W=answer.a_WB_W - magnitude * np.cross(w, v))


def acceleration_of_centre(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Give accelerations of the centres of mass where those of the origins belong."""
    R = np.array([rotation_from_quaternion(s.quat_WB) for s in asked.states])
    c = np.einsum("sbij,bj->sbi", R, np.array([b.com for b in asked.mechanism.bodies]))
    w = _velocities(asked)[1]
    extra = np.cross(answer.alpha_WB_W, c) + np.cross(w, np.cross(w, c))
    return replace(answer, a_WB_W=answer.a_WB_W + magnitude * extra)


def answer_of_step_end(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Give accelerations and reactions at the end of a step of `magnitude` seconds, with the energies of its start."""
    later = []
    for n, state in enumerate(asked.states):
        on = moved(state, magnitude)
        v = state.v_WB_W + magnitude * answer.a_WB_W[n]
        later.append(replace(on, v_WB_W=v, w_WB_W=state.w_WB_W + magnitude * answer.alpha_WB_W[n]))
    end = asked.engine.instant(asked.mechanism, later, asked.method)
    return replace(end, kinetic=answer.kinetic, potential=answer.potential)


def constraints_half_ignored(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Blend in a fraction of the accelerations of the same bodies without joints, in free fall."""
    m = asked.mechanism
    at = Frame(np.zeros(3), np.eye(3))
    joints = tuple(Joint(f"free {b.name}", "free", GROUND, b.name, at, at) for b in m.bodies)
    alone = replace(m, joints=joints, springs=(), joint_springs=(), loads=())
    free = asked.engine.instant(alone, asked.states, asked.engine.methods(alone, Question.INSTANT)[0])
    a = blend(free.a_WB_W, answer.a_WB_W, magnitude)
    return replace(answer, a_WB_W=a, alpha_WB_W=blend(free.alpha_WB_W, answer.alpha_WB_W, magnitude))


# ---------------------------------------------------------------- reactions


def _of_reactions(change: Callable[[InstantRequest, Array, float], None]) -> InstantChange:
    """Change the reactions of an answer in place, shape (n_s, n_j, 6); an answer without reactions stays as it is."""

    def of_answer(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
        if answer.force_F is None or answer.torque_F is None:
            return answer
        both = np.concatenate([answer.force_F, answer.torque_F], axis=2)
        change(asked, both, magnitude)
        return replace(answer, force_F=both[:, :, :3], torque_F=both[:, :, 3:])

    return of_answer


def _sign(asked: InstantRequest, both: Array, magnitude: float) -> None:
    """Take the first joint's reaction on the predecessor, the opposite of that on the successor."""
    first = next(k for k, joint in enumerate(asked.mechanism.joints) if JOINT_KINDS[joint.kind].rows)
    both[:, first] *= 1.0 - 2.0 * magnitude


def _cleared(_: InstantRequest, both: Array, magnitude: float) -> None:
    """Lose a fraction of the reactions after the first state, as if the engine cleared its forces."""
    both[1:] *= 1.0 - magnitude


def _in_world(asked: InstantRequest, both: Array, magnitude: float) -> None:
    """Give components in world axes where those of F belong."""
    U = np.array([[joint_frames(asked.mechanism, s, j).U for j in asked.mechanism.joints] for s in asked.states])
    for part in (both[:, :, :3], both[:, :, 3:]):
        part[:] = blend(np.einsum("sjab,sjb->sja", U, part), part, magnitude)


def _about_centre(asked: InstantRequest, both: Array, magnitude: float) -> None:
    """Give torques about the successor's centre of mass where M belongs."""
    m = asked.mechanism
    for n, state in enumerate(asked.states):
        for k, joint in enumerate(m.joints):
            i = m.body_index[joint.successor]
            if i >= 0:
                arm = rotation_from_quaternion(state.quat_WB[i]) @ (joint.M.p - m.bodies[i].com)
                both[n, k, 3:] += magnitude * np.cross(joint_frames(m, state, joint).U.T @ arm, both[n, k, :3])


def _undetermined(asked: InstantRequest, both: Array, magnitude: float) -> None:
    """Change the components that equilibrium leaves open: another solution of the same equations, and no error."""
    for n, state in enumerate(asked.states):
        both[n][~determinate_reactions(asked.mechanism, state)] += magnitude


reaction_sign = _of_reactions(_sign)
reactions_cleared = _of_reactions(_cleared)
reactions_in_world = _of_reactions(_in_world)
reactions_about_centre = _of_reactions(_about_centre)
undetermined_reactions = _of_reactions(_undetermined)


# ---------------------------------------------------------------- loads, forms, models


def loads_cleared(asked: InstantRequest, answer: InstantAnswer, magnitude: float) -> InstantAnswer:
    """Lose a fraction of the loads after the first state, as if the engine cleared its external forces."""
    weaker = tuple(replace(load, vector=(1.0 - magnitude) * load.vector) for load in asked.mechanism.loads)
    later = asked.engine.instant(replace(asked.mechanism, loads=weaker), asked.states, asked.method)
    mixed = {
        name: np.concatenate([first[:1], getattr(later, name)[1:]])
        for name, first in vars(answer).items()
        if first is not None
    }
    return replace(answer, **mixed)


def name_gone(asked: InstantRequest, _answer: InstantAnswer, _magnitude: float) -> InstantAnswer:
    """Use a name that the next version of the engine's interface no longer has."""
    gone: InstantAnswer = asked.engine.accelerations_of_old  # type: ignore[attr-defined]
    return gone


def array_transposed(_asked: InstantRequest, answer: InstantAnswer, _magnitude: float) -> InstantAnswer:
    """Exchange the axes of an array, as the next version of the engine might."""
    return replace(answer, a_WB_W=np.swapaxes(answer.a_WB_W, 1, 2))


def freedom_off(answer: ModelAnswer, magnitude: float) -> ModelAnswer:
    """Add a whole number to the degrees of freedom, as if dependent rows counted as independent."""
    return replace(answer, freedom=answer.freedom + round(magnitude))


def order_declared(order: int) -> MethodChange:
    """Declare another order than methods of a fixed step have."""

    def declare(method: Method, _: float) -> Method:
        return replace(method, order=order) if method.substeps else method

    return declare


# ---------------------------------------------------------------- motions


def motion_late(answer: TrajectoryAnswer, magnitude: float) -> TrajectoryAnswer:
    """Give poses of `magnitude` seconds earlier with the velocities of now, as if read before their update."""
    steps = -magnitude * answer.w_WB_W.reshape(-1, 3)
    turned = [
        quaternion_product(quaternion_from_rotation_vector(step), q)
        for step, q in zip(steps, answer.quat_WB.reshape(-1, 4), strict=True)
    ]
    quat = np.array(turned).reshape(answer.quat_WB.shape)
    p = answer.p_WB - magnitude * answer.v_WB_W
    return replace(answer, p_WB=p, quat_WB=quat / np.linalg.norm(quat, axis=-1, keepdims=True))


def motion_conjugate(answer: TrajectoryAnswer, _: float) -> TrajectoryAnswer:
    """Give ``R_BW`` where ``R_WB`` belongs."""
    return replace(answer, quat_WB=answer.quat_WB * [1.0, -1.0, -1.0, -1.0])


def motion_other_sign(answer: TrajectoryAnswer, _: float) -> TrajectoryAnswer:
    """Give quaternions of the other sign, which are the same rotations: no error."""
    return replace(answer, quat_WB=-answer.quat_WB)


def motion_velocities_in_body(answer: TrajectoryAnswer, magnitude: float) -> TrajectoryAnswer:
    """Give velocities in the axes of the bodies where world axes belong."""
    R = rotation_from_quaternion(answer.quat_WB)
    v, w = (blend(np.einsum("tbji,tbj->tbi", R, x), x, magnitude) for x in (answer.v_WB_W, answer.w_WB_W))
    return replace(answer, v_WB_W=v, w_WB_W=w)
