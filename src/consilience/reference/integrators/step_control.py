"""Step size control of the compiled integrators: ``h_new = h safety err^(-1/8)``.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.4.
"""

from __future__ import annotations

import numpy as np

from consilience.reference.kernel.compiled import inner

SAFETY, SMALLEST, LARGEST = 0.9, 0.2, 6.0
"""Safety factor and bounds of the change of the step size."""

UNSUITABLE = 3
"""Status of a motion that another integrator has to take. A series with fewer rows would leave the loops open."""

STATUS = {
    0: "finished",
    1: "the step size fell below what the time resolves: the motion runs into a singular pose or grows without bound",
    2: "the accelerations are not finite",
    UNSUITABLE: "the loops pass a pose in which their rows lose rank, and series do not lead through it",
}
"""Meaning of the status of a compiled integrator."""


@inner
def factor_of(error: float, safety: float, most: float) -> float:
    """Return the change of the step size for a scaled error: at most `most`, least where the error is not finite."""
    if error == 0.0:
        return most
    if not np.isfinite(error):
        return SMALLEST
    return min(most, max(SMALLEST, safety * error ** (-1.0 / 8.0)))
