"""Adaptive explicit Runge-Kutta methods of order 8 in the state z, with projection after every step.

Step control as in `integrators.dop853`, every component scaled by the tolerance times the size of its kind. Samples do
not shorten steps: they come from the dense output of the method [Hairer, Norsett, Wanner, section II.10], a polynomial
of degree seven for three or four evaluations more in each step that holds samples, and are projected like the steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.integrators.coefficients import D_DENSE, STAGES
from consilience.reference.integrators.step_control import EVALUATIONS, LARGEST, REJECTED, STEPS, factor_of
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.kernel.held import opened
from consilience.reference.kernel.vectors import assign
from consilience.reference.tree.arrays import Elements, Rest, Run, Space, Tree
from consilience.reference.tree.dynamics import rates
from consilience.reference.tree.loop_groups import CHOSEN
from consilience.reference.tree.methods import STAGES_AT_MOST, Method
from consilience.reference.tree.plane import Plane
from consilience.reference.tree.projection import SEEN, arrive, begin, longest_now, note, settle
from consilience.reference.tree.step_control import first_length, length, sizes, within

BEGIN, SECOND, END = np.array([0, 1, STAGES])
"""Stages: the first two, and that at the end of a step. They are numbers of NumPy, as kernels are compiled anew for
each Python number that is written out where they are called."""

LEFT = 3
"""Status of a motion that is left to another integrator."""

CRAWLING, PATIENCE, LEAST_LEFT = 3.5, 15, 100
"""A motion is stiff for a method where so many steps, less the others, times the fastest rate of decay are as long as
this: longer than accuracy asks for, and close to what the method's stability allows, 6 [Hairer and Wanner, IV.2]. It is
left to another method if there are more than so many steps to go."""

AT_FIRST = 1e4
"""Largest growth of the step directly after the first one, which is a guess from a single slope."""

SAFETY = 0.8
"""Safety factor of the step size: with 0.9 a quarter of the steps of a pendulum or linkage are taken in vain."""


class Scratch(NamedTuple):
    """What a run writes into: made once, so that nothing else makes arrays."""

    K: Array  # (17, n_z) derivatives at the stages
    end: Array  # (n_z,) end of the step
    state: Array  # (n_z,) of a stage or sample
    F: Array  # (7, n_z) dense output
    size: Array  # (5,) of the kinds of components
    order: Array  # rows chosen at the end of the step, while its samples are taken
    chosen: Array
    late: Array  # (2, n_z) state and derivative of the last stage of the step before


def scratch(z: Array, rest: Rest | None) -> Scratch:
    """Scratch of a run from the state z."""
    rows, groups = (0, 0) if rest is None else (len(rest.fronts.order), len(rest.fronts.state))
    return Scratch(
        K=np.zeros((STAGES_AT_MOST, len(z))),
        end=np.empty(len(z)),
        state=np.empty(len(z)),
        F=np.empty((3 + len(D_DENSE), len(z))),
        size=np.empty(5),
        order=np.empty(rows, dtype=np.int64),
        chosen=np.empty(groups, dtype=np.int64),
        late=np.empty((2, len(z))),
    )


@inner
def _error(kind: Array, K: Array, h: float, size: Array, estimate: Array, power: float) -> float:
    """Scaled error estimate of a step."""
    error = lower = 0.0
    count = K.shape[1]
    for n in range(count):
        one = two = 0.0
        for i in range(STAGES):
            one += estimate[0, i] * K[i, n]
            two += estimate[1, i] * K[i, n]
        scale = size[kind[n]]
        error += (one / scale) ** 2
        lower += (two / scale) ** 2
    if error == 0.0 and lower == 0.0:
        return 0.0
    return (abs(h) * error / np.sqrt((error + 0.01 * lower) * count)) ** power


@inner
def _stage(table: Array, z: Array, K: Array, h: float, i: int, trial: Array) -> None:
    """State at which a stage is evaluated."""
    for n in range(z.shape[0]):
        trial[n] = z[n]
    for j in range(i):
        weight = h * table[i, j]
        if weight != 0.0:
            for n in range(z.shape[0]):
                trial[n] += weight * K[j, n]


@inner
def _evaluate(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    method: Method,
    z: Array,
    end: Array,
    K: Array,
    t: float,
    h: float,
    first: int,
    last: int,
    state: Array,
) -> None:
    """Derivatives of some stages of a step that begins at z and, where it is known, ends at `end`."""
    for i in range(first, last):
        if i == END:
            assign(state, end)
        else:
            _stage(method.table, z, K, h, i, state)
        rates(tree, rest, space, elements, plane, t + method.nodes[i] * h, state, K[i])


@kernel
def _polynomial(dense: Array, z: Array, end: Array, K: Array, h: float, F: Array) -> None:
    """Dense output of a step, F of shape (7, n_z), in the nested form of `integrators.tableaus`."""
    for n in range(z.shape[0]):
        F[0, n] = end[n] - z[n]
        F[1, n] = h * K[0, n] - F[0, n]
        F[2, n] = 2.0 * F[0, n] - h * (K[0, n] + K[END, n])
        for i in range(dense.shape[0]):
            total = 0.0
            for j in range(dense.shape[1]):
                total += dense[i, j] * K[j, n]
            F[3 + i, n] = h * total


@kernel
def between(z: Array, F: Array, x: float, state: Array) -> None:
    """State at the part x of a step."""
    for n in range(z.shape[0]):
        total = 0.0
        for i in range(F.shape[0] - 1, -1, -1):
            total = (total + F[i, n]) * (1.0 - x if i % 2 else x)
        state[n] = z[n] + total


@inlined
def record_within(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    z: Array,
    t: float,
    step: float,
    times: Array,
    motion: Array,
    scratch: Scratch,
) -> None:
    """Record the bodies at times within a step."""
    if rest is not None:
        # the rows chosen at the end of the step are those for the next one
        assign(scratch.order, rest.fronts.order)
        assign(scratch.chosen, rest.fronts.state[:, CHOSEN])
    for n in range(times.shape[0]):
        between(z, scratch.F, (times[n] - t) / step, scratch.state)
        settle(tree, rest, space, elements, plane, times[n], scratch.state, SEEN)
        note(tree, space, plane, motion[n])
    if rest is not None:
        assign(rest.fronts.order, scratch.order)
        assign(rest.fronts.state[:, CHOSEN], scratch.chosen)


@inlined
def _record(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    method: Method,
    z: Array,
    t: float,
    step: float,
    seen: bool,
    times: Array,
    motion: Array,
    counters: Array,
    first: int,
    inner: int,
    scratch: Scratch,
) -> tuple[int, int]:
    """Record the samples of a step, from the first; the number of the next one, and the next stage not known.

    `inner` is the first that is not within the step; where its end is `seen`, it is there.
    """
    sample = inner
    if seen:
        note(tree, space, plane, motion[sample])
        sample += 1
    if first == inner:
        return sample, BEGIN
    end, K, behind = scratch.end, scratch.K, method.nodes.shape[0]
    _evaluate(tree, rest, space, elements, plane, method, z, end, K, t, step, END, behind, scratch.state)
    counters[EVALUATIONS] += behind - END
    _polynomial(method.dense, z, end, K, step, scratch.F)
    record_within(tree, rest, space, elements, plane, z, t, step, times[first:inner], motion[first:inner], scratch)
    return sample, SECOND


@inner
def _advance(z: Array, end: Array, K: Array, first: int) -> None:
    """Go on to the end of a step, whose derivative is the first stage of the next one where that is known."""
    for n in range(z.shape[0]):
        z[n] = end[n]
        if first == SECOND:
            K[0, n] = K[END, n]


@inlined
def _attempt(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    method: Method,
    z: Array,
    t: float,
    step: float,
    first: int,
    last: int,
    counters: Array,
    scratch: Scratch,
) -> float:
    """Evaluate stages `first` to `last` of a step; its end into the scratch, and its scaled error."""
    K, size = scratch.K, scratch.size
    _evaluate(tree, rest, space, elements, plane, method, z, z, K, t, step, first, last, scratch.state)
    counters[EVALUATIONS] += last - first
    _stage(method.table, z, K, step, END, scratch.end)
    sizes(tree.kind, tree.length, z, size)
    return _error(tree.kind, K, step, size, method.estimate, method.power)


@inner
def _decay(kind: Array, z: Array, f: Array, late: Array, size: Array, tolerance: float) -> float:
    """Rate at which what is between a step's end and its last stage decays; none where they are as good as equal."""
    states = slopes = 0.0
    for n in range(z.shape[0]):
        states += ((z[n] - late[0, n]) / size[kind[n]]) ** 2
        slopes += ((f[n] - late[1, n]) / size[kind[n]]) ** 2
    least = max(1e-13, 1e-3 * tolerance)
    return np.sqrt(slopes / states) if states > least**2 * z.shape[0] else 0.0


