"""Adaptive explicit Runge-Kutta method of order 8 in the state z, with projection after every step.

Step control as in `integrators.dop853`, every component scaled by the tolerance times the size of its kind. Samples do
not shorten steps: they come from the dense output of the method [Hairer, Norsett, Wanner, section II.10], a polynomial
of degree seven for three evaluations more in each step that holds samples, and are projected like the steps.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from consilience.reference.integrators.coefficients import E3, E5, STAGES, A, B, C
from consilience.reference.integrators.dop853 import EVALUATIONS, LARGEST, REJECTED, SMALLEST, STEPS
from consilience.reference.integrators.tableaus import DORMAND_PRINCE
from consilience.reference.joint_rows import coordinate
from consilience.reference.model import ANGLE, Model
from consilience.reference.relative.dynamics import derivative, free_derivative, project, remember
from consilience.reference.relative.kinematics import orient
from consilience.reference.relative.model import Links, Scratch
from consilience.reference.workspace import Workspace
from consilience.spatial import Array

A_DENSE, C_DENSE, D_DENSE = DORMAND_PRINCE.A_dense, DORMAND_PRINCE.c_dense, DORMAND_PRINCE.D
END = STAGES
"""Stage at the end of a step; those of the dense output stand behind it."""
ALL_STAGES = A_DENSE.shape[1]

SAFETY = 0.8
"""Safety factor of the step size: with 0.9 a quarter of the steps of a pendulum or linkage are taken in vain."""

_TURN = 1.5
"""Most that an angle whose turns are counted may change in a step, rad: well below half a turn."""


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
def _stages(
    links: Links,
    model: Model,
    cut: Model,
    z: Array,
    K: Array,
    t: float,
    h: float,
    first: int,
    trial: Array,
    memory: Array,
    ws: Scratch,
    rows: Workspace,
) -> None:
    """Derivatives of the stages of a step, from the first that is not known."""
    if links.free:
        # handing on tuples of arrays costs more than such a tree does
        layout, link, free, speeds = links.layout, ws.link, ws.free, links.speeds
        for i in range(first, STAGES):
            _stage(z, K, h, i, trial)
            free_derivative(layout, link, free, speeds, trial, K[i])
        return
    for i in range(first, STAGES):
        _stage(z, K, h, i, trial)
        derivative(links, model, cut, t + C[i] * h, trial, memory, ws, rows, K[i])


@njit(cache=True, error_model="numpy")
def turning(model: Model, ws: Scratch, memory: Array) -> float:
    """Longest step in which turns can be counted, from the rates of the bodies as they are placed."""
    rate = 0.0
    for n in range(memory.shape[0]):
        if model.coordinate[n, 1] == ANGLE:
            rate = max(rate, abs(coordinate(model, ws.y, ws.A, n, memory[n]).rate))
    return _TURN / rate if rate > 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def _dense_stage(z: Array, K: Array, h: float, i: int, trial: Array) -> None:
    """State at which a stage of the dense output is evaluated."""
    trial[:] = z
    for j in range(i):
        weight = h * A_DENSE[i - END - 1, j]
        if weight != 0.0:
            for n in range(z.shape[0]):
                trial[n] += weight * K[j, n]


@njit(cache=True, error_model="numpy")
def _polynomial(z: Array, end: Array, K: Array, h: float, F: Array) -> None:
    """Dense output of a step, F of shape (7, n_z), in the nested form of `integrators.tableaus`."""
    for n in range(z.shape[0]):
        F[0, n] = end[n] - z[n]
        F[1, n] = h * K[0, n] - F[0, n]
        F[2, n] = 2.0 * F[0, n] - h * (K[0, n] + K[END, n])
        for i in range(D_DENSE.shape[0]):
            total = 0.0
            for j in range(ALL_STAGES):
                total += D_DENSE[i, j] * K[j, n]
            F[3 + i, n] = h * total


@njit(cache=True, error_model="numpy")
def _between(z: Array, F: Array, x: float, state: Array) -> None:
    """State at the part x of a step."""
    for n in range(z.shape[0]):
        total = 0.0
        for i in range(F.shape[0] - 1, -1, -1):
            total = (total + F[i, n]) * (1.0 - x if i % 2 else x)
        state[n] = z[n] + total


@njit(cache=True, error_model="numpy")
def _length(h: float, remaining: float) -> float:
    """Length of the next step: a remainder a little longer than a step is halved, so that no sliver of one is left."""
    return remaining if h >= remaining else min(h, 0.5 * remaining)


@njit(cache=True, error_model="numpy")
def _begin(
    links: Links,
    model: Model,
    cut: Model,
    z: Array,
    times: Array,
    tolerance: float,
    memory: Array,
    ws: Scratch,
    rows: Workspace,
    size: Array,
    f: Array,
) -> float:
    """Derivative at the start, into f, and the length of the first step: z changes by ``tolerance ** (1/8)`` in it."""
    derivative(links, model, cut, times[0], z, memory, ws, rows, f)
    sizes(links.kind, model.length, z, size)
    total = 0.0
    for n in range(f.shape[0]):
        total += (f[n] / size[links.kind[n]]) ** 2
    return tolerance ** (1.0 / 8.0) / max(np.sqrt(total / f.shape[0]), 1.0 / (times[-1] - times[0]))


@njit(cache=True, error_model="numpy")
def _samples(
    links: Links,
    model: Model,
    cut: Model,
    z: Array,
    end: Array,
    K: Array,
    t: float,
    step: float,
    times: Array,
    memory: Array,
    ws: Scratch,
    rows: Workspace,
    motion: Array,
) -> None:
    """Record the bodies at times within a step, and leave the derivative at its end in ``K[END]``."""
    # the rows chosen at the end of the step are those for the next one
    order, chosen, least = ws.fronts.order.copy(), ws.fronts.chosen.copy(), ws.fronts.least[0]
    state, F = end.copy(), np.empty((3 + D_DENSE.shape[0], z.shape[0]))
    for i in range(END, ALL_STAGES):
        if i > END:
            _dense_stage(z, K, step, i, state)
        at = t + (C_DENSE[i - END - 1] if i > END else 1.0) * step
        derivative(links, model, cut, at, state, memory, ws, rows, K[i])
    _polynomial(z, end, K, step, F)
    for n in range(times.shape[0]):
        _between(z, F, (times[n] - t) / step, state)
        project(links, model, cut, times[n], state, memory, ws, rows)
        orient(ws.A, ws.y)
        motion[n] = ws.y
    ws.fronts.order[:], ws.fronts.chosen[:], ws.fronts.least[0] = order, chosen, least


@njit(cache=True, error_model="numpy")
def integrate(
    links: Links,
    model: Model,
    cut: Model,
    z: Array,
    times: Array,
    tolerance: float,
    longest: float,
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
    longest : float, s
        Bound on the steps.
    motion : ndarray, shape (n_t, n_b + n_e, 13)
        Overwritten.

    Returns
    -------
    int
        Key of `integrators.dop853.STATUS`.
    """
    K, trial, size = np.zeros((ALL_STAGES, z.shape[0])), np.empty_like(z), np.empty(5)
    counters[:] = 0
    t, last, sample = times[0], times[-1], 1
    project(links, model, cut, t, z, memory, ws, rows)
    orient(ws.A, ws.y)
    motion[0] = ws.y
    if times.shape[0] == 1:
        return 0
    longest_now = min(longest, turning(model, ws, memory))
    h, first = _begin(links, model, cut, z, times, tolerance, memory, ws, rows, size, K[0]), 1
    counters[EVALUATIONS] = 1
    while sample < times.shape[0]:
        step = _length(min(h, longest_now), last - t)
        if step < 1e-14 * max(1.0, abs(t)):
            return 1
        _stages(links, model, cut, z, K, t, step, first, trial, memory, ws, rows)
        _stage(z, K, step, STAGES, trial)
        counters[EVALUATIONS] += STAGES - first
        sizes(links.kind, model.length, z, size)
        error = _error(links.kind, K, step, size) / tolerance
        if not np.isfinite(error):
            return 2
        factor = LARGEST if error == 0.0 else min(LARGEST, max(SMALLEST, SAFETY * error ** (-1.0 / 8.0)))
        if error > 1.0:
            counters[REJECTED] += 1
            h, first = step * min(1.0, factor), 1  # the first stage is still known
            continue
        counters[STEPS] += 1
        after = last if step == last - t else t + step
        project(links, model, cut, after, trial, memory, ws, rows)
        remember(model, ws, memory)
        longest_now, first, begin = min(longest, turning(model, ws, memory)), 0, sample
        while sample < times.shape[0] and times[sample] < after:
            sample += 1
        inner = sample
        if sample < times.shape[0] and times[sample] == after:
            orient(ws.A, ws.y)
            motion[sample] = ws.y
            sample += 1
        if begin < inner:
            within, found = times[begin:inner], motion[begin:inner]
            _samples(links, model, cut, z, trial, K, t, step, within, memory, ws, rows, found)
            counters[EVALUATIONS] += ALL_STAGES - END
            K[0], first = K[END], 1
        z[:] = trial
        t, h = after, step * factor if step == h else max(h, step * factor)
    return 0
