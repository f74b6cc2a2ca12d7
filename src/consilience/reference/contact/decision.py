"""Mode decision: which contacts open, slide and stick, with forces and accelerations, at one instant.

Candidates are tried in this order: the modes before, everything held, the solution of the complementarity problem with
pyramids for circles, exchanges of what is violated, and all combinations. Each answer is verified by the inclusions of
`consilience.reference.contact.inclusion`. Where combinations are few enough to try them all, an answer is also known to
be the only one, or the others are listed: with friction, accelerations need not be unique (Painleve 1895).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact import candidates
from consilience.reference.contact.cones import StickingMargin, admissible_force, sticking_margin
from consilience.reference.contact.groups import RowGroup, groups
from consilience.reference.contact.inclusion import residual
from consilience.reference.contact.mode_system import ModeSolution, active, columns_and_rows, solve_with_modes
from consilience.reference.contact.problem import ContactProblem, Modes
from consilience.reference.contact.uniqueness import proven_unique

VERIFIED = 1e-11
"""Largest residual of the contact laws, relative to the forces."""

_MOST = 100
"""Largest number of combinations of modes that are all tried."""

_SAME = 1e-8
"""Accelerations that differ by less, relative to the largest, are the same solution."""

_EXCHANGES = 40


@dataclass(frozen=True, eq=False)
class ModeDecision:
    """Modes, forces and accelerations at one instant.

    Attributes
    ----------
    modes : Modes
    force, acceleration : ndarray, shape (m,)
    undetermined : ndarray, shape (m, k)
        Orthonormal changes of the force that change no acceleration; the force given is then the one of least norm in
        the cones.
    margin : StickingMargin
    unique : bool, optional
        Whether the accelerations are the only ones; none if that was not examined, the combinations being too many.
    others : tuple of ModeSolution
        Admissible solutions of other accelerations.
    """

    modes: Modes
    force: Array
    acceleration: Array
    undetermined: Array
    margin: StickingMargin
    unique: bool | None
    others: tuple[ModeSolution, ...]

    def determined(self, functional: Array) -> bool:
        """Return whether ``functional . f`` is determined, shape (m,): a unit vector asks for a single force."""
        effect = float(np.max(np.abs(functional @ self.undetermined), initial=0.0))
        return effect <= 1e-9 * float(np.linalg.norm(functional))


class PainleveParadox(NumericalFailure):
    """No forces satisfy the laws of sliding contacts.

    Attributes
    ----------
    contact : str
    slope, constant : float
        A and B of ``g'' = A N + B`` of the contact, the others as they are in the last candidate.
    """

    def __init__(self, contact: str, slope: float, constant: float) -> None:
        self.contact, self.slope, self.constant = contact, slope, constant
        super().__init__(
            f"contact {contact}: sliding friction jams (Painleve): g'' = A N + B with A = {slope:.12g} 1/kg and "
            f"B = {constant:.12g} m/s^2 has no solution; an impact without collision would have to follow"
        )

    def __reduce__(self) -> tuple[type[PainleveParadox], tuple[str, float, float]]:
        """Pickle the three parts."""
        return type(self), (self.contact, self.slope, self.constant)


def decide(
    problem: ContactProblem,
    previous: Modes | None = None,
    opened: frozenset[int] = frozenset(),
    started: Mapping[int, Array] | None = None,
) -> ModeDecision:
    """Decide the modes of all contacts, stops and dry joints.

    Parameters
    ----------
    problem : ContactProblem
    previous : Modes, optional
        Modes until now, tried first.
    opened : frozenset of int
        Normals (indices into `ContactProblem.normals`) whose force has just fallen to zero: they are open if that is
        admissible.
    started : mapping of int to ndarray, optional
        Friction sets that have just reached their bound, with the heading in which they start to slide: opposite to
        their last force, shape (d,).

    Raises
    ------
    PainleveParadox
        One contact that slides, without a solution.
    NumericalFailure
        No modes are admissible.
    """
    found = []
    for group in groups(problem):
        at = {j: k for k, j in enumerate(group.sets)}
        search = _Search(group.problem)
        first = search.prefer(
            None if previous is None else group.modes(previous),
            [k for k, i in enumerate(group.normals) if i in opened],
            {at[j]: heading for j, heading in (started or {}).items() if j in at},
        )
        found.append((group, *search.decide(first)))
    return _assembled(problem, found)


def _assembled(
    problem: ContactProblem, found: list[tuple[RowGroup, ModeSolution, tuple[ModeSolution, ...], bool | None]]
) -> ModeDecision:
    """Return the decision of the whole problem from those of its groups."""
    chosen = [(group, solved) for group, solved, _, _ in found]
    whole = _joined(problem, chosen)
    others = [
        _joined(problem, [(g, other if g is group else solved) for g, solved in chosen])
        for group, _, several, _ in found
        for other in several
    ]
    judged = {one for _, _, _, one in found}
    unique = False if False in judged else None if None in judged else True
    margin = sticking_margin(problem, whole.modes, whole)
    return ModeDecision(whole.modes, whole.force, whole.acceleration, whole.undetermined, margin, unique, tuple(others))


def _joined(problem: ContactProblem, parts: list[tuple[RowGroup, ModeSolution]]) -> ModeSolution:
    """Return the solution of the whole problem from those of its groups."""
    m = len(problem.free)
    force, undetermined = np.zeros(m), [np.zeros((m, 0))]
    closed, friction = np.zeros(len(problem.normals), dtype=bool), list(problem.natural_modes().friction)
    for group, solved in parts:
        force[group.rows] = solved.force
        closed[group.normals] = solved.modes.closed
        columns = np.zeros((m, solved.undetermined.shape[1]))
        columns[group.rows] = solved.undetermined
        undetermined.append(columns)
        for j, mode in zip(group.sets, solved.modes.friction, strict=True):
            friction[j] = mode
    modes = Modes(closed, tuple(friction))
    return ModeSolution(modes, force, problem.acceleration(force), np.hstack(undetermined), True, False)


def solutions(problem: ContactProblem) -> tuple[ModeSolution, ...]:
    """Return all solutions of different accelerations, by trying all combinations of modes."""
    search = _Search(problem)
    found: list[ModeSolution] = []
    for one in search.all():
        if all(search.differs(one, other) for other in found):
            found.append(one)
    return tuple(found)


class _Search:
    """Candidates of one problem, and what is wrong with them."""

    def __init__(self, problem: ContactProblem) -> None:
        self.problem = problem
        self.natural = problem.natural_modes()
        self.undecided = candidates.undecided(problem)
        self.acceleration_unit = float(np.max(np.abs(problem.free) / problem.row_scale(), initial=0.0)) or 1.0
        self.best: tuple[float, str] = (np.inf, "no candidate")

    def prefer(self, previous: Modes | None, opened: list[int], started: Mapping[int, Array]) -> Modes | None:
        """Return the modes to try first."""
        if previous is None and not opened and not started:
            return None
        modes = previous or self.natural
        for i in opened:
            modes = modes.opened(i)
        for j, heading in started.items():
            modes = modes.with_friction(
                j, candidates.slips(self.problem.friction[j], self.natural.friction[j], heading)
            )
        return modes

    def decide(self, preferred: Modes | None) -> tuple[ModeSolution, tuple[ModeSolution, ...], bool | None]:
        """Return the first admissible solution, the others, and whether there are none."""
        found = self.first(preferred)
        if found is None:
            raise self.failure()
        if proven_unique(self.problem):
            return found, (), True
        if candidates.count(self.problem) > _MOST:
            return found, (), None
        others: list[ModeSolution] = []
        for one in self.all(found):
            if all(self.differs(one, other) for other in others):
                others.append(one)
        return found, tuple(others), not others

    def first(self, preferred: Modes | None) -> ModeSolution | None:
        """Return the first admissible candidate."""
        for modes in self._candidates(preferred):
            found = self.exchanged(modes)
            if found is not None:
                return found
        if candidates.count(self.problem) > _MOST:
            return None
        return next(self.all(), None)

    def _candidates(self, preferred: Modes | None) -> Iterator[Modes]:
        if preferred is not None:
            yield preferred
        for outer in (False, True):
            modes = candidates.guess(self.problem, outer)
            if modes is not None:
                yield modes
        yield self.natural

    def all(self, known: ModeSolution | None = None) -> Iterator[ModeSolution]:
        """Yield every admissible combination but those of the accelerations of a known one."""
        free = self.problem.free
        headings = {j: free[list(self.problem.friction[j].rows)] for j in self.undecided}
        headings = {j: u if np.any(u) else np.eye(len(u))[0] for j, u in headings.items()}
        for modes in candidates.all_modes(self.problem, headings):
            solved = self._with_headings(modes)
            if known is not None and not self.differs(solved, known):
                continue
            checked = self._checked(solved)
            if checked is not None:
                yield checked

    def starting(self, modes: Modes) -> list[int]:
        """Return the circles whose heading the accelerations must confirm."""
        return [
            j
            for j in self.undecided
            if self.problem.friction[j].vertices is None
            and not len(modes.friction[j].held)
            and self.problem.friction[j].kinetic > 0.0
            and active(self.problem, modes, j)
        ]

    def _checked(self, solved: ModeSolution) -> ModeSolution | None:
        """Return the solution if it satisfies all laws, with undetermined forces within their cones."""
        if not solved.consistent or solved.singular or not self._moves_right(solved):
            return None
        if solved.undetermined.shape[1]:
            margin = sticking_margin(self.problem, solved.modes, solved)
            solved = replace(solved, force=admissible_force(self.problem, solved, margin))
        missed = np.abs(residual(self.problem, solved.force, solved.acceleration))
        worst = int(np.argmax(missed)) if len(missed) else 0
        if len(missed) and missed[worst] < self.best[0]:
            self.best = (float(missed[worst]), self.problem.names[worst])
        return solved if np.max(missed, initial=0.0) <= VERIFIED else None

    def _moves_right(self, solved: ModeSolution) -> bool:
        """Return whether no open normal closes and no friction drives its own sliding: forces do not matter here."""
        weight, unit = self.problem.row_scale(), self.acceleration_unit
        normals = np.array(self.problem.normals, dtype=int)[~solved.modes.closed]
        if np.min(solved.acceleration[normals] / weight[normals], initial=0.0) < -_SAME * unit:
            return False
        return all(power <= _SAME * unit for power, _ in self._powers(solved))

    def _powers(self, solved: ModeSolution) -> Iterator[tuple[float, int]]:
        """Yield the power of the friction of each set that starts to slide, per load and rate of its rows."""
        for j in self.undecided:
            rows, mode = list(self.problem.friction[j].rows), solved.modes.friction[j]
            if len(mode.held) < len(self.natural.friction[j].held) and active(self.problem, solved.modes, j):
                fixed = mode.drag - self.natural.friction[j].drag
                weight = float(np.mean(self.problem.row_scale()[rows]))
                yield float(fixed @ solved.acceleration[rows]) / weight, j

    def _with_headings(self, modes: Modes) -> ModeSolution:
        """Solve, with the headings of circles that start to slide turned into those of their accelerations."""
        starting = self.starting(modes)
        solved = solve_with_modes(self.problem, modes)
        if not starting:
            return solved
        unit = self.acceleration_unit

        def turned(angles: Array) -> Modes:
            changed = modes
            for j, angle in zip(starting, angles, strict=True):
                heading = np.array([np.cos(angle), np.sin(angle)])
                changed = changed.with_friction(j, self.problem.friction[j].sliding(heading))
            return changed

        def across(angles: Array) -> Array:
            a = solve_with_modes(self.problem, turned(angles)).acceleration
            pairs = [(a[list(self.problem.friction[j].rows)], t) for j, t in zip(starting, angles, strict=True)]
            return np.array([w[1] * np.cos(t) - w[0] * np.sin(t) for w, t in pairs]) / unit

        headings = [-modes.friction[j].drag for j in starting]
        angles = np.array([np.arctan2(h[1], h[0]) for h in headings])
        if np.max(np.abs(across(angles))) <= 1e-13:
            return solved
        angles = scipy.optimize.root(across, angles, tol=1e-14).x
        return solve_with_modes(self.problem, turned(angles))

    def exchanged(self, modes: Modes) -> ModeSolution | None:
        """Exchange violated modes until none is left; None if a combination recurs."""
        seen: set[tuple[object, ...]] = set()
        for _ in range(_EXCHANGES):
            solved = self._with_headings(modes)
            checked = self._checked(solved)
            if checked is not None:
                return checked
            key = (*modes.closed, *(f.name for f in modes.friction))
            changed = self._exchange(solved)
            if changed is None or key in seen:
                return None
            seen.add(key)
            modes = changed
        return None

    def _exchange(self, solved: ModeSolution) -> Modes | None:
        """Return the modes with the worst violation mended; normal rows before friction."""
        problem, modes, weight = self.problem, solved.modes, self.problem.row_scale()
        margin = sticking_margin(problem, modes, solved)
        unit = float(np.max(np.abs(problem.free) / weight**2)) or 1.0
        pulls = np.where(modes.closed, margin.of_normal, np.inf) / unit
        normals = list(problem.normals)
        sinks = np.where(modes.closed, np.inf, solved.acceleration[normals] / weight[normals] ** 2 / unit)
        worst = np.minimum(pulls, sinks)
        if len(worst) and np.min(worst) < -VERIFIED:
            i = int(np.argmin(worst))
            closed = modes.closed.copy()
            closed[i] = not closed[i]
            return replace(modes, closed=closed)
        j = int(np.argmin(margin.of_friction)) if len(margin.of_friction) else 0
        if len(margin.of_friction) and margin.of_friction[j] < -VERIFIED * unit:
            one, base = problem.friction[j], self.natural.friction[j]
            heading = -(base.held.T @ base.held @ margin.force[list(one.rows)])
            return modes.with_friction(j, candidates.slips(one, base, heading))
        return self._turned(solved)

    def _turned(self, solved: ModeSolution) -> Modes | None:
        """Return the modes with the friction set held that is driven most by its own force, or a pyramid turned."""
        power = max(self._powers(solved), default=(0.0, -1))
        if power[0] > VERIFIED * self.acceleration_unit:
            return solved.modes.with_friction(power[1], self.natural.friction[power[1]])
        for _, j in self._powers(solved):
            one, mode = self.problem.friction[j], solved.modes.friction[j]
            w = solved.acceleration[list(one.rows)]
            if one.vertices is None or len(one.rows) == 1 or self.natural.friction[j].reach or len(mode.held):
                continue
            best = one.kinetic * one.vertices[np.argmin(one.vertices @ w)]
            if not np.allclose(best, mode.drag, atol=1e-12):
                return solved.modes.with_friction(j, one.sliding(-(best + mode.drag)))
        return None

    def differs(self, one: ModeSolution, other: ModeSolution) -> bool:
        """Return whether two solutions differ, but by a choice that the laws make.

        What can stick sticks, where the static coefficient is the larger one.
        """
        for j in self.undecided:
            law = self.problem.friction[j]
            if law.static > law.kinetic and len(one.modes.friction[j].held) != len(other.modes.friction[j].held):
                return False
        weight = self.problem.row_scale()
        unit = max(float(np.max(np.abs(s.acceleration) / weight)) for s in (one, other)) or 1.0
        unit = max(unit, float(np.max(np.abs(self.problem.free) / weight)))
        return bool(np.max(np.abs(one.acceleration - other.acceleration) / weight) > _SAME * unit)

    def failure(self) -> NumericalFailure:
        """Return the error of a problem without a solution."""
        if len(self.problem.normals) == 1 and not self.undecided:
            n = self.problem.normals[0]
            _, S, _ = columns_and_rows(self.problem, self.natural)
            slope = float((self.problem.delassus @ S)[n, 0])
            return PainleveParadox(self.problem.names[n], slope, float(self.problem.free[n]))
        names = ", ".join(dict.fromkeys(self.problem.names))
        return NumericalFailure(
            f"no modes of {names} satisfy the laws of contact: the best candidate violates that of {self.best[1]} by "
            f"{self.best[0]:.3g} of the forces"
        )
