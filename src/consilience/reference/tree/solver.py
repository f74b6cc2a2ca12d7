"""Motions in relative joint coordinates, from canonical states to canonical states."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array, Mechanism, State
from consilience.reference.bodies.arrays import Model, pack
from consilience.reference.bodies.canonical import canonical_motion
from consilience.reference.bodies.consistency import check_motion, check_solvable, refuse_inconsistent
from consilience.reference.bodies.residual import (
    CONSISTENT,
    RATIO,
    CheckedRows,
    SolvableRows,
    checked_rows,
    solvable_rows,
)
from consilience.reference.bodies.spanning_tree import TreeModel
from consilience.reference.integrators.step_control import STATUS, UNSUITABLE
from consilience.reference.steppers import explicit, gauss, radau13
from consilience.reference.steppers.driver import (
    CompiledStepper,
    Integration,
    MotionRequest,
    counts_of,
    new_integration,
    run,
)
from consilience.reference.tree import taylor
from consilience.reference.tree.arrays import (
    TreeLinks,
    TreeSystem,
    flatten_relative,
    persistent_arrays,
    tree_system,
    with_own_arrays,
)
from consilience.reference.tree.planar_detection import planar_system
from consilience.reference.tree.state import StatePacking, pack_compared, state_packing
from consilience.reference.tree.system import SystemRecord, serve, serve_states, system_record

_RESOLUTION = 3.0
"""Longest step, in points of a table or as part of the period of a harmonic, that misses no feature of a function."""


def longest_step(model: Model) -> float:
    """Return the longest step, s, that cannot pass over a feature of a function of time."""
    functions, longest = model.functions, np.inf
    springs = *model.spring["actuator"], *model.joint_spring["actuator"]
    of_time = {*model.drive["motion"], *springs, *model.load["history"], *model.control["target"]}
    for n in of_time - {-1}:
        _, harmonic, piece = functions.first[n]
        _, harmonic_end, piece_end = functions.first[n + 1]
        for w in functions.harmonics[harmonic:harmonic_end]["frequency"]:
            longest = min(longest, 2.0 * np.pi / (_RESOLUTION * abs(w)) if w else np.inf)
        for left, right, _ in functions.pieces[piece:piece_end]:
            longest = min(longest, _RESOLUTION * (right - left))
    return float(longest)


class _WorkingArrays(NamedTuple):
    """Arrays that one motion writes."""

    system: SystemRecord
    integration: Integration
    persistent_arrays: list[tuple[Array, Array]]  # arrays to reset, and their initial values


class PreparedMechanism(NamedTuple):
    """Data common to all motions of a mechanism."""

    links: TreeLinks
    spanning: TreeModel
    packing: StatePacking  # a record array
    model: Model
    cut: Model  # the mechanism with the rows that the tree does not satisfy
    residuals: int  # size of the array `found` of `bodies.residual`
    closing: CheckedRows | None  # of `cut`, a record array; None without rows
    solvable: SolvableRows
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
            system = system_record(arrays, self.tree_alone)
            operation, given = (serve_states, (system,)) if integrator == "taylor" else (serve, ())
            scales = arrays.tree.kind, arrays.tree.length
            integration = new_integration(INTEGRATORS[integrator], *scales, (operation, system), *given)
            return _WorkingArrays(system, integration, persistent_arrays(arrays, self.tree_system, self.tree_alone))
        for array, first in taken.persistent_arrays:
            array[...] = first
        return taken


@lru_cache(maxsize=8)
def _prepare(mechanism: Mechanism, in_space: bool) -> PreparedMechanism:
    """Prepare a mechanism; the last mechanisms are kept, because preparation is slow."""
    return prepare(mechanism, in_space)


def prepare(mechanism: Mechanism, in_space: bool = False) -> PreparedMechanism:
    """Prepare a mechanism for many motions.

    With `in_space` the kernels of space serve mechanisms in a plane, too.
    """
    links, spanning, model = flatten_relative(mechanism)
    arrays = None if in_space else planar_system(mechanism, links, spanning, model)
    arrays = arrays or tree_system(mechanism, links, spanning, model)
    tree_alone = links.bare_tree if arrays.planar is None else not len(arrays.closure.loops.group)
    pair = "dop853" if len(model.functions.pieces) else "tp86"
    default_integrators = (*(["taylor"] if taylor.has_series(arrays, tree_alone) else []), pair, "radau13")
    idle: dict[str, list[_WorkingArrays]] = {name: [] for name in INTEGRATORS}
    return PreparedMechanism(
        links,
        spanning,
        state_packing(links, spanning, model),
        model,
        spanning.cut,
        links.residuals,
        checked_rows(spanning.cut) if spanning.cut_rows else None,
        solvable_rows(model),
        arrays,
        tree_alone,
        longest_step(model),
        default_integrators,
        idle,
    )


INTEGRATORS: dict[str, CompiledStepper] = taylor.STEPPERS | explicit.STEPPERS | radau13.STEPPERS | gauss.STEPPERS
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
        The state is not consistent, or the integrator is taylor and the mechanism has no series.
    NumericalFailure
        With the status of the integrator, or the constraint that is violated.
    """
    return simulate_prepared(_prepare(mechanism, integrator == "gauss"), mechanism, state, times, tolerance, integrator)


