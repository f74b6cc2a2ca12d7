"""Translation of a mechanism into a Pinocchio model: joints depth first, welded links merged, split bodies welded.

Pinocchio's conventions: linear part first in `Motion` and `Force`, quaternions scalar last, spatial quantities of a
joint in the axes of the joint's moving frame and about its origin, inertia about the centre of mass.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from consilience.engine import without_screws
from consilience.mechanism import (
    Array,
    Coordinate,
    Frame,
    Joint,
    Link,
    Mechanism,
    State,
    Tree,
    coordinates,
    cross,
    full_turns,
    relative_motion,
    rotation_from_quaternion,
    to_elementary_tree,
)

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

_TURN = 2.0 * math.pi

_SPLIT = "TS"
"""A free joint as a translation of the centre of mass and a ball."""

_JOINT_MODELS: dict[str, Any] = {
    "R": pin.JointModelRZ,
    "P": pin.JointModelPZ,
    "S": pin.JointModelSpherical,
    "F": pin.JointModelFreeFlyer,
}


@dataclass(frozen=True, eq=False)
class Seat:
    """Place of a link in the Pinocchio model.

    Attributes
    ----------
    joint : int
        Pinocchio joint that carries the link; 0 is the universe.
    placement : pinocchio.SE3
        Frame of the link in the moving frame of the joint; the identity unless the link is welded to its parent.
    """

    joint: int
    placement: Any


@dataclass(frozen=True, eq=False)
class Translation:
    """Pinocchio model of a mechanism.

    Attributes
    ----------
    mechanism, plain : Mechanism
        The given mechanism, and the same with revolute joints in place of screws.
    tree : Tree
        Tree of `plain`. A screw is one joint in Pinocchio as well (``JointModelHZ``).
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
        """Return joint and placement of frame B of a body (of the original of a split body); the universe for -1."""
        link = self.tree.carrier(body)
        return Seat(0, pin.SE3.Identity()) if link < 0 else _body_seat(self.tree.links[link], self.seats[link])


def _se3(frame: Frame) -> Any:
    return pin.SE3(np.array(frame.R), np.array(frame.p))


def _body_seat(link: Link, seat: Seat) -> Seat:
    return Seat(seat.joint, seat.placement * _se3(link.body_frame))


def link_inertia(link: Link) -> Any:
    """Return the inertia of a link in its own frame, as `pinocchio.Inertia`."""
    return pin.Inertia(link.mass, np.array(link.com), np.array(link.inertia))


def _joint_model(joint: Joint, link: Link) -> Any:
    """Pinocchio's joint for an elementary joint; the pitch of a screw is in m/rad, the same in both senses."""
    return pin.JointModelHZ(joint.pitch / _TURN) if joint.pitch else _JOINT_MODELS[link.elementary]()


def _motion(mechanism: Mechanism, link: Link) -> str:
    """Kind of a link's elementary joint; a free joint is split beside contacts, at the centre of mass.

    A step ``v + h a`` in the body's axes, as a free-flyer has them, turns the velocity of a rolling body with the body;
    a step of another point than the centre of mass goes straight where the point turns. Both are errors in the first
    order of h, by which a body in free flight leaves its parabola.
    """
    return _SPLIT if link.elementary == "F" and mechanism.contacts else link.elementary


def _jointed(model: Any, parent: int, placement: Any, mechanism: Mechanism, link: Link) -> Seat:
    """Add the joint of a link behind a placement on its parent."""
    if _motion(mechanism, link) != _SPLIT:
        joint_model = _joint_model(mechanism.joints[link.joint], link)
        return Seat(model.addJoint(parent, joint_model, placement, link.name), pin.SE3.Identity())
    center = model.addJoint(parent, pin.JointModelTranslation(), placement, f"centre of {link.name}")
    turning = model.addJoint(center, pin.JointModelSpherical(), pin.SE3.Identity(), link.name)
    return Seat(turning, pin.SE3(np.eye(3), -np.array(link.com)))


