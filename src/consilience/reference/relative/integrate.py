"""Adaptive explicit Runge-Kutta method of order 8 in the state z, with projection after every step.

Step control as in `integrators.dop853`, every component scaled by the tolerance times the size of its kind.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from consilience.reference.integrators.coefficients import E3, E5, STAGES, A, B, C
from consilience.reference.integrators.dop853 import EVALUATIONS, LARGEST, REJECTED, SAFETY, SMALLEST, STEPS
from consilience.reference.model import Model
from consilience.reference.relative.dynamics import derivative, project, remember
from consilience.reference.relative.kinematics import orient
from consilience.reference.relative.model import Links, Scratch
from consilience.reference.workspace import Workspace
from consilience.spatial import Array


@njit(cache=True, error_model="numpy")
def sizes(kind: Array, model_length: float, z: Array, size: Array) -> None:
    """Size of each kind of component, shape (5,)."""
    size[:] = 0.0
    for n in range(z.shape[0]):
        size[kind[n]] = max(size[kind[n]], abs(z[n]))
    size[0] = max(size[0], model_length)
    size[1] = 1.0
    size[2] = max(size[2], size[3] * model_length, model_length)
    size[3] = max(size[3], 1.0)
    size[4] = max(size[4], 1.0)


@njit(cache=True, error_model="numpy")
def _error(kind: Array, K: Array, h: float, size: Array) -> float:
    """Scaled error estimate of a step."""
    e5 = e3 = 0.0
    count = K.shape[1]
    for n in range(count):
        s5 = s3 = 0.0
        for i in range(STAGES):
            s5 += E5[i] * K[i, n]
            s3 += E3[i] * K[i, n]
        scale = size[kind[n]]
        e5 += (s5 / scale) ** 2
        e3 += (s3 / scale) ** 2
    if e5 == 0.0 and e3 == 0.0:
        return 0.0
    return abs(h) * e5 / np.sqrt((e5 + 0.01 * e3) * count)


@njit(cache=True, error_model="numpy")
def _stage(z: Array, K: Array, h: float, i: int, trial: Array) -> None:
    """State at which stage i is evaluated; behind the last one: the end of the step."""
    trial[:] = z
    for j in range(i):
        weight = h * (A[i, j] if i < STAGES else B[j])
        if weight != 0.0:
            for n in range(z.shape[0]):
                trial[n] += weight * K[j, n]


@njit(cache=True, error_model="numpy")
def integrate(
    links: Links,
    model: Model,
    cut: Model,
    z: Array,
    times: Array,
    tolerance: float,
    memory: Array,
    ws: Scratch,
    rows: Workspace,
    motion: Array,
    counters: Array,
) -> int:
    """Integrate from ``times[0]`` and record the bodies at all sample times; arguments as in `integrators.dop853`.

    Parameters
    ----------
    z : ndarray, shape (n_z,)
        Initial state; overwritten by the last.
    motion : ndarray, shape (n_t, n_b + n_e, 13)
        Overwritten.

    Returns
    -------
    int
        Key of `integrators.dop853.STATUS`.
    """
    K = np.zeros((STAGES, z.shape[0]))
    trial, size = np.empty_like(z), np.empty(5)
    counters[:] = 0
    project(links, model, cut, times[0], z, memory, ws, rows)
    orient(ws.A, ws.y)
    motion[0] = ws.y
    t = times[0]
    h = 1e-2 * (times[-1] - times[0]) / max(1, times.shape[0] - 1)
    first = 0  # the first stage is the last state's, and still known after a step that is rejected
    for sample in range(1, times.shape[0]):
        while t < times[sample]:
            remaining = times[sample] - t
            # a remainder a little longer than the step is halved, so that no sliver of a step is left
            step = remaining if h >= remaining else min(h, 0.5 * remaining) if h > 0.5 * remaining else h
            if step < 1e-14 * max(1.0, abs(t)):
                return 1
            for i in range(first, STAGES):
                _stage(z, K, step, i, trial)
                derivative(links, model, cut, t + C[i] * step, trial, memory, ws, rows, K[i])
            _stage(z, K, step, STAGES, trial)
            counters[EVALUATIONS] += STAGES - first
            sizes(links.kind, model.length, z, size)
            error = _error(links.kind, K, step, size) / tolerance
            if not np.isfinite(error):
                return 2
            factor = LARGEST if error == 0.0 else min(LARGEST, max(SMALLEST, SAFETY * error ** (-1.0 / 8.0)))
            if error > 1.0:
                counters[REJECTED] += 1
                h, first = step * min(1.0, factor), 1
                continue
            counters[STEPS] += 1
            z[:] = trial
            t = times[sample] if step == remaining else t + step
            project(links, model, cut, t, z, memory, ws, rows)
            remember(model, ws, memory)
            h, first = step * factor if step == h else max(h, step * factor), 0
        orient(ws.A, ws.y)
        motion[sample] = ws.y
    return 0
