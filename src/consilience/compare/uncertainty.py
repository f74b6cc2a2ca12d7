"""Uncertainty of a computed motion from a ladder of steps or tolerances: the grid convergence index.

From levels with steps ``h_1 > h_2 > ... > h_n`` and the ratio r of the last two:

- observed order ``p = ln(|x_1 - x_2| / |x_2 - x_3|) / ln r`` of the finest three levels that rounding does not hide;
- limit ``x = x_n + (x_n - x_{n-1}) / (r^P - 1)``, P the declared order [Richardson 1911];
- band ``u = F |x_n - x_{n-1}| / (r^q - 1)`` [Roache 1994; ASME V&V 20-2009, section 2].

F and q follow what has been observed [Roache 1998; Oberkampf and Roy 2010, section 8.6.3]:

=====================================  ====  =============================
observed order                         F     q
=====================================  ====  =============================
within `WINDOW` of the declared one    1.25  p, but no more than P
not, or hidden by rounding, or absent  3     p within [1/2, P]; P if unseen
=====================================  ====  =============================

A method of controlled error takes a ladder of tolerances: its error is asked to be proportional to the tolerance,
which is order one with the tolerance for h. Where a quantity does not converge at all the band is as wide as the last
difference many times over, and says so. To every band the rounding of the steps is added: one unit in each.

P. J. Roache, J. Fluids Eng. 116 (1994) 405-413; P. J. Roache, Verification and Validation in Computational Science and
Engineering, 1998; W. L. Oberkampf, C. J. Roy, Verification and Validation in Scientific Computing, 2010; L. F.
Richardson, Phil. Trans. R. Soc. A 210 (1911) 307-357.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from consilience.compare.motion import OBSERVABLES, Scales, difference_over_time, extrapolated
from consilience.engine import Method, TrajectoryAnswer
from consilience.mechanism import Array

WINDOW = 0.5
"""Distance of the observed order from the declared one up to which levels count as asymptotic: halfway to the next."""

SAFE, CAUTIOUS = 1.25, 3.0
"""Roache's safety factors: for three levels of the expected order, and for everything else."""

LEAST_ORDER = 0.5
"""Least order a band is made with where the observed one is lower [Oberkampf and Roy 2010]."""

ROUNDING = 1e-11
"""Differences below this are made of rounding, not of steps: no order can be read from them."""

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Estimate:
    """What a ladder says about one observable.

    Attributes
    ----------
    name : str
    order : float or None
        Observed among the levels themselves; None where rounding hides it or there are fewer than three.
    band : float
        Uncertainty of the finest level.
    change : float
        Largest difference of the two finest levels.
    """

    name: str
    order: float | None
    band: float
    change: float


def declared_order(method: Method) -> int | None:
    """Order of the error in what distinguishes the levels: steps, or tolerances."""
    return 1 if method.tolerances else method.order


def ratio_of(steps: Sequence[float | None]) -> float:
    """Ratio of the two finest steps or tolerances."""
    coarse, fine = steps[-2:]
    assert coarse is not None
    assert fine is not None
    return coarse / fine


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def finest_order(errors: Sequence[float], ratio: float) -> float | None:
    """Observed order from the finest pair of errors that rounding does not hide."""
    for coarse, fine in reversed(list(pairwise(errors))):
        if coarse > 2 * ROUNDING and fine > ROUNDING:
            return float(np.log(coarse / fine) / np.log(ratio))
    return None


def settled(order: float | None, declared: int) -> bool:
    """Whether an observed order is that of the method."""
    return order is not None and abs(order - declared) <= WINDOW


def band(change: float, order: float | None, declared: int, ratio: float, steps: float) -> float:
    """Uncertainty of the finest level from its change to the one before, by the module's table."""
    factor = SAFE if settled(order, declared) else CAUTIOUS
    exponent = float(declared) if order is None else min(max(order, LEAST_ORDER), float(declared))
    return factor * change / (ratio**exponent - 1.0) + EPS * steps


def estimates(
    answers: Sequence[TrajectoryAnswer], method: Method, steps: Sequence[float | None], scales: Scales
) -> tuple[Estimate, ...]:
    """Order and band of every observable, from the levels of one run alone; none from a single level."""
    declared = declared_order(method)
    if declared is None or len(answers) < 2:
        return ()
    ratio, count = ratio_of(steps), _steps_taken(answers[-1], steps[-1])
    found = []
    for name, difference in OBSERVABLES.items():
        changes = [difference(a, b, scales) for a, b in pairwise(answers)]
        order = finest_order([rms(c) for c in changes], ratio)
        largest = float(np.max(changes[-1]))
        found.append(Estimate(name, order, band(largest, order, declared, ratio, count), largest))
    return tuple(found)


def _steps_taken(answer: TrajectoryAnswer, step: float | None) -> float:
    """Steps of a run, by its own count where it has one."""
    counted = answer.counters.get("steps")
    if counted:
        return float(counted)
    return float(np.ptp(answer.time)) / step if step else 0.0


def needs_another_level(answers: Sequence[TrajectoryAnswer], method: Method, steps: Sequence[float | None]) -> bool:
    """Whether the observed order has not settled yet, so that a finer level would say more.

    Not where rounding hides the order: no finer level will show it.
    """
    declared = declared_order(method)
    if declared is None or len(answers) < 2:
        return False
    size = max(float(np.max(np.ptp(answers[-1].p_WB, axis=0))), 1e-300)
    changes = [rms(difference_over_time(a, b, size)) for a, b in pairwise(answers)]
    order = finest_order(changes, ratio_of(steps))
    if order is None:
        return len(answers) < 3 and changes[-1] > ROUNDING
    return not settled(order, declared)


def richardson(coarse: TrajectoryAnswer, fine: TrajectoryAnswer, order: float, ratio: float = 2.0) -> TrajectoryAnswer:
    """Limit of two levels."""
    return extrapolated(coarse, fine, 1.0 / (ratio**order - 1.0))
