"""Impulses of contacts that close at one instant, by the laws of Newton, Moreau and Poisson.

``u+ = u- + G p`` with the Delassus matrix G, all contacts that act on one another together:

- Newton: ``u_n+ = -e u_n-``, with friction by the modes of `consilience.reference.contact.modes`, which never gains
  energy. That table is of circles; other friction sets (pyramids, boxes, moments) follow Moreau's law.
- Moreau: ``0 <= u_n+ + e u_n- _|_ N >= 0``, friction opposes the velocity after: what a time stepper does.
- Poisson: a contact by itself follows Routh's path; contacts that act on one another take two phases (Pfeiffer and
  Glocker 1996), compression without restitution and then normal impulses of at least e times those of compression, in
  each of which friction opposes the velocity at its end.
- Associated cones (`projections`) have a law of their own, whatever is asked.

Friction with a constant bound has no impulse.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.decision import ModeDecision, all_unique, decide
from consilience.reference.contact.groups import groups
from consilience.reference.contact.mode_system import RANK
from consilience.reference.contact.modes import ClosedContacts, solve_modes
from consilience.reference.contact.problem import ContactProblem, FrictionSet, in_words
from consilience.reference.contact.projections import PATIENT_SWEEPS, friction_table, project_impulses
from consilience.reference.contact.routh import poisson_path
from consilience.reference.contact.search import JammedFriction

LAWS = ("poisson", "moreau", "newton")
"""Of contacts that act on one another and state several the first."""

_OPEN = 1e-9
"""Velocities that open impulses change by less, relative to the scales of G, are determined."""

JAMMED = "friction jams (Painleve) under the rebound that restitution asks for; without rebound it does not"


_HELD = frozenset(("sticking", "starting", "halted"))
"""Modes in which the velocity along the contact is held."""

_PUSHES, _MOVES = 1e-9, 1e-7
"""Least impulse, over the largest, of a contact that pushes, and least velocity, scaled, that other shares change."""


@dataclass(frozen=True, eq=False)
class ImpulseSolution:
    """Impulses at one instant.

    Attributes
    ----------
    impulse, velocity : ndarray, shape (m,)
        p, and u after.
    modes : tuple of str, length n
        Mode of each normal row: of `consilience.reference.contact.modes`, or released, sliding, sticking, frictionless.
    unique : bool, optional
        As of `consilience.reference.contact.decision.ModeDecision`; none if not examined.
    """

    impulse: Array
    velocity: Array
    modes: tuple[str, ...]
    unique: bool | None


def solve_impulse(
    problem: ContactProblem, restitution: Array, law: str | Sequence[str], at_rest: float = 0.0, time: float = 0.0
) -> ImpulseSolution:
    """Solve for the impulses of all contacts and stops of a problem.

    Parameters
    ----------
    problem : ContactProblem
        `free` holds the velocities before; `sliding` is not read.
    restitution : ndarray, shape (n,)
        e of each normal row.
    law : str, or one for each normal row
        One of `LAWS`.
    at_rest : float, m/s
        Smaller velocities before count as zero.
    time : float, s
        For messages.

    Raises
    ------
    NumericalFailure
        No impulses satisfy the law.
    """
    laws = np.broadcast_to(np.array(law), len(problem.normals)).tolist()
    for one in set(laws) - set(LAWS):
        raise InvalidInput("law", f"it is {one}", f"One of {', '.join(LAWS)}.")
    approach = problem.free.copy()
    normals = list(problem.normals)
    approach[normals] = np.where(np.abs(approach[normals]) <= at_rest, 0.0, approach[normals])
    sets = tuple(f for f in problem.friction if f.load is not None)
    sets = tuple(replace(f, static=f.kinetic, offset=0.0) for f in sets)
    problem = replace(problem, free=approach, friction=sets, sliding=None)
    impulse, modes = np.zeros(len(approach)), ["released"] * len(normals)
    judged: set[bool | None] = set()
    for group in groups(problem):
        if group.normals and _acts(group.problem, at_rest):
            own = {laws[i] for i in group.normals}
            first = next(one for one in LAWS if one in own)
            found = _solve(group.problem, restitution[group.normals], first, at_rest, time)
            impulse[group.rows] = found.impulse
            judged.add(found.unique)
            for i, mode in zip(group.normals, found.modes, strict=True):
                modes[i] = mode
    return ImpulseSolution(impulse, problem.acceleration(impulse), tuple(modes), all_unique(judged))


def _acts(problem: ContactProblem, at_rest: float) -> bool:
    """Return whether something approaches, or slides: what is at rest would be decided by rounding."""
    slides = [row for one in problem.friction for row in one.rows]
    return bool(np.any(problem.free[list(problem.normals)] < 0.0) or np.any(np.abs(problem.free[slides]) > at_rest))


def _solve(problem: ContactProblem, restitution: Array, law: str, at_rest: float, time: float) -> ImpulseSolution:
    """Solve one group by one law."""
    if any(one.associated for one in problem.friction):
        return _convex(problem, restitution)
    if law == "poisson":
        return _poisson(problem, restitution)
    if law == "newton" and has_table(problem):
        return _newton(problem, restitution, at_rest, time)
    return _moreau(problem, restitution)


def has_table(problem: ContactProblem) -> bool:
    """Return whether Newton's table of modes covers the friction of all loads: circles, one for each."""
    sets = [f for f in problem.friction if f.load is not None]
    return all(map(_is_circle, sets)) and len({f.load for f in sets}) == len(sets)


