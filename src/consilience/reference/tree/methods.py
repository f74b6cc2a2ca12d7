"""The explicit Runge-Kutta pairs of order 8 of `explicit_rk`, as arrays of its kernels.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, sections II.5 and II.10; the coefficients
are those of `integrators.coefficients` and `integrators.tsitouras`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators.coefficients import DORMAND_PRINCE, STAGES, Explicit
from consilience.reference.integrators.tsitouras import TSITOURAS

BEGIN, SECOND, END = np.array([0, 1, STAGES])
"""First two stages, and the stage at the end of a step, as NumPy integers: see `few_freedoms.ONE_TARGET`."""


class RungeKuttaPair(NamedTuple):
    """A pair of twelve stages; stage 12 is the end of the step, the s - 13 stages behind serve the dense output."""

    table: Array  # (s, s) weights of the stages; row 12 holds those of the step
    nodes: Array  # (s,)
    estimate: Array  # (2, 12) weights of the error estimate; the second row, if not zero, is of lower order
    power: float  # power of the estimate that is proportional to the eighth power of the step
    dense: Array  # (4, s) weights of F_3 and higher of the dense output


def _pair(method: Explicit, power: float) -> RungeKuttaPair:
    nodes = np.concatenate([method.c, [1.0], method.c_dense])
    table, estimate = np.zeros((len(nodes), len(nodes))), np.zeros((2, STAGES))
    table[:STAGES, :STAGES], table[STAGES, :STAGES], table[STAGES + 1 :] = method.A, method.b, method.A_dense
    estimate[: len(method.E)] = method.E
    return RungeKuttaPair(table, nodes, estimate, power, method.D)


DOP853 = _pair(DORMAND_PRINCE, 1.0)
"""Dormand-Prince 8(5,3)."""

TP86 = _pair(TSITOURAS, 8.0 / 7.0)
"""Tsitouras-Papakostas 8(6).

The estimate belongs to the method of order six and exceeds the error of the solution of order eight. With this power
the steps are about as long as those of DOP853 at the same tolerance.
"""

PAIRS = {"tp86": TP86, "dop853": DOP853}
"""Pairs by name. A node of tp86 lies behind the end of the step, where a table may be undefined."""

STAGES_AT_MOST = max(len(DOP853.nodes), len(TP86.nodes))
"""Largest number of stages of a step, its end and its dense output together."""
