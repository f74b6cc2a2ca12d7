"""Uncertainty of a computed motion from several steps or tolerances: the grid convergence index.

From levels with steps ``h_1 > h_2 > ... > h_n`` and the ratio r of the last two:

- observed order ``p = ln(|x_1 - x_2| / |x_2 - x_3|) / ln r`` of the finest three levels above rounding;
- limit ``x = x_n + (x_n - x_{n-1}) / (r^P - 1)``, P the declared order [Richardson 1911];
- band ``u = F |x_n - x_{n-1}| / (r^q - 1)`` [Roache 1994; ASME V&V 20-2009, section 2].

F and q depend on the observed order [Roache 1998; Oberkampf and Roy 2010, section 8.6.3]:

=====================================  ====  =============================
observed order                         F     q
=====================================  ====  =============================
within `WINDOW` of the declared one    1.25  p, but no more than P
not, or hidden by rounding, or absent  3     p within [1/2, P]; P if unseen
=====================================  ====  =============================

A method with error control has levels of tolerances: its error should be proportional to the tolerance, which is order
one with the tolerance for h. The band of a quantity that does not converge is several times the last difference. The
rounding of the steps is added to each band: one unit a step.

P. J. Roache, J. Fluids Eng. 116 (1994) 405-413; P. J. Roache, Verification and Validation in Computational Science and
Engineering, 1998; W. L. Oberkampf, C. J. Roy, Verification and Validation in Scientific Computing, 2010; L. F.
Richardson, Phil. Trans. R. Soc. A 210 (1911) 307-357.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from consilience.compare.motion import OBSERVABLES, TINY, Scales, difference_over_time, displacements, extrapolated
from consilience.engine import Method, TrajectoryAnswer
from consilience.mechanism import Array

WINDOW = 0.5
"""Largest distance of the observed from the declared order of asymptotic levels: halfway to the next order."""

SAFE, CAUTIOUS = 1.25, 3.0
"""Safety factors of Roache: for three levels with the expected order, and for all other ladders."""

LEAST_ORDER = 0.5
"""Least order in a band; a lower observed order is raised to it [Oberkampf and Roy 2010]."""

ROUNDING = 1e-11
"""Differences below this are rounding errors, which show no order."""

LEAST_LEVELS = 3
"""Levels that have an order, which may be one by chance."""

UNLIKE_LEVELS = 5
"""Levels of halved steps of which an impact is late at one instant in all by a chance of 1/16, and several never."""

MOST_LEVELS = 8
LEVEL_BUDGET = 5.0
"""Largest number of levels of a method, and largest CPU time in s that a further level may take."""

EPS = float(np.finfo(float).eps)

BLOWN_UP = np.errstate(over="ignore", invalid="ignore")
"""Squares of a diverging motion overflow and count as infinite."""


@dataclass(frozen=True)
class Estimate:
    """Observed order and uncertainty of one observable.

    Attributes
    ----------
    name : str
    order : float or None
        Order observed among the levels; None below rounding or with fewer than three levels.
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
    """Return the declared order of a method, in its steps or in its tolerances."""
    return 1 if method.tolerances else method.order


def ratio_of(steps: Sequence[float | None]) -> float:
    """Return the ratio of the two finest steps or tolerances."""
    coarse, fine = steps[-2:]
    assert coarse is not None
    assert fine is not None
    return coarse / fine


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def finest_order(errors: Sequence[float], ratio: float) -> float | None:
    """Return the observed order from the finest pair of errors above rounding; None if there is none."""
    for coarse, fine in reversed(list(pairwise(errors))):
        if coarse > 2 * ROUNDING and fine > ROUNDING:
            return float((np.log(coarse) - np.log(fine)) / np.log(ratio))  # of a motion that diverges, too
    return None


