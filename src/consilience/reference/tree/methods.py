"""Runge-Kutta methods of order 8 that `integrate` takes."""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators import coefficients, tsitouras
from consilience.reference.integrators.coefficients import STAGES


class RungeKuttaPair(NamedTuple):
    """A method of twelve stages, the end of the step, and the s - 13 stages of its dense output."""

    table: Array  # (s, s) weights of the stages; row 12 those of the step
    nodes: Array  # (s,)
    estimate: Array  # (2, 12) weights of the error estimate and, if not zero, of one of lower order that tempers it
    power: float  # of the estimate that grows with the step to the eighth
    dense: Array  # (4, s) weights of F_3 and higher of the dense output


def _pair(pair: ModuleType, estimate: Array, power: float) -> RungeKuttaPair:
    nodes = np.concatenate([pair.C, [1.0], pair.C_DENSE])
    table = np.zeros((len(nodes), len(nodes)))
    table[:STAGES, :STAGES], table[STAGES, :STAGES], table[STAGES + 1 :] = pair.A, pair.B, pair.A_DENSE
    return RungeKuttaPair(table, nodes, estimate, power, pair.D_DENSE)


DOP853 = _pair(coefficients, np.array([coefficients.E5, coefficients.E3]), 1.0)
"""Dormand-Prince 8(5,3)."""

TP86 = _pair(tsitouras, np.array([tsitouras.E, np.zeros(STAGES)]), 8.0 / 7.0)
"""Tsitouras-Papakostas 8(6): a quarter fewer evaluations than DOP853 to the same accuracy of linkages.

Its estimate is that of the method of order six, much larger than the error of the one that is carried on. Raised to
this power it asks for about the steps of DOP853 at the same tolerance, and the motion is more accurate.
"""

PAIRS = {"tp86": TP86, "dop853": DOP853}
"""By name. The first looks a little beyond the end of a step, where a table may have ended."""

STAGES_AT_MOST = max(len(DOP853.nodes), len(TP86.nodes))
"""Of a step, its end, and a dense output."""
