"""Contacts: pairs of shapes that touch, slide, stick, roll and bounce, with the laws of each pair. Immutable data.

The normal n points from `partner` to `body`, the gap opens along it. A shape other than a sphere or a point is a
composite of them (`contact_parts`); the rim of a disc has its own nearest point. docs/contact.md has the equations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from itertools import product
from typing import Any

import numpy as np

from consilience.errors import InvalidInput, in_range
from consilience.mechanism.contact_laws import SurfaceLaw
from consilience.mechanism.spatial import Array, fixed_array


@dataclass(frozen=True, eq=False, kw_only=True)
class _Pair(SurfaceLaw):
    """What all contacts share: the checks, and the names of the features."""

    def __post_init__(self) -> None:
        pair: Any = self
        where = f"contact '{pair.name}'"
        if pair.body == pair.partner:
            raise InvalidInput(where, f"both sides are '{pair.body}'", "Let two different bodies touch.")
        for name in _VECTORS & vars(self).keys():
            object.__setattr__(self, name, fixed_array(vars(self)[name], (3,), f"{where}: {name}"))
        for name in _DIRECTIONS & vars(self).keys():
            object.__setattr__(self, name, _unit(f"{where}: {name}", vars(self)[name]))
        for name in _RADII & vars(self).keys():
            in_range(f"{where}: {name}", vars(self)[name], *_SIZES, "Give a radius above zero, 1e-100 to 1e100 m.")
        self.check_law(where)
        if "normal" in vars(self) and self.cone.tangent is not None:
            try:
                self.cone.tangents(pair.normal)
            except InvalidInput as error:
                raise InvalidInput(f"{where}: {error.where}", error.what, error.remedy) from None

    @property
    def features(self) -> Iterator[str]:
        """Features that an engine must represent for this contact, in the names of `Mechanism.features`."""
        pair: Any = self
        yield f"{_SHAPES[type(self).__name__]} contact"
        for has, feature in (
            (self.restitution > 0.0, "contact restitution"),
            (self.restitution > 0.0 and self.rebound_threshold > 0.0, "rebound threshold"),
            (self.friction > 0.0, "contact friction"),
            (self.static_friction not in (None, self.friction), "static friction"),
            (self.cone.kind != "circle", f"{self.cone.kind} cone"),
            (self.associated, "associated cone"),
            (self.impact_law != "newton", f"{self.impact_law.capitalize()} impact"),
            (self.torsional > 0.0, "torsional friction"),
            (self.rolling > 0.0, "rolling friction"),
            (self.compliance is not None, "compliant contact"),
            ("normal" in vars(self) and pair.partner != "ground", "moving plane contact"),
        ):
            if has:
                yield feature


_VECTORS = frozenset(("center", "corner", "point", "partner_center", "start", "end", "half_sizes"))
_DIRECTIONS = frozenset(("normal", "axis"))
_RADII = frozenset(("radius", "partner_radius"))
_SIZES = 1e-100, 1e100
"""Least and largest size of a shape, m: squares of what is beyond are no numbers."""


def _unit(where: str, value: Array) -> Array:
    direction = fixed_array(value, (3,), where)
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        remedy = "Give the direction out of the solid half-space." if where.endswith("normal") else "Give a direction."
        raise InvalidInput(where, "it is the zero vector", remedy)
    return fixed_array(direction / length, (3,), where)


@dataclass(frozen=True, eq=False)
class SpherePlane(_Pair):
    """A sphere of one body and a solid half-space of another.

    Attributes
    ----------
    name : str
    body, partner : str
        Bodies that carry the sphere and the plane; either may be ``ground``.
    center : ndarray, shape (3,), m
        From the origin of `body`, in its axes.
    radius : float, m
    point : ndarray, shape (3,), m
        A point of the plane, from the origin of `partner`, in its axes.
    normal : ndarray, shape (3,)
        Out of the half-space, in axes of `partner`; made a unit vector.
    """

    name: str
    body: str
    center: Array
    radius: float
    partner: str
    point: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class PointPlane(_Pair):
    """A corner, tip or other point of one body and a solid half-space of another; attributes as `SpherePlane`.

    Attributes
    ----------
    corner : ndarray, shape (3,), m
        From the origin of `body`, in its axes.
    """

    name: str
    body: str
    corner: Array
    partner: str
    point: Array
    normal: Array

    @property
    def center(self) -> Array:
        """The corner: a sphere of radius zero."""
        return self.corner

    @property
    def radius(self) -> float:
        """Zero."""
        return 0.0


@dataclass(frozen=True, eq=False)
class SphereSphere(_Pair):
    """Two spheres, each outside the other; attributes as `SpherePlane`."""

    name: str
    body: str
    center: Array
    radius: float
    partner: str
    partner_center: Array
    partner_radius: float


@dataclass(frozen=True, eq=False)
class DiscPlane(_Pair):
    """The sharp rim of a circle on a solid half-space; attributes as `SpherePlane`.

    Attributes
    ----------
    center : ndarray, shape (3,), m
        Of the circle.
    axis : ndarray, shape (3,)
        Normal of the circle in axes of `body`; made a unit vector.
    radius : float, m
        Of the circle.
    """

    name: str
    body: str
    center: Array
    axis: Array
    radius: float
    partner: str
    point: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class BoxPlane(_Pair):
    """The eight corners of a box on a solid half-space; attributes as `SpherePlane`.

    Attributes
    ----------
    center : ndarray, shape (3,), m
        Of the box.
    half_sizes : ndarray, shape (3,), m
        Half of its edges, along its axes.
    orientation : ndarray, shape (3, 3)
        Rotation matrix, axes of the box to axes of `body`; default: those of the body.
    """

    name: str
    body: str
    center: Array
    half_sizes: Array
    partner: str
    point: Array
    normal: Array
    orientation: Array = field(default_factory=lambda: np.eye(3), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        where = f"contact '{self.name}'"
        for size in self.half_sizes.tolist():
            in_range(f"{where}: half_sizes", size, *_SIZES, "Give half of each edge, above zero, 1e-100 to 1e100 m.")
        R = fixed_array(self.orientation, (3, 3), f"{where}: orientation")
        if np.max(np.abs(R.T @ R - np.eye(3))) > 1e-9 or np.linalg.det(R) < 0.0:
            what = "the matrix is not a rotation"
            raise InvalidInput(f"{where}: orientation", what, "Give an orthogonal matrix of determinant +1.")
        object.__setattr__(self, "orientation", R)


@dataclass(frozen=True, eq=False)
class CapsulePlane(_Pair):
    """The two end spheres of a capsule on a solid half-space; attributes as `SpherePlane`.

    Attributes
    ----------
    start, end : ndarray, shape (3,), m
        Centres of the end spheres, from the origin of `body`, in its axes.
    radius : float, m
    """

    name: str
    body: str
    start: Array
    end: Array
    radius: float
    partner: str
    point: Array
    normal: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.array_equal(self.start, self.end):
            remedy = "Draw them apart, or give a sphere."
            raise InvalidInput(f"contact '{self.name}'", "the ends of the capsule coincide", remedy)


ElementaryContact = SpherePlane | PointPlane | SphereSphere | DiscPlane
"""Contacts with one nearest point."""

Contact = ElementaryContact | BoxPlane | CapsulePlane

_SHAPES = {
    "SpherePlane": "sphere on plane",
    "PointPlane": "point on plane",
    "SphereSphere": "sphere on sphere",
    "DiscPlane": "disc on plane",
    "BoxPlane": "box on plane",
    "CapsulePlane": "capsule on plane",
}
"""Shapes of each class of contacts in words."""


def shapes_in_words(contact: Contact) -> str:
    """Return the shapes of a contact in words, such as ``sphere on plane``."""
    return _SHAPES[type(contact).__name__]


def contact_parts(contact: Contact) -> tuple[ElementaryContact, ...]:
    """Return the contacts with one nearest point of which a contact is made, ``box[0]``, ``box[1]``, ...

    Corners of a box are in the order of the signs (-, -, -), (-, -, +), ... (+, +, +) of their coordinates in the box;
    ends of a capsule as `start`, `end`. A contact with one nearest point is its own part.
    """
    if not isinstance(contact, BoxPlane | CapsulePlane):
        return (contact,)
    law = {one.name: getattr(contact, one.name) for one in fields(SurfaceLaw)}
    plane = (contact.partner, contact.point, contact.normal)
    if isinstance(contact, CapsulePlane):
        ends = enumerate((contact.start, contact.end))
        return tuple(
            SpherePlane(f"{contact.name}[{n}]", contact.body, end, contact.radius, *plane, **law) for n, end in ends
        )
    corners = [
        contact.center + contact.orientation @ (np.array(signs) * contact.half_sizes)
        for signs in product((-1.0, 1.0), repeat=3)
    ]
    return tuple(PointPlane(f"{contact.name}[{n}]", contact.body, c, *plane, **law) for n, c in enumerate(corners))
