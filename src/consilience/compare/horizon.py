"""How far a motion can be judged at all: the growth of small perturbations along the reference.

The reference moves from states displaced by `PERTURBATION` in random directions that the constraints allow, positions
and velocities alike. The growth g(t) is the largest difference to the undisturbed motion, so far, over that at the
start. One rounding error, eps, committed at the start by whoever computes, is g(t) eps at the time t: where that
reaches the digits asked lies the horizon, and nothing is judged beyond. It is the finite-time counterpart of a
Lyapunov exponent [Benettin et al. 1980].

A perturbation that has grown to `LINEAR` grows no more as small ones do; from there on g is continued at the mean
exponential rate so far. The reference has errors of its own, of its tolerance, which grow likewise: where g is above
`AMPLIFYING` and the uncertainty of the reference reaches the digits asked, the horizon lies as well.

G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-20.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.compare.motion import difference_over_time, size_of_motion
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import Array, Mechanism

PERTURBATION = 1e-8
"""Displacement in m and rad, velocity in m/s and rad/s: far above the errors of the reference, far below `LINEAR`."""

LINEAR = 1e-3
"""Difference of two motions up to which growth is read: its square is what is not linear."""

AMPLIFYING = 1e3
"""Growth above which the uncertainty of the reference is that of the motion and not of the reference."""

EPS = float(np.finfo(float).eps)


def growth(mechanism: Mechanism, reference: TrajectoryAnswer, disturbed: Sequence[TrajectoryAnswer]) -> Array:
    """Growth of perturbations up to each sample, shape (n_t,); ones where nothing can be displaced."""
    size = size_of_motion(mechanism, reference)
    found = [np.ones(len(reference.time))]
    for motion in disturbed:
        difference = difference_over_time(motion, reference, size)
        if difference[0] > 0.0:
            found.append(_continued(reference.time, np.maximum.accumulate(difference), difference[0]))
    return np.max(found, axis=0)


def _continued(time: Array, largest: Array, start: float) -> Array:
    """Growth from the largest difference so far, continued where it is not small any more."""
    grown = largest / start
    beyond = np.flatnonzero(largest > LINEAR)
    if not len(beyond) or beyond[0] == 0:
        return grown
    first = int(beyond[0])
    rate = np.log(grown[first]) / (time[first] - time[0])
    return np.concatenate([grown[:first], np.exp(np.minimum(rate * (time[first:] - time[0]), 300.0))])


def judged_samples(growing: Array, spread: Array, digits: int) -> int:
    """Number of samples before the horizon of so many digits.

    Parameters
    ----------
    growing : ndarray, shape (n_t,)
        As from `growth`.
    spread : ndarray, shape (n_t,)
        Uncertainty of the reference up to each sample.
    """
    asked = 10.0**-digits
    beyond = np.flatnonzero(~(EPS * growing < asked) | ((growing > AMPLIFYING) & ~(spread <= asked)))
    return int(beyond[0]) if len(beyond) else len(growing)
