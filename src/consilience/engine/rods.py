"""Charts of rods: frames turned such that the two revolute axes of a rod stay far from coinciding.

The chain of a rod is a revolute about x, a revolute about y and a ball (`to_elementary_tree`). The chain is singular
where the rod lies along x of its start frame. A rod holds a distance only, so the orientation of its frames is free:
they are turned until the rod lies along their z. Dynamics and all other coordinates stay the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from consilience.mechanism import (
    Array,
    Frame,
    Joint,
    Mechanism,
    State,
    Tree,
    elementary_rotation,
    relative_motion,
    rotation_with_z_axis,
)

ROD_MARGIN = 0.5
"""Smallest cosine of the second angle of a chart; rounding errors grow with the inverse square of the cosine."""


def rods_of(mechanism: Mechanism, tree: Tree) -> list[int]:
    """Return the index of the first of the three links of each rod."""
    links, joints = tree.links, mechanism.joints
    return [
        i
        for i, link in enumerate(links)
        if joints[link.joint].kind == "rod" and (link.parent < 0 or links[link.parent].joint != link.joint)
    ]


def suited_rods(mechanism: Mechanism, state: State) -> Mechanism:
    """Return a mechanism whose rods are far from singular at a state: the given one, or one with turned frames."""
    joints = tuple(_suited(mechanism, state, joint) if joint.kind == "rod" else joint for joint in mechanism.joints)
    changed = any(new is not old for new, old in zip(joints, mechanism.joints, strict=True))
    return replace(mechanism, joints=joints) if changed else mechanism


def _suited(mechanism: Mechanism, state: State, rod: Joint) -> Joint:
    back = replace(rod, predecessor=rod.successor, successor=rod.predecessor, F=rod.M, M=rod.F)
    F, M = (_clear_frame(mechanism, state, passed) for passed in (rod, back))
    return rod if F is rod.F and M is rod.M else replace(rod, F=F, M=M)


def _clear_frame(mechanism: Mechanism, state: State, rod: Joint) -> Frame:
    """Frame F of a rod, or the same with z along the rod if the rod is near to its x."""
    along = relative_motion(mechanism, state, rod).p
    if np.hypot(along[1], along[2]) >= ROD_MARGIN * np.linalg.norm(along):
        return rod.F
    return Frame(rod.F.p, rod.F.R @ rotation_with_z_axis(along))


def rod_turn(angles: Array, rates: Array) -> tuple[Array, Array]:
    """Return the turn ``C = Rx(a) Ry(b)`` that puts a rod along z, and the angular velocity of the rod in turned axes.

    In the turned chart both angles are zero, their rates are the first two components of the angular velocity, and the
    ball keeps its quaternion; the third component is added to the angular velocity of the ball.

    Parameters
    ----------
    angles, rates : ndarray, shape (2,), rad and rad/s
        Of the two revolutes.
    """
    R_a = elementary_rotation(0, angles[0])
    C = R_a @ elementary_rotation(1, angles[1])
    return C, C.T @ (rates[0] * np.array([1.0, 0.0, 0.0]) + rates[1] * R_a[:, 1])


def turned_rods(mechanism: Mechanism, tree: Tree, turns: Mapping[int, Array]) -> Mechanism:
    """Return the mechanism with the start frames of rods turned, by the first link of each (columns: new axes)."""
    joints = list(mechanism.joints)
    for first, C in turns.items():
        link = tree.links[first]
        joint = joints[link.joint]
        frame = joint.M if link.reversed else joint.F
        turned = Frame(frame.p, frame.R @ C)
        joints[link.joint] = replace(joint, M=turned) if link.reversed else replace(joint, F=turned)
    return replace(mechanism, joints=tuple(joints))
