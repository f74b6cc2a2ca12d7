"""Taylor's method for planar mechanisms in the state z, with projection after every step.

The order p follows from the tolerance, the step h from the last coefficients [Jorba and Zou, A software package for
the numerical integration of ODEs by means of high-order Taylor methods, Experimental Mathematics 14, 2005, 99-117,
section 3]: with |z_m| the largest scaled component of coefficient m,

    h = (a tolerance)^(1/p) min |z_m|^(-1/m),    m = p - 3 ... p,

so that the last term of the series is a small part a of the tolerance. No step is rejected, and samples are taken from
the polynomial of a step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators import step_control
from consilience.reference.integrators.step_control import EVALUATIONS, STEPS
from consilience.reference.kernel.compiled import fused, inner, kernel
from consilience.reference.kernel.mechanism_record import fields_of
from consilience.reference.tree.arrays import KernelArguments, LoopClosure, PlanarArrays, TreeArrays, TreeSystem
from consilience.reference.tree.dynamics import factorise_rows
from consilience.reference.tree.either import evaluate_rows, loop_acceleration_residual
from consilience.reference.tree.explicit_rk import UNSUITABLE
from consilience.reference.tree.loop_rows import mark_active_rows
from consilience.reference.tree.multifrontal import least_norm_forces, multipliers
from consilience.reference.tree.planar import planar_inward_sweep, planar_outward_sweep
from consilience.reference.tree.projection import AT_SAMPLE
from consilience.reference.tree.records import LARGEST_ORDER
from consilience.reference.tree.step_control import component_sizes, next_sample, step_length
from consilience.reference.tree.system import begin_motion, end_step, project_state, record_sample
from consilience.reference.tree.taylor_rows import (
    RowSeries,
    begin_rows,
    known_row_accelerations,
    known_row_forces,
    knows_rows,
    row_forces,
    row_series,
)
from consilience.reference.tree.taylor_series import (
    Series,
    begin_series,
    joint_forces,
    known_forces,
    known_rotations,
    next_order,
    series_arrays,
    sweep_biases,
)

RADIUS_COEFFICIENTS = 4
"""Number of last coefficients that determine the step: in a motion from rest every second coefficient is zero."""

LAST_TERM = 0.01
"""The last term of the series, as part of the tolerance; motions are then about as accurate as by other integrators."""

STATUS = {
    **step_control.STATUS,
    UNSUITABLE: "the loops pass a pose in which their rows lose rank, and series do not lead through it",
}
"""Meaning of the status of `integrate_taylor`. A series with fewer rows would leave the loops open."""


class TaylorScratch(NamedTuple):
    """Work arrays of an integration."""

    series: Series
    rows: RowSeries
    inverse: Array  # (N,) reciprocals of the pivots D
    along: Array  # (N,) known joint forces
    torque: Array  # (n_b + 1,) known torques on the links that P does not contain
    lam: Array  # (q,) multipliers of an order
    end: Array  # (n_z,) state at the end of a step, or at a sample
    size: Array  # (5,) sizes of the kinds of components


def has_series(arrays: TreeSystem, tree_alone: bool) -> bool:
    """Return whether a mechanism is planar, moved by gravity alone, its loops closed by joints other than rods."""
    planar = arrays.planar
    if planar is None or len(planar.force_table) or len(planar.driven):
        return False
    return tree_alone or knows_rows(planar.row_table)


def taylor_scratch(z: Array, arrays: TreeSystem, closure: LoopClosure | None) -> TaylorScratch:
    """Return work arrays for a motion from the state z of a mechanism that has series."""
    planar, n = arrays.planar, len(arrays.tree.free)
    assert planar is not None
    return TaylorScratch(
        series=series_arrays(len(arrays.tree.layout), n),
        rows=row_series(planar.row_table if closure is not None else planar.row_table[:0], arrays.tree.length),
        inverse=np.zeros(n),
        along=np.zeros(n),
        torque=np.zeros(len(arrays.tree.link)),
        lam=np.zeros(0 if closure is None else len(closure.value)),
        end=np.empty(len(z)),
        size=np.empty(5),
    )


def order_for(tolerance: float) -> int:
    """Return the order of the series for a tolerance."""
    return min(LARGEST_ORDER, math.ceil(1.0 - 0.7 * math.log(tolerance)))


@fused
def _begin_step(
    tree: TreeArrays, closure: LoopClosure | None, planar: PlanarArrays, scratch: TaylorScratch, t: float, z: Array
) -> None:
    """Factorise the matrices common to all orders, and begin the series, at a state where the links are placed."""
    planar_inward_sweep(tree.link, tree.free, False)
    begin_series(tree.link, tree.free, scratch.series.link, scratch.series.q, tree.first_speed, z, scratch.inverse)
    if closure is not None:
        loops, qr, rows = closure.loops, closure.qr, scratch.rows
        mark_active_rows(loops.group, qr.order, qr.state, qr.active)
        evaluate_rows(closure, None, None, planar, t, z)
        factorise_rows(closure, None, planar)
        begin_rows(rows.kind, rows.row_table, rows.coef, closure.link, scratch.series.link)


@fused
def _solve_order(
    tree: TreeArrays, closure: LoopClosure | None, planar: PlanarArrays, scratch: TaylorScratch, m: int
) -> None:
    """Solve for the accelerations of order m, and compute the coefficients that follow from them."""
    link, free, coef, q = tree.link, tree.free, scratch.series.link, scratch.series.q
    known_forces(link, free, coef, q, m, scratch.along, scratch.torque)
    if closure is not None:
        qr, rows = closure.qr, scratch.rows
        known_row_forces(rows.kind, rows.row_table, rows.coef, qr.active, coef, m, scratch.torque)
    known_rotations(link, free, coef, q, m, scratch.torque)
    sweep_biases(link, free, scratch.along, scratch.inverse)
    if closure is not None:
        qr, rows = closure.qr, scratch.rows
        planar_outward_sweep(link, free, closure.u, 1.0)
        known_row_accelerations(rows.kind, rows.row_table, rows.coef, qr.active, qr.W, coef, m, closure.gamma)
        loop_acceleration_residual(closure, None, planar)
        least_norm_forces(closure)
        multipliers(closure.loops.group, qr.order, qr.state, qr.F, qr.y, scratch.lam)
    next_order(link, free, coef, q, scratch.inverse, m)
    if closure is not None:
        qr, rows = closure.qr, scratch.rows
        row_forces(rows, qr.active, qr.W, link, coef, m, scratch.lam)
    joint_forces(link, free, coef, q, m)


@inner
def _largest(kind: Array, q: Array, first_speed: int, m: int, size: Array) -> float:
    """Return the largest scaled component of a coefficient of z; not a number if one component is not."""
    largest = total = 0.0
    for n in range(q.shape[0]):
        at, rate = abs(q[n, m]) / size[kind[n]], (m + 1.0) * abs(q[n, m + 1]) / size[kind[first_speed + n]]
        largest = max(largest, at, rate)
        total += at + rate
    return largest + 0.0 * total


@inner
def _radius(kind: Array, q: Array, first_speed: int, order: int, size: Array) -> float:
    """Return the time at which the last known terms reach the size of their kind; zero if a term is not a number."""
    least = np.inf
    for m in range(order - RADIUS_COEFFICIENTS + 1, order + 1):
        found = _largest(kind, q, first_speed, m, size)
        if not found < np.inf:
            return 0.0
        if found > 0.0:
            least = min(least, found ** (-1.0 / m))
    return least


@inner
def _rank(closure: LoopClosure | None) -> int:
    """Return the rank of the rows that close the loops."""
    return closure.rank_limit[0] if closure is not None else 0


@inner
def _evaluate_series(q: Array, first_speed: int, order: int, h: float, z: Array) -> None:
    """Evaluate the state at a time h after the start of the series."""
    for n in range(q.shape[0]):
        value, rate = q[n, order + 1], 0.0
        for m in range(order, -1, -1):
            rate = rate * h + value
            value = value * h + q[n, m]
        z[n], z[first_speed + n] = value, rate


@inner
def _integrate(
    system: KernelArguments,
    z: Array,
    times: Array,
    tolerance: float,
    order: int,
    longest: float,
    motion: Array,
    counters: Array,
) -> int:
    """Integrate as `integrate_taylor`, compiled for each combination of arrays that are None."""
    tree, closure, planar, scratch = system.tree, system.closure, system.planar, system.scratch
    t, last, sample = times[0], times[-1], 1
    q, end = scratch.series.q, scratch.end
    allowed = (LAST_TERM * tolerance) ** (1.0 / order)
    begin_motion(system, t, z, motion, counters)
    rank = _rank(closure)
    while sample < times.shape[0]:
        _begin_step(tree, closure, planar, scratch, t, z)
        for m in range(order):
            _solve_order(tree, closure, planar, scratch, m)
        counters[EVALUATIONS] += order
        component_sizes(tree.kind, tree.length, z, scratch.size)
        h = _radius(tree.kind, q, tree.first_speed, order, scratch.size) * allowed
        if not h > 0.0:
            return 2
        step = step_length(min(h, longest), last - t)
        if not step >= 1e-14 * max(1.0, abs(t)):
            return 1
        counters[STEPS] += 1
        after = last if step == last - t else t + step
        left = next_sample(times, sample, after)
        for n in range(sample, left):
            _evaluate_series(q, tree.first_speed, order, times[n] - t, end)
            project_state(system, times[n], end, AT_SAMPLE)
            record_sample(system, motion[n])
        _evaluate_series(q, tree.first_speed, order, step, z)
        t, sample, at_sample = after, left, left < times.shape[0] and times[left] == after
        end_step(system, t, z, at_sample)
        if _rank(closure) != rank:
            return UNSUITABLE
        if at_sample:
            record_sample(system, motion[sample])
            sample += 1
    return 0


@kernel
def integrate_taylor(
    run: KernelArguments,
    z: Array,
    times: Array,
    tolerance: float,
    order: int,
    longest: float,
    motion: Array,
    counters: Array,
) -> int:
    """Integrate from ``times[0]`` and record the bodies at all sample times.

    Parameters
    ----------
    run, z, times, tolerance, longest, motion, counters : see `explicit_rk.integrate`
    order : int
        Order of the series, at most LARGEST_ORDER.

    Returns
    -------
    int
        Key of STATUS.
    """
    return _integrate(fields_of(run), z, times, tolerance, order, longest, motion, counters)
