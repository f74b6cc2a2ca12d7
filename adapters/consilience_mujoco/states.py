"""Conversion of body poses and velocities to MuJoCo's coordinates, and back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from consilience.mechanism import (
    Array,
    Coordinate,
    Link,
    State,
    coordinates,
    cross,
    full_turns,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from consilience_mujoco.translate import Translation


def _scalar(_: Link, coordinate: Coordinate, __: State) -> tuple[Any, Any]:
    return [coordinate.q], [coordinate.rate]


def _ball(_: Link, coordinate: Coordinate, __: State) -> tuple[Any, Any]:
    return coordinate.quat, coordinate.w  # in axes of the link, which are those of the MuJoCo body


def _free(link: Link, _: Coordinate, state: State) -> tuple[Any, Any]:
    """Origin and its velocity in world axes, quaternion, angular velocity in axes of the link."""
    R_WL = rotation_from_quaternion(state.quat_WB[link.body]) @ link.body_frame.R.T
    arm, w = R_WL @ link.body_frame.p, state.w_WB_W[link.body]
    position, velocity = state.p_WB[link.body] - arm, state.v_WB_W[link.body] - cross(w, arm)
    return np.concatenate([position, quaternion_from_rotation(R_WL)]), np.concatenate([velocity, R_WL.T @ w])


_WRITE: dict[str, Callable[[Link, Coordinate, State], tuple[Any, Any]]] = {
    "R": _scalar,
    "P": _scalar,
    "S": _ball,
    "F": _free,
}


def set_state(translation: Translation, state: State) -> None:
    """Reset the data and write `qpos` and `qvel` of a state, without any evaluation."""
    t = translation
    mujoco.mj_resetData(t.model, t.data)
    coords = coordinates(t.plain, t.tree, state)
    for link, coordinate, joint in zip(t.tree.links, coords, t.link_joint, strict=True):
        if joint >= 0:
            q, v = _WRITE[link.elementary](link, coordinate, state)
            start_q, start_v = t.model.jnt_qposadr[joint], t.model.jnt_dofadr[joint]
            t.data.qpos[start_q : start_q + len(q)] = q
            t.data.qvel[start_v : start_v + len(v)] = v
    for slide, turn, pitch in t.rows.screws:  # full turns of a screw follow from the displacement
        t.data.qpos[turn] = full_turns(float(t.data.qpos[turn]), 2.0 * np.pi * float(t.data.qpos[slide]) / pitch)


def poses_and_velocities(translation: Translation) -> tuple[Array, Array, Array, Array]:
    """Return p_WB, quat_WB, v_WB_W, w_WB_W of all bodies from the present `qpos` and `qvel`.

    After a step the derived fields of the data belong to the state before the step, and are evaluated here again.
    """
    t = translation
    mujoco.mj_kinematics(t.model, t.data)
    mujoco.mj_comPos(t.model, t.data)
    mujoco.mj_comVel(t.model, t.data)
    twists = np.zeros((len(t.body_site), 6))
    for twist, site in zip(twists, t.body_site, strict=True):
        mujoco.mj_objectVelocity(t.model, t.data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
    R = t.data.site_xmat[t.body_site].reshape(-1, 3, 3)
    return t.data.site_xpos[t.body_site], quaternion_from_rotation(R), twists[:, 3:], twists[:, :3]
