"""Event functions of a motion with contacts, and their first zero within a step.

========  ==============================================  =============================
watch     function, positive while the mode lasts         event at its zero
========  ==============================================  =============================
gap       gap of an open normal                           impact, or closes
normal    force N of a closed normal                      opens
touch     gap of a compliant contact; where shapes          is pressed
          overlap and part, by how much it would pull
spring    force of one that is pressed                    opens
margin    ``mu_s N - |T|`` of what sticks                 slips
group     the same where forces are undetermined: the     opens, or slips
          widest margin of all normals and sticking
          contacts
slip      speed along the heading of what slides          sticks, or slides back
turn      how far the heading is from the bisector of     slides along a facet
          two vertices of a pyramid
========  ==============================================  =============================

Functions are evaluated at equidistant times of a step, at least `PARTS` and one in `INTERVALS` of the motion, and at
their lowest points between them, which their rates tell, or slopes of polynomials through five of their values. A
function counts once it has left zero by `ARMED` of its scale: the event that has just happened does not happen again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from consilience.mechanism import Array
from consilience.reference.contact.problem import FrictionMode, FrictionSet
from consilience.reference.contact.quiet_steps import INTERVALS, PARTS, ROUNDING, SLOPES

ARMED = 1e-9
"""Value, over its scale, from which an event function counts."""

_NEAR = 1e-12
"""Distance from a zero at which its search ends, over the step: steps that end there refine it."""

_LOWEST = 1e-6
"""Distance from a lowest point at which its search ends, over a part of the step."""

CLEAR = 1e-2
"""Margin of undetermined forces, over the forces, from which it stands for the widest, whose sign it has."""


@dataclass(frozen=True)
class Watch:
    """Event function of one normal or friction set.

    Attributes
    ----------
    kind : str
        See the module.
    index : int
        Of the normal, of the friction set, or -1.
    scale : float
        Value that counts as large.
    """

    kind: str
    index: int
    scale: float


def start_of_slip(one: FrictionSet, mode: FrictionMode | None, force: Array) -> Array:
    """Return the heading in which a friction set starts to slide at its bound, shape (d,): along the normal of the set.

    Of a disc, and of one row, it is opposite to the force; of a pyramid that sticks, across the facet reached.
    """
    T, vertices = force[list(one.rows)], one.vertices
    if mode is None or mode.reach or vertices is None or len(one.rows) == 1:
        return -T
    middles = 0.5 * (vertices + np.roll(vertices, -1, axis=0))
    return -middles[int(np.argmax(middles @ T))]


def friction_margin(one: FrictionSet, mode: FrictionMode, force: Array, offset: Array) -> Array:
    """Return how far the forces of a friction set with held directions are from its bound, shape (n,), N (N m).

    Parameters
    ----------
    one : FrictionSet
    mode : FrictionMode
        Sticking, or sliding along a facet.
    force : ndarray, shape (n, m)
        Of all rows.
    offset : ndarray, shape (n,)
        Constant part of the bound, where there is no load; the force of a load includes one that the state gives.
    """
    T, vertices = force[:, list(one.rows)], one.vertices
    bound = offset if one.load is None else force[:, one.load]
    if mode.reach:
        return np.asarray(mode.reach * bound - np.abs(T @ mode.held[0]))
    if vertices is None or len(one.rows) == 1:
        return np.asarray(one.static * bound - np.linalg.norm(T, axis=1))
    middles = 0.5 * (vertices + np.roll(vertices, -1, axis=0))
    reached = T @ (middles / np.sum(middles**2, axis=1)[:, None]).T
    return np.asarray(np.min(one.static * bound[:, None] - reached, axis=1))


Values = Callable[[Array], tuple[Array, Array]]
"""Values of all watches at times within the last step, and their rates where known (else NaN), each (n_t, n_w)."""


def nodes_of(start: float, end: float, span: float) -> Array:
    """Return the times of a step at which event functions are evaluated, equidistant; span of the motion, s."""
    parts = max(PARTS, int(np.ceil(INTERVALS * (end - start) / span)))
    nodes = start + (end - start) / parts * np.arange(parts + 1)
    nodes[-1] = end
    return nodes


def first_zero(values: Values, nodes: Array, armed: Array, watches: list[Watch]) -> tuple[float, int] | None:
    """Return the time of the first zero of an armed event function from above, and its index; None if there is none.

    Parameters
    ----------
    values : callable
    nodes : ndarray, shape (n,), s
        Equidistant times of the step, from its start to its end.
    armed : ndarray of bool, shape (n_w,)
        Which functions count at the first node; updated to the last one.
    watches : list of Watch
    """
    if not watches:
        return None
    table, rates = values(nodes)
    slopes = _slopes(table)
    best: tuple[float, int] | None = None
    for w in np.flatnonzero(~(armed & _stays_positive(table, rates, slopes))).tolist():
        watch, column = watches[w], _Column(values, w, nodes, table[:, w], rates[:, w], slopes[:, w])
        found, armed[w] = column.first_zero(bool(armed[w]), ARMED * watch.scale)
        if found is not None and (best is None or found < best[0]):
            best = (found, w)
    return best


def _slopes(table: Array) -> Array:
    """Return the slopes of functions at equidistant nodes, times their distance, from values at five of them each."""
    last = len(table) - 1
    if last < len(SLOPES) - 1:
        return np.asarray(np.gradient(table, axis=0))
    first = np.clip(np.arange(last + 1) - 2, 0, last - 4)
    near = table[first[:, None] + np.arange(5)]
    return np.asarray(np.einsum("nj,njw->nw", SLOPES[np.arange(last + 1) - first], near))


def _stays_positive(table: Array, rates: Array, slopes: Array) -> Array:
    """Return which functions are positive at all nodes and have no lowest point between them."""
    known, inner = np.isfinite(rates), table[1:-1]
    rate = np.where(known, rates, slopes)
    by_rates = (rate[:-1] < 0.0) & (rate[1:] > 0.0)
    by_values = (inner < table[:-2]) & (inner <= table[2:])
    overlaps = known[:-1] & ~known[1:]
    dips = (by_rates | overlaps).any(axis=0) | (by_values.any(axis=0) & ~known.all(axis=0))
    return np.asarray((table > 0.0).all(axis=0) & ~dips)


class _Column:
    """One event function: its values, rates and slopes at the nodes."""

    def __init__(self, values: Values, index: int, nodes: Array, value: Array, rate: Array, slope: Array) -> None:
        self._values, self._index, self.nodes, self.value, self.rate = values, index, nodes, value, rate
        self._slope = slope
        self._known = dict(zip(nodes.tolist(), value.tolist(), strict=True))

    def _at(self, t: float) -> float:
        known = self._known.get(float(t))
        return float(self._values(np.array([t]))[0][0, self._index]) if known is None else known

    def _rate_at(self, t: float) -> float:
        return float(self._values(np.array([t]))[1][0, self._index])

    def first_zero(self, armed: bool, ready: float) -> tuple[float | None, bool]:
        """Return the first zero, or None, and whether the function counts at the last node."""
        value, nodes = self.value, self.nodes
        for k in range(len(nodes) - 1):
            noise = ROUNDING * ready  # what does not leave it within a part rises by rounding alone
            rises = value[k] >= -noise and self.rate[k] * (nodes[k + 1] - nodes[k]) > noise
            armed = armed or bool(value[k] > ready or rises)
            low = self._lowest(k) if armed else None
            if low is not None:
                return self._root(nodes[k], low), True
            top = self._highest(k) if armed and value[k + 1] < 0.0 else nodes[k]
            if value[k + 1] < 0.0 and armed and (value[k] > 0.0 or top > nodes[k]):
                return self._root(top, nodes[k + 1]), True
            if value[k + 1] < -ready:  # a mode that has just begun does not last
                return self._root(self._highest(k), nodes[k + 1], -ready), True
        return None, armed or bool(value[-1] > ready)

    def _turning(self, k: int) -> float:
        """Return the time at which the rate changes sign in part k, or one at which it is not known."""

        def rate(t: float) -> float:
            found = self._rate_at(t)
            return found if np.isfinite(found) else 0.0

        return float(scipy.optimize.brentq(rate, self.nodes[k], self.nodes[k + 1], xtol=1e-15, rtol=1e-15))

    def _overlap(self, k: int, t: float) -> float:
        """Return a time in part k, until t, at which the function is negative, if shapes overlap at t and part."""
        start = float(self.nodes[k])
        while self._at(t) >= 0.0 and not np.isfinite(self._rate_at(t)):
            middle = 0.5 * (start + t)
            if not start < middle < t:
                break
            start, t = (middle, t) if np.isfinite(self._rate_at(middle)) else (start, middle)
        return t

    def _highest(self, k: int) -> float:
        """Return the time of the maximum in part k of a function that rises from zero, or the start of the part."""
        rises = self.rate[k] > 0.0 > self.rate[k + 1]
        return self._turning(k) if rises else float(self.nodes[k])

    def _dips(self, k: int, rate: Array, step: float) -> bool:
        """Return whether the function falls and rises in part k, and a convex one may fall to zero: tangents meet."""
        (a, b), (falls, rises) = self.value[k : k + 2], rate[k : k + 2]
        return bool(falls < 0.0 < rises and a * rises - b * falls + falls * rises * step <= 0.0)

    def _bends(self, k: int) -> bool:
        """Return whether node k is lower than those beside it, and the parabola through the three falls near zero."""
        if not 0 < k < len(self.nodes) - 1:
            return False
        before, here, after = self.value[k - 1 : k + 2]
        if not before > here <= after:
            return False
        return bool(0.9 * here <= 0.125 * (after - before) ** 2 / (after - 2.0 * here + before))

    def _lowest(self, k: int) -> float | None:
        """Return a time in part k at which the function is negative though it is not at its ends; None: nowhere."""
        value, nodes = self.value, self.nodes
        if value[k] <= 0.0 or value[k + 1] < 0.0:
            return None
        if np.isfinite(self.rate[k]) and not np.isfinite(self.rate[k + 1]):  # shapes overlap, and part again
            low = self._overlap(k, float(nodes[k + 1]))
        elif np.isfinite(self.rate[k]):
            if not self._dips(k, self.rate, nodes[k + 1] - nodes[k]):
                return None
            low = self._overlap(k, self._turning(k))
        else:
            if not (self._dips(k, self._slope, 1.0) or self._bends(k) or self._bends(k + 1)):
                return None
            bounds, width = (nodes[k], nodes[k + 1]), nodes[k + 1] - nodes[k]
            search = scipy.optimize.minimize_scalar
            low = float(search(self._at, bounds=bounds, method="bounded", options={"xatol": _LOWEST * width}).x)
        return low if self._at(low) < 0.0 else None

    def _root(self, start: float, end: float, level: float = 0.0) -> float:
        """Return the time between two others at which the function falls through a level."""
        if self._at(start) <= level:
            return float(start)
        if self._at(end) >= level:
            return float(end)
        least = _NEAR * (self.nodes[-1] - self.nodes[0])
        return float(scipy.optimize.brentq(lambda t: self._at(t) - level, start, end, xtol=least, rtol=1e-15))
