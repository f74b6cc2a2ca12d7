"""Rows of joint coordinates: rates and accelerations from those of the bodies.

    q' = R (v, w),    q'' = R (a, alpha) + drift

with velocities of the body origins, world axes. The columns of ``R^T`` are the forces of unit efforts in the
coordinates. The second derivative of an orientation is that of its angular velocity in axes of F.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import (
    JOINT_KINDS,
    RANK_TOLERANCE,
    Array,
    Joint,
    Mechanism,
    State,
    cross,
    joint_coordinates,
    joint_frames,
    quaternion_product,
    relative_motion,
    rotation_vector_from_quaternion,
    row_gamma,
)
from consilience.mechanism.assembly import held_rows
from consilience.mechanism.joint_rows import full_turns, scatter

JointCoordinate = tuple[Joint, str]

_SPACES = {"position": ("X", "Y", "Z"), "distance": ("Z",), "x": ("X",), "y": ("Y",)}


def width(coordinate: str) -> int:
    """Return the number of rows of a joint coordinate: three for a position or orientation, else one."""
    return 3 if coordinate in ("position", "orientation") else 1


def named_coordinate(mechanism: Mechanism, joint: str, coordinate: str, where: str) -> JointCoordinate:
    """Return the joint coordinate of a name.

    Raises
    ------
    InvalidInput
        Unknown joint or coordinate.
    """
    if joint not in mechanism.joint_index:
        raise InvalidInput(where, f"there is no joint '{joint}'", f"Joints are: {', '.join(mechanism.joint_index)}.")
    found = mechanism.joints[mechanism.joint_index[joint]]
    names = JOINT_KINDS[found.kind].coordinates
    if coordinate not in names:
        known = ", ".join(names) or "none"
        raise InvalidInput(
            f"{where}: joint '{joint}'", f"a {found.kind} joint has no '{coordinate}'", f"It has: {known}."
        )
    return found, coordinate


def all_coordinates(mechanism: Mechanism) -> list[JointCoordinate]:
    """Return all joint coordinates in the order of the joints."""
    return [(joint, name) for joint in mechanism.joints for name in JOINT_KINDS[joint.kind].coordinates]


def coordinate_rows(mechanism: Mechanism, state: State, wanted: Sequence[JointCoordinate]) -> tuple[Array, Array]:
    """Return rows R, shape (m, 6 n_b), and drift, shape (m,), of the wanted coordinates."""
    rows, drift = [np.zeros((0, 6 * len(mechanism.bodies)))], [np.zeros(0)]
    for joint, coordinate in wanted:
        pairs = held_rows(mechanism, state, joint, coordinate)
        rows.append(scatter(mechanism, joint, pairs))
        f = joint_frames(mechanism, state, joint)
        if coordinate in _SPACES:
            drift.append(-np.array([row_gamma(f, row) for row in _SPACES[coordinate]]))
        else:  # axes fixed to F or to M have the same drift
            drift.append(pairs[:, 9:] @ cross(f.w_j, f.w_i))
    return np.vstack(rows), np.concatenate(drift)


def unturned(coordinates: Sequence[JointCoordinate]) -> dict[JointCoordinate, Array]:
    """Return zero for every coordinate, the unit quaternion for an orientation."""
    return {c: np.eye(4)[0] if c[1] == "orientation" else np.zeros(()) for c in coordinates}


def turn_between(start: Array, end: Array) -> Array:
    """Return the rotation vector from one orientation to another, unit quaternions, in the axes of reference."""
    return rotation_vector_from_quaternion(quaternion_product(end, start * np.array([1.0, -1.0, -1.0, -1.0])))


def least_squares(S: Array, b: Array) -> Array:
    """Solve ``S x = b`` by least squares with one refinement."""
    x = np.linalg.lstsq(S, b, rcond=RANK_TOLERANCE)[0]
    return x + np.linalg.lstsq(S, b - S @ x, rcond=RANK_TOLERANCE)[0]


def with_velocities(state: State, v: Array) -> State:
    """Return the pose of a state with other velocities ``(v_WB_W, w_WB_W)``, shape (6 n_b,)."""
    both = v.reshape(-1, 6)
    return State(state.p_WB, state.quat_WB, both[:, :3], both[:, 3:])


def coordinate_values(
    mechanism: Mechanism, state: State, near: Mapping[JointCoordinate, Array]
) -> dict[JointCoordinate, Array]:
    """Return the values of the coordinates in `near`, angles and signs of quaternions nearest to those values."""
    values: dict[JointCoordinate, Array] = {}
    for (joint, name), before in near.items():
        value = joint_coordinates(joint, relative_motion(mechanism, state, joint))[name]
        if name.startswith("angle"):
            value = np.asarray(full_turns(float(value), float(before)))
        elif name == "orientation" and value @ before < 0:
            value = -value
        values[joint, name] = value
    return values
