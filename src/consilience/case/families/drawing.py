"""Geometry of families: gravity, a skew plane, random orientations, lumpy bodies; round sampling intervals."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from consilience.case.families.tables import joint
from consilience.case.file.values import TomlTable
from consilience.mechanism import Array, elementary_rotation, rotation_from_quaternion

GRAVITY = 9.81
GRAVITY_W = np.array([0.0, 0.0, -GRAVITY])


class SkewPlane:
    """A skew plane of planar mechanisms: x down the slope, y horizontal, z along the normal (-1, 2, 2) / 3.

    Parameters
    ----------
    level : bool
        Gravity is opposite to the normal, in place of along minus z of the world.

    Attributes
    ----------
    R : ndarray, shape (3, 3)
        Axes of the plane as columns, world components.
    gravity : ndarray, shape (3,), m/s^2
    slope : float, m/s^2
        Gravity along x; none along y.
    """

    origin = np.array([0.2, -0.1, 0.3])

    def __init__(self, level: bool = False) -> None:
        normal = np.array([-1.0, 2.0, 2.0]) / 3.0
        down = np.array([-2.0, 4.0, -5.0]) / np.sqrt(45.0)
        self.R = np.column_stack([down, np.cross(normal, down), normal])
        self.gravity = -GRAVITY * normal if level else GRAVITY_W
        self.slope = 0.0 if level else float(down @ self.gravity)

    def point(self, x: float, y: float, z: float = 0.0) -> Array:
        """Return the point of the world with coordinates in the plane, m."""
        return self.origin + self.R @ np.array([x, y, z])

    def along(self, angle: float, length: float) -> Array:
        """Return the vector in world axes at an angle in the plane, from x towards y."""
        return self.R @ np.array([length * np.cos(angle), length * np.sin(angle), 0.0])

    def turned(self, angle: float) -> Array:
        """Return axes (3, 3) with x at an angle from x of the plane, z along the normal."""
        return self.R @ elementary_rotation(2, angle)

    def joint(
        self, name: str, predecessor: str, successor: str, at: ArrayLike, kind: str = "revolute", angle: float = 0.0
    ) -> TomlTable:
        """Return a revolute joint across the plane, or a prismatic joint along a direction in the plane.

        Parameters
        ----------
        name, predecessor, successor : str
        at : array_like, shape (3,), m
            Origin of F and M, in the world.
        kind : {"revolute", "prismatic"}
        angle : float, rad
            Direction of a prismatic joint, from x of the plane.
        """
        axis = self.along(angle, 1.0) if kind == "prismatic" else self.R[:, 2]
        return joint(name, kind, predecessor, successor, at, axis)


def random_rotation(rng: np.random.Generator) -> Array:
    """Return a random rotation matrix, all orientations equally likely."""
    quat = rng.normal(size=4)
    return rotation_from_quaternion(quat / np.linalg.norm(quat))


def lumps(rng: np.random.Generator, mass: float, size: float | Array) -> tuple[Array, Array]:
    """Return centre of mass (3,) and inertia (3, 3) about it of twelve equal random lumps in a cloud.

    The size is that of the cloud in m, or its sizes along the axes, shape (3,).
    """
    points = 0.4 * size * rng.normal(size=(12, 3)) * np.array([1.0, 0.7, 1.3])
    com = points.mean(axis=0)
    arms = points - com
    squares = np.sum(arms * arms, axis=1)
    tensor = mass / 12 * (np.eye(3) * squares.sum() - arms.T @ arms)
    return com, (tensor + tensor.T) / 2


def round_step(longest: float) -> float:
    """Return the largest of 0.05, 0.02, 0.01, 0.005, ... s that is not above `longest`, in s."""
    exponent = np.floor(np.log10(min(longest, 0.05)))
    steps = [float(f"{d}e{exponent:.0f}") for d in (1, 2, 5)]
    return max(step for step in steps if step <= min(longest, 0.05) * (1 + 1e-12))
