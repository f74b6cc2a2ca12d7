"""Bodies whose centre of mass and rotation are known functions of time, evaluated as expected values of a case."""

from collections.abc import Callable

import numpy as np

from consilience.case import read_motion
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import quaternion_from_rotation, quaternion_from_rotation_vector, rotation_from_quaternion
from oracles.planar import drawn_frame

Moving = Callable[[float], tuple]
"""Centre of mass and its velocity, turn out of the drawing and angular velocity at a time; world axes."""


def about(axis, angle):
    """Rotation about a unit axis."""
    return rotation_from_quaternion(quaternion_from_rotation_vector(np.asarray(axis) * angle))


def origin(moving):
    """Origin from `moving(case)`, which returns one `Moving` for each body."""

    def values(case, published):
        mechanism, found = case.mechanism, []
        functions = moving(case)
        for known in published:
            p, R, v, w = [], [], [], []
            for body, at in zip(mechanism.bodies, functions, strict=True):
                c, c_dot, turn, spin = at(known.time)
                axes = turn @ body.drawing.R
                arm = axes @ body.com
                p.append(c - arm)
                R.append(axes)
                v.append(c_dot - np.cross(spin, arm))
                w.append(spin)
            quats = quaternion_from_rotation(np.array(R))
            motion = TrajectoryAnswer(np.array([known.time]), *(np.array([x]) for x in (p, quats, v, w)))
            found.append(read_motion(mechanism, known, motion))
        return np.array(found)

    return values


def joint_of(case, name):
    return case.mechanism.joints[case.mechanism.joint_index[name]]


def drawn_com(body):
    return body.drawing.p + body.drawing.R @ body.com


def drawn_inertia(body):
    """Inertia about the centre of mass, in the world axes of the drawing."""
    return body.drawing.R @ body.inertia @ body.drawing.R.T


def hinged(case, joint, angle) -> Moving:
    """A body that a revolute joint rotates from the drawing; `angle(t)` gives angle and rate."""
    body = case.mechanism.bodies[case.mechanism.body_index[joint_of(case, joint).successor]]
    pin, U = drawn_frame(case.mechanism, joint_of(case, joint))
    u = U[:, 2]

    def at(t):
        q, rate = angle(t)
        turn = about(u, q)
        arm = turn @ (drawn_com(body) - pin)
        return pin + arm, rate * np.cross(u, arm), turn, rate * u

    return at


def sliding(case, joint, distance) -> Moving:
    """A body that a prismatic joint displaces from the drawing; `distance(t)` gives distance and rate."""
    body = case.mechanism.bodies[case.mechanism.body_index[joint_of(case, joint).successor]]
    u = drawn_frame(case.mechanism, joint_of(case, joint))[1][:, 2]

    def at(t):
        s, rate = distance(t)
        return drawn_com(body) + s * u, rate * u, np.eye(3), np.zeros(3)

    return at


def about_hinge(case, joint):
    """Axis, moment of inertia about the axis, and perpendicular arm of the centre of mass, in the drawing."""
    found, at = joint_of(case, joint), case.mechanism.body_index
    body = case.mechanism.bodies[at[found.successor if found.successor in at else found.predecessor]]
    pin, U = drawn_frame(case.mechanism, found)
    u, arm = U[:, 2], drawn_com(body) - pin
    across = arm - (arm @ u) * u
    return u, u @ drawn_inertia(body) @ u + body.mass * across @ across, across
