"""Tables of time of a mechanism: points that no step passes over many at once, whatever moves meanwhile."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from consilience.mechanism import Array, Function, Mechanism

_AT_ONCE = 4
"""Points of tables that a step may pass: what a table does between two of them lasts a quarter of a step, or longer."""

_MOST = 1_000_000
"""Largest number of points; a periodic table with more is left to the control of errors."""


def ends_of_steps(mechanism: Mechanism, start: float, end: float) -> Array:
    """Return the times that steps from start to end may not pass, s, the last of them the end, or later."""
    found = np.unique(np.concatenate([[end], *(_points(f, start, end) for f in _functions(mechanism))]))
    return np.append(found[(found > start) & (found < end)][_AT_ONCE - 1 :: _AT_ONCE], end)


def _functions(mechanism: Mechanism) -> Iterator[Function]:
    """Yield the functions of time with tables."""
    m = mechanism
    histories = [load.history for load in m.loads]
    actuators = [s.actuator for s in m.springs] + [s.actuator for s in m.joint_springs]
    motions = [c.target for c in m.controls] + [d.motion for d in m.drives]
    for function in [*histories, *actuators, *motions]:
        if function is not None and function.table is not None:
            yield function


def _points(function: Function, start: float, end: float) -> Array:
    """Return the points of a table in a span of time, repeated if it is periodic."""
    table = function.table
    assert table is not None
    if not table.periodic:
        return table.x
    first, last = (int(np.floor((t - table.x[0]) / table.period)) for t in (start, end))
    if (last - first + 1) * len(table.x) > _MOST:
        return np.zeros(0)
    return np.asarray((table.x + table.period * np.arange(first, last + 1)[:, None]).ravel())
