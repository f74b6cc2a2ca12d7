"""Chains of particles: particles shared by joints, their motion, and constraints between them [ATTIA].

Each body has primary particles: 1 at the joint to its predecessor in the spanning tree, 2 on the axis of that joint, 4
and 3 (eliminated) across the axis, at the distance of a radius of gyration. A joint *shares* particles: they follow
from those of the predecessor and are not coordinates,

    joint holds X Y Z                (spherical, universal)    particle 1
    ... and D13 D23                  (revolute)                particles 1, 2
    ... and D12                      (rigid)                   particles 1, 2, 4

Other rows of tree joints remain as constraints between particles; for a prismatic joint these are ATTIA (23), the two
vector products projected across the axis. Coordinates x are the positions of all particles that are not shared. Every
other vector is a combination of generators (see `particles`), with the first rate ``J x'`` and the second rate
``J x'' + beta``. Arrays named D hold the n_x columns of J, the first rate, and beta.

All constraints are scalar products of two vectors s, t between points, ``s . t = const`` [ATTIA (4), (23)]:

    t . s'' + s . t'' = 0:   (t . J_s + s . J_t) x'' = -(t . beta_s + s . beta_t + 2 s' . t').

The seven vectors of a joint are d (from the origin of F to that of M), the axes u of F, and the axes w of M; a basic
constraint is ``u_k . d``, ``d . d`` or ``u_k . w_l`` [MASS (9)-(12)]. Its multiplier lam acts as forces ``lam t`` and
``-lam t`` on the two points of s, or as a couple ``lam s x t`` if s is an axis, and likewise for t.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import GROUND, Array, Body, Frame, Joint, Mechanism, cross, skew, spanning_tree
from consilience.reference.formulations.particles import (
    combination,
    generators,
    particle_masses,
    primary_mass_matrix,
    vector_combination,
)

D, U, W = 0, 1, 4
"""Indices of the first vectors of a joint: d, u_1..u_3, w_1..w_3."""

VECTORS = {
    **{row: (U + k, D) for k, row in enumerate("XYZ")},
    "L": (D, D),
    **{f"D{k + 1}{l + 1}": (U + k, W + l) for k in range(3) for l in range(3)},
}
"""The two vectors whose scalar product is a basic constraint."""

SHARED: tuple[frozenset[str], ...] = (frozenset("XYZ"), frozenset(("D13", "D23")), frozenset(("D12",)))
"""Rows satisfied by sharing one, two, three particles."""

FREE_MOMENTS: dict[frozenset[str], tuple[int, ...]] = {
    frozenset(): (U, U + 1, U + 2),
    frozenset(("D31",)): (U + 2, W),
    frozenset(("D13", "D23")): (U + 2,),
    frozenset(("D13", "D23", "D12")): (),
}
"""Vectors about which a joint with these D rows transmits no moment."""

_ROUNDING = 1e-13
"""Size of a row, over the largest one, below which no motion can violate it: a joint on the axes of two bearings."""

_DISTANCES = ((0, 1), (0, 2), (1, 2))  # of particles 1, 2, 4 [ATTIA (4.1)-(4.3)]


class ChainModel(NamedTuple):
    """Particles of n_b bodies and n_j joints; arrays over bodies end with the ground, over joints with the world.

    The generators of the ground are the world origin and axes.
    """

    order: tuple[int, ...]  # bodies from the ground outwards
    parent: Array  # (n_b,) -1 for a body on the ground or a floating one
    shared: Array  # (n_b,) number of particles shared with the parent
    column: Array  # (n_b,) first coordinate of the other particles
    size: int  # n_x
    given: Array  # (n_b, 3, 4) particles 1, 2, 4 as combinations of the parent's generators
    drawn: Array  # (n_b + 1, 4, 3) generators in body axes
    primary: Array  # (n_b, 4, 4) primary particles as combinations of generators
    mass: Array  # (n_b, 4, 4) mu
    origin: Array  # (n_b, 4) body origins as combinations of generators
    outboard: Array  # (n_b, n_b) 1 if the second body is the first or outboard of it
    frames: Array  # (n_j + 1, 2, 4, 4) origins and axes of F and M as combinations of generators
    frame_body: Array  # (n_j + 1, 2)
    reversed: Array  # (n_j,) tree joints passed from successor to predecessor
    outer: Array  # (n_j,) body that a tree joint carries, -1 for a joint with multipliers
    # momentum equations of a body and all bodies outboard of it: body; joint (n_j: world axes of a floating body);
    # vector of the joint on which the equation is projected; 1 for angular momentum
    equation: Array  # (d, 4)
    distance: Array  # (n_distances, 2) body, index into the distances of particles 1, 2, 4
    distance_target: Array  # (n_distances,)
    rows: Array  # (n_rows, 3) joint and its two vectors
    target: Array  # (n_rows,)
    multiplied: Array  # (n_c,) rows with multipliers: of cut joints, and of those on floating bodies


class ChainMotion(NamedTuple):
    """Generators of bodies and vectors of joints, and their D arrays."""

    G: Array  # (n_b + 1, 4, 3)
    DG: Array  # (n_b + 1, 4, 3, n_x + 2)
    S: Array  # (n_j + 1, 7, 3)
    DS: Array  # (n_j + 1, 7, 3, n_x + 2)
    arms: Array  # (n_j + 1, 7, 2, 3) moment arm that each vector gives the predecessor and the successor
    marks: Array  # (n_j + 1, 2, 4, 3) origin and axes of F and of M


def _cosines(joint: Joint) -> frozenset[str]:
    """Return the D rows of a joint."""
    return frozenset(row for row in joint.rows if row[0] == "D")


def floats(joint: Joint) -> bool:
    """Tell whether a body on this tree joint is a floating base, and the rows of the joint have multipliers.

    True for a free joint and for joints whose free directions are not axes of F or M.
    """
    return not joint.rows or "L" in joint.rows or _cosines(joint) not in FREE_MOMENTS


def sharing(joint: Joint) -> int:
    """Return the number of particles 1, 2, 4 that a tree joint shares."""
    count = 0
    while not floats(joint) and count < len(SHARED) and SHARED[count] <= set(joint.rows):
        count += 1
    return count


def _primary_particles(body: Body, end: Frame) -> Array:
    """Return particles 1 to 4 of a body: at the origin of its joint frame, along z, y and x, shape (4, 3)."""
    arm = body.com - end.p
    length = np.sqrt(0.5 * np.trace(body.inertia) / body.mass + arm @ arm)
    return end.p + length * np.vstack([np.zeros(3), end.R[:, 2], end.R[:, 1], end.R[:, 0]])


class _Passage(NamedTuple):
    """Tree joint in the direction of the tree: from the frame `start` on body `inner` to `end` on `body`."""

    k: int
    joint: Joint
    backward: bool
    inner: int
    start: Frame
    body: int
    end: Frame


def _passages(mechanism: Mechanism) -> list[_Passage]:
    """Return the tree joints in depth-first order."""
    found = []
    for k, backward in spanning_tree(mechanism)[0]:
        joint = mechanism.joints[k]
        ends = [(mechanism.body_index[joint.predecessor], joint.F), (mechanism.body_index[joint.successor], joint.M)]
        (inner, start), (body, end) = ends[::-1] if backward else ends
        found.append(_Passage(k, joint, backward, inner, start, body, end))
    return found


def _equations(passage: _Passage, world: int) -> list[tuple[int, int, int, bool]]:
    """Return the momentum equations of a tree joint, one for each of its degrees of freedom."""
    k, joint, body = passage.k, passage.joint, passage.body
    if floats(joint):
        return [(body, world, U + axis, moment) for moment in (False, True) for axis in range(3)]
    moments = FREE_MOMENTS[_cosines(joint)]
    slides = [U + axis for axis, row in enumerate("XYZ") if row not in joint.rows]
    return [(body, k, v, False) for v in slides] + [(body, k, v, True) for v in moments]


def _given(passages: list[_Passage], primary: Array, drawn: Array) -> Array:
    """Return particles 1, 2, 4 as combinations of the parent's generators for coincident joint frames, (n_b, 3, 4)."""
    given = np.empty((len(passages), 3, 4))
    for _, _, _, inner, start, b, end in passages:
        in_frame = (primary[b, [0, 1, 3]] - end.p) @ end.R
        given[b] = combination(drawn[inner], start.p + in_frame @ start.R.T)
    return given


