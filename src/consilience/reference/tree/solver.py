"""Motions in relative joint coordinates, from canonical states to canonical states."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array, Mechanism, State
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.canonical import canonical_motion
from consilience.reference.kernel.mechanism_record import record_array
from consilience.reference.tree.arrays import (
    KernelArguments,
    LoopClosure,
    TreeLinks,
    TreeSystem,
    flatten_relative,
    persistent_arrays,
    tree_system,
    with_own_arrays,
)
from consilience.reference.tree.explicit_rk import UNSUITABLE, explicit_scratch, integrate
from consilience.reference.tree.gauss import gauss_scratch, integrate_gauss
from consilience.reference.tree.methods import PAIRS
from consilience.reference.tree.planar_detection import planar_system
from consilience.reference.tree.radau13 import integrate_radau, radau_scratch
from consilience.reference.tree.state import StatePacking, pack_state
from consilience.reference.tree.taylor import STATUS, has_series, integrate_taylor, order_for, taylor_scratch

_RESOLUTION = 3.0
"""Longest step, in points of a table or as part of the period of a harmonic, that misses no feature of a function."""


def longest_step(model: Model) -> float:
    """Return the longest step, s, that cannot pass over a feature of a function of time."""
    functions, longest = model.functions, np.inf
    of_time = [*model.drive[:, 1], *model.spring_function, *model.joint_spring[:, 1], *model.load_function]
    for n in {*of_time, *model.control[:, 1]} - {-1}:
        _, harmonic, piece = functions.first[n]
        _, harmonic_end, piece_end = functions.first[n + 1]
        for w in functions.harmonics[harmonic:harmonic_end, 1]:
            longest = min(longest, 2.0 * np.pi / (_RESOLUTION * abs(w)) if w else np.inf)
        for left, right in functions.pieces[piece:piece_end, :2]:
            longest = min(longest, _RESOLUTION * (right - left))
    return float(longest)


class _WorkingArrays(NamedTuple):
    """Arrays that one motion writes."""

    arrays: KernelArguments
    run: KernelArguments  # its record array
    persistent_arrays: list[tuple[Array, Array]]  # arrays to reset, and their initial values


class _PreparedMechanism(NamedTuple):
    """Data common to all motions of a mechanism."""

    links: TreeLinks
    packing: StatePacking  # a record array
    tree_system: TreeSystem  # in its initial state
    tree_alone: bool  # without loops and, in space, without elements
    longest: float  # longest step, s
    default_integrators: tuple[str, ...]  # in this order, until one can go on
    idle: dict[str, list[_WorkingArrays]]  # work arrays of ended motions, by integrator

    def working(self, integrator: str) -> _WorkingArrays:
        """Return arrays that no other motion writes."""
        try:
            taken = self.idle[integrator].pop()
        except IndexError:
            arrays = with_own_arrays(self.tree_system)
            tree, closing, spatial, elements, planar = arrays
            closure = None if self.tree_alone else closing
            scratch = INTEGRATORS[integrator].scratch(np.zeros(len(self.links.kind)), arrays, closure)
            run = KernelArguments(tree, closure, spatial, elements, planar, scratch)
            return _WorkingArrays(run, record_array(run), persistent_arrays(arrays, self.tree_system))
        for array, first in taken.persistent_arrays:
            array[...] = first
        return taken


@lru_cache(maxsize=8)
def _prepare(mechanism: Mechanism, in_space: bool) -> _PreparedMechanism:
    """Prepare a mechanism; the last mechanisms are kept, because preparation is slow.

    With `in_space` the kernels of space serve mechanisms in a plane, too.
    """
    links, spanning, model = flatten_relative(mechanism)
    arrays = None if in_space else planar_system(mechanism, links, spanning, model)
    arrays = arrays or tree_system(mechanism, links, spanning, model)
    tree_alone = links.bare_tree if arrays.planar is None else not len(arrays.closure.loops.group)
    explicit = "dop853" if len(model.functions.pieces) else "tp86"
    default_integrators = (*(["taylor"] if has_series(arrays, tree_alone) else []), explicit, "radau13")
    idle: dict[str, list[_WorkingArrays]] = {name: [] for name in INTEGRATORS}
    return _PreparedMechanism(
        links,
        record_array(StatePacking(links, spanning, model)),
        arrays,
        tree_alone,
        longest_step(model),
        default_integrators,
        idle,
    )


class _MotionRequest(NamedTuple):
    """Arguments of a motion, and the arrays that it fills: bodies at the samples, and counters."""

    z: Array
    times: Array
    tolerance: float
    longest: float  # longest step, s
    motion: Array
    counters: Array


class _Integrator(NamedTuple):
    """How an integrator is called."""

    scratch: Callable[[Array, TreeSystem, LoopClosure | None], Any]
    run: Callable[..., int]  # arguments: run, those of _MotionRequest, stop_if_stiff; returns the status


def _run_taylor(run: KernelArguments, z: Array, times: Array, tolerance: float, *others: Any) -> int:
    """Integrate by Taylor's method, which does not stop."""
    return integrate_taylor(run, z, times, tolerance, order_for(tolerance), *others[:-1])


