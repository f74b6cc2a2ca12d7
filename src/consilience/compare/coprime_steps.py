"""Limit of motions whose levels scatter, from their ends at coprime steps.

Bodies that hop, or stick and slip, may err at any step by amounts that follow no power of it. Halved steps share their
grids, so that their errors are not independent. Prime numbers of steps in a sample interval have the samples alone in
common. Each component y of the displacements from the reference, at each sample, is fitted by least squares:

    y(h) = L + c h^p,    p = 1/2 and 1

p = 1 is the order of what happens at any phase of a step, and of every step of a higher order above it; p = 1/2 the
least that is believed, as in `uncertainty`. The standard error s of L is the larger one of the residuals' and of the
jackknife's [MacKinnon and White 1985, HC3], which holds where the scatter depends on the step. A limit elsewhere is
told of a component for which, by each p,

- ``|L| > allowed + t s``: t of Student's distribution, by which one of all components is by a chance of `FALSE`;
- L differs from the mean of y by no more than `softness.EXPLAINED` of L. An error ``c h^q``, q >= 1/2, of a motion that
  leads to the reference has an L by p = 1/2 of the other sign than its mean, or none, so that it is never told;
- neighbouring residuals differ as those of independent errors [von Neumann 1941]: no trend is left in them;
- at another softness, if the engine has one, all this holds too, and L is the same but for `softness.EXPLAINED` of it:
  what gives way by its softness is not taken for another model.

J. G. MacKinnon, H. White, J. Econometrics 29 (1985) 305-325; J. von Neumann, Ann. Math. Statist. 12 (1941) 367-395.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from math import isqrt

import numpy as np
import scipy

from consilience.compare.motion import TINY
from consilience.compare.softness import EXPLAINED
from consilience.mechanism import Array

ORDERS = (0.5, 1.0)
"""Orders in the step by which a limit is fitted."""

COUNT, RATIO = 24, 32.0
"""Number of steps, and the ratio of the longest to the shortest: five halvings, over which a root falls by 5.7."""

FALSE = 1e-4
"""Chance of a false limit in any component."""

UNRELATED = 1.2
"""Least mean square of differences of neighbouring residuals over their variance: 2 of independent ones, two standard
deviations ``2 / sqrt(COUNT)`` less."""


@dataclass(frozen=True)
class CoprimeLimit:
    """Limit of motions at coprime steps; differences as of motions.

    Attributes
    ----------
    count : int
        Number of motions.
    limit, error : float
        Distance of the limit from the reference in one component, and its standard error, by the order that leaves the
        most doubt: of the components that are elsewhere, or else of all, the largest distance.
    least : float
        Largest distance in that component that counts as chance.
    elsewhere : bool
        Whether the limit is elsewhere in a component, by each order.
    saturation : float
        Largest difference of the motions to the reference, as a share of the most that motions can differ.
    """

    count: int
    limit: float
    error: float
    least: float
    elsewhere: bool
    saturation: float = 0.0


def coprime_substeps(finest: float) -> Iterator[int]:
    """Yield prime numbers of steps in a sample interval, up to that of the shortest step; more of few."""
    last = 1
    for n in range(COUNT - 1, -1, -1):
        target = max(round(finest / RATIO ** (n / (COUNT - 1))), last + 1)
        last = next(k for k in count(target) if all(k % d for d in range(2, isqrt(k) + 1)))
        yield last


def coprime_limit(
    sets: Sequence[Array], steps: Sequence[float], allowed: float, saturation: float = 0.0
) -> CoprimeLimit:
    """Return the limit of displacements from the reference.

    Parameters
    ----------
    sets : sequence of ndarray, shape (n_h, n_c)
        Components of the displacements at each step; then, where the engine has a softness, the same at another one.
    steps : sequence of float, s
        In the order of their length.
    allowed : float
        Largest difference that counts as agreement.
    saturation : float
        As in `CoprimeLimit`.
    """
    count, components = sets[0].shape
    surely = -float(scipy.special.stdtrit(count - 2, FALSE / (2.0 * components)))
    own, *others = [[_fit(off, np.array(steps) ** order) for order in ORDERS] for off in sets]
    elsewhere = np.ones(components, bool)
    for fits in (own, *others):
        for fit, first in zip(fits, own, strict=True):
            same = np.abs(fit.limit - first.limit) <= EXPLAINED * np.abs(first.limit)
            elsewhere &= fit.steady & same & (np.abs(fit.limit) > allowed + surely * fit.error)
    told = bool(np.any(elsewhere))
    limits, errors = np.abs([fit.limit for fit in own]), np.array([fit.error for fit in own])
    least = allowed + surely * errors
    doubtful = np.argmin(limits / np.maximum(least, TINY), axis=0)
    largest = np.take_along_axis(limits, doubtful[None], axis=0)[0]
    most = int(np.argmax(np.where(elsewhere, largest, -1.0) if told else largest))
    at = doubtful[most], most
    return CoprimeLimit(count, float(limits[at]), float(errors[at]), float(least[at]), told, saturation)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Limits of all components by one order, their standard errors, and whether neither mean nor residuals trend."""

    limit: Array
    error: Array
    steady: Array


def _fit(off: Array, power: Array) -> _Fit:
    """Fit a constant and a power of the step by least squares."""
    columns = np.column_stack([np.ones(len(power)), power])
    inverse = np.linalg.pinv(columns)
    limit = inverse[0] @ off
    rest, weights = off - columns @ (inverse @ off), inverse[0][:, None]
    squares = np.sum(rest**2, axis=0)
    alike = squares / (len(power) - 2) * np.sum(weights**2)
    jackknife = np.sum((weights * rest / (1.0 - np.sum(columns * inverse.T, axis=1)[:, None])) ** 2, axis=0)
    unrelated = np.sum(np.diff(rest, axis=0) ** 2, axis=0) >= UNRELATED * squares
    still = np.abs(limit - np.mean(off, axis=0)) <= EXPLAINED * np.abs(limit)
    return _Fit(limit, np.sqrt(np.maximum(alike, jackknife)), unrelated & still)
