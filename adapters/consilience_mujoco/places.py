"""Places of a mechanism in a MuJoCo specification: names of links, sites on bodies."""

from __future__ import annotations

from typing import Any

import numpy as np

from consilience.mechanism import GROUND, Array, Frame, Mechanism, Tree, quaternion_from_rotation


def compose(a: Frame, b: Frame) -> Frame:
    """Return the pose of b in the frame in which `a` is given; b is given in a."""
    return Frame(a.p + a.R @ b.p, a.R @ b.R)


def inverse(a: Frame) -> Frame:
    """Return the pose, in `a`, of the frame in which `a` is given."""
    return Frame(-a.R.T @ a.p, a.R.T)


def link_name(tree: Tree, link: int) -> str:
    """Return the name of the joint of a link, and of body and site B if the link is the last of its chain."""
    return f"{link} {tree.links[link].name}"  # the number avoids MuJoCo's name "world"


def add_site(body: Any, name: str, frame: Frame) -> None:
    """Mark a frame of a body of the specification by a site."""
    body.add_site(name=name, pos=frame.p, quat=quaternion_from_rotation(frame.R))


def add_point(spec: Any, mechanism: Mechanism, tree: Tree, body: str, point: Array, name: str) -> None:
    """Mark a point of a body by a site with the axes of the body.

    Parameters
    ----------
    spec : mujoco.MjSpec
    mechanism : Mechanism
    tree : Tree
    body : str
    point : ndarray, shape (3,), m
        In axes of the body, from its origin.
    name : str
        Name of the site.
    """
    if body == GROUND:
        add_site(spec.worldbody, name, Frame(point, np.eye(3)))
    else:
        carrier = tree.carrier(mechanism.body_index[body])
        frame = compose(tree.links[carrier].body_frame, Frame(point, np.eye(3)))
        add_site(spec.body(link_name(tree, carrier)), name, frame)
