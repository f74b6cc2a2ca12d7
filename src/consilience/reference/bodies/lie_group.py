"""Increments of poses for Lie-group integrators.

An increment xi = (dr, phi) moves the centre of mass of a body by dr in world axes and turns the body by the rotation
vector phi in body axes: ``r + dr``, ``p exp(phi / 2)``. The corresponding velocities are (v, w').
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array, quaternion_product
from consilience.reference.bodies.arrays import P, R

SPEEDS = slice(7, 13)
"""Columns of y with (v, w')."""


def exponential(phi: Array) -> Array:
    """Convert rotation vectors, shape (n, 3), to unit Euler parameters, shape (n, 4)."""
    angle = np.linalg.norm(phi, axis=1)[:, None]
    return np.hstack([np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * phi])


def displaced(y: Array, count: int, xi: Array, speeds: Array) -> Array:
    """Return the packed state y with its first `count` rows moved by increments and given speeds, each (6 n_b,)."""
    moved, step = y.copy(), xi.reshape(count, 6)
    moved[:count, R] += step[:, :3]
    p = quaternion_product(y[:count, P], exponential(step[:, 3:]))
    moved[:count, P] = p / np.linalg.norm(p, axis=1)[:, None]
    moved[:count, SPEEDS] = speeds.reshape(count, 6)
    return moved


def increment_rates(xi: Array, speeds: Array) -> Array:
    """Return the time derivative of increments xi at given speeds, arrays of shape (6 n_b,).

    ``dr' = v`` and ``phi' = w' + 1/2 phi x w' + c phi x (phi x w')``, ``c = (1 - (f/2) cot(f/2)) / f^2``, f = |phi|:
    the inverse of the tangent operator of the exponential [Brüls & Cardona 2010].
    """
    rates = speeds.reshape(-1, 6).copy()
    phi, w = xi.reshape(-1, 6)[:, 3:], rates[:, 3:].copy()
    square = np.sum(phi * phi, axis=1)
    half = 0.5 * np.sqrt(square)
    with np.errstate(invalid="ignore", divide="ignore"):
        exact = (1.0 - half / np.tan(half)) / square
    # series up to 0.05 rad, where the quotient cancels; its truncation error is 1e-14
    c = np.where(square < 2.5e-3, 1 / 12 + square / 720 + square**2 / 30240 + square**3 / 1209600, exact)
    across = np.cross(phi, w)
    rates[:, 3:] += 0.5 * across + c[:, None] * np.cross(phi, across)
    return rates.reshape(-1)
