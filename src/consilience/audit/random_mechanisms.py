"""Random mechanisms, assembled as drawn: the same seed gives the same mechanism.

Bodies have their mass off the origin and the full inertia of a cloud of points, frames are skew, bodies and joints are
listed in random order, and either side of a joint may be the predecessor. A mechanism grows as a tree from the ground;
then joints of any kind close loops in the drawn pose. Linkages with dependent rows hang on the ground or a body:
planar linkages, with parallel axes, and spherical linkages, whose axes meet in a point.

Every addition leaves a degree of freedom and a clear rank: singular values of the constraint Jacobian in the drawn pose
are zero or above `GAP` of the largest. Half of the mechanisms have no elements but springs, joint springs and constant
loads, which every formulation supports. A `Recipe` fixes some of the choices.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from consilience.mechanism import (
    AXIS_COORDINATES,
    GROUND,
    JOINT_KINDS,
    RANK_TOLERANCE,
    Array,
    Body,
    Control,
    Coupling,
    Drive,
    Frame,
    Friction,
    Function,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Rolling,
    Skate,
    Spring,
    State,
    constraint_jacobian,
    drawing_state,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
    through,
)

GAP = 1e-4
MOST_BODIES = 12

TREE_KINDS = {
    "revolute": 6,
    "prismatic": 3,
    "cylindrical": 3,
    "universal": 3,
    "spherical": 4,
    "planar": 2,
    "rigid": 1,
    "rod": 2,
    "free": 2,
    "screw": 1,
    "point_on_line": 1,
    "point_in_plane": 1,
    "parallel_axes": 1,
}
"""Weights of the kinds of joints of the tree."""

CLOSING_KINDS = {kind: 1.0 for kind in TREE_KINDS if kind != "free"} | {"spherical": 3.0, "rod": 3.0, "universal": 2.0}
"""Weights of the kinds of joints that close loops."""

LINKAGES = {
    "planar": ("revolute", "revolute", "revolute", "revolute"),
    "slider": ("revolute", "revolute", "revolute", "prismatic"),
    "spherical": ("revolute", "revolute", "revolute", "revolute"),
}
"""Linkages of three bodies with dependent rows: kinds of the four joints, from base to base."""

_LOCKING = 0.15
"""Fraction kept of the loops that lock: the closing joint has rows that depend on the others."""

_WORLD = Frame(np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class Recipe:
    """Choices for a random mechanism.

    Attributes
    ----------
    kinds : collection of str
        Kinds of joints allowed.
    plain : bool or None
        No elements but springs, joint springs and constant loads; None: at random, one half.
    chain : bool
        Every body is attached to the body before.
    linkages : float
        Probability that a linkage, not a body, is attached to the tree.
    flat : float
        Height of linkages over the usual height; near zero they are near a singular pose, with all joints on a line.
    """

    kinds: Collection[str] = tuple(JOINT_KINDS)
    plain: bool | None = None
    chain: bool = False
    linkages: float = 0.2
    flat: float = 1.0

    @property
    def gap(self) -> float:
        """Least singular value of the constraints, over the largest, that counts as nonzero."""
        return GAP * min(1.0, self.flat)

    def kind(self, weights: Mapping[str, float], rng: np.random.Generator) -> str:
        """Return a kind of joint at random, by weights."""
        known = {kind: weight for kind, weight in weights.items() if kind in self.kinds}
        return str(rng.choice(list(known), p=np.array(list(known.values())) / sum(known.values())))


USUAL = Recipe()


def random_mechanism(seed: int, bodies: int | None = None, recipe: Recipe = USUAL) -> Mechanism:
    """Return the random mechanism of a seed, assembled in the drawing at time zero, with at least one freedom.

    Parameters
    ----------
    seed : int
    bodies : int, optional
        Number of bodies; default: 1 to `MOST_BODIES` at random.
    recipe : Recipe, optional
    """
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, MOST_BODIES + 1)) if bodies is None else bodies
    draft = _Draft(f"random_{seed}", rng, recipe)
    plain = rng.random() < 0.5 if recipe.plain is None else recipe.plain
    while len(draft.bodies) < count:
        if count - len(draft.bodies) >= 3 and rng.random() < recipe.linkages:
            draft.add_linkage()
        else:
            draft.add_body()
    draft.free_something()
    for _ in range(rng.integers(0, 4) if rng.random() < 0.6 else 0):
        draft.close_loop()
    draft.add_forces(plain)
    if not plain:
        draft.add_constraints()
    return draft.shuffled()


class _Draft:
    """A mechanism under construction."""

    def __init__(self, name: str, rng: np.random.Generator, recipe: Recipe) -> None:
        self.name, self.rng, self.recipe = name, rng, recipe
        self.gravity = 9.8 * _direction(rng)
        self.bodies: dict[str, Body] = {}
        self.joints: list[Joint] = []
        self.elements: dict[str, list[Any]] = {}

    def mechanism(self, joints: list[Joint], elements: Mapping[str, list[Any]]) -> Mechanism:
        """Return the mechanism with the given joints and elements."""
        groups = {name: tuple(group) for name, group in elements.items()}
        return Mechanism(self.name, self.gravity, tuple(self.bodies.values()), tuple(joints), **groups)

    def shuffled(self) -> Mechanism:
        """Return the mechanism with bodies and joints in random order."""
        names = self.rng.permutation(list(self.bodies))
        self.bodies = {str(name): self.bodies[str(name)] for name in names}
        order = self.rng.permutation(len(self.joints))
        return self.mechanism([self.joints[k] for k in order], self.elements)

    def _place(self, body: str) -> Frame:
        return _WORLD if body == GROUND else self.bodies[body].drawing

    def _new_body(self, near: Array) -> str:
        name = f"b{len(self.bodies)}"
        drawing = Frame(near + self.rng.normal(scale=0.2, size=3), _rotation(self.rng))
        self.bodies[name] = lumpy_body(name, drawing, self.rng)
        return name

    def _base(self) -> str:
        """Return the body to which the next body is attached: half of the time the last, so that chains are long."""
        known = [GROUND, *self.bodies]
        return known[-1] if self.recipe.chain or self.rng.random() < 0.5 else str(self.rng.choice(known))

    def _joint(self, kind: str, i: str, j: str, at: Array, axes: Array, to: Array | None = None) -> Joint:
        """Return a joint drawn in the world; either body may be the predecessor.

        Parameters
        ----------
        kind, i, j : str
            Kind of the joint, and names of the bodies.
        at, to : ndarray, shape (3,), m
            Origins of F and of M; default of `to`: the origin of F.
        axes : ndarray, shape (3, 3)
            Axes of both frames, as columns.
        """
        to = at if to is None else to
        if self.rng.random() < 0.4:
            i, j = j, i
        start, end = self._place(i), self._place(j)
        F = Frame(start.R.T @ (at - start.p), start.R.T @ axes)
        M = Frame(end.R.T @ (to - end.p), end.R.T @ axes)
        length = float(np.linalg.norm(to - at)) if kind == "rod" else 0.0
        pitch = float(self.rng.choice([-1, 1]) * self.rng.uniform(0.1, 0.6)) if kind == "screw" else 0.0
        return Joint(f"j{len(self.joints)}", kind, i, j, F, M, length, pitch)

    def _between(self, kind: str, i: str, j: str) -> Joint:
        """Return a joint at a random place and direction between two bodies."""
        at = 0.5 * (self._place(i).p + self._place(j).p) + self.rng.normal(scale=0.2, size=3)
        to = at + self.rng.uniform(0.3, 0.9) * _direction(self.rng) if kind == "rod" else None
        return self._joint(kind, i, j, at, _rotation(self.rng), to)

    def add_body(self) -> None:
        """Attach a body to the tree."""
        base = self._base()
        name = self._new_body(self._place(base).p + 0.7 * _direction(self.rng))
        self.joints.append(self._between(self.recipe.kind(TREE_KINDS, self.rng), base, name))

    def free_something(self) -> None:
        """Make the last joint spherical if all joints are rigid or locked."""
        if not rank_of(self.mechanism(self.joints, {}))[0]:
            self.joints[-1] = replace(self.joints[-1], kind="spherical", length=0.0, pitch=0.0)

    def add_linkage(self) -> None:
        """Attach three bodies to the tree that close a loop with dependent rows."""
        shape, base = str(self.rng.choice(list(LINKAGES))), self._base()
        kinds, R = LINKAGES[shape], _rotation(self.rng)
        corners = np.array([[0.0, 0.0], [0.2, 0.6], [1.1, 0.8], [1.0, 0.0]]) + self.rng.uniform(-0.1, 0.1, (4, 2))
        corners[:, 1] *= self.recipe.flat
        center = self._place(base).p + self.rng.normal(scale=0.4, size=3)
        points, frames = [], []
        for corner, kind in zip(corners, kinds, strict=True):
            axes = R
            if shape == "spherical":  # axes through the center and the corner of a pyramid
                z = R @ np.array([*corner, 1.2])
                axes = _with_z(z / np.linalg.norm(z), self.rng)
                points.append(center + axes[:, 2] * self.rng.uniform(0.3, 1.0))
            else:
                points.append(center + R @ np.array([*corner, self.rng.normal(scale=0.3)]))
            if kind == "prismatic":  # along a direction of the plane
                angle = self.rng.uniform(-0.4, 0.4)
                if self.recipe.flat != 1.0:  # across the line of the other joints: a constraint is lost
                    angle = 0.5 * np.pi + self.recipe.flat * angle
                axes = _with_z(R @ np.array([np.cos(angle), np.sin(angle), 0.0]), self.rng)
            frames.append(axes)
        ends = [base, *(self._new_body(point) for point in points[:3]), base]
        for n, kind in enumerate(kinds):
            self.joints.append(self._joint(kind, ends[n], ends[n + 1], points[n], frames[n]))

    def close_loop(self) -> None:
        """Add a joint between two bodies without a joint, if a degree of freedom remains."""
        known = [GROUND, *self.bodies]
        taken = {frozenset((joint.predecessor, joint.successor)) for joint in self.joints}
        pairs = [(i, j) for n, i in enumerate(known) for j in known[n + 1 :] if frozenset((i, j)) not in taken]
        if not pairs:
            return
        i, j = pairs[int(self.rng.integers(len(pairs)))]
        joint = self._between(self.recipe.kind(CLOSING_KINDS, self.rng), i, j)
        before, _ = rank_of(self.mechanism(self.joints, {}))
        after, clear = rank_of(self.mechanism([*self.joints, joint], {}), self.recipe.gap)
        moves = before - after == len(joint.rows)
        if after and clear and (moves or self.rng.random() < _LOCKING):
            self.joints.append(joint)

    def _add(self, group: str, element: Any) -> None:
        self.elements.setdefault(group, []).append(element)

    def _axes(self) -> list[tuple[str, str]]:
        """Return the coordinates of joints with an axis, in random order."""
        found = [(j.name, coordinate) for j in self.joints for coordinate in AXIS_COORDINATES.get(j.kind, ())]
        return [found[k] for k in self.rng.permutation(len(found))]

    def _function(self) -> Function:
        """Return a smooth function of time of order one."""
        rng = self.rng
        if rng.random() < 0.3:
            return through(np.linspace(-1.0, 11.0, 13), rng.normal(size=13))
        return Function(rng.normal(scale=0.5, size=2), np.array([[1.0, rng.uniform(1.0, 5.0), rng.uniform(0.0, 6.0)]]))

    def _history(self, plain: bool) -> Function | None:
        """Return a function with probability one half; None if plain."""
        return self._function() if not plain and self.rng.random() < 0.5 else None

    def _motion(self) -> Function:
        """Return a smooth function, zero at zero, with slope and curvature there."""
        a, w, phi = self.rng.uniform(0.1, 0.4), self.rng.uniform(1.0, 4.0), self.rng.uniform(0.2, 6.0)
        return Function(np.array([-a * np.sin(phi), self.rng.normal()]), np.array([[a, w, phi]]))

    def add_forces(self, plain: bool) -> None:
        """Add springs, joint springs and loads; if not plain, also functions of time, friction and control."""
        rng, known = self.rng, [GROUND, *self.bodies]
        for n in range(rng.integers(0, 3)):
            i, j = rng.permutation(known)[:2]
            points = (rng.normal(scale=0.4, size=3), rng.normal(scale=0.4, size=3))
            k, c, rest = rng.uniform(5.0, 40.0), rng.uniform(0.0, 2.0), rng.uniform(0.2, 0.8)
            self._add("springs", Spring(f"spring{n}", str(i), str(j), *points, k, c, rest, self._history(plain)))
        for n in range(rng.integers(0, 3)):
            kind, frame = str(rng.choice(["force", "torque"])), str(rng.choice(["world", "body"]))
            body, vector = str(rng.choice(known[1:])), rng.normal(scale=3.0, size=3)
            point = rng.normal(scale=0.3, size=3)
            self._add("loads", Load(f"load{n}", kind, body, vector, frame, point, self._history(plain)))  # type: ignore[arg-type]
        for axis in self._axes():
            name = "_".join(axis)
            if rng.random() < 0.3:
                k, c, rest = rng.uniform(1.0, 10.0), rng.uniform(0.0, 1.0), rng.normal(scale=0.3)
                self._add("joint_springs", JointSpring(f"k_{name}", *axis, k, c, rest, self._history(plain)))
            if not plain and rng.random() < 0.2:
                d, coulomb, v = rng.uniform(0.0, 0.5), rng.uniform(0.0, 2.0), rng.uniform(0.2, 0.5)
                self._add("frictions", Friction(f"f_{name}", *axis, d, coulomb, v))
            if not plain and rng.random() < 0.15:
                gains = (rng.uniform(5.0, 30.0), rng.uniform(0.0, 5.0), rng.uniform(0.0, 3.0))
                self._add("controls", Control(f"c_{name}", *axis, self._function(), *gains))

    def add_constraints(self) -> None:
        """Add drives, couplings, rolling bodies and skates while a degree of freedom remains."""
        rng = self.rng
        axes = self._axes()
        if axes and rng.random() < 0.35:
            self._try("drives", Drive("drive", *axes[0], self._motion()), 1)
        if len(axes) > 1 and rng.random() < 0.45:
            self._try("couplings", Coupling("coupling", *axes[-1], *axes[-2], self._law(axes[-1][1])), 1)
        if rng.random() < 0.3:
            self._try("rollings", self._rolling(str(rng.choice(list(self.bodies)))), 3)
        if rng.random() < 0.25:
            body, point = str(rng.choice(list(self.bodies))), rng.normal(scale=0.3, size=3)
            self._try("skates", Skate("skate", body, point, _direction(rng)), 1)

    def _try(self, group: str, element: Any, rows: int) -> None:
        """Add a constraint if its rows are independent of all others and a degree of freedom remains."""
        before, _ = rank_of(self.mechanism(self.joints, self.elements))
        more = self.elements | {group: [*self.elements.get(group, []), element]}
        after, clear = rank_of(self.mechanism(self.joints, more), self.recipe.gap)
        if after and clear and before - after == rows:
            self.elements = more

    def _law(self, driver: str) -> Function:
        """Return the law of a gear or rack, or of a cam: periodic in an angle, quadratic in a distance."""
        ratio = self.rng.choice([-1, 1]) * self.rng.uniform(0.3, 2.0)
        if self.rng.random() < 0.5:
            return Function(np.array([0.0, ratio]))
        if driver == "distance":
            return Function(np.array([0.0, ratio, self.rng.normal(scale=0.5)]))
        x = np.linspace(0.0, 2 * np.pi, 17)
        lift = self.rng.uniform(0.1, 0.3) * np.sin(x) + self.rng.uniform(-0.1, 0.1) * (1.0 - np.cos(2 * x))
        return through(x, [*lift[:-1], lift[0]], periodic=True)

    def _rolling(self, body: str) -> Rolling:
        """Return a disc, torus or ball on a plane that touches the body in the drawing."""
        rng, pose = self.rng, self.bodies[body].drawing
        normal, center = _direction(rng), rng.normal(scale=0.1, size=3)
        # leaning, but far from lying flat, where the contact is no point
        lean = rng.uniform(0.0, 0.9)
        across = _with_z(normal, rng)[:, 0]
        axis = np.cos(lean) * across + np.sin(lean) * normal
        radius, rounding = ((0.4, 0.0), (0.4, 0.07), (0.0, 0.5))[int(rng.integers(3))]
        height = radius * np.cos(lean) + rounding
        point = pose.p + pose.R @ center - height * normal + _with_z(normal, rng)[:, 1] * rng.normal()
        return Rolling("rolling", body, center, pose.R.T @ axis, radius, point, normal, rounding)


def lumpy_body(name: str, drawing: Frame, rng: np.random.Generator) -> Body:
    """Return a body of eight random points, of one to two kg and some 0.3 m."""
    points = rng.normal(scale=0.3, size=(8, 3))
    masses = rng.uniform(0.1, 0.3, size=8)
    com = masses @ points / masses.sum()
    c = points - com
    inertia = np.einsum("n,nij->ij", masses, np.eye(3) * np.sum(c * c, 1)[:, None, None] - c[:, :, None] * c[:, None])
    return Body(name, float(masses.sum()), com, inertia, drawing)


def rank_of(mechanism: Mechanism, gap: float = GAP) -> tuple[int, bool]:
    """Return the degrees of freedom in the drawing, and whether nonzero singular values exceed `gap` of the largest."""
    singular = relative_singular_values(mechanism, drawing_state(mechanism))
    freedom = 6 * len(mechanism.bodies) - int(np.sum(singular > RANK_TOLERANCE))
    return freedom, not np.any((singular > 1e-12) & (singular < gap))


def relative_singular_values(mechanism: Mechanism, state: State) -> Array:
    """Return the singular values of the constraint Jacobian over the largest; empty without constraints."""
    singular = np.linalg.svd(constraint_jacobian(mechanism, state), compute_uv=False)
    return np.asarray(singular / singular[:1])


def _direction(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def _rotation(rng: np.random.Generator) -> Array:
    return rotation_from_quaternion(quaternion_from_rotation_vector(rng.normal(size=3)))


def _with_z(z: Array, rng: np.random.Generator) -> Array:
    """Return a rotation matrix with the unit vector z as third column, turned about z at random."""
    x = np.cross(_direction(rng), z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
