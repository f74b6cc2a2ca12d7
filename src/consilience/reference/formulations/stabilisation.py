"""What keeps an index-1 form on its constraints, which ``Q x'' = gamma`` alone lets drift away as t^2.

- ``none``: nothing; the drift is that of the integrator's local errors, integrated twice.
- ``baumgarte``: ``Q x'' = gamma - 2 alpha (Q x' - nu) - beta^2 g`` [Baumgarte, Comput. Meth. Appl. Mech. Eng. 1, 1972,
  1-16]: violations obey ``g'' + 2 alpha g' + beta^2 g = 0``. At a consistent state it changes nothing.
- ``projection``: positions, then velocities, back to ``g = 0`` and ``Q x' = nu`` in the mass metric after each step.
"""

from __future__ import annotations

from typing import Literal

from consilience.mechanism import Array

Stabilisation = Literal["none", "baumgarte", "projection"]

ALPHA = BETA = 10.0
"""1/s: critical damping with a time constant of 0.1 s, slow beside steps of milliseconds, so it makes nothing stiff."""


def right_hand_side(stabilisation: Stabilisation, gamma: Array, rate_error: Array, value: Array) -> Array:
    """Right-hand side of the rows at acceleration level, shape (q,).

    Parameters
    ----------
    gamma, rate_error, value : ndarray, shape (q,)
        ``Q x'' = gamma``, ``Q x' - nu`` and g, the last zero for rows that hold velocities only.
    """
    if stabilisation == "baumgarte":
        return gamma - 2.0 * ALPHA * rate_error - BETA**2 * value
    return gamma