def _is_circle(one: FrictionSet) -> bool:
    return len(one.rows) == 2 and one.facets == 0


def _newton(problem: ContactProblem, restitution: Array, at_rest: float, time: float) -> ImpulseSolution:
    """Solve by the table of modes, each normal row with two tangents, which are zero for a stop."""
    n, m = len(problem.normals), len(problem.free)
    friction = {f.load: f for f in problem.friction}
    place = np.zeros((3 * n, m))
    for i, row in enumerate(problem.normals):
        place[3 * i, row] = 1.0
        if row in friction:
            place[3 * i + 1 : 3 * i + 3, list(friction[row].rows)] = np.eye(2)
    before = (place @ problem.free).reshape(-1, 3)
    law = ClosedContacts(
        names=tuple(problem.names[row] for row in problem.normals),
        normal=np.tile([1.0, 0.0, 0.0], (n, 1)),
        friction=np.array([friction[row].kinetic if row in friction else 0.0 for row in problem.normals]),
        target=restitution * np.maximum(-before[:, 0], 0.0),
        before=before,
        compliance=place @ problem.delassus @ place.T,
        free_compliance=float(np.max(problem.row_scale())) ** 2,
        at_rest=at_rest,
    )
    modes, p, _ = solve_modes(law, time, _modes_by_moreau(problem, restitution))
    impulse = place.T @ p.ravel()
    unique = False if _leaves_open(problem, impulse, modes, law.target, problem.free) else None
    return ImpulseSolution(impulse, problem.acceleration(impulse), modes, unique)


def _leaves_open(problem: ContactProblem, impulse: Array, modes: Sequence[str], rebound: Array, slips: Array) -> bool:
    """Return whether the contacts may share their impulse otherwise, with other velocities after it.

    Each impulse then changes along itself where a contact slides, and freely where it sticks; what the laws hold stays.
    What touches and slides without an impulse may take one: a share may be the first or the last of a family.

    Parameters
    ----------
    problem : ContactProblem
    impulse : ndarray, shape (m,)
    modes : sequence of str, length n
    rebound : ndarray, shape (n,)
        Normal velocities of what has an impulse.
    slips : ndarray, shape (m,)
        Velocities which friction opposes, before or after the impact.
    """
    friction, after = {f.load: f for f in problem.friction}, problem.acceleration(impulse)
    normals = list(problem.normals)
    least, still = _PUSHES * float(np.max(impulse[normals])), _PUSHES * float(np.max(np.abs(problem.free)))
    every, columns, held, touching = np.eye(len(impulse)), list[Array](), list[int](), dict[int, Array]()
    for row, mode, target in zip(normals, modes, rebound, strict=True):
        tangents = list(friction[row].rows) if row in friction else []
        if impulse[row] <= least:
            if abs(after[row] - target) <= still and (not tangents or after[tangents] @ slips[tangents] > still**2):
                touching[row] = every[row].copy()
                if tangents:
                    touching[row][tangents] += friction[row].sliding(slips[tangents]).drag
        elif mode in _HELD:
            columns += [every[row], *every[tangents]]
            held += [row, *tangents]
        else:
            columns.append(every[[row, *tangents]].T @ impulse[[row, *tangents]] / impulse[row])
            held.append(row)
    if _shares(problem, columns, held):
        return True
    return any(_shares(problem, [*columns, column], [*held, row]) for row, column in touching.items())


def _shares(problem: ContactProblem, columns: list[Array], held: list[int]) -> bool:
    """Return whether impulses along some columns keep the velocities of the rows that are held, and change others."""
    if len(held) < 2:
        return False
    answers = problem.delassus @ np.array(columns).T / problem.row_scale()[:, None]
    answers /= np.max(np.abs(answers))
    _, singular, Vt = np.linalg.svd(answers[held])
    free = Vt[int(np.sum(singular > RANK * singular[0])) :]
    return bool(np.max(np.abs(answers @ free.T), initial=0.0) > _MOVES)


def _modes_by_moreau(problem: ContactProblem, restitution: Array) -> Iterator[tuple[str, ...]]:
    """Yield the modes under Moreau's law, if it has a solution: the two differ where slip turns or reverses."""
    with suppress(NumericalFailure):
        yield _moreau(problem, restitution).modes


