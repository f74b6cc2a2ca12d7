"""Spanning tree of a mechanism as arrays, and its joint kinematics at a state, for the recursive formulations.

    a_k = X_k a_p + S_k u_k + c_k                                  [C4 (4.99)-(4.101); Featherstone 2008, chapter 4]

Each body is a link of the tree, carried by one tree joint. The free directions of a tree joint complement its rows in
the joint table: along the axes of F without an X, Y, Z row, and about the axes that the D rows leave free. Other joints
are cut; they keep their rows, as do drives, couplings and contacts.

Accelerations and wrenches of a link are (linear, angular) in world axes at its centre of mass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import JOINT_KINDS, Array, Mechanism, spanning_tree
from consilience.reference.bodies.arrays import Model, all_rows, flatten
from consilience.reference.bodies.motion import ZERO, arm, motion
from consilience.reference.kernel.compiled import allocating, inner
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.kernel.vectors import (
    Vector,
    add,
    column,
    cross,
    dot,
    load,
    rotate,
    rotate_back,
    scale,
    store,
    sub,
)

_F, _M = 0, 1
_ALONG, _ABOUT = 0, 1

_TURNS: dict[frozenset[str], tuple[tuple[int, int], ...]] = {
    frozenset(): ((_F, 0), (_F, 1), (_F, 2)),
    frozenset({"D31"}): ((_F, 2), (_M, 0)),  # held about u_3 x w_1, so free about u_3 and w_1, which are orthogonal
    frozenset({"D13", "D23"}): ((_F, 2),),
    frozenset({"D12", "D13", "D23"}): (),
}
"""Axes (frame, number) about which the D rows of a joint leave it free."""


class TreeModel(NamedTuple):
    """Spanning tree of n_b links, parents first, with N free directions."""

    body: Array  # (n_b,) body of the link
    parent: Array  # (n_b,) parent link, -1 for the ground
    joint: Array  # (n_b,) tree joint
    sign: Array  # (n_b,) +1, or -1 where the tree passes the joint from successor to predecessor
    first_free: Array  # (n_b + 1,)
    direction: Array  # (N, 3) axis of F (0) or M (1); number of the axis; along it (0) or about it (1)
    cut: Model  # the mechanism with the rows that the tree does not satisfy
    cut_rows: int  # their number


def tree_rows(kind: str) -> tuple[str, ...]:
    """Return the rows of a tree joint that its free directions satisfy; other rows are treated as loop rows.

    The free directions of a rod are fixed neither to F nor to M, and a screw couples two: in the tree a rod is a free
    joint and a screw a cylindrical one.
    """
    return tuple(row for row in JOINT_KINDS[kind].rows if row not in ("L", "H"))


def free_axes(kind: str) -> list[tuple[int, int, int]]:
    """Return the free directions of a joint kind in the tree: rows of `TreeModel.direction`."""
    rows = tree_rows(kind)
    along = [(_F, n, _ALONG) for n in range(3) if "XYZ"[n] not in rows]
    turns = _TURNS[frozenset(row for row in rows if row[0] == "D")]
    return along + [(frame, n, _ABOUT) for frame, n in turns]


def _open_rows(mechanism: Mechanism, closing: list[int]) -> Model:
    """Return the model with the joint rows that the tree does not satisfy; drives, couplings and contacts stay."""
    model = flatten(mechanism)
    chosen: list[int] = []
    first = [0]
    for k, joint in enumerate(mechanism.joints):
        taken = () if k in closing else tree_rows(joint.kind)
        chosen += [int(model.first_row[k]) + n for n, row in enumerate(joint.rows) if row not in taken]
        first.append(len(chosen))
    return model._replace(
        first_row=np.array(first, dtype=np.int64), row_kind=model.row_kind[chosen], row_target=model.row_target[chosen]
    )


def flatten_tree(mechanism: Mechanism) -> TreeModel:
    """Convert the spanning tree of a mechanism to arrays."""
    joints, closing = spanning_tree(mechanism)
    index = mechanism.body_index
    link_of = {-1: -1}
    body: list[int] = []
    parent: list[int] = []
    directions: list[list[tuple[int, int, int]]] = []
    for k, backward in joints:
        joint = mechanism.joints[k]
        ends = (index[joint.predecessor], index[joint.successor])
        start, end = ends[::-1] if backward else ends
        parent.append(link_of[start])
        link_of[end] = len(body)
        body.append(end)
        directions.append(free_axes(joint.kind))
    cut = _open_rows(mechanism, closing)
    return record_of(
        TreeModel(
            body=np.array(body, dtype=np.int64),
            parent=np.array(parent, dtype=np.int64),
            joint=np.array([k for k, _ in joints], dtype=np.int64),
            sign=np.array([-1.0 if backward else 1.0 for _, backward in joints]),
            first_free=np.cumsum([0, *(len(d) for d in directions)]).astype(np.int64),
            direction=np.array([axis for d in directions for axis in d], dtype=np.int64).reshape(-1, 3),
            cut=cut,
            cut_rows=all_rows(cut),
        )
    )


class TreeState(NamedTuple):
    """Joint kinematics and inertias of n_b links at a state, N free directions."""

    X: Array  # (n_b, 6, 6) transport from the parent to the link
    S: Array  # (N, 6) free directions, one a row
    c: Array  # (n_b, 6) bias accelerations
    inertia: Array  # (n_b, 6, 6) diag(m 1, I) in world axes


@inner
def _transport(r: Vector, X: Array) -> None:
    """Write ``X = [1 -~r; 0 1]``, so that ``a_k = a_p + alpha_p x r``."""
    for n in range(6):
        X[n, n] = 1.0
    X[0, 4], X[0, 5] = r[2], -r[1]
    X[1, 3], X[1, 5] = -r[2], r[0]
    X[2, 3], X[2, 4] = r[1], -r[0]


@inner
def _joint_step(tree: TreeModel, model: Model, y: Array, A: Array, k: int, links: TreeState) -> None:
    """Write X, S and c of the tree joint of link k, from the motion of the origin P of M relative to F.

    With s from the centres of mass of predecessor i and successor j to P, e the free axes and q' their rates,

        a_j + alpha_j x s_j + w_j x (w_j x s_j) = a_i + alpha_i x s_i + w_i x (w_i x s_i)
                                                  + sum_along (e u + 2 w_i x e q')
        alpha_j = alpha_i + sum_about (e u + w_e x e q'),     w_e = w_i for an axis of F, w_j for one of M

    solved for the acceleration of the link. If the link is the predecessor, all but X and s change sign.

    Parameters
    ----------
    tree : TreeModel
    model : Model
    y, A : ndarray, shape (n_b + n_e, 13) and (n_b, 3, 3)
    k : int
        Link.
    links : TreeState
        Row k is overwritten.
    """
    joint, sign = tree.joint[k], tree.sign[k]
    i, j = model.body_i[joint], model.body_j[joint]
    r_i, v_i, w_i = motion(y, A, i)
    r_j, v_j, w_j = motion(y, A, j)
    s_j = arm(A, j, load(model.arm_j[joint]))
    s_i = sub(add(r_j, s_j), r_i)
    s = s_j if sign > 0 else s_i
    v_rel = sub(add(v_j, cross(w_j, s_j)), add(v_i, cross(w_i, s_i)))
    w_rel = sub(w_j, w_i)
    linear = sub(cross(w_i, cross(w_i, s_i)), cross(w_j, cross(w_j, s_j)))
    angular = ZERO
    for n in range(tree.first_free[k], tree.first_free[k + 1]):
        on_F, axis, about = tree.direction[n, 0] == 0, tree.direction[n, 1], tree.direction[n, 2] == 1
        e = arm(A, i, column(model.axes_i[joint], axis)) if on_F else arm(A, j, column(model.axes_j[joint], axis))
        e_dot = cross(w_i, e) if on_F else cross(w_j, e)
        if about:
            angular = add(angular, scale(dot(e, w_rel), e_dot))
            store(links.S[n, 0:3], cross(s, e), sign)
            store(links.S[n, 3:6], e, sign)
        else:
            linear = add(linear, scale(2.0 * dot(e, v_rel), e_dot))
            store(links.S[n, 0:3], e, sign)
    _transport(scale(sign, sub(r_j, r_i)), links.X[k])
    store(links.c[k, 0:3], add(linear, cross(s, angular)), sign)
    store(links.c[k, 3:6], angular, sign)


@allocating
def kinematics(tree: TreeModel, model: Model, y: Array, A: Array) -> TreeState:
    """Evaluate X, S, c and world inertias of all links at a state, in any order: velocities are known."""
    n = tree.body.shape[0]
    links = TreeState(np.zeros((n, 6, 6)), np.zeros((tree.first_free[n], 6)), np.zeros((n, 6)), np.zeros((n, 6, 6)))
    for k in range(n):
        b = tree.body[k]
        _joint_step(tree, model, y, A, k, links)
        for axis in range(3):
            links.inertia[k, axis, axis] = model.mass[b]
        links.inertia[k, 3:6, 3:6] = A[b] @ model.inertia[b] @ A[b].T
    return links


@allocating
def world_wrenches(tree: TreeModel, A: Array, f: Array) -> Array:
    """Convert generalised forces (world, body axes) of all bodies to wrenches on the links, world axes, (n_b, 6)."""
    wrench = np.empty((tree.body.shape[0], 6))
    for k in range(tree.body.shape[0]):
        b = tree.body[k]
        store(wrench[k, 0:3], load(f[6 * b : 6 * b + 3]), 1.0)
        store(wrench[k, 3:6], rotate(A[b], load(f[6 * b + 3 : 6 * b + 6])), 1.0)
    return wrench


@inner
def write_accelerations(tree: TreeModel, A: Array, acc: Array, a: Array) -> None:
    """Write the accelerations of the links as (dv/dt, dw'/dt), ``dw'/dt = A^T alpha``, into a, shape (6 n_b,)."""
    for k in range(tree.body.shape[0]):
        b = tree.body[k]
        store(a[6 * b : 6 * b + 3], load(acc[k, 0:3]), 1.0)
        store(a[6 * b + 3 : 6 * b + 6], rotate_back(A[b], load(acc[k, 3:6])), 1.0)
