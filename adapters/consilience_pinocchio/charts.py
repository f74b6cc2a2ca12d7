"""Charts of rods: start frames turned such that the two revolute axes of a rod stay far from coinciding.

The chain of a rod is a revolute about x, a revolute about y and a ball (`to_elementary_tree`). The chain is singular
where the rod lies along x of its start frame. A rod holds a distance only, so the orientation of the start frame is
free: the frame is turned until the rod lies along its z. Dynamics and all other coordinates stay the same.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.mechanism import Array, Frame, Joint, Link, Mechanism, State, elementary_rotation, relative_motion
from consilience_pinocchio.translate import Translation, translate

MARGIN = 0.5
"""Smallest cosine of the second angle of a chart; rounding errors grow with the inverse square of the cosine."""


def _turned(joint: Joint, backward: bool, C: Array) -> Joint:
    """Rod with its start frame, as the tree passes the rod, turned by C (columns: new axes in the old frame)."""
    if backward:
        return replace(joint, M=Frame(joint.M.p, joint.M.R @ C))
    return replace(joint, F=Frame(joint.F.p, joint.F.R @ C))


def _rods(translation: Translation) -> list[tuple[int, Link]]:
    """Index and link of the start of the chain of each rod."""
    joints = translation.mechanism.joints
    links = translation.tree.links
    return [
        (i, link)
        for i, link in enumerate(links)
        if joints[link.joint].kind == "rod" and (link.parent < 0 or links[link.parent].joint != link.joint)
    ]


def _with_joints(mechanism: Mechanism, joints: dict[int, Joint]) -> Mechanism:
    return replace(mechanism, joints=tuple(joints.get(k, joint) for k, joint in enumerate(mechanism.joints)))


def suited(translation: Translation, state: State) -> Translation:
    """Return a translation whose rods are far from singular at `state`: the given one, or one with turned frames."""
    joints: dict[int, Joint] = {}
    for _, link in _rods(translation):
        joint = translation.mechanism.joints[link.joint]
        passed = joint
        if link.reversed:
            passed = replace(joint, predecessor=joint.successor, successor=joint.predecessor, F=joint.M, M=joint.F)
        p = relative_motion(translation.mechanism, state, passed).p
        across = float(np.hypot(p[1], p[2]))
        if across < MARGIN * float(np.linalg.norm(p)):
            C = elementary_rotation(0, float(np.arctan2(-p[1], p[2]))) @ elementary_rotation(
                1, float(np.arctan2(p[0], across))
            )
            joints[link.joint] = _turned(joint, link.reversed, C)
    return translate(_with_joints(translation.mechanism, joints)) if joints else translation


class ChartWatch:
    """Charts of the rods of a translation during an integration."""

    def __init__(self, translation: Translation) -> None:
        self._translation = translation
        model = translation.model
        self._chains: list[tuple[Link, tuple[Any, Any, Any]]] = []
        for first, link in _rods(translation):
            seats = translation.seats[first : first + 3]
            self._chains.append((link, tuple(model.joints[seat.joint] for seat in seats)))

    @property
    def needed(self) -> bool:
        """Whether there are rods."""
        return bool(self._chains)

    def left(self, q: Array) -> bool:
        """Whether a rod is too near to its singular pose."""
        return any(abs(np.cos(q[second.idx_q])) < MARGIN for _, (_, second, _) in self._chains)

    def change(self, q: Array, v: Array) -> tuple[Translation, Array, Array]:
        """Turn the start frames of all rods until the rods lie along z, and transform q and v.

        With the turn ``C = Rx(a) Ry(b)`` the new angles are zero and the ball keeps its quaternion; the component of
        the massless link's angular velocity along the rod is added to that of the ball.
        """
        joints: dict[int, Joint] = {}
        q, v = q.copy(), v.copy()
        for link, (first, second, ball) in self._chains:
            a, b = q[first.idx_q], q[second.idx_q]
            C = elementary_rotation(0, a) @ elementary_rotation(1, b)
            w_rod = C.T @ (
                v[first.idx_v] * np.array([1.0, 0.0, 0.0]) + v[second.idx_v] * elementary_rotation(0, a)[:, 1]
            )
            xyzw = q[ball.idx_q : ball.idx_q + 4]
            R = pin.Quaternion(xyzw / np.linalg.norm(xyzw)).toRotationMatrix()
            v[ball.idx_v : ball.idx_v + 3] += w_rod[2] * R[2]
            q[first.idx_q] = q[second.idx_q] = 0.0
            v[first.idx_v], v[second.idx_v] = w_rod[0], w_rod[1]
            joint = self._translation.mechanism.joints[link.joint]
            joints[link.joint] = _turned(joint, link.reversed, C)
        return translate(_with_joints(self._translation.mechanism, joints)), q, v