def _moreau(problem: ContactProblem, restitution: Array) -> ImpulseSolution:
    rebound = np.zeros(len(problem.free))
    rebound[list(problem.normals)] = restitution * np.minimum(problem.free[list(problem.normals)], 0.0)
    try:
        decision = decide(replace(problem, free=problem.free + rebound))
    except JammedFriction as failure:
        if np.any(rebound) and _is_solvable(problem):
            names = in_words(problem.names)
            raise NumericalFailure(f"{names}: {JAMMED}") from failure
        raise
    after, modes = problem.acceleration(decision.force), _names(problem, decision.force)
    unique = _unique(problem, decision, -rebound[list(problem.normals)])
    return ImpulseSolution(decision.force, after, modes, unique)


def _unique(problem: ContactProblem, decision: ModeDecision, rebound: Array) -> bool | None:
    """Return whether velocities after an impact are unique, with friction that opposes them: shares may be open."""
    force = decision.force
    if decision.unique is None and has_table(problem):
        several = _leaves_open(problem, force, _names(problem, force), rebound, problem.acceleration(force))
        return False if several else None
    return decision.unique


def _is_solvable(problem: ContactProblem) -> bool:
    """Return whether there are impulses without rebound."""
    try:
        decide(problem)
    except NumericalFailure:
        return False
    return True


def _convex(problem: ContactProblem, restitution: Array) -> ImpulseSolution:
    """Solve where what slides parts: velocities are the nearest, in the mass metric, in the dual of all cones."""
    free, act, p = problem.free.copy(), np.zeros(len(problem.free), dtype=np.bool_), np.zeros(len(problem.free))
    normals = list(problem.normals)
    free[normals] += restitution * np.minimum(free[normals], 0.0)
    act[normals] = True
    law = friction_table(problem.friction, problem.normals)
    if not project_impulses(problem.delassus, free, law, np.zeros(len(problem.friction)), act, PATIENT_SWEEPS, p):
        raise NumericalFailure(f"{in_words(problem.names)}: impulses in associated cones are not found")
    return ImpulseSolution(p, problem.acceleration(p), _names(problem, p), None)


def _names(problem: ContactProblem, p: Array) -> tuple[str, ...]:
    """Name the mode of each normal row by its impulse and velocity."""
    u, sets = problem.acceleration(p), {f.load: f for f in problem.friction}
    still = 1e-9 * float(np.max(np.abs(problem.free)))
    names = []
    for row in problem.normals:
        if p[row] == 0.0:
            names.append("released")
        elif row not in sets:
            names.append("frictionless")
        else:
            slides = np.max(np.abs(u[list(sets[row].rows)])) > still
            names.append("sliding" if slides else "sticking")
    return tuple(names)


def _poisson(problem: ContactProblem, restitution: Array) -> ImpulseSolution:
    """Solve along Routh's path, or in two phases."""
    p, unique = np.zeros(len(problem.free)), None
    if len(restitution) > 1 or len(problem.friction) != 1 or not _is_circle(problem.friction[0]):
        p, unique = _two_phases(problem, restitution)
    elif problem.free[problem.normals[0]] < 0.0:
        own = [problem.normals[0], *problem.friction[0].rows]
        delassus, e = problem.delassus[np.ix_(own, own)], float(restitution[0])
        p[own] = poisson_path(delassus, problem.free[own], problem.friction[0], e)
    return ImpulseSolution(p, problem.acceleration(p), _names(problem, p), unique)


def _two_phases(problem: ContactProblem, restitution: Array) -> tuple[Array, bool | None]:
    """Solve compression and expansion; without a rebound beyond rounding, what compression leaves at rest stays so."""
    compression = decide(problem)
    unique = _unique(problem, compression, np.zeros(len(restitution)))
    preload = np.zeros(len(problem.free))
    preload[list(problem.normals)] = restitution * compression.force[list(problem.normals)]
    if np.all(np.abs(problem.delassus @ preload) <= problem.rounding * problem.row_scale()):
        return compression.force, unique
    sets = tuple(replace(f, offset=float(preload[f.load])) for f in problem.friction if f.load is not None)
    free = compression.acceleration + problem.delassus @ preload
    expansion = decide(replace(problem, free=free, friction=sets))
    unique = all_unique({unique, expansion.unique, not _open_rebound(problem, compression, restitution)})
    return compression.force + preload + expansion.force, unique


def _open_rebound(problem: ContactProblem, compression: ModeDecision, restitution: Array) -> bool:
    """Return whether impulses that compression leaves open change the velocities by what restitution makes of them."""
    normals, scale = list(problem.normals), problem.row_scale()
    effect = problem.delassus[:, normals] @ (restitution[:, None] * compression.undetermined[normals])
    return bool(np.any(np.abs(effect) > _OPEN * scale[:, None] * float(np.max(scale))))
