"""Rows that close loops, as wrenches on the few links that each of them touches: no array of rows times bodies."""

from __future__ import annotations

import numpy as np

from consilience.reference.compiled import inner, kernel
from consilience.reference.joint_rows import joint_motion, joint_row
from consilience.reference.relative.columns import ACCELERATION
from consilience.reference.relative.kinematics import vector_at
from consilience.reference.relative.loops import CHOSEN, ROW, TOUCHED
from consilience.reference.relative.model import BODY, CutJoints
from consilience.reference.vectors import dot, load, rotate, rotate_back, scale, store
from consilience.spatial import Array


@kernel
def want(group: Array, order: Array, state: Array, wanted: Array) -> None:
    """Mark the rows chosen: those that depend on them enter no acceleration."""
    for n in range(wanted.shape[0]):
        wanted[n] = 0
    for g in range(group.shape[0]):
        for n in range(group[g, ROW], group[g, ROW] + state[g, CHOSEN]):
            wanted[order[n]] = 1


@inner
def joint_rows(joints: CutJoints, wanted: Array, y: Array, A: Array, W: Array, value: Array, gamma: Array) -> None:
    """Rows wanted of the joints that close loops: wrenches on predecessor and successor, values and gammas."""
    closing, first_row, row_kind, row_target, body_i, body_j, arm_i, arm_j, axes_i, axes_j, pitch = joints
    for m in range(closing.shape[0]):
        k = closing[m]
        motion = joint_motion(body_i, body_j, arm_i, arm_j, y, A, k)
        for n in range(first_row[k], first_row[k + 1]):
            if not wanted[n]:
                continue
            row = joint_row(axes_i[k], axes_j[k], pitch[k], A, motion, row_kind[n])
            value[n] = row.value - row_target[n]
            gamma[n] = row.gamma
            store(W[n, 0, 0:3], row.e, -1.0)
            store(W[n, 0, 3:6], row.c_i, 1.0)
            store(W[n, 1, 0:3], row.e, 1.0)
            store(W[n, 1, 3:6], row.c_j, 1.0)


@kernel
def gather(touched: Array, layout: Array, Q: Array, A: Array, W: Array) -> None:
    """Wrenches out of the rows of all bodies."""
    for row in range(touched.shape[0]):
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                b = layout[link, BODY]
                at = 6 * b
                store(W[row, n, 0:3], load(Q[row, at : at + 3]), 1.0)
                store(W[row, n, 3:6], rotate(A[b], load(Q[row, at + 3 : at + 6])), 1.0)


@kernel
def open_accelerations(touched: Array, W: Array, links: Array, gamma: Array, target: Array) -> None:
    """``gamma - Q a`` of the accelerations of the links."""
    for row in range(touched.shape[0]):
        total = gamma[row]
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                total -= dot(load(W[row, n, 0:3]), vector_at(links, link, ACCELERATION))
                total -= dot(load(W[row, n, 3:6]), vector_at(links, link, ACCELERATION + 3))
        target[row] = total


@kernel
def open_rates(touched: Array, layout: Array, W: Array, y: Array, A: Array, rate: Array, target: Array) -> None:
    """``rate - Q v`` of the velocities of the bodies."""
    for row in range(touched.shape[0]):
        total = rate[row]
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                b = layout[link, BODY]
                total -= dot(load(W[row, n, 0:3]), load(y[b, 7:10]))
                total -= dot(load(W[row, n, 3:6]), rotate(A[b], load(y[b, 10:13])))
        target[row] = total


@kernel
def size_of_rows(mass: Array, inertia_factor: Array, touched: Array, layout: Array, W: Array, A: Array) -> float:
    """Largest ``|L^-1 q|`` of a row for bodies without joints: what its response in the tree comes to at most."""
    largest = 0.0
    for row in range(touched.shape[0]):
        total = 0.0
        for n in range(TOUCHED):
            link = touched[row, n]
            if link >= 0:
                b = layout[link, BODY]
                force, torque = load(W[row, n, 0:3]), rotate_back(A[b], load(W[row, n, 3:6]))
                L = inertia_factor[b]
                w0 = torque[0] / L[0, 0]
                w1 = (torque[1] - L[1, 0] * w0) / L[1, 1]
                w2 = (torque[2] - L[2, 0] * w0 - L[2, 1] * w1) / L[2, 2]
                total += dot(force, scale(1.0 / mass[b], force)) + w0 * w0 + w1 * w1 + w2 * w2
        largest = max(largest, np.sqrt(total))
    return largest
