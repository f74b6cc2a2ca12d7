"""The state of the joints of a spanning tree, and the arrays of the kernels.

The state z has three parts: coordinates, speeds of the N free directions, integrals of controllers. The coordinates of
a tree joint are those of M relative to F: displacements along the free axes of F, then the angle about z of F
(revolute), the angles about z of F and x of M (universal), or Euler parameters (ball). No chart of these is singular.
Speeds are the rates of the first ones, and for a ball the angular velocity of M relative to F in axes of F.

Kernels are given these tuples `held`: one address each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array, Mechanism
from consilience.reference.bodies.arrays import Model, Workspace, all_rows, flatten, workspace
from consilience.reference.bodies.spanning_tree import TreeModel, flatten_tree
from consilience.reference.kernel.held import hold
from consilience.reference.tree import records
from consilience.reference.tree.cut_joints import CutJoints, cut_joints
from consilience.reference.tree.loop_groups import Fronts, Loops, find_loops, fronts
from consilience.reference.tree.plane import Plane
from consilience.reference.tree.reduced import Reduced, reduced

DISTANCE, ANGLE, SPEED, SPIN, INTEGRAL = range(5)
"""Kinds of the components of z: what a relative tolerance refers to."""

PARENT, PARENT_BODY, BODY, FORWARD, COORDINATE, ALONG, ABOUT, FREE, FREE_END = range(9)
"""Columns of `Links.layout`: parent link (-1: the ground), its body, the body of the link, whether the tree passes the
joint from predecessor to successor, first coordinate, number of displacements, of directions about (3: a ball), first
free direction and the one behind the last."""

LARGEST_RANK, LEAST, PIVOT = np.array([0, 1, 2])
"""Entries of `Rest.best`: largest rank so far, and its largest least pivot, of the fronts and of `null_space`."""


class Links(NamedTuple):
    """The tree: n_b links, each behind its parent; N free directions."""

    layout: Array  # (n_b, 9)
    real: Array  # (n_b, 31) constants of the links: columns NEAR to PLACED of `columns`
    direction: Array  # (N, 3) axis of F (0) or M (1); number of the axis; along it (0) or about it (1)
    kind: Array  # (n_z,) DISTANCE, ...
    speeds: int  # first speed in z
    integrals: int  # first integral in z
    plain: bool  # no forces but gravity
    free: bool  # that, and no rows to close: `articulated.free_accelerations` says all
    other_rows: int  # rows that are not joints'
    held: int  # rows that hold positions; those of rolling and skates stand behind them
    loops: Loops
    com: Array  # (n_b, 3) of the bodies, from their origins


class Tree(NamedTuple):
    """What an integrator reads of a tree without elements."""

    layout: Array
    kind: Array
    link: Array  # (n_b + 1, LINK_WIDTH) rows of the links and of the ground: see `columns`
    free: Array  # (N, FREE_WIDTH) rows of the directions
    y: Array  # (n_b + n_e, 13) bodies, as the other kernels know them
    A: Array  # (n_b, 3, 3) rotation matrices
    speeds: int
    length: float  # of the mechanism, m


class Space(NamedTuple):
    """What kernels of space read beside both: bodies as other kernels know them. In a plane there is `plane.Plane`.

    Where nothing reads them but samples, y and A are of the last sample.
    """

    y: Array
    A: Array
    mass: Array
    inertia_factor: Array
    joints: CutJoints
    reduced: Reduced


class Rest(NamedTuple):
    """What loops need beside the tree, and the arrays that their kernels write into; q cut rows."""

    layout: Array
    link: Array
    free: Array
    speeds: int
    length: float
    held: int
    loops: Loops
    fronts: Fronts
    value: Array  # (q,) violations of the rows
    gamma: Array  # (q,)
    rate: Array  # (q,)
    u: Array  # (N,) accelerations, or displacements, of the directions
    limit: Array  # (1,) rank of the cut rows, where a projection has found it
    best: Array  # (3,) LARGEST_RANK, LEAST, PIVOT
    size: Array  # (1,) largest size of a cut row


class Elements(NamedTuple):
    """What elements and rows that are not joints' need beside both."""

    model: Model
    cut: Model
    memory: Array  # joint coordinates that elements read, turns counted
    rows: Workspace
    integrals: int
    plain: bool
    other_rows: int


