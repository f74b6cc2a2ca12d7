"""The relative form behind canonical states and observables."""

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
from consilience.reference.kernel.held import words_of
from consilience.reference.tree.arrays import Links, Rest, Run, System, flatten_relative, lasting, renewed, system
from consilience.reference.tree.explicit_rk import LEFT, integrate, scratch
from consilience.reference.tree.gauss import gauss_scratch, integrate_gauss
from consilience.reference.tree.methods import METHODS, Method
from consilience.reference.tree.planar_detection import planar
from consilience.reference.tree.radau13 import integrate_radau, radau_scratch
from consilience.reference.tree.state import Packing, pack_by
from consilience.reference.tree.taylor import STATUS, has_series, integrate_taylor, order_of, taylor_scratch

_CLOSE = 3.0
"""Steps of this many points of a table, or of this part of the period of a harmonic, miss nothing of it."""


def longest_step(model: Model) -> float:
    """Longest step, in s, that cannot pass over what functions of time do: no sample stops it there."""
    functions, longest = model.functions, np.inf
    of_time = [*model.drive[:, 1], *model.spring_function, *model.joint_spring[:, 1], *model.load_function]
    for n in {*of_time, *model.control[:, 1]} - {-1}:
        _, harmonic, piece = functions.first[n]
        _, harmonic_end, piece_end = functions.first[n + 1]
        for w in functions.harmonics[harmonic:harmonic_end, 1]:
            longest = min(longest, 2.0 * np.pi / (_CLOSE * abs(w)) if w else np.inf)
        for left, right in functions.pieces[piece:piece_end, :2]:
            longest = min(longest, _CLOSE * (right - left))
    return float(longest)


class _Working(NamedTuple):
    """Arrays that a motion writes into."""

    arrays: Run
    run: Run  # their words
    lasting: list[tuple[Array, Array]]  # those that it would leave to the next, and what they were


class _Prepared(NamedTuple):
    """What is the same in all motions of a mechanism."""

    links: Links
    packing: Packing  # its words
    system: System  # nothing written into it yet
    tree_alone: bool  # whether the tables of the tree (and of a plane) say all
    longest: float  # step, s
    usual: tuple[str, ...]  # integrators where none is asked for: the next one where one cannot go on
    idle: dict[str, list[_Working]]  # of motions that have ended, by integrator: making them takes longer than a motion

    def working(self, integrator: str) -> _Working:
        """Arrays that no other motion writes into."""
        try:
            taken = self.idle[integrator].pop()
        except IndexError:
            arrays = renewed(self.system)
            tree, closing, space, elements, plane = arrays
            rest = None if self.tree_alone else closing
            scratch_of = INTEGRATORS[integrator].scratch(np.zeros(len(self.links.kind)), arrays, rest)
            run = Run(tree, rest, space, elements, plane, scratch_of)
            return _Working(run, words_of(run), lasting(arrays, self.system))
        for array, first in taken.lasting:
            array[...] = first
        return taken


@lru_cache(maxsize=8)
def _prepared(mechanism: Mechanism, in_space: bool) -> _Prepared:
    """Of the mechanisms asked last: making it takes as long as some thousand evaluations.

    In space even where they move in parallel planes, if that is asked for.
    """
    links, spanning, model = flatten_relative(mechanism)
    arrays = None if in_space else planar(mechanism, links, spanning, model)
    arrays = arrays or system(mechanism, links, spanning, model)
    tree_alone = links.free if arrays.plane is None else not len(arrays.rest.loops.group)
    explicit = "dop853" if len(model.functions.pieces) else "tp86"
    usual = (*(["taylor"] if has_series(arrays, tree_alone) else []), explicit, "radau13")
    idle: dict[str, list[_Working]] = {name: [] for name in INTEGRATORS}
    return _Prepared(
        links, words_of(Packing(links, spanning, model)), arrays, tree_alone, longest_step(model), usual, idle
    )


class _Asked(NamedTuple):
    """What a motion is asked for, and what is filled: bodies at the samples, and counters."""

    z: Array
    times: Array
    tolerance: float
    longest: float  # step, s
    motion: Array
    counters: Array


