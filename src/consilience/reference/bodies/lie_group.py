"""Packed states moved by increments, as the integrators on the group of poses need it.

An increment xi of a body is (dr, phi): its centre of mass moves by dr in world axes and it turns by the rotation
vector phi in body axes, ``r + dr`` and ``p exp(phi / 2)``. The speeds of the same kind are (v, w').
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array, quaternion_product
from consilience.reference.bodies.arrays import P, R

SPEEDS = slice(7, 13)
"""Columns of y with (v, w')."""


def exponential(phi: Array) -> Array:
    """Unit Euler parameters of rotation vectors, shape (n, 3) to (n, 4)."""
    angle = np.linalg.norm(phi, axis=1)[:, None]
    return np.hstack([np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * phi])


def displaced(y: Array, count: int, xi: Array, speeds: Array) -> Array:
    """New packed state: the first `count` rows of y moved by increments, shape (6 n_b,), with other speeds."""
    moved, step = y.copy(), xi.reshape(count, 6)
    moved[:count, R] += step[:, :3]
    p = quaternion_product(y[:count, P], exponential(step[:, 3:]))
    moved[:count, P] = p / np.linalg.norm(p, axis=1)[:, None]
    moved[:count, SPEEDS] = speeds.reshape(count, 6)
    return moved


def increment_rates(xi: Array, speeds: Array) -> Array:
    """Time derivative of increments from a fixed state to one with the speeds given, arrays of shape (6 n_b,).

    ``dr' = v`` and ``phi' = w' + 1/2 phi x w' + c phi x (phi x w')``, ``c = (1 - (f/2) cot(f/2)) / f^2``, f = |phi|:
    the inverse of the tangent operator of the exponential [Brüls & Cardona 2010].
    """
    rates = speeds.reshape(-1, 6).copy()
    phi, w = xi.reshape(-1, 6)[:, 3:], rates[:, 3:].copy()
    square = np.sum(phi * phi, axis=1)
    half = 0.5 * np.sqrt(square)
    with np.errstate(invalid="ignore", divide="ignore"):
        exact = (1.0 - half / np.tan(half)) / square
    # the series up to a twentieth of a radian, where the quotient cancels; its first term left out is 1e-14 there
    c = np.where(square < 2.5e-3, 1 / 12 + square / 720 + square**2 / 30240 + square**3 / 1209600, exact)
    across = np.cross(phi, w)
    rates[:, 3:] += 0.5 * across + c[:, None] * np.cross(phi, across)
    return rates.reshape(-1)
