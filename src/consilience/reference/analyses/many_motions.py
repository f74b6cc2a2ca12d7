"""Motions of one mechanism with many parameter sets or from many states, by arrays and kernels that all of them share.

Each thread prepares the mechanism once and writes the numbers of one set after another into its arrays; kernels run
without the global interpreter lock. A set of another structure (one that leaves the plane of the mechanism, for
example) has arrays of its own. A set that cannot be assembled or integrated costs the others nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Lock

import numpy as np
from numpy.typing import ArrayLike

from consilience.case import Case
from consilience.engine import TrajectoryAnswer
from consilience.errors import InvalidInput, NumericalFailure, in_range, require
from consilience.mechanism import Array, Initial, Mechanism, State, drawing_state, float_array, initial_state
from consilience.mechanism.start import Start, checked_start
from consilience.reference.analyses.parameters import change_of
from consilience.reference.analyses.touching import refuse_laws
from consilience.reference.bodies.canonical import sample_times
from consilience.reference.solver import refuse_steep_friction, simulate
from consilience.reference.states.assembly import CompiledAssembly
from consilience.reference.tree.parameter_sets import OtherStructure, ParameterSets

_LARGEST_PART = 250
"""Largest number of sets whose numbers are computed at once."""

_PARTS = 4
"""Number of parts for each thread, because sets are not equally fast."""


_ONE_BY_ONE = (
    "Simulate one by one: [consilience.simulate(mechanism, state, times) for state in states]; "
    "consilience.reference.analyses.with_parameter sets a parameter."
)
"""What to do in place of many motions with contacts."""


def starts_of(states: Iterable[State]) -> list[State]:
    """Return the states that motions start from; refuse what is no sequence, and none.

    Raises
    ------
    InvalidInput
    """
    remedy = "Give a list of states, for example of random_states."
    require(states, Iterable, "states", remedy)
    if not (found := list(states)):
        raise InvalidInput("states", "there are none", remedy)
    return found


def columns_of(parameters: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Return the values of each parameter as an array of finite floats, shape (n,).

    Raises
    ------
    InvalidInput
    """
    remedy = "Give values by name: {'upper.mass': [1.0, 2.0]}."
    require(parameters, Mapping, "parameters", remedy)
    if not parameters:
        raise InvalidInput("parameters", "there are none", remedy)
    return {path: _column(path, values) for path, values in parameters.items()}


def changed_cases(case: Case, columns: Mapping[str, Array], grid: bool) -> list[Case]:
    """Return the case with all combinations of values of its parameters, or with one row of values after another.

    Parameters
    ----------
    case : Case
    columns : dict of str to ndarray, shape (n,)
        Values by name (`columns_of`).
    grid : bool
        All combinations, the last parameter varied fastest; else arrays of one length are taken row by row.

    Raises
    ------
    InvalidInput
        An unknown name, lists of different lengths, or an impossible value.
    """
    lengths = {path: len(column) for path, column in columns.items()}
    if not grid and len(set(lengths.values())) > 1:
        what = ", ".join(f"{path} has {n}" for path, n in lengths.items())
        raise InvalidInput("parameters", f"{what} values", "Give lists of one length, or ask for all combinations.")
    count = 1 if grid else next(iter(lengths.values()))
    cases = [case] * count
    for path, column in columns.items():
        change = change_of(case, path)
        pairs = ((c, v) for c in cases for v in column) if grid else zip(cases, column, strict=True)
        cases = [_changed(change, path, c, v) for c, v in pairs]
    return cases


def _column(path: str, values: ArrayLike) -> Array:
    remedy = "Give a list of numbers."
    found = np.atleast_1d(float_array(values, f"parameter '{path}'", remedy))
    if found.ndim != 1 or not len(found) or not np.all(np.isfinite(found)):
        raise InvalidInput(f"parameter '{path}'", "its values are no list of finite numbers", remedy)
    return found


def _changed(change: Callable[[Case, float], Case], path: str, case: Case, value: float) -> Case:
    try:
        return change(case, value)
    except InvalidInput as error:
        raise type(error)(f"parameter '{path}' = {value:g}: {error.where}", error.what, error.remedy) from None


@dataclass(frozen=True, eq=False)
class ManyMotions:
    """Motions of n sets at n_t times.

    Attributes
    ----------
    time : ndarray, shape (n_t,), s
    p_WB, quat_WB, v_WB_W, w_WB_W : ndarray, shape (n, n_t, n_b, 3 or 4)
        As in `TrajectoryAnswer`; NaN where a set has no motion.
    failures : dict of int to str
        Why a set has no motion.
    rebuilt : list of int
        Sets of another structure.
    """

    time: Array
    p_WB: Array
    quat_WB: Array
    v_WB_W: Array
    w_WB_W: Array
    failures: dict[int, str] = field(default_factory=dict)
    rebuilt: list[int] = field(default_factory=list)

    @classmethod
    def empty(cls, sets: int, time: Array, bodies: int) -> ManyMotions:
        """Return motions without values."""
        p, quat, v, w = (np.full((sets, len(time), bodies, width), np.nan) for width in (3, 4, 3, 3))
        return cls(time, p, quat, v, w)

    def put(self, n: int, answer: TrajectoryAnswer) -> None:
        """Store the motion of set n."""
        self.p_WB[n], self.quat_WB[n] = answer.p_WB, answer.quat_WB
        self.v_WB_W[n], self.w_WB_W[n] = answer.v_WB_W, answer.w_WB_W


