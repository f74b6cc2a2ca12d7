"""Conversion of states to DART's positions and velocities, and back.

Positions of a ball joint are the rotation vector of the link in the joint frame, velocities the angular velocity in
axes of the **link**. Positions of a free joint with identity frames are rotation vector and origin, velocities angular
velocity and rate of the origin, all in axes of the **parent**.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import (
    Array,
    Link,
    State,
    coordinates,
    joint_coordinates,
    quaternion_from_rotation,
    quaternion_product,
    relative_motion,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
)
from consilience_dart.translation import Model

SMALL_ANGLE = 2e-3
"""Angle below which rotation vectors are replaced: under about 1e-3 rad DART's exponential map is a truncated series
with an error up to 1.6e-10."""


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Coordinates of a state with quaternions in place of rotation vectors.

    Attributes
    ----------
    q, v : ndarray, shape (n,)
        DART's positions (zero for rotation vectors, see `quats`) and velocities.
    quats : ndarray, shape (n_rotations, 4)
        Orientation of each ball and free joint, in the order of the links.
    """

    q: Array
    v: Array
    quats: Array


def rotations(model: Model) -> list[tuple[int, bool]]:
    """Return the first coordinate of each ball and free joint; True if its angular velocity is in parent axes."""
    return [
        (start, link.elementary == "F")
        for start, link in zip(model.start, model.tree.links, strict=True)
        if link.elementary in ("S", "F")
    ]


def from_state(model: Model, state: State) -> Coordinates:
    """Compute the coordinates of the skeleton at a state of the mechanism."""
    q, v = np.zeros(model.skeleton.getNumDofs()), np.zeros(model.skeleton.getNumDofs())
    quats = [np.zeros((0, 4))]
    elementary = coordinates(model.lowered, model.tree, state)
    for link, i, c in zip(model.tree.links, model.start, elementary, strict=True):
        place = link.placement
        if link.elementary in ("R", "P"):
            q[i], v[i] = c.q, c.rate
            if model.mechanism.joints[link.joint].pitch:
                q[i] = _screw_angle(model, link, state)
        elif link.elementary == "S":
            quats.append(np.atleast_2d(np.asarray(c.quat)))
            v[i : i + 3] = np.asarray(c.w)
        elif link.elementary == "F":
            quat = quaternion_product(quaternion_from_rotation(place.R), np.asarray(c.quat))
            quats.append(np.atleast_2d(quat))
            q[i + 3 : i + 6] = place.p + place.R @ np.asarray(c.p)
            v[i : i + 3] = rotation_from_quaternion(quat) @ np.asarray(c.w)
            v[i + 3 : i + 6] = place.R @ np.asarray(c.v)
    return Coordinates(q, v, np.vstack(quats))


def _screw_angle(model: Model, link: Link, state: State) -> float:
    """Angle of a screw; its full turns follow from the displacement."""
    joint = model.mechanism.joints[link.joint]
    angle = float(joint_coordinates(joint, relative_motion(model.mechanism, state, joint))["angle"])
    return -angle if link.reversed else angle


def rotation_vector(quat: Array) -> Array:
    """Return the rotation vector that DART maps to the rotation without loss of digits.

    A rotation by a small angle t is given as the rotation by ``2 pi - t`` about the opposite axis.
    """
    phi = rotation_vector_from_quaternion(quat)
    angle = float(np.linalg.norm(phi))
    if 0.0 < angle < SMALL_ANGLE:
        phi = phi * (1.0 - 2.0 * np.pi / angle)
    return phi


def send(model: Model, c: Coordinates) -> None:
    """Set the skeleton's positions and velocities."""
    if not (np.all(np.isfinite(c.q)) and np.all(np.isfinite(c.v)) and np.all(np.isfinite(c.quats))):
        raise FloatingPointError("the state is not finite; DART would go on with an identity transform in its place")
    q = c.q.copy()
    for (i, _), quat in zip(rotations(model), c.quats, strict=True):
        q[i : i + 3] = rotation_vector(quat)
    model.skeleton.setPositions(q)
    model.skeleton.setVelocities(c.v)


def read(model: Model) -> tuple[Array, Array, Array, Array]:
    """Return ``p_WB, quat_WB, v_WB_W, w_WB_W`` of all bodies at the skeleton's state, one row for each body."""
    if not np.all(np.isfinite(model.skeleton.getPositions())):
        raise FloatingPointError("DART's positions are not finite; its transforms show an identity in their place")
    p, quat, v, w = [], [], [], []
    for carrier in model.carriers:
        node, frame = model.nodes[carrier], model.tree.links[carrier].body_frame
        T = node.getWorldTransform()
        R = T.rotation()
        p.append(T.translation() + R @ frame.p)
        quat.append(quaternion_from_rotation(R @ frame.R))
        v.append(node.getLinearVelocity(frame.p))
        w.append(node.getAngularVelocity())
    return np.array(p), np.array(quat), np.array(v), np.array(w)
