"""Detection of mechanisms that move in parallel planes, and their arrays in the two coordinates of the plane.

Where the axes of all rotating joints between a link and the ground are parallel to a normal n, and all displacements
are orthogonal to n, the link keeps its distance from the plane and rotates about n alone. Branches of the tree may have
planes of their own if only couplings of their coordinates connect them. Three of the six equations of motion of a link
remain, and of a constraint row its part in the plane; the other equations hold for every motion. All vectors are in the
axes e_1, e_2 of the plane, vectors of a link as they are where all joint coordinates are zero: an angle theta of the
link from there rotates them by theta.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array, Mechanism
from consilience.reference.bodies.arrays import ANGLE, Model, all_rows
from consilience.reference.bodies.spanning_tree import TreeModel
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

    joint: Array  # (..., n_b, 3, 3) axes of the joint frames F and M, equal in this pose
    arm_parent: Array  # (..., n_b, 3)
    arm: Array  # (..., n_b, 3)
    position: Array  # (..., n_b + 1, 3) centres of mass; the ground is last
    R: Array  # (..., n_b + 1, 3, 3) axes of the bodies
    link: Array  # (n_b + 1,) link of each body; -1 for the ground

    @property
    def sets(self) -> tuple[int, ...]:
        """Shape of the parameter sets: () or (n,)."""
        return self.joint.shape[:-3]


def _zero_pose(links: TreeLinks) -> _ZeroPose:
    n, sets = len(links.layout), links.constants.shape[:-2]
    X, position = np.tile(np.eye(3), (*sets, n + 1, 1, 1)), np.zeros((*sets, n + 1, 3))
    R, arms, link = X.copy(), np.zeros((2, *sets, n, 3)), np.full(n + 1, -1)
    records = link_records(links, np.zeros(3))
    for k, row in enumerate(links.layout):
        p, given = row.parent, records[..., k]
        X[..., k, :, :] = X[..., p, :, :] @ np.swapaxes(given["inboard_axes"], -1, -2)
        arms[0, ..., k, :] = _turned(X[..., p, :, :], given["parent_arm"])
        arms[1, ..., k, :] = _turned(X[..., k, :, :], given["arm"])
        position[..., k, :] = position[..., p, :] + arms[0, ..., k, :] - arms[1, ..., k, :]
        R[..., k, :, :] = X[..., k, :, :] @ np.swapaxes(given["body_axes"], -1, -2)
        link[row.body] = k
    return _ZeroPose(X[..., :-1, :, :], arms[0], arms[1], position, R, link)


def _turned(R: Array, vector: Array) -> Array:
    """Return ``R v`` for matrices (..., 3, 3) and vectors (..., 3)."""
    return np.asarray((R @ vector[..., None])[..., 0])


def _axes(links: TreeLinks, zero: _ZeroPose, k: int, first: int, last: int) -> Array:
    """Return the axes of consecutive free directions of a link, as rows, shape (..., last - first, 3)."""
    return np.swapaxes(zero.joint[..., k, :, :][..., links.direction[first:last, 1]], -1, -2)


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
        along[root[k]] = np.vstack([along[root[k]], _axes(links, zero, k, row.free, middle).reshape(-1, 3)])
        about[root[k]] = np.vstack([about[root[k]], _axes(links, zero, k, middle, row.free_end).reshape(-1, 3)])
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


def _link_records(links: TreeLinks, model: Model, zero: _ZeroPose, bases: Array) -> Array:
    layout, flat = links.layout, bases[:, :2]
    found = np.zeros((*zero.sets, len(layout) + 1), PLANAR_LINK)
    rows = found[..., :-1]
    rows["parent"], rows["sense"] = layout["parent"], 2.0 * layout["forward"] - 1.0
    rows["first"], rows["last"] = layout["free"], layout["free_end"]
    axis = np.einsum("...ki,ki->...k", zero.joint[..., 2], bases[:, 2])
    rows["rotation_sense"] = rows["sense"] * layout["rotations"] * np.sign(axis)
    rows["parent_arm"] = np.einsum("kij,...kj->...ki", flat, zero.arm_parent)
    rows["arm"] = np.einsum("kij,...kj->...ki", flat, zero.arm)
    body = layout["body"]
    rows["mass"] = model.mass[..., body]
    normals = np.einsum("...kij,ki->...kj", zero.R[..., :-1, :, :], bases[:, 2])
    rows["inertia"] = np.einsum("...ki,...kij,...kj->...k", normals, model.inertia[..., body, :, :], normals)
    rows["weight"] = rows["mass"][..., None] * np.einsum("kij,...j->...ki", flat, model.gravity)
    found["turn"][..., -1, :] = 1.0, 0.0
    return found


def _free_records(links: TreeLinks, zero: _ZeroPose, bases: Array) -> Array:
    found = np.zeros((*zero.sets, len(links.direction)), PLANAR_FREE)
    for k, row in enumerate(links.layout):
        first, last = row.free, row.free + row.translations
        found["direction"][..., first:last, :] = _axes(links, zero, k, first, last) @ bases[k, :2].T
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
        self.rows: list[Array] = []

    def _holds(self, value: Array) -> bool:
        if np.max(np.abs(value)) > ROUNDING_LENGTH * max(1.0, self.model.length):
            raise _NotPlanar
        return False

    def table(self) -> Array:
        """Return all rows, shape (..., n_f)."""
        return np.stack([np.zeros(self.zero.sets, PLANAR_ROW), *self.rows], axis=-1)[..., 1:]

    def add(self, joint: int, kind: int, target: Array) -> bool:
        """Add a basic constraint function of a joint; return False if it holds for every motion in the plane."""
        model = self.model
        i, j = (int(self.zero.link[b[joint]]) for b in (model.body_i, model.body_j))
        basis = _common_basis(self.bases, i, j)
        flat, normal = basis[:2], basis[2]
        R_i, R_j = self.zero.R[..., i, :, :], self.zero.R[..., j, :, :]
        axes_i, axes_j = model.axes_i[..., joint, :, :], model.axes_j[..., joint, :, :]
        arm_i, arm_j = _turned(R_i, model.arm_i[..., joint, :]), _turned(R_j, model.arm_j[..., joint, :])
        height = (self.zero.position[..., j, :] + arm_j - self.zero.position[..., i, :] - arm_i) @ normal
        row = np.zeros(self.zero.sets, PLANAR_ROW)
        row["i"], row["j"], row["arm_i"], row["arm_j"] = i, j, arm_i @ flat.T, arm_j @ flat.T
        if kind < 3:
            u, w, level = _turned(R_i, axes_i[..., kind]), normal, height
        elif kind == 3:
            u, w, level = normal, normal, 0.0
        elif kind < 13:
            u, w = _turned(R_i, axes_i[..., (kind - 4) // 3]), _turned(R_j, axes_j[..., (kind - 4) % 3])
            level = w @ normal
        else:
            raise _NotPlanar
        row["axis_i"], row["axis_j"] = u @ flat.T, w @ flat.T
        # the component along the normal is constant
        row["target"] = target - level * (u @ normal)
        row["kind"] = AXIS_DISPLACEMENT if kind < 3 else ROD_LENGTH if kind == 3 else AXIS_PRODUCT
        if kind == 3:
            row["normal_distance"] = height
        else:
            in_plane = np.linalg.norm(row["axis_i"], axis=-1), np.linalg.norm(row["axis_j"], axis=-1)
            holds = np.minimum(in_plane[0], 1.0 if kind < 3 else in_plane[1]) <= _ROUNDING_ANGLE
            if np.any(holds):
                return self._holds(row["target"]) if np.all(holds) else self._holds(np.array(np.inf))
        self.rows.append(row)
        return True

    def coordinate(self, joint: int, kind: int) -> None:
        """Add a joint coordinate that elements read. Turns of a joint that closes a loop are not counted."""
        if np.any(self.model.pitch[..., joint]):
            raise _NotPlanar
        if kind != ANGLE:
            if not self.add(joint, 2, np.array(0.0)):
                raise _NotPlanar
            return
        link = np.flatnonzero(self.spanning.joint == joint)
        if not len(link) or self.links.layout[link[0]].rotations != 1:
            raise _NotPlanar
        row = np.zeros(self.zero.sets, PLANAR_ROW)
        row["kind"] = JOINT_ANGLE
        row["i"], row["j"] = (self.zero.link[b[joint]] for b in (self.model.body_i, self.model.body_j))
        row["angle_index"] = self.links.layout[link[0]].free_end - 1
        row["angle_sense"] = np.sign(self.zero.joint[..., link[0], :, 2] @ self.bases[link[0], 2])
        self.rows.append(row)


def _numbers(elements: Array, n: int, *names: str) -> tuple[int, ...]:
    """Return whole numbers of element n, which are those of every parameter set."""
    return tuple(int(elements[name][..., n].flat[0]) for name in names)


def _springs(model: Model, zero: _ZeroPose, bases: Array) -> Array:
    springs = model.spring
    rows = np.zeros((*zero.sets, springs.shape[-1]), PLANAR_FORCE)
    for n in range(springs.shape[-1]):
        i, j = zero.link[list(_numbers(springs, n, "i", "j"))]
        basis, row, spring = _common_basis(bases, i, j), rows[..., n], springs[..., n]
        arm_i, arm_j = _turned(zero.R[..., i, :, :], spring["arm_i"]), _turned(zero.R[..., j, :, :], spring["arm_j"])
        apart = zero.position[..., j, :] + arm_j - zero.position[..., i, :] - arm_i
        row["kind"], row["i"], row["j"], row["function"] = SPRING, i, j, spring["actuator"]
        row["law"] = np.stack([spring["stiffness"], spring["damping"], spring["rest"]], axis=-1)
        row["arm_i"], row["arm_j"], row["normal_distance"] = arm_i @ basis[:2].T, arm_j @ basis[:2].T, apart @ basis[2]
    return rows


def _loads(model: Model, zero: _ZeroPose, bases: Array) -> Array:
    loads = model.load
    rows = np.zeros((*zero.sets, loads.shape[-1]), PLANAR_FORCE)
    for n in range(loads.shape[-1]):
        body, along, is_torque = _numbers(loads, n, "body", "on_body", "is_torque")
        link, row, load = int(zero.link[body]), rows[..., n], loads[..., n]
        R, basis = zero.R[..., link, :, :], bases[link]
        row["kind"], row["j"], row["function"], row["body_fixed"] = LOAD, link, load["history"], along
        vector = (_turned(R, load["vector"]) if along else load["vector"]) @ basis.T
        row["law"] = vector * ((0.0, 0.0, 1.0) if is_torque else (1.0, 1.0, 0.0))
        row["arm_j"] = _turned(R, load["arm"]) @ basis[:2].T
    return rows


def _joint_forces(model: Model, sets: tuple[int, ...], first: int, first_integral: int) -> list[Array]:
    """Return springs, friction and controls of joints; `first` is the row of the first joint coordinate."""
    found = []
    for kind, elements, function, law in (
        (JOINT_SPRING, model.joint_spring, "actuator", ("stiffness", "damping", "rest")),
        (FRICTION, model.friction, None, ("viscous", "coulomb", "speed")),
        (CONTROL, model.control, "target", ("proportional", "integral", "derivative")),
    ):
        rows = np.zeros((*sets, elements.shape[-1]), PLANAR_FORCE)
        rows["kind"], rows["i"] = kind, first + elements["coordinate"]
        rows["function"] = elements[function] if function else -1
        rows["law"] = np.stack([elements[name] for name in law], axis=-1)
        rows["higher"] = elements["higher"] if kind == JOINT_SPRING else 0.0
        rows["j"] = first_integral + np.arange(elements.shape[-1]) if kind == CONTROL else 0
        found.append(rows)
    return found


def _bodies(links: TreeLinks, zero: _ZeroPose, bases: Array) -> Array:
    """Return body, height along the normal, axes at zero and axes of the plane of each link, shape (..., n_b, 20)."""
    found = np.empty((*zero.sets, len(links.layout), 20))
    found[..., 0], found[..., 1] = (
        links.layout["body"],
        np.einsum("...ki,ki->...k", zero.position[..., :-1, :], bases[:, 2]),
    )
    found[..., 2:11] = (bases @ zero.R[..., :-1, :, :]).reshape(*found.shape[:-1], 9)
    found[..., 11:] = bases.reshape(-1, 9)
    return found


class PlanarNumbers(NamedTuple):
    """Arrays of a mechanism in a plane, of one parameter set or, with an axis for them in front, of many."""

    link: Array  # (..., n_b + 1) of PLANAR_LINK
    free: Array  # (..., N) of PLANAR_FREE
    planar: PlanarArrays
    cut: Model  # with the rows that do not hold for every motion in the plane


def planar_numbers(links: TreeLinks, spanning: TreeModel, model: Model) -> PlanarNumbers | None:
    """Return the arrays of a mechanism in a plane; many parameter sets (`parameter_sets`) move in those of the first.

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
            kept += [n for n in rows if collector.add(joint, int(cut.row_kind[n]), cut.row_target[..., n])]
            first.append(len(kept))
        for joint, kind in model.coordinate:
            collector.coordinate(int(joint), int(kind))
        efforts = [_springs(model, zero, bases), _loads(model, zero, bases)]
    except _NotPlanar:
        return None
    cut = cut._replace(
        first_row=np.array(first, dtype=np.int64), row_kind=cut.row_kind[kept], row_target=cut.row_target[..., kept]
    )
    count = len(kept)
    driven = [(count + c, -1, f) for c, f in model.drive] + [(count + c, count + d, f) for c, d, f in model.coupling]
    efforts += _joint_forces(model, zero.sets, count, links.first_integral)
    planar = PlanarArrays(
        body=_bodies(links, zero, bases),
        row_table=collector.table(),
        driven=np.array(driven, DRIVEN),
        force_table=np.concatenate(efforts, axis=-1),
        functions=model.functions,
    )
    return PlanarNumbers(_link_records(links, model, zero, bases), _free_records(links, zero, bases), planar, cut)


def planar_system(mechanism: Mechanism, links: TreeLinks, spanning: TreeModel, model: Model) -> TreeSystem | None:
    """Return the arrays of a mechanism in a plane, in place of those of `arrays.tree_system`; see `planar_numbers`."""
    found = planar_numbers(links, spanning, model)
    if found is None:
        return None
    tree = tree_arrays(links, model.length, found.link, found.free, len(mechanism.controls))
    loops = find_loop_groups(links.layout, len(links.direction), found.cut)
    return TreeSystem(tree, loop_closure(tree, loops, all_rows(found.cut), 3), None, None, found.planar)
