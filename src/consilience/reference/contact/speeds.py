"""Speeds of a mechanism, beside which rates of contacts are zero or not."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.response import Response


def fastest(equations: ContactEquations, y: Array, length: float) -> float:
    """Return the speed of the fastest body of a packed state, rotation times a length included, m/s."""
    largest = np.abs(y[: len(equations.model.mass), 7:]).max(axis=0).tolist()
    return max(*largest[:3], length * max(largest[3:]))


def speed_from_rest(equations: ContactEquations, response: Response, length: float) -> float:
    """Return the speed that a fall, or without gravity the forces and bounds of friction, make over a length, m/s."""
    size = float(np.linalg.norm(equations.model.gravity))
    if size == 0.0:
        weight = np.linalg.norm(response.load, axis=0)
        bounds = [
            offset * one.static * float(np.max(weight[list(one.rows)]))
            for one, offset in zip(equations.layout.friction, equations.offsets, strict=True)
        ]
        size = max(response.pull, *bounds, 0.0) / float(np.sqrt(np.sum(equations.model.mass)))
    return float(np.sqrt(size * length))
