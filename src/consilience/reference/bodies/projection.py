"""Projection of a state back to ``g = 0`` and ``Q v = nu`` in the mass metric ("assembling during integration" [MASS]).

The step (dr, rotation vector in body axes) of least M-norm with ``Q step = -g``; then the change of the velocities of
least M-norm with ``Q (v + dv) = nu``. Non-holonomic rows hold velocities only.

The rank of the constraints is found where they hold, that is here, and kept in ``ws.limit`` for the stages of the next
step, which are off the manifold by their error: rows that depend on others show it only to that error there.
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
"""Part of its largest value at which the least independent pivot counts as passing through zero."""
_PASSING_VIOLATION = 1e-11
"""Violation (over the length of the mechanism) that rows left out on the way through a singular pose may have."""


@kernel
def normalise(y: Array, count: int) -> None:
    """Divide the Euler parameters of the first `count` rows by their norm."""
    for b in range(count):
        n = np.sqrt(y[b, 3] ** 2 + y[b, 4] ** 2 + y[b, 5] ** 2 + y[b, 6] ** 2)
        for k in range(3, 7):
            y[b, k] /= n


@inner
def _move(y: Array, step: Array) -> None:
    """Displace all bodies: ``r += dr``, ``p <- p * exp(phi'/2)``."""
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
    found = 0.0
    for v in x:
        found = max(found, abs(v))
    return found


@inner
def rank_to_work_with(B: Array, best: Array, rank: int, violation: float) -> int:
    """Rank to work with until the next projection, from the numerical one of the factors in B.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Close to it they have the
    full rank still, but what they say of the accelerations drowns in rounding. There the rows that are about to become
    dependent are left out, as in the pose itself: the motion so far has satisfied them, and does so on the way
    through. Where it does not, in a linkage that comes near such a pose and turns, they are taken back.
    """
    if rank == 0:
        return rank
    least = abs(B[rank - 1, rank - 1])
    if rank > best[0]:
        best[0], best[1] = rank, least
    elif rank == best[0]:
        best[1] = max(best[1], least)
    if violation > _PASSING_VIOLATION:
        return rank
    while rank > 1 and abs(B[rank - 1, rank - 1]) < _PASSING * best[1]:
        rank -= 1
    return rank


@kernel
def project(model: Model, t: float, y: Array, turns: Array, ws: Workspace) -> None:
    """Project a state in place: positions by Newton's method until rounding is reached, then velocities."""
    count = model.mass.shape[0]
    normalise(y, count)
    if ws.Q.shape[0] == 0:
        return
    rows = ws.Q.shape[0]
    held = rows - 2 * model.rolling_body.shape[0] - model.skate_body.shape[0]
    last = False
    for step in range(_POSITION_STEPS + 1):
        rotations(y, ws.A)
        constraints.evaluate(model, t, y, turns, ws)
        if last or step == _POSITION_STEPS or _largest(ws.value) <= 2e-16 * max(1.0, model.length):
            break
        ws.Q[held:, :] = 0.0
        rank = factorise(model, ws)
        for n in range(ws.value.shape[0]):
            ws.value[n] = -ws.value[n]
        least_norm(ws.B, ws.tau, ws.pivot, rank, ws.value, ws.z)
        solve_factor_transposed(model, ws.z)
        last = _largest(ws.z) < 1e-9  # then Q changes by less than rounding of the velocities asks for
        _move(y, ws.z)
    ws.limit[0] = rows
    violation = _largest(ws.value[:held]) / max(1.0, model.length)
    ws.limit[0] = rank_to_work_with(ws.B, ws.best, factorise(model, ws), violation)
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
