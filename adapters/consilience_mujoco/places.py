"""Where things of a mechanism are in a MuJoCo specification: names of links, sites on bodies, axes of joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from consilience.mechanism import GROUND, Array, Frame, Mechanism, Tree, quaternion_from_rotation

ELEMENTARY = {"angle": "R", "distance": "P"}
"""Elementary joint that has a coordinate elements refer to."""


def compose(a: Frame, b: Frame) -> Frame:
    """Pose of b, given in a, in the frame in which a is given."""
    return Frame(a.p + a.R @ b.p, a.R @ b.R)


def inverse(a: Frame) -> Frame:
    """Pose of the frame in which `a` is given, as seen from `a`."""
    return Frame(-a.R.T @ a.p, a.R.T)


def link_name(tree: Tree, link: int) -> str:
    """Name of the joint of a link, and of the body and of the site B where it is the last of its chain."""
    return f"{link} {tree.links[link].name}"  # the number keeps clear of MuJoCo's "world"


def axis_link(mechanism: Mechanism, tree: Tree, joint: str, coordinate: str) -> tuple[int, float]:
    """Link whose MuJoCo joint has a joint coordinate, and the sign with which it has it.

    Passed backwards, a joint has the opposite coordinate.
    """
    k = mechanism.joint_index[joint]
    found = (i for i, x in enumerate(tree.links) if x.joint == k and x.elementary == ELEMENTARY[coordinate])
    link = next(found)
    return link, -1.0 if tree.links[link].reversed else 1.0


def add_site(body: Any, name: str, frame: Frame) -> None:
    """Mark a frame of a body of the specification."""
    body.add_site(name=name, pos=frame.p, quat=quaternion_from_rotation(frame.R))


def add_point(spec: Any, mechanism: Mechanism, tree: Tree, body: str, point: Array, name: str) -> None:
    """Mark a point of a body by a site with the axes of the body."""
    if body == GROUND:
        add_site(spec.worldbody, name, Frame(point, np.eye(3)))
    else:
        carrier = tree.carrier(mechanism.body_index[body])
        frame = compose(tree.links[carrier].body_frame, Frame(point, np.eye(3)))
        add_site(spec.body(link_name(tree, carrier)), name, frame)
