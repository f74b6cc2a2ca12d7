"""Constraint stabilisation of index-1 forms: ``Q x'' = gamma`` alone lets violations grow as t^2.

- ``none``: no stabilisation; local errors of the integrator are integrated twice.
- ``baumgarte``: ``Q x'' = gamma - 2 alpha (Q x' - nu) - beta^2 g`` [Baumgarte, Comput. Meth. Appl. Mech. Eng. 1, 1972,
  1-16]: violations obey ``g'' + 2 alpha g' + beta^2 g = 0``. Consistent states have the same accelerations.
- ``projection``: after each step positions, then velocities, are projected onto ``g = 0``, ``Q x' = nu`` (mass metric).
"""

from __future__ import annotations

from typing import Literal

from consilience.mechanism import Array

Stabilisation = Literal["none", "baumgarte", "projection"]

ALPHA = BETA = 10.0
"""1/s: critical damping with a time constant of 0.1 s, not stiff for steps of milliseconds."""


def right_hand_side(stabilisation: Stabilisation, gamma: Array, rate_error: Array, value: Array) -> Array:
    """Return the right-hand side of the rows at acceleration level, shape (q,).

    Parameters
    ----------
    stabilisation : str
    gamma, rate_error, value : ndarray, shape (q,)
        gamma, ``Q x' - nu`` and g, the last one zero for non-holonomic rows.
    """
    if stabilisation == "baumgarte":
        return gamma - 2.0 * ALPHA * rate_error - BETA**2 * value
    return gamma