def envelope(changes: Sequence[float], steps: Sequence[float | None], least: float = ROUNDING) -> float | None:
    """Return the largest error of the finest level whose errors are random within a multiple of the step.

    An impact falls at any phase of a step, so that errors ``|e_k| <= C h_k`` have no order. C is at least the largest
    ``|x_k - x_(k+1)| / (h_k + h_(k+1))``; `CAUTIOUS` times it is taken. None for fewer than three levels, and where
    the last change is neither smaller than the largest by a quarter nor at most `least`, as of an impact on the grid.

    Parameters
    ----------
    changes : sequence of float
        Differences of consecutive levels, coarse to fine.
    steps : sequence of float, s
        Steps of the levels, or tolerances.
    least : float
        Change that counts as none.
    """
    if len(changes) < 2 or changes[-1] > max(0.75 * max(changes), least) or not all(steps):
        return None
    slopes = [change / ((a or 0.0) + (b or 0.0)) for change, (a, b) in zip(changes, pairwise(steps), strict=True)]
    return CAUTIOUS * max(slopes) * (steps[-1] or 0.0)


def settled(order: float | None, declared: int) -> bool:
    """Whether an observed order agrees with the declared one."""
    return order is not None and abs(order - declared) <= WINDOW


def band(change: float, order: float | None, declared: int, ratio: float, steps: float) -> float:
    """Return the uncertainty of the finest level, by the table of the module.

    Parameters
    ----------
    change : float
        Difference of the two finest levels.
    order : float or None
        Observed order.
    declared : int
        Declared order.
    ratio : float
        Ratio of the two finest steps.
    steps : float
        Number of steps of the finest level, for the rounding.
    """
    factor = SAFE if settled(order, declared) else CAUTIOUS
    exponent = float(declared) if order is None else min(max(order, LEAST_ORDER), float(declared))
    return factor * change / (ratio**exponent - 1.0) + EPS * steps


def estimates(
    answers: Sequence[TrajectoryAnswer], method: Method, steps: Sequence[float | None], scales: Scales
) -> tuple[Estimate, ...]:
    """Return order and band of each observable, from the levels alone; none from a single level."""
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
    """Return the number of steps of a motion, by the engine's count if there is one."""
    counted = answer.counters.get("steps")
    if counted:
        return float(counted)
    return float(np.ptp(answer.time)) / step if step else 0.0


def affordable(cpu: float) -> bool:
    """Whether a level of half the step of one that took this CPU time, s, is within `LEVEL_BUDGET`."""
    return 2.0 * cpu < LEVEL_BUDGET


@BLOWN_UP
def needs_another_level(answers: Sequence[TrajectoryAnswer], method: Method, steps: Sequence[float | None]) -> bool:
    """Whether the observed order differs from the declared one, so that a finer level may show it.

    Below rounding no finer level shows an order.
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
    """Return the Richardson limit of two levels."""
    return extrapolated(coarse, fine, 1.0 / (ratio**order - 1.0))


def off_where_closing(
    levels: Sequence[TrajectoryAnswer],
    limit: TrajectoryAnswer,
    reference: TrajectoryAnswer,
    size: float,
    judged: slice,
    ratio: float,
) -> float:
    """Return the largest difference of a limit to the reference along which the levels draw together.

    Errors that have grown as large as they can hardly change with the step, and change more with smaller ones, beside
    others that shrink with the declared order: a limit by this order is none for them. Levels draw together along the
    displacement of a body from the reference to the limit where the last change along it is smaller by the least order
    that is believed, or rounding. Two levels do not tell.

    Parameters
    ----------
    levels : sequence of TrajectoryAnswer
        Coarse to fine.
    limit, reference : TrajectoryAnswer
    size : float, m
        Size of the motion.
    judged : slice
        Samples up to the horizon.
    ratio : float
        Ratio of the two finest steps.
    """
    off = displacements(reference, limit, size)[:, judged]
    largest = np.linalg.norm(off, axis=-1)
    if len(levels) > 2:
        along = off / np.maximum(largest, TINY)[..., None]
        changes = [displacements(a, b, size)[:, judged] for a, b in pairwise(levels[-3:])]
        before, last = (np.abs(np.sum(change * along, axis=-1)) for change in changes)
        largest = largest[last <= np.maximum(before / ratio**LEAST_ORDER, ROUNDING)]
    return float(np.max(largest, initial=0.0))
