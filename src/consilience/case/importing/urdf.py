"""Reader of URDF: links and joints of an XML file, in the drawing where every joint coordinate is zero.

Conventions of the format (<http://wiki.ros.org/urdf/XML>): the frame of a joint is that of its child at zero, ``rpy``
are rotations about fixed axes, ``Rz(yaw) Ry(pitch) Rx(roll)``, an inertia is about the centre of mass in axes of the
inertial frame. The type ``spherical`` is no part of the format.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from consilience.engine.native import CoordinateLaw, NativeJoint, Notes, Parts, Piece
from consilience.mechanism import Array, Frame, elementary_rotation

STANDARD_GRAVITY = np.array([0.0, 0.0, -9.81])
"""In m/s^2; URDF has no gravity, engines that read URDF assume this one."""

_KINDS = {
    "fixed": "",
    "revolute": "R",
    "continuous": "R",
    "prismatic": "P",
    "planar": "planar",
    "floating": "F",
    "spherical": "S",
}

_IDENTITY = Frame(np.zeros(3), np.eye(3))

_OF_A_JOINT = {"origin", "parent", "child", "axis", "dynamics", "mimic"}

COULOMB = "Coulomb friction, not read: `dry_friction` states it"
LIMITS = "limits, not read: a `stop` states them"
SHAPES = "shapes, not read: a `contact` states which pairs touch"

LEFT_OUT = {
    "visual": SHAPES,
    "collision": SHAPES,
    "limit": LIMITS,
    "safety_controller": "limits, which a case does not have",
    "calibration": "calibration, which a case does not have",
    "transmission": "transmissions and motors, which a case does not have",
    "material": SHAPES,
    "gazebo": "extensions for Gazebo, not read",
}
"""Elements of the format without effect on the free motion, or that are not read."""


@dataclass(frozen=True, eq=False)
class _UrdfJoint:
    name: str
    kind: str
    parent: str
    child: str
    origin: Frame
    axis: Array
    damping: float


class _UrdfReader:
    """Reader of elements and attributes; refusals go to the notes."""

    def __init__(self, where: str, notes: Notes) -> None:
        self.where, self.notes = where, notes

    def text(self, element: Element | None, attribute: str, what: str) -> str:
        """Return a required attribute; if missing, note a refusal and return an empty text."""
        value = None if element is None else element.get(attribute)
        if not value:
            self.notes.refuse(f"'{attribute}' is missing", what)
            return ""
        return value

    def numbers(self, element: Element | None, attribute: str, count: int, default: str, what: str) -> Array:
        """Return the numbers of an attribute; if wrong, note a refusal and return zeros.

        Parameters
        ----------
        element : Element or None
            None: the default applies.
        attribute, default : str
            Without a default the attribute is required.
        count : int
            Number of numbers.
        what : str
            Name of the joint or link, for the note.
        """
        given = default if element is None else element.get(attribute, default)
        if not given:
            self.notes.refuse(f"'{attribute}' is missing", what)
            return np.zeros(count)
        try:
            values = np.array([float(word) for word in given.split()])
        except ValueError:
            values = np.zeros(0)
        if len(values) != count or not np.all(np.isfinite(values)):
            self.notes.refuse(f"'{attribute}' is not {count} finite number{'s' * (count > 1)}", what)
            return np.zeros(count)
        return values

    def number(self, element: Element | None, attribute: str, default: str, what: str) -> float:
        return float(self.numbers(element, attribute, 1, default, what)[0])

    def frame(self, element: Element | None, what: str) -> Frame:
        """Return the frame of an ``origin``."""
        roll, pitch, yaw = self.numbers(element, "rpy", 3, "0 0 0", what)
        R = elementary_rotation(2, yaw) @ elementary_rotation(1, pitch) @ elementary_rotation(0, roll)
        return Frame(self.numbers(element, "xyz", 3, "0 0 0", what), R)

    def inertial(self, link: Element, what: str) -> tuple[float, Array, Array]:
        """Return mass, centre of mass and inertia about that centre, in axes of the link."""
        element = link.find("inertial")
        if element is None:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        frame = self.frame(element.find("origin"), what)
        mass = self.number(element.find("mass"), "value", "", what)
        tensor = element.find("inertia")
        xx, yy, zz, xy, xz, yz = (
            self.number(tensor, f"i{name}", "", what) for name in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if mass < 0.0:
            self.notes.refuse(f"its mass is {mass:g} kg", what)
        return mass, frame.p, frame.R @ inertia @ frame.R.T

    def joint(self, element: Element) -> _UrdfJoint:
        """Return a joint: frame in the parent link, unit axis, damping."""
        name = self.text(element, "name", "joint")
        what = f"joint '{name}'"
        kind = self.text(element, "type", what)
        if kind and kind not in _KINDS:
            self.notes.refuse(f"there is no joint type '{kind}'", what)
        axis = self.numbers(element.find("axis"), "xyz", 3, "1 0 0", what)
        size = float(np.linalg.norm(axis))
        if size == 0.0 and kind not in ("fixed", "floating", "spherical"):
            self.notes.refuse("its axis has no length", what)
        elif kind in ("revolute", "continuous", "prismatic", "planar") and abs(size - 1.0) > 1e-12:
            self.notes.add("axis that is not a unit vector, made one", name)
        dynamics = element.find("dynamics")
        if self.number(dynamics, "friction", "0", what):
            self.notes.add(COULOMB, name)
        return _UrdfJoint(
            name,
            _KINDS.get(kind, ""),
            self.text(element.find("parent"), "link", what),
            self.text(element.find("child"), "link", what),
            self.frame(element.find("origin"), what),
            axis / size if size else axis,
            self.number(dynamics, "damping", "0", what),
        )

    def mimic(self, element: Element) -> Iterator[CoordinateLaw]:
        """Yield the law ``offset + multiplier * driver`` of a joint that mimics another joint."""
        given, name = element.find("mimic"), element.get("name", "")
        if given is not None and element.get("type") != "fixed":
            what = f"joint '{name}'"
            offset = self.number(given, "offset", "0", what)
            ratio = self.number(given, "multiplier", "1", what)
            yield CoordinateLaw(f"{name}_mimic", name, self.text(given, "joint", what), (offset, ratio))

    def unread(self, robot: Element) -> None:
        """Note all elements that were not read."""
        for element in robot:
            name = element.get("name") or element.get("reference") or element.tag
            if element.tag not in ("link", "joint"):
                self.notes.add(LEFT_OUT.get(element.tag, f"<{element.tag}>, not read"), name)
                continue
            used = {"inertial"} if element.tag == "link" else _OF_A_JOINT
            for tag in dict.fromkeys(e.tag for e in element if e.tag not in used):
                reason = LEFT_OUT.get(tag, f"<{tag}> of a {element.tag}, not read")
                if name not in self.notes.left_out.get(reason, ()):
                    self.notes.add(reason, name)


def _unique(names: list[str], reason: str, notes: Notes) -> None:
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        notes.refuse(reason, *twice)


def _in_order(links: dict[str, Element], joints: list[_UrdfJoint], notes: Notes) -> list[str]:
    """Names of the links, carriers first."""
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                notes.refuse(f"there is no link '{end}'", f"joint '{joint.name}'")
    children = [joint.child for joint in joints]
    _unique(children, "two joints lead to it", notes)
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        notes.refuse(f"{len(roots)} links have no parent; one is the root", "robot")
    hanging: dict[str, list[str]] = {}
    for joint in joints:
        hanging.setdefault(joint.parent, []).append(joint.child)
    order = list(roots[:1])
    for name in order:  # the list grows during the loop
        if len(order) <= len(links):
            order += hanging.get(name, [])
    if set(order) != set(links) and len(roots) == 1:
        notes.refuse("no chain of joints connects it to the root", *(n for n in links if n not in order))
    return order


def read_urdf(robot: Element, path: Path, free_base: bool, notes: Notes) -> Parts:
    """Return the parts of a URDF file.

    Parameters
    ----------
    robot : Element
        Root of the XML.
    path : Path
        File, for its name.
    free_base : bool
        The root link floats; otherwise the root link is the ground.
    notes : Notes
        Changes and refusals are added.

    Raises
    ------
    InvalidInput
        All errors of the file in one message.
    """
    reader = _UrdfReader(path.name, notes)
    _unique([e.get("name", "") for e in robot.findall("link")], "two links have this name", notes)
    _unique([e.get("name", "") for e in robot.findall("joint")], "two joints have this name", notes)
    links = {reader.text(e, "name", "link"): e for e in robot.findall("link")}
    joints = [reader.joint(e) for e in robot.findall("joint")]
    laws = [law for e in robot.findall("joint") for law in reader.mimic(e)]
    _check_drivers(laws, joints, notes)
    order = _in_order(links, joints, notes)
    if not any(link.find("inertial") is not None for link in links.values()):
        notes.refuse("no link of this file has an <inertial>", "robot")
    notes.check(path.name)
    onto = {joint.child: joint for joint in joints}
    frames: dict[str, Frame] = {}
    pieces = []
    for name in order:
        if name in onto:
            joint, start = onto[name], frames[onto[name].parent]
            frames[name] = Frame(start.p + start.R @ joint.origin.p, start.R @ joint.origin.R)
            motions, carrier = _motions(joint, frames[name]), joint.parent
        else:
            frames[name], carrier = _IDENTITY, ""
            motions = (NativeJoint("root", "F", np.zeros(3), np.array([0.0, 0.0, 1.0])),) if free_base else ()
        pieces.append(Piece(name, carrier, frames[name], motions, *reader.inertial(links[name], f"link '{name}'")))
    reader.unread(robot)
    notes.add(f"gravity, which URDF does not have, is {STANDARD_GRAVITY.tolist()} m/s^2", "mechanism")
    notes.check(path.name)
    return Parts(path.stem, STANDARD_GRAVITY, tuple(pieces), tuple(laws))


def _check_drivers(laws: list[CoordinateLaw], joints: list[_UrdfJoint], notes: Notes) -> None:
    names = {joint.name for joint in joints}
    for law in laws:
        if law.driver not in names or law.driver == law.motion or not math.isfinite(sum(law.coefficients)):
            notes.refuse(f"it mimics '{law.driver}', which is no other joint", f"joint '{law.motion}'")


def _motions(joint: _UrdfJoint, frame: Frame) -> tuple[NativeJoint, ...]:
    if not joint.kind:
        return ()
    return (NativeJoint(joint.name, joint.kind, frame.p, frame.R @ joint.axis, damping=joint.damping),)
