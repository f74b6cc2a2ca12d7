"""Taylor's method for mechanisms in a plane, in the state z, with projection after every step.

The order p follows from the tolerance, the step h from the last coefficients [Jorba and Zou, A software package for
the numerical integration of ODEs by means of high-order Taylor methods, Experimental Mathematics 14, 2005, 99-117,
section 3]: with the largest component |z_m| of a coefficient, each scaled by the size of its kind,

    h = (a tolerance)^(1/p) min |z_m|^(-1/m),    m = p - 3 ... p,

so that the last term of the series is a small part a of the tolerance. No step is taken in vain, and samples come from
the polynomial of a step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators import step_control
from consilience.reference.integrators.step_control import EVALUATIONS, STEPS
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.kernel.held import opened
from consilience.reference.tree.arrays import Rest, Run, System, Tree
from consilience.reference.tree.dynamics import factorise_rows
from consilience.reference.tree.either import cut_rows, force_rows, open_links
from consilience.reference.tree.explicit_rk import LEFT
from consilience.reference.tree.loop_rows import want
from consilience.reference.tree.multifrontal import multipliers
from consilience.reference.tree.planar import sweep_in_planar, sweep_out_planar
from consilience.reference.tree.plane import Plane
from consilience.reference.tree.projection import SEEN, arrive, begin, note, settle
from consilience.reference.tree.step_control import length, sizes, within
from consilience.reference.tree.taylor_rows import (
    RowSeries,
    begin_rows,
    known_openings,
    known_row_forces,
    knows_rows,
    row_forces,
    row_series,
)
from consilience.reference.tree.taylor_series import (
    MOST,
    Series,
    begin_series,
    joint_forces,
    known_forces,
    known_turns,
    next_order,
    series_arrays,
    sweep_biases,
)

LOOKED_AT = 4
"""Coefficients that say how long a step may be: of a motion that begins at rest every second one is zero."""

PART = 0.01
"""Part of the tolerance that the last term may be: motions then are about as accurate as by the other methods."""

STATUS = {
    **step_control.STATUS,
    LEFT: "the loops pass a pose in which their rows lose rank, and series do not lead through it",
}
"""Meaning of the status that `integrate_taylor` returns: a series with fewer rows would leave the loops open."""


class Scratch(NamedTuple):
    """What a run writes into."""

    series: Series
    rows: RowSeries
    inverse: Array  # (N,) of the pivots
    along: Array  # (N,) joint forces that are known
    torque: Array  # (n_b + 1,) on the links, what is known of them and P does not say
    lam: Array  # (q,) multipliers of an order
    end: Array  # (n_z,) of a step, or a sample
    size: Array  # (5,) of the kinds of components


def has_series(arrays: System, tree_alone: bool) -> bool:
    """Whether a mechanism moves in parallel planes, by gravity alone, its loops closed by joints without rods."""
    plane = arrays.plane
    if plane is None or len(plane.effort) or len(plane.tied):
        return False
    return tree_alone or knows_rows(plane.form)


def taylor_scratch(z: Array, arrays: System, rest: Rest | None) -> Scratch:
    """Scratch of a run from the state z, of a mechanism that has series."""
    plane, n = arrays.plane, len(arrays.tree.free)
    assert plane is not None
    return Scratch(
        series=series_arrays(len(arrays.tree.layout), n),
        rows=row_series(plane.form if rest is not None else plane.form[:0], arrays.tree.length),
        inverse=np.zeros(n),
        along=np.zeros(n),
        torque=np.zeros(len(arrays.tree.link)),
        lam=np.zeros(0 if rest is None else len(rest.value)),
        end=np.empty(len(z)),
        size=np.empty(5),
    )


def order_of(tolerance: float) -> int:
    """Order of the series for a tolerance: steps are longer, and fewer, than with half as many; measured."""
    return min(MOST, math.ceil(1.0 - 0.7 * math.log(tolerance)))


@inlined
def _begin(tree: Tree, rest: Rest | None, plane: Plane, scratch: Scratch, t: float, z: Array) -> None:
    """Factorise what is the same in all orders, and begin the series at a state where `arrive` placed the links."""
    sweep_in_planar(tree.link, tree.free, False)
    begin_series(tree.link, tree.free, scratch.series.link, scratch.series.q, tree.speeds, z, scratch.inverse)
    if rest is not None:
        loops, fronts, rows = rest.loops, rest.fronts, scratch.rows
        want(loops.group, fronts.order, fronts.state, fronts.wanted)
        cut_rows(rest, None, None, plane, t, z)
        factorise_rows(loops, rest.layout, rest.link, rest.free, fronts, None, plane, rest.size[0])
        begin_rows(rows.kind, rows.form, rows.of, rest.link, scratch.series.link)


@inlined
def _order(tree: Tree, rest: Rest | None, plane: Plane, scratch: Scratch, m: int) -> None:
    """Coefficients of order m of the accelerations, and what follows from them."""
    link, free, of, q = tree.link, tree.free, scratch.series.link, scratch.series.q
    known_forces(link, free, of, q, m, scratch.along, scratch.torque)
    if rest is not None:
        fronts, rows = rest.fronts, scratch.rows
        known_row_forces(rows.kind, rows.form, rows.of, fronts.wanted, of, m, scratch.torque)
    known_turns(link, free, of, q, m, scratch.torque)
    sweep_biases(link, free, scratch.along, scratch.inverse)
    if rest is not None:
        fronts, rows = rest.fronts, scratch.rows
        sweep_out_planar(link, free, rest.u, 1.0)
        known_openings(rows.kind, rows.form, rows.of, fronts.wanted, fronts.W, of, m, rest.gamma)
        open_links(rest.loops, fronts, None, plane, link, rest.gamma)
        force_rows(rest.loops, fronts, free)
        multipliers(rest.loops.group, fronts.order, fronts.state, fronts.F, fronts.y, scratch.lam)
    next_order(link, free, of, q, scratch.inverse, m)
    if rest is not None:
        fronts, rows = rest.fronts, scratch.rows
        row_forces(rows.kind, rows.form, rows.of, fronts.wanted, fronts.W, link, of, m, scratch.lam)
    joint_forces(link, free, of, q, m)


@inner
def _largest(kind: Array, q: Array, speeds: int, m: int, size: Array) -> float:
    """Largest scaled component of a coefficient of z; not a number if one of them is not."""
    largest = total = 0.0
    for n in range(q.shape[0]):
        at, rate = abs(q[n, m]) / size[kind[n]], (m + 1.0) * abs(q[n, m + 1]) / size[kind[speeds + n]]
        largest = max(largest, at, rate)
        total += at + rate
    return largest + 0.0 * total


@inner
def _radius(kind: Array, q: Array, speeds: int, order: int, size: Array) -> float:
    """Time in which no term that is known grows beyond the size of its kind; zero if one is not a number."""
    least = np.inf
    for m in range(order - LOOKED_AT + 1, order + 1):
        found = _largest(kind, q, speeds, m, size)
        if not found < np.inf:
            return 0.0
        if found > 0.0:
            least = min(least, found ** (-1.0 / m))
    return least


@inlined
def _rank(rest: Rest | None) -> int:
    """Rows that close the loops from here on."""
    return rest.limit[0] if rest is not None else 0


@inner
def _at(q: Array, speeds: int, order: int, h: float, z: Array) -> None:
    """The state at a time within a step."""
    for n in range(q.shape[0]):
        value, rate = q[n, order + 1], 0.0
        for m in range(order, -1, -1):
            rate = rate * h + value
            value = value * h + q[n, m]
        z[n], z[speeds + n] = value, rate


@inner
def _integrate(
    tree: Tree,
    rest: Rest | None,
    plane: Plane,
    scratch: Scratch,
    z: Array,
    times: Array,
    tolerance: float,
    order: int,
    longest: float,
    motion: Array,
    counters: Array,
) -> int:
    """`integrate_taylor`, compiled for what a mechanism has."""
    t, last, sample = times[0], times[-1], 1
    q, end = scratch.series.q, scratch.end
    allowed = (PART * tolerance) ** (1.0 / order)
    counters[:] = 0
    begin(tree, rest, None, None, plane, t, z)
    note(tree, None, plane, motion[0])
    rank = _rank(rest)
    while sample < times.shape[0]:
        _begin(tree, rest, plane, scratch, t, z)
        for m in range(order):
            _order(tree, rest, plane, scratch, m)
        counters[EVALUATIONS] += order
        sizes(tree.kind, tree.length, z, scratch.size)
        h = _radius(tree.kind, q, tree.speeds, order, scratch.size) * allowed
        if not h > 0.0:
            return 2
        step = length(min(h, longest), last - t)
        if not step >= 1e-14 * max(1.0, abs(t)):
            return 1
        counters[STEPS] += 1
        after = last if step == last - t else t + step
        left = within(times, sample, after)
        for n in range(sample, left):
            _at(q, tree.speeds, order, times[n] - t, end)
            settle(tree, rest, None, None, plane, times[n], end, SEEN)
            note(tree, None, plane, motion[n])
        _at(q, tree.speeds, order, step, z)
        t, sample, seen = after, left, left < times.shape[0] and times[left] == after
        arrive(tree, rest, None, None, plane, t, z, seen)
        if _rank(rest) != rank:
            return LEFT
        if seen:
            note(tree, None, plane, motion[sample])
            sample += 1
    return 0


@kernel
def integrate_taylor(
    run: Run, z: Array, times: Array, tolerance: float, order: int, longest: float, motion: Array, counters: Array
) -> int:
    """Integrate from ``times[0]`` and record the bodies at all sample times; arguments as in `integrate.integrate`.

    Parameters
    ----------
    order : int
        Of the series, MOST at most.

    Returns
    -------
    int
        Key of STATUS.
    """
    on = opened(run)
    tree, rest, plane = on.tree, on.rest, on.plane
    return _integrate(tree, rest, plane, on.scratch, z, times, tolerance, order, longest, motion, counters)