class System(NamedTuple):
    """A mechanism for the kernels: they are compiled for trees, for linkages, for those with elements, and in a plane.

    Where an argument is None, Numba leaves out what is done only where it is not; the reverse it does not. So there is
    one argument for space and one for a plane, and one of them is None.
    """

    tree: Tree
    rest: Rest
    space: Space | None
    elements: Elements | None  # None where there are only joints and gravity, and in a plane
    plane: Plane | None


class Run(NamedTuple):
    """What an integrator reads and writes; kernels are given it `held`."""

    tree: Tree
    rest: Rest | None  # None where the tables of the tree (and of a plane) say all
    space: Space | None
    elements: Elements | None
    plane: Plane | None
    scratch: NamedTuple  # of the integrator


def flatten_relative(mechanism: Mechanism) -> tuple[Links, TreeModel, Model]:
    """Flat arrays of the tree, its coordinates, and the mechanism."""
    tree, model = flatten_tree(mechanism), flatten(mechanism)
    index, kinds, speeds = [], list[int](), list[int]()
    for k, body in enumerate(tree.body):
        first, last = int(tree.first_free[k]), int(tree.first_free[k + 1])
        turns = int(np.sum(tree.direction[first:last, 2]))
        along = last - first - turns
        parent = int(tree.parent[k])
        carrier = -1 if parent < 0 else int(tree.body[parent])
        index.append([parent, carrier, int(body), bool(tree.sign[k] > 0), len(kinds), along, turns, first, last])
        kinds += [DISTANCE] * along + [ANGLE] * (turns if turns < 3 else 4)
        speeds += [SPEED] * along + [SPIN] * turns
    elements = (mechanism.springs, mechanism.joint_springs, mechanism.loads, mechanism.frictions, mechanism.controls)
    cut = tree.cut
    layout = np.array(index, dtype=np.int64)
    links = Links(
        layout=layout,
        real=link_constants(tree, model),
        direction=tree.direction,
        kind=np.array([*kinds, *speeds, *[INTEGRAL] * len(mechanism.controls)], dtype=np.int64),
        speeds=len(kinds),
        integrals=len(kinds) + len(speeds),
        plain=not any(elements),
        free=not any(elements) and not tree.cut_rows,
        other_rows=int(tree.cut_rows - len(cut.row_kind)),
        held=all_rows(cut) - 2 * len(cut.rolling_body) - len(cut.skate_body),
        loops=find_loops(layout, len(speeds), cut),
        com=np.array([body.com for body in mechanism.bodies]),
    )
    return hold(links), tree, model


def link_constants(tree: TreeModel, model: Model) -> Array:
    """Constants of the links, shape (n_b, 31): columns NEAR to PLACED of `columns`."""
    forward = tree.sign > 0
    on_i, on_j = model.axes_i[tree.joint], model.axes_j[tree.joint]
    arm_i, arm_j = model.arm_i[tree.joint], model.arm_j[tree.joint]
    near, own = np.where(forward[:, None, None], on_i, on_j), np.where(forward[:, None, None], on_j, on_i)
    arm_near, arm_own = np.where(forward[:, None], arm_i, arm_j), np.where(forward[:, None], arm_j, arm_i)
    # a parent of -1 is the last one here, the ground
    base = np.concatenate([own, np.eye(3)[None]])[tree.parent]
    turned = np.swapaxes(own, 1, 2)
    inertia = turned @ model.inertia[tree.body] @ own
    parts = [
        np.swapaxes(np.swapaxes(base, 1, 2) @ near, 1, 2).reshape(-1, 9),
        np.einsum("kji,kj->ki", base, arm_near),
        np.einsum("kij,kj->ki", turned, arm_own),
        model.mass[tree.body][:, None],
        inertia[:, *np.triu_indices(3)],
        own.reshape(-1, 9),
    ]
    return np.hstack(parts)


def link_table(links: Links, gravity: Array) -> Array:
    """Rows of the links and of the ground, shape (n_b + 1, LINK_WIDTH), nothing placed yet."""
    table = np.zeros((len(links.layout) + 1, records.LINK_WIDTH))
    rows, layout = table[:-1], links.layout
    rows[:, records.PARENT] = layout[:, PARENT]
    rows[:, records.ONE_TURN] = (layout[:, ALONG] == 0) & (layout[:, ABOUT] == 1)
    rows[:, records.SENSE] = 2.0 * layout[:, FORWARD] - 1.0
    rows[:, records.COORDINATE : records.LAST + 1] = layout[:, COORDINATE:]
    rows[:, records.NEAR : records.PLACED] = links.real
    table[-1, records.GRAVITY : records.GRAVITY + 3] = gravity
    table[-1, records.COORDINATE] = links.speeds
    table[-1, [records.X, records.X + 4, records.X + 8]] = 1.0
    return table


