"""Springs, joint springs and loads, which Pinocchio does not have: wrenches and joint efforts from its kinematics.

Everything that does not change is prepared once, and the evaluations use small matrix products only: they stand in
the innermost loop of an integration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.mechanism import JointSpring, Load, Spring
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
    """

    link: int
    joint: int
    p: Array
    force: Array


def _point(translation: Translation, body: str, point: Array) -> Point:
    index = translation.mechanism.body_index[body]
    seat = translation.body_seat(index)
    p = seat.placement.act(np.array(point))
    return Point(translation.tree.carrier(index), seat.joint, p, np.vstack([np.eye(3), skew(p)]))


class Forces:
    """Force elements of a mechanism, evaluated at Pinocchio's current kinematics.

    Attributes
    ----------
    active : bool
        Whether there are springs or loads, so that `wrenches` is worth a call.
    loaded : tuple of (int, int)
        Links and their joints that can bear a wrench.
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
        self._world: list[tuple[Point, Array, Array]] = []
        for load in mechanism.loads:
            self._add_load(load)
        points = [p for _, i, j in self._springs for p in (i, j)]
        points += [_point(translation, load.body, load.point) for load in mechanism.loads]
        self.loaded = tuple(sorted({(p.link, p.joint) for p in points if p.link >= 0}))
        self.active = bool(points)
        self._prepare_joint_springs(mechanism.joint_springs)
        self.sprung = bool(mechanism.joint_springs)

    def _add_load(self, load: Load) -> None:
        translation = self._translation
        point = _point(translation, load.body, load.point)
        to_wrench = point.force if load.kind == "force" else np.vstack([np.zeros((3, 3)), np.eye(3)])
        if load.frame == "world":
            self._world.append((point, to_wrench, load.vector))
        else:
            R = translation.body_seat(translation.mechanism.body_index[load.body]).placement.rotation
            self._constant[point.link] += to_wrench @ (R @ load.vector)

    def _prepare_joint_springs(self, springs: tuple[JointSpring, ...]) -> None:
        """Rows that pick the joint coordinate of each spring out of q and v; a joint passed backwards turns round."""
        translation = self._translation
        model, tree = translation.model, translation.tree
        self._from_q, self._from_v = np.zeros((len(springs), model.nq)), np.zeros((len(springs), model.nv))
        self._joint_slots: list[tuple[int, int, int]] = []
        for n, spring in enumerate(springs):
            k = translation.mechanism.joint_index[spring.joint]
            elementary, slot = ("R", 5) if spring.coordinate == "angle" else ("P", 2)
            link = next(i for i, li in enumerate(tree.links) if li.joint == k and li.elementary == elementary)
            joint = translation.seats[link].joint
            sign = -1.0 if tree.links[link].reversed else 1.0
            self._from_q[n, model.joints[joint].idx_q] = sign
            self._from_v[n, model.joints[joint].idx_v] = sign
            self._joint_slots.append((k, slot, model.joints[joint].idx_v))
        self._stiffness = np.array([s.stiffness for s in springs])
        self._damping = np.array([s.damping for s in springs])
        self._rest = np.array([s.rest for s in springs])

    def efforts(self, q: Array, v: Array) -> Array:
        """Generalised forces of the joint springs, shape (nv,)."""
        moments = self._stiffness * (self._from_q @ q - self._rest) + self._damping * (self._from_v @ v)
        return np.asarray(-(moments @ self._from_v))

    def effort_wrench(self, joint: int, tau: Array) -> Array:
        """Part of the wrench through a joint of the mechanism that is its springs', shape (6,): force, torque.

        It acts on the link behind the joint, in that link's axes: all elementary joints of a sprung joint share z.
        """
        wrench = np.zeros(6)
        for slot, index in {(slot, index) for k, slot, index in self._joint_slots if k == joint}:
            wrench[slot] += tau[index]
        return wrench

    def wrenches(self, data: Any) -> Array:
        """Wrenches of springs and loads on the links, shape (n_links + 1, 6), the last row being the ground's.

        Force, then torque about the origin of the joint that carries the link, in the axes of that joint. `data`
        must hold placements and velocities (`pinocchio.forwardKinematics`).
        """
        W = self._constant.copy()
        for point, to_wrench, vector in self._world:
            W[point.link] += to_wrench @ (data.oMi[point.joint].rotation.T @ vector)
        for spring, i, j in self._springs:
            R_i, p_i, v_i = _motion(data, i)
            R_j, p_j, v_j = _motion(data, j)
            d = p_j - p_i
            length = float(np.sqrt(d @ d))
            e = d / length
            force = (spring.stiffness * (length - spring.free_length) + spring.damping * (e @ (v_j - v_i))) * e
            W[i.link] += i.force @ (R_i.T @ force)
            W[j.link] -= j.force @ (R_j.T @ force)
        return W

    def potential(self, data: Any, q: Array) -> float:
        """Potential energy of springs and joint springs in J, at Pinocchio's current placements."""
        energy = sum(_spring_energy(data, *row) for row in self._springs)
        return energy + 0.5 * float(self._stiffness @ (self._from_q @ q - self._rest) ** 2)


def _motion(data: Any, point: Point) -> tuple[Array, Array, Array]:
    """World rotation of the joint's moving frame, world position and velocity of the point."""
    placement = data.oMi[point.joint]
    R = placement.rotation
    return R, placement.translation + R @ point.p, R @ (point.force.T @ data.v[point.joint].vector)


def _spring_energy(data: Any, spring: Spring, i: Point, j: Point) -> float:
    length = float(np.linalg.norm(_motion(data, j)[1] - _motion(data, i)[1]))
    return 0.5 * spring.stiffness * (length - spring.free_length) ** 2
