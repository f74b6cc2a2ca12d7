"""Dormand-Prince 8(5,3), compiled with a formulation, with projection after every step.

Error estimate [Hairer, Norsett and Wanner, section II.10]:

    err = |h| |e5|^2 / sqrt(|e5|^2 + 0.01 |e3|^2),   e5 = sum E5_i k_i,  e3 = sum E3_i k_i,

root mean square of the components, each over the tolerance and the size of its kind: positions over the length of the
mechanism, Euler parameters over one, velocities over the largest of any body. Steps end exactly on the sample times.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model, Workspace
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.projection import project
from consilience.reference.formulations.compiled_choice import derivative
from consilience.reference.integrators.coefficients import DORMAND_PRINCE, STAGES
from consilience.reference.integrators.step_control import LARGEST, SAFETY, factor_of
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.kernel.vectors import assign
from consilience.reference.steppers.motion import RUN

A, B, C = DORMAND_PRINCE.A, DORMAND_PRINCE.b, DORMAND_PRINCE.c
E5, E3 = DORMAND_PRINCE.E


class Dop853Scratch(NamedTuple):
    """Work arrays of an integration."""

    K: Array  # (12, n_b + n_e, 13) derivatives at the stages
    trial: Array  # (n_b + n_e, 13) state of a stage, and the end of the step
    a: Array  # (6 n_b,) accelerations
    size: Array  # (13,) of the columns of a state
    turns: Array  # (n_c,) joint coordinates that elements read, full turns counted (m, rad)
    run: Array  # (1,) of RUN: accepted steps, rejected steps, evaluations


def dop853_scratch(model: Model, y: Array) -> Dop853Scratch:
    """Allocate the work arrays of an integration from the state y."""
    K, trial, a = np.zeros((STAGES, *y.shape)), np.empty_like(y), np.empty(6 * len(model.mass))
    return Dop853Scratch(K, trial, a, np.empty(13), np.zeros(len(model.coordinate)), np.zeros(1, RUN))


@inner
def _sizes(model: Model, y: Array, size: Array) -> None:
    """Compute the size of each column of y, shape (13,), which scales errors."""
    r = v = w = 0.0
    for b in range(model.mass.shape[0]):
        for k in range(3):
            r = max(r, abs(y[b, k]))
            v = max(v, abs(y[b, 7 + k]))
            w = max(w, abs(y[b, 10 + k]))
    for k in range(13):
        size[k] = 1.0
    for k in range(3):
        size[k] = max(r, model.length)
        size[7 + k] = max(v, model.length)
        size[10 + k] = max(w, 1.0)


@inner
def _error(K: Array, h: float, size: Array) -> float:
    """Return the scaled error estimate of a step."""
    e5 = e3 = 0.0
    for b in range(K.shape[1]):
        for c in range(13):
            s5 = s3 = 0.0
            for i in range(STAGES):
                s5 += E5[i] * K[i, b, c]
                s3 += E3[i] * K[i, b, c]
            e5 += (s5 / size[c]) ** 2
            e3 += (s3 / size[c]) ** 2
    if e5 == 0.0 and e3 == 0.0:
        return 0.0
    return abs(h) * e5 / np.sqrt((e5 + 0.01 * e3) * 13 * K.shape[1])


@inner
def _copy(y: Array, into: Array) -> None:
    """Copy a state."""
    for b in range(y.shape[0]):
        assign(into[b], y[b])


@inlined
def _stages(
    formulation: int, model: Model, t: float, y: Array, h: float, ws: Workspace, scratch: Dop853Scratch
) -> None:
    """Evaluate stages 2 to 12 of a step of length h; the end of the step is left in ``scratch.trial``.

    Parameters as in `integrate`; ``scratch.K[0]`` holds stage 1.
    """
    K, trial = scratch.K, scratch.trial
    for i in range(1, STAGES + 1):
        _copy(y, trial)
        for j in range(i):
            weight = h * (A[i, j] if i < STAGES else B[j])
            if weight != 0.0:
                for b in range(y.shape[0]):
                    for c in range(13):
                        trial[b, c] += weight * K[j, b, c]
        if i < STAGES:
            derivative(formulation, model, t + C[i] * h, trial, scratch.turns, ws, scratch.a, K[i])


@kernel
def integrate(
    formulation: int,
    model: Model,
    y: Array,
    times: Array,
    tolerance: float,
    ws: Workspace,
    motion: Array,
    scratch: Dop853Scratch,
) -> int:
    """Integrate from ``times[0]`` and record the motion at all sample times.

    Parameters
    ----------
    formulation : int
        Number in `compiled_choice.FORMULATIONS`.
    model : Model
    y : ndarray, shape (n_b + n_e, 13)
        Initial state; overwritten by the last one.
    times : ndarray, shape (n_t,), s
    tolerance : float
        Bound on the scaled local error of a step.
    ws : Workspace
    motion : ndarray, shape (n_t, n_b + n_e, 13)
        Overwritten.
    scratch : Dop853Scratch
        With the turns at the first state, which are updated; its run counts steps and evaluations.

    Returns
    -------
    int
        Key of `STATUS`.
    """
    K, trial, a, size, turns, run = scratch.K, scratch.trial, scratch.a, scratch.size, scratch.turns, scratch.run[0]
    _copy(y, motion[0])
    t = times[0]
    h, finite = 1e-2 * (times[-1] - times[0]) / max(1, times.shape[0] - 1), True
    derivative(formulation, model, t, y, turns, ws, a, K[0])
    for n in range(1, times.shape[0]):
        while t < times[n]:
            remaining = times[n] - t
            # halve a remainder of less than two steps, to avoid a very short last step
            step = remaining if h >= remaining else min(h, 0.5 * remaining) if h > 0.5 * remaining else h
            if not step >= 1e-14 * max(1.0, abs(t)):
                return 1 if finite else 2
            _stages(formulation, model, t, y, step, ws, scratch)
            run.evaluations += STAGES
            _sizes(model, y, size)
            error = _error(K, step, size) / tolerance
            finite = np.isfinite(error)  # an overflow in a stage is a failure only at the shortest step
            factor = factor_of(error, SAFETY, LARGEST)
            if not error <= 1.0:
                run.rejected += 1
                h = step * min(1.0, factor)
                continue
            run.steps += 1
            _copy(trial, y)
            t = times[n] if step == remaining else t + step
            project(model, t, y, turns, ws)
            count_turns(model, y, ws, turns)
            derivative(formulation, model, t, y, turns, ws, a, K[0])
            h = step * factor if step == h else max(h, step * factor)
        _copy(y, motion[n])
    return 0
