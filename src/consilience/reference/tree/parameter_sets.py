"""Parameter sets of one mechanism: its numbers, written set by set into arrays that are prepared once.

Mechanisms that differ in numbers alone have the same tree, rows and elements. Their numbers are computed for all sets
at once, in arrays with an axis for the sets in front, and one set at a time is written into the arrays that the kernels
read. Tolerances are scaled by the characteristic length of the first set.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import Array, Mechanism, State
from consilience.reference.bodies.arrays import Model, model_arrays
from consilience.reference.bodies.spanning_tree import TreeModel
from consilience.reference.tree.arrays import link_constants, link_records
from consilience.reference.tree.loop_rows import cut_joints
from consilience.reference.tree.planar_detection import planar_system
from consilience.reference.tree.solver import PreparedMechanism, longest_step, prepare, simulate_prepared


class OtherStructure(Exception):
    """The mechanisms differ in more than numbers."""


class ParameterSets:
    """Motions of mechanisms that differ in numbers alone; not to be used by two threads at once.

    Parameters
    ----------
    mechanisms : sequence of Mechanism

    Raises
    ------
    OtherStructure
        A mechanism has other joints or elements, or does not move in the plane of the first one.
    """

    def __init__(self, mechanisms: Sequence[Mechanism]) -> None:
        self.mechanisms, self._prepared = mechanisms, prepare(mechanisms[0])
        self._numbers = list(_numbers(self._prepared, mechanisms))

    def simulate(self, n: int, state: State, times: Array, tolerance: float) -> TrajectoryAnswer:
        """Return the motion of the n-th mechanism; arguments and errors as in `consilience.reference.simulate`."""
        for array, values in self._numbers:
            array[...] = values[n]
        prepared = self._prepared._replace(longest=longest_step(self._prepared.model))
        return simulate_prepared(prepared, self.mechanisms[n], state, times, tolerance)


def _numbers(prepared: PreparedMechanism, mechanisms: Sequence[Mechanism]) -> Iterator[tuple[Array, Array]]:
    """Yield the arrays of a prepared mechanism that differ between sets, and their values, the sets in front."""
    model = _stacked([model_arrays(m) for m in mechanisms])
    spanning = _stacked_tree(prepared, model)
    com = np.array([[body.com for body in m.bodies] for m in mechanisms])
    links = prepared.links._replace(constants=link_constants(spanning, model), com=com)
    given: list[tuple[Any, Any]] = [(prepared.model, model), (prepared.cut, spanning.cut), (prepared.links, links)]
    system = prepared.tree_system
    if system.planar is not None:
        found = planar_system(mechanisms[0], links, spanning, model)
        if found is None:
            raise OtherStructure
        given += [(system.tree.link, found.tree.link), (system.tree.free, found.tree.free)]
        given.append((system.planar, found.planar))
    elif system.spatial is not None:
        given += [(system.tree.link, link_records(links, model.gravity))]
        given.append((system.spatial.joints, cut_joints(spanning, model)))
    for array, values in _pairs(given):
        if values.shape[1:] != array.shape:
            raise OtherStructure
        if np.any(values != values[:1]):
            yield array, values


def _stacked(given: Sequence[Any]) -> Any:
    """Return named tuples of arrays as one, arrays with fractions stacked; other values have to be equal."""
    first = given[0]
    if hasattr(first, "_fields"):
        return first._replace(**{name: _stacked([getattr(one, name) for one in given]) for name in first._fields})
    if isinstance(first, np.ndarray) and first.size and _has_fractions(first.dtype):
        if any(one.shape != first.shape for one in given):
            raise OtherStructure
        return np.stack(given)
    if isinstance(first, np.ndarray) and any(not np.array_equal(one, first) for one in given):
        raise OtherStructure
    return first


def _has_fractions(kind: np.dtype[Any]) -> bool:
    kinds = [field[0].base for field in kind.fields.values()] if kind.fields else [kind]
    return any(one.kind == "f" for one in kinds)


def _stacked_tree(prepared: PreparedMechanism, model: Model) -> TreeModel:
    """Return the spanning tree with the numbers of all sets."""
    spanning, kept = prepared.spanning, list[int]()
    for k, (first, last) in enumerate(zip(model.first_row[:-1], model.first_row[1:], strict=True)):
        own = prepared.cut.row_kind[prepared.cut.first_row[k] : prepared.cut.first_row[k + 1]]
        kept += [n for n in range(first, last) if model.row_kind[n] in own]
    rows = {name: getattr(prepared.cut, name) for name in ("first_row", "row_kind")}
    found: TreeModel = spanning._replace(cut=model._replace(**rows, row_target=model.row_target[:, kept]))
    return found


def _pairs(given: Sequence[tuple[Any, Any]]) -> Iterator[tuple[Array, Array]]:
    """Yield arrays and their stacked values of named tuples and records."""
    for one, other in given:
        if isinstance(one, np.ndarray):
            if other.ndim > one.ndim:
                yield one, other
        elif hasattr(one, "_fields"):
            yield from _pairs([(getattr(one, name), getattr(other, name)) for name in one._fields])
