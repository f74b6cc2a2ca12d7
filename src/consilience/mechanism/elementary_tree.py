"""Elementary tree of a mechanism: the description that engines in minimal coordinates start from.

A spanning tree from the ground is chosen, and each joint of the tree becomes a chain of elementary joints, each along
or about **z** of its own frame:

===========  =========================================================
revolute     R
prismatic    P
cylindrical  P R
universal    R R            (z of F, then x of M)
planar       P P R          (x, y, then z of F)
spherical    S
free         F
rigid        W
rod          R R S          (a massless link: two axes across it, then a ball)
on line      P S            (point on line)
in plane     P P S          (point in plane: x, y of F)
parallel     P P P R        (parallel axes: x, y, z of F)
===========  =========================================================

A screw couples two elementary joints and has no chain.

All links of a chain but the last are massless. A joint that closes a loop is opened by *splitting* the body behind the
joint: a copy of the body hangs on the closing joint, the copies share mass and inertia equally, and a `Weld` holds the
copies together. The dynamics is exactly that of the mechanism, whatever the kind of the closing joint, and the wrench
on the copy is the reaction of that joint.

The two axes of a rod are x and y of F (of M where the tree passes the rod backwards): the chain is singular where the
rod lies along that x.

Conventions are those of `model`: SI units, rad, quaternions scalar first. The frame of a link coincides with its joint
frame where its coordinate is zero; the inertia of a link is about its centre of mass, in its axes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism.bodies import Frame
from consilience.mechanism.constraints import RelativeMotion, relative_motion
from consilience.mechanism.model import GROUND, Joint, Mechanism, State
from consilience.mechanism.spanning_tree import spanning_tree
from consilience.mechanism.spatial import Array, cross, elementary_rotation, quaternion_from_rotation

ElementaryJoint = Literal["R", "P", "S", "F", "W"]

_Z_TO_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # columns y, z, x: the new z is the old x
_Z_TO_Y = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # columns z, x, y: the new z is the old y
_SWAP_X_Z = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
_ONE = np.eye(3)
_IDENTITY = Frame(np.zeros(3), _ONE)

# elementary joints of a chain, with the axes of their frames in F (in M where the tree passes a joint backwards)
_CHAINS: dict[str, tuple[tuple[ElementaryJoint, Array], ...]] = {
    "revolute": (("R", _ONE),),
    "prismatic": (("P", _ONE),),
    "cylindrical": (("P", _ONE), ("R", _ONE)),
    "universal": (("R", _ONE), ("R", _Z_TO_X)),
    "planar": (("P", _Z_TO_X), ("P", _Z_TO_Y), ("R", _ONE)),
    "spherical": (("S", _ONE),),
    "free": (("F", _ONE),),
    "rigid": (("W", _ONE),),
    "rod": (("R", _Z_TO_X), ("R", _Z_TO_Y), ("S", _ONE)),
    "point_on_line": (("P", _ONE), ("S", _ONE)),
    "point_in_plane": (("P", _Z_TO_X), ("P", _Z_TO_Y), ("S", _ONE)),
    "parallel_axes": (("P", _Z_TO_X), ("P", _Z_TO_Y), ("P", _ONE), ("R", _ONE)),
    # passed backwards, the ball on M comes first; the weld W turns the axes back to those of the ball
    "point_on_line~": (("S", _ONE), ("P", _ONE)),
    "point_in_plane~": (("S", _ONE), ("P", _Z_TO_X), ("P", _Z_TO_Y), ("W", _ONE)),
}


@dataclass(frozen=True, eq=False)
class Link:
    """One elementary joint and the (possibly massless) link behind the joint.

    Attributes
    ----------
    name : str
        Unique; the last link of a chain has the name of its body, a copy ``<body>~<joint>``.
    parent : int
        Index of the parent link; -1 is the ground. Links are in depth-first order, parents first.
    elementary : {"R", "P", "S", "F", "W"}
        Revolute about z, prismatic along z, spherical, free, welded.
    placement : Frame
        Joint frame in the frame of the parent link.
    joint : int
        Index of the mechanism's joint that the link belongs to.
    reversed : bool
        The tree passes the joint backwards, from successor to predecessor.
    last : bool
        Last link of its chain: the wrench on the link through its elementary joint is the joint's reaction (on the
        predecessor where `reversed`).
    body : int
        Index of the mechanism's body that the link carries; -1 for a massless link.
    share : float
        Fraction of the body's mass and inertia that the link carries.
    body_frame : Frame
        Frame B of the body in the frame of the link.
    mass : float, kg
    com : ndarray, shape (3,), m
        Centre of mass in the frame of the link.
    inertia : ndarray, shape (3, 3), kg m^2
        About the centre of mass, in the axes of the link.
    """

    name: str
    parent: int
    elementary: ElementaryJoint
    placement: Frame
    joint: int
    reversed: bool
    last: bool
    body: int = -1
    share: float = 0.0
    body_frame: Frame = _IDENTITY
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True)
class Weld:
    """Two links that carry shares of one body: their body frames coincide. `joint` is the closing joint."""

    joint: int
    original: int
    copy: int


@dataclass(frozen=True, eq=False)
class Tree:
    """Links in depth-first order, and the welds that close the loops."""

    links: tuple[Link, ...]
    welds: tuple[Weld, ...]

    def carrier(self, body: int) -> int:
        """Return the index of the link that carries a body, not one of its copies; -1 for the ground."""
        if body < 0:
            return -1
        return next(i for i, link in enumerate(self.links) if link.body == body and "~" not in link.name)

    def reaction_link(self, joint: int) -> int:
        """Return the index of the link on which the wrench of a joint of the mechanism acts."""
        return next(i for i, link in enumerate(self.links) if link.joint == joint and link.last)


@dataclass(frozen=True, eq=False)
class Coordinate:
    """Coordinate and rate of one elementary joint.

    Attributes
    ----------
    q, rate : float
        Of R (rad) and P (m).
    p, v : ndarray, shape (3,), m
        Of F: origin of the link in the joint frame, and its rate, in axes of the joint frame.
    quat : ndarray, shape (4,)
        Of S and F: orientation of the link in the joint frame, scalar first.
    w : ndarray, shape (3,), rad/s
        Of S and F: angular velocity of the link relative to the joint frame, in axes **of the link**.
    """

    q: float = 0.0
    rate: float = 0.0
    p: Array | None = None
    v: Array | None = None
    quat: Array | None = None
    w: Array | None = None


def _bodies(joint: Joint, backward: bool) -> tuple[str, str]:
    """Names of the bodies before and after a joint, as the tree passes it."""
    return (joint.successor, joint.predecessor) if backward else (joint.predecessor, joint.successor)


def _end_frames(joint: Joint, backward: bool) -> tuple[Frame, Frame]:
    """Frames at the start and at the end of the chain of a joint, as the tree passes it."""
    if not backward:
        return joint.F, joint.M
    if joint.kind == "universal":  # passed backwards, its first axis is x of M, its second z of F
        return Frame(joint.M.p, joint.M.R @ _SWAP_X_Z), Frame(joint.F.p, joint.F.R @ _SWAP_X_Z)
    return joint.M, joint.F


def _chain_of(joint: Joint, backward: bool) -> str:
    """Key of `_CHAINS` for a joint, as the tree passes it."""
    return f"{joint.kind}~" if backward and f"{joint.kind}~" in _CHAINS else joint.kind


def _chain(mechanism: Mechanism, k: int, backward: bool, parent_frame: Frame, name: str) -> list[Link]:
    """Links of joint k, without parents.

    Parameters
    ----------
    k : int
        Index of the joint.
    backward : bool
        The tree passes the joint from successor to predecessor.
    parent_frame : Frame
        Frame B of the body before the joint, in the frame of its link.
    name : str
        Name of the last link.
    """
    joint = mechanism.joints[k]
    start, end = _end_frames(joint, backward)
    body = mechanism.body_index[_bodies(joint, backward)[1]]
    p, R = parent_frame.p + parent_frame.R @ start.p, parent_frame.R @ start.R
    links: list[Link] = []
    axes_before = _ONE
    chain = _CHAINS[_chain_of(joint, backward)]
    for n, (elementary, axes) in enumerate(chain):
        if elementary == "S" and joint.kind == "rod":
            p = axes_before.T @ np.array([0.0, 0.0, joint.length])
        last = n == len(chain) - 1
        # B in the link: axes^T times (M in B)^-1
        R_LB = axes.T @ end.R.T
        links.append(
            Link(
                name=name if last else f"{name}:{n}",
                parent=-1,
                elementary=elementary,
                placement=Frame(p, R @ axes),
                joint=k,
                reversed=backward,
                last=last,
                body=body if last else -1,
                share=1.0 if last else 0.0,
                body_frame=Frame(-R_LB @ end.p, R_LB) if last else _IDENTITY,
            )
        )
        p, R, axes_before = np.zeros(3), axes.T, axes
    return links


@lru_cache(maxsize=32)  # adapters, and the condition at each state, ask for the tree of the same mechanism
def to_elementary_tree(mechanism: Mechanism) -> Tree:
    """Return the elementary tree of a mechanism, with welds for its loops.

    Raises
    ------
    InvalidInput
        A joint is a screw.
    """
    for joint in mechanism.joints:
        if joint.kind not in _CHAINS:
            raise InvalidInput(
                f"joint '{joint.name}'", f"a {joint.kind} is no chain of elementary joints", "Use another description."
            )
    joints, closing = spanning_tree(mechanism)
    links: list[Link] = []
    carrier: dict[str, int] = {}

    def append(k: int, backward: bool, name: str) -> None:
        """Append the chain of joint k to the link of the body before the joint."""
        parent = carrier.get(_bodies(mechanism.joints[k], backward)[0], -1)
        chain = _chain(mechanism, k, backward, links[parent].body_frame if parent >= 0 else _IDENTITY, name)
        for n, link in enumerate(chain):
            links.append(replace(link, parent=parent if n == 0 else len(links) - 1))

    for k, backward in joints:
        to_body = _bodies(mechanism.joints[k], backward)[1]
        append(k, backward, to_body)
        carrier[to_body] = len(links) - 1
    welds = []
    for k in closing:
        joint = mechanism.joints[k]
        backward = joint.successor == GROUND
        to_body = _bodies(joint, backward)[1]
        append(k, backward, f"{to_body}~{joint.name}")
        welds.append(Weld(joint=k, original=carrier[to_body], copy=len(links) - 1))
    return _in_depth_first_order(_share_masses(mechanism, links), welds)


def _share_masses(mechanism: Mechanism, links: list[Link]) -> list[Link]:
    """Give each link that carries a body its share of mass and inertia: equal shares for a body and its copies."""
    counts = [sum(link.body == b for link in links) for b in range(len(mechanism.bodies))]

    def loaded(link: Link) -> Link:
        if link.body < 0:
            return link
        body, R, share = mechanism.bodies[link.body], link.body_frame.R, 1.0 / counts[link.body]
        com, inertia = link.body_frame.p + R @ body.com, share * R @ body.inertia @ R.T
        return replace(link, share=share, mass=share * body.mass, com=com, inertia=inertia)

    return [loaded(link) for link in links]


def _in_depth_first_order(links: list[Link], welds: list[Weld]) -> Tree:
    """Sort links in depth-first order: copies, appended last, move behind their parents."""
    order: list[int] = []

    def visit(parent: int) -> None:
        for i, link in enumerate(links):
            if link.parent == parent:
                order.append(i)
                visit(i)

    visit(-1)
    new = {old: n for n, old in enumerate(order)} | {-1: -1}
    return Tree(
        links=tuple(replace(links[i], parent=new[links[i].parent]) for i in order),
        welds=tuple(Weld(w.joint, new[w.original], new[w.copy]) for w in welds),
    )


def coordinates(mechanism: Mechanism, tree: Tree, state: State) -> list[Coordinate]:
    """Return coordinates and rates of all elementary joints at a state, in the order of the links."""
    result: list[Coordinate] = []
    cache: dict[tuple[int, bool], list[Coordinate]] = {}
    for link in tree.links:
        key = (link.joint, link.reversed)
        if not cache.get(key):
            joint = mechanism.joints[link.joint]
            start, end = _end_frames(joint, link.reversed)
            before, after = _bodies(joint, link.reversed)
            passed = replace(joint, predecessor=before, successor=after, F=start, M=end)
            cache[key] = _chain_coordinates(_chain_of(joint, link.reversed), relative_motion(mechanism, state, passed))
        result.append(cache[key].pop(0))
    return result


def _chain_coordinates(chain: str, motion: RelativeMotion) -> list[Coordinate]:
    """Coordinates of the chain of one joint, from the motion of its end frame relative to its start frame."""
    if chain == "rod":
        return _rod_coordinates(motion)
    R, p, v, w = motion.R, motion.p, motion.v, motion.w
    angle = Coordinate(q=float(np.arctan2(R[1, 0], R[0, 0])), rate=float(w[2]))
    if chain == "revolute":
        return [angle]  # of the most frequent joint, nothing else is computed
    slide = [Coordinate(q=float(p[n]), rate=float(v[n])) for n in range(3)]
    quat, w_link = quaternion_from_rotation(R), R.T @ w
    ball = Coordinate(quat=quat, w=w_link)
    p_seen, v_seen = R.T @ p, R.T @ (v - cross(w, p))  # in the axes of the end frame
    seen = [Coordinate(q=float(p_seen[n]), rate=float(v_seen[n])) for n in range(3)]
    return {
        "prismatic": [slide[2]],
        "cylindrical": [slide[2], angle],
        "universal": [angle, Coordinate(q=float(np.arctan2(R[2, 1], R[2, 2])), rate=float(R[:, 0] @ w))],
        "planar": [slide[0], slide[1], angle],
        "spherical": [ball],
        "free": [Coordinate(p=p, v=v, quat=quat, w=w_link)],
        "rigid": [Coordinate()],
        "point_on_line": [slide[2], ball],
        "point_in_plane": [slide[0], slide[1], ball],
        "parallel_axes": [*slide, angle],
        "point_on_line~": [ball, seen[2]],
        "point_in_plane~": [ball, seen[0], seen[1], Coordinate()],
    }[chain]


def _rod_coordinates(motion: RelativeMotion) -> list[Coordinate]:
    """Angles about x, then y, that turn z into the direction of the rod; then the ball on its end."""
    p, v = motion.p, motion.v
    across = np.hypot(p[1], p[2])
    a, b = np.arctan2(-p[1], p[2]), np.arctan2(p[0], across)
    a_dot = (p[1] * v[2] - p[2] * v[1]) / across**2
    b_dot = v[0] / across - p[0] * (p @ v) / (across * (p @ p))
    R_rod = elementary_rotation(0, a) @ elementary_rotation(1, b)
    w_rod = a_dot * np.array([1.0, 0.0, 0.0]) + b_dot * elementary_rotation(0, a)[:, 1]
    return [
        Coordinate(q=float(a), rate=float(a_dot)),
        Coordinate(q=float(b), rate=float(b_dot)),
        Coordinate(quat=quaternion_from_rotation(R_rod.T @ motion.R), w=motion.R.T @ (motion.w - w_rod)),
    ]
