"""Translation of a mechanism into one DART skeleton, by way of the tree of elementary joints.

Each link of the tree is one body node whose frame is the link's frame; the joint frame coincides with it, so
``T_ChildBodyToJoint`` is the identity everywhere. Massless links are body nodes of zero mass: exact, for DART never
inverts the inertia of a node, only its projection on the joint, and a link with mass hangs behind each of them.
The tree knows no screws: it is that of the mechanism with revolute joints in their place, and these become DART's
`ScrewJoint`, whose coordinate is the angle and whose pitch is the advance in a turn, as ours is.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import dartpy
import numpy as np

from consilience.mechanism import (
    AXIS_COORDINATES,
    Array,
    Coupling,
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
ELEMENTARY = {"angle": "R", "distance": "P"}  # joint coordinate -> elementary joint that has it
SCREW = "createScrewJointAndBodyNodePair"


@dataclass(frozen=True, eq=False)
class Axis:
    """A coordinate of a joint of the mechanism as a coordinate of the skeleton, or its negative.

    Attributes
    ----------
    joint : dartpy Joint
    index : int
        Of the coordinate in the skeleton.
    sign : float
        -1 where the tree passes the joint backwards.
    turns : bool
        Whether it is an angle.
    """

    joint: Any
    index: int
    sign: float
    turns: bool

    @property
    def value(self) -> float:
        """Coordinate in rad or m; the angle over full turns, for DART never wraps it."""
        return self.sign * float(self.joint.getPosition(0))

    @property
    def rate(self) -> float:
        """Its rate."""
        return self.sign * float(self.joint.getVelocity(0))


@dataclass(frozen=True, eq=False)
class Model:
    """A mechanism as DART holds it.

    Attributes
    ----------
    lowered : Mechanism
        The mechanism with revolute joints in place of screws, as `tree` describes it.
    skeleton : dartpy Skeleton
    nodes, joints : list
        Body node and its parent joint of each link of `tree`.
    start : list of int
        Index of each link's first coordinate in the skeleton.
    carriers : list of int
        Link that carries the original of each body of the mechanism.
    axes : dict
        Coordinates of all joints with one axis, by joint and name.
    spring_offset : float, J
        What DART's spring energy lacks where several springs on one joint were merged.
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
    """Silence the standard error of native code: DART warns there of every massless link."""
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
    """Constraints that `World.step` has no means for: what they are called, and the first of each kind."""
    groups: dict[str, tuple[Coupling | Rolling | Skate, ...]] = {
        "coupling": mechanism.couplings,
        "rolling": mechanism.rollings,
        "skate": mechanism.skates,
    }
    return {what: elements[0].name for what, elements in groups.items() if elements}


def constrained(mechanism: Mechanism, tree: Tree) -> bool:
    """Whether a skeleton alone does not know all constraints: drives are its own, loops and others are not."""
    return bool(tree.welds or unstepped(mechanism))


def isometry(p: Array, R: Array) -> Any:
    """DART's rigid transform from an origin and a rotation matrix."""
    transform = dartpy.math.Isometry3()
    transform.set_rotation(R)
    transform.set_translation(p)
    return transform


def set_inertia(node: Any, mass: float, com: Array, moment: Array) -> None:
    """Give a node its inertia: `moment` is about the centre of mass, in axes of the node."""
    if mass > 0.0:
        node.setInertia(dartpy.dynamics.Inertia(mass, com, moment))
        return
    with quiet():
        node.setInertia(dartpy.dynamics.Inertia(0.0, np.zeros(3), np.zeros((3, 3))))


def without_screws(mechanism: Mechanism) -> Mechanism:
    """The mechanism with a revolute joint in place of each screw."""
    if all(joint.kind != "screw" for joint in mechanism.joints):
        return mechanism
    joints = (replace(j, kind="revolute", pitch=0.0) if j.kind == "screw" else j for j in mechanism.joints)
    return replace(mechanism, joints=tuple(joints))


def _add(skeleton: Any, parent: Any, link: Link, pitch: float) -> tuple[Any, Any]:
    joint, node = getattr(skeleton, SCREW if pitch else CREATORS[link.elementary])(parent)
    node.setName(link.name)
    joint.setName(f"to {link.name}")
    set_inertia(node, link.mass, link.com, link.inertia)
    if link.elementary in ("R", "P"):
        joint.setAxis(Z)
    if pitch:
        joint.setPitch(pitch)
    if link.elementary != "F":  # a free joint keeps the identity: elsewhere its velocity has an odd basis
        joint.setTransformFromParentBodyNode(isometry(link.placement.p, link.placement.R))
    return joint, node


def axis_link(tree: Tree, joint: int, coordinate: str) -> int:
    """Index of the link whose elementary joint has a coordinate of a joint with one axis."""
    elementary = ELEMENTARY[coordinate]
    return next(i for i, link in enumerate(tree.links) if link.joint == joint and link.elementary == elementary)


def sprung(mechanism: Mechanism, tree: Tree) -> dict[int, list[JointSpring]]:
    """Joint springs by the link whose coordinate they act on."""
    found: dict[int, list[JointSpring]] = {}
    for spring in mechanism.joint_springs:
        link = axis_link(tree, mechanism.joint_index[spring.joint], spring.coordinate)
        found.setdefault(link, []).append(spring)
    return found


def _add_joint_springs(mechanism: Mechanism, tree: Tree, joints: list[Any]) -> float:
    """Give DART's joints their springs and dampers; return the energy that merging several on one joint loses."""
    offset = 0.0
    for i, springs in sprung(mechanism, tree).items():
        # the coordinate of a joint passed backwards is the negative of the mechanism's
        sign = -1.0 if tree.links[i].reversed else 1.0
        stiffness = sum(s.stiffness for s in springs)
        moment = sum(s.stiffness * s.rest for s in springs)
        rest = moment / stiffness if stiffness else 0.0
        joints[i].setSpringStiffness(0, stiffness)
        joints[i].setDampingCoefficient(0, sum(s.damping for s in springs))
        joints[i].setRestPosition(0, sign * rest)
        offset += 0.5 * (sum(s.stiffness * s.rest**2 for s in springs) - stiffness * rest**2)
    return offset


def _axes(mechanism: Mechanism, tree: Tree, joints: list[Any], start: list[int]) -> dict[tuple[str, str], Axis]:
    axes = {}
    for k, joint in enumerate(mechanism.joints):
        for coordinate in AXIS_COORDINATES.get(joint.kind, ()):
            i = axis_link(tree, k, coordinate)
            sign = -1.0 if tree.links[i].reversed else 1.0
            axes[joint.name, coordinate] = Axis(joints[i], start[i], sign, coordinate == "angle")
    return axes


def build(mechanism: Mechanism) -> Model:
    """Translate a mechanism. The skeleton has time step zero, so that its joint springs act at the state as it is."""
    lowered = without_screws(mechanism)
    tree = to_elementary_tree(lowered)
    skeleton = dartpy.dynamics.Skeleton(mechanism.name)
    skeleton.setGravity(mechanism.gravity)
    skeleton.setTimeStep(0.0)
    nodes: list[Any] = []
    joints: list[Any] = []
    for link in tree.links:
        parent = nodes[link.parent] if link.parent >= 0 else None
        joint, node = _add(skeleton, parent, link, mechanism.joints[link.joint].pitch)
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