class _Integrator(NamedTuple):
    """How an integrator is called."""

    scratch: Callable[[Array, System, Rest | None], Any]
    run: Callable[[Run, _Asked, bool], int]  # the status; may it leave a motion to another one?


def _run_method(method: Method, run: Run, asked: _Asked, leaves: bool) -> int:
    """A motion by a Runge-Kutta method."""
    return integrate(run, method, *asked, leaves)


def _run_gauss(run: Run, asked: _Asked, _leaves: bool) -> int:
    """A motion by collocation."""
    return integrate_gauss(run, *asked)


def _run_radau13(run: Run, asked: _Asked, _leaves: bool) -> int:
    """A motion by an implicit Runge-Kutta method."""
    return integrate_radau(run, *asked)


def _run_taylor(run: Run, asked: _Asked, _leaves: bool) -> int:
    """A motion by series."""
    z, times, tolerance, *others = asked
    return integrate_taylor(run, z, times, tolerance, order_of(tolerance), *others)


INTEGRATORS = {
    "taylor": _Integrator(taylor_scratch, _run_taylor),
    **{
        name: _Integrator(lambda z, arrays, rest: scratch(z, rest), partial(_run_method, words_of(method)))
        for name, method in METHODS.items()
    },
    "radau13": _Integrator(lambda z, arrays, rest: radau_scratch(z, rest), _run_radau13),
    "gauss": _Integrator(lambda z, arrays, rest: gauss_scratch(z, rest), _run_gauss),
}
"""Compiled integrators of the relative form; the first is for mechanisms in a plane without elements."""


def simulate_relative(
    mechanism: Mechanism, state: State, times: Array, tolerance: float, integrator: str | None = None
) -> TrajectoryAnswer:
    """Motion of a mechanism; arguments as of `consilience.reference.simulate`, with one of `INTEGRATORS`.

    If none is given, ``taylor`` where the mechanism has series (`taylor.has_series`), elsewhere ``tp86``, or ``dop853``
    where a function is a table; and ``radau13`` where that method finds the motion stiff.

    Raises
    ------
    InvalidInput
        A mechanism without series, if they are asked for.
    NumericalFailure
        With the status of the integrator.
    """
    prepared = _prepared(mechanism, integrator == "gauss")
    if integrator == "taylor" and "taylor" not in prepared.usual:
        why = "it is for mechanisms that move in parallel planes by gravity alone, without drives, couplings and rods"
        raise InvalidInput("integrator", f"taylor cannot follow {mechanism.name}: {why}", "Use tp86, or leave it out.")
    asked = pack_by(prepared.links, prepared.packing, state), times, float(tolerance)
    names = prepared.usual if integrator is None else (integrator,)
    for name in names:
        status, motion, counters = _run(prepared, name, *asked, name != names[-1])
        if status != LEFT:
            break
    if status:
        raise NumericalFailure(f"reference, relative, {name}, tolerance {tolerance:g}: {STATUS[status]}")
    p, quat, v, w = canonical_motion(prepared.links.com, motion)
    labels = ("steps", "rejected", "evaluations")
    counts: dict[str, int | float] = dict(zip(labels, counters.tolist(), strict=True))
    return TrajectoryAnswer(times, p, quat, v, w, counts)


def _run(
    prepared: _Prepared, name: str, z: Array, times: Array, tolerance: float, leaves: bool
) -> tuple[int, Array, Array]:
    """Status, bodies at the samples, and counters of an integrator from the state z."""
    working = prepared.working(name)
    motion, counters = np.empty((len(times), *working.arrays.tree.y.shape)), np.zeros(3, dtype=np.int64)
    asked = _Asked(z.copy(), times, tolerance, prepared.longest, motion, counters)
    status = INTEGRATORS[name].run(working.run, asked, leaves)
    if status in (0, LEFT):  # a failure may leave what is not a number
        prepared.idle[name].append(working)
    return status, motion, counters
