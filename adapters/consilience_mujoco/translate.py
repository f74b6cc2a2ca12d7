"""Translation of a mechanism into a compiled MuJoCo model.

All elementary joints of one joint belong to one MuJoCo body, which composes them in order, so that no massless link is
needed, not even for a rod (hinge, hinge, ball). The frame of a MuJoCo body is that of the last link of the chain; a
site marks frame B of the mechanism's body. A body on a free joint is a child of the world, whatever the predecessor:
MuJoCo has free joints only there, and a free joint constrains nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from consilience.engine import ELEMENTARY, merged_spring, without_screws
from consilience.mechanism import (
    GROUND,
    Array,
    Frame,
    JointSpring,
    Link,
    Mechanism,
    Spring,
    Tree,
    body_point,
    drawing_state,
    quaternion_from_rotation,
    quaternion_product,
    to_elementary_tree,
)
from consilience_mujoco.actuators import Signal, add_forces
from consilience_mujoco.contacts import Limit, Touch, add_contacts, limits_of, touches_of
from consilience_mujoco.messages import warnings_raise
from consilience_mujoco.places import add_site, compose, inverse, link_name
from consilience_mujoco.rows import Rows, add_rows, rows_of

FRAME_EPS = 1e-5
"""Difference of frames, in m or parts of a quaternion, above which MuJoCo never takes one for the other."""

JOINT_TYPES = {
    "R": mujoco.mjtJoint.mjJNT_HINGE,
    "P": mujoco.mjtJoint.mjJNT_SLIDE,
    "S": mujoco.mjtJoint.mjJNT_BALL,
    "F": mujoco.mjtJoint.mjJNT_FREE,
}


@dataclass(frozen=True, eq=False)
class Translation:
    """Compiled model of a mechanism, with the places of the mechanism's parts.

    Attributes
    ----------
    mechanism : Mechanism
    plain : Mechanism
        The mechanism with cylindrical joints in place of screws, whose threads are rows of `rows`, and with free
        joints at centres of mass if there are contacts.
    tree : Tree
        Elementary tree of `plain`.
    model, data : mujoco.MjModel, mujoco.MjData
    link_body : ndarray of int, shape (n_links,)
        MuJoCo body of each link; the links of one chain share a body.
    link_joint : ndarray of int, shape (n_links,)
        MuJoCo joint of each link; -1 for a welded one.
    body_site : ndarray of int, shape (n_b,)
        Site that marks frame B of each body of the mechanism.
    energy_offset : float, J
        Constant that MuJoCo's potential energy lacks where several springs on one coordinate are merged.
    signals : tuple of Signal
        Controls of actuators.
    rows : Rows
        Constraints whose rows a callback completes.
    touches : tuple of Touch
        Elementary contacts.
    limits : tuple of Limit
        Joint coordinates with stops.
    """

    mechanism: Mechanism
    plain: Mechanism
    tree: Tree
    model: Any
    data: Any
    link_body: NDArray[np.int_]
    link_joint: NDArray[np.int_]
    body_site: NDArray[np.int_]
    energy_offset: float
    signals: tuple[Signal, ...]
    rows: Rows
    touches: tuple[Touch, ...] = ()
    limits: tuple[Limit, ...] = ()


def principal_inertia(inertia: Array) -> tuple[Array, Array]:
    """Return the principal moments, ascending, and the quaternion of their axes.

    MuJoCo's own reduction of a full tensor loses a digit, and MuJoCo then refuses a lamina (A + B = C). Here the
    largest moment is limited to the sum of the others, which `consilience.mechanism.check_inertia` ensures to 1e-12.

    Parameters
    ----------
    inertia : ndarray, shape (3, 3), kg m^2

    Returns
    -------
    moments : ndarray, shape (3,), kg m^2
    quat : ndarray, shape (4,)
        From principal to given axes, scalar first.
    """
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.linalg.det(axes)
    moments[2] = min(moments[2], moments[0] + moments[1])
    return moments, quaternion_from_rotation(axes)


def _seen(moments: Array, quat: Array, com: Array) -> tuple[Array, Array]:
    """Return principal moments and axes in another order, where MuJoCo would take them for the axes of the body.

    MuJoCo drops differences of frames below `FRAME_EPS` when it compiles, and the products of inertia with them.
    """
    turned, moved = float(np.linalg.norm(quat[1:])), float(np.linalg.norm(com))
    if turned > FRAME_EPS or (turned == 0.0 and (moved == 0.0 or moved > FRAME_EPS)):
        return moments, quat
    return moments[[1, 2, 0]], quaternion_product(quat, np.full(4, 0.5))


def _chains(tree: Tree) -> list[list[int]]:
    """Group the indices of the links by the joint to which they belong, in the order of the tree."""
    chains: list[list[int]] = [[]]
    for i, link in enumerate(tree.links):
        chains[-1].append(i)
        if link.last:
            chains.append([])
    return chains[:-1]


def slides_behind_balls(tree: Tree) -> list[int]:
    """Return the joints in a loop that are a ball, then a slide, on one body, where MuJoCo's `mj_jacDot` is wrong.

    MuJoCo's function takes the velocity of the slide for a motion of the ball's axes. Where both ends of a weld hang
    behind the joint, the errors cancel.
    """
    found = []
    for chain in _chains(tree):
        if "SP" in "".join(tree.links[i].elementary for i in chain):
            behind = _behind(tree, chain[-1])
            if any((weld.original in behind) != (weld.copy in behind) for weld in tree.welds):
                found.append(tree.links[chain[-1]].joint)
    return found


def _behind(tree: Tree, root: int) -> set[int]:
    """Indices of a link and of all its descendants; what is free hangs on the world."""
    found = {root}
    for i, link in enumerate(tree.links):  # parents come before their children
        if link.parent in found and link.elementary != "F":
            found.add(i)
    return found


def _add_body(spec: Any, mechanism: Mechanism, tree: Tree, chain: list[int]) -> None:
    """Add the body at the end of a chain, with its joints and the site of frame B."""
    links = [tree.links[i] for i in chain]
    last = links[-1]
    parent = -1 if last.elementary == "F" else links[0].parent
    mother = spec.worldbody if parent < 0 else spec.body(link_name(tree, parent))
    poses = [links[0].placement]
    for link in links[1:]:
        poses.append(compose(poses[-1], link.placement))
    at = poses[-1]
    moments, axes = _seen(*principal_inertia(last.inertia), last.com)
    body = mother.add_body(
        name=link_name(tree, chain[-1]),
        pos=at.p,
        quat=quaternion_from_rotation(at.R),
        mass=last.mass,
        ipos=last.com,  # without a position MuJoCo drops the orientation of the principal axes
        inertia=moments,
        iquat=axes,
        explicitinertial=True,
    )
    for i, link, pose in zip(chain, links, poses, strict=True):
        if link.elementary in JOINT_TYPES:
            _add_joint(body, link_name(tree, i), link, compose(inverse(at), pose), mechanism)
    add_site(body, link_name(tree, chain[-1]), last.body_frame)


def _add_joint(body: Any, name: str, link: Link, frame: Frame, mechanism: Mechanism) -> None:
    """Add the elementary joint of a link to a body, with its springs.

    Parameters
    ----------
    body : mujoco.MjsBody
    name : str
    link : Link
    frame : Frame
        Joint frame in the frame of the MuJoCo body.
    mechanism : Mechanism
    """
    joint = body.add_joint(
        name=name,
        type=JOINT_TYPES[link.elementary],
        pos=frame.p,
        axis=frame.R[:, 2],
        align=mujoco.mjtAlignFree.mjALIGNFREE_FALSE,
    )
    springs = springs_on(mechanism, link)
    if springs:
        joint.stiffness[0], joint.damping[0], rest, _ = merged_spring(springs)
        rest = next((s.rest for s in springs if any(s.laws[0][1:])), rest)
        sign = -1.0 if link.reversed else 1.0  # passed backwards, a joint has the opposite coordinate
        joint.springref = sign * rest
        k1, k2, c1, c2 = np.sum([s.higher for s in springs], axis=0)
        joint.stiffness[1:], joint.damping[1:] = [sign * k1, k2], [c1, c2]


def springs_on(mechanism: Mechanism, link: Link) -> list[JointSpring]:
    """Return the joint springs in the coordinate of a link, including viscous friction as dampers."""
    viscous = [JointSpring(f.name, f.joint, f.coordinate, 0.0, f.viscous, 0.0) for f in mechanism.frictions]
    name = mechanism.joints[link.joint].name
    return [
        s
        for s in (*mechanism.joint_springs, *viscous)
        if s.joint == name and ELEMENTARY[s.coordinate] == link.elementary
    ]


def drawn_length(mechanism: Mechanism, spring: Spring) -> float:
    """Return the distance of the ends of a spring in the drawing, m."""
    drawn = drawing_state(mechanism)
    ends = ((spring.predecessor, spring.point_predecessor), (spring.successor, spring.point_successor))
    (start, _), (end, _) = (body_point(mechanism, drawn, body, point) for body, point in ends)
    return float(np.linalg.norm(end - start))


def springs_cancel(springs: list[JointSpring]) -> bool:
    """Whether stiffnesses of opposite sign cancel, so that no single spring has the same effort."""
    return abs(sum(s.stiffness for s in springs)) < 1e-9 * sum(abs(s.stiffness) for s in springs)


def polynomials_apart(springs: list[JointSpring]) -> bool:
    """Whether springs of different rests, not all of them linear, act in one coordinate."""
    rests = {s.rest for s in springs if any(s.laws[0])}
    return len(rests) > 1 and any(any(s.laws[0][1:]) for s in springs)


def _energy_offset(mechanism: Mechanism, tree: Tree) -> float:
    several = (springs for link in tree.links if len(springs := springs_on(mechanism, link)) > 1)
    return sum((merged_spring(springs)[3] for springs in several), 0.0)


def _add_weld(spec: Any, tree: Tree, original: int, copy: int) -> None:
    """Hold the copies of a split body together at their frames B."""
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1=link_name(tree, original),
        name2=link_name(tree, copy),
    )


def with_free_joints_at_centres(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with free joints at the centres of mass, if it has contacts; a free joint has no place.

    MuJoCo's rows of contacts have no velocity terms. Those of a ball on a plane vanish in the velocity of its centre.
    """
    if not mechanism.contacts:
        return mechanism
    joints = [
        replace(joint, M=Frame(mechanism.bodies[mechanism.body_index[joint.successor]].com, joint.M.R))
        if joint.kind == "free" and joint.successor != GROUND
        else joint
        for joint in mechanism.joints
    ]
    return replace(mechanism, joints=tuple(joints))


