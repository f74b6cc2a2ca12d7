"""Table of the joints that close loops: one row for each joint that keeps constraint rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.spanning_tree import TreeModel

LINK_I, LINK_J, FIRST_ROW, LAST_ROW, PITCH, ARM_I, ARM_J, AXES_I, AXES_J, JOINT_WIDTH = np.array(
    [0, 1, 2, 3, 4, 5, 8, 11, 20, 29]
)
"""Columns: links of predecessor and successor (-1: ground), first row and the one behind the last, pitch; arms from the
centres of mass and axes of the joint frames, column by column, in axes of the links.
"""


class CutJoints(NamedTuple):
    """Joints that close loops, and kinds and targets of all their rows."""

    joint: Array  # (n_c, JOINT_WIDTH)
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
    table = np.zeros((len(closing), JOINT_WIDTH))
    table[:, FIRST_ROW], table[:, LAST_ROW] = cut.first_row[closing], cut.first_row[closing + 1]
    table[:, PITCH] = cut.pitch[closing]
    sides = (
        (cut.body_i, cut.arm_i, cut.axes_i, LINK_I, ARM_I, AXES_I),
        (cut.body_j, cut.arm_j, cut.axes_j, LINK_J, ARM_J, AXES_J),
    )
    for body, arm, axes, at, at_arm, at_axes in sides:
        on = link[body[closing]]
        table[:, at] = on
        table[:, at_arm : at_arm + 3] = np.einsum("kmn,kn->km", to_link[on], arm[closing])
        turned = to_link[on] @ axes[closing]
        table[:, at_axes : at_axes + 9] = np.swapaxes(turned, 1, 2).reshape(-1, 9)
    return CutJoints(table, cut.row_kind, cut.row_target)
