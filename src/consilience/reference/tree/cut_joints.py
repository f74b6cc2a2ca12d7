"""Joints that close loops: one record for each joint that keeps constraint rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.spanning_tree import TreeModel
from consilience.reference.tree.records import CUT_JOINT


class CutJoints(NamedTuple):
    """Joints that close loops, and kinds and targets of all their rows."""

    joint: Array  # (n_c,) of CUT_JOINT
    kind: Array
    target: Array


def cut_joints(tree: TreeModel, model: Model) -> CutJoints:
    """Return the joints that close loops; rows are numbered as in ``tree.cut``."""
    cut = tree.cut
    closing = np.flatnonzero(np.diff(cut.first_row))
    link = np.full(len(tree.body) + 1, -1)
    link[tree.body] = np.arange(len(tree.body))
    # a link has the axes of the joint frame on it; the ground, the last entry, those of the world
    own = np.where((tree.sign > 0)[:, None, None], model.axes_j[tree.joint], model.axes_i[tree.joint])
    to_link = np.concatenate([np.swapaxes(own, 1, 2), np.eye(3)[None]])
    found = np.zeros(len(closing), CUT_JOINT)
    found["first_row"], found["last_row"] = cut.first_row[closing], cut.first_row[closing + 1]
    found["pitch"] = cut.pitch[closing]
    for side, body, arm, axes in (("i", cut.body_i, cut.arm_i, cut.axes_i), ("j", cut.body_j, cut.arm_j, cut.axes_j)):
        on = link[body[closing]]
        found[side] = on
        found[f"arm_{side}"] = np.einsum("kmn,kn->km", to_link[on], arm[closing])
        found[f"axes_{side}"] = np.swapaxes(to_link[on] @ axes[closing], 1, 2)
    return CutJoints(found, cut.row_kind, cut.row_target)
