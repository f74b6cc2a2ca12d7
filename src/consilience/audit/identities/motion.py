"""Constraints along a motion: residuals of ``g = 0`` and of ``Q v = nu`` at the samples of a trajectory.

The constraints hold if the residual is rounding: that of one evaluation for each step, because roundings of steps may
add up. A larger residual may be an error of the steps, which vanishes at step zero. From the finest levels with
residuals r1, r2, r3, whose steps (or tolerances) have the ratio q, and an integrator of order P (tolerances: 1):

- limit ``r3 + (r3 - r2) / (q^P - 1)`` [Richardson 1911];
- band ``F |r3 - r2| / (q^P - 1)``, F = 1.25 where the observed order is within 0.5 of P, else 3 [grid convergence
  index, Roache 1994].

A constraint that is ignored or soft has a limit beyond the band.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from consilience.audit.identities.asking import Asker
from consilience.audit.identities.equations import Equations, largest
from consilience.audit.identities.result import NotApplicableError, Residual, relative
from consilience.engine import Method, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism, State, constraint_rates, constraint_residual, count_turns

SAFETY = (1.25, 3.0)
"""Factors of the band where the observed order is as declared, and where it is not [Roache 1994]."""

ORDER_WINDOW = 0.5

SAMPLES = 20
"""Sample intervals of a case's trajectory that are checked: drift shows from the start."""


def drift_of(mechanism: Mechanism, answer: TrajectoryAnswer) -> tuple[Array, Array]:
    """Return the residuals of positions and of velocities at the samples, each shape (n_t, rows).

    Residuals of positions are in characteristic lengths or rad, of velocities relative to the largest velocity.
    """
    states = [_state(answer, n) for n in range(len(answer.time))]
    equations = [Equations(mechanism, state) for state in states]
    fastest = max(eq.speed for eq in equations) or 1.0
    positions, velocities, angles = [], [], dict[str, float]()
    for t, state, eq in zip(answer.time - answer.time[0], states, equations, strict=True):
        angles = count_turns(mechanism, state, angles)
        norms = np.linalg.norm(eq.Q, axis=1)
        g = constraint_residual(mechanism, state, float(t), angles)
        positions.append(g / (norms[: len(g)] * eq.length))
        velocities.append((eq.Q @ eq.velocity - constraint_rates(mechanism, float(t))) / (norms * fastest))
    return np.array(positions), np.array(velocities)


def _state(answer: TrajectoryAnswer, n: int) -> State:
    quat = answer.quat_WB[n] / np.linalg.norm(answer.quat_WB[n], axis=-1, keepdims=True)
    return State(answer.p_WB[n], quat, answer.v_WB_W[n], answer.w_WB_W[n])


def measure_drift(
    asker: Asker, mechanism: Mechanism, start: State, times: Array, method: Method
) -> tuple[Residual, Residual]:
    """Integrate at the finest levels and return the residuals of positions and of velocities.

    Parameters
    ----------
    asker : Asker
    mechanism : Mechanism
    start : State
        At the first time.
    times : ndarray, shape (n_t,), s
        Uniform samples.
    method : Method

    Raises
    ------
    NotApplicableError
        Nothing is constrained.
    UnansweredError
    """
    if mechanism.constraint_count() == 0:
        raise NotApplicableError("there are no constraints")
    sample = float(times[1] - times[0])
    steps = ([sample / n for n in method.substeps] or list(method.tolerances))[-3:]  # the finest, coarse to fine
    found = [drift_of(mechanism, asker.trajectory(mechanism, start, times, method, step)) for step in steps]
    order = (method.order or 1) if method.substeps else 1
    count = (times[-1] - times[0]) / steps[-1] if method.substeps else 1.0
    guard = Equations(mechanism, start).guard * float(count)
    positions, velocities = (limit_of_levels(residuals, steps, order, guard) for residuals in zip(*found, strict=True))
    return positions, velocities


def limit_of_levels(residuals: Sequence[Array], steps: Sequence[float], order: int, guard: float) -> Residual:
    """Extrapolate the residuals of the levels to step zero; the bar is their band and `guard`, the rounding."""
    finest = largest(residuals[-1])
    if finest <= guard or len(steps) < 2:
        return relative(finest, guard, 1.0, f"{finest:.1e} at {steps[-1]:.3g}")
    step = (residuals[-1] - residuals[-2]) / ((steps[-2] / steps[-1]) ** order - 1.0)
    observed = _observed_order(residuals, steps)
    factor = SAFETY[0] if abs(observed - order) <= ORDER_WINDOW else SAFETY[1]
    remark = f"limit of {largest(residuals[-2]):.1e} at {steps[-2]:.3g} and {finest:.1e} at {steps[-1]:.3g}"
    return relative(
        largest(residuals[-1] + step), guard + factor * largest(step), 1.0, f"{remark}, order {observed:.2g}"
    )


def _observed_order(residuals: Sequence[Array], steps: Sequence[float]) -> float:
    """Return the order of the differences of three levels; NaN of two levels, or of equal levels."""
    if len(steps) < 3:
        return float("nan")
    first, second = largest(residuals[-2] - residuals[-3]), largest(residuals[-1] - residuals[-2])
    if min(first, second) == 0.0:
        return float("nan")
    return float(np.log(first / second) / np.log(steps[-2] / steps[-1]))
