"""From a mechanism to a Pinocchio model: joints in depth-first order, welded links merged, split bodies welded.

Pinocchio's conventions: linear part first in `Motion` and `Force`, quaternions scalar last, spatial quantities of a
joint in the axes of the joint's moving frame and about its origin, inertia about the centre of mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.mechanism import (
    Coordinate,
    Frame,
    Joint,
    Link,
    Mechanism,
    State,
    Tree,
    coordinates,
    full_turns,
    relative_motion,
    rotation_from_quaternion,
    to_elementary_tree,
)

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

_TURN = 2.0 * math.pi

_JOINT_MODELS: dict[str, Any] = {
    "R": pin.JointModelRZ,
    "P": pin.JointModelPZ,
    "S": pin.JointModelSpherical,
    "F": pin.JointModelFreeFlyer,
}


@dataclass(frozen=True, eq=False)
class Seat:
    """Where a link sits in the Pinocchio model.

    Attributes
    ----------
    joint : int
        Pinocchio joint that carries the link; 0 is the universe.
    placement : pinocchio.SE3
        Frame of the link in the moving frame of that joint; the identity unless the link is welded to its parent.
    """

    joint: int
    placement: Any


@dataclass(frozen=True, eq=False)
class Translation:
    """A mechanism in Pinocchio's terms.

    Attributes
    ----------
    mechanism, plain : Mechanism
        As given, and with a revolute in the place of each screw.
    tree : Tree
        Of `plain`: a screw is one elementary joint, too, which Pinocchio has (``JointModelHZ``).
    model, data : pinocchio.Model, pinocchio.Data
    seats : tuple of Seat
        One for each link of `tree`.
    welds : tuple of (Seat, Seat)
        Joint and placement of frame B of the original and of the copy of each split body.
    constraints, constraint_data : pinocchio.StdVec_RigidConstraintModel, pinocchio.StdVec_RigidConstraintData
        One CONTACT_6D for each weld, without Baumgarte correction; frame 1 is B of the original.
    """

    mechanism: Mechanism
    plain: Mechanism
    tree: Tree
    model: Any
    data: Any
    seats: tuple[Seat, ...]
    welds: tuple[tuple[Seat, Seat], ...]
    constraints: Any
    constraint_data: Any

    def body_seat(self, body: int) -> Seat:
        """Joint and placement of frame B of a body (of its original, if it is split); the universe for -1."""
        link = self.tree.carrier(body)
        return Seat(0, pin.SE3.Identity()) if link < 0 else _body_seat(self.tree.links[link], self.seats[link])


def _se3(frame: Frame) -> Any:
    return pin.SE3(np.array(frame.R), np.array(frame.p))


def _body_seat(link: Link, seat: Seat) -> Seat:
    return Seat(seat.joint, seat.placement * _se3(link.body_frame))


def link_inertia(link: Link) -> Any:
    """Inertia of a link in its own frame, as `pinocchio.Inertia`."""
    return pin.Inertia(link.mass, np.array(link.com), np.array(link.inertia))


def _without_screws(mechanism: Mechanism) -> Mechanism:
    if not any(joint.pitch for joint in mechanism.joints):
        return mechanism
    joints = [replace(joint, kind="revolute", pitch=0.0) if joint.pitch else joint for joint in mechanism.joints]
    return replace(mechanism, joints=tuple(joints))


def _joint_model(joint: Joint, link: Link) -> Any:
    """Elementary joint; of a screw, passed in either sense, the pitch in m/rad."""
    return pin.JointModelHZ(joint.pitch / _TURN) if joint.pitch else _JOINT_MODELS[link.elementary]()


def translate(mechanism: Mechanism) -> Translation:
    """Build the Pinocchio model of a mechanism.

    Raises
    ------
    RuntimeError
        If Pinocchio's own check of the model fails; with joints out of depth-first order `crba` is silently wrong.
    """
    plain = _without_screws(mechanism)
    tree = to_elementary_tree(plain)
    model = pin.Model()
    model.gravity = pin.Motion(np.array(mechanism.gravity), np.zeros(3))
    seats: list[Seat] = []
    for link in tree.links:
        parent = Seat(0, pin.SE3.Identity()) if link.parent < 0 else seats[link.parent]
        placement = parent.placement * _se3(link.placement)
        if link.elementary == "W":
            seat = Seat(parent.joint, placement)
        else:
            joint_model = _joint_model(mechanism.joints[link.joint], link)
            joint = model.addJoint(parent.joint, joint_model, placement, link.name)
            seat = Seat(joint, pin.SE3.Identity())
        model.appendBodyToJoint(seat.joint, link_inertia(link), seat.placement)
        seats.append(seat)
    data = model.createData()
    if not model.check(data):
        raise RuntimeError("Pinocchio's Model.check refuses the translated model")
    welds = tuple(
        (_body_seat(tree.links[w.original], seats[w.original]), _body_seat(tree.links[w.copy], seats[w.copy]))
        for w in tree.welds
    )
    constraints, constraint_data = _rigid_constraints(model, data, welds)
    return Translation(mechanism, plain, tree, model, data, tuple(seats), welds, constraints, constraint_data)


def _rigid_constraints(model: Any, data: Any, welds: tuple[tuple[Seat, Seat], ...]) -> tuple[Any, Any]:
    constraints, constraint_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for original, copy in welds:
        constraint = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_6D,
            model,
            original.joint,
            original.placement,
            copy.joint,
            copy.placement,
            pin.ReferenceFrame.LOCAL,
        )
        constraints.append(constraint)
        constraint_data.append(constraint.createData())
    pin.initConstraintDynamics(model, data, constraints, constraint_data)
    return constraints, constraint_data


def _no_coordinate(c: Coordinate) -> tuple[list[float], list[float]]:
    return [], []


def _scalar(c: Coordinate) -> tuple[list[float], list[float]]:
    return [c.q], [c.rate]


def _ball(c: Coordinate) -> tuple[list[float], list[float]]:
    assert c.quat is not None
    assert c.w is not None
    return [*c.quat[1:], c.quat[0]], [*c.w]


def _free(c: Coordinate) -> tuple[list[float], list[float]]:
    """Free-flyer velocities are those of the moving frame in its own axes, linear first."""
    assert c.p is not None
    assert c.v is not None
    quat, w = _ball(c)
    R = rotation_from_quaternion(c.quat)  # type: ignore[arg-type]  # _ball has seen that it is there
    return [*c.p, *quat], [*(R.T @ c.v), *w]


_COORDINATES = {"R": _scalar, "P": _scalar, "S": _ball, "F": _free, "W": _no_coordinate}


def configuration(translation: Translation, state: State) -> tuple[Any, Any]:
    """Pinocchio's configuration q, shape (nq,), and velocity v, shape (nv,), of a state.

    Angles are in (-pi, pi], but for those of screws, whose turns are those of their displacements.
    """
    mechanism, tree = translation.mechanism, translation.tree
    q: list[float] = []
    v: list[float] = []
    for link, coordinate in zip(tree.links, coordinates(translation.plain, tree, state), strict=True):
        q_link, v_link = _COORDINATES[link.elementary](coordinate)
        joint = mechanism.joints[link.joint]
        if joint.pitch:
            displacement = float(relative_motion(mechanism, state, joint).p[2])
            q_link = [full_turns(q_link[0], (-1.0 if link.reversed else 1.0) * _TURN * displacement / joint.pitch)]
        q += q_link
        v += v_link
    return np.array(q), np.array(v)
