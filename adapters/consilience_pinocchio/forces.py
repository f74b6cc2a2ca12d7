"""Springs and loads, which Pinocchio lacks, as wrenches on the links from Pinocchio's placements and velocities.

Constants are prepared once, and an evaluation uses small matrix products only, because it is in the innermost loop of
an integration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import Array, Function, Load, skew, spring_force
from consilience_pinocchio.translate import Translation


@dataclass(frozen=True, eq=False)
class Point:
    """Point of a body in terms of Pinocchio.

    Attributes
    ----------
    link : int
        Link that carries the point; -1 is the ground.
    joint : int
        Pinocchio joint that carries the link.
    p : ndarray, shape (3,), m
        Point from the origin of the joint's moving frame, in its axes.
    force : ndarray, shape (6, 3)
        Wrench (force, torque about the joint's origin) of a force at the point, all in the axes of the joint.
    R_WJ, p_WJ, twist : ndarray, shape (3, 3), (3,) and (6,)
        Pose and spatial velocity of the joint: views of Pinocchio's data, which change with every evaluation.
    """

    link: int
    joint: int
    p: Array
    force: Array
    R_WJ: Array
    p_WJ: Array
    twist: Array

    def position(self) -> Array:
        """Return the world position in m, shape (3,)."""
        return np.asarray(self.p_WJ + self.R_WJ @ self.p)

    def velocity(self) -> Array:
        """Return the world velocity in m/s, shape (3,)."""
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


@dataclass(frozen=True, eq=False)
class _Push:
    """Load as a wrench in axes of the joint: ``matrix @ view``, times a function of time.

    A vector f fixed in the world is R^T f in axes of the joint, linear in the nine entries of R^T; `view` is a view of
    them. For a vector fixed in the body `matrix` is the wrench, shape (6, 1), and `view` is 1.
    """

    link: int
    matrix: Array
    view: Array
    history: Function | None


class Forces:
    """Springs and loads of a mechanism, evaluated at Pinocchio's current kinematics.

    Attributes
    ----------
    active : bool
        Whether there are springs or loads, so that `wrenches` has to be called.
    loaded : tuple of (int, int)
        Links with springs or loads, and their joints, without links on the ground.
    """

    def __init__(self, translation: Translation) -> None:
        mechanism = translation.mechanism
        self._translation = translation
        self._springs = [
            (
                s,
                _point(translation, s.predecessor, s.point_predecessor),
                _point(translation, s.successor, s.point_successor),
                s.actuator,
            )
            for s in mechanism.springs
        ]
        # one row more than links: the last row takes wrenches on the ground (link -1) and is not read
        self._constant = np.zeros((len(translation.tree.links) + 1, 6))
        self._pushes: list[_Push] = []
        for load in mechanism.loads:
            self._add_load(load)
        points = [p for _, i, j, _ in self._springs for p in (i, j)]
        points += [_point(translation, load.body, load.point) for load in mechanism.loads]
        self.loaded = tuple(sorted({(p.link, p.joint) for p in points if p.joint > 0}))
        self.active = bool(points)

    def _add_load(self, load: Load) -> None:
        translation = self._translation
        point = _point(translation, load.body, load.point)
        to_wrench = point.force if load.kind == "force" else np.vstack([np.zeros((3, 3)), np.eye(3)])
        history = load.history
        if load.frame == "world":
            matrix, view = to_wrench @ np.kron(np.eye(3), load.vector), point.R_WJ.T.reshape(9)
        else:
            R = translation.body_seat(translation.mechanism.body_index[load.body]).placement.rotation
            wrench = to_wrench @ (R @ load.vector)
            if history is None:
                self._constant[point.link] += wrench
                return
            matrix, view = wrench[:, None], np.ones(1)
        if history is None:  # constant loads of a link are merged into one
            for push in [push for push in self._pushes if push.history is None and push.link == point.link]:
                self._pushes.remove(push)
                matrix = matrix + push.matrix
        self._pushes.append(_Push(point.link, matrix, view, history))

    def wrenches(self, t: float = 0.0) -> Array:
        """Return the wrenches of springs and loads on the links, shape (n_links + 1, 6); the last row is the ground's.

        A wrench is the force, then the torque about the origin of the link's joint, in axes of the joint.
        Pinocchio's data must hold placements and velocities (`pinocchio.forwardKinematics`).
        """
        W = self._constant.copy()
        for push in self._pushes:
            wrench = push.matrix @ push.view
            W[push.link] += wrench if push.history is None else push.history.jet(t)[0] * wrench
        for spring, i, j, actuator in self._springs:
            apart = 0.0 if actuator is None else actuator.jet(t)[0]
            force = spring_force(spring.law, apart, j.position() - i.position(), j.velocity() - i.velocity())
            if i.link >= 0:
                W[i.link] += i.force @ (i.R_WJ.T @ force)
            if j.link >= 0:
                W[j.link] -= j.force @ (j.R_WJ.T @ force)
        return W

    def potential(self) -> float:
        """Return the potential energy of the springs in J, at Pinocchio's current placements."""
        energy = 0.0
        for spring, i, j, _ in self._springs:
            length = float(np.linalg.norm(j.position() - i.position()))
            energy += 0.5 * spring.stiffness * (length - spring.free_length) ** 2
        return energy
