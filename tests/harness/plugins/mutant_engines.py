"""Engines with one error of translation each; adapters are known to make these errors.

A mutant alters the mechanism or the states that it passes to the reference, or the answer that it gets back.
"""

from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from honest_engine import HonestEngine
from kept_answers import UncheckedReference

from consilience.engine import Question
from consilience.mechanism import GROUND, Body, Frame, Load, State, joint_frames, rotation_from_quaternion, skew


class MutantEngine(HonestEngine):
    """The functions `mechanism`, `state` and `instant` alter a mechanism, a state and an answer."""

    def __init__(self, mechanism=lambda m: m, state=lambda s: s, instant=lambda m, s, a: a):
        super().__init__()
        self._mechanism, self._state, self._instant = mechanism, state, instant

    @cached_property
    def _reference(self):
        return UncheckedReference()

    def model(self, mechanism, state, method):
        return super().model(self._mechanism(mechanism), self._state(state), method)

    def instant(self, mechanism, states, method):
        answer = super().instant(self._mechanism(mechanism), [self._state(s) for s in states], method)
        return self._instant(mechanism, states, answer)

    def trajectory(self, mechanism, state, times, method, step):
        return super().trajectory(self._mechanism(mechanism), self._state(state), times, method, step)


def _each_body(change):
    return lambda mechanism: replace(mechanism, bodies=tuple(change(body) for body in mechanism.bodies))


def _about_the_origin(body: Body) -> Body:
    """Inertia about B in place of the inertia about the centre of mass."""
    S = skew(body.com)
    return replace(body, inertia=body.inertia - body.mass * S @ S)


def _without_product(body: Body) -> Body:
    inertia = body.inertia.copy()
    inertia[0, 1] = inertia[1, 0] = 0.0
    return replace(body, inertia=inertia)


def _turned_frames(mechanism):
    """Joint frames on the successors transposed: components are taken from the body to the frame, not back."""
    joints = tuple(replace(j, M=Frame(j.M.p, j.M.R.T)) for j in mechanism.joints)
    return replace(mechanism, joints=joints)


def _scalar_last(state: State) -> State:
    """Quaternion (e0, e1, e2, e3) read as (x, y, z, w)."""
    return replace(state, quat_WB=state.quat_WB[:, [3, 0, 1, 2]])


def _conjugate(state: State) -> State:
    """``R_BW`` in place of ``R_WB``."""
    return replace(state, quat_WB=state.quat_WB * [1.0, -1.0, -1.0, -1.0])


def _in_body_axes(state: State) -> State:
    R = rotation_from_quaternion(state.quat_WB)
    return replace(state, w_WB_W=np.einsum("bji,bj->bi", R, state.w_WB_W))


def _weightless(mechanism, states, answer):
    """The first body does not feel gravity: an upward force at its centre of mass takes its weight."""
    body = mechanism.bodies[0]
    lift = Load("lift", "force", body.name, -body.mass * mechanism.gravity, "world", body.com)
    engine = HonestEngine()
    lifted = replace(mechanism, loads=(*mechanism.loads, lift))
    return replace(
        engine.instant(lifted, states, engine.methods(lifted, Question.INSTANT)[0]), potential=answer.potential
    )


def _wrong_sign(mechanism, states, answer):
    return replace(answer, force_F=-answer.force_F, torque_F=-answer.torque_F)


def _other_sign_of_one(mechanism, states, answer):
    """The reaction of the second joint alone has the opposite sign: the reaction on the predecessor."""
    force, torque = answer.force_F.copy(), answer.torque_F.copy()
    force[:, 1] *= -1.0
    torque[:, 1] *= -1.0
    return replace(answer, force_F=force, torque_F=torque)


def _in_world_axes(mechanism, states, answer):
    U = np.array([[joint_frames(mechanism, s, j).U for j in mechanism.joints] for s in states])
    turn = partial(np.einsum, "sjab,sjb->sja", U)
    return replace(answer, force_F=turn(answer.force_F), torque_F=turn(answer.torque_F))


def _about_the_centre_of_mass(mechanism, states, answer):
    """Torque of the reaction about the successor's centre of mass, not about M."""
    arms = np.zeros_like(answer.torque_F)
    for k, joint in enumerate(mechanism.joints):
        if joint.successor != GROUND:
            body = mechanism.bodies[mechanism.body_index[joint.successor]]
            arms[:, k] = joint.M.R.T @ (joint.M.p - body.com)  # in axes of M, not of F: a mutant need not be exact
    return replace(answer, torque_F=answer.torque_F + np.cross(arms, answer.force_F))


def _at_the_centre_of_mass(mechanism, states, answer):
    """Accelerations of the centres of mass, not of the origins."""
    a = answer.a_WB_W.copy()
    for n, state in enumerate(states):
        R = rotation_from_quaternion(state.quat_WB)
        for b, body in enumerate(mechanism.bodies):
            c, w = R[b] @ body.com, state.w_WB_W[b]
            a[n, b] += np.cross(answer.alpha_WB_W[n, b], c) + np.cross(w, np.cross(w, c))
    return replace(answer, a_WB_W=a)


transposed_rotation = partial(MutantEngine, state=_conjugate)
quaternion_order = partial(MutantEngine, state=_scalar_last)
transposed_joint_frames = partial(MutantEngine, mechanism=_turned_frames)
inertia_about_origin = partial(MutantEngine, mechanism=_each_body(_about_the_origin))
dropped_product = partial(MutantEngine, mechanism=_each_body(_without_product))
centre_of_mass_lost = partial(MutantEngine, mechanism=_each_body(lambda b: replace(b, com=np.zeros(3))))
body_axes_velocity = partial(MutantEngine, state=_in_body_axes)
weightless_body = partial(MutantEngine, instant=_weightless)
reaction_sign = partial(MutantEngine, instant=_wrong_sign)
reaction_sign_of_one = partial(MutantEngine, instant=_other_sign_of_one)
reaction_axes = partial(MutantEngine, instant=_in_world_axes)
reaction_point = partial(MutantEngine, instant=_about_the_centre_of_mass)
acceleration_point = partial(MutantEngine, instant=_at_the_centre_of_mass)
halved_friction = partial(
    MutantEngine,
    mechanism=lambda m: replace(m, contacts=tuple(replace(c, friction=0.5 * c.friction) for c in m.contacts)),
)
