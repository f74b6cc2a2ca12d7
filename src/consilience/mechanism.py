"""The neutral mechanism: ground, bodies, joints, forces and gravity. Immutable; no state, no engine words.

Conventions (docs/conventions.md): SI units, radians, right-handed frames. W is the world frame, fixed to the body
called ``ground``. A joint joins frame F on its *predecessor* to frame M on its *successor*; the axis of a one-axis
joint is +z of F. Inertia is about the centre of mass, in body axes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import InvalidInput
from consilience.spatial import Array

GROUND = "ground"

BASIC_CONSTRAINTS = ("X", "Y", "Z", "L", "D11", "D12", "D13", "D21", "D22", "D23", "D31", "D32", "D33")
"""Names of the thirteen basic constraints between two joint coordinate systems [MASS (9)-(12)]."""


@dataclass(frozen=True)
class JointKind:
    """One row of the joint table: which basic constraints hold, and which coordinates stay free.

    Attributes
    ----------
    rows : tuple of str
        Basic constraints, held at the value they have where F and M coincide (the rod: at its length).
    coordinates : tuple of str
        Scalar joint coordinates of M relative to F, in the order in which the motion is composed from F to M.
    """

    rows: tuple[str, ...]
    coordinates: tuple[str, ...]

    @property
    def freedom(self) -> int:
        """Number of degrees of freedom the joint leaves."""
        return 6 - len(self.rows)


JOINT_KINDS: dict[str, JointKind] = {
    "revolute": JointKind(("X", "Y", "Z", "D13", "D23"), ("angle",)),
    "prismatic": JointKind(("X", "Y", "D13", "D23", "D12"), ("distance",)),
    "cylindrical": JointKind(("X", "Y", "D13", "D23"), ("distance", "angle")),
    "universal": JointKind(("X", "Y", "Z", "D31"), ("angle1", "angle2")),
    "spherical": JointKind(("X", "Y", "Z"), ("orientation",)),
    "planar": JointKind(("Z", "D13", "D23"), ("x", "y", "angle")),
    "rigid": JointKind(("X", "Y", "Z", "D12", "D13", "D23"), ()),
    "rod": JointKind(("L",), ()),
    "free": JointKind((), ("position", "orientation")),
}
"""The joint table of formulations section 4. Joint axis: z; universal: z of F, then x of M; planar normal: z."""


def _array(value: ArrayLike, shape: tuple[int, ...]) -> Array:
    a = np.array(value, dtype=float)
    if a.shape != shape:
        raise InvalidInput("array", f"shape {a.shape}", f"Give an array of shape {shape}.")
    if not np.all(np.isfinite(a)):
        raise InvalidInput("array", "a component is not finite", "Give finite numbers.")
    a.setflags(write=False)
    return a


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame fixed to a body (a joint coordinate system, or marker).

    Attributes
    ----------
    p : ndarray, shape (3,), m
        Origin from the body's origin, in body axes.
    R : ndarray, shape (3, 3)
        Rotation matrix, frame components to body components.
    """

    p: Array
    R: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "p", _array(self.p, (3,)))
        object.__setattr__(self, "R", _array(self.R, (3, 3)))
        if np.max(np.abs(self.R.T @ self.R - np.eye(3))) > 1e-9 or np.linalg.det(self.R) < 0:
            raise InvalidInput("frame", "the matrix is not a rotation", "Give an orthogonal matrix of determinant +1.")


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body.

    Attributes
    ----------
    name : str
    mass : float, kg
        Positive.
    com : ndarray, shape (3,), m
        Centre of mass from the body's origin, in body axes (``p_BBcm_B``).
    inertia : ndarray, shape (3, 3), kg m^2
        Inertia tensor about the centre of mass in body axes (``I_BBcm_B``): ``I[0, 1] = -sum m x y``.
    drawing : Frame
        Pose of the body in the drawing, from the world origin (``p_WB``, ``R_WB``).
    """

    name: str
    mass: float
    com: Array
    inertia: Array
    drawing: Frame

    def __post_init__(self) -> None:
        where = f"body '{self.name}'"
        object.__setattr__(self, "com", _array(self.com, (3,)))
        object.__setattr__(self, "inertia", _array(self.inertia, (3, 3)))
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise InvalidInput(f"{where}: mass", f"{self.mass} kg is not positive", "Give a mass above zero.")
        check_inertia(self.inertia, f"{where}: inertia")


def check_inertia(inertia: Array, where: str) -> None:
    """Refuse a tensor no rigid body can have.

    Raises
    ------
    InvalidInput
        If it is not symmetric, not positive definite, or violates the triangle inequality of principal moments.
    """
    if np.max(np.abs(inertia - inertia.T)) > 1e-12 * np.max(np.abs(inertia)):
        raise InvalidInput(where, "the tensor is not symmetric", "Give a symmetric 3 x 3 tensor.")
    principal = np.linalg.eigvalsh(inertia)
    text = ", ".join(f"{m:.6g}" for m in principal)
    if principal[0] <= 0:
        raise InvalidInput(
            where,
            f"principal moments {text} kg m^2 are not all positive",
            "Give a three-dimensional body: all principal moments above zero.",
        )
    if principal[0] + principal[1] < principal[2] * (1 - 1e-12):
        raise InvalidInput(
            where,
            f"principal moments {text} kg m^2 violate the triangle inequality: no mass distribution has them",
            "The sum of any two principal moments must be at least the third; "
            "check the signs of the products of inertia (Ixy = -sum m x y).",
        )


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between frame F on the predecessor and frame M on the successor.

    Attributes
    ----------
    name, kind : str
        Kind is a key of `JOINT_KINDS`.
    predecessor, successor : str
        Body names; either may be ``ground``.
    F, M : Frame
        Frames in the axes of the predecessor and of the successor.
    length : float, m
        Distance of the origins of F and M that a rod holds; zero for every other kind.
    """

    name: str
    kind: str
    predecessor: str
    successor: str
    F: Frame
    M: Frame
    length: float = 0.0

    def __post_init__(self) -> None:
        where = f"joint '{self.name}'"
        if self.kind not in JOINT_KINDS:
            raise InvalidInput(
                f"{where}: kind", f"'{self.kind}' is not a joint kind", f"Use one of {', '.join(JOINT_KINDS)}."
            )
        if self.predecessor == self.successor:
            raise InvalidInput(where, f"both sides are '{self.successor}'", "Join two different bodies.")
        if self.kind == "rod" and not self.length > 0:
            raise InvalidInput(f"{where}: length", f"{self.length} m", "Draw the two ends of the rod apart.")

    @property
    def rows(self) -> tuple[str, ...]:
        """Basic constraints of the joint."""
        return JOINT_KINDS[self.kind].rows


