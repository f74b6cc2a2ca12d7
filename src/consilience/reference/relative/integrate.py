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
from consilience.reference.relative.kinematics import normalise, place, record
from consilience.reference.relative.model import Rest, Tree
from consilience.spatial import Array

D_DENSE = DORMAND_PRINCE.D
END = STAGES
"""Stage at the end of a step; those of the dense output stand behind it."""
ALL_STAGES = DORMAND_PRINCE.A_dense.shape[1]
TABLE = np.zeros((ALL_STAGES, ALL_STAGES))
TABLE[:END, :END], TABLE[END, :END], TABLE[END + 1 :] = A, B, DORMAND_PRINCE.A_dense
NODES = np.concatenate([C, [1.0], DORMAND_PRINCE.c_dense])
LIMITS = np.array([0, 1, END, ALL_STAGES])
"""In an array, as kernels are compiled anew for each number that is written out where they are called."""

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
    """State at which a stage is evaluated."""
    trial[:] = z
    for j in range(i):
        weight = h * TABLE[i, j]
        if weight != 0.0:
            for n in range(z.shape[0]):
                trial[n] += weight * K[j, n]


@njit(cache=True, error_model="numpy")
def _evaluate(
    tree: Tree, rest: Rest | None, z: Array, end: Array, K: Array, t: float, h: float, first: int, last: int
) -> None:
    """Derivatives of some stages of a step that begins at z and, where it is known, ends at `end`."""
    trial = np.empty_like(z)
    for i in range(first, last):
        if i == END:
            trial[:] = end
        else:
            _stage(z, K, h, i, trial)
        if rest is None:
            free_derivative(tree.layout, tree.link, tree.free, tree.speeds, trial, K[i])
        else:
            at = t + NODES[i] * h
            derivative(rest.links, rest.model, rest.cut, at, trial, rest.memory, rest.ws, rest.rows, K[i])


@njit(cache=True, error_model="numpy", inline="always")
def settle(tree: Tree, rest: Rest | None, t: float, z: Array) -> None:
    """Bring a state back to closed loops, in place, and place the bodies at it."""
    if rest is None:
        normalise(tree.layout, z)
        place(tree.layout, tree.link, tree.free, tree.speeds, z, tree.y, tree.A)
    else:
        project(rest.links, rest.model, rest.cut, t, z, rest.memory, rest.ws, rest.rows)


@njit(cache=True, error_model="numpy")
def _turning(model: Model, y: Array, A: Array, memory: Array) -> float:
    """Longest step in which turns can be counted, from the rates of the bodies as they are placed."""
    rate = 0.0
    for n in range(memory.shape[0]):
        if model.coordinate[n, 1] == ANGLE:
            rate = max(rate, abs(coordinate(model, y, A, n, memory[n]).rate))
    return _TURN / rate if rate > 0.0 else np.inf


@njit(cache=True, error_model="numpy", inline="always")
def longest_now(rest: Rest | None, longest: float) -> float:
    """Longest step from where the bodies are placed."""
    found = longest
    if rest is not None:
        found = min(longest, _turning(rest.model, rest.ws.y, rest.ws.A, rest.memory))
    return found


@njit(cache=True, error_model="numpy", inline="always")
def count_turns(rest: Rest | None) -> None:
    """Update what elements remember."""
    if rest is not None:
        remember(rest.model, rest.ws.y, rest.ws.A, rest.memory)


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
def _first_length(kind: Array, f: Array, span: float, tolerance: float, size: Array) -> float:
    """Length of the first step, in which z changes by ``tolerance ** (1/8)``, from its derivative f."""
    total = 0.0
    for n in range(f.shape[0]):
        total += (f[n] / size[kind[n]]) ** 2
    return tolerance ** (1.0 / 8.0) / max(np.sqrt(total / f.shape[0]), 1.0 / span)


