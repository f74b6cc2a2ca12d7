"""Projection of the state z onto what closes the loops, and the choice of the rows that do, compiled.

In space or in a plane: the steps are the same, the kernels that take them are not. See `dynamics`.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import Model
from consilience.reference.bodies.joint_rows import coordinate
from consilience.reference.kernel.compiled import inlined, inner, kernel
from consilience.reference.tree.arrays import LARGEST_RANK, LEAST, Elements, Rest, Space, Tree
from consilience.reference.tree.closing import CLOSED, POSITION_STEPS, largest, note_pivot, opened, pull
from consilience.reference.tree.dynamics import remember
from consilience.reference.tree.either import (
    accelerate,
    articulate_links,
    force_rows,
    open_speeds,
    place_at,
    respond_to_rows,
)
from consilience.reference.tree.few_freedoms import SOUND
from consilience.reference.tree.kinematics import displace, normalise, place, place_bodies, place_links, record
from consilience.reference.tree.loop_groups import CHOSEN, RANK, ROW, ROW_END, USED, Fronts, Loops
from consilience.reference.tree.multifrontal import CHOOSE, factorise, threshold
from consilience.reference.tree.planar import place_planar, place_planar_bodies
from consilience.reference.tree.plane import Plane
from consilience.reference.tree.records import REST

_PASSING = 1e-4
"""Part of its largest value at which the least independent pivot counts as passing through zero."""
_TURN = 1.5
"""Most that an angle whose turns are counted may change in a step, rad: well below half a turn."""

SEEN = np.array([True])[0]
"""Of a state that is a sample, or that is kept."""

_PASSING_VIOLATION = 1e-11
"""Violation that rows left out on the way through a singular pose may have."""


@inner
def _displacements(
    loops: Loops, fronts: Fronts, space: Space | None, plane: Plane | None, link: Array, free: Array, u: Array
) -> None:
    """Displacements u of least M-norm that change the rows by the target of the fronts."""
    for n in range(free.shape[0]):
        free[n, REST] = 0.0
    force_rows(loops, fronts, free)
    accelerate(space, plane, link, free, u, 0.0)


@inner
def _choose_rows(
    loops: Loops,
    layout: Array,
    fronts: Fronts,
    space: Space | None,
    plane: Plane | None,
    link: Array,
    free: Array,
    smallest: float,
    size: float,
) -> tuple[int, float, float]:
    """Factorise the responses to all rows; rank, least pivot, and the square that counted as dependent."""
    group, state = loops.group, fronts.state
    for g in range(group.shape[0]):
        state[g, USED] = group[g, ROW_END] - group[g, ROW]
    largest = respond_to_rows(loops, layout, fronts, space, plane, link, free)
    smallest = max(smallest, threshold(size, largest))
    least = factorise(group, fronts.order, state, fronts.F, fronts.tau, smallest, CHOOSE)
    rank = 0
    for g in range(group.shape[0]):
        rank += state[g, RANK]
    return rank, least, smallest


@inner
def _work_with(loops: Loops, fronts: Fronts, rank: int, limit: Array) -> None:
    """Rows chosen until the next projection: those that are independent in the present factors."""
    for g in range(loops.group.shape[0]):
        fronts.state[g, CHOSEN] = fronts.state[g, RANK]
    limit[0] = rank


@inner
def _choose(
    loops: Loops,
    layout: Array,
    fronts: Fronts,
    space: Space | None,
    plane: Plane | None,
    link: Array,
    free: Array,
    size: float,
    best: Array,
    limit: Array,
    violation: float,
) -> None:
    """Choose the rows to work with until the next projection, and factorise the responses.

    A linkage may pass through a pose in which its rows lose rank (a flat parallelogram). Close to it they have the
    full rank still, but what they say of the accelerations drowns in rounding. There the rows that are about to become
    dependent are left out, as in the pose itself: the motion so far has satisfied them, and does so on the way
    through. Where it does not, in a linkage that comes near such a pose and turns, they are taken back.
    """
    rank, least, smallest = _choose_rows(loops, layout, fronts, space, plane, link, free, 0.0, size)
    if rank > best[LARGEST_RANK]:
        best[LARGEST_RANK], best[LEAST] = rank, least
    elif rank == best[LARGEST_RANK]:
        best[LEAST] = max(best[LEAST], least)
    if violation <= _PASSING_VIOLATION and least < _PASSING * best[LEAST]:
        passing = (_PASSING * best[LEAST]) ** 2
        fewer = _choose_rows(loops, layout, fronts, space, plane, link, free, passing, size)[0]
        if fewer:
            rank = fewer
        else:
            _choose_rows(loops, layout, fronts, space, plane, link, free, smallest, size)
    _work_with(loops, fronts, rank, limit)


@inner
def _keep(loops: Loops, fronts: Fronts, rank: int, least: float, best: Array, limit: Array) -> bool:
    """Go on with the factors of a pose that is apart by rounding, if they have the rank so far, far from losing it."""
    if rank != best[LARGEST_RANK] or least < SOUND * best[LEAST]:
        return False
    best[LEAST] = max(best[LEAST], least)
    _work_with(loops, fronts, rank, limit)
    return True


@inner
def _release(W: Array, held: int) -> None:
    """Take away the wrenches of the rows that hold no positions."""
    for row in range(held, W.shape[0]):
        for n in range(W.shape[1]):
            for r in range(W.shape[2]):
                W[row, n, r] = 0.0


@kernel
def find_rank(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array
) -> None:
    """Independent rows of a state whose loops are closed, into ``rest.fronts``; places the bodies."""
    place_at(rest, space, elements, plane, z)
    if rest.loops.group.shape[0]:
        violation = opened(rest, space, elements, plane, t, z)
        articulate_links(space, plane, rest.link, rest.free)
        loops, fronts, link, free = rest.loops, rest.fronts, rest.link, rest.free
        _choose(loops, rest.layout, fronts, space, plane, link, free, rest.size[0], rest.best, rest.limit, violation)


@inlined
def _close(rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array) -> None:
    """`project` by the fronts, whatever the rows are and however far they are open."""
    loops, layout, fronts, link, free, u = rest.loops, rest.layout, rest.fronts, rest.link, rest.free, rest.u
    speeds, held, size = rest.speeds, rest.held, rest.size
    W, target, value = fronts.W, fronts.target, rest.value
    last, violation, rank, least = False, 0.0, 0, 0.0
    for step in range(POSITION_STEPS + 1):
        violation = opened(rest, space, elements, plane, t, z)
        if last:
            break
        articulate_links(space, plane, link, free)
        if step == POSITION_STEPS or violation <= 2e-16:
            break
        _release(W, held)
        rank, least, _ = _choose_rows(loops, layout, fronts, space, plane, link, free, 0.0, size[0])
        for row in range(target.shape[0]):
            target[row] = -value[row] if row < held else 0.0
        _displacements(loops, fronts, space, plane, link, free, u)
        last = largest(u, u.shape[0]) < CLOSED
        displace(layout, z, u)
        place_at(rest, space, elements, plane, z)
    # where the first correction is that small, the speeds have as little to be corrected, and its factors will do
    if not (last and step == 1 and held == W.shape[0] and _keep(loops, fronts, rank, least, rest.best, rest.limit)):
        if last:
            articulate_links(space, plane, link, free)
        _choose(loops, layout, fronts, space, plane, link, free, size[0], rest.best, rest.limit, violation)
    if space is not None:
        note_pivot(rest, space)
    open_speeds(rest, space, plane)
    _displacements(loops, fronts, space, plane, link, free, u)
    for n in range(u.shape[0]):
        z[speeds + n] += u[n]
    place_at(rest, space, elements, plane, z)


@inner
def project(
    rest: Rest, space: Space | None, elements: Elements | None, plane: Plane | None, t: float, z: Array, seen: bool
) -> None:
    """Bring z back to closed loops, in place: coordinates by Newton's method, then speeds, each of least M-norm.

    Newton's method goes on until rounding is reached: in a flat parallelogram, whose coordinates violate the rows by
    their square, a violation of 1e-14 is a coordinate that is wrong by 1e-7. Leaves the bodies placed at the state it
    ends with. A state that is not seen, no sample and nothing that is kept, may stay open by what the next step will
    take away, and its bodies are placed only where elements read them.
    """
    normalise(rest.layout, z)
    place_at(rest, space, elements, plane, z)
    if rest.loops.group.shape[0] == 0:
        return
    closed = False
    if space is not None:
        closed = pull(rest, space, elements, t, z, seen)
    if not closed:
        _close(rest, space, elements, plane, t, z)


@inlined
def settle(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    t: float,
    z: Array,
    seen: bool,
) -> None:
    """Bring a state back to closed loops, in place, and place the links at it: see `project`."""
    if rest is not None:
        project(rest, space, elements, plane, t, z, seen)
    elif plane is not None:
        place_planar(tree.link, tree.free, z, z[tree.speeds :])
    elif space is not None:
        normalise(tree.layout, z)
        place_links(tree.link, tree.free, z, z[tree.speeds :])


@inlined
def note(tree: Tree, space: Space | None, plane: Plane | None, motion: Array) -> None:
    """Record the bodies of links that are placed, as a sample of a motion."""
    if plane is not None:
        place_planar_bodies(plane.body, tree.link, tree.y, tree.A)
    if space is not None:
        place_bodies(tree.layout, tree.link, tree.y, tree.A)
    record(tree.A, tree.y, motion)


@inlined
def _turning(model: Model, y: Array, A: Array, memory: Array) -> float:
    """Longest step in which turns can be counted, from the rates of the bodies as they are placed."""
    rate = 0.0
    for n in range(memory.shape[0]):
        if model.counted[n]:
            rate = max(rate, abs(coordinate(model, y, A, n, memory[n]).rate))
    return _TURN / rate if rate > 0.0 else np.inf


@inlined
def longest_now(tree: Tree, elements: Elements | None, longest: float) -> float:
    """Longest step from where the bodies are placed."""
    if elements is None:
        return longest
    return min(longest, _turning(elements.model, tree.y, tree.A, elements.memory))


@inlined
def arrive(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    t: float,
    z: Array,
    seen: bool,
) -> None:
    """`settle` at the end of a step, and count the turns that elements read."""
    settle(tree, rest, space, elements, plane, t, z, seen)
    if elements is not None:
        remember(elements, tree.y, tree.A)


@inlined
def begin(
    tree: Tree,
    rest: Rest | None,
    space: Space | None,
    elements: Elements | None,
    plane: Plane | None,
    t: float,
    z: Array,
) -> None:
    """`arrive` at the start of a motion, where angles that elements read are within half a turn of zero."""
    if elements is not None:
        place(tree.layout, tree.link, tree.free, tree.speeds, z, tree.y, tree.A)
        remember(elements, tree.y, tree.A)
    arrive(tree, rest, space, elements, plane, t, z, SEEN)
