"""Translation of a mechanism into one DART skeleton, by way of the tree of elementary joints.

Each link of the tree becomes one body node. The frame of the node is the frame of the link and coincides with the joint
frame, so that ``T_ChildBodyToJoint`` is the identity everywhere. Massless links become body nodes of zero mass. The
dynamics stays exact: DART inverts no node's inertia, only the projection of an articulated inertia on a joint, and a
link with mass hangs behind each massless link. The tree is built with revolute joints in place of screws; DART's
`ScrewJoint` takes their place, whose coordinate is the angle and whose pitch is the advance in a turn.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import dartpy
import numpy as np

from consilience.engine import axis_link, merged_spring, without_screws
from consilience.mechanism import (
    AXIS_COORDINATES,
    Array,
    Coupling,
    Frame,
    JointSpring,
    Link,
    Mechanism,
    Rolling,
    Skate,
    Tree,
    to_elementary_tree,
)

Z = np.array([0.0, 0.0, 1.0])

CREATORS = {
    "R": "createRevoluteJointAndBodyNodePair",
    "P": "createPrismaticJointAndBodyNodePair",
    "S": "createBallJointAndBodyNodePair",
    "F": "createFreeJointAndBodyNodePair",
    "W": "createWeldJointAndBodyNodePair",
}
FREEDOM = {"R": 1, "P": 1, "S": 3, "F": 6, "W": 0}
SCREW = "createScrewJointAndBodyNodePair"


@dataclass(frozen=True, eq=False)
class Axis:
    """Coordinate of a joint of the mechanism in terms of the skeleton.

    Attributes
    ----------
    joint : dartpy Joint
    index : int
        Index of the coordinate in the skeleton.
    sign : float
        -1 where the tree passes the joint backwards: the skeleton's coordinate is the negative one.
    turns : bool
        The coordinate is an angle.
    """

    joint: Any
    index: int
    sign: float
    turns: bool

    @property
    def value(self) -> float:
        """Coordinate in rad or m; DART does not wrap angles, so that full turns are counted."""
        return self.sign * float(self.joint.getPosition(0))

    @property
    def rate(self) -> float:
        """Rate of the coordinate in rad/s or m/s."""
        return self.sign * float(self.joint.getVelocity(0))


@dataclass(frozen=True, eq=False)
class Model:
    """Skeleton of a mechanism.

    Attributes
    ----------
    mechanism : Mechanism
    lowered : Mechanism
        The mechanism with revolute joints in place of screws, from which `tree` is built.
    tree : Tree
    skeleton : dartpy Skeleton
    nodes, joints : list
        Body node, and its parent joint, of each link of `tree`.
    start : list of int
        Index of the first coordinate of each link in the skeleton; -1 for a welded link.
    carriers : list of int
        Link that carries the original of each body of the mechanism.
    axes : dict
        Coordinates of all joints with one axis, by names of joint and coordinate.
    spring_offset : float, J
        Constant that DART's spring energy lacks where several springs on one joint were merged.
    """

    mechanism: Mechanism
    lowered: Mechanism
    tree: Tree
    skeleton: Any
    nodes: list[Any]
    joints: list[Any]
    start: list[int]
    carriers: list[int]
    axes: dict[tuple[str, str], Axis]
    spring_offset: float


@contextmanager
def quiet() -> Iterator[None]:
    """Silence the standard error of native code, where DART warns of every massless link."""
    saved = os.dup(2)
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(sink)


def unstepped(mechanism: Mechanism) -> dict[str, str]:
    """Return the kinds of constraints that `World.step` cannot hold, each with the name of its first element."""
    groups: dict[str, tuple[Coupling | Rolling | Skate, ...]] = {
        "coupling": mechanism.couplings,
        "rolling": mechanism.rollings,
        "skate": mechanism.skates,
    }
    return {what: elements[0].name for what, elements in groups.items() if elements}


def constrained(mechanism: Mechanism, tree: Tree) -> bool:
    """Whether the mechanism has constraints beside drives, which a skeleton holds as acceleration actuators."""
    return bool(tree.welds or unstepped(mechanism))


def set_inertia(node: Any, mass: float, com: Array, moment: Array) -> None:
    """Set the inertia of a node; `moment` is about the centre of mass, in axes of the node."""
    if mass > 0.0:
        node.setInertia(dartpy.dynamics.Inertia(mass, com, moment))
        return
    with quiet():
        node.setInertia(dartpy.dynamics.Inertia(0.0, np.zeros(3), np.zeros((3, 3))))


def _add_link(skeleton: Any, parent: Any, link: Link, pitch: float) -> tuple[Any, Any]:
    joint, node = getattr(skeleton, SCREW if pitch else CREATORS[link.elementary])(parent)
    node.setName(link.name)
    joint.setName(f"to {link.name}")
    set_inertia(node, link.mass, link.com, link.inertia)
    if link.elementary in ("R", "P"):
        joint.setAxis(Z)
    if pitch:
        joint.setPitch(pitch)
    if link.elementary != "F":  # a free joint keeps the identity: with other frames its velocities have another basis
        transform = dartpy.math.Isometry3()
        transform.set_rotation(link.placement.R)
        transform.set_translation(link.placement.p)
        joint.setTransformFromParentBodyNode(transform)
    return joint, node


def sprung(mechanism: Mechanism, tree: Tree) -> dict[int, list[JointSpring]]:
    """Group the joint springs by the link whose coordinate they act on."""
    found: dict[int, list[JointSpring]] = {}
    for spring in mechanism.joint_springs:
        link, _ = axis_link(mechanism, tree, spring.joint, spring.coordinate)
        found.setdefault(link, []).append(spring)
    return found


def own_part(spring: JointSpring) -> JointSpring:
    """Return the linear part of a joint spring that DART's joint has: of one that is not linear, nothing below zero."""
    if spring.is_linear:
        return spring
    return replace(spring, stiffness=max(spring.stiffness, 0.0), damping=max(spring.damping, 0.0))


