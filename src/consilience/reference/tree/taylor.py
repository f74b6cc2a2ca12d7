"""Taylor's method for planar mechanisms in the state z, with projection after every step.

The order p follows from the tolerance, the step h from the last coefficients [Jorba and Zou, A software package for
the numerical integration of ODEs by means of high-order Taylor methods, Experimental Mathematics 14, 2005, 99-117,
section 3]: with |z_m| the largest scaled component of coefficient m,

    h = (a tolerance)^(1/p) min |z_m|^(-1/m),    m = p - 3 ... p,

so that the last term of the series is a small part a of the tolerance. No step is rejected, and samples are taken from
the polynomial of a step.

The linear equations of an order cost more than its convolutions. Where all orders cost the same, ``p tolerance^(-1/p)``
is least for ``p = -log(tolerance)``, twice the order of the source, whose orders cost in proportion to their number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators.step_control import UNSUITABLE
from consilience.reference.kernel.compiled import fused, inlined, inner, kernel
from consilience.reference.kernel.operation import Operation, array_of
from consilience.reference.steppers.driver import CompiledStepper
from consilience.reference.steppers.motion import ATTEMPT, INTERPOLATE, PREPARE, MotionArrays, component_sizes
from consilience.reference.tree.arrays import LoopClosure, PlanarArrays, TreeArrays, TreeSystem
from consilience.reference.tree.dynamics import factorise_rows
from consilience.reference.tree.either import evaluate_rows, loop_acceleration_residual
from consilience.reference.tree.loop_rows import mark_active_rows
from consilience.reference.tree.multifrontal import least_norm_forces, multipliers
from consilience.reference.tree.planar import place_planar_links, planar_inward_sweep, planar_outward_sweep
from consilience.reference.tree.records import LARGEST_ORDER
from consilience.reference.tree.system import SystemRecord
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

LOWEST_ORDER = 8
"""Order at which a series ends that reaches the end of the motion already, as that of a fall does."""

LAST_TERM = 0.01
"""The last term of the series, as part of the tolerance; motions are then about as accurate as by other integrators."""


class TaylorArrays(NamedTuple):
    """Record of the kernels of Taylor's method."""

    motion: MotionArrays
    tree: TreeArrays
    closure: LoopClosure | None
    planar: PlanarArrays
    series: Series
    rows: RowSeries
    inverse: Array  # (N,) reciprocals of the pivots D
    along: Array  # (N,) known joint forces
    torque: Array  # (n_b + 1,) known torques on the links that P does not contain
    lam: Array  # (q,) multipliers of an order
    rank: Array  # (1,) rank of the rows in the first state
    order: Array  # (1,) order of the series of the step


def has_series(arrays: TreeSystem, tree_alone: bool) -> bool:
    """Return whether a mechanism is planar, moved by gravity alone, its loops closed by joints other than rods."""
    planar = arrays.planar
    if planar is None or len(planar.force_table) or len(planar.driven):
        return False
    return tree_alone or knows_rows(planar.row_table)


def taylor_arrays(motion: MotionArrays, system: SystemRecord) -> TaylorArrays:
    """Return the record for a motion of a mechanism that has series."""
    tree, closure, _, _, planar, _ = system
    assert planar is not None
    n = len(tree.free)
    return TaylorArrays(
        *(motion, tree, closure, planar),
        series=series_arrays(len(tree.layout), n),
        rows=row_series(planar.row_table if closure is not None else planar.row_table[:0], tree.length),
        inverse=np.zeros(n),
        along=np.zeros(n),
        torque=np.zeros(len(tree.link)),
        lam=np.zeros(0 if closure is None else len(closure.value)),
        rank=np.zeros(1, dtype=np.int64),
        order=np.zeros(1, dtype=np.int64),
    )


@kernel
def order_for(tolerance: float) -> int:
    """Return the order of the series for a tolerance, LOWEST_ORDER where that reaches the end of the motion."""
    return int(min(LARGEST_ORDER, np.ceil(1.0 - np.log(tolerance))))