def _outboard(passages: list[_Passage]) -> Array:
    """Return `ChainModel.outboard`, along joints without multipliers."""
    outboard = np.eye(len(passages))
    for p in passages:
        if p.inner >= 0 and not floats(p.joint):
            outboard[:, p.body] += outboard[:, p.inner]
    return outboard


def chain_model(mechanism: Mechanism) -> ChainModel:
    """Choose the particles of a mechanism; tabulate joints, constraints and momentum equations."""
    passages, n_j = _passages(mechanism), len(mechanism.joints)
    by_body = sorted(passages, key=lambda p: p.body)
    primary = np.array([_primary_particles(mechanism.bodies[p.body], p.end) for p in by_body])
    ground = np.vstack([np.zeros(3), np.eye(3)])
    drawn = np.array([*(generators(p) for p in primary), ground])
    shared = np.array([sharing(p.joint) for p in by_body])
    column, size = np.zeros(len(passages), dtype=np.int64), 0
    backwards, outer = np.zeros(n_j, dtype=bool), np.full(n_j, -1)
    for p in passages:
        column[p.body], size = size, size + 3 * (3 - int(shared[p.body]))
        backwards[p.k] = p.backward
        if not floats(p.joint):
            outer[p.k] = p.body
    equation = np.array([e for p in passages for e in _equations(p, n_j)], dtype=np.int64).reshape(-1, 4)
    distances = [(b, n) for b, s in enumerate(shared) for n, pair in enumerate(_DISTANCES) if max(pair) >= s]
    rows, target = _rows(mechanism, outer)
    index = mechanism.body_index
    return ChainModel(
        order=tuple(p.body for p in passages),
        parent=np.array([-1 if floats(p.joint) else p.inner for p in by_body]),
        shared=shared,
        column=column,
        size=size,
        given=_given(passages, primary, drawn),
        drawn=drawn,
        primary=np.array([combination(g, p) for g, p in zip(drawn[:-1], primary, strict=True)]),
        mass=np.array(
            [primary_mass_matrix(particle_masses(body, p)) for body, p in zip(mechanism.bodies, primary, strict=True)]
        ),
        origin=np.vstack([combination(g, np.zeros((1, 3))) for g in drawn[:-1]]),
        outboard=_outboard(passages),
        frames=_frames(mechanism, drawn),
        frame_body=np.array([*([index[j.predecessor], index[j.successor]] for j in mechanism.joints), [-1, -1]]),
        reversed=backwards,
        outer=outer,
        equation=equation,
        distance=np.array(distances, dtype=np.int64).reshape(-1, 2),
        distance_target=np.array([np.sum(_edges(drawn)[b, n] ** 2) for b, n in distances]),
        rows=rows,
        target=target,
        multiplied=np.flatnonzero(outer[rows[:, 0]] < 0),
    )


