"""A mechanism as chains of particles: which bodies share them, where joints lie among them, how they move [ATTIA].

Each body has primary particles 1 at the joint to its predecessor in the spanning tree, 2 on the axis of that joint, 4
and 3 (eliminated) across it, a radius of gyration away. What the joint allows is *shared*: the particle is then given
by the predecessor's and is no coordinate of its own,

    joint holds X Y Z                (spherical, universal)    particle 1
    ... and D13 D23                  (revolute)                particles 1, 2
    ... and D12                      (rigid)                   particles 1, 2, 4

Other rows of tree joints stay as constraints between particles; for a prismatic joint they are ATTIA (23), the two
vector products projected across the axis, where alone they say something. Own particles of all bodies are the
coordinates x. All else is a combination of generators (see `particles`), so that its rate is ``J x'`` and its second
rate ``J x'' + beta``: arrays called `D` have the n_x columns of J, then the rate, then beta.

All constraints are products of two vectors s, t between points, ``s . t = const`` [ATTIA (4), (23)], with the row

    t . s'' + s . t'' = 0:   (t . J_s + s . J_t) x'' = -(t . beta_s + s . beta_t + 2 s' . t').

The seven vectors of a joint are d (from the origin of F to that of M), the axes u of F, and the axes w of M; a basic
constraint is ``u_k . d``, ``d . d`` or ``u_k . w_l`` [MASS (9)-(12)]. With a multiplier lam it is a pair of wrenches:
forces ``lam t`` and ``-lam t`` on the two points of s, or a couple ``lam s x t`` if s is an axis, and likewise for t.
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
"""First of the vectors d, u_1..u_3, w_1..w_3 of a joint."""

VECTORS = {
    **{row: (U + k, D) for k, row in enumerate("XYZ")},
    "L": (D, D),
    **{f"D{k + 1}{l + 1}": (U + k, W + l) for k in range(3) for l in range(3)},
}
"""The two vectors whose product a basic constraint holds."""

SHARED: tuple[frozenset[str], ...] = (frozenset("XYZ"), frozenset(("D13", "D23")), frozenset(("D12",)))
"""ChainConstraints that sharing one more particle satisfies."""

FREE_MOMENTS: dict[frozenset[str], tuple[int, ...]] = {
    frozenset(): (U, U + 1, U + 2),
    frozenset(("D31",)): (U + 2, W),
    frozenset(("D13", "D23")): (U + 2,),
    frozenset(("D13", "D23", "D12")): (),
}
"""Vectors about which a joint with these direction cosines transmits no moment."""

_DISTANCES = ((0, 1), (0, 2), (1, 2))  # of particles 1, 2, 4 [ATTIA (4.1)-(4.3)]


class ChainModel(NamedTuple):
    """Particles of n_b bodies and n_j joints. Arrays over bodies end with the ground, those over joints with the world.

    The ground's generators are the world's origin and axes.
    """

    order: tuple[int, ...]  # bodies from the ground outwards
    parent: Array  # (n_b,) -1 for a body on the ground or a floating one
    shared: Array  # (n_b,) how many of particles 1, 2, 4 the parent gives
    column: Array  # (n_b,) first coordinate of the own ones
    size: int  # n_x
    given: Array  # (n_b, 3, 4) particles 1, 2, 4 by the parent's generators
    drawn: Array  # (n_b + 1, 4, 3) generators in body axes
    primary: Array  # (n_b, 4, 4) primary particles by generators
    mass: Array  # (n_b, 4, 4) mu
    origin: Array  # (n_b, 4) body's origin by generators
    outboard: Array  # (n_b, n_b) 1 where the second body hangs on the first, or is it
    frames: Array  # (n_j + 1, 2, 4, 4) origin and axes of F and of M by generators
    frame_body: Array  # (n_j + 1, 2)
    reversed: Array  # (n_j,) the tree passes the joint from successor to predecessor
    outer: Array  # (n_j,) body that a tree joint carries, -1 for a joint with multipliers
    equation_body: Array  # (d,) a momentum equation: of this body and all further out,
    equation_joint: Array  # (d,) projected on a vector of this joint (n_j: on the world's axes, the body floats),
    equation_vector: Array  # (d,) this one,
    equation_moment: Array  # (d,) angular or linear momentum
    distance: Array  # (n_distances, 2) body, index into the distances of particles 1, 2, 4
    distance_target: Array  # (n_distances,)
    rows: Array  # (n_rows, 3) joint and its two vectors
    target: Array  # (n_rows,)
    multiplied: Array  # (n_c,) rows with multipliers: of cut joints, and of those on floating bodies


class ChainMotion(NamedTuple):
    """Generators and vectors of joints, and their D arrays."""

    G: Array  # (n_b + 1, 4, 3)
    DG: Array  # (n_b + 1, 4, 3, n_x + 2)
    S: Array  # (n_j + 1, 7, 3)
    DS: Array  # (n_j + 1, 7, 3, n_x + 2)
    arms: Array  # (n_j + 1, 7, 2, 3) moment arm that each vector gives the predecessor and the successor
    marks: Array  # (n_j + 1, 2, 4, 3) origin and axes of F and of M


def _cosines(joint: Joint) -> frozenset[str]:
    return frozenset(row for row in joint.rows if row[0] == "D")


def floats(joint: Joint) -> bool:
    """Whether a body on this joint is a floating base, and the rows of the joint have multipliers.

    So it is with a free joint, which has none, and with those whose free directions are not axes of F or M.
    """
    return not joint.rows or "L" in joint.rows or _cosines(joint) not in FREE_MOMENTS


def sharing(joint: Joint) -> int:
    """How many of particles 1, 2, 4 a joint of the tree shares."""
    count = 0
    while not floats(joint) and count < len(SHARED) and SHARED[count] <= set(joint.rows):
        count += 1
    return count


def _primary_particles(body: Body, end: Frame) -> Array:
    """Particles 1 to 4 on the joint frame of a body: at its origin, along z, y and x, shape (4, 3)."""
    arm = body.com - end.p
    length = np.sqrt(0.5 * np.trace(body.inertia) / body.mass + arm @ arm)
    return end.p + length * np.vstack([np.zeros(3), end.R[:, 2], end.R[:, 1], end.R[:, 0]])


class _Passage(NamedTuple):
    """A joint as the spanning tree passes it: from the frame `start` on a body to `end` on the next."""

    k: int
    joint: Joint
    backward: bool
    inner: int
    start: Frame
    body: int
    end: Frame


def _passages(mechanism: Mechanism) -> list[_Passage]:
    """Tree joints in depth-first order."""
    found = []
    for k, backward in spanning_tree(mechanism)[0]:
        joint = mechanism.joints[k]
        ends = [(mechanism.body_index[joint.predecessor], joint.F), (mechanism.body_index[joint.successor], joint.M)]
        (inner, start), (body, end) = ends[::-1] if backward else ends
        found.append(_Passage(k, joint, backward, inner, start, body, end))
    return found


def _equations(passage: _Passage, world: int) -> list[tuple[int, int, int, bool]]:
    """Momentum equations along and about whatever the joint leaves free: as many as it has freedoms."""
    k, joint, body = passage.k, passage.joint, passage.body
    if floats(joint):
        return [(body, world, U + axis, moment) for moment in (False, True) for axis in range(3)]
    moments = FREE_MOMENTS[_cosines(joint)]
    slides = [U + axis for axis, row in enumerate("XYZ") if row not in joint.rows]
    return [(body, k, v, False) for v in slides] + [(body, k, v, True) for v in moments]


def _given(passages: list[_Passage], primary: Array, drawn: Array) -> Array:
    """Particles 1, 2, 4 by the generators of the parent, where the frames of the joint coincide, shape (n_b, 3, 4)."""
    given = np.empty((len(passages), 3, 4))
    for _, _, _, inner, start, b, end in passages:
        in_frame = (primary[b, [0, 1, 3]] - end.p) @ end.R
        given[b] = combination(drawn[inner], start.p + in_frame @ start.R.T)
    return given


def _outboard(passages: list[_Passage]) -> Array:
    """1 where the second body hangs on the first through joints without multipliers, or is it."""
    outboard = np.eye(len(passages))
    for p in passages:
        if p.inner >= 0 and not floats(p.joint):
            outboard[:, p.body] += outboard[:, p.inner]
    return outboard


def chain_model(mechanism: Mechanism) -> ChainModel:
    """Particles, joints and momentum equations of a mechanism."""
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
        equation_body=equation[:, 0],
        equation_joint=equation[:, 1],
        equation_vector=equation[:, 2],
        equation_moment=equation[:, 3].astype(bool),
        distance=np.array(distances, dtype=np.int64).reshape(-1, 2),
        distance_target=np.array([_square_distances(drawn[b])[n] for b, n in distances]),
        rows=rows,
        target=target,
        multiplied=np.flatnonzero(outer[rows[:, 0]] < 0),
    )


def _square_distances(basis: Array) -> Array:
    edges = np.array([basis[1], basis[2], basis[2] - basis[1]])
    return np.sum(edges * edges, axis=1)


def _frames(mechanism: Mechanism, drawn: Array) -> Array:
    """Origins and axes of F and M of all joints, and of the world, by generators."""
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
    """ChainConstraints that sharing does not satisfy, and their targets."""
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
    """Generators of all bodies from the coordinates, G of shape (n_b + 1, 4, 3), and their D array."""
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
    """Combinations of D arrays: (..., m, g) of (..., g, 3, n_x + 2), shape (..., m, 3, n_x + 2)."""
    flat = constants @ columns.reshape(*columns.shape[:-2], -1)
    return flat.reshape(*flat.shape[:-1], *columns.shape[-2:])


def motion(model: ChainModel, x: Array, rate: Array) -> ChainMotion:
    """Everything of the mechanism that constraints and momentum equations need, at coordinates and rates."""
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
    """Constraints at a motion: distances, then joint rows; n of them."""

    value: Array  # (n,) s . t - const
    D: Array  # (n, n_x + 2) [Q | rate | -gamma]


def constraint_rows(model: ChainModel, m: ChainMotion) -> ChainConstraints:
    """All constraints, each divided by the size its row of Q has if s and t turn in the worst direction.

    Not by the length of the row itself: a row that nothing can violate is zero but for rounding, and has to stay so.
    """
    b, n = model.distance.T
    edges = np.stack([m.G[:, 1], m.G[:, 2], m.G[:, 2] - m.G[:, 1]], axis=1)[b, n]
    D_edges = np.stack([m.DG[:, 1], m.DG[:, 2], m.DG[:, 2] - m.DG[:, 1]], axis=1)[b, n]
    k, left, right = model.rows.T
    s, Ds = np.concatenate([edges, m.S[k, left]]), np.concatenate([D_edges, m.DS[k, left]])
    t, Dt = np.concatenate([edges, m.S[k, right]]), np.concatenate([D_edges, m.DS[k, right]])
    rows = (t[:, None] @ Ds + s[:, None] @ Dt)[:, 0]
    rows[:, -1] += 2 * np.sum(Ds[:, :, -2] * Dt[:, :, -2], axis=1)
    value = np.sum(s * t, axis=1) - np.concatenate([model.distance_target, model.target])
    size = np.hypot(_length(t) * _size(Ds), _length(s) * _size(Dt))
    size[size == 0.0] = 1.0  # neither side can move
    return ChainConstraints(value / size, rows / size[:, None])


def _length(a: Array) -> Array:
    return np.linalg.norm(a, axis=1)


def _size(columns: Array) -> Array:
    """Size of the Jacobians in D arrays of vectors."""
    return np.linalg.norm(columns[:, :, :-2], axis=(1, 2))


_ON_POINTS = np.zeros((7, 2))
_ON_POINTS[D] = -1.0, 1.0  # only d ends on points: a force on M's origin, the opposite on F's


def multiplier_wrenches(model: ChainModel, m: ChainMotion) -> Array:
    """Force and moment about the world's origin, on predecessor and successor, per multiplier, shape (n_c, 2, 6)."""
    k, left, right = model.rows[model.multiplied].T
    wrench = np.zeros((len(k), 2, 6))
    for at, other in ((left, right), (right, left)):
        pull = m.S[k, other][:, None]
        wrench[:, :, :3] += _ON_POINTS[at][:, :, None] * pull
        wrench[:, :, 3:] += np.cross(m.arms[k, at], pull)
    return wrench
