"""Projection of a state onto ``g = 0`` and ``Q v = nu`` in the mass metric ("assembling during integration" [MASS]).

Positions: Newton steps (dr, rotation vector in body axes) of least M-norm with ``Q step = -g``. Velocities: the change
dv of least M-norm with ``Q (v + dv) = nu``. Non-holonomic rows constrain velocities only.

The rank is determined here, where the constraints hold, and is the upper limit ``ws.limit`` in the stages of the next
step: off the manifold, dependent rows look independent by the error of the stage.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.mass_metric import factorise, solve_factor_transposed
from consilience.reference.bodies.motion import rotations
from consilience.reference.kernel.compiled import inner, kernel
from consilience.reference.kernel.factorisation import least_norm

_POSITION_STEPS = 3
_PASSING = 1e-4
"""The smallest pivot counts as passing through zero below this fraction of its largest value so far."""
_PASSING_VIOLATION = 1e-11
"""Largest violation, over the length of the mechanism, with which rows may be left out near a singular pose."""


@kernel
def normalise(y: Array, count: int) -> None:
    """Divide the Euler parameters of the first `count` rows by their norm."""
    for b in range(count):
        n = np.sqrt(y[b, 3] ** 2 + y[b, 4] ** 2 + y[b, 5] ** 2 + y[b, 6] ** 2)
        for k in range(3, 7):
            y[b, k] /= n


@inner
def move_bodies(y: Array, step: Array) -> None:
    """Move all bodies by a small step: ``r += dr``, ``p <- p (1, phi' / 2)``, normalised."""
    for b in range(step.shape[0] // 6):
        for k in range(3):
            y[b, k] += step[6 * b + k]
        h1, h2, h3 = 0.5 * step[6 * b + 3], 0.5 * step[6 * b + 4], 0.5 * step[6 * b + 5]
        e0, e1, e2, e3 = y[b, 3], y[b, 4], y[b, 5], y[b, 6]
        y[b, 3] = e0 - e1 * h1 - e2 * h2 - e3 * h3
        y[b, 4] = e1 + e0 * h1 + e2 * h3 - e3 * h2
        y[b, 5] = e2 + e0 * h2 + e3 * h1 - e1 * h3
        y[b, 6] = e3 + e0 * h3 + e1 * h2 - e2 * h1
    normalise(y, step.shape[0] // 6)


@inner
def _largest(x: Array) -> float:
    """Return the largest magnitude in x."""
    found = 0.0
    for v in x:
        found = max(found, abs(v))
    return found


@inner
def effective_rank(B: Array, best: Array, rank: int, violation: float) -> int:
    """Return the rank for the steps until the next projection, from the numerical rank of the factors in B.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Near that pose the rows that
    become dependent determine accelerations with large rounding errors only. These rows are left out there, as in the
    pose itself, while the motion satisfies them (`violation`); otherwise they are kept.

    best: largest rank so far and the largest value of its smallest pivot, updated.
    """
    if rank == 0:
        return rank
    least = abs(B[rank - 1, rank - 1])
    if rank > best[0].rank:
        best[0].rank, best[0].pivot = rank, least
    elif rank == best[0].rank:
        best[0].pivot = max(best[0].pivot, least)
    if violation > _PASSING_VIOLATION:
        return rank
    while rank > 1 and abs(B[rank - 1, rank - 1]) < _PASSING * best[0].pivot:
        rank -= 1
    return rank


@kernel
def project(model: Model, t: float, y: Array, turns: Array, ws: Workspace) -> None:
    """Project a state onto the constraints in place: positions by Newton's method to rounding, then velocities.

    Parameters as in `constraints.evaluate`; sets ``ws.limit`` and ``ws.best``.
    """
    count = model.mass.shape[0]
    normalise(y, count)
    if ws.Q.shape[0] == 0:
        return
    rows = ws.Q.shape[0]
    holonomic = rows - 2 * model.rolling.shape[0] - model.skate.shape[0]
    last = False
    for step in range(_POSITION_STEPS + 1):
        rotations(y, ws.A)
        constraints.evaluate(model, t, y, turns, ws)
        if last or step == _POSITION_STEPS or _largest(ws.value) <= 2e-16 * max(1.0, model.length):
            break
        ws.Q[holonomic:, :] = 0.0
        rank = factorise(model, ws)
        for n in range(ws.value.shape[0]):
            ws.value[n] = -ws.value[n]
        least_norm(ws.B, ws.tau, ws.pivot, rank, ws.value, ws.z)
        solve_factor_transposed(model, ws.z)
        last = _largest(ws.z) < 1e-9  # then the change of Q does not matter for the velocities
        move_bodies(y, ws.z)
    ws.limit[0] = rows
    violation = _largest(ws.value[:holonomic]) / max(1.0, model.length)
    ws.limit[0] = effective_rank(ws.B, ws.best, factorise(model, ws), violation)
    for row in range(rows):
        s = ws.rate[row]
        for b in range(count):
            for k in range(6):
                s -= ws.Q[row, 6 * b + k] * y[b, 7 + k]
        ws.value[row] = s
    least_norm(ws.B, ws.tau, ws.pivot, ws.limit[0], ws.value, ws.z)
    solve_factor_transposed(model, ws.z)
    for b in range(count):
        for k in range(6):
            y[b, 7 + k] += ws.z[6 * b + k]