@fused
def _begin_step(
    tree: TreeArrays, closure: LoopClosure | None, planar: PlanarArrays, arrays: TaylorArrays, t: float, z: Array
) -> None:
    """Factorise the matrices common to all orders, and begin the series."""
    place_planar_links(tree.link, tree.free, z, z[tree.first_speed :])
    planar_inward_sweep(tree.link, tree.free, False)
    begin_series(tree.link, tree.free, arrays.series.link, arrays.series.q, tree.first_speed, z, arrays.inverse)
    if closure is not None:
        loops, qr, rows = closure.loops, closure.qr, arrays.rows
        mark_active_rows(loops.group, qr.order, qr.state, qr.active)
        evaluate_rows(closure, None, None, planar, t, z)
        factorise_rows(closure, None, planar)
        begin_rows(rows.kind, rows.row_table, rows.coef, closure.link, arrays.series.link)


@fused
def _solve_order(
    tree: TreeArrays, closure: LoopClosure | None, planar: PlanarArrays, arrays: TaylorArrays, m: int
) -> None:
    """Solve for the accelerations of order m, and compute the coefficients that follow from them."""
    link, free, coef, q = tree.link, tree.free, arrays.series.link, arrays.series.q
    known_forces(link, free, coef, q, m, arrays.along, arrays.torque)
    if closure is not None:
        qr, rows = closure.qr, arrays.rows
        known_row_forces(rows.kind, rows.row_table, rows.coef, qr.active, coef, m, arrays.torque)
    known_rotations(link, free, coef, q, m, arrays.torque)
    sweep_biases(link, free, arrays.along, arrays.inverse)
    if closure is not None:
        qr, rows = closure.qr, arrays.rows
        planar_outward_sweep(link, free, closure.u, 1.0)
        known_row_accelerations(rows.kind, rows.row_table, rows.coef, qr.active, qr.W, coef, m, closure.gamma)
        loop_acceleration_residual(closure, None, planar)
        least_norm_forces(closure)
        multipliers(closure.loops.group, qr.order, qr.state, qr.F, qr.y, arrays.lam)
    next_order(link, free, coef, q, arrays.inverse, m)
    if closure is not None:
        qr, rows = closure.qr, arrays.rows
        row_forces(rows, qr.active, qr.W, link, coef, m, arrays.lam)
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


@inlined
def _prepare(arrays: TaylorArrays, t: float, z: Array) -> None:
    """Compute the series at a new state, and propose a step."""
    motion, tree, closure, planar = arrays.motion, arrays.tree, arrays.closure, arrays.planar
    run = motion.run[0]
    if run.h == 0.0:
        arrays.rank[0] = _rank(closure)
    elif arrays.rank[0] != _rank(closure):
        run.status = UNSUITABLE
        return
    _begin_step(tree, closure, planar, arrays, t, z)
    component_sizes(motion.kind, motion.length, z, motion.size)
    order, highest = 0, order_for(run.tolerance)
    for end in (min(LOWEST_ORDER, highest), highest):
        for m in range(order, end):
            _solve_order(tree, closure, planar, arrays, m)
        order = end
        radius = _radius(motion.kind, arrays.series.q, tree.first_speed, order, motion.size)
        run.h = radius * (LAST_TERM * run.tolerance) ** (1.0 / order)
        if run.h >= run.span:
            break
    arrays.order[0] = order
    run.evaluations += order
    if not run.h > 0.0:
        run.status = 2


@Operation
def step(arrays: TaylorArrays, request: int, t: float, z: Array, out: Array) -> float:
    """Answer the requests of the driver: see `motion.PREPARE`. No step is rejected; the series is the dense output.

    Parameters
    ----------
    arrays : TaylorArrays
    request, t, z, out : see `motion.ask`
    """
    run = arrays.motion.run[0]
    if request == PREPARE:
        _prepare(arrays, t, array_of(z))
    elif request != INTERPOLATE:
        run.factor = 1.0
        after = run.step if request == ATTEMPT else t
        _evaluate_series(arrays.series.q, arrays.tree.first_speed, arrays.order[0], after, array_of(out))
    return 0.0


STEPPERS = {"taylor": CompiledStepper(taylor_arrays, step)}
"""The method by its name; for mechanisms that have series."""
