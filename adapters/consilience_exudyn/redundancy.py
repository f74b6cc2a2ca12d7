"""Choice of independent constraint equations for Exudyn's integrators.

With dependent rows Exudyn's matrices are singular: initial accelerations become zero with a console warning, the
integrators stop, and TrapezoidalIndex2 may lock an over-constrained mechanism and report success. The rows of the
joints of a spanning tree are independent; of each joint that closes a loop, then of each element, as many axes are held
as the joint or element adds to the rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from consilience.engine import numerical_rank
from consilience.errors import CannotAssemble
from consilience.mechanism import Array, Mechanism, State, initial_state, random_states, spanning_tree
from consilience_exudyn.maximal import Axes, build, full_axes
from consilience_exudyn.rows import rows_of
from consilience_exudyn.terms import Terms

_STATES = 4
_SEED = 20
_NAMES = ("translation x", "translation y", "translation z", "rotation x", "rotation y", "rotation z")


def independent_axes(mechanism: Mechanism, along: Sequence[State] = ()) -> tuple[Axes, ...]:
    """Choose the constrained axes of every joint and row such that the equations are independent.

    The smallest singular value of the chosen rows, in Exudyn's own Jacobian, is largest in the worst of some states.

    Parameters
    ----------
    mechanism : Mechanism
    along : sequence of State
        States of a motion; by default the drawing and a few states along its branch.
    """
    full = full_axes(mechanism)
    _, closing = spanning_tree(mechanism)
    optional = [*closing, *range(len(mechanism.joints), len(full))]
    if not optional:
        return full
    drawing = initial_state(mechanism)
    states = [drawing, *_nearby(mechanism, drawing)]
    if min(_ranks(mechanism, states, full)) == equations(full):
        return full
    held = [tuple(0 for _ in axes) if k in optional else axes for k, axes in enumerate(full)]
    for k in optional:
        before = _ranks(mechanism, states, held)
        after = _ranks(mechanism, states, _with(held, k, full[k]))
        added = max(after) - max(before)
        if added == sum(full[k]):
            held[k] = full[k]
        else:
            regular = [s for s, r in zip(states, after, strict=True) if r == max(after)]
            held[k] = _best(mechanism, along or regular, held, k, added)
    return tuple(held)


def _nearby(mechanism: Mechanism, drawing: State) -> list[State]:
    """Return a few states along the branch of the drawing; none of a mechanism that is rigid beside it."""
    try:
        return random_states(mechanism, drawing, _STATES, _SEED)
    except CannotAssemble:
        return []


def equations(held: Sequence[Axes]) -> int:
    """Count the equations that are held."""
    return sum(map(sum, held))


def left_out(mechanism: Mechanism, held: Sequence[Axes]) -> dict[str, str]:
    """Return the axes that are left out, in words, by the name of the joint or element."""
    joints = [(joint.name, ("distance",) if joint.kind == "rod" else _NAMES) for joint in mechanism.joints]
    named = [*joints, *((row.name, row.axes) for row in rows_of(mechanism))]
    words: dict[str, str] = {}
    for (name, names), axes, full in zip(named, held, full_axes(mechanism), strict=True):
        dropped = [word for word, mine, all_ in zip(names, axes, full, strict=False) if all_ > mine]
        if dropped:
            words[name] = ", ".join([words[name], *dropped] if name in words else dropped)
    return words


def smallest_singular_value(J: Array, count: int) -> float:
    """Return the `count`-th singular value of J relative to the largest; one if `count` is zero."""
    if count == 0:
        return 1.0
    singular = np.linalg.svd(J, compute_uv=False)
    return float(singular[count - 1] / singular[0])


def _with(held: Sequence[Axes], k: int, axes: Axes) -> tuple[Axes, ...]:
    return (*held[:k], axes, *held[k + 1 :])


def _jacobians(mechanism: Mechanism, states: Sequence[State], held: Sequence[Axes]) -> list[Array]:
    terms = Terms(build(mechanism, states[0], tuple(held)))
    return [terms.constraint_jacobian(state) for state in states]


def _ranks(mechanism: Mechanism, states: Sequence[State], held: Sequence[Axes]) -> list[int]:
    return [numerical_rank(J) for J in _jacobians(mechanism, states, held)]


def _best(mechanism: Mechanism, states: Sequence[State], held: Sequence[Axes], k: int, count: int) -> Axes:
    """Choose `count` axes of joint or row k such that the smallest singular value is largest in the worst state.

    Parameters
    ----------
    mechanism : Mechanism
    states : sequence of State
    held : sequence of Axes
        Axes of all joints and rows; entry k is replaced by each candidate.
    k : int
    count : int
    """
    full = held_axes = full_axes(mechanism)[k]
    best = -1.0
    for chosen in combinations([n for n, axis in enumerate(full) if axis], count):
        axes = tuple(int(n in chosen) for n in range(len(full)))
        trial = _with(held, k, axes)
        worst = min(smallest_singular_value(J, equations(trial)) for J in _jacobians(mechanism, states, trial))
        if worst > best:
            best, held_axes = worst, axes
    return held_axes