def free_table(links: Links) -> Array:
    """Rows of the directions, shape (N, FREE_WIDTH)."""
    table = np.zeros((len(links.direction), records.FREE_WIDTH))
    table[:, records.AXIS] = 3 * links.direction[:, 0] + links.direction[:, 1]
    return table


def tree_arrays(links: Links, length: float, link: Array, free: Array, integrals: int) -> Tree:
    """What a tree without elements needs; link and free are its tables."""
    n = len(links.layout)
    return Tree(
        layout=links.layout,
        kind=links.kind,
        link=link,
        free=free,
        y=np.zeros((n + -(-integrals // 13), 13)),
        A=np.zeros((n, 3, 3)),
        speeds=links.speeds,
        length=length,
    )


def closing_arrays(tree: Tree, loops: Loops, held: int, width: int) -> Rest:
    """What loops need beside the tree; wrenches and motions are of 6 numbers, or 3 in a plane."""
    q = len(loops.touched)
    value, gamma, rate = np.zeros((3, q))
    return Rest(
        *(tree.layout, tree.link, tree.free, tree.speeds, tree.length),
        held=held,
        loops=loops,
        fronts=fronts(loops, len(tree.layout), width),
        value=value,
        gamma=gamma,
        rate=rate,
        u=np.zeros(len(tree.free)),
        limit=np.array([q], dtype=np.int64),
        best=np.zeros(3),
        size=np.zeros(1),
    )


def system(mechanism: Mechanism, links: Links, spanning: TreeModel, model: Model) -> System:
    """Arrays of the kernels, those that they write into new."""
    cut = spanning.cut
    table = link_table(links, mechanism.gravity)
    tree = tree_arrays(links, model.length, table, free_table(links), len(mechanism.controls))
    rest = closing_arrays(tree, links.loops, links.held, 6)
    few = reduced(len(rest.value), tree.layout, len(tree.free))
    space = Space(tree.y, tree.A, model.mass, model.inertia_factor, cut_joints(spanning, model), few)
    if links.plain and not links.other_rows:
        return System(tree, rest, space, None, None)
    memory, rows = np.zeros(len(model.coordinate)), workspace(cut)._replace(A=tree.A)
    rest = rest._replace(value=rows.value, gamma=rows.gamma, rate=rows.rate)
    elements = Elements(model, cut, memory, rows, links.integrals, links.plain, links.other_rows)
    return System(tree, rest, space, elements, None)


def renewed(given: System) -> System:
    """The same system with arrays of its own to write into, in the state in which they are given.

    It takes a third of the time that `system` does.
    """
    link, free, y, A = (array.copy() for array in given.tree[2:6])
    tree = given.tree._replace(link=link, free=free, y=y, A=A)
    rest, elements = given.rest, given.elements
    value, gamma, rate = rest.value.copy(), rest.gamma.copy(), rest.rate.copy()
    if elements is not None:
        rows = Workspace(*(array.copy() for array in elements.rows))
        rows = rows._replace(A=A, value=value, gamma=gamma, rate=rate)
        elements = elements._replace(memory=elements.memory.copy(), rows=rows)
    rest = rest._replace(
        link=link,
        free=free,
        value=value,
        gamma=gamma,
        rate=rate,
        fronts=Fronts(*(array.copy() for array in rest.fronts)),
        u=rest.u.copy(),
        limit=rest.limit.copy(),
        best=rest.best.copy(),
        size=rest.size.copy(),
    )
    space = given.space
    if space is not None:
        space = space._replace(y=y, A=A, reduced=Reduced(*(array.copy() for array in space.reduced)))
    return System(tree, rest, space, elements, given.plane)


def lasting(used: System, given: System) -> list[tuple[Array, Array]]:
    """What one motion would leave to the next, and as it was: rows chosen, what rows and pivots have been, turns."""
    return list(zip(_lasting(used), _lasting(given), strict=True))


def _lasting(arrays: System) -> list[Array]:
    rest = arrays.rest
    memory = [] if arrays.elements is None else [arrays.elements.memory]
    return [rest.fronts.order, rest.fronts.state, rest.limit, rest.best, rest.size, *memory]
