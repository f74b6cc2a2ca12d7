"""A mechanism as flat arrays: what the compiled kernels read.

One compilation serves all mechanisms, because only the sizes of the arrays differ. Vectors of a body are taken from
its **centre of mass**, in body axes; body -1 is the ground, whose vectors are from the world origin.

The state of the solver is an array y of shape (n_b, 13): r (centre of mass, world), p (Euler parameters), v (of the
centre of mass, world), w' (angular velocity, body axes).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import BASIC_CONSTRAINTS, Mechanism, State
from consilience.spatial import Array, rotation_from_quaternion

R, P, V, W = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)
"""Columns of y."""


class Model(NamedTuple):
    """Flat arrays of a mechanism; n_b bodies, n_j joints, q rows, n_s springs, n_k joint springs, n_l loads."""

    gravity: Array  # (3,)
    mass: Array  # (n_b,)
    inertia: Array  # (n_b, 3, 3) about the centre of mass, body axes
    inertia_factor: Array  # (n_b, 3, 3) lower Cholesky factor of the inertia
    length: float  # a length typical of the mechanism, to scale tolerances, m
    body_i: Array  # (n_j,) predecessor
    body_j: Array  # (n_j,) successor
    arm_i: Array  # (n_j, 3) s_i'
    arm_j: Array  # (n_j, 3) s_j'
    axes_i: Array  # (n_j, 3, 3) A_Ji
    axes_j: Array  # (n_j, 3, 3) A_Jj
    first_row: Array  # (n_j + 1,)
    row_kind: Array  # (q,) index into BASIC_CONSTRAINTS
    row_target: Array  # (q,)
    spring_body: Array  # (n_s, 2)
    spring_arm: Array  # (n_s, 2, 3)
    spring_law: Array  # (n_s, 3) k, c, L0
    joint_spring: Array  # (n_k, 2) joint, 0 for an angle or 1 for a distance
    joint_spring_law: Array  # (n_k, 3) k, c, rest
    load_body: Array  # (n_l,)
    load_kind: Array  # (n_l, 2) 0 force or 1 torque; 0 world or 1 body
    load_vector: Array  # (n_l, 3)
    load_arm: Array  # (n_l, 3)


def _table(rows: list[list[float]], width: int) -> Array:
    return np.array(rows, dtype=float).reshape(-1, width)


def _indices(rows: list[int] | list[list[int]], *width: int) -> Array:
    return np.array(rows, dtype=np.int64).reshape(-1, *width)


def flatten(mechanism: Mechanism) -> Model:
    """Flat arrays of a mechanism."""
    index = mechanism.body_index

    def arm(body: str, point: Array) -> Array:
        return point if index[body] < 0 else point - mechanism.bodies[index[body]].com

    joints, springs, loads = mechanism.joints, mechanism.springs, mechanism.loads
    arms_i = [arm(j.predecessor, j.F.p) for j in joints]
    arms_j = [arm(j.successor, j.M.p) for j in joints]
    counts = [len(j.rows) for j in joints]
    inertia = np.array([b.inertia for b in mechanism.bodies])
    lengths = [float(np.linalg.norm(a)) for a in (*arms_i, *arms_j)] + [j.length for j in joints]
    return Model(
        gravity=np.array(mechanism.gravity),
        mass=np.array([b.mass for b in mechanism.bodies]),
        inertia=inertia,
        inertia_factor=np.linalg.cholesky(inertia),
        length=max(lengths) or 1.0,
        body_i=_indices([index[j.predecessor] for j in joints]),
        body_j=_indices([index[j.successor] for j in joints]),
        arm_i=np.array(arms_i).reshape(-1, 3),
        arm_j=np.array(arms_j).reshape(-1, 3),
        axes_i=np.array([j.F.R for j in joints]).reshape(-1, 3, 3),
        axes_j=np.array([j.M.R for j in joints]).reshape(-1, 3, 3),
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        row_kind=_indices([BASIC_CONSTRAINTS.index(row) for j in joints for row in j.rows]),
        row_target=np.array([j.length if row == "L" else 0.0 for j in joints for row in j.rows]),
        spring_body=_indices([[index[s.predecessor], index[s.successor]] for s in springs], 2),
        spring_arm=np.array(
            [[arm(s.predecessor, s.point_predecessor), arm(s.successor, s.point_successor)] for s in springs]
        ).reshape(-1, 2, 3),
        spring_law=_table([[s.stiffness, s.damping, s.free_length] for s in springs], 3),
        joint_spring=_indices(
            [[mechanism.joint_index[s.joint], int(s.coordinate == "distance")] for s in mechanism.joint_springs], 2
        ),
        joint_spring_law=_table([[s.stiffness, s.damping, s.rest] for s in mechanism.joint_springs], 3),
        load_body=_indices([index[load.body] for load in loads]),
        load_kind=_indices([[int(load.kind == "torque"), int(load.frame == "body")] for load in loads], 2),
        load_vector=np.array([load.vector for load in loads]).reshape(-1, 3),
        load_arm=np.array([arm(load.body, load.point) for load in loads]).reshape(-1, 3),
    )


def pack(mechanism: Mechanism, state: State) -> Array:
    """Solver state y of a canonical state, shape (n_b, 13)."""
    A = rotation_from_quaternion(state.quat_WB)
    c = np.einsum("bij,bj->bi", A, np.array([b.com for b in mechanism.bodies]))
    w = state.w_WB_W
    w_body = np.einsum("bji,bj->bi", A, w)
    return np.hstack([state.p_WB + c, state.quat_WB, state.v_WB_W + np.cross(w, c), w_body])


def unpack(mechanism: Mechanism, y: Array) -> tuple[Array, Array, Array, Array]:
    """Canonical p_WB, quat_WB, v_WB_W, w_WB_W of solver states, y of shape (..., n_b, 13)."""
    A = rotation_from_quaternion(y[..., P])
    c = np.einsum("...bij,bj->...bi", A, np.array([b.com for b in mechanism.bodies]))
    w = np.einsum("...bij,...bj->...bi", A, y[..., W])
    return y[..., R] - c, y[..., P].copy(), y[..., V] - np.cross(w, c), w
