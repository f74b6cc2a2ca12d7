"""Tables of bodies, joints and known values of families, with the fields of `consilience.case.file.schema`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from consilience.case.file.values import TomlTable
from consilience.mechanism import Array, elementary_rotation, quaternion_from_rotation, rotation_from_quaternion

GRAVITY = 9.81
GRAVITY_W = np.array([0.0, 0.0, -GRAVITY])


def numbers(values: ArrayLike) -> list[float]:
    """Return a list of numbers."""
    return np.asarray(values, dtype=float).tolist()


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


def body(name: str, mass: float, at: ArrayLike, R: Array, com: ArrayLike, inertia: ArrayLike) -> TomlTable:
    """Return the table of a body.

    Parameters
    ----------
    name : str
    mass : float, kg
    at : array_like, shape (3,), m
        Origin in the world.
    R : ndarray, shape (3, 3)
        Axes of the body as columns, in the world.
    com : array_like, shape (3,), m
        Centre of mass in body axes, from the origin.
    inertia : array_like, shape (6,) or (3, 3), kg m^2
        About the centre of mass, body axes: xx, yy, zz, xy, xz, yz, or the tensor.
    """
    entries = np.asarray(inertia, dtype=float)
    if entries.ndim == 2:
        entries = entries[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    return {
        "name": name,
        "mass": float(mass),
        "at": numbers(at),
        "orientation": {"quaternion": numbers(quaternion_from_rotation(R))},
        "com": numbers(com),
        "inertia": dict(zip(("xx", "yy", "zz", "xy", "xz", "yz"), numbers(entries), strict=True)),
    }


def lumps(rng: np.random.Generator, mass: float, size: float) -> tuple[Array, Array]:
    """Return centre of mass (3,) and inertia (3, 3) about it of twelve equal random lumps in a cloud of a size in m."""
    points = rng.normal(scale=0.4 * size, size=(12, 3)) * np.array([1.0, 0.7, 1.3])
    com = points.mean(axis=0)
    arms = points - com
    squares = np.sum(arms * arms, axis=1)
    tensor = mass / 12 * (np.eye(3) * squares.sum() - arms.T @ arms)
    return com, (tensor + tensor.T) / 2


def joint(
    name: str, kind: str, predecessor: str, successor: str, at: ArrayLike, axis: ArrayLike, **more: Any
) -> TomlTable:
    """Return the table of a joint.

    Parameters
    ----------
    name, kind, predecessor, successor : str
    at : array_like, shape (3,), m
        Origin of F and M, in the world.
    axis : array_like, shape (3,)
        Along z of F and M, in the world.
    **more
        Further fields.
    """
    table = {"name": name, "kind": kind, "predecessor": predecessor, "successor": successor, "at": numbers(at)}
    return table | {"axis": numbers(axis)} | more


def known(
    of: tuple[str, str], observable: str, time: float, value: ArrayLike, uncertainty: float, source: str
) -> TomlTable:
    """Return the table of a value in closed form.

    Parameters
    ----------
    of : (str, str)
        ("body", name) or ("joint", name).
    observable : str
    time : float, s
    value : array_like
        SI units; vectors in world axes.
    uncertainty : float
        Of each component.
    source : str
        The formula.
    """
    return {
        of[0]: of[1],
        "observable": observable,
        "time": float(time),
        "value": numbers(value),
        "uncertainty": float(uncertainty),
        "origin": "closed form",
        "source": source,
    }


def round_step(longest: float) -> float:
    """Return the largest of 0.05, 0.02, 0.01, 0.005, ... s that is not above `longest`, in s."""
    exponent = np.floor(np.log10(min(longest, 0.05)))
    steps = [float(f"{d}e{exponent:.0f}") for d in (1, 2, 5)]
    return max(step for step in steps if step <= min(longest, 0.05) * (1 + 1e-12))


def case_table(
    title: str,
    remarks: str,
    sources: Sequence[str],
    tags: Sequence[str],
    mechanism: TomlTable,
    initial: TomlTable,
    span: tuple[float, float],
    published: Sequence[TomlTable] = (),
) -> TomlTable:
    """Return the tables of a case file.

    Parameters
    ----------
    title, remarks : str
    sources, tags : sequence of str
    mechanism : dict
        Gravity (m/s^2, world axes), and lists of tables: body, joint, spring, ...
    initial : dict
        Held coordinates and rates.
    span : (float, float), s
        Duration and sample.
    published : sequence of dict
        Values in closed form, see `known`.
    """
    return {
        "title": title,
        "sources": list(sources),
        "remarks": remarks.strip(),
        "tags": ["family", *tags],
        **mechanism,
        "initial": initial,
        "trajectory": {"duration": span[0], "sample": span[1], "digits": 8},
        "instant": {"states": 10, "seed": 1},
        **({"published": list(published)} if published else {}),
    }
