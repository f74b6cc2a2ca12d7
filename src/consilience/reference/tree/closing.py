"""Projection of a state that a step has left a little open, by elimination, compiled; in space alone. See `null_space`.

Where it cannot be done, or does not close the loops, `settling.project` goes on with the fronts.
"""

from __future__ import annotations

from consilience.mechanism import Array
from consilience.reference.kernel.compiled import fused, inlined, inner
from consilience.reference.tree.arrays import LARGEST_RANK, PIVOT, Elements, Rest, Space
from consilience.reference.tree.articulated import inertias
from consilience.reference.tree.either import cut_rows, eliminate, measure_rows, open_speeds, place_at
from consilience.reference.tree.few_freedoms import (
    SOUND,
    TWO,
    is_small,
    put_targets,
    rank_chosen,
    reduce_again,
    reduce_links,
    solve_rows,
)
from consilience.reference.tree.kinematics import displace
from consilience.reference.tree.plane import Plane

POSITION_STEPS = 3
"""Steps of Newton's method at most."""

CLOSED = 1e-9
"""Correction of an angle, or of a length in m, whose square rounding hides: the next one would do nothing."""


@inner
def largest(x: Array, count: int) -> float:
    """Largest size of the first numbers of an array."""
    found = 0.0
    for n in range(count):
        found = max(found, abs(x[n]))
    return found


@inner
def opened(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array
) -> float:
    """Cut rows of the bodies as they are placed; their violation."""
    rest.fronts.wanted[:] = 1
    cut_rows(rest, space, elements, plane, t, z)
    measure_rows(rest, space, plane)
    return largest(rest.value, rest.held) / max(1.0, rest.length)


@inlined
def _is_regular(rest: Rest, space: Space) -> bool:
    """Whether elimination will do: few directions are free, and all rows hold positions and have been independent.

    Of rows that depend on others those are to be chosen anew after each step which are the most independent.
    """
    group, state, count = rest.loops.group, rest.fronts.state, rest.fronts.W.shape[0]
    return (
        is_small(group, state, space.reduced.left)
        and rank_chosen(group, state) == count
        and rest.best[LARGEST_RANK] == count
        and rest.held == count
    )


@inlined
def note_pivot(rest: Rest, space: Space) -> None:
    """The least pivot of the rows, once."""
    if rest.best[PIVOT] == 0.0 and _is_regular(rest, space):
        rest.best[PIVOT] = eliminate(rest.loops, rest.fronts, space.reduced, rest.link, rest.free)[2]


@inner
def _is_sound(least: float, best: Array) -> bool:
    """Whether the least pivot is about as large as it has been."""
    return SOUND * best[PIVOT] <= least <= best[PIVOT]


@fused
def pull(rest: Rest, space: Space, elements: Elements | None, t: float, z: Array, seen: bool) -> bool:
    """`settling.project` by elimination, each time of coordinates and speeds at once.

    The speeds are closed in the pose before its correction u, and open by about ``u v`` afterwards. Where the state is
    seen, that is taken away by one time more, otherwise by the next step. False, with z closed as far as it came, where
    the rows are not `_is_regular` or the least pivot is not `_is_sound`.
    """
    loops, fronts, few, link, free, u = rest.loops, rest.fronts, space.reduced, rest.link, rest.free, rest.u
    group, order, state, value, target = loops.group, fronts.order, fronts.state, rest.value, fronts.target
    if rest.best[PIVOT] == 0.0 or not _is_regular(rest, space):
        return False
    closed = False
    for _ in range(POSITION_STEPS + 1):
        inertias(link)
        opened(rest, space, elements, None, t, z)
        open_speeds(rest, space, None)
        put_targets(group, order, state, target, few.J, u.shape[0] + 1)
        for row in range(target.shape[0]):
            target[row] = -value[row]
        put_targets(group, order, state, target, few.J, u.shape[0])
        rows, freedoms, least = solve_rows(loops, fronts, few, link, free, TWO)
        if not _is_sound(least, rest.best):
            # the fronts have their own measure of it, which has to follow
            rest.best[PIVOT] = max(rest.best[PIVOT], least)
            return False
        reduce_links(few, rows, freedoms, link, free, u, 0.0)
        displace(rest.layout, z, u)
        last = closed or not seen
        closed = largest(u, u.shape[0]) < CLOSED
        reduce_again(few, rows, freedoms, link, free, u)
        for n in range(u.shape[0]):
            z[rest.speeds + n] += u[n]
        done = closed and last
        if seen or elements is not None or not done:
            place_at(rest, space, elements, None, z)
        if done:
            return True
    return False
