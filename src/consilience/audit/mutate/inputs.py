"""Errors in the request to an engine: the mechanism and its states, translated wrongly.

The magnitude is the fraction of the whole error, unless the docstring says otherwise; 1 is the error as it occurs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from consilience.errors import CannotAssemble
from consilience.mechanism import (
    AXIS_COORDINATES,
    GROUND,
    Array,
    Body,
    Frame,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    State,
    assemble_positions,
    assemble_velocities,
    drawing_state,
    joint_coordinates,
    joint_frames,
    move,
    quaternion_from_rotation_vector,
    quaternion_product,
    relative_motion,
    rotation_from_quaternion,
    skew,
    spanning_tree,
)

_SKEW = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
"""Unit vector along no coordinate axis."""

_DENSITY = 1000.0
"""Default density of engines that derive inertia from geometry, kg/m^3."""

_ATTEMPTS = 12
"""Random guesses, in the plane normal to the axis, from which another assembly is sought."""


def _turn(angle: float) -> Array:
    return rotation_from_quaternion(quaternion_from_rotation_vector(angle * _SKEW))


def blend(wrong: Array, right: Array, magnitude: float) -> Array:
    """Interpolate from right, at magnitude 0, to wrong, at magnitude 1."""
    return np.asarray(right + magnitude * (wrong - right))


# ---------------------------------------------------------------- bodies


def _each_body(change: Callable[[Body, float], Body]) -> Callable[[Mechanism, float], Mechanism]:
    def of_all(mechanism: Mechanism, magnitude: float) -> Mechanism:
        return replace(mechanism, bodies=tuple(change(body, magnitude) for body in mechanism.bodies))

    return of_all


def _about_the_origin(body: Body, magnitude: float) -> Body:
    S = skew(body.com)
    return replace(body, inertia=body.inertia - magnitude * body.mass * S @ S)


def _rotated(body: Body, magnitude: float) -> Body:
    R = _turn(magnitude)
    inertia = R @ body.inertia @ R.T
    return replace(body, inertia=0.5 * (inertia + inertia.T))


def _without_products(body: Body, magnitude: float) -> Body:
    return replace(body, inertia=blend(np.diag(np.diag(body.inertia)), body.inertia, magnitude))


def _centre_at_origin(body: Body, magnitude: float) -> Body:
    return replace(body, com=(1.0 - magnitude) * body.com)


def _with_geometry(body: Body, magnitude: float) -> Body:
    """Add a sphere about the origin, of `magnitude` times the mass of the body and of the default density."""
    extra = magnitude * body.mass
    radius = (3.0 * extra / (4.0 * np.pi * _DENSITY)) ** (1.0 / 3.0)
    mass = body.mass + extra
    com = body.mass / mass * body.com
    own, other = skew(body.com - com), skew(com)
    inertia = body.inertia - body.mass * own @ own - extra * other @ other + 0.4 * extra * radius**2 * np.eye(3)
    return replace(body, mass=mass, com=com, inertia=0.5 * (inertia + inertia.T))


inertia_about_origin = _each_body(_about_the_origin)
inertia_rotated = _each_body(_rotated)
products_dropped = _each_body(_without_products)
centre_of_mass_lost = _each_body(_centre_at_origin)
geometry_masses = _each_body(_with_geometry)


# ---------------------------------------------------------------- gravity, loads, hidden elements


def gravity_scaled(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Enlarge gravity by a fraction."""
    return replace(mechanism, gravity=(1.0 + magnitude) * mechanism.gravity)


