"""Spheres that press, kept in touch where a step lifts them although their contact is closed.

DART's rows hold velocities of points along normals, both of the start of a step, and a gap is no contact. So the corner
of a turning body, and a sphere that rolls on another, leave what they press by the square of the step: the contact does
not act in the next step, and acts again when it has fallen. Where that happens is by chance, so that steps have no
limit of an order above one. A sphere that presses is larger by its gap, until it does not press.
"""

from __future__ import annotations

from math import hypot
from typing import Any

from consilience.mechanism import Array


class Pressing:
    """A sphere and what it may touch.

    Attributes
    ----------
    name, other_name : str
        Of their shape nodes.

    Parameters
    ----------
    node, other : dartpy ShapeNode
        Of the sphere, and of the plane or sphere that it may touch.
    at_rest : bool
        `other` does not move.
    inside : float, m
        Part of the sphere's radius by which it overlaps at a gap of zero.
    normal : ndarray, shape (3,), or None
        Of the plane, in axes of `other`; None for a sphere.
    offset : float, m
        Of the plane along the normal, or radius of the other sphere.
    """

    def __init__(
        self, node: Any, other: Any, at_rest: bool, inside: float, normal: Array | None, offset: float
    ) -> None:
        self._node, self._other, self._shape = node, other, node.getShape()
        self.name, self.other_name = node.getName(), other.getName()
        self._to_other = other.getWorldTransform().inverse() if at_rest else None
        self._radius = self._size = float(self._shape.getRadius())
        self._less = offset - inside
        self._normal = None if normal is None else normal.tolist()

    def keep(self) -> None:
        """Make the sphere as large as touching takes at the present poses, and no smaller than it is."""
        to_other = self._to_other or self._other.getWorldTransform().inverse()
        x, y, z = to_other.multiply(self._node.getWorldTransform().translation()).tolist()
        if self._normal is None:
            apart = hypot(x, y, z)
        else:
            nx, ny, nz = self._normal
            apart = nx * x + ny * y + nz * z
        self._resize(max(self._radius, apart - self._less))

    def release(self) -> None:
        """Give the sphere its own radius."""
        self._resize(self._radius)

    def _resize(self, size: float) -> None:
        if size != self._size:
            self._size = size
            self._shape.setRadius(size)
