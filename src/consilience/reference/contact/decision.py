"""Mode decision: which contacts open, slide and stick, with forces and accelerations, at one instant.

Candidates are tried in this order: the modes before, everything held, the solution of the complementarity problem with
pyramids for circles, exchanges of what is violated, and all combinations. Each answer is verified by the inclusions of
`consilience.reference.contact.inclusion`. Where combinations are few enough to try them all, an answer is also known to
be the only one, or the others are listed: with friction, accelerations need not be unique (Painleve 1895).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.groups import RowGroup, groups
from consilience.reference.contact.mode_system import ModeSolution
from consilience.reference.contact.problem import ContactProblem, Modes
from consilience.reference.contact.search import ModeSearch


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
    unique : bool, optional
        Whether the accelerations are the only ones; none if that was not examined, the combinations being too many.
    others : tuple of ModeSolution
        Admissible solutions of other accelerations.
    """

    modes: Modes
    force: Array
    acceleration: Array
    undetermined: Array
    unique: bool | None
    others: tuple[ModeSolution, ...]

    def determined(self, functional: Array) -> bool:
        """Return whether ``functional . f`` is determined, shape (m,): a unit vector asks for a single force."""
        effect = float(np.max(np.abs(functional @ self.undetermined), initial=0.0))
        return effect <= 1e-9 * float(np.linalg.norm(functional))


def decide(
    problem: ContactProblem,
    previous: Modes | None = None,
    opened: frozenset[int] = frozenset(),
    started: Mapping[int, Array] | None = None,
    exhaustive: bool = False,
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
    exhaustive : bool
        Whether to look for other solutions among all combinations of modes, where they are not too many; otherwise
        some starts of Lemke's method look for them.

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
        search = ModeSearch(group.problem)
        first = search.prefer(
            None if previous is None else group.modes(previous),
            [k for k, i in enumerate(group.normals) if i in opened],
            {at[j]: heading for j, heading in (started or {}).items() if j in at},
        )
        found.append((group, *search.decide(first, exhaustive)))
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
    unique = all_unique({one for _, _, _, one in found})
    return ModeDecision(whole.modes, whole.force, whole.acceleration, whole.undetermined, unique, tuple(others))


def all_unique(judged: Collection[bool | None]) -> bool | None:
    """Return whether all solutions are unique; none if that was not examined of one, and no other has several."""
    return False if False in judged else None if None in judged else True


def _joined(problem: ContactProblem, parts: list[tuple[RowGroup, ModeSolution]]) -> ModeSolution:
    """Return the solution of the whole problem from those of its groups."""
    if len(parts) == 1:
        return parts[0][1]
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
    search = ModeSearch(problem)
    found: list[ModeSolution] = []
    for one in search.all():
        if all(search.differs(one, other) for other in found):
            found.append(one)
    return tuple(found)
