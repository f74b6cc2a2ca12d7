"""Functions for a callback of MuJoCo, whose clock overruns the end of a table by rounding."""

from __future__ import annotations

from collections.abc import Callable

from consilience.mechanism import Function, Jet

__all__ = ["Jet", "jet_of"]

_SLACK = 1e-9
"""How far beyond the ends of a table, of its length, it has the values of its ends: a clock that sums up its steps runs
so far over."""


def jet_of(function: Function) -> Callable[[float], Jet]:
    """Value and two derivatives of a function, as a function of its argument; NaN outside a table."""
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