INTEGRATORS = {
    "taylor": _Integrator(taylor_scratch, _run_taylor),
    **{name: _Integrator(partial(explicit_scratch, pair), integrate) for name, pair in PAIRS.items()},
    "radau13": _Integrator(radau_scratch, integrate_radau),
    "gauss": _Integrator(gauss_scratch, integrate_gauss),
}
"""Compiled integrators of the relative form; ``taylor`` serves planar mechanisms without elements."""


def simulate_relative(
    mechanism: Mechanism, state: State, times: Array, tolerance: float, integrator: str | None = None
) -> TrajectoryAnswer:
    """Return the motion of a mechanism in relative joint coordinates.

    If no integrator is given: ``taylor`` where the mechanism has series (`taylor.has_series`), elsewhere ``tp86``, or
    ``dop853`` where a function is a table; ``radau13`` where that integrator finds the motion stiff.

    Parameters
    ----------
    mechanism, state, times, tolerance : see `consilience.reference.simulate`
    integrator : str, optional
        Key of `INTEGRATORS`.

    Raises
    ------
    InvalidInput
        The integrator is taylor and the mechanism has no series.
    NumericalFailure
        With the status of the integrator.
    """
    prepared = _prepare(mechanism, integrator == "gauss")
    if integrator == "taylor" and "taylor" not in prepared.default_integrators:
        why = "it is for mechanisms that move in parallel planes by gravity alone, without drives, couplings and rods"
        raise InvalidInput("integrator", f"taylor cannot follow {mechanism.name}: {why}", "Use tp86, or leave it out.")
    request = pack_state(prepared.links, prepared.packing, state), times, float(tolerance)
    names = prepared.default_integrators if integrator is None else (integrator,)
    for name in names:
        status, motion, counters = _run(prepared, name, *request, name != names[-1])
        if status != UNSUITABLE:
            break
    if status:
        raise NumericalFailure(f"reference, relative, {name}, tolerance {tolerance:g}: {STATUS[status]}")
    p, quat, v, w = canonical_motion(prepared.links.com, motion)
    labels = ("steps", "rejected", "evaluations")
    counts: dict[str, int | float] = dict(zip(labels, counters.tolist(), strict=True))
    return TrajectoryAnswer(times, p, quat, v, w, counts)


def _run(
    prepared: _PreparedMechanism, name: str, z: Array, times: Array, tolerance: float, stop_if_stiff: bool
) -> tuple[int, Array, Array]:
    """Integrate from the state z; return status, bodies at the samples, and counters."""
    working = prepared.working(name)
    motion, counters = np.empty((len(times), *working.arrays.tree.y.shape)), np.zeros(3, dtype=np.int64)
    request = _MotionRequest(z.copy(), times, tolerance, prepared.longest, motion, counters)
    status = INTEGRATORS[name].run(working.run, *request, stop_if_stiff)
    if status in (0, UNSUITABLE):  # a failure may leave NaN in the arrays
        prepared.idle[name].append(working)
    return status, motion, counters
