"""Parameter sets of one mechanism: its numbers, written set by set into arrays that are prepared once.

Mechanisms that differ in numbers alone have the same tree, rows and elements. Their numbers are computed for all sets
at once, in arrays with an axis for the sets in front, and one set at a time is written into the arrays that the kernels
read.
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
from consilience.reference.tree.planar_detection import planar_numbers
from consilience.reference.tree.solver import PreparedMechanism, longest_step, prepare, simulate_prepared


class OtherStructure(Exception):
    """The mechanisms differ in more than numbers."""


class ParameterSets:
    """Motions of mechanisms that differ in numbers alone; not to be used by two threads at once.

    Parameters
    ----------
    base : Mechanism
        Its characteristic length scales the tolerances of all.
    mechanisms : sequence of Mechanism

    Attributes
    ----------
    model, com : Model and ndarray, shape (n_b, 3), m
        Arrays and centres of mass of the selected mechanism.

    Raises
    ------
    OtherStructure
        A mechanism has other joints or elements than the base, or moves in a plane and the base does not.
    """

    def __init__(self, base: Mechanism, mechanisms: Sequence[Mechanism]) -> None:
        self._mechanisms, self._prepared, self._selected = mechanisms, prepare(base), 0
        self._numbers = list(_numbers(self._prepared, base, mechanisms))
        self.model, self.com = self._prepared.model, self._prepared.links.com

    def select(self, n: int) -> None:
        """Write the numbers of the n-th mechanism into the arrays."""
        self._selected = n
        for array, values in self._numbers:
            array[...] = values[n]

    def simulate(self, state: State, times: Array, tolerance: float) -> TrajectoryAnswer:
        """Return the motion of the selected mechanism; see `consilience.reference.simulate`."""
        prepared = self._prepared
        if len(prepared.model.functions.period):
            prepared = prepared._replace(longest=longest_step(prepared.model))
        return simulate_prepared(prepared, self._mechanisms[self._selected], state, times, tolerance)


def _numbers(
    prepared: PreparedMechanism, base: Mechanism, mechanisms: Sequence[Mechanism]
) -> Iterator[tuple[Array, Array]]:
    """Yield the arrays of the base that differ in a set, and their values, the sets in front."""
    models = [model_arrays(m) for m in mechanisms]
    _stacked([model_arrays(base), models[0]])
    model = _stacked(models)
    spanning = _stacked_tree(prepared, model)
    com = np.array([[body.com for body in m.bodies] for m in mechanisms])
    links = prepared.links._replace(constants=link_constants(spanning, model), com=com)
    given: list[tuple[Any, Any]] = [(prepared.model, model), (prepared.cut, spanning.cut), (prepared.links, links)]
    system = prepared.tree_system
    if system.planar is not None:
        found = planar_numbers(links, spanning, model)
        if found is None:
            raise OtherStructure
        given += [(system.tree.link, found.link), (system.tree.free, found.free), (system.planar, found.planar)]
    elif system.spatial is not None:
        given += [(system.tree.link, link_records(links, model.gravity))]
        given.append((system.spatial.joints, cut_joints(spanning, model)))
    for array, values in _pairs(given):
        if values.shape[1:] != array.shape:
            raise OtherStructure
        if np.any(values != array):
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
    if isinstance(first, np.ndarray) and any(one.tobytes() != first.tobytes() for one in given):
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