def _edges(basis: Array) -> Array:
    """Return the vectors between particles 1, 2, 4 of generators, or their D arrays, shape (n, 3, 3, ...)."""
    return np.stack([basis[:, 1], basis[:, 2], basis[:, 2] - basis[:, 1]], axis=1)


def _frames(mechanism: Mechanism, drawn: Array) -> Array:
    """Return the frames F and M of all joints, and of the world, as combinations of generators."""
    world = Frame(np.zeros(3), np.eye(3))
    sides = [((j.predecessor, j.F), (j.successor, j.M)) for j in mechanism.joints]
    sides.append(((GROUND, world), (GROUND, world)))
    frames = np.empty((len(sides), 2, 4, 4))
    for k, pair in enumerate(sides):
        for side, (body, frame) in enumerate(pair):
            basis = drawn[mechanism.body_index[body]]
            frames[k, side, :1] = combination(basis, frame.p[None])
            frames[k, side, 1:] = vector_combination(basis, frame.R.T)
    return frames


def _rows(mechanism: Mechanism, outer: Array) -> tuple[Array, Array]:
    """Return the rows that sharing does not satisfy, and their targets."""
    rows: list[tuple[int, int, int]] = []
    target: list[float] = []
    for k, joint in enumerate(mechanism.joints):
        satisfied = frozenset[str]().union(*SHARED[: sharing(joint)]) if outer[k] >= 0 else frozenset[str]()
        for row in joint.rows:
            if row not in satisfied:
                rows.append((k, *VECTORS[row]))
                target.append(joint.length**2 if row == "L" else 0.0)
    return np.array(rows, dtype=np.int64).reshape(-1, 3), np.array(target)


