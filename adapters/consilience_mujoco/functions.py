"""Functions for a callback of MuJoCo, whose clock exceeds the end of a table by rounding."""

from __future__ import annotations

from collections.abc import Callable

from consilience.mechanism import Function, Jet

_SLACK = 1e-9
"""Distance beyond the ends of a table, relative to its length, up to which the values at the ends apply: the rounding
error of a clock that sums up its steps."""


def jet_of(function: Function) -> Callable[[float], Jet]:
    """Return a function for value and two derivatives of `function`; NaN outside a table."""
    table = function.table
    if table is None or table.periodic:
        return function.jet
    first, last = float(table.x[0]), float(table.x[-1])
    slack = _SLACK * (last - first)

    def at(x: float) -> Jet:
        """Value and two derivatives."""
        within = first - slack <= x <= last + slack
        return function.jet(min(max(x, first), last) if within else x)

    return at
