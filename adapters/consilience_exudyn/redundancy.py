"""Which constraint equations to leave out, so that Exudyn's integrators see independent ones.

With dependent rows Exudyn's matrices are singular: initial accelerations become zero with a console warning,
the integrators stop, and TrapezoidalIndex2 has been seen to lock an over-constrained mechanism and report success.
The rows of the tree are always independent; of each joint that closes a loop as many axes are held as it adds to the
rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from consilience.assembly import initial_state, random_states
from consilience.mechanism import Mechanism, State
from consilience.spatial import Array
from consilience.tree import lower
from consilience_exudyn.maximal import JOINT_ITEMS, Axes, build, full_axes
from consilience_exudyn.pointwise import rank
from consilience_exudyn.terms import Terms

_STATES = 4
_SEED = 20
_NAMES = ("translation x", "translation y", "translation z", "rotation x", "rotation y", "rotation z")


def independent_axes(mechanism: Mechanism) -> tuple[Axes, ...]:
    """Constrained axes of every joint such that no equation depends on the others.

    The choice is made by Exudyn's own Jacobian in the drawing and at a few states along its branch, for the set whose
    smallest singular value is largest in the worst of them. It depends on the mechanism only.
    """
    held = list(full_axes(mechanism))
    closing = [weld.joint for weld in lower(mechanism).welds]
    if not closing:
        return tuple(held)
    drawing = initial_state(mechanism)
    states = [drawing, *random_states(mechanism, drawing, _STATES, _SEED)]
    for k in closing:
        held[k] = tuple(0 for _ in held[k])
    for k in closing:
        before = _ranks(mechanism, states, held)
        full = JOINT_ITEMS[mechanism.joints[k].kind].axes
        after = _ranks(mechanism, states, _with(held, k, full))
        added = max(after) - max(before)
        if added == sum(full):
            held[k] = full
        else:
            regular = [s for s, r in zip(states, after, strict=True) if r == max(after)]
            held[k] = _best(mechanism, regular, held, k, added)
    return tuple(held)


def left_out(mechanism: Mechanism, held: Sequence[Axes]) -> dict[str, str]:
    """Axes each joint no longer constrains, in words, by the name of the joint."""
    words = {}
    for joint, axes in zip(mechanism.joints, held, strict=True):
        full = JOINT_ITEMS[joint.kind].axes
        names = ("distance",) if joint.kind == "rod" else _NAMES
        dropped = [name for name, mine, all_ in zip(names, axes, full, strict=False) if all_ > mine]
        if dropped:
            words[joint.name] = ", ".join(dropped)
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
    return [rank(J) for J in _jacobians(mechanism, states, held)]


def _best(mechanism: Mechanism, states: Sequence[State], held: Sequence[Axes], k: int, count: int) -> Axes:
    """Of all ways to hold `count` axes of joint k, the one that stays furthest from losing rank."""
    full = held_axes = JOINT_ITEMS[mechanism.joints[k].kind].axes
    best = -1.0
    for chosen in combinations([n for n, axis in enumerate(full) if axis], count):
        axes = tuple(int(n in chosen) for n in range(len(full)))
        trial = _with(held, k, axes)
        equations = sum(sum(a) for a in trial)
        worst = min(smallest_singular_value(J, equations) for J in _jacobians(mechanism, states, trial))
        if worst > best:
            best, held_axes = worst, axes
    return held_axes