@njit(cache=True, error_model="numpy", inline="always")
def _samples(
    tree: Tree, rest: Rest | None, z: Array, F: Array, t: float, step: float, times: Array, motion: Array
) -> None:
    """Record the bodies at times within a step."""
    if rest is not None:
        # the rows chosen at the end of the step are those for the next one
        fronts = rest.ws.fronts
        order, chosen = fronts.order.copy(), fronts.chosen.copy()
    state = np.empty_like(z)
    for n in range(times.shape[0]):
        _between(z, F, (times[n] - t) / step, state)
        settle(tree, rest, times[n], state)
        record(tree.A, tree.y, motion[n])
    if rest is not None:
        fronts.order[:], fronts.chosen[:] = order, chosen


@njit(cache=True, error_model="numpy")
def integrate(
    tree: Tree,
    rest: Rest | None,
    z: Array,
    times: Array,
    tolerance: float,
    longest: float,
    motion: Array,
    counters: Array,
) -> int:
    """Integrate from ``times[0]`` and record the bodies at all sample times.

    It is compiled twice: for trees without elements, whose kernels are few, and for everything else.

    Parameters
    ----------
    rest : Rest or None
        None for a tree without elements.
    z : ndarray, shape (n_z,)
        Initial state; overwritten by the last.
    times : ndarray, shape (n_t,), s
    tolerance : float
        Bound on the scaled local error.
    longest : float, s
        Bound on the steps.
    motion : ndarray, shape (n_t, n_b + n_e, 13)
        Overwritten.
    counters : ndarray of int, shape (3,)
        Overwritten: accepted steps, rejected steps, evaluations.

    Returns
    -------
    int
        Key of `integrators.dop853.STATUS`.
    """
    K, F = np.zeros((ALL_STAGES, z.shape[0])), np.empty((3 + D_DENSE.shape[0], z.shape[0]))
    trial, size = np.empty_like(z), np.empty(5)
    none, one, end, all_stages = LIMITS[0], LIMITS[1], LIMITS[2], LIMITS[3]
    counters[:] = 0
    t, last, sample = times[0], times[-1], 1
    settle(tree, rest, t, z)
    record(tree.A, tree.y, motion[0])
    if times.shape[0] == 1:
        return 0
    bound = longest_now(rest, longest)
    _evaluate(tree, rest, z, z, K, t, 0.0, none, one)
    sizes(tree.kind, tree.length, z, size)
    h, first = _first_length(tree.kind, K[0], last - t, tolerance, size), one
    counters[EVALUATIONS] = 1
    while sample < times.shape[0]:
        step = _length(min(h, bound), last - t)
        if step < 1e-14 * max(1.0, abs(t)):
            return 1
        _evaluate(tree, rest, z, z, K, t, step, first, end)
        _stage(z, K, step, end, trial)
        counters[EVALUATIONS] += end - first
        sizes(tree.kind, tree.length, z, size)
        error = _error(tree.kind, K, step, size) / tolerance
        if not np.isfinite(error):
            return 2
        factor = LARGEST if error == 0.0 else min(LARGEST, max(SMALLEST, SAFETY * error ** (-1.0 / 8.0)))
        if error > 1.0:
            counters[REJECTED] += 1
            h, first = step * min(1.0, factor), one  # the first stage is still known
            continue
        counters[STEPS] += 1
        after = last if step == last - t else t + step
        settle(tree, rest, after, trial)
        count_turns(rest)
        bound, first, begin = longest_now(rest, longest), none, sample
        while sample < times.shape[0] and times[sample] < after:
            sample += 1
        inner = sample
        if sample < times.shape[0] and times[sample] == after:
            record(tree.A, tree.y, motion[sample])
            sample += 1
        if begin < inner:
            _evaluate(tree, rest, z, trial, K, t, step, end, all_stages)
            counters[EVALUATIONS] += all_stages - end
            _polynomial(z, trial, K, step, F)
            _samples(tree, rest, z, F, t, step, times[begin:inner], motion[begin:inner])
            K[0], first = K[END], one
        z[:] = trial
        t, h = after, step * factor if step == h else max(h, step * factor)
    return 0