@dataclass(frozen=True, eq=False)
class _Job:
    """What is asked, and where it is stored."""

    base: Mechanism
    mechanisms: Sequence[Mechanism]
    starts: Sequence[State | Initial]
    tolerance: float
    found: ManyMotions
    done: Callable[[int], None]


def simulate_many(
    base: Mechanism,
    mechanisms: Sequence[Mechanism],
    starts: Sequence[State | Initial],
    times: Array,
    tolerance: float = 1e-9,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> ManyMotions:
    """Integrate the motions of many mechanisms that differ from a base in numbers.

    Parameters
    ----------
    base : Mechanism
        Its characteristic length scales the tolerances.
    mechanisms : sequence of Mechanism, length n
    starts : sequence of State or Initial, length n
        Consistent states, or initial conditions to assemble.
    times : ndarray, shape (n_t,), s
    tolerance : float
        As in `consilience.reference.simulate`, 1e-14 to 1e-3.
    threads : int, optional
        Default: one for each processor.
    progress : callable, optional
        Called with the number of sets done so far, from any thread.

    Raises
    ------
    InvalidInput
        A tolerance out of range, times that do not increase, contacts, or friction that no step resolves. What is wrong
        with one set is among the failures.
    """
    in_range("tolerance", tolerance, 1e-14, 1e-3, "Choose 1e-14 to 1e-3.")
    refuse_laws(base, "the compiled model of many motions", _ONE_BY_ONE)
    for mechanism in mechanisms if base.frictions else ():
        refuse_steep_friction(mechanism)
    found, count, lock = ManyMotions.empty(len(mechanisms), sample_times(times), len(base.bodies)), [0], Lock()

    def done(sets: int) -> None:
        with lock:
            count[0] += sets
            if progress is not None:
                progress(count[0])

    job = _Job(base, mechanisms, starts, float(tolerance), found, done)
    threads = max(1, min(threads or os.cpu_count() or 1, len(mechanisms)))
    size = max(1, min(_LARGEST_PART, -(-len(mechanisms) // (threads * _PARTS))))
    parts = [range(n, min(n + size, len(mechanisms))) for n in range(0, len(mechanisms), size)]
    if threads == 1:
        for part in parts:
            _simulate_part(job, part)
    else:
        with ThreadPoolExecutor(threads) as pool:
            for ended in [pool.submit(_simulate_part, job, part) for part in parts]:
                ended.result()
    return found


def _simulate_part(job: _Job, part: range) -> None:
    """Integrate consecutive sets; those of another structure are found by halving."""
    try:
        sets = ParameterSets(job.base, [job.mechanisms[n] for n in part])
    except OtherStructure:
        if len(part) == 1:
            _simulate_alone(job, part[0])
            return
        middle = part.start + len(part) // 2
        _simulate_part(job, range(part.start, middle))
        _simulate_part(job, range(middle, part.stop))
        return
    assembly, drawing = CompiledAssembly(job.base, sets.model, sets.com), drawing_state(job.base)
    known: dict[int, Start] = {}
    for k, n in enumerate(part):
        sets.select(k)
        try:
            state = job.starts[n]
            if isinstance(state, Initial):
                state = _assembled(assembly, job.base, job.mechanisms[n], state, drawing, known)
            job.found.put(n, sets.simulate(state, job.found.time, job.tolerance))
        except (InvalidInput, NumericalFailure, np.linalg.LinAlgError) as error:
            job.found.failures[n] = str(error)
    job.done(len(part))


def _assembled(
    assembly: CompiledAssembly,
    base: Mechanism,
    mechanism: Mechanism,
    initial: Initial,
    drawing: State,
    known: dict[int, Start],
) -> State:
    """Return the state of a set, whose bodies are drawn like those of the base in nearly every study.

    Parameters
    ----------
    assembly : CompiledAssembly
        With the numbers of the set.
    base, mechanism : Mechanism
    initial : Initial
    drawing : State
        Of the base.
    known : dict of int to Start
        Starts by the identity of their initial conditions.
    """
    drawn_alike = all(own.drawing is other.drawing for own, other in zip(base.bodies, mechanism.bodies, strict=True))
    if not drawn_alike:
        found = assembly.assemble(checked_start(mechanism, initial), 0.0)
    else:
        if id(initial) not in known:
            known[id(initial)] = checked_start(mechanism, initial, drawing)
        found = assembly.assemble(known[id(initial)], 0.0)
    return initial_state(mechanism, initial) if found is None else found


def _simulate_alone(job: _Job, n: int) -> None:
    """Integrate a set of another structure."""
    job.found.rebuilt.append(n)
    start = job.starts[n]
    try:
        state = initial_state(job.mechanisms[n], start) if isinstance(start, Initial) else start
        answer = simulate(job.mechanisms[n], state, job.found.time, job.tolerance, "relative")
        job.found.put(n, answer)
    except (InvalidInput, NumericalFailure) as error:
        job.found.failures[n] = str(error)
    job.done(1)