@inner
def _integrate(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    scratch: Scratch,
    method: Method,
    z: Array,
    times: Array,
    tolerance: float,
    longest: float,
    motion: Array,
    counters: Array,
    leaves: bool,
) -> int:
    """`integrate`, compiled for what a mechanism has: where an argument is None, there is none."""
    t, last, sample = times[0], times[-1], SECOND
    K, end = scratch.K, scratch.end
    counters[:] = 0
    begin(tree, rest, space, elements, plane, t, z)
    note(tree, space, plane, motion[0])
    if times.shape[0] == 1:
        return 0
    bound = longest_now(tree, elements, longest)
    _attempt(tree, rest, space, elements, plane, method, z, t, 0.0, BEGIN, SECOND, counters, scratch)
    h, first = first_length(tree.kind, K[0], last - t, tolerance, scratch.size), SECOND
    finite, most, before, crawled = np.isfinite(h), AT_FIRST, 0.0, 0
    while sample < times.shape[0]:
        step = length(min(h, bound), last - t)
        if not step >= 1e-14 * max(1.0, abs(t)):
            return 1 if finite else 2
        error = (
            _attempt(tree, rest, space, elements, plane, method, z, t, step, first, END, counters, scratch) / tolerance
        )
        if leaves and before > 0.0:
            long = before * _decay(tree.kind, z, K[0], scratch.late, scratch.size, tolerance) > CRAWLING
            before, crawled = 0.0, crawled + 1 if long else max(0, crawled - 1)
            if crawled >= PATIENCE and last - t > LEAST_LEFT * step:
                return LEFT
        finite = np.isfinite(error)  # a stage far from the motion may overflow: of no step that is short enough
        factor = factor_of(error, SAFETY, most)
        if not error <= 1.0:
            counters[REJECTED] += 1
            h, first, most = step * factor, SECOND, 1.0  # the first stage is still known
            continue
        counters[STEPS] += 1
        assign(scratch.late[0], scratch.state)
        assign(scratch.late[1], K[END - 1])
        after = last if step == last - t else t + step
        left = within(times, sample, after)
        seen = left < times.shape[0] and times[left] == after
        arrive(tree, rest, space, elements, plane, after, end, seen)
        bound = longest_now(tree, elements, longest)
        sample, first = _record(
            tree, rest, space, elements, plane, method, z, t, step, seen, times, motion, counters, sample, left, scratch
        )
        _advance(z, end, K, first)
        t, h, most, before = after, step * factor if step == h else max(h, step * factor), LARGEST, step
    return 0


@kernel
def integrate(
    run: Run,
    method: Method,
    z: Array,
    times: Array,
    tolerance: float,
    longest: float,
    motion: Array,
    counters: Array,
    leaves: bool,
) -> int:
    """Integrate from ``times[0]`` and record the bodies at all sample times.

    Parameters
    ----------
    run, method : Run and Method, their words
    z : ndarray, shape (n_z,)
        Initial state; overwritten by the last.
    times : ndarray, shape (n_t,), s
    tolerance, longest : float
        Bounds on the scaled local error, and on the steps in s.
    motion, counters : ndarray, shapes (n_t, n_b + n_e, 13) and (3,)
        Overwritten; counters are accepted steps, rejected steps, evaluations.
    leaves : bool
        Whether a stiff motion is left to another method.

    Returns
    -------
    int
        Key of `integrators.dop853.STATUS`, or `LEFT`.
    """
    on, method = opened(run), opened(method)
    return _integrate(
        on.tree,
        on.rest,
        on.space,
        on.elements,
        on.plane,
        on.scratch,
        method,
        z,
        times,
        tolerance,
        longest,
        motion,
        counters,
        leaves,
    )
