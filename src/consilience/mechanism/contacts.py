"""Contacts: pairs of shapes that may hit one another, with restitution and friction. Immutable data.

A sphere or a corner on a plane, or two spheres. The normal points from `partner` to `body`, so that the gap opens along
the normal. Between impacts contacts exert no force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism.spatial import Array


def _vector(where: str, value: Array) -> Array:
    a = np.array(value, dtype=float)
    if a.shape != (3,) or not np.all(np.isfinite(a)):
        raise InvalidInput(where, "it is not three finite numbers", "Give a vector of shape (3,).")
    a.setflags(write=False)
    return a


def _unit(where: str, value: Array) -> Array:
    a = _vector(where, value)
    length = float(np.linalg.norm(a))
    if length == 0.0:
        raise InvalidInput(where, "it is the zero vector", "Give the direction out of the solid half-space.")
    return _vector(where, a / length)


_MADE = {"center": _vector, "corner": _vector, "point": _vector, "partner_center": _vector, "normal": _unit}
"""Fields of contacts that are vectors, with the function that checks and freezes them."""


def _check(contact: Contact) -> None:
    """Refuse values out of range, and freeze the vectors."""
    where, restitution, friction = f"contact '{contact.name}'", contact.restitution, contact.friction
    if contact.body == contact.partner:
        raise InvalidInput(where, f"both sides are '{contact.body}'", "Let two different bodies touch.")
    if not 0.0 <= restitution <= 1.0:
        raise InvalidInput(f"{where}: restitution", f"{restitution} is out of range", "Choose 0 to 1.")
    if not 0.0 <= friction < np.inf:
        raise InvalidInput(f"{where}: friction", f"{friction} is out of range", "Give a coefficient of at least 0.")
    if not all(0.0 < value < np.inf for name, value in vars(contact).items() if name.endswith("radius")):
        raise InvalidInput(f"{where}: radius", "it is not positive", "Give a radius above zero.")
    for name, make in _MADE.items():
        if name in vars(contact):
            object.__setattr__(contact, name, make(f"{where}: {name}", getattr(contact, name)))


@dataclass(frozen=True, eq=False)
class SpherePlane:
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
    restitution : float
        Newton's coefficient s of ``vn+ = -s vn-``, 0 to 1.
    friction : float
        Coulomb's coefficient mu during an impact.
    """

    name: str
    body: str
    center: Array
    radius: float
    partner: str
    point: Array
    normal: Array
    restitution: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True, eq=False)
class PointPlane:
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
    restitution: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        _check(self)

    @property
    def center(self) -> Array:
        """The corner: a sphere of radius zero."""
        return self.corner

    @property
    def radius(self) -> float:
        """Zero."""
        return 0.0


@dataclass(frozen=True, eq=False)
class SphereSphere:
    """Two spheres, each outside the other; attributes as `SpherePlane`."""

    name: str
    body: str
    center: Array
    radius: float
    partner: str
    partner_center: Array
    partner_radius: float
    restitution: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        _check(self)


Contact = SpherePlane | PointPlane | SphereSphere
