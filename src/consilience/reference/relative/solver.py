"""The relative form behind canonical states and observables."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Mechanism, State
from consilience.reference.canonical import canonical_motion
from consilience.reference.formulations.recursive_model import TreeModel
from consilience.reference.integrators.dop853 import STATUS
from consilience.reference.model import Model
from consilience.reference.relative.gauss import gauss_scratch, integrate_gauss
from consilience.reference.relative.integrate import Scratch, integrate, scratch
from consilience.reference.relative.methods import DOP853, TP86
from consilience.reference.relative.model import Links, Rest, System, flatten_relative, lasting, renewed, system
from consilience.reference.relative.packing import pack_relative
from consilience.reference.relative.planar_model import planar
from consilience.run import TrajectoryAnswer
from consilience.spatial import Array

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

    system: System
    scratch: Scratch
    lasting: list[tuple[Array, Array]]  # those that it would leave to the next, and what they were


class _Prepared(NamedTuple):
    """What is the same in all motions of a mechanism."""

    links: Links
    spanning: TreeModel
    model: Model
    system: System  # nothing written into it yet
    tree_alone: bool  # whether the tables of the tree (and of a plane) say all
    longest: float  # step, s
    integrator: str  # where none is asked for
    idle: list[_Working]  # of motions that have ended: making them takes longer than a short motion

    def working(self) -> _Working:
        """Arrays that no other motion writes into."""
        try:
            taken = self.idle.pop()
        except IndexError:
            arrays = renewed(self.system)
            own = scratch(np.zeros(len(self.links.kind)), self.motion_of(arrays))
            return _Working(arrays, own, lasting(arrays, self.system))
        for array, first in taken.lasting:
            array[...] = first
        return taken

    def motion_of(self, arrays: System) -> Rest | None:
        """What an integrator takes beside the tree."""
        return None if self.tree_alone else arrays.rest


@lru_cache(maxsize=8)
def _prepared(mechanism: Mechanism, in_space: bool) -> _Prepared:
    """Of the mechanisms asked last: making it takes as long as some thousand evaluations.

    In space even where they move in parallel planes, if that is asked for.
    """
    links, spanning, model = flatten_relative(mechanism)
    arrays = None if in_space else planar(mechanism, links, spanning, model)
    arrays = arrays or system(mechanism, links, spanning, model)
    tree_alone = links.free if arrays.plane is None else not len(arrays.rest.loops.group)
    integrator = "dop853" if len(model.functions.pieces) else "tp86"
    return _Prepared(links, spanning, model, arrays, tree_alone, longest_step(model), integrator, [])


METHODS = {"tp86": TP86, "dop853": DOP853}
"""Methods of `integrate`. The first looks a little beyond the end of a step, where a table may have ended."""

INTEGRATORS = (*METHODS, "gauss")
"""Compiled integrators of the relative form."""


def simulate_relative(
    mechanism: Mechanism, state: State, times: Array, tolerance: float, integrator: str | None = None
) -> TrajectoryAnswer:
    """Motion of a mechanism; arguments as of `consilience.reference.simulate`, with one of `INTEGRATORS`.

    If none is given, ``tp86``, or ``dop853`` where a function is a table.

    Raises
    ------
    NumericalFailure
        With the status of the integrator.
    """
    prepared = _prepared(mechanism, integrator == "gauss")
    integrator = integrator or prepared.integrator
    working = prepared.working()
    tree, _, space, elements, plane = working.system
    rest = prepared.motion_of(working.system)
    z = pack_relative(prepared.links, prepared.spanning, prepared.model, state)
    motion, counters = np.empty((len(times), *tree.y.shape)), np.zeros(3, dtype=np.int64)
    asked = times, float(tolerance), prepared.longest
    if integrator == "gauss":
        status = integrate_gauss(tree, rest, space, elements, z, *asked, motion, counters, gauss_scratch(z, rest))
    else:
        method = METHODS[integrator]
        status = integrate(tree, rest, space, elements, plane, method, z, *asked, motion, counters, working.scratch)
    if status:
        raise NumericalFailure(f"reference, relative, {integrator}, tolerance {tolerance:g}: {STATUS[status]}")
    prepared.idle.append(working)  # not after a failure, which may leave what is not a number
    p, quat, v, w = canonical_motion(prepared.links.com, motion)
    names = ("steps", "rejected", "evaluations")
    counts: dict[str, int | float] = dict(zip(names, counters.tolist(), strict=True))
    return TrajectoryAnswer(times, p, quat, v, w, counts)
