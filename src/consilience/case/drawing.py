"""A drawing: a mechanism built from Python as it is drawn on paper, part by part, by the names of a case file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from consilience.case.case import Case
from consilience.case.file.reader import cases_from_tables
from consilience.case.file.schema import CaseTable
from consilience.case.file.writer import function_table
from consilience.errors import InvalidInput
from consilience.mechanism import (
    JOINT_KINDS,
    Array,
    Frame,
    Function,
    Mechanism,
    check_inertia,
    inertia_tensor,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from consilience.mechanism.solids import Solid
from consilience.mechanism.spatial import fixed_array

_ELEMENTS = tuple(
    name
    for name in CaseTable.model_fields
    if name not in ("title", "sources", "remarks", "tags", "gravity", "body", "joint", "initial", "trajectory")
    and name not in ("instant", "published", "variants")
)
"""Kinds of elements of a case file."""

_INERTIA = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


def frame(p: ArrayLike, orientation: ArrayLike | None = None) -> Frame:
    """Return a frame of its origin and its axes.

    Parameters
    ----------
    p : array_like, shape (3,), m
    orientation : array_like, shape (3, 3) or (4,), optional
        Rotation matrix, or unit quaternion, scalar first; default: axes of the world.

    Raises
    ------
    InvalidInput
        The orientation has another shape, or is no rotation.
    """
    at = fixed_array(p, (3,), "frame: p")
    if orientation is None:
        return Frame(at, np.eye(3))
    if np.shape(orientation) == (3, 3):
        return Frame(at, np.asarray(orientation, dtype=float))
    hint = " Give a rotation matrix or a quaternion."
    quaternion = fixed_array(orientation, (4,), "frame: orientation", hint)
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > 1e-9:
        raise InvalidInput("frame: orientation", f"the quaternion has norm {norm:.9g}", "Give a unit quaternion.")
    return Frame(at, rotation_from_quaternion(quaternion / norm))


class Drawing:
    """A mechanism in the making: bodies, joints and elements in the pose in which they are drawn.

    Points and axes are those of the world in the drawing, m. The fields of elements have the names of a case file
    (``consilience schema case``).

    Parameters
    ----------
    name : str
    gravity : array_like, shape (3,), m/s^2
        In world axes; there is no default and no "up".
    title : str, optional
        One line for reports; default: the name.

    Examples
    --------
    >>> draw = Drawing("pendulum", gravity=(0, 0, -9.81))
    >>> draw.body("rod", bar((0, 0, 0), (0, 0, -1), radius=0.02), density=7850)
    >>> draw.joint("pin", "revolute", "ground", "rod", at=(0, 0, 0), axis=(0, 1, 0))
    >>> pendulum = draw.mechanism()
    """

    def __init__(self, name: str, gravity: ArrayLike, title: str = "") -> None:
        self.name = name
        self._tables: dict[str, Any] = {"title": title or name, "sources": ["own"], "gravity": _plain(gravity)}

    def body(
        self,
        name: str,
        solid: Solid | None = None,
        *,
        mass: float | None = None,
        density: float | None = None,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        at: ArrayLike | Frame = (0.0, 0.0, 0.0),
    ) -> None:
        """Draw a body: a solid with a mass or density, or mass, centre of mass and inertia.

        Parameters
        ----------
        name : str
        solid : Solid, optional
            `bar`, `block`, `ball` or a sum of them, in axes of the body.
        mass, density : float, kg, kg/m^3
        com : array_like, shape (3,), m
            Centre of mass in axes of the body, without a solid.
        inertia : array_like, kg m^2
            About the centre of mass in axes of the body, without a solid: three principal moments, six entries xx, yy,
            zz, xy, xz, yz of the tensor (xy = -sum m x y), or the tensor.
        at : array_like, shape (3,), m, or Frame
            Origin of the body in the drawing, or its pose (`frame` makes one of a quaternion or a matrix); default: the
            origin and axes of the world, so that coordinates of the body are those of the drawing.

        Raises
        ------
        InvalidInput
            The mass properties are incomplete or given twice. Values are checked when the drawing is read.
        """
        where = f"body '{name}'"
        pose = at if isinstance(at, Frame) else frame(at)
        if solid is not None:
            if inertia is not None:
                raise InvalidInput(f"{where}: inertia", "the solid has it", "Give a solid or an inertia.")
            mass, com, inertia = solid.mass_properties(mass, density)
        elif mass is None or inertia is None:
            lacking = "mass" if mass is None else "inertia"
            raise InvalidInput(
                f"{where}: {lacking}", "it is missing", "Give a solid with mass or density, or mass and inertia."
            )
        table = {"name": name, "mass": mass, "com": _plain(com), "at": pose.p.tolist(), **_orientation(pose.R)}
        self._add("body", {**table, "inertia": _inertia(inertia, f"{where}: inertia")})

    def joint(
        self, name: str, kind: str, predecessor: str, successor: str, at: ArrayLike | None = None, **fields: Any
    ) -> None:
        """Draw a joint.

        Parameters
        ----------
        name, kind : str
            Kinds: `consilience.mechanism.JOINT_KINDS`.
        predecessor, successor : str
            Names of bodies, or ``ground``.
        at : array_like, shape (3,), m
            Origin of the joint's frames in the drawing.
        **fields
            ``axis``, ``second_axis``, ``to``, ``pitch`` as in a case file; or, in place of all that is drawn, ``F`` and
            ``M``, frames on the predecessor and on the successor in axes of these bodies.

        Raises
        ------
        InvalidInput
            There is no such kind of joint.
        """
        if kind not in JOINT_KINDS:
            known = ", ".join(JOINT_KINDS)
            raise InvalidInput(f"joint '{name}': kind", f"'{kind}' is not a joint kind", f"Use one of {known}.")
        table = {"name": name, "kind": kind, "predecessor": predecessor, "successor": successor}
        self._add("joint", {**table, **({} if at is None else {"at": _plain(at)}), **_plain_fields(fields)})

    def add(self, element: str, name: str, **fields: Any) -> None:
        """Draw an element: a spring, drive, load, ... with the fields of that table of a case file.

        A function of time is its table, or a `Function` (`consilience.constant`, `linear`, `sine`, `through`).

        Raises
        ------
        InvalidInput
            There is no such element.
        """
        if element not in _ELEMENTS:
            known = ", ".join(_ELEMENTS)
            raise InvalidInput(f"element '{name}'", f"'{element}' is no kind of element", f"Use one of {known}.")
        self._add(element, {"name": name, **_plain_fields(fields)})

    def mechanism(self) -> Mechanism:
        """Return the mechanism.

        Raises
        ------
        InvalidInput
            With part, field, what is wrong and what would be right.
        """
        return self.case().mechanism

    def case(
        self, start: Mapping[str, Any] | None = None, rates: Mapping[str, Any] | None = None, **trajectory: float
    ) -> Case:
        """Return a case: the mechanism, where it starts, and the span of its motion.

        Parameters
        ----------
        start, rates : mapping of joint name to value
            Held joint coordinates and rates at the start: the value for a joint of one coordinate, else a mapping by
            the names of the coordinates. An ``orientation`` is a quaternion, a matrix, or a table of a case file; its
            rate is ``angular_velocity``, in axes of F. All others are assembled from the drawing, at rest.
        **trajectory
            ``duration`` and ``sample`` (s), ``digits``, as in a case file.

        Raises
        ------
        InvalidInput
            With part, field, what is wrong and what would be right.
        """
        held = {"joints": self._held(start or {}, "orientation"), "rates": self._held(rates or {}, "angular_velocity")}
        tables = {**self._tables, "initial": held, "trajectory": _plain_fields(trajectory)}
        (case,) = cases_from_tables(self.name, self.name, tables)
        return replace(case, file_digest="")

    def __repr__(self) -> str:
        bodies, joints, *elements = (len(self._tables.get(name, ())) for name in ("body", "joint", *_ELEMENTS))
        return f"Drawing '{self.name}': {bodies} bodies, {joints} joints, {sum(elements)} elements"

    def _repr_html_(self) -> str | None:
        try:
            return self.mechanism()._repr_html_()
        except InvalidInput:  # it is not complete yet
            return None

    def _add(self, kind: str, table: dict[str, Any]) -> None:
        self._tables.setdefault(kind, []).append(table)

    def _held(self, values: Mapping[str, Any], of_orientation: str) -> dict[str, dict[str, Any]]:
        """Return held values by joint and coordinate; a bare value belongs to the joint's only coordinate."""
        kinds = {joint["name"]: joint["kind"] for joint in self._tables.get("joint", ())}
        held: dict[str, dict[str, Any]] = {}
        for joint, value in values.items():
            if joint not in kinds:
                raise InvalidInput(f"joint '{joint}'", "it is not drawn", f"Joints are: {', '.join(kinds)}.")
            names = JOINT_KINDS[kinds[joint]].coordinates
            if not isinstance(value, Mapping) and len(names) != 1:
                known = ", ".join(names) or "none"
                raise InvalidInput(
                    f"joint '{joint}'", f"a {kinds[joint]} joint has {len(names)} coordinates", f"Name them: {known}."
                )
            only = of_orientation if names == ("orientation",) else names[0] if names else ""
            held[joint] = _plain_fields(value if isinstance(value, Mapping) else {only: value})
        return held