def remainder(spring: JointSpring) -> JointSpring:
    """Return what a joint spring has beside its actuator and its `own_part`."""
    own = own_part(spring)
    stiffness, damping = spring.stiffness - own.stiffness, spring.damping - own.damping
    return replace(spring, actuator=None, stiffness=stiffness, damping=damping)


def _add_joint_springs(mechanism: Mechanism, tree: Tree, joints: list[Any]) -> float:
    """Give DART's joints their springs and dampers; return the energy that merging several on one joint loses."""
    offset = 0.0
    for i, springs in sprung(mechanism, tree).items():
        stiffness, damping, rest, lost = merged_spring([own_part(spring) for spring in springs])
        joints[i].setSpringStiffness(0, stiffness)
        joints[i].setDampingCoefficient(0, damping)
        joints[i].setRestPosition(0, -rest if tree.links[i].reversed else rest)
        offset += lost
    return offset


def _axes(mechanism: Mechanism, tree: Tree, joints: list[Any], start: list[int]) -> dict[tuple[str, str], Axis]:
    axes = {}
    for joint in mechanism.joints:
        for coordinate in AXIS_COORDINATES.get(joint.kind, ()):
            i, sign = axis_link(mechanism, tree, joint.name, coordinate)
            axes[joint.name, coordinate] = Axis(joints[i], start[i], sign, coordinate == "angle")
    return axes


def _centred(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with frames of free joints at the centres of mass of their bodies.

    A step of DART moves the origin of a free joint straight: with another origin a body that turns leaves its parabola.
    """

    def at_center(body: str, frame: Frame) -> Frame:
        index = mechanism.body_index[body]
        return frame if index < 0 else Frame(mechanism.bodies[index].com, frame.R)

    joints = tuple(
        replace(j, F=at_center(j.predecessor, j.F), M=at_center(j.successor, j.M)) if j.kind == "free" else j
        for j in mechanism.joints
    )
    return replace(mechanism, joints=joints)


def build(mechanism: Mechanism) -> Model:
    """Build the skeleton of a mechanism, with time step zero so that joint springs act at the present state."""
    lowered = without_screws(mechanism, "revolute")
    if mechanism.contacts:
        lowered = _centred(lowered)
    tree = to_elementary_tree(lowered)
    skeleton = dartpy.dynamics.Skeleton(mechanism.name)
    skeleton.setGravity(mechanism.gravity)
    skeleton.setTimeStep(0.0)
    nodes: list[Any] = []
    joints: list[Any] = []
    for link in tree.links:
        parent = nodes[link.parent] if link.parent >= 0 else None
        joint, node = _add_link(skeleton, parent, link, mechanism.joints[link.joint].pitch)
        joints.append(joint)
        nodes.append(node)
    offset = _add_joint_springs(mechanism, tree, joints)
    start = [
        joint.getIndexInSkeleton(0) if FREEDOM[link.elementary] else -1
        for joint, link in zip(joints, tree.links, strict=True)
    ]
    carriers = [tree.carrier(b) for b in range(len(mechanism.bodies))]
    axes = _axes(mechanism, tree, joints, start)
    for drive in mechanism.drives:
        axes[drive.joint, drive.coordinate].joint.setActuatorType(dartpy.dynamics.ActuatorType.ACCELERATION)
    return Model(mechanism, lowered, tree, skeleton, nodes, joints, start, carriers, axes, offset)
