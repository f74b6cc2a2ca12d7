"""Constraint rows that close loops, as wrenches on the few links that each row acts on.

A row of the constraint Jacobian Q satisfies ``Q v = rate`` and ``Q a = gamma`` [C4 (4.84)-(4.97)]. Row n acts on link
``touched[n, s]`` with the wrench ``W[n, s]`` of a unit multiplier; no array of rows times bodies is formed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.joint_rows import (
    TURN,
    JointMotion,
    Row,
    displacement_row,
    distance_row,
    motion_between,
    product_row,
    row_of_angle,
    row_of_screw,
)
from consilience.reference.bodies.spanning_tree import TreeModel
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.vectors import Vector, dot, load, rotate, rotate_back, scale, store
from consilience.reference.tree.inertia import columns, matrix_times
from consilience.reference.tree.loop_groups import TOUCHED
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
    on_i, on_j = model.axes_i[..., tree.joint, :, :], model.axes_j[..., tree.joint, :, :]
    own = np.swapaxes(np.where((tree.sign > 0)[:, None, None], on_j, on_i), -1, -2)
    to_link = np.concatenate([own, np.broadcast_to(np.eye(3), (*own.shape[:-3], 1, 3, 3))], axis=-3)
    found = np.zeros((*own.shape[:-3], len(closing)), CUT_JOINT)
    found["first_row"], found["last_row"] = cut.first_row[closing], cut.first_row[closing + 1]
    found["pitch"] = cut.pitch[..., closing]
    for side, body, arm, axes in (("i", cut.body_i, cut.arm_i, cut.axes_i), ("j", cut.body_j, cut.arm_j, cut.axes_j)):
        on = link[body[closing]]
        found[side], turned = on, to_link[..., on, :, :]
        found[f"arm_{side}"] = np.einsum("...kmn,...kn->...km", turned, arm[..., closing, :])
        found[f"axes_{side}"] = np.swapaxes(turned @ axes[..., closing, :, :], -1, -2)
    return CutJoints(found, cut.row_kind, cut.row_target)


@kernel
def mark_active_rows(group: Array, order: Array, state: Array, active: Array) -> None:
    """Mark the independent rows; dependent rows do not enter accelerations."""
    for n in range(active.shape[0]):
        active[n] = 0
    for g in range(group.shape[0]):
        for n in range(group[g].row, group[g].row + state[g].active):
            active[order[n]] = 1


@fused
def _axis(link: Array, k: int, axis: Array) -> Vector:
    """Return an axis or arm of a joint frame on a link, in the world."""
    return matrix_times(columns(link[k].axes), load(axis))


@fused
def _motion(link: Array, joint: Array, m: int) -> JointMotion:
    """Return the relative motion of the frames of a joint between placed links."""
    i, j = joint[m].i, joint[m].j
    s_i, s_j = _axis(link, i, joint[m].arm_i), _axis(link, j, joint[m].arm_j)
    body_i = load(link[i].position), load(link[i].velocity), load(link[i].spin)
    body_j = load(link[j].position), load(link[j].velocity), load(link[j].spin)
    return motion_between(i, j, s_i, s_j, body_i, body_j)


@fused
def _product(link: Array, joint: Array, n: int, motion: JointMotion, one: int, two: int) -> Row:
    """Return the row of the product of two axes of a joint."""
    u, w = _axis(link, motion.i, joint[n].axes_i[one]), _axis(link, motion.j, joint[n].axes_j[two])
    return product_row(u, w, motion)


@inner
def _row(link: Array, joint: Array, n: int, motion: JointMotion, kind: int) -> Row:
    """Return a row of a joint by its number in `reference.bodies.arrays.ROWS`."""
    if kind < 3:
        return displacement_row(_axis(link, motion.i, joint[n].axes_i[kind]), motion)
    if kind == 3:
        return distance_row(motion)
    if kind < 13:
        return _product(link, joint, n, motion, (kind - 4) // 3, (kind - 4) % 3)
    pitch, z = joint[n].pitch, displacement_row(_axis(link, motion.i, joint[n].axes_i[2]), motion)
    cos, sin = _product(link, joint, n, motion, 0, 0), _product(link, joint, n, motion, 1, 0)
    return row_of_screw(z, row_of_angle(cos, sin, motion, TURN * z.value / pitch), pitch)


@fused
def evaluate_joint_rows(
    joint: Array, kinds: Array, targets: Array, active: Array, link: Array, W: Array, value: Array, gamma: Array
) -> None:
    """Evaluate the active rows of the joints that close loops.

    Parameters
    ----------
    joint, kinds, targets : ndarray
        Fields of `CutJoints`.
    active, link, W : see `arrays`
        W is overwritten: wrenches on predecessor (slot 0) and successor (slot 1).
    value, gamma : ndarray, shape (q,)
        Overwritten: violations, and right sides of ``Q a = gamma``.
    """
    for m in range(joint.shape[0]):
        motion = _motion(link, joint, m)
        for n in range(joint[m].first_row, joint[m].last_row):
            if not active[n]:
                continue
            row = _row(link, joint, m, motion, kinds[n])
            value[n] = row.value - targets[n]
            gamma[n] = row.gamma
            store(W[n, 0, 0:3], row.e, -1.0)
            store(W[n, 0, 3:6], row.c_i, 1.0)
            store(W[n, 1, 0:3], row.e, 1.0)
            store(W[n, 1, 3:6], row.c_j, 1.0)


@inner
def wrenches_of_rows(touched: Array, layout: Array, Q: Array, A: Array, W: Array) -> None:
    """Fill the wrenches of the rows from a constraint Jacobian of all bodies.

    Parameters
    ----------
    touched, layout : see `arrays`
    Q : ndarray, shape (q, 6 n_b)
        Rows in (world, body) axes.
    A : ndarray, shape (n_b, 3, 3)
        Rotation matrices of the bodies.
    W : ndarray, shape (q, 4, 6)
        Overwritten: wrenches in world axes.
    """
    for row in range(touched.shape[0]):
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                b = layout[link].body
                at = 6 * b
                store(W[row, n, 0:3], load(Q[row, at : at + 3]), 1.0)
                store(W[row, n, 3:6], rotate(A[b], load(Q[row, at + 3 : at + 6])), 1.0)


@inner
def acceleration_residual(touched: Array, W: Array, links: Array, gamma: Array, target: Array) -> None:
    """Compute ``gamma - Q a`` from the accelerations of the links.

    Parameters
    ----------
    touched, W : see `arrays`
    links : ndarray
        Table of the links.
    gamma : ndarray, shape (q,)
    target : ndarray, shape (q,)
        Overwritten: the residual.
    """
    for row in range(touched.shape[0]):
        total = gamma[row]
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                total -= dot(load(W[row, n, 0:3]), load(links[link].acceleration[0]))
                total -= dot(load(W[row, n, 3:6]), load(links[link].acceleration[1]))
        target[row] = total


@inner
def velocity_residual(touched: Array, W: Array, links: Array, rate: Array, target: Array) -> None:
    """Compute ``rate - Q v`` from the velocities of the links; arguments as of `acceleration_residual`.

    Parameters
    ----------
    touched, W, links, target : see `acceleration_residual`
    rate : ndarray, shape (q,)
    """
    for row in range(touched.shape[0]):
        total = rate[row]
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                total -= dot(load(W[row, n, 0:3]), load(links[link].velocity))
                total -= dot(load(W[row, n, 3:6]), load(links[link].spin))
        target[row] = total


@inner
def largest_row(mass: Array, inertia_factor: Array, touched: Array, layout: Array, W: Array, A: Array) -> float:
    """Return the largest ``|L^-1 q|`` of a row q of free bodies, M = L L^T: an upper bound of its response in the tree.

    Parameters
    ----------
    mass : ndarray, shape (n_b,), kg
    inertia_factor : ndarray, shape (n_b, 3, 3)
        Cholesky factors of the inertias, axes of the bodies.
    touched, layout, W : see `arrays`
    A : ndarray, shape (n_b, 3, 3)
        Rotation matrices of the bodies.
    """
    largest = 0.0
    for row in range(touched.shape[0]):
        total = 0.0
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                b = layout[link].body
                force, torque = load(W[row, n, 0:3]), rotate_back(A[b], load(W[row, n, 3:6]))
                L = inertia_factor[b]
                w0 = torque[0] / L[0, 0]
                w1 = (torque[1] - L[1, 0] * w0) / L[1, 1]
                w2 = (torque[2] - L[2, 0] * w0 - L[2, 1] * w1) / L[2, 2]
                total += dot(force, scale(1.0 / mass[b], force)) + w0 * w0 + w1 * w1 + w2 * w2
        largest = max(largest, np.sqrt(total))
    return largest
