"""State of the tree joints, arrays of the kernels, and the arguments that the kernels of this package share.

State. The vector z consists of coordinates, speeds of the N free directions, and integrals of controllers. The
coordinates of a tree joint are those of frame M relative to frame F: displacements along the free axes of F, then the
angle about z of F (revolute), the angles about z of F and x of M (universal), or Euler parameters (ball); none of these
charts is singular. A speed is the rate of a coordinate; the speeds of a ball are the angular velocity of M relative to
F in axes of F.

Sizes. n_b links (one for each body), N free directions, n_z components of z, q rows that close loops (of cut joints,
drives, couplings and contacts), G groups of such rows, n_e rows that hold integrals of controllers.

Common arguments. Kernels take the groups of arrays below as `kernel.mechanism_record` records. Lengths are in m,
angles in rad, forces in N, torques in N m. Motions and wrenches are (linear, angular) in world axes at the centre of
mass of a link; in a plane they have three components in the axes e_1, e_2, n of `planar_detection`.

tree : TreeArrays
    Tables of links and free directions, and the bodies.
closure : LoopClosure
    Loops and the arrays that their kernels write; None for a tree with gravity alone (or any tree in a plane).
spatial : SpatialArrays or None
    Arrays of the kernels of space; None for a mechanism in a plane.
elements : TreeElements or None
    Force elements and rows of other constraints than joints; None in a plane, and of a tree with gravity alone.
planar : PlanarArrays or None
    Arrays of the kernels of a plane; None in space.
link, free : ndarray of records, shapes (n_b + 1,) and (N,)
    The links (last: the ground) and the free directions: LINK and FREE of `records`, or PLANAR_LINK and PLANAR_FREE.
layout : ndarray of LAYOUT, shape (n_b,)
    Topology of the tree.
loops, qr : Loops and MultifrontalQR
    See `loop_groups`; their arrays group, touched, path, own_directions, owner and W, wrench, F, tau, x, y, order,
    state, active, target are arguments of their own in inner kernels.
elimination : EliminationArrays
    See `loop_groups`.
t, z, dz, u : float, ndarrays of shapes (n_z,), (n_z,), (N,)
    Time in s, state, its derivative, accelerations (or displacements) of the free directions.
first_speed : int
    Index of the first speed in z.
velocity_terms : float
    Factor of the accelerations quadratic in velocities: 1 for accelerations, 0 for displacements.
at_sample : bool
    Whether the state is a sample, and its loops are to be closed to rounding.

Numba prunes a branch ``if spatial is not None`` but not ``is None``: hence one argument for space, one for a plane.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from consilience.mechanism import Array, Mechanism
from consilience.reference.bodies.arrays import Model, Workspace, all_rows, flatten, workspace
from consilience.reference.bodies.records import LARGEST
from consilience.reference.bodies.residual import TURNS
from consilience.reference.bodies.spanning_tree import TreeModel, flatten_tree
from consilience.reference.kernel.functions import Functions
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.steppers.motion import ANGLE, DISTANCE, INTEGRAL, SPEED, SPIN
from consilience.reference.tree.loop_groups import (
    EliminationArrays,
    Loops,
    MultifrontalQR,
    elimination_arrays,
    find_loop_groups,
    multifrontal_arrays,
)
from consilience.reference.tree.loop_rows import CutJoints, cut_joints
from consilience.reference.tree.records import FREE, LAYOUT, LINK, constants_of


class TreeLinks(NamedTuple):
    """Spanning tree of n_b links, each behind its parent, with N free directions."""

    layout: Array  # (n_b,) of LAYOUT
    constants: Array  # (n_b, 31) of `records.constants_of`
    direction: Array  # (N, 3) frame of the axis, F (0) or M (1); its number; displacement (0) or rotation (1)
    kind: Array  # (n_z,) DISTANCE to INTEGRAL
    first_speed: int  # index of the first speed in z
    first_integral: int  # index of the first integral of a controller in z
    gravity_only: bool  # no force elements
    bare_tree: bool  # no force elements and no loops: `articulated.tree_accelerations` applies
    other_rows: int  # number of rows of drives, couplings and contacts
    position_rows: int  # number of rows that hold positions; velocity rows of rolling and skates follow
    loops: Loops
    com: Array  # (n_b, 3) centres of mass in axes of the bodies, m
    residuals: int  # size of the array `found` of `bodies.residual`


class TreeArrays(NamedTuple):
    """Arrays of a tree, without force elements, for an integrator."""

    layout: Array
    kind: Array
    link: Array  # (n_b + 1,) links and, last, the ground: see `records`
    free: Array  # (N,) free directions
    y: Array  # (n_b + n_e, 13) bodies as in `reference.bodies`, then integrals of controllers
    A: Array  # (n_b, 3, 3) rotation matrices
    first_speed: int
    length: float  # characteristic length of the mechanism, m


class SpatialArrays(NamedTuple):
    """Arrays that only kernels of space read: bodies as in `reference.bodies`, cut joints, elimination.

    Without elements y and A are those of the last sample.
    """

    y: Array
    A: Array
    mass: Array
    inertia_factor: Array
    joints: CutJoints
    elimination: EliminationArrays


class PlanarArrays(NamedTuple):
    """Arrays that only kernels of a plane read; vectors in the axes e_1, e_2, n of `planar_detection`."""

    body: Array  # (n_b, 20) body, height along n, axes of the body at zero in e_1, e_2, n; e_1, e_2, n in the world
    row_table: Array  # (n_f,) of PLANAR_ROW: rows of joints, then joint coordinates that elements read
    driven: Array  # (m,) of DRIVEN
    force_table: Array  # (m,) of PLANAR_FORCE
    functions: Functions


class LoopClosure(NamedTuple):
    """The tree, its q rows that close loops, and the arrays that their kernels write."""

    layout: Array
    link: Array
    free: Array
    first_speed: int
    length: float
    position_rows: int
    loops: Loops
    qr: MultifrontalQR
    value: Array  # (q,) violations of the rows
    gamma: Array  # (q,) right side of Q a = gamma
    rate: Array  # (q,) right side of Q v = rate
    u: Array  # (N,) accelerations, or displacements, of the free directions
    rank_limit: Array  # (1,) rank of the rows from the last projection
    best: Array  # (1,) of LARGEST
    row_norm: Array  # (1,) largest row, `loop_rows.largest_row`; zero before it is known


class TreeElements(NamedTuple):
    """Data for force elements and for constraints other than joints."""

    model: Model
    cut: Model  # the mechanism with only the rows that close loops
    turns: Array  # (n_c,) joint coordinates that elements read, turns counted
    rows: Workspace  # of `cut`
    first_integral: int
    gravity_only: bool
    other_rows: int
    read_bodies: bool  # whether there are any: bodies are then placed wherever links are


Spatial: TypeAlias = SpatialArrays | None
Planar: TypeAlias = PlanarArrays | None
"""Arrays of space and of a plane: one of the two is None."""


class TreeSystem(NamedTuple):
    """All arrays of a mechanism; kernels are compiled once for each combination of those that are None."""

    tree: TreeArrays
    closure: LoopClosure
    spatial: Spatial
    elements: TreeElements | None
    planar: Planar


def flatten_relative(mechanism: Mechanism) -> tuple[TreeLinks, TreeModel, Model]:
    """Return the spanning tree, its coordinates and the mechanism as flat arrays."""
    tree, model = flatten_tree(mechanism), flatten(mechanism)
    rows, kinds, speed_kinds = [], list[int](), list[int]()
    for k, body in enumerate(tree.body):
        first, last = int(tree.first_free[k]), int(tree.first_free[k + 1])
        turns = int(np.sum(tree.direction[first:last, 2]))
        along = last - first - turns
        parent = int(tree.parent[k])
        carrier = -1 if parent < 0 else int(tree.body[parent])
        rows.append((parent, carrier, int(body), bool(tree.sign[k] > 0), len(kinds), along, turns, first, last))
        kinds += [DISTANCE] * along + [ANGLE] * (turns if turns < 3 else 4)
        speed_kinds += [SPEED] * along + [SPIN] * turns
    elements = (mechanism.springs, mechanism.joint_springs, mechanism.loads, mechanism.frictions, mechanism.controls)
    cut = tree.cut
    layout = np.array(rows, LAYOUT)
    links = TreeLinks(
        layout=layout,
        constants=link_constants(tree, model),
        direction=tree.direction,
        kind=np.array([*kinds, *speed_kinds, *[INTEGRAL] * len(mechanism.controls)], dtype=np.int64),
        first_speed=len(kinds),
        first_integral=len(kinds) + len(speed_kinds),
        gravity_only=not any(elements),
        bare_tree=not any(elements) and not tree.cut_rows,
        other_rows=int(tree.cut_rows - len(cut.row_kind)),
        position_rows=all_rows(cut) - 2 * len(cut.rolling) - len(cut.skate),
        loops=find_loop_groups(layout, len(speed_kinds), cut),
        com=np.array([body.com for body in mechanism.bodies]),
        residuals=TURNS + 2 * len(model.coupling),
    )
    return record_of(links), tree, model


def link_constants(tree: TreeModel, model: Model) -> Array:
    """Return the constants of the links, shape (..., n_b, 31), as in `records.constants_of`."""
    forward = tree.sign > 0
    on_i, on_j = model.axes_i[..., tree.joint, :, :], model.axes_j[..., tree.joint, :, :]
    arm_i, arm_j = model.arm_i[..., tree.joint, :], model.arm_j[..., tree.joint, :]
    inboard, outboard = np.where(forward[:, None, None], on_i, on_j), np.where(forward[:, None, None], on_j, on_i)
    arm_inboard, arm_outboard = np.where(forward[:, None], arm_i, arm_j), np.where(forward[:, None], arm_j, arm_i)
    # parent -1 selects the last entry, the ground
    ground = np.broadcast_to(np.eye(3), (*outboard.shape[:-3], 1, 3, 3))
    base = np.concatenate([outboard, ground], axis=-3)[..., tree.parent, :, :]
    turned = np.swapaxes(outboard, -1, -2)
    inertia = turned @ model.inertia[..., tree.body, :, :] @ outboard
    matrices = (*outboard.shape[:-2], 9)
    parts = [
        np.swapaxes(np.swapaxes(base, -1, -2) @ inboard, -1, -2).reshape(matrices),
        np.einsum("...kji,...kj->...ki", base, arm_inboard),
        np.einsum("...kij,...kj->...ki", turned, arm_outboard),
        model.mass[..., tree.body, None],
        inertia[..., *np.triu_indices(3)],
        outboard.reshape(matrices),
    ]
    return np.concatenate(parts, axis=-1)


def link_records(links: TreeLinks, gravity: Array) -> Array:
    """Return the links and, last, the ground, LINK of shape (..., n_b + 1), with constants alone."""
    layout = links.layout
    found = np.zeros((*links.constants.shape[:-2], len(layout) + 1), LINK)
    for field in ("parent", "coordinate", "translations", "rotations"):
        found[field][..., :-1] = layout[field]
    found["first"][..., :-1], found["last"][..., :-1] = layout["free"], layout["free_end"]
    found["is_revolute"][..., :-1] = (layout["translations"] == 0) & (layout["rotations"] == 1)
    found["sense"][..., :-1] = 2.0 * layout["forward"] - 1.0
    constants_of(found)[..., :-1, :] = links.constants
    ground = found[..., -1]
    ground["inboard_axes"][..., 0, :], ground["coordinate"], ground["axes"] = gravity, links.first_speed, np.eye(3)
    return found


def free_records(links: TreeLinks) -> Array:
    """Return the free directions, FREE of shape (N,)."""
    found = np.zeros(len(links.direction), FREE)
    found["axis"] = 3 * links.direction[:, 0] + links.direction[:, 1]
    return found


def tree_arrays(links: TreeLinks, length: float, link: Array, free: Array, controllers: int) -> TreeArrays:
    """Return the arrays of a tree without elements.

    Parameters
    ----------
    links : TreeLinks
    length : float, m
        Characteristic length of the mechanism.
    link, free : ndarray
        Records of links and free directions; see the module.
    controllers : int
        Number of integrals, which y has rows of 13 numbers for.
    """
    n = len(links.layout)
    return TreeArrays(
        layout=links.layout,
        kind=links.kind,
        link=link,
        free=free,
        y=np.zeros((n + -(-controllers // 13), 13)),
        A=np.zeros((n, 3, 3)),
        first_speed=links.first_speed,
        length=length,
    )


def loop_closure(tree: TreeArrays, loops: Loops, position_rows: int, width: int) -> LoopClosure:
    """Return the arrays of loop closure; a wrench or motion has `width` components, 6 in space and 3 in a plane."""
    q = len(loops.touched)
    value, gamma, rate = np.zeros((3, q))
    return LoopClosure(
        *(tree.layout, tree.link, tree.free, tree.first_speed, tree.length),
        position_rows=position_rows,
        loops=loops,
        qr=multifrontal_arrays(loops, len(tree.layout), width),
        value=value,
        gamma=gamma,
        rate=rate,
        u=np.zeros(len(tree.free)),
        rank_limit=np.array([q], dtype=np.int64),
        best=np.zeros(1, LARGEST),
        row_norm=np.zeros(1),
    )


def tree_system(mechanism: Mechanism, links: TreeLinks, spanning: TreeModel, model: Model) -> TreeSystem:
    """Return the arrays of a mechanism in space; those that kernels write are new."""
    cut = spanning.cut
    link, free = link_records(links, model.gravity), free_records(links)
    tree = tree_arrays(links, model.length, link, free, len(mechanism.controls))
    closure = loop_closure(tree, links.loops, links.position_rows, 6)
    elimination = elimination_arrays(len(closure.value), tree.layout, len(tree.free))
    spatial = SpatialArrays(tree.y, tree.A, model.mass, model.inertia_factor, cut_joints(spanning, model), elimination)
    turns, rows = np.zeros(len(model.coordinate)), workspace(cut)._replace(A=tree.A)
    closure = closure._replace(value=rows.value, gamma=rows.gamma, rate=rows.rate)
    read_bodies = not links.gravity_only or links.other_rows > 0
    counts = links.first_integral, links.gravity_only, links.other_rows, read_bodies
    elements = TreeElements(model, cut, turns, rows, *counts)
    return TreeSystem(tree, closure, spatial, elements, None)


def with_own_arrays(given: TreeSystem) -> TreeSystem:
    """Return the same system with copies of all arrays that kernels write."""
    link, free, y, A = (array.copy() for array in given.tree[2:6])
    tree = given.tree._replace(link=link, free=free, y=y, A=A)
    closure, elements = given.closure, given.elements
    value, gamma, rate = closure.value.copy(), closure.gamma.copy(), closure.rate.copy()
    if elements is not None:
        rows = Workspace(*(array.copy() for array in elements.rows))
        rows = rows._replace(A=A, value=value, gamma=gamma, rate=rate)
        elements = elements._replace(turns=elements.turns.copy(), rows=rows)
    closure = closure._replace(
        link=link,
        free=free,
        value=value,
        gamma=gamma,
        rate=rate,
        qr=MultifrontalQR(*(array.copy() for array in closure.qr)),
        u=closure.u.copy(),
        rank_limit=closure.rank_limit.copy(),
        best=closure.best.copy(),
        row_norm=closure.row_norm.copy(),
    )
    spatial = given.spatial
    if spatial is not None:
        spatial = spatial._replace(
            y=y, A=A, elimination=EliminationArrays(*(array.copy() for array in spatial.elimination))
        )
    return TreeSystem(tree, closure, spatial, elements, given.planar)


def persistent_arrays(used: TreeSystem, given: TreeSystem, tree_alone: bool) -> list[tuple[Array, Array]]:
    """Return pairs of arrays that one motion would leave changed for the next, and their initial values, as bytes.

    With `tree_alone` without those of the loops.

    Links and free directions are among them: their constants may be those of another parameter set. NumPy copies
    records field by field, bytes at once.
    """
    pairs = zip(_persistent(used, tree_alone), _persistent(given, tree_alone), strict=True)
    return [(own.view(np.uint8), first.view(np.uint8)) for own, first in pairs if own.size]


def _persistent(arrays: TreeSystem, tree_alone: bool) -> list[Array]:
    tree, closure, _, elements, _ = arrays
    turns = [] if elements is None else [elements.turns]
    loops = [closure.qr.order, closure.qr.state, closure.rank_limit, closure.best, closure.row_norm]
    return [tree.link, tree.free, *turns, *([] if tree_alone else loops)]