def translate(mechanism: Mechanism) -> Translation:
    """Build the Pinocchio model of a mechanism.

    Raises
    ------
    RuntimeError
        Pinocchio's own check of the model fails. With joints out of depth-first order `crba` is silently wrong.
    """
    plain = without_screws(mechanism, "revolute")
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
            seat = _jointed(model, parent.joint, placement, mechanism, link)
        model.appendBodyToJoint(seat.joint, link_inertia(link), seat.placement)
        seats.append(seat)
    data = model.createData()
    if not model.check(data):
        raise RuntimeError("Pinocchio's Model.check refuses the translated model")
    welds = tuple(
        (_body_seat(tree.links[w.original], seats[w.original]), _body_seat(tree.links[w.copy], seats[w.copy]))
        for w in tree.welds
    )
    held = [rigid_contact("CONTACT_6D", model, a.joint, a.placement, b.joint, b.placement) for a, b in welds]
    constraints, constraint_data = initialised(model, data, held)
    return Translation(mechanism, plain, tree, model, data, tuple(seats), welds, constraints, constraint_data)


def as_matrix(J: Any, model: Any) -> Array:
    """Return a Jacobian of Pinocchio's with shape (rows, nv); which come 1-D for one row or column."""
    return np.asarray(J).reshape(-1, model.nv)


def rigid_contact(kind: str, model: Any, *ends: Any) -> Any:
    """Return a constraint of a `pinocchio.ContactType`; the ends are joint 1, placement 1, joint 2, placement 2."""
    return pin.RigidConstraintModel(getattr(pin.ContactType, kind), model, *ends, pin.ReferenceFrame.LOCAL)


def initialised(model: Any, data: Any, contacts: Iterable[Any]) -> tuple[Any, Any]:
    """Return constraints and their data as Pinocchio's vectors, after ``initConstraintDynamics``."""
    models, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for contact in contacts:
        models.append(contact)
        contact_data.append(contact.createData())
    pin.initConstraintDynamics(model, data, models, contact_data)
    return models, contact_data


def _no_coordinate(c: Coordinate) -> tuple[list[float], list[float]]:
    return [], []


def _scalar(c: Coordinate) -> tuple[list[float], list[float]]:
    return [c.q], [c.rate]


def _ball(c: Coordinate) -> tuple[list[float], list[float]]:
    assert c.quat is not None
    assert c.w is not None
    return [*c.quat[1:], c.quat[0]], [*c.w]


def _free(c: Coordinate) -> tuple[list[float], list[float]]:
    """Position and velocity of a free-flyer; velocities are in axes of the moving frame, linear first."""
    assert c.p is not None
    assert c.v is not None
    quat, w = _ball(c)
    R = rotation_from_quaternion(c.quat)  # type: ignore[arg-type]  # _ball has seen that it is there
    return [*c.p, *quat], [*(R.T @ c.v), *w]


def _split(c: Coordinate) -> tuple[list[float], list[float]]:
    """Position and velocity of a translation, in axes of the parent, with a ball behind it."""
    assert c.p is not None
    assert c.v is not None
    quat, w = _ball(c)
    return [*c.p, *quat], [*c.v, *w]


def _of_center(c: Coordinate, com: Array) -> Coordinate:
    """Return the coordinates of a free joint for the centre of mass, given in axes of the link."""
    R = rotation_from_quaternion(c.quat)  # type: ignore[arg-type]  # a free joint has all
    return replace(c, p=c.p + R @ com, v=c.v + R @ cross(c.w, com))  # type: ignore[operator,arg-type]


_COORDINATES = {"R": _scalar, "P": _scalar, "S": _ball, "F": _free, _SPLIT: _split, "W": _no_coordinate}


def configuration(translation: Translation, state: State) -> tuple[Any, Any]:
    """Compute Pinocchio's configuration q, shape (nq,), and velocity v, shape (nv,), of a state.

    Angles are in (-pi, pi], except those of screws, whose full turns follow from the displacement.
    """
    mechanism, tree = translation.mechanism, translation.tree
    q: list[float] = []
    v: list[float] = []
    for link, coordinate in zip(tree.links, coordinates(translation.plain, tree, state), strict=True):
        kind = _motion(mechanism, link)
        q_link, v_link = _COORDINATES[kind](_of_center(coordinate, link.com) if kind == _SPLIT else coordinate)
        joint = mechanism.joints[link.joint]
        if joint.pitch:
            displacement = float(relative_motion(mechanism, state, joint).p[2])
            q_link = [full_turns(q_link[0], (-1.0 if link.reversed else 1.0) * _TURN * displacement / joint.pitch)]
        q += q_link
        v += v_link
    return np.array(q), np.array(v)
