"""Modes of everything that touches at one instant: the contact problem of a state, decided, as modes of all rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.cones import admissible_force, sticking_margin
from consilience.reference.contact.decision import ModeDecision, decide
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.joint_friction import decide_with_reactions
from consilience.reference.contact.mode_system import solve_with_modes
from consilience.reference.contact.problem import ContactProblem, FrictionMode, Modes, in_words
from consilience.reference.contact.response import Response
from consilience.reference.contact.row_modes import RowModes, open_modes

_BINDING = 1e-7
"""Margins of undetermined forces that count as equal, over the forces; accelerations, over the largest one."""

ROOM = 0.05
"""Margin that a choice of undetermined forces keeps to all bounds, over the forces."""

HOPS = "what slides under an associated cone parts at once: pressed on from rest, it slides in hops without end"


@dataclass(frozen=True, eq=False)
class LastingContact:
    """Modes, forces and accelerations of all rows at one instant.

    Attributes
    ----------
    modes : RowModes
    force, acceleration : ndarray, shape (m,)
    decision : ModeDecision or None
        Of the rows that touch; None where nothing does.
    undetermined : bool
        Whether the forces are not unique.
    apart : tuple of str
        Names of the rows whose accelerations are not unique.
    """

    modes: RowModes
    force: Array
    acceleration: Array
    decision: ModeDecision | None
    undetermined: bool
    apart: tuple[str, ...] = ()


def decide_lasting(
    equations: ContactEquations,
    response: Response,
    touching: Array,
    sliding: Array,
    previous: RowModes | None = None,
    opened: frozenset[int] = frozenset(),
    started: Mapping[int, Array] | None = None,
) -> LastingContact:
    """Decide the modes of all normals that touch and of all friction there.

    Parameters
    ----------
    equations : ContactEquations
    response : Response
        At the state.
    touching : ndarray of bool, shape (n_n,)
        Normals of zero gap that neither approach nor part.
    sliding : ndarray, shape (m,)
        Rates of the rows of friction, exactly zero where nothing slides.
    previous : RowModes, optional
    opened : frozenset of int
        Normals whose force has just vanished.
    started : mapping of int to ndarray, optional
        Friction sets that have just reached their bound, with the heading in which they start.

    Raises
    ------
    NumericalFailure
        No modes satisfy the laws, or several do.
    """
    problem, rows, sets = equations.problem(response, touching, sliding)
    normals = np.flatnonzero(touching)
    place, at = {int(j): k for k, j in enumerate(sets)}, {int(n): k for k, n in enumerate(normals)}
    if not len(rows):
        modes = replace(open_modes(equations.layout), pressed=equations.pressed.copy())
        return LastingContact(modes, response.given, response.free, None, False)
    decided = partial(
        decide,
        previous=None if previous is None else _restricted(problem, previous, normals, sets),
        opened=frozenset(at[n] for n in opened if n in at),
        started={place[j]: heading for j, heading in (started or {}).items() if j in place},
    )
    reactions = {place[j]: one.on(rows, response.given) for j, one in response.reactions.items()}
    if reactions:
        problem, decision = decide_with_reactions(problem, reactions, decided)
        equations.offsets[sets] = [one.offset for one in problem.friction]
    else:
        decision = decided(problem)
    force = response.given.copy()
    force[rows] += decision.force
    modes = all_modes(equations, decision.modes, normals, sets, sliding)
    for one, mode in zip(equations.layout.friction, modes.friction, strict=True):
        if one.associated and mode is not None and len(mode.held) < len(one.rows):
            raise NumericalFailure(f"{one.name}: {HOPS}")
    names = (equations.layout.names[row] for row in (rows[_apart(decision)] if decision.others else ()))
    found = bool(decision.undetermined.shape[1])
    return LastingContact(modes, force, response.accelerations(force), decision, found, tuple(dict.fromkeys(names)))


def decide_opening(
    equations: ContactEquations,
    response: Response,
    touching: Array,
    sliding: Array,
    previous: RowModes | None,
    opened: frozenset[int],
    started: Mapping[int, Array],
    sinks: float,
) -> LastingContact:
    """Decide modes, as `decide_lasting`; what has just lost its force opens unless it would sink.

    Parameters
    ----------
    equations, response, touching, sliding, previous, opened, started : see `decide_lasting`
    sinks : float, m/s^2
        Acceleration into a plane that counts as zero.
    """
    if opened:
        left = touching.copy()
        left[list(opened)] = False
        found = decide_lasting(equations, response, left, sliding, previous, frozenset(), started)
        if np.min(found.acceleration[[equations.layout.normals[n] for n in opened]]) > -sinks:
            return found
    return decide_lasting(equations, response, touching, sliding, previous, opened, started)


def _apart(decision: ModeDecision) -> Array:
    """Return which rows have several accelerations, bool (m,)."""
    others = np.array([one.acceleration for one in decision.others])
    least = _BINDING * float(np.max(np.abs(others)))
    return np.asarray(np.any(np.abs(others - decision.acceleration) > least, axis=0))


def _restricted(problem: ContactProblem, modes: RowModes, normals: Array, sets: Array) -> Modes:
    """Return modes of all rows for the rows of a problem; what is new there has its natural mode."""
    natural = problem.natural_modes()
    friction = []
    for k, j in enumerate(sets):
        before, slides = modes.friction[j], bool(np.any(problem.slip(k)))
        friction.append(natural.friction[k] if before is None or slides or not len(before.held) else before)
    closed = np.array([bool(modes.closed[n]) for n in normals], dtype=bool)
    return Modes(closed, tuple(friction))


def all_modes(equations: ContactEquations, modes: Modes, normals: Array, sets: Array, sliding: Array) -> RowModes:
    """Return modes of the rows of a problem for all rows, with the headings of what slides.

    Parameters
    ----------
    equations : ContactEquations
    modes : Modes
        Of the problem.
    normals, sets : ndarray of int
        Its normals and friction sets among all.
    sliding : ndarray, shape (m,)
        Rates of the rows, exactly zero where nothing slides.
    """
    layout = equations.layout
    closed = np.zeros(len(layout.normals), dtype=bool)
    closed[normals] = modes.closed
    friction: list[FrictionMode | None] = [None] * len(layout.friction)
    heading: list[Array | None] = [None] * len(layout.friction)
    for k, j in enumerate(sets):
        one, mode = layout.friction[j], modes.friction[k]
        if one.load in layout.normals and not closed[layout.normals.index(one.load)]:
            continue
        friction[j] = mode
        if len(mode.held) < len(one.rows):
            slip = sliding[list(one.rows)]
            along = slip if one.vertices is None and np.any(slip) else -mode.drag
            size = float(np.linalg.norm(along))
            heading[j] = along / size if size > 0.0 else np.eye(len(one.rows))[0]
    return RowModes(closed, equations.pressed.copy(), tuple(friction), tuple(heading))


def require_unique(found: LastingContact, time: float) -> LastingContact:
    """Refuse accelerations that the laws of contact do not determine.

    Raises
    ------
    NumericalFailure
    """
    if found.decision is not None and found.decision.others:
        raise NumericalFailure(
            f"contact at t = {time:.12g} s: the laws of contact and friction allow several accelerations "
            f"of {in_words(found.apart)}: the motion is not unique from here on"
        )
    return found


@contextmanager
def telling_time(time: float) -> Iterator[None]:
    """Let a failure tell the time."""
    try:
        yield
    except NumericalFailure as failure:
        if "t = " in str(failure):
            raise
        raise NumericalFailure(f"t = {time:.12g} s: {failure}") from failure


def problem_in_modes(
    equations: ContactEquations, response: Response, modes: RowModes, sliding: Array
) -> tuple[ContactProblem, Modes, Array, Array, Array]:
    """Return the contact problem of closed normals, its modes, and its rows, normals and friction sets among all."""
    problem, rows, sets = equations.problem(response, modes.closed, sliding)
    normals = np.flatnonzero(modes.closed)
    friction = []
    for k, j in enumerate(sets):
        mode, heading = modes.friction[j], modes.heading[j]
        assert mode is not None
        one = problem.friction[k]
        if heading is not None and one.vertices is None:
            slip = problem.slip(k)
            mode = one.sliding(slip if np.any(slip) else heading)
        friction.append(mode)
    return problem, Modes(np.ones(len(normals), dtype=bool), tuple(friction)), rows, normals, sets


def widest_margin(
    equations: ContactEquations, response: Response, modes: RowModes, sliding: Array
) -> tuple[float, Array, Array, Array]:
    """Return the widest margin of undetermined forces.

    Returns
    -------
    float
        The margin, N (N m).
    of_normal, of_friction : ndarray, shape (n_n,) and (n_f,)
        Margins of all normals and friction sets; infinite where none binds.
    force : ndarray, shape (m,)
        The forces that attain it.
    """
    problem, given, rows, normals, sets = problem_in_modes(equations, response, modes, sliding)
    margin = sticking_margin(problem, given)
    of_normal, of_friction = (np.full(len(part), np.inf) for part in (modes.closed, modes.friction))
    of_normal[normals], of_friction[sets] = margin.of_normal, margin.of_friction
    force = np.zeros(len(response.free))
    force[rows] = margin.force
    return margin.value, of_normal, of_friction, force + response.given


def binding_bounds(
    equations: ContactEquations, response: Response, modes: RowModes, scale: float
) -> tuple[list[int], list[int], Array]:
    """Return normals and friction sets, of loaded normals, whose bounds undetermined forces reach, and the forces."""
    layout = equations.layout
    value, of_normal, of_friction, force = widest_margin(
        equations, response, modes, sliding_rates(equations, modes, 0.0)
    )
    normals, sets = (np.flatnonzero(part <= value + _BINDING * scale).tolist() for part in (of_normal, of_friction))
    unloaded = [layout.normals[n] for n in normals]
    return normals, [j for j in sets if layout.friction[j].load not in unloaded], force


def chosen_force(equations: ContactEquations, response: Response, modes: RowModes) -> Array:
    """Return forces of all rows that no law forbids, shape (m,): where the modes leave them open, with `ROOM`."""
    problem, given, rows, *_ = problem_in_modes(equations, response, modes, sliding_rates(equations, modes, 0.0))
    solved = solve_with_modes(problem, given)
    force = np.zeros(len(response.free))
    force[rows] = admissible_force(problem, solved, partial(sticking_margin, problem, given, solved), ROOM)
    return force


def sliding_rates(equations: ContactEquations, modes: RowModes | None, least: float) -> Array:
    """Return the rates of the rows, exactly zero where nothing slides: what was held, or is slower than `least`.

    What slides along a facet of a pyramid but for `least` slides along it exactly; what has started to slide and is
    slower than `least` slides along its heading: rounding has no direction.
    """
    u = equations.rows.u.copy()
    for j, one in enumerate(equations.layout.friction):
        at = list(one.rows)
        mode, heading = (None, None) if modes is None else (modes.friction[j], modes.heading[j])
        if heading is not None and float(np.linalg.norm(u[at])) <= least:
            u[at] = least * heading
        if mode is None:
            if float(np.linalg.norm(u[at])) <= least:
                u[at] = 0.0
            else:
                u[at] = one.along_facet(u[at], least)
        elif len(mode.held) == len(at):
            u[at] = 0.0
        elif len(mode.held):
            u[at] -= mode.held.T @ (mode.held @ u[at])
        else:
            u[at] = one.along_facet(u[at], least)
    return u
