"""How far a motion can be judged at all: the growth of small perturbations along the reference.

The reference moves from states displaced by `PERTURBATION` in random directions that the constraints allow, positions
and velocities alike. The growth g(t) is the largest difference to the undisturbed motion, so far, over that at the
start. One rounding error, eps, committed at the start by whoever computes, is g(t) eps at the time t: where that
reaches the digits asked lies the horizon, and nothing is judged beyond. It is the finite-time counterpart of a
Lyapunov exponent [Benettin et al. 1980].

G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-20.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.compare.motion import difference_over_time, size_of_motion
from consilience.mechanism import Mechanism
from consilience.run import TrajectoryAnswer
from consilience.spatial import Array

PERTURBATION = 1e-7
"""Displacement in m and rad, velocity in m/s and rad/s: its square, what is not linear, is near one rounding error."""

EPS = float(np.finfo(float).eps)


def growth(mechanism: Mechanism, reference: TrajectoryAnswer, disturbed: Sequence[TrajectoryAnswer]) -> Array:
    """Growth of perturbations up to each sample, shape (n_t,); ones where nothing can be displaced."""
    size = size_of_motion(mechanism, reference)
    found = [np.ones(len(reference.time))]
    for motion in disturbed:
        difference = difference_over_time(motion, reference, size)
        if difference[0] > 0.0:
            found.append(np.maximum.accumulate(difference) / difference[0])
    return np.max(found, axis=0)


def judged_samples(growing: Array, digits: int) -> int:
    """Number of samples before the horizon of so many digits; `growing` as from `growth`, shape (n_t,)."""
    beyond = np.flatnonzero(~(EPS * growing < 10.0**-digits))
    return int(beyond[0]) if len(beyond) else len(growing)
