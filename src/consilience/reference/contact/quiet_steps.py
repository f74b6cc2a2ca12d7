"""Steps in which nothing happens, compiled: from step to step, until one in which an event may be.

`simulation` takes a step, and looks for what happens in it. These kernels take the same steps as long as nothing does:
all event functions that count are positive at the nodes of the step, with no low point between them, undetermined
forces keep clear of their bounds, slips are fast, those along a line keep to it, no friction jams, and no disc comes
flat. The first step that is not like that is taken back, for `simulation`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.algebra import dot_rows
from consilience.reference.contact.derivative import CARRY, FORCES, OBSERVE, SAMPLE, ActiveModes
from consilience.reference.contact.pairs import RowMotion
from consilience.reference.kernel.compiled import inner
from consilience.reference.kernel.operation import allocating_operation, array_of
from consilience.reference.kernel.record_type import INT, record_type
from consilience.reference.kernel.vectors import Vector, add, assign, cross, dot, load, scale, sub
from consilience.reference.steppers.explicit import ExplicitArrays, dense_output
from consilience.reference.steppers.motion import ATTEMPT, END_STEP, INTERPOLATE, PREPARE, Kernel, ask

GAP, NORMAL, MARGIN, SLIP = range(4)
"""Event functions of `events` that are compiled."""

PARTS, INTERVALS = 6, 96
"""Least number of parts of a step, and of a motion, at whose ends event functions are evaluated."""

SLOPES = np.divide(
    [[-25, 48, -36, 16, -3], [-3, -10, 18, -6, 1], [1, -8, 0, 8, -1], [-1, 6, -18, 10, 3], [3, -16, 36, -48, 25]], 12.0
)
"""Slopes of the polynomial of degree four through five equidistant values, at each of them, times the distance."""

ROUNDING = 1e-5
"""Value below zero, over that from which a function counts, from which one that rises counts."""

SHORTEST = 1e-14
"""Shortest step, over the time or a second."""

JAMS = 1e-6
"""Determinant of modes in which sliding friction counts as jammed."""

STILL = 1e-11
"""Rates that count as zero, over the speeds of the mechanism."""

STOPPING, STARTING = 1e-12, 3e-10
"""Slips over the same, below which the heading of what stops is kept, and up to which that of what starts."""

STRAIGHT = 3e-11
"""Turn of a slip, rad, below which it is along a line."""

SLOW = 1e-2
"""Largest slip that may make the motion stiff, over the speeds."""

WATCHED = record_type(
    ("kind", INT),
    ("row", INT, 2),  # of friction, the second -1 for one row; of a gap its index, then its row; of a normal its row
    ("load", INT),  # row; -1: none
    ("static", float),
    ("offset", float),  # constant part of the bound
    ("least", float),  # value above which nothing happens
    ("ready", float),  # value from which it counts
    ("armed", INT),  # whether it counts
    ("arms", INT),  # behind the step that is looked at
    ("disc", INT),  # index into the sets of the active modes of a disc that slides; else -1
    ("heading", float, 2),
)
"""Event function: a gap, a force, the margin of what sticks, or the slip along its heading."""

MARCH = record_type(
    ("bound", float),  # time at which to end, s
    ("longest", float),  # step, s
    ("span", float),  # of the motion, s
    ("length", float),  # of the mechanism, m
    ("bodies", INT),
    ("packed", INT),  # size of a packed state
    ("straight", float),  # turn of a slip up to which it has kept to its line, rad
    ("flat", float),  # sine of the tilt of a disc that is parallel to its plane
    ("speed", float),  # of the mechanism, m/s
    ("h", float),  # proposed length of the next step, s
    ("next", float),  # proposed behind the step that is looked at, s
    ("fresh", INT),  # whether the first step has none
    ("watched", INT),  # number of event functions
    ("loaded", INT),  # whether anything that slides can jam
    ("first", INT),  # sample of the march
    ("recorded", INT),  # number of samples so far
)
"""Scalars of a march."""


class MarchArrays(NamedTuple):
    """Record of the kernel."""

    now: Array  # (1,) of MARCH
    explicit: ExplicitArrays
    stepper: Kernel
    rows: RowMotion  # of the mechanism, like its modes and its turns
    modes: ActiveModes
    turns: Array
    watched: Array  # of WATCHED
    discs: Array  # (n_d,) of PAIR
    force: Array  # (m,)
    nodes: Array  # packed states with their times, in one row
    seen: Array  # gaps, rates and forces there
    times: Array  # (n_t,) s, of all samples
    states: Array  # (n_s, ...) times, packed states and turns of samples, n_s being the room for them
    sums: Array  # (n_s, n_sums) as `RowLayout.sums`
    found: Array  # (n_s, ...) what `derivative` writes of them


@inner
def _along(arrays: MarchArrays, k: int) -> tuple[float, float]:
    """Return the heading of disc k along the tangents of the last state."""
    frame, heading = arrays.rows.frame[arrays.modes.pair[k]], arrays.modes.heading[k]
    d0, d1 = dot_rows(frame[1], heading), dot_rows(frame[2], heading)
    size = np.sqrt(d0 * d0 + d1 * d1)
    return d0 / size, d1 / size


@inner
def _turn(arrays: MarchArrays) -> bool:
    """Let headings follow the slips at the last state; return False where `SlipHeadings` has to look at them."""
    modes, speed = arrays.modes, arrays.now[0].speed
    for w in range(arrays.now[0].watched):
        one = arrays.watched[w]
        if one.kind != SLIP or one.disc < 0:
            continue
        k = one.disc
        h0, h1 = _along(arrays, k)
        if np.isfinite(modes.slow[k]):
            u0, u1 = arrays.rows.u[one.row[0]], arrays.rows.u[one.row[1]]
            size = np.sqrt(u0 * u0 + u1 * u1)
            if size <= SLOW * speed or (not arrays.now[0].fresh and abs(h0 * u1 - h1 * u0) <= STRAIGHT * size):
                return False
            if u0 * h0 + u1 * h1 < 0.0:
                size = -size
            h0, h1, modes.slow[k] = u0 / size, u1 / size, STOPPING * speed
            frame = arrays.rows.frame[modes.pair[k]]
            for i in range(3):
                modes.heading[k, i] = h0 * frame[1, i] + h1 * frame[2, i]
        one.heading[0], one.heading[1] = h0, h1
    return True


@inner
def _slips_on(arrays: MarchArrays) -> bool:
    """Return whether slips are fast at the last state, and those along a line have kept to it."""
    speed = arrays.now[0].speed
    for w in range(arrays.now[0].watched):
        one = arrays.watched[w]
        if one.kind != SLIP or one.disc < 0:
            continue
        u0, u1 = arrays.rows.u[one.row[0]], arrays.rows.u[one.row[1]]
        size = np.sqrt(u0 * u0 + u1 * u1)
        if np.isfinite(arrays.modes.slow[one.disc]):
            if size <= SLOW * speed:
                return False
            continue
        h0, h1 = _along(arrays, one.disc)
        if size > 2.0 * STARTING * speed and abs(h0 * u1 - h1 * u0) > max(arrays.now[0].straight * size, STILL * speed):
            return False
    return True


@inner
def _value(one: Any, seen: Array, gaps: int, rows: int) -> float:
    """Return an event function from gaps, rates and forces at a state."""
    a, b = one.row[0], one.row[1]
    if one.kind == GAP:
        return seen[a]
    if one.kind == NORMAL:
        return seen[gaps + rows + a]
    if one.kind == SLIP:
        return seen[gaps + a] * one.heading[0] + (seen[gaps + b] * one.heading[1] if b >= 0 else 0.0)
    T0, T1 = seen[gaps + rows + a], seen[gaps + rows + b] if b >= 0 else 0.0
    bound = one.offset if one.load < 0 else seen[gaps + rows + one.load]
    return one.static * bound - np.sqrt(T0 * T0 + T1 * T1)


@inner
def _slope(one: Any, seen: Array, p: int, parts: int, gaps: int, rows: int) -> float:
    """Return the slope of an event function at node p, times the distance of two nodes, by five values."""
    first, width, found = min(max(p - 2, 0), parts - 4), gaps + 2 * rows, 0.0
    for j in range(5):
        at = (first + j) * width
        found += SLOPES[p - first, j] * _value(one, seen[at : at + width], gaps, rows)
    return found


@inner
def _stays_positive(one: Any, seen: Array, parts: int, step: float, gaps: int, rows: int) -> bool:
    """Return whether an event function that counts is positive at all nodes, with no low point between them.

    One that does not count yet is to stay near zero until it does, as in `events`.

    Parameters
    ----------
    one : record of WATCHED
    seen : ndarray
        Gaps, rates and forces at the nodes.
    parts : int
    step : float, s
        Between two nodes.
    gaps, rows : int
        Numbers of gaps, and of rates.
    """
    width, last, before, noise = gaps + 2 * rows, np.inf, 0.0, ROUNDING * one.ready
    one.arms = one.armed
    if not one.armed and one.least > 0.0:
        return False
    for p in range(parts + 1):
        here = seen[p * width : (p + 1) * width]
        value = _value(one, here, gaps, rows)
        rate = step * here[gaps + one.row[1]] if one.kind == GAP else _slope(one, seen, p, parts, gaps, rows)
        if one.arms:
            if not value > one.least:
                return False
            if before < 0.0 < rate and last * rate - value * before + before * rate <= 0.0:  # tangents meet
                return False
            last, before = value, rate
        elif value < -one.ready:
            return False
        elif value > one.ready or (one.kind == GAP and p < parts and value >= -noise and rate > noise):
            one.arms, last, before = 1, value, rate
    return True


@inner
def _turned(y: Array, body: int, a: Vector, sign: float) -> Vector:
    """Turn a vector from axes of a body to those of the world, or back (sign -1), at a packed state in one row."""
    if body < 0:
        return a
    e0, e = sign * y[13 * body + 3], load(y[13 * body + 4 : 13 * body + 7])
    across = cross(e, a)
    return add(a, scale(2.0 / (e0 * e0 + dot(e, e)), add(scale(e0, across), cross(e, across))))


@inner
def _rims_lean(arrays: MarchArrays, nodes: Array, parts: int) -> bool:
    """Return whether no disc comes parallel to its plane, nor lowest points jump, from node to node (`rims`)."""
    width, flat = arrays.now[0].packed + 1, arrays.now[0].flat
    for d in range(arrays.discs.shape[0]):
        disc, before = arrays.discs[d], (0.0, 0.0, 0.0)
        for p in range(parts + 1):
            y = nodes[p * width + 1 : (p + 1) * width]
            axis, n = _turned(y, disc.body, load(disc.axis), 1.0), load(disc.normal)
            axis = _turned(y, disc.partner, axis, -1.0)
            lean = sub(axis, scale(dot(axis, n), n))
            if dot(lean, lean) <= flat * flat or (p > 0 and dot(before, lean) <= 0.0):
                return False
            before = lean
    return True


@inner
def _attempt(arrays: MarchArrays, t: float, start: Array, end: Array) -> float:
    """Take a step from a state, of the error allowed; return the time at its end, t where steps become too short."""
    explicit, now = arrays.explicit, arrays.now[0]
    mechanism, run, left = explicit.motion.mechanism, explicit.motion.run[0], now.bound - t
    run.t, run.span, run.most, run.h = t, left, np.inf, 0.0 if now.fresh else now.h
    ask(arrays.stepper, PREPARE, t, start, end)
    planned = max(run.h, now.h)
    run.h = planned
    while True:
        h = min(run.h, now.longest)
        h = left if h >= left else min(h, 0.5 * left)
        run.step = h
        accepted = ask(arrays.stepper, ATTEMPT, t, start, end) <= 1.0
        run.h = h * run.factor
        if accepted:
            break
        run.rejected += 1
        run.most = 1.0
        if not run.h >= SHORTEST * max(1.0, abs(t)):
            return t
    now.next = max(run.h, planned) if h == left else run.h
    reached = now.bound if h == left else t + h
    ask(mechanism, END_STEP, reached, end, arrays.force)
    ask(arrays.stepper, INTERPOLATE, t, start, end)
    return reached


@inner
def _is_quiet(arrays: MarchArrays, t: float, reached: float, start: Array, end: Array) -> bool:
    """Return whether nothing happens in a step."""
    now, explicit = arrays.now[0], arrays.explicit
    mechanism, rows, gaps = explicit.motion.mechanism, arrays.force.shape[0], arrays.rows.gap.shape[0]
    determinant = ask(mechanism, FORCES, reached, end, arrays.force)
    if not (determinant > JAMS or not now.loaded) or not _slips_on(arrays):
        return False
    parts, width = max(PARTS, int(np.ceil(INTERVALS * (reached - t) / now.span))), gaps + 2 * rows
    size = now.packed
    if (parts + 1) * width > arrays.seen.shape[0]:
        return False
    for p in range(parts + 1):
        node = arrays.nodes[p * (size + 1) : (p + 1) * (size + 1)]
        node[0] = t + (reached - t) * p / parts
        dense_output(start[:size], explicit.F, p / parts, node[1:])
    seen = arrays.seen[: (parts + 1) * width]
    ask(mechanism, OBSERVE, 0.0, arrays.nodes[: (parts + 1) * (size + 1)], seen)
    quiet = _rims_lean(arrays, arrays.nodes, parts)
    for w in range(now.watched):
        quiet = quiet and _stays_positive(arrays.watched[w], seen, parts, (reached - t) / parts, gaps, rows)
    return quiet


@inner
def _samples_fit(arrays: MarchArrays, reached: float) -> bool:
    """Return whether there is room for the samples up to a time."""
    last = arrays.now[0].first + arrays.states.shape[0]
    return last >= arrays.times.shape[0] or reached < arrays.times[last]


@inner
def _take(arrays: MarchArrays, t: float, reached: float, start: Array, end: Array) -> None:
    """Record the samples of a step, and continue from its end."""
    now, motion = arrays.now[0], arrays.explicit.motion
    size, first = now.packed, now.recorded
    while now.recorded < arrays.times.shape[0] and arrays.times[now.recorded] <= reached:
        k, at, state = now.recorded - now.first, arrays.times[now.recorded], motion.state
        assign(state, end)
        if at < reached:
            dense_output(start, arrays.explicit.F, (at - t) / motion.run[0].step, state)
        record = arrays.states[k]
        record[0] = at
        assign(record[1 : 1 + size], state)
        assign(record[1 + size :], arrays.turns)
        assign(arrays.sums[k], state[size:])
        ask(motion.mechanism, SAMPLE, 0.0, record, arrays.found[k])
        assign(arrays.turns, record[1 + size :])
        now.recorded += 1
    if now.recorded > first:  # the rows at the end
        ask(motion.mechanism, FORCES, reached, end, arrays.force)
    for b in range(now.bodies):
        for i in range(3):
            now.speed = max(now.speed, abs(end[13 * b + 7 + i]), now.length * abs(end[13 * b + 10 + i]))
    ask(motion.mechanism, CARRY, reached, end, arrays.force)
    assign(start, end)
    for w in range(now.watched):
        arrays.watched[w].armed = arrays.watched[w].arms
    now.h, now.fresh = now.next, 0
    motion.run[0].steps += 1


@allocating_operation
def march(arrays: MarchArrays, request: int, t: float, z: Array, out: Array) -> float:
    """Take steps from a state with impulses and loss while nothing happens; return the time.

    Parameters
    ----------
    arrays : MarchArrays
    request, t : see `motion.ask`
    z, out : ndarray, shapes (n_z,) and (n_q,)
        State at the time t, and turns; both are overwritten by those at the end.
    """
    start, turns = array_of(z), array_of(out)
    explicit = arrays.explicit
    end = explicit.motion.end
    assign(turns, arrays.turns)
    ask(explicit.motion.mechanism, FORCES, t, start, arrays.force)
    heading, slow = arrays.modes.heading.copy(), arrays.modes.slow.copy()
    while t < arrays.now[0].bound:
        reached = _attempt(arrays, t, start, end) if _turn(arrays) else t
        if reached == t or not _samples_fit(arrays, reached) or not _is_quiet(arrays, t, reached, start, end):
            explicit.stiffness[0].knows_end = 0
            arrays.modes.heading[:, :] = heading
            arrays.modes.slow[:] = slow
            break
        _take(arrays, t, reached, start, end)
        t = reached
        assign(turns, arrays.turns)
        heading[:, :] = arrays.modes.heading
        slow[:] = arrays.modes.slow
    return t