def _plain(value: Any) -> Any:
    """Return arrays and NumPy numbers as lists and numbers of Python, functions and frames as tables."""
    if isinstance(value, Function):
        return function_table(value)
    if isinstance(value, Frame):
        return {"at": value.p.tolist(), "orientation": {"rows": value.R.tolist()}}
    return np.asarray(value).tolist() if isinstance(value, np.ndarray | np.generic | list | tuple) else value


def _plain_fields(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields as a file has them: without arrays, an orientation as a table."""
    found = {name: _plain_fields(v) if isinstance(v, Mapping) else _plain(v) for name, v in fields.items()}
    given = found.get("orientation")
    way = {(4,): "quaternion", (3, 3): "rows"}.get(np.asarray(given, dtype=object).shape)
    return found | {"orientation": {way: given}} if way else found


def _orientation(R: Array) -> dict[str, Any]:
    """Return the field `orientation` of a table; none for the axes of the world."""
    return {} if np.array_equal(R, np.eye(3)) else {"orientation": {"quaternion": quaternion_from_rotation(R).tolist()}}


def _inertia(given: ArrayLike, where: str) -> dict[str, float]:
    """Return the table `inertia` of three moments, six entries or the tensor."""
    tensor = inertia_tensor(given, where)
    check_inertia(tensor, where)
    return {name: float(tensor[at]) for name, at in _INERTIA.items()}
