"""Orientation coordinates of a body, each kind one row of `ORIENTATIONS`.

Every row gives the rotation matrix ``R_WB(x)`` and the matrix H of ``w = H x'``, ``dw/dt = H x'' + h(x, x')``
[C4 (4.55)-(4.56)], with w = w_WB_W: the angular velocity of the body in the world, in world components, rad/s. Arrays
are of shape (n,) for coordinates and their rates, with n = 4 for Euler parameters and n = 3 for the others. Angles and
rotation vectors are in rad, Euler and Rodrigues parameters are pure numbers. Equation keys refer to
`docs/formulations.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import atan, atan2, ceil, cos, factorial, hypot, pi, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import ConsilienceError
from consilience.mechanism import (
    Array,
    cross,
    elementary_rotation,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    rotation_from_bryant_xyz,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
    skew,
)

NEAR_SINGULAR = 1e-6
"""Smallest accepted distance to a singularity; rates lose six of sixteen digits there.

As an angle: 1e-6 rad for theta and beta, 2e-6 rad from a half turn for Rodrigues parameters, 6.3e-6 rad from a full
turn for the rotation vector.
"""


_OfRates = Callable[[Array, Array], Array]
"""Function of the coordinates and their rates, or of the coordinates and the angular velocity."""


class SingularOrientation(ConsilienceError):
    """The orientation of a body is singular in its coordinates.

    Parameters
    ----------
    body : str
        Name of the body.
    coordinates : str
        Orientation coordinates, for example ``Euler angles z-x-z``.
    angle : str
        Singular angle, for example ``theta``.
    value, singular_value : float
        Angle of the body, and the nearest singular angle, rad.
    """

    def __init__(self, body: str, coordinates: str, angle: str, value: float, singular_value: float) -> None:
        super().__init__(
            f"{body}: {coordinates} are singular at {angle} = {singular_value:.6f} rad, and {angle} = {value:.9f} rad "
            f"is {abs(value - singular_value):.1e} rad away. Euler parameters have no singular orientation."
        )
        self.body = body
        self.coordinates = coordinates
        self.angle = angle
        self.value = value
        self.singular_value = singular_value

    def __reduce__(self) -> tuple[type[SingularOrientation], tuple[str, str, str, float, float]]:
        """Pickle the error with its five arguments."""
        return type(self), (self.body, self.coordinates, self.angle, self.value, self.singular_value)


@dataclass(frozen=True)
class Singularity:
    """Singularities of orientation coordinates: at the angles ``first + k period``, k integer.

    Parameters
    ----------
    angle : str
        Name of the angle.
    value : callable
        Function of x: the angle, rad.
    first, period : float
        Singular angles, rad.
    distance : callable
        Function of x: pure number, at most 1, 0 at the singular angles.
    """

    angle: str
    value: Callable[[Array], float]
    first: float
    period: float
    distance: Callable[[Array], float]


@dataclass(frozen=True)
class OrientationCoordinates:
    """Kind of orientation coordinates.

    Parameters
    ----------
    name : str
        Name in messages.
    size : int
        Number of coordinates n.
    rotation : callable
        ``rotation(x)`` is R_WB, shape (3, 3).
    coordinates : callable
        x from unit Euler parameters quat_WB, shape (4,) to (n,), unchecked; call `from_quaternion`.
    H : callable
        ``H(x)``, shape (3, n), in ``w_WB_W = H x'``.
    h : callable
        ``h(x, x_dot)``, shape (3,), in ``dw/dt = H x'' + h``, rad/s^2, world components.
    solve : callable
        ``x' (x, w)``, unchecked; call `rates`.
    singularity : Singularity, optional
        Singularities; None without singularities.
    """

    name: str
    size: int
    rotation: Callable[[Array], Array]
    coordinates: Callable[[Array], Array]
    H: Callable[[Array], Array]
    h: _OfRates
    solve: _OfRates
    singularity: Singularity | None = None

    def from_rotation(self, R_WB: ArrayLike, body: str = "a body") -> Array:
        """Convert a rotation matrix, shape (3, 3), to coordinates, shape (n,); raises as `from_quaternion`."""
        return self.from_quaternion(quaternion_from_rotation(R_WB), body)

    def from_quaternion(self, quat_WB: ArrayLike, body: str = "a body") -> Array:
        """Convert unit Euler parameters, scalar first, shape (4,), to coordinates, shape (n,).

        Angles are in (-pi, pi], theta in [0, pi], beta in [-pi/2, pi/2], rotation vectors at most pi long.

        Raises
        ------
        SingularOrientation
            If ``distance_to_singularity(x) < NEAR_SINGULAR``; with the name `body`.
        """
        x = self.coordinates(np.asarray(quat_WB, dtype=float))
        self._refuse_singular(x, body)
        return x

    def rates(self, x: Array, w_WB_W: Array, body: str = "a body") -> Array:
        """Return x', shape (n,), 1/s, for the angular velocity w_WB_W, shape (3,), rad/s.

        Raises
        ------
        SingularOrientation
            If ``distance_to_singularity(x) < NEAR_SINGULAR``; with the name `body`.
        """
        self._refuse_singular(x, body)
        return self.solve(x, w_WB_W)

    def distance_to_singularity(self, x: Array) -> float:
        """Return the distance to a singularity, a pure number from 0 (singular) to 1; 1 without singularities."""
        return 1.0 if self.singularity is None else self.singularity.distance(x)

    def _refuse_singular(self, x: Array, body: str) -> None:
        at = self.singularity
        if at is not None and at.distance(x) < NEAR_SINGULAR:
            value = at.value(x)
            nearest = at.first + at.period * round((value - at.first) / at.period)
            raise SingularOrientation(body, self.name, at.angle, value, nearest)


def _parameters_H(p: Array) -> Array:
    """Return ``H = 2 E``, ``E = [-e | e0 1 + ~e]``, the counterpart of G in world axes [MASS (38)]."""
    return 2.0 * np.column_stack([-p[1:], p[0] * np.eye(3) + skew(p[1:])])


def _parameters_h(_p: Array, _p_dot: Array) -> Array:
    """Return zero: ``E' p' = -e' e0' + e0' e' + e' x e' = 0``, as ``G' p' = 0`` [MASS (38)]."""
    return np.zeros(3)


def _parameters_rates(p: Array, w: Array) -> Array:
    """Return ``p' = 1/2 E^T w``, from ``E E^T = 1`` and ``E p = 0`` for ``p.p = 1`` and so ``p.p' = 0`` [MASS (38)]."""
    return 0.25 * _parameters_H(p).T @ w


def _turn_axes(sequence: tuple[int, int, int], x: Array) -> Array:
    """Return H of three successive rotations: column k is the axis of rotation k after those before it [C4 (4.55)].

    Euler angles: ``[0 cos(phi) sin(phi) sin(theta); 0 sin(phi) -cos(phi) sin(theta); 1 0 cos(theta)]``.
    Bryant angles: ``[1 0 sin(beta); 0 cos(alpha) -sin(alpha) cos(beta); 0 sin(alpha) cos(alpha) cos(beta)]``.
    """
    i, j, k = sequence
    first = elementary_rotation(i, x[0])
    return np.column_stack([np.eye(3)[i], first[:, j], first @ elementary_rotation(j, x[1])[:, k]])


def _turn_h(sequence: tuple[int, int, int], x: Array, x_dot: Array) -> Array:
    """Return ``h = x2' (x1' a1 x a2) + x3' ((x1' a1 + x2' a2) x a3)``: the earlier rotations move each axis."""
    a1, a2, a3 = _turn_axes(sequence, x).T
    d1, d2, d3 = x_dot
    return d2 * cross(d1 * a1, a2) + d3 * cross(d1 * a1 + d2 * a2, a3)


