"""Horizon: the time up to which a motion can be judged, from the growth of small perturbations of the reference.

The reference is integrated from states displaced by `PERTURBATION` in random directions that the constraints allow, in
positions and velocities. The growth g(t) is the largest difference to the undisturbed motion up to t, divided by the
difference at the start; a mechanism that drives move alone has nothing to displace, and no growth. A rounding error is
here a change of the initial positions by eps, relative to the size of the motion or in rad, along such a direction: it
has grown to g(t) eps at the time t. The horizon is the time at which g(t) eps reaches the digits asked; nothing is
judged beyond. The logarithmic rate of g is a finite-time Lyapunov exponent [Benettin et al. 1980].

A perturbation above `LINEAR` no longer grows linearly: from there on g is extrapolated at its mean exponential rate.
Errors of the reference, of the size of its tolerance, grow in the same way: the horizon also lies where g exceeds
`AMPLIFYING` and the uncertainty of the reference reaches the digits asked.

G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-20.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.compare.motion import difference_over_time, size_of_motion
from consilience.engine import TrajectoryAnswer
from consilience.mechanism import Array, Mechanism

PERTURBATION = 1e-8
"""Displacement in characteristic lengths and rad, and as much of a velocity in a second.

Far above the errors of the reference, far below `LINEAR`."""

ROUNDED = 1e-13
"""Difference at the start that is the rounding of an assembly, not a displacement."""

LINEAR = 1e-3
"""Difference of two motions up to which growth is linear: the quadratic terms are of the size of its square."""

AMPLIFYING = 1e3
"""Growth above which the uncertainty of the reference is due to the motion, not to the integration."""

EPS = float(np.finfo(float).eps)


def growth(mechanism: Mechanism, reference: TrajectoryAnswer, disturbed: Sequence[TrajectoryAnswer]) -> Array:
    """Return the growth of perturbations up to each sample, shape (n_t,); ones if no state can be displaced."""
    size = size_of_motion(mechanism, reference)
    found = [np.ones(len(reference.time))]
    for motion in disturbed:
        difference = difference_over_time(motion, reference, size)
        if difference[0] > ROUNDED:
            found.append(_continued(reference.time, np.maximum.accumulate(difference), difference[0]))
    return np.max(found, axis=0)


def _continued(time: Array, largest: Array, start: float) -> Array:
    """Return the growth from the largest difference up to each sample, extrapolated beyond `LINEAR`."""
    grown = largest / start
    beyond = np.flatnonzero(largest > LINEAR)
    if not len(beyond) or beyond[0] == 0:
        return grown
    first = int(beyond[0])
    rate = np.log(grown[first]) / (time[first] - time[0])
    return np.concatenate([grown[:first], np.exp(np.minimum(rate * (time[first:] - time[0]), 300.0))])


def judged_samples(growing: Array, spread: Array, digits: int) -> int:
    """Return the number of samples before the horizon.

    Parameters
    ----------
    growing : ndarray, shape (n_t,)
        Growth of perturbations, as from `growth`.
    spread : ndarray, shape (n_t,)
        Uncertainty of the reference up to each sample.
    digits : int
        Digits asked.
    """
    asked = 10.0**-digits
    beyond = np.flatnonzero(~(EPS * growing < asked) | ((growing > AMPLIFYING) & ~(spread <= asked)))
    return int(beyond[0]) if len(beyond) else len(growing)