def gravity_turned(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Turn gravity by an angle in rad."""
    return replace(mechanism, gravity=_turn(magnitude) @ mechanism.gravity)


def gravity_default(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Take the engine's default gravity, along -z, in place of the mechanism's."""
    return replace(mechanism, gravity=blend(np.array([0.0, 0.0, -9.81]), mechanism.gravity, magnitude))


def loads_in_other_axes(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Take a fraction of each load in the axes of the body in place of the world, or in the world's for the body's."""
    other = {"world": "body", "body": "world"}
    loads: list[Load] = []
    for load in mechanism.loads:
        loads.append(replace(load, vector=(1.0 - magnitude) * load.vector))
        wrong = replace(load, name=f"{load.name}, wrong axes", vector=magnitude * load.vector, frame=other[load.frame])  # type: ignore[arg-type]
        loads.append(wrong)
    return replace(mechanism, loads=tuple(loads))


def loads_at_the_origin(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Move the points of forces towards the origins of the bodies."""
    return replace(mechanism, loads=tuple(replace(x, point=(1.0 - magnitude) * x.point) for x in mechanism.loads))


def damping_hidden(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Add a damper to every joint axis, of `magnitude` in N m s or N s/m."""
    hidden = [
        JointSpring(f"hidden {j.name} {c}", j.name, c, 0.0, magnitude, 0.0)
        for j in mechanism.joints
        for c in AXIS_COORDINATES.get(j.kind, ())
    ]
    return replace(mechanism, joint_springs=(*mechanism.joint_springs, *hidden))


# ---------------------------------------------------------------- joints


def _with_frames(mechanism: Mechanism, change: Callable[[Joint], Frame]) -> Mechanism:
    return replace(mechanism, joints=tuple(replace(j, M=change(j)) for j in mechanism.joints))


def frames_turned(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Turn the frames M in their bodies by an angle in rad."""
    return _with_frames(mechanism, lambda j: Frame(j.M.p, j.M.R @ _turn(magnitude)))


def frames_transposed(mechanism: Mechanism, _: float) -> Mechanism:
    """Transpose the rotations of the frames M; all or nothing."""
    return _with_frames(mechanism, lambda j: Frame(j.M.p, j.M.R.T))


def anchors_elsewhere(mechanism: Mechanism, magnitude: float) -> Mechanism:
    """Compute the frames M of joints that close loops in a pose that is not assembled.

    In that pose every coordinate of every body differs by up to `magnitude`, in m or rad, from the drawing.
    """
    n = 6 * len(mechanism.bodies)
    pose = move(drawing_state(mechanism), magnitude * np.sin(np.arange(1.0, n + 1.0)))
    joints = list(mechanism.joints)
    for k in spanning_tree(mechanism)[1]:
        joint = joints[k]
        f = joint_frames(mechanism, pose, joint)
        shift, turned = joint.M.R @ (f.W.T @ -f.d), joint.M.R @ (f.W.T @ f.U)
        drawn = joint_frames(mechanism, drawing_state(mechanism), joint)
        # subtract the offset of the frames in the drawing, where they need not coincide
        back = joint.M.R @ (drawn.W.T @ -drawn.d), joint.M.R @ (drawn.W.T @ drawn.U)
        joints[k] = replace(joint, M=Frame(joint.M.p + shift - back[0], turned @ back[1].T @ joint.M.R))
    return replace(mechanism, joints=tuple(joints))


def joint_ignored(mechanism: Mechanism, _: float) -> Mechanism:
    """Free the joint that closes the first loop; all or nothing."""
    k = spanning_tree(mechanism)[1][0]
    joints = list(mechanism.joints)
    joints[k] = replace(joints[k], kind="free", length=0.0)
    springs = tuple(s for s in mechanism.joint_springs if s.joint != joints[k].name)
    return replace(mechanism, joints=tuple(joints), joint_springs=springs)


# ---------------------------------------------------------------- states


def _each_state(change: Callable[[Mechanism, State, float], State]) -> Callable[..., list[State]]:
    def of_all(mechanism: Mechanism, states: Sequence[State], magnitude: float) -> list[State]:
        return [change(mechanism, state, magnitude) for state in states]

    return of_all


def _turned(_: Mechanism, state: State, magnitude: float) -> State:
    """Turn all orientations by an angle in rad."""
    off = quaternion_from_rotation_vector(magnitude * _SKEW)
    quats = np.array([quaternion_product(off, q) for q in state.quat_WB])
    return replace(state, quat_WB=quats / np.linalg.norm(quats, axis=1, keepdims=True))


def _in_body_axes(vectors: Array, state: State, magnitude: float) -> Array:
    R = rotation_from_quaternion(state.quat_WB)
    return blend(np.einsum("bji,bj->bi", R, vectors), vectors, magnitude)


def _of_the_centre(mechanism: Mechanism, state: State, magnitude: float) -> State:
    R = rotation_from_quaternion(state.quat_WB)
    arms = np.einsum("bij,bj->bi", R, np.array([b.com for b in mechanism.bodies]))
    return replace(state, v_WB_W=state.v_WB_W + magnitude * np.cross(state.w_WB_W, arms))


def _swapped(_: Mechanism, state: State, magnitude: float) -> State:
    v, w = state.v_WB_W, state.w_WB_W
    return replace(state, v_WB_W=blend(w, v, magnitude), w_WB_W=blend(v, w, magnitude))


def moved(state: State, time: float) -> State:
    """Return the state with its poses advanced by a time at constant velocities."""
    return move(state, time * np.hstack([state.v_WB_W, state.w_WB_W]).ravel())


quaternion_conjugate = _each_state(lambda m, s, e: replace(s, quat_WB=s.quat_WB * [1.0, -1.0, -1.0, -1.0]))
quaternion_scalar_last = _each_state(lambda m, s, e: replace(s, quat_WB=s.quat_WB[:, [3, 0, 1, 2]]))
quaternion_other_sign = _each_state(lambda m, s, e: replace(s, quat_WB=-s.quat_WB))
orientations_turned = _each_state(_turned)
angular_velocity_in_body = _each_state(lambda m, s, e: replace(s, w_WB_W=_in_body_axes(s.w_WB_W, s, e)))
velocity_in_body = _each_state(lambda m, s, e: replace(s, v_WB_W=_in_body_axes(s.v_WB_W, s, e)))
velocity_of_centre = _each_state(_of_the_centre)
twist_order = _each_state(_swapped)
poses_stale = _each_state(lambda m, s, e: moved(s, -e))


@lru_cache(maxsize=256)
def other_branch(mechanism: Mechanism, state: State) -> State | None:
    """Return another assembly with the same coordinate of the first joint of one axis; None if none is found."""
    for joint in mechanism.joints:
        names = AXIS_COORDINATES.get(joint.kind, ())
        if len(names) == 1 and GROUND in (joint.predecessor, joint.successor):
            return _other_assembly(mechanism, state, joint, names[0])
    return None


def _other_assembly(mechanism: Mechanism, state: State, joint: Joint, name: str) -> State | None:
    value = joint_coordinates(joint, relative_motion(mechanism, state, joint))[name]
    axis = joint_frames(mechanism, state, joint).U[:, 2]
    rng = np.random.default_rng(1)
    for _ in range(_ATTEMPTS):
        steps = rng.normal(scale=0.5, size=(len(mechanism.bodies), 3))
        turns = rng.uniform(-np.pi, np.pi, (len(mechanism.bodies), 1)) * axis
        guess = move(state, np.hstack([steps - np.outer(steps @ axis, axis), turns]).ravel())
        try:
            found = assemble_positions(mechanism, guess, [(joint, name, value)])
        except CannotAssemble:
            continue
        if float(np.max(np.abs(found.p_WB - state.p_WB))) > 0.05:
            return assemble_velocities(mechanism, found)
    return None


def branch_flipped(mechanism: Mechanism, states: Sequence[State], _: float) -> list[State]:
    """Replace every state by its other assembly, if there is one; all or nothing."""
    return [other_branch(mechanism, state) or state for state in states]
