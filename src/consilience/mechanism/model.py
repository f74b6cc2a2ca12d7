"""Mechanism (ground, bodies, joints, elements, gravity) and state: immutable data, independent of any engine.

Conventions (docs/conventions.md): SI units, radians, right-handed frames. W is the world frame, fixed to the body
called ``ground``; B is the frame of a body. ``p_WB`` is the position of the origin of B from that of W in axes of W,
``R_WB`` maps components, ``v_W = R_WB @ v_B``. A joint connects frame F on its *predecessor* with frame M on its
*successor*; the axis of a one-axis joint is +z of F. Inertia is about the centre of mass, in body axes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from consilience.errors import InvalidInput, require
from consilience.mechanism.bodies import Body, Frame
from consilience.mechanism.contacts import Contact
from consilience.mechanism.elements import Control, Coupling, Drive, Friction, JointSpring, Load, Rolling, Skate, Spring
from consilience.mechanism.joints import AXIS_COORDINATES, JOINT_KINDS
from consilience.mechanism.spatial import Array, fixed_array, rotation_from_quaternion
from consilience.mechanism.stops import DryFriction, Stop

GROUND = "ground"


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
        Frames on the predecessor and on the successor, in body axes.
    length : float, m
        Distance that a rod holds between the origins of F and M; zero for every other kind.
    pitch : float, m
        Advance of a screw in a turn, positive for a right-handed one; zero for every other kind.
    """

    name: str
    kind: str
    predecessor: str
    successor: str
    F: Frame
    M: Frame
    length: float = 0.0
    pitch: float = 0.0

    def __post_init__(self) -> None:
        where = f"joint '{self.name}'"
        for name in ("F", "M"):
            require(getattr(self, name), Frame, f"{where}: {name}", "Give Frame(p, R), in axes of the body.")
        if self.kind not in JOINT_KINDS:
            raise InvalidInput(
                f"{where}: kind", f"'{self.kind}' is not a joint kind", f"Use one of {', '.join(JOINT_KINDS)}."
            )
        if self.predecessor == self.successor:
            raise InvalidInput(where, f"both sides are '{self.successor}'", "Join two different bodies.")
        if self.kind == "rod" and not self.length > 0:
            what = "the ends of the rod coincide" if self.length == 0.0 else f"{self.length} m"
            raise InvalidInput(f"{where}: length", what, "Draw the two ends of the rod apart.")
        if (self.kind == "screw") != (self.pitch != 0.0) or not np.isfinite(self.pitch):
            raise InvalidInput(f"{where}: pitch", f"{self.pitch} m", "Give a screw, and no other kind, its pitch.")

    def __repr__(self) -> str:
        return f"Joint '{self.name}': {self.kind}, {self.predecessor} to {self.successor}"

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the basic constraints that the joint holds."""
        return JOINT_KINDS[self.kind].rows


Element = (
    Spring | JointSpring | Load | Friction | Control | Drive | Coupling | Rolling | Skate | Contact | Stop | DryFriction
)


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism:
    """Bodies, joints, force elements and gravity.

    Attributes
    ----------
    name : str
    gravity : ndarray, shape (3,), m/s^2
        In world axes; there is no default and no "up".
    bodies, joints : tuple
        Arrays of an answer follow this order. The ground is not in the list of bodies.
    springs, joint_springs, loads, frictions, controls : tuple
        Force elements.
    drives, couplings, rollings, skates : tuple
        Constraints other than joints.
    contacts : tuple
        Shapes that may touch.
    stops, dry_frictions : tuple
        Limits of joint coordinates, and friction in them that sticks.

    Raises
    ------
    InvalidInput
        Duplicate or unknown names, or bodies that no chain of joints connects to the ground.
    """

    name: str
    gravity: Array
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    springs: tuple[Spring, ...] = ()
    joint_springs: tuple[JointSpring, ...] = ()
    loads: tuple[Load, ...] = ()
    frictions: tuple[Friction, ...] = ()
    controls: tuple[Control, ...] = ()
    drives: tuple[Drive, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    rollings: tuple[Rolling, ...] = ()
    skates: tuple[Skate, ...] = ()
    contacts: tuple[Contact, ...] = ()
    stops: tuple[Stop, ...] = ()
    dry_frictions: tuple[DryFriction, ...] = ()

    html: ClassVar[Callable[[Mechanism, State | None], str] | None] = None
    """Function that draws a mechanism, in a state, for notebooks: the library sets it, which knows how to draw."""

    writer: ClassVar[Callable[[Mechanism, str | Path], Path] | None] = None
    """Function that writes a mechanism as a case file: the library sets it, which knows files."""

    def __repr__(self) -> str:
        elements = [f", {what} '{element.name}'" for what, element in self._elements]
        return f"Mechanism '{self.name}': {len(self.bodies)} bodies, {len(self.joints)} joints{''.join(elements)}"

    def _repr_html_(self) -> str | None:
        return self.drawn()

    def drawn(self, state: State | None = None) -> str | None:
        """Return an SVG picture of the mechanism in a state, or in its drawing; None if only this room is imported."""
        return None if Mechanism.html is None else Mechanism.html(self, state)

    def save(self, path: str | Path) -> Path:
        """Write the mechanism as a case file, which starts at rest in its drawing; return the path.

        The name of the file is the name of what is read from it.

        Raises
        ------
        InvalidInput
            The file cannot be written.
        """
        assert Mechanism.writer is not None, "importing consilience sets it"
        return Mechanism.writer(self, path)

    def __post_init__(self) -> None:
        where = f"mechanism '{self.name}'"
        object.__setattr__(self, "gravity", fixed_array(self.gravity, (3,), f"{where}: gravity"))
        for name, kind in (("bodies", Body), ("joints", Joint)):
            given = getattr(self, name)
            require(given, Iterable, f"{where}: {name}", f"Give a sequence of {kind.__name__}.")
            object.__setattr__(self, name, tuple(given))
            for n, one in enumerate(getattr(self, name)):
                require(one, kind, f"{where}: {name}[{n}]", f"Give a sequence of {kind.__name__}.")
        if not self.bodies:
            raise InvalidInput(f"mechanism '{self.name}': body", "there is no body", "Give at least one [[body]].")
        self._check_names()
        self._check_references()
        self._check_connected()

    @cached_property
    def body_index(self) -> dict[str, int]:
        """Index of each body in the arrays; the ground has -1."""
        return {GROUND: -1} | {body.name: i for i, body in enumerate(self.bodies)}

    @cached_property
    def joint_index(self) -> dict[str, int]:
        """Index of each joint in the arrays."""
        return {joint.name: i for i, joint in enumerate(self.joints)}

    @property
    def _elements(self) -> Iterator[tuple[str, Element]]:
        """Every element that is neither body nor joint, with its kind as messages name it."""
        for group in fields(self):
            if group.default == ():  # bodies and joints have no default
                for element in getattr(self, group.name):
                    yield group.name.removesuffix("s").replace("_", " "), element

    @cached_property
    def features(self) -> dict[str, str]:
        """Features beyond bodies that an engine must represent, each with the first joint or element that has it.

        Features are joint kinds, such as ``screw joint``, kinds of elements, such as ``drive`` or ``actuator``, and
        shapes and laws of contacts, such as ``sphere on plane contact`` and ``contact friction``.
        """
        found: dict[str, str] = {}
        for joint in self.joints:
            found.setdefault(f"{joint.kind} joint", f"joint '{joint.name}'")
        for what, element in self._elements:
            for feature in element.features if isinstance(element, Contact | Stop | DryFriction) else (what,):
                found.setdefault(feature, f"{what} '{element.name}'")
            if isinstance(element, Spring | JointSpring) and element.actuator is not None:
                found.setdefault("actuator", f"{what} '{element.name}'")
            if isinstance(element, JointSpring) and not element.is_linear:
                found.setdefault("nonlinear joint spring", f"{what} '{element.name}'")
            if isinstance(element, Load) and element.history is not None:
                found.setdefault("load in time", f"{what} '{element.name}'")
        return found

    def _check_names(self) -> None:
        """Refuse two bodies, joints or elements of one name."""
        groups: dict[str, list[str]] = {
            "body": [GROUND, *(b.name for b in self.bodies)],
            "joint": [j.name for j in self.joints],
            "element": [element.name for _, element in self._elements],
        }
        for what, names in groups.items():
            seen: set[str] = set()
            for name in names:
                if name in seen:
                    raise InvalidInput(f"{what} '{name}'", "the name is used twice", "Give each its own name.")
                seen.add(name)

    def _check_references(self) -> None:
        """Refuse names of bodies, joints and coordinates that do not exist, and guides on the ground."""
        bodies = [(f"joint '{j.name}'", n) for j in self.joints for n in (j.predecessor, j.successor)]
        for what, element in self._elements:
            where = f"{what} '{element.name}'"
            if isinstance(element, Spring):
                bodies += [(where, element.predecessor), (where, element.successor)]
            elif isinstance(element, Load | Rolling | Skate):
                bodies.append((where, element.body))
            elif isinstance(element, Contact):
                bodies += [(where, element.body), (where, element.partner)]
            else:
                self._check_coordinate(where, element.joint, element.coordinate)
            if isinstance(element, Coupling):
                self._check_coordinate(where, element.driver_joint, element.driver_coordinate)
        for where, name in bodies:
            if name not in self.body_index:
                known = ", ".join(self.body_index)
                raise InvalidInput(where, f"there is no body '{name}'", f"Bodies are: {known}.")
        self._check_elements()

    def _check_elements(self) -> None:
        """Refuse limits of driven coordinates, and guides on the ground."""
        guided: tuple[Rolling | Skate, ...] = (*self.rollings, *self.skates)
        driven = {(d.joint, d.coordinate): d.name for d in self.drives}
        for stop in self.stops:
            if (stop.joint, stop.coordinate) in driven:
                what = f"drive '{driven[stop.joint, stop.coordinate]}' moves this coordinate, whatever the limit"
                raise InvalidInput(f"stop '{stop.name}'", what, "Remove the stop or the drive.")
        for rolls in guided:
            if rolls.body == GROUND:
                raise InvalidInput(
                    f"{type(rolls).__name__.lower()} '{rolls.name}': body", "the ground does not move", "Name a body."
                )

    def _check_coordinate(self, where: str, joint: str, coordinate: str) -> None:
        if joint not in self.joint_index:
            raise InvalidInput(where, f"there is no joint '{joint}'", f"Joints are: {', '.join(self.joint_index)}.")
        kind = self.joints[self.joint_index[joint]].kind
        known = AXIS_COORDINATES.get(kind, ())
        if not known:
            raise InvalidInput(where, f"joint '{joint}' is {kind}", "Use a joint with one axis.")
        if coordinate not in known:
            raise InvalidInput(where, f"a {kind} joint has no '{coordinate}'", f"It has: {', '.join(known)}.")

    def _check_connected(self) -> None:
        """Refuse bodies that no chain of joints connects to the ground."""
        beside: dict[str, list[str]] = {}
        for j in self.joints:
            beside.setdefault(j.predecessor, []).append(j.successor)
            beside.setdefault(j.successor, []).append(j.predecessor)
        reached, front = {GROUND}, [GROUND]
        while front:
            new = [name for name in beside.get(front.pop(), []) if name not in reached]
            reached.update(new)
            front += new
        loose = [b.name for b in self.bodies if b.name not in reached]
        if loose:
            raise InvalidInput(
                f"mechanism '{self.name}': body '{loose[0]}'",
                "no chain of joints connects it to the ground",
                "Add a joint (kind = 'free' for a body that floats).",
            )

    @property
    def holonomic_count(self) -> int:
        """Number of constraint rows at position level, redundant rows included."""
        joints = sum(len(j.rows) for j in self.joints)
        return joints + len(self.drives) + len(self.couplings) + len(self.rollings)

    def constraint_count(self) -> int:
        """Number of all constraint rows, redundant and non-holonomic rows included."""
        return self.holonomic_count + 2 * len(self.rollings) + len(self.skates)


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
        n = 1 if np.ndim(self.p_WB) < 2 and np.size(self.p_WB) else len(self.p_WB)
        for name, width in (("p_WB", 3), ("quat_WB", 4), ("v_WB_W", 3), ("w_WB_W", 3)):
            value = fixed_array(getattr(self, name), (n, width), f"state: {name}", " One row is one body.")
            object.__setattr__(self, name, value)
        lengths = np.sqrt((self.quat_WB * self.quat_WB).sum(axis=1))
        if n and abs(lengths - 1.0).max() > 1e-12:
            raise InvalidInput("state: quat_WB", "a quaternion is not unit", "Normalise it before building a state.")

    def __repr__(self) -> str:
        return f"State of {len(self.p_WB)} bodies"

    @cached_property
    def R_WB(self) -> Array:
        """Rotation matrices of the bodies, shape (n_b, 3, 3)."""
        return rotation_from_quaternion(self.quat_WB)


def require_states(mechanism: Mechanism, states: Iterable[State]) -> None:
    """Refuse what is no mechanism, and states that are not of this mechanism.

    Raises
    ------
    InvalidInput
    """
    remedy = "Give a Mechanism: of a case, case.mechanism; of a drawing, draw.mechanism()."
    require(mechanism, Mechanism, "mechanism", remedy)
    if isinstance(states, State):
        raise InvalidInput("states", "it is one state, not a sequence of states", "Give a list: [state].")
    require(states, Iterable, "states", "Give a list of states, for example of random_states.")
    for state in states:
        require(state, State, "state", "Give a State, for example initial_state(mechanism).")
        if len(state.p_WB) != len(mechanism.bodies):
            what = f"it has {len(state.p_WB)} bodies, mechanism '{mechanism.name}' has {len(mechanism.bodies)}"
            raise InvalidInput("state", what, "Give a state of this mechanism.")