def generator_motion(model: ChainModel, x: Array, rate: Array) -> tuple[Array, Array]:
    """Compute the generators of all bodies, shape (n_b + 1, 4, 3), and their D array from coordinates and rates."""
    n_b, n_x = len(model.parent), model.size
    G, DG = np.zeros((n_b + 1, 4, 3)), np.zeros((n_b + 1, 4, 3, n_x + 2))
    G[-1] = model.drawn[-1]
    for b in model.order:
        s, first = model.shared[b], model.column[b]
        last = first + 3 * (3 - s)
        r, Dr = np.empty((3, 3)), np.zeros((3, 3, n_x + 2))
        r[:s] = model.given[b, :s] @ G[model.parent[b]]
        Dr[:s] = np.tensordot(model.given[b, :s], DG[model.parent[b]], 1)
        r[s:] = x[first:last].reshape(-1, 3)
        own = Dr[s:].reshape(last - first, n_x + 2)
        own[:, first:last] = np.eye(last - first)
        own[:, n_x] = rate[first:last]
        G[b, 0], DG[b, 0] = r[0], Dr[0]
        G[b, 1:3], DG[b, 1:3] = r[1:] - r[0], Dr[1:] - Dr[0]
        to_2, to_4 = skew(G[b, 1]), skew(G[b, 2])
        G[b, 3] = to_2 @ G[b, 2]
        DG[b, 3] = to_2 @ DG[b, 2] - to_4 @ DG[b, 1]
        DG[b, 3, :, -1] += 2 * cross(DG[b, 1, :, n_x], DG[b, 2, :, n_x])  # the last term of ATTIA (14)
    return G, DG


def combine(constants: Array, columns: Array) -> Array:
    """Combine D arrays: constants (..., m, g) times (..., g, 3, n_x + 2), shape (..., m, 3, n_x + 2)."""
    flat = constants @ columns.reshape(*columns.shape[:-2], -1)
    return flat.reshape(*flat.shape[:-1], *columns.shape[-2:])


def motion(model: ChainModel, x: Array, rate: Array) -> ChainMotion:
    """Compute generators, joint vectors and moment arms at coordinates x and rates."""
    G, DG = generator_motion(model, x, rate)
    marks = model.frames @ G[model.frame_body]
    D_marks = combine(model.frames, DG[model.frame_body])

    def vectors(a: Array) -> Array:
        return np.concatenate([a[:, 1, :1] - a[:, 0, :1], a[:, 0, 1:], a[:, 1, 1:]], axis=1)

    arms = np.zeros((len(marks), 7, 2, 3))
    arms[:, D, 0], arms[:, D, 1] = -marks[:, 0, 0], marks[:, 1, 0]
    arms[:, U:W, 0], arms[:, W:, 1] = marks[:, 0, 1:], marks[:, 1, 1:]
    return ChainMotion(G, DG, vectors(marks), vectors(D_marks), arms, marks)


class ChainConstraints(NamedTuple):
    """n constraints at a motion: distances, then joint rows."""

    value: Array  # (n,) s . t - const
    D: Array  # (n, n_x + 2) [Q | rate | -gamma]


def constraint_rows(model: ChainModel, m: ChainMotion) -> ChainConstraints:
    """Evaluate all constraints, each divided by the size of its row of Q for the worst directions of s and t.

    The norm of the row itself does not scale it: a row that no motion can violate consists of rounding errors.
    """
    b, n = model.distance.T
    edges, D_edges = _edges(m.G)[b, n], _edges(m.DG)[b, n]
    k, left, right = model.rows.T
    s, Ds = np.concatenate([edges, m.S[k, left]]), np.concatenate([D_edges, m.DS[k, left]])
    t, Dt = np.concatenate([edges, m.S[k, right]]), np.concatenate([D_edges, m.DS[k, right]])
    rows = (t[:, None] @ Ds + s[:, None] @ Dt)[:, 0]
    rows[:, -1] += 2 * np.sum(Ds[:, :, -2] * Dt[:, :, -2], axis=1)
    value = np.sum(s * t, axis=1) - np.concatenate([model.distance_target, model.target])
    size = np.hypot(_length(t) * _size(Ds), _length(s) * _size(Dt))
    size[size <= _ROUNDING * np.max(size, initial=0.0)] = 1.0  # neither vector can move, but for rounding
    return ChainConstraints(value / size, rows / size[:, None])


def _length(a: Array) -> Array:
    return np.linalg.norm(a, axis=1)


def _size(columns: Array) -> Array:
    """Return the norms of the Jacobians in D arrays of vectors."""
    return np.linalg.norm(columns[:, :, :-2], axis=(1, 2))


_ON_POINTS = np.zeros((7, 2))
_ON_POINTS[D] = -1.0, 1.0  # d connects points: a force on the origin of M, its opposite on that of F


def multiplier_wrenches(model: ChainModel, m: ChainMotion) -> Array:
    """Return force and moment about the world origin on predecessor and successor per multiplier, shape (n_c, 2, 6)."""
    k, left, right = model.rows[model.multiplied].T
    wrench = np.zeros((len(k), 2, 6))
    for at, other in ((left, right), (right, left)):
        pull = m.S[k, other][:, None]
        wrench[:, :, :3] += _ON_POINTS[at][:, :, None] * pull
        wrench[:, :, 3:] += np.cross(m.arms[k, at], pull)
    return wrench
