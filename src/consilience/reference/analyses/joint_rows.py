"""Rates and accelerations of joint coordinates as rows on the velocities of the bodies, for every kind of coordinate.

    q' = R (v, w),    q'' = R (a, alpha) + drift

in the velocities of the bodies' origins, world axes. Forces of unit efforts along the coordinates are the columns of
``R^T``. The second derivative of an orientation is that of its angular velocity, taken in axes of F.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import (
    JOINT_KINDS,
    Array,
    Joint,
    Mechanism,
    State,
    cross,
    joint_coordinates,
    joint_frames,
    relative_motion,
    row_gamma,
)
from consilience.mechanism.assembly import held_rows, scatter

JointCoordinate = tuple[Joint, str]

_SPACES = {"position": ("X", "Y", "Z"), "distance": ("Z",), "x": ("X",), "y": ("Y",)}


def width(coordinate: str) -> int:
    """Number of rows of a joint coordinate: three for a position and an orientation."""
    return 3 if coordinate in ("position", "orientation") else 1


def named_coordinate(mechanism: Mechanism, joint: str, coordinate: str, where: str) -> JointCoordinate:
    """The coordinate of that name.

    Raises
    ------
    InvalidInput
        Unknown joint, or a coordinate that the joint has not.
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
    """All joint coordinates, in the order of the joints."""
    return [(joint, name) for joint in mechanism.joints for name in JOINT_KINDS[joint.kind].coordinates]


def coordinate_rows(mechanism: Mechanism, state: State, wanted: Sequence[JointCoordinate]) -> tuple[Array, Array]:
    """Rows R (m, 6 n_b) and drift (m,) of the wanted coordinates, those of a vector coordinate one below another."""
    rows, drift = [np.zeros((0, 6 * len(mechanism.bodies)))], [np.zeros(0)]
    for joint, coordinate in wanted:
        pairs = held_rows(mechanism, state, joint, coordinate)
        rows.append(scatter(mechanism, joint, pairs))
        f = joint_frames(mechanism, state, joint)
        if coordinate in _SPACES:
            drift.append(-np.array([row_gamma(f, row) for row in _SPACES[coordinate]]))
        else:  # an axis turns with one side of the joint or the other: what that adds is the same
            drift.append(pairs[:, 9:] @ cross(f.w_j, f.w_i))
    return np.vstack(rows), np.concatenate(drift)


def counted_on(value: float, near: float) -> float:
    """The angle that differs from `value` by full turns and is closest to `near`."""
    return value + 2.0 * np.pi * round((near - value) / (2.0 * np.pi))


def coordinate_values(
    mechanism: Mechanism, state: State, near: Mapping[JointCoordinate, Array]
) -> dict[JointCoordinate, Array]:
    """Values of the coordinates that are keys of `near`, angles counted on from there."""
    values: dict[JointCoordinate, Array] = {}
    for (joint, name), before in near.items():
        value = joint_coordinates(joint, relative_motion(mechanism, state, joint))[name]
        if name.startswith("angle"):
            value = np.asarray(counted_on(float(value), float(before)))
        elif name == "orientation" and value @ before < 0:
            value = -value
        values[joint, name] = value
    return values
