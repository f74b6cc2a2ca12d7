"""Detection of mechanisms that move in parallel planes, and their arrays in the two coordinates of the plane.

Where the axes of all rotating joints between a link and the ground are parallel to a normal n, and all displacements
are orthogonal to n, the link keeps its distance from the plane and rotates about n alone. Branches of the tree may have
planes of their own if only couplings of their coordinates connect them. Three of the six equations of motion of a link
remain, and of a constraint row its part in the plane; the other equations hold for every motion. All vectors are in the
axes e_1, e_2 of the plane, vectors of a link as they are where all joint coordinates are zero: an angle theta of the
link from there rotates them by theta.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import Array, Mechanism
from consilience.reference.bodies.arrays import ANGLE, Model, all_rows
from consilience.reference.bodies.spanning_tree import TreeModel
from consilience.reference.kernel.record_type import new_record
from consilience.reference.tree.arrays import (
    PlanarArrays,
    TreeLinks,
    TreeSystem,
    link_records,
    loop_closure,
    tree_arrays,
)
from consilience.reference.tree.loop_groups import find_loop_groups
from consilience.reference.tree.records import (
    AXIS_DISPLACEMENT,
    AXIS_PRODUCT,
    CONTROL,
    DRIVEN,
    FRICTION,
    JOINT_ANGLE,
    JOINT_SPRING,
    LOAD,
    PLANAR_FORCE,
    PLANAR_FREE,
    PLANAR_LINK,
    PLANAR_ROW,
    ROD_LENGTH,
    SPRING,
)

_ROUNDING_ANGLE = 1e-13
"""Sine of an angle that counts as rounding."""
ROUNDING_LENGTH = 1e-12
"""Distance, as part of the length of a mechanism, that counts as rounding."""


class _NotPlanar(Exception):
    """Some link may move out of the plane."""


class _ZeroPose(NamedTuple):
    """Links and bodies where all joint coordinates are zero, in world axes."""

    joint: Array  # (n_b, 3, 3) axes of the joint frames F and M, equal in this pose
    arm_parent: Array  # (n_b, 3)
    arm: Array  # (n_b, 3)
    position: Array  # (n_b + 1, 3) centres of mass; the ground is last
    R: Array  # (n_b + 1, 3, 3) axes of the bodies
    link: Array  # (n_b + 1,) link of each body; -1 for the ground


def _zero_pose(links: TreeLinks) -> _ZeroPose:
    n = len(links.layout)
    X, position = np.tile(np.eye(3), (n + 1, 1, 1)), np.zeros((n + 1, 3))
    R, arms, link = np.tile(np.eye(3), (n + 1, 1, 1)), np.zeros((2, n, 3)), np.full(n + 1, -1)
    for k, given in enumerate(link_records(links, np.zeros(3))[:-1]):
        p = given.parent
        X[k] = X[p] @ given.inboard_axes.T
        arms[0, k] = X[p] @ given.parent_arm
        arms[1, k] = X[k] @ given.arm
        position[k] = position[p] + arms[0, k] - arms[1, k]
        R[k] = X[k] @ given.body_axes.T
        link[links.layout[k].body] = k
    return _ZeroPose(X[:-1], arms[0], arms[1], position, R, link)


def _axes(links: TreeLinks, zero: _ZeroPose, k: int, first: int, last: int) -> Array:
    """Return the axes of consecutive free directions of a link, as rows."""
    return np.asarray(zero.joint[k][:, links.direction[first:last, 1]].T)


def _basis(normal: Array) -> Array:
    """Return two axes of a plane and its normal, as rows."""
    normal = normal / np.linalg.norm(normal)
    first = np.eye(3)[np.argmin(np.abs(normal))]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def _plane_bases(links: TreeLinks, zero: _ZeroPose) -> Array:
    """Return the basis of the plane of each link, shape (n_b, 3, 3): one for all links of a branch from the ground."""
    layout, count = links.layout, len(links.layout)
    root = np.arange(count)
    along, about = [np.zeros((0, 3)) for _ in range(count)], [np.zeros((0, 3)) for _ in range(count)]
    for k, row in enumerate(layout):
        if row.rotations > 1:
            raise _NotPlanar
        root[k] = k if row.parent < 0 else root[row.parent]
        middle = row.free + row.translations
        along[root[k]] = np.vstack([along[root[k]], _axes(links, zero, k, row.free, middle)])
        about[root[k]] = np.vstack([about[root[k]], _axes(links, zero, k, middle, row.free_end)])
    found = list[Array]()
    bases = np.zeros((count, 3, 3))
    # branches with rotations first: a branch that only slides may lie in one of their planes
    for k in sorted(set(root.tolist()), key=lambda k: -len(about[k])):
        choices = [basis[2] for basis in found] if not len(about[k]) else [about[k][0]]
        choices += [_orthogonal_to(along[k])] if not len(about[k]) else []
        lying = [n for n in choices if np.all(np.abs(along[k] @ n) <= _ROUNDING_ANGLE)]
        if not lying or np.any(np.linalg.norm(np.cross(about[k], lying[0]), axis=1) > _ROUNDING_ANGLE):
            raise _NotPlanar
        same = [basis for basis in found if np.linalg.norm(np.cross(basis[2], lying[0])) <= _ROUNDING_ANGLE]
        if not same:
            found.append(_basis(lying[0]))
        bases[root == k] = same[0] if same else found[-1]
    return bases


def _orthogonal_to(axes: Array) -> Array:
    """Return a unit vector orthogonal to all axes, if there is one."""
    return np.asarray(np.linalg.svd(np.vstack([np.zeros((3, 3)), axes]))[2][2])


def _link_records(links: TreeLinks, mechanism: Mechanism, model: Model, zero: _ZeroPose, bases: Array) -> Array:
    layout, flat = links.layout, bases[:, :2]
    found = np.zeros(len(layout) + 1, PLANAR_LINK)
    rows = found[:-1]
    rows["parent"], rows["sense"] = layout["parent"], 2.0 * layout["forward"] - 1.0
    rows["first"], rows["last"] = layout["free"], layout["free_end"]
    axis = np.einsum("ki,ki->k", zero.joint[:, :, 2], bases[:, 2])
    rows["rotation_sense"] = rows["sense"] * layout["rotations"] * np.sign(axis)
    rows["parent_arm"] = np.einsum("kij,kj->ki", flat, zero.arm_parent)
    rows["arm"] = np.einsum("kij,kj->ki", flat, zero.arm)
    body = layout["body"]
    rows["mass"] = model.mass[body]
    normals = np.einsum("kij,ki->kj", zero.R[:-1], bases[:, 2])
    rows["inertia"] = np.einsum("ki,kij,kj->k", normals, model.inertia[body], normals)
    rows["weight"] = rows["mass"][:, None] * (flat @ mechanism.gravity)
    found["turn"][-1] = 1.0, 0.0
    return found


def _free_records(links: TreeLinks, zero: _ZeroPose, bases: Array) -> Array:
    found = np.zeros(len(links.direction), PLANAR_FREE)
    for k, row in enumerate(links.layout):
        first, last = row.free, row.free + row.translations
        found["direction"][first:last] = _axes(links, zero, k, first, last) @ bases[k, :2].T
    return found


def _common_basis(bases: Array, i: int, j: int) -> Array:
    """Return the basis of the plane of two links, one of which may be the ground (-1)."""
    if min(i, j) >= 0 and not np.array_equal(bases[i], bases[j]):
        raise _NotPlanar
    return np.asarray(bases[max(i, j)])


class _RowCollector:
    """Collects the rows of a mechanism in a plane: constraint rows, then joint coordinates that elements read."""

    def __init__(self, links: TreeLinks, spanning: TreeModel, model: Model, zero: _ZeroPose, bases: Array) -> None:
        self.links, self.spanning, self.model, self.zero, self.bases = links, spanning, model, zero, bases
        self.rows: list[Any] = []

    def _holds(self, value: float) -> bool:
        if abs(value) > ROUNDING_LENGTH * max(1.0, self.model.length):
            raise _NotPlanar
        return False

    def add(self, joint: int, kind: int, target: float) -> bool:
        """Add a basic constraint function of a joint; return False if it holds for every motion in the plane."""
        model = self.model
        i, j = (int(self.zero.link[b[joint]]) for b in (model.body_i, model.body_j))
        basis = _common_basis(self.bases, i, j)
        flat, normal = basis[:2], basis[2]
        R_i, R_j = self.zero.R[i], self.zero.R[j]
        arm_i, arm_j = R_i @ model.arm_i[joint], R_j @ model.arm_j[joint]
        height = float((self.zero.position[j] + arm_j - self.zero.position[i] - arm_i) @ normal)
        row = new_record(PLANAR_ROW)
        row.i, row.j, row.arm_i, row.arm_j = i, j, flat @ arm_i, flat @ arm_j
        if kind < 3:
            u, w, level = R_i @ model.axes_i[joint][:, kind], normal, height
        elif kind == 3:
            u, w, level = normal, normal, 0.0
        elif kind < 13:
            u, w = R_i @ model.axes_i[joint][:, (kind - 4) // 3], R_j @ model.axes_j[joint][:, (kind - 4) % 3]
            level = float(w @ normal)
        else:
            raise _NotPlanar
        row.axis_i, row.axis_j = flat @ u, flat @ w
        # the component along the normal is constant
        row.target = target - level * float(u @ normal)
        row.kind = AXIS_DISPLACEMENT if kind < 3 else ROD_LENGTH if kind == 3 else AXIS_PRODUCT
        if kind == 3:
            row.normal_distance = height
        elif min(np.linalg.norm(flat @ u), 1.0 if kind < 3 else np.linalg.norm(flat @ w)) <= _ROUNDING_ANGLE:
            return self._holds(row.target)
        self.rows.append(row)
        return True

    def coordinate(self, joint: int, kind: int) -> None:
        """Add a joint coordinate that elements read. Turns of a joint that closes a loop are not counted."""
        if self.model.pitch[joint]:
            raise _NotPlanar
        if kind != ANGLE:
            if not self.add(joint, 2, 0.0):
                raise _NotPlanar
            return
        link = np.flatnonzero(self.spanning.joint == joint)
        if not len(link) or self.links.layout[link[0]].rotations != 1:
            raise _NotPlanar
        row = new_record(PLANAR_ROW)
        row.kind = JOINT_ANGLE
        row.i, row.j = (self.zero.link[b[joint]] for b in (self.model.body_i, self.model.body_j))
        row.angle_index = self.links.layout[link[0]].free_end - 1
        row.angle_sense = np.sign(self.zero.joint[link[0], :, 2] @ self.bases[link[0], 2])
        self.rows.append(row)


def _springs(model: Model, zero: _ZeroPose, bases: Array) -> list[Any]:
    rows = []
    for spring in model.spring:
        links = zero.link[[spring.i, spring.j]]
        basis = _common_basis(bases, *links.tolist())
        arms = [zero.R[k] @ arm for k, arm in zip(links, (spring.arm_i, spring.arm_j), strict=True)]
        apart = zero.position[links[1]] + arms[1] - zero.position[links[0]] - arms[0]
        row = new_record(PLANAR_FORCE)
        row.kind, (row.i, row.j), row.function = SPRING, links, spring.actuator
        row.law, row.normal_distance = (spring.stiffness, spring.damping, spring.rest), apart @ basis[2]
        row.arm_i, row.arm_j = (basis[:2] @ a for a in arms)
        rows.append(row)
    return rows


def _loads(model: Model, zero: _ZeroPose, bases: Array) -> list[Any]:
    rows = []
    for load in model.load:
        link, along = zero.link[load.body], load.on_body
        basis = bases[link]
        vector = basis @ (zero.R[link] @ load.vector if along else load.vector)
        row = new_record(PLANAR_FORCE)
        row.kind, row.j, row.function, row.body_fixed = LOAD, link, load.history, along
        row.law = (0.0, 0.0, vector[2]) if load.is_torque else (vector[0], vector[1], 0.0)
        row.arm_j = basis[:2] @ zero.R[link] @ load.arm
        rows.append(row)
    return rows


def _joint_forces(model: Model, first: int, first_integral: int) -> list[Any]:
    """Return springs, friction and controls of joints; `first` is the row of the first joint coordinate."""
    given = [
        *((JOINT_SPRING, c, 0, f, law) for c, f, *law in model.joint_spring),
        *((FRICTION, c, 0, -1, law) for c, *law in model.friction),
        *((CONTROL, c, first_integral + n, f, law) for n, (c, f, *law) in enumerate(model.control)),
    ]
    rows = np.zeros(len(given), PLANAR_FORCE)
    for row, (kind, coordinate, at, function, law) in zip(rows, given, strict=True):
        row.kind, row.i, row.j, row.function, row.law = kind, first + coordinate, at, function, law
    return list(rows)


def planar_system(mechanism: Mechanism, links: TreeLinks, spanning: TreeModel, model: Model) -> TreeSystem | None:
    """Return the arrays of a mechanism in a plane, in place of those of `arrays.tree_system`.

    Returns
    -------
    TreeSystem or None
        None if a link may move out of the plane or rolls, or an element reads the turns of a joint that closes a loop.
    """
    try:
        if len(model.rolling) or len(model.skate):
            return None
        zero = _zero_pose(links)
        bases = _plane_bases(links, zero)
        collector = _RowCollector(links, spanning, model, zero, bases)
        cut, kept, first = spanning.cut, list[int](), [0]
        for joint in range(len(cut.body_i)):
            rows = range(cut.first_row[joint], cut.first_row[joint + 1])
            kept += [n for n in rows if collector.add(joint, int(cut.row_kind[n]), float(cut.row_target[n]))]
            first.append(len(kept))
        for joint, kind in model.coordinate:
            collector.coordinate(int(joint), int(kind))
        efforts = [*_springs(model, zero, bases), *_loads(model, zero, bases)]
    except _NotPlanar:
        return None
    cut = cut._replace(
        first_row=np.array(first, dtype=np.int64), row_kind=cut.row_kind[kept], row_target=cut.row_target[kept]
    )
    count = len(kept)
    driven = [(count + c, -1, f) for c, f in model.drive] + [(count + c, count + d, f) for c, d, f in model.coupling]
    efforts += _joint_forces(model, count, links.first_integral)
    height = np.einsum("ki,ki->k", zero.position[:-1], bases[:, 2])
    axes = (bases @ zero.R[:-1]).reshape(-1, 9), bases.reshape(-1, 9)
    planar = PlanarArrays(
        body=np.column_stack([links.layout["body"], height, *axes]),
        row_table=np.array(collector.rows, PLANAR_ROW),
        driven=np.array(driven, DRIVEN),
        force_table=np.array(efforts, PLANAR_FORCE),
        functions=model.functions,
    )
    link, free = _link_records(links, mechanism, model, zero, bases), _free_records(links, zero, bases)
    tree = tree_arrays(links, model.length, link, free, len(mechanism.controls))
    loops = find_loop_groups(links.layout, len(links.direction), cut)
    return TreeSystem(tree, loop_closure(tree, loops, all_rows(cut), 3), None, None, planar)