def _turn_rates(sequence: tuple[int, int, int], x: Array, w: Array) -> Array:
    """Solve ``w = x1' a1 + x2' a2 + x3' a3``, a2 orthogonal to a1 and a3.

    The divisor ``a1 x a2 . a3`` is -sin(theta) for Euler angles and cos(beta) for Bryant angles.
    """
    a1, a2, a3 = _turn_axes(sequence, x).T
    d3 = (cross(a1, a2) @ w) / (cross(a1, a2) @ a3)
    # a1 is a unit vector: no second division by the small divisor near the singularity
    return np.array([a1 @ (w - d3 * a3), a2 @ w, d3])


def _wrap(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    return angle - 2.0 * pi * ceil((angle - pi) / (2.0 * pi))


def _euler_angles(quat: Array) -> Array:
    """Return (phi, theta, psi) by half angles, an accurate rotation also near theta = 0 or pi.

    ``(e0, e3) = cos(theta/2) (cos, sin)((phi + psi)/2)``, ``(e1, e2) = sin(theta/2) (cos, sin)((phi - psi)/2)``.
    """
    e0, e1, e2, e3 = quat.tolist()
    half_sum, half_difference = atan2(e3, e0), atan2(e2, e1)
    theta = 2.0 * atan2(hypot(e1, e2), hypot(e0, e3))
    return np.array([_wrap(half_sum + half_difference), theta, _wrap(half_sum - half_difference)])


def _bryant_angles(quat: Array) -> Array:
    """Return (alpha, beta, gamma) by half angles, an accurate rotation also near beta = +-pi/2.

    ``(e0 + e2, e1 + e3) = sqrt(2) sin(beta/2 + pi/4) (cos, sin)((alpha + gamma)/2)``,
    ``(e0 - e2, e1 - e3) = sqrt(2) cos(beta/2 + pi/4) (cos, sin)((alpha - gamma)/2)``.
    """
    e0, e1, e2, e3 = quat.tolist()
    half_sum, half_difference = atan2(e1 + e3, e0 + e2), atan2(e1 - e3, e0 - e2)
    beta = 2.0 * atan2(hypot(e0 + e2, e1 + e3), hypot(e0 - e2, e1 - e3)) - pi / 2.0
    return np.array([_wrap(half_sum + half_difference), beta, _wrap(half_sum - half_difference)])


def _rodrigues_rotation(g: Array) -> Array:
    """Return the rotation matrix of the Euler parameters ``(1, g) / sqrt(1 + g.g)``."""
    return rotation_from_quaternion(np.array([1.0, *g]) / sqrt(1.0 + g @ g))


def _rodrigues_parameters(quat: Array) -> Array:
    """Return ``g = e / e0`` [C4 section 4.3.1]."""
    # at a half turn a very long vector, which the singularity check refuses, instead of 0/0
    return quat[1:] / (quat[0] if abs(quat[0]) > 1e-150 else 1e-150)


def _rodrigues_H(g: Array) -> Array:
    """Return H of ``w = 2 / (1 + g.g) (g' + g x g')``: Euler parameters with ``e = e0 g``, ``e0^2 = 1 / (1 + g.g)``."""
    return 2.0 / (1.0 + g @ g) * (np.eye(3) + skew(g))


def _rodrigues_h(g: Array, g_dot: Array) -> Array:
    """Return ``h = -2 g.g' / (1 + g.g) w``: only the factor of H changes, since ``g' x g' = 0``."""
    return -2.0 * (g @ g_dot) / (1.0 + g @ g) * (_rodrigues_H(g) @ g_dot)


def _rodrigues_rates(g: Array, w: Array) -> Array:
    """Return ``g' = 1/2 (w + g (g.w) - g x w)``."""
    return 0.5 * (w + g * (g @ w) - cross(g, w))


def _rotation_of_vector(phi: Array) -> Array:
    return rotation_from_quaternion(quaternion_from_rotation_vector(phi))


_TERMS = np.arange(15)
_SERIES = np.array(
    [
        [(-1.0) ** k / factorial(2 * k + 2) for k in _TERMS],
        [(-1.0) ** k / factorial(2 * k + 3) for k in _TERMS],
        [(-1.0) ** (k + 1) * (2 * k + 2) / factorial(2 * k + 4) for k in _TERMS],
        [(-1.0) ** (k + 1) * (2 * k + 2) / factorial(2 * k + 5) for k in _TERMS],
    ]
)
"""Coefficients of ``f^(2 k)`` in a, b, a~, b~ of `_vector_coefficients`; truncation error below 1e-18 up to pi."""


def _vector_coefficients(phi: Array) -> tuple[float, float, float, float]:
    """Return ``a = (1 - cos f) / f^2``, ``b = (f - sin f) / f^3``, ``a~ = a' / f``, ``b~ = b' / f``, f = |phi|.

    Up to half a turn by series without cancellation:
    ``a = 1/2 - f^2/24 + ..``, ``b = 1/6 - f^2/120 + ..``,
    ``a~ = -1/12 + f^2/180 - ..``, ``b~ = -1/60 + f^2/1260 - ..``.
    """
    square = float(phi @ phi)
    if square <= pi**2:
        a, b, da, db = (_SERIES @ square**_TERMS).tolist()
        return a, b, da, db
    f = sqrt(square)
    a, b = 2.0 * (sin(f / 2.0) / f) ** 2, (1.0 - sin(f) / f) / square
    return a, b, (sin(f) / f - 2.0 * a) / square, (a - 3.0 * b) / square


def _vector_H(phi: Array) -> Array:
    """Return ``H = 1 + a ~phi + b ~phi^2``, det H = 2 a."""
    a, b, _, _ = _vector_coefficients(phi)
    matrix = skew(phi)
    return np.eye(3) + a * matrix + b * (matrix @ matrix)


def _vector_h(phi: Array, phi_dot: Array) -> Array:
    """Return ``h = phi.phi' (a~ c + b~ phi x c) + b phi' x c`` with ``c = phi x phi'``."""
    _, b, da, db = _vector_coefficients(phi)
    c = cross(phi, phi_dot)
    return (phi @ phi_dot) * (da * c + db * cross(phi, c)) + b * cross(phi_dot, c)


def _vector_rates(phi: Array, w: Array) -> Array:
    """Return ``phi' = w - phi x w / 2 + c phi x (phi x w)``, ``c = (1 - (f/2) cot(f/2)) / f^2 = -a~ / (2 a)``."""
    a, _, da, _ = _vector_coefficients(phi)
    across = cross(phi, w)
    return w - 0.5 * across - da / (2.0 * a) * cross(phi, across)


def switch_chart(phi: Array, phi_dot: Array) -> tuple[Array, Array]:
    """Return the rotation vector of at most half a turn, and its rates, of the same rotation and angular velocity.

    ``phi (1 - 2 pi n / |phi|)`` with n full turns, 0 up to pi and 1 up to 3 pi. After each step of an integrator it
    keeps the vector away from its singularity at a full turn.

    Parameters
    ----------
    phi, phi_dot : ndarray, shape (3,)
        Rotation vector, rad, and its time derivative, rad/s.

    Returns
    -------
    phi, phi_dot : ndarray, shape (3,)
        The arguments themselves up to half a turn.
    """
    f = sqrt(phi @ phi)
    if f <= pi:
        return phi, phi_dot
    turns = 2.0 * pi * ceil((f - pi) / (2.0 * pi))
    axis = phi / f
    return axis * (f - turns), phi_dot - turns / f * (phi_dot - axis * (axis @ phi_dot))


def _three_turns(sequence: tuple[int, int, int]) -> tuple[Callable[[Array], Array], _OfRates, _OfRates]:
    """Return H, h and rates of three successive rotations."""
    return partial(_turn_axes, sequence), partial(_turn_h, sequence), partial(_turn_rates, sequence)


ORIENTATIONS = {
    "euler_parameters": OrientationCoordinates(
        "Euler parameters", 4, rotation_from_quaternion, np.copy, _parameters_H, _parameters_h, _parameters_rates
    ),
    "euler_angles": OrientationCoordinates(
        "Euler angles z-x-z",
        3,
        rotation_from_euler_zxz,
        _euler_angles,
        *_three_turns((2, 0, 2)),
        Singularity("theta", lambda x: float(x[1]), 0.0, pi, lambda x: abs(sin(x[1]))),
    ),
    "bryant_angles": OrientationCoordinates(
        "Bryant angles x-y-z",
        3,
        rotation_from_bryant_xyz,
        _bryant_angles,
        *_three_turns((0, 1, 2)),
        Singularity("beta", lambda x: float(x[1]), pi / 2.0, pi, lambda x: abs(cos(x[1]))),
    ),
    "rodrigues_parameters": OrientationCoordinates(
        "Rodrigues parameters",
        3,
        _rodrigues_rotation,
        _rodrigues_parameters,
        _rodrigues_H,
        _rodrigues_h,
        _rodrigues_rates,
        Singularity("|phi|", lambda g: 2.0 * atan(sqrt(g @ g)), pi, 2.0 * pi, lambda g: 1.0 / sqrt(1.0 + g @ g)),
    ),
    "rotation_vector": OrientationCoordinates(
        "rotation vector components",
        3,
        _rotation_of_vector,
        rotation_vector_from_quaternion,
        _vector_H,
        _vector_h,
        _vector_rates,
        Singularity(
            "|phi|", lambda v: sqrt(v @ v), 2.0 * pi, 2.0 * pi, lambda v: abs(float(np.sinc(sqrt(v @ v) / (2.0 * pi))))
        ),
    ),
}
"""Orientation coordinates by name."""
