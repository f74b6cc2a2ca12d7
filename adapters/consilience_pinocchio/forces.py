"""Springs, joint springs and loads, which Pinocchio does not have: wrenches and joint efforts from its kinematics.

Everything that does not change is prepared once, and the evaluations use small matrix products only: they stand in
the innermost loop of an integration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from consilience.mechanism import JointSpring, Load
from consilience.spatial import Array, skew
from consilience_pinocchio.translate import Translation


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a body as Pinocchio sees it.

    Attributes
    ----------
    link : int
        Link that carries it; -1 is the ground.
    joint : int
        Pinocchio joint that carries the link.
    p : ndarray, shape (3,), m
        Point from the origin of the joint's moving frame, in its axes.
    force : ndarray, shape (6, 3)
        Wrench (force, torque about the joint's origin) of a force at the point, all in the axes of the joint.
    R_WJ, p_WJ, twist : ndarray, shape (3, 3), (3,) and (6,)
        Pose and spatial velocity of the joint: live views into Pinocchio's data, which follow every evaluation.
    """

    link: int
    joint: int
    p: Array
    force: Array
    R_WJ: Array
    p_WJ: Array
    twist: Array

    def position(self) -> Array:
        """World position in m, shape (3,)."""
        return np.asarray(self.p_WJ + self.R_WJ @ self.p)

    def velocity(self) -> Array:
        """World velocity in m/s, shape (3,)."""
        return np.asarray(self.R_WJ @ (self.force.T @ self.twist))


def _point(translation: Translation, body: str, point: Array) -> Point:
    index = translation.mechanism.body_index[body]
    seat = translation.body_seat(index)
    p = seat.placement.act(np.array(point))
    placement, twist = translation.data.oMi[seat.joint], translation.data.v[seat.joint]
    return Point(
        translation.tree.carrier(index),
        seat.joint,
        p,
        np.vstack([np.eye(3), skew(p)]),
        placement.rotation,
        placement.translation,
        twist.vector,
    )


class Forces:
    """Force elements of a mechanism, evaluated at Pinocchio's current kinematics.

    Attributes
    ----------
    active : bool
        Whether there are springs or loads, so that `wrenches` is worth a call.
    loaded : tuple of (int, int)
        Links that springs and loads may push, with their joints; without what stands on the ground.
    sprung : bool
        Whether there are joint springs.
    """

    def __init__(self, translation: Translation) -> None:
        mechanism = translation.mechanism
        self._translation = translation
        self._springs = [
            (
                s,
                _point(translation, s.predecessor, s.point_predecessor),
                _point(translation, s.successor, s.point_successor),
            )
            for s in mechanism.springs
        ]
        # one row more than links: the last takes what acts on the ground (link -1), and is never read
        self._constant = np.zeros((len(translation.tree.links) + 1, 6))
        self._world: dict[int, tuple[Array, Array]] = {}
        for load in mechanism.loads:
            self._add_load(load)
        points = [p for _, i, j in self._springs for p in (i, j)]
        points += [_point(translation, load.body, load.point) for load in mechanism.loads]
        self.loaded = tuple(sorted({(p.link, p.joint) for p in points if p.joint > 0}))
        self.active = bool(points)
        self._prepare_joint_springs(mechanism.joint_springs)
        self.sprung = bool(mechanism.joint_springs)

    def _add_load(self, load: Load) -> None:
        translation = self._translation
        point = _point(translation, load.body, load.point)
        to_wrench = point.force if load.kind == "force" else np.vstack([np.zeros((3, 3)), np.eye(3)])
        if load.frame == "world":
            # in the joint's axes the vector is R^T f: linear in the nine entries of R^T, of which this is a live view
            before, rotation = self._world.get(point.link, (np.zeros((6, 9)), point.R_WJ.T.reshape(9)))
            self._world[point.link] = before + to_wrench @ np.kron(np.eye(3), load.vector), rotation
        else:
            R = translation.body_seat(translation.mechanism.body_index[load.body]).placement.rotation
            self._constant[point.link] += to_wrench @ (R @ load.vector)

    def _prepare_joint_springs(self, springs: tuple[JointSpring, ...]) -> None:
        """Rows that pick the joint coordinate of each spring out of q and v; a joint passed backwards turns round."""
        translation = self._translation
        model, tree = translation.model, translation.tree
        self._from_q = np.zeros((len(springs), model.nq))
        from_v = np.zeros((len(springs), model.nv))
        self._joint_slots: list[tuple[int, int, int]] = []
        for n, spring in enumerate(springs):
            k = translation.mechanism.joint_index[spring.joint]
            elementary, slot = ("R", 5) if spring.coordinate == "angle" else ("P", 2)
            link = next(i for i, li in enumerate(tree.links) if li.joint == k and li.elementary == elementary)
            joint = translation.seats[link].joint
            sign = -1.0 if tree.links[link].reversed else 1.0
            self._from_q[n, model.joints[joint].idx_q] = sign
            from_v[n, model.joints[joint].idx_v] = sign
            self._joint_slots.append((k, slot, model.joints[joint].idx_v))
        self._stiffness = np.array([s.stiffness for s in springs])
        self._rest = np.array([s.rest for s in springs])
        damping = np.array([s.damping for s in springs])
        # efforts are linear in q and v: constant, stiffness and damping matrix of all joint springs together
        self._effort_constant = from_v.T @ (self._stiffness * self._rest)
        self._effort_q = -from_v.T @ (self._stiffness[:, None] * self._from_q)
        self._effort_v = -from_v.T @ (damping[:, None] * from_v)

    def efforts(self, q: Array, v: Array) -> Array:
        """Generalised forces of the joint springs, shape (nv,)."""
        return np.asarray(self._effort_constant + self._effort_q @ q + self._effort_v @ v)

    def effort_wrench(self, joint: int, tau: Array) -> Array:
        """Part of the wrench through a joint of the mechanism that is its springs', shape (6,): force, torque.

        It acts on the link behind the joint, in that link's axes: all elementary joints of a sprung joint share z.
        """
        wrench = np.zeros(6)
        for slot, index in {(slot, index) for k, slot, index in self._joint_slots if k == joint}:
            wrench[slot] += tau[index]
        return wrench

    def wrenches(self) -> Array:
        """Wrenches of springs and loads on the links, shape (n_links + 1, 6), the last row being the ground's.

        Force, then torque about the origin of the joint that carries the link, in the axes of that joint. Pinocchio's
        data must hold placements and velocities (`pinocchio.forwardKinematics`).
        """
        W = self._constant.copy()
        for link, (to_wrench, rotation) in self._world.items():
            W[link] += to_wrench @ rotation
        for spring, i, j in self._springs:
            d = j.position() - i.position()
            length = math.sqrt(d @ d)
            e = d / length
            tension = spring.stiffness * (length - spring.free_length)
            if spring.damping:
                tension += spring.damping * float(e @ (j.velocity() - i.velocity()))
            force = tension * e
            if i.link >= 0:
                W[i.link] += i.force @ (i.R_WJ.T @ force)
            if j.link >= 0:
                W[j.link] -= j.force @ (j.R_WJ.T @ force)
        return W

    def potential(self, q: Array) -> float:
        """Potential energy of springs and joint springs in J, at Pinocchio's current placements."""
        energy = 0.5 * float(self._stiffness @ (self._from_q @ q - self._rest) ** 2)
        for spring, i, j in self._springs:
            length = float(np.linalg.norm(j.position() - i.position()))
            energy += 0.5 * spring.stiffness * (length - spring.free_length) ** 2
        return energy