def translate(mechanism: Mechanism) -> Translation:
    """Compile a mechanism with all options at MuJoCo's defaults; `methods.configured` sets those of a method.

    Raises
    ------
    ValueError
        MuJoCo's compiler refuses the model, for the reason in its text.
    """
    plain = with_free_joints_at_centres(without_screws(mechanism, "cylindrical"))
    tree, spec = to_elementary_tree(plain), mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = mechanism.gravity
    add_site(spec.worldbody, "world axes", Frame(np.zeros(3), np.eye(3)))
    chains = _chains(tree)
    for chain in chains:
        _add_body(spec, mechanism, tree, chain)
    signals = add_forces(spec, mechanism, tree)
    for weld in tree.welds:
        _add_weld(spec, tree, weld.original, weld.copy)
    add_rows(spec, mechanism, tree)
    add_contacts(spec, mechanism, tree)
    with warnings_raise():
        model = spec.compile()
        model.body_sameframe[:] = model.site_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
        data = mujoco.MjData(model)
    ends = {i: chain[-1] for chain in chains for i in chain}
    return Translation(
        mechanism=mechanism,
        plain=plain,
        tree=tree,
        model=model,
        data=data,
        link_body=np.array([model.body(link_name(tree, ends[i])).id for i in range(len(tree.links))]),
        link_joint=np.array(
            [-1 if link.elementary == "W" else model.joint(link_name(tree, i)).id for i, link in enumerate(tree.links)]
        ),
        body_site=np.array([model.site(link_name(tree, tree.carrier(b))).id for b in range(len(mechanism.bodies))]),
        energy_offset=_energy_offset(mechanism, tree),
        signals=signals,
        rows=rows_of(model, mechanism, tree),
        touches=touches_of(model, mechanism),
        limits=limits_of(model, mechanism, tree),
    )
