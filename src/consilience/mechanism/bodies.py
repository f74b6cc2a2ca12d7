"""Rigid bodies and frames fixed to them. Immutable data."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import InvalidInput, require
from consilience.mechanism.spatial import Array, cross, fixed_array

_ONE = np.eye(3)


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame fixed to a body: joint coordinate system, or marker.

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
        object.__setattr__(self, "p", fixed_array(self.p, (3,), "frame: p"))
        hint = " Of a quaternion: consilience.frame(p, quaternion)."
        object.__setattr__(self, "R", fixed_array(self.R, (3, 3), "frame: R", hint))
        x, y, z = self.R.T
        if np.max(np.abs(self.R.T @ self.R - _ONE)) > 1e-9 or cross(x, y) @ z < 0:
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
        Inertia tensor about the centre of mass in body axes (``I_BBcm_B``): ``I[0, 1] = -sum m x y``. Three principal
        moments or six entries of it may be given (`inertia_tensor`).
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
        object.__setattr__(self, "com", fixed_array(self.com, (3,), f"{where}: com"))
        object.__setattr__(self, "inertia", inertia_tensor(self.inertia, f"{where}: inertia"))
        require(self.drawing, Frame, f"{where}: drawing", "Give Frame(p, R), the pose in the drawing.")
        require(self.mass, Real, f"{where}: mass", "Give a number, in kg.")
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise InvalidInput(f"{where}: mass", f"{self.mass} kg is not positive", "Give a mass above zero.")
        check_inertia(self.inertia, f"{where}: inertia")

    def __repr__(self) -> str:
        return f"Body '{self.name}': {self.mass:g} kg, centre of mass {self.com.tolist()} m"


ROUNDING_OF_MOMENTS = 1e-14
"""Least principal moment over the largest: one below it may be rounding of the tensor, of either sign."""


def inertia_tensor(given: ArrayLike, where: str = "inertia") -> Array:
    """Return an inertia tensor, read-only, shape (3, 3), kg m^2.

    Parameters
    ----------
    given : array_like, shape (3,), (6,) or (3, 3), kg m^2
        Moments about the axes, or the entries xx, yy, zz, xy, xz, yz of the tensor, or the tensor.
    where : str
        Body and field, for the message.

    Raises
    ------
    InvalidInput
        It has another shape, or holds what is no finite number.
    """
    shape = np.asarray(given, dtype=object).shape
    if shape == (3,):
        given = np.diag(fixed_array(given, (3,), where))
    elif shape == (6,):
        xx, yy, zz, xy, xz, yz = fixed_array(given, (6,), where)
        given = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    hint = " Three moments or the six entries xx, yy, zz, xy, xz, yz will do."
    return fixed_array(given, (3, 3), where, hint)


def check_inertia(inertia: Array, where: str) -> None:
    """Refuse an inertia tensor that no rigid body can have.

    Raises
    ------
    InvalidInput
        If the tensor is not symmetric, not positive definite, or violates the triangle inequality of its principal
        moments.
    """
    if np.max(np.abs(inertia - inertia.T)) > 1e-12 * np.max(np.abs(inertia)):
        raise InvalidInput(where, "the tensor is not symmetric", "Give a symmetric 3 x 3 tensor.")
    principal = np.linalg.eigvalsh(inertia)
    text = ", ".join(f"{m:.6g}" for m in principal)
    if principal[0] <= ROUNDING_OF_MOMENTS * principal[2]:
        raise InvalidInput(
            where,
            f"principal moments {text} kg m^2 are not all positive beyond rounding",
            "Give a three-dimensional body: a rod has a thickness, and all principal moments are above zero.",
        )
    if principal[0] + principal[1] < principal[2] * (1 - 1e-12):
        raise InvalidInput(
            where,
            f"principal moments {text} kg m^2 violate the triangle inequality: no mass distribution has them",
            "The sum of any two principal moments must be at least the third; "
            "check the signs of the products of inertia (Ixy = -sum m x y).",
        )