def simulate_prepared(
    prepared: PreparedMechanism,
    mechanism: Mechanism,
    state: State,
    times: Array,
    tolerance: float,
    integrator: str | None = None,
) -> TrajectoryAnswer:
    """Return the motion of a mechanism whose numbers the prepared arrays hold.

    Parameters
    ----------
    prepared : PreparedMechanism
    mechanism, state, times, tolerance, integrator : see `simulate_relative`
    """
    if integrator == "taylor" and "taylor" not in prepared.default_integrators:
        why = "it is for mechanisms that move in parallel planes by gravity alone, without drives, couplings and rods"
        raise InvalidInput("integrator", f"taylor cannot follow {mechanism.name}: {why}", "Use tp86, or leave it out.")
    found = np.zeros(prepared.residuals)
    z = pack_compared(prepared.links, prepared.packing, state, times, found)
    if found[RATIO] > CONSISTENT:
        refuse_inconsistent(mechanism, prepared.model, found, times[0])
    request = MotionRequest(z, times, float(tolerance), prepared.longest)
    names = prepared.default_integrators if integrator is None else (integrator,)
    for name in names:
        status, motion, counters, time, dependent = _run(prepared, name, request, name != names[-1])
        if status != UNSUITABLE:
            break
    if dependent:
        check_solvable(mechanism, prepared.solvable, times[0], pack(mechanism, state) if status else motion[0])
    if status:
        raise NumericalFailure(f"{_label(name, tolerance)}, at {time:.6g} s: {STATUS[status]}")
    if prepared.closing is not None:
        check_motion(mechanism, prepared.closing, prepared.cut, times, motion, tolerance, _label(name, tolerance))
    p, quat, v, w = canonical_motion(prepared.links.com, motion)
    return TrajectoryAnswer(times, p, quat, v, w, counters)


def _label(integrator: str, tolerance: float) -> str:
    """Return how a motion is computed."""
    return f"reference, relative, {integrator}, tolerance {tolerance:g}"


def _run(
    prepared: PreparedMechanism, name: str, request: MotionRequest, stop_if_stiff: bool
) -> tuple[int, Array, dict[str, int | float], float, bool]:
    """Integrate; return status, bodies at samples, counters, start of the last step (s), if rows depend on others."""
    working = prepared.working(name)
    motion = np.empty((len(request.times), *working.system.tree.y.shape))
    status = run(working.integration, request, motion, stop_if_stiff)
    if status in (0, UNSUITABLE):  # a failure may leave NaN in the arrays
        prepared.idle[name].append(working)
    closure, ended = working.system.closure, working.integration.motion.run
    dependent = closure is not None and closure.best["first"][0] < len(closure.value)
    return status, motion, counts_of(ended), ended["t"].item(), dependent