@dataclass(frozen=True, eq=False)
class Spring:
    """Spring-damper between two points: ``F = (k (L - L0) + c dL/dt) e`` on the predecessor [MASS (30)-(32)].

    Points are in the axes of their bodies, from the bodies' origins, in m; k in N/m, c in N s/m, L0 in m.
    """

    name: str
    predecessor: str
    successor: str
    point_predecessor: Array
    point_successor: Array
    stiffness: float
    damping: float
    free_length: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_predecessor", _array(self.point_predecessor, (3,)))
        object.__setattr__(self, "point_successor", _array(self.point_successor, (3,)))


@dataclass(frozen=True, eq=False)
class JointSpring:
    """Spring-damper about or along the axis of a joint: ``-(k (q - q0) + c dq/dt)`` on the successor [MASS (33)].

    The joint is revolute (k in N m/rad), prismatic (k in N/m) or cylindrical (`coordinate` says which). An angle is
    counted over full turns, starting within half a turn of zero at the initial state.
    """

    name: str
    joint: str
    coordinate: str
    stiffness: float
    damping: float
    rest: float


@dataclass(frozen=True, eq=False)
class Load:
    """A constant force at a point of a body, or a constant torque on it, fixed in the world or in the body.

    Attributes
    ----------
    vector : ndarray, shape (3,), N or N m
    point : ndarray, shape (3,), m
        Point of application of a force in body axes from the body's origin; without meaning for a torque.
    frame : {"world", "body"}
        Axes in which `vector` is constant.
    """

    name: str
    kind: Literal["force", "torque"]
    body: str
    vector: Array
    frame: Literal["world", "body"]
    point: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "vector", _array(self.vector, (3,)))
        object.__setattr__(self, "point", _array(self.point, (3,)))


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies, joints, force elements and gravity.

    Attributes
    ----------
    name : str
    gravity : ndarray, shape (3,), m/s^2
        In world axes; there is no default and no "up".
    bodies, joints, springs, joint_springs, loads : tuple
        In a fixed order; arrays that an engine returns follow it (ground is not a body of the list).

    Raises
    ------
    InvalidInput
        Duplicate or unknown names, bodies that no chain of joints connects to the ground.
    """

    name: str
    gravity: Array
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    springs: tuple[Spring, ...] = ()
    joint_springs: tuple[JointSpring, ...] = ()
    loads: tuple[Load, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", _array(self.gravity, (3,)))
        if not self.bodies:
            raise InvalidInput(f"mechanism '{self.name}': body", "there is no body", "Give at least one [[body]].")
        self._check_names()
        self._check_references()
        self._check_connected()

    @cached_property
    def body_index(self) -> dict[str, int]:
        """Position of each body in the arrays; ground is -1."""
        return {GROUND: -1} | {body.name: i for i, body in enumerate(self.bodies)}

    @cached_property
    def joint_index(self) -> dict[str, int]:
        """Position of each joint in the arrays."""
        return {joint.name: i for i, joint in enumerate(self.joints)}

    def _check_names(self) -> None:
        groups: dict[str, Iterable[str]] = {
            "body": [GROUND, *(b.name for b in self.bodies)],
            "joint": [j.name for j in self.joints],
            "force element": [
                *(s.name for s in self.springs),
                *(s.name for s in self.joint_springs),
                *(load.name for load in self.loads),
            ],
        }
        for what, names in groups.items():
            seen: set[str] = set()
            for name in names:
                if name in seen:
                    raise InvalidInput(f"{what} '{name}'", "the name is used twice", "Give each its own name.")
                seen.add(name)

    def _check_references(self) -> None:
        pairs = [(f"joint '{j.name}'", n) for j in self.joints for n in (j.predecessor, j.successor)]
        pairs += [(f"spring '{s.name}'", n) for s in self.springs for n in (s.predecessor, s.successor)]
        pairs += [(f"load '{load.name}'", load.body) for load in self.loads]
        for where, name in pairs:
            if name not in self.body_index:
                known = ", ".join(self.body_index)
                raise InvalidInput(where, f"there is no body '{name}'", f"Bodies are: {known}.")
        for spring in self.joint_springs:
            where = f"joint spring '{spring.name}'"
            if spring.joint not in self.joint_index:
                known = ", ".join(self.joint_index)
                raise InvalidInput(where, f"there is no joint '{spring.joint}'", f"Joints are: {known}.")
            kind = self.joints[self.joint_index[spring.joint]].kind
            if kind not in ("revolute", "prismatic", "cylindrical"):
                raise InvalidInput(where, f"joint '{spring.joint}' is {kind}", "Use a joint with one axis.")
            if spring.coordinate not in JOINT_KINDS[kind].coordinates:
                known = ", ".join(JOINT_KINDS[kind].coordinates)
                raise InvalidInput(where, f"a {kind} joint has no '{spring.coordinate}'", f"It has: {known}.")

    def _check_connected(self) -> None:
        reached = {GROUND}
        while True:
            ends = [{j.predecessor, j.successor} for j in self.joints]
            new = {n for pair in ends if pair & reached for n in pair} - reached
            if not new:
                break
            reached |= new
        loose = [b.name for b in self.bodies if b.name not in reached]
        if loose:
            raise InvalidInput(
                f"mechanism '{self.name}': body '{loose[0]}'",
                "no chain of joints connects it to the ground",
                "Add a joint (kind = 'free' for a body that floats).",
            )

    def constraint_count(self) -> int:
        """Number of constraint rows of all joints, redundant ones included."""
        return sum(len(j.rows) for j in self.joints)


@dataclass(frozen=True, eq=False)
class State:
    """Poses and velocities of all bodies (ground excluded) at one instant, in the mechanism's body order.

    Attributes
    ----------
    p_WB : ndarray, shape (n_b, 3), m
        Origins of the bodies.
    quat_WB : ndarray, shape (n_b, 4)
        Unit quaternions, scalar first.
    v_WB_W : ndarray, shape (n_b, 3), m/s
        Velocities of the origins, in world axes.
    w_WB_W : ndarray, shape (n_b, 3), rad/s
        Angular velocities, in world axes.
    """

    p_WB: Array
    quat_WB: Array
    v_WB_W: Array
    w_WB_W: Array

    def __post_init__(self) -> None:
        n = len(self.p_WB)
        for name, width in (("p_WB", 3), ("quat_WB", 4), ("v_WB_W", 3), ("w_WB_W", 3)):
            object.__setattr__(self, name, _array(getattr(self, name), (n, width)))
        if n and np.max(np.abs(np.linalg.norm(self.quat_WB, axis=1) - 1.0)) > 1e-12:
            raise InvalidInput("state: quat_WB", "a quaternion is not unit", "Normalise it before building a state.")
