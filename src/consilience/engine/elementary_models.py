"""Steps that translations into elementary joints share: screws, coordinates of joints, springs in one coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from consilience.mechanism import JointSpring, Mechanism, Tree

ELEMENTARY = {"angle": "R", "distance": "P"}
"""Elementary joint that has a coordinate of a joint with one axis."""


def without_screws(mechanism: Mechanism, kind: str) -> Mechanism:
    """Return the mechanism with joints of another kind in place of its screws, which have no elementary chain."""
    if all(joint.kind != "screw" for joint in mechanism.joints):
        return mechanism
    joints = (replace(j, kind=kind, pitch=0.0) if j.kind == "screw" else j for j in mechanism.joints)
    return replace(mechanism, joints=tuple(joints))


def axis_link(mechanism: Mechanism, tree: Tree, joint: str, coordinate: str) -> tuple[int, float]:
    """Return the index of the link whose elementary joint has a joint coordinate, and the sign of the coordinate there.

    The sign is -1 where the tree passes the joint backwards.
    """
    k, elementary = mechanism.joint_index[joint], ELEMENTARY[coordinate]
    n = next(i for i, link in enumerate(tree.links) if link.joint == k and link.elementary == elementary)
    return n, -1.0 if tree.links[n].reversed else 1.0


def nonlinear_part(spring: JointSpring) -> JointSpring:
    """Return a joint spring without its linear part and its actuator, for engines whose own springs are linear."""
    return replace(spring, stiffness=0.0, damping=0.0, actuator=None)


def merged_spring(springs: Sequence[JointSpring]) -> tuple[float, float, float, float]:
    """Return the one spring-damper with the same effort as the linear parts of several springs in a joint coordinate.

    Returns
    -------
    stiffness, damping, rest : float
        The rest is 0 where the stiffnesses cancel: no spring has their constant effort.
    energy : float, J
        Constant by which the potential energy of the several springs exceeds that of the one spring.
    """
    stiffness = sum(s.stiffness for s in springs)
    rest = sum(s.stiffness * s.rest for s in springs) / stiffness if stiffness else 0.0
    energy = 0.5 * (sum(s.stiffness * s.rest**2 for s in springs) - stiffness * rest**2)
    return stiffness, sum(s.damping for s in springs), rest, energy
