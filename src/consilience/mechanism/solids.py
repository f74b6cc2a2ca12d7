"""Solids of uniform density: volume, centre of mass and inertia, for bodies that are given by their shape.

Moments of inertia of blocks, cylinders and balls: Goldstein, Poole and Safko, Classical Mechanics, 3rd ed., chapter 5;
solids are added by the parallel-axis theorem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import InvalidInput
from consilience.mechanism.spatial import Array, fixed_array, rotation_with_z_axis


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid of density one, in axes of the body.

    Attributes
    ----------
    volume : float, m^3
    com : ndarray, shape (3,), m
        Centre of mass from the origin of the body.
    second_moment : ndarray, shape (3, 3), m^5
        Inertia tensor about the centre of mass at density one.
    """

    volume: float
    com: Array
    second_moment: Array

    def __repr__(self) -> str:
        return f"Solid: {self.volume:g} m^3, centre of mass {self.com.tolist()} m"

    def __add__(self, other: Solid) -> Solid:
        """Return both solids as one, of one density."""
        volume = self.volume + other.volume
        com = (self.volume * self.com + other.volume * other.com) / volume
        moved = [
            s.second_moment + s.volume * ((d := s.com - com) @ d * np.eye(3) - np.outer(d, d)) for s in (self, other)
        ]
        return Solid(volume, com, moved[0] + moved[1])

    def mass_properties(self, mass: float | None = None, density: float | None = None) -> tuple[float, Array, Array]:
        """Return mass (kg), centre of mass (m) and inertia tensor about that centre (kg m^2), of mass or density.

        Raises
        ------
        InvalidInput
            Neither mass nor density is given, or both are, or the value is not positive.
        """
        if (mass is None) == (density is None):
            what = "neither mass nor density is given" if mass is None else "mass and density are both given"
            raise InvalidInput("solid", what, "Give one of them: mass in kg, or density in kg/m^3.")
        factor = density if density is not None else (mass or 0.0) / self.volume
        if not (np.isfinite(factor) and factor > 0.0):
            name, value = ("mass", mass) if density is None else ("density", density)
            raise InvalidInput(f"solid: {name}", f"{value} is not positive", "Give a number above zero.")
        return factor * self.volume, self.com, factor * self.second_moment


def block(lengths: ArrayLike, at: ArrayLike = (0.0, 0.0, 0.0)) -> Solid:
    """Return a block with edges along the axes of the body.

    Parameters
    ----------
    lengths : array_like, shape (3,), m
        Edges along x, y and z.
    at : array_like, shape (3,), m
        Centre.
    """
    x, y, z = _positive("block: lengths", lengths, (3,))
    volume = x * y * z
    moments = volume / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    return Solid(volume, fixed_array(at, (3,), "block: at"), np.diag(moments))


def ball(radius: float, at: ArrayLike = (0.0, 0.0, 0.0)) -> Solid:
    """Return a ball of a radius in m about a centre in m."""
    (r,) = _positive("ball: radius", [radius], (1,))
    volume = 4.0 / 3.0 * np.pi * r**3
    return Solid(volume, fixed_array(at, (3,), "ball: at"), 0.4 * volume * r * r * np.eye(3))


def bar(start: ArrayLike, end: ArrayLike, radius: float) -> Solid:
    """Return a round bar, a cylinder with its axis between two points.

    Parameters
    ----------
    start, end : array_like, shape (3,), m
    radius : float, m
    """
    a, b = fixed_array(start, (3,), "bar: start"), fixed_array(end, (3,), "bar: end")
    length = float(np.linalg.norm(b - a))
    if not length > 0.0:
        raise InvalidInput("bar: end", "the ends coincide", "Give two points apart.")
    (r,) = _positive("bar: radius", [radius], (1,))
    volume = np.pi * r * r * length
    across = r * r / 4.0 + length * length / 12.0
    R = rotation_with_z_axis(b - a)
    return Solid(volume, (a + b) / 2.0, volume * R @ np.diag([across, across, r * r / 2.0]) @ R.T)


def _positive(where: str, given: ArrayLike | Sequence[float], shape: tuple[int, ...]) -> list[float]:
    values = fixed_array(given, shape, where)
    if not np.all(values > 0.0):
        raise InvalidInput(where, f"{values.tolist()} m is not positive", "Give lengths above zero, in m.")
    return values.tolist()
