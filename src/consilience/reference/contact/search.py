"""Search for admissible modes of contacts that act on one another, and the error where there are none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact import candidates
from consilience.reference.contact.cones import StickingMargin, admissible_force, sticking_margin
from consilience.reference.contact.headings import Headings
from consilience.reference.contact.inclusion import residual
from consilience.reference.contact.mode_system import RANK, ModeSolution, active, columns_and_rows
from consilience.reference.contact.problem import ContactProblem, FrictionMode, Modes, in_words
from consilience.reference.contact.uniqueness import proven_unique

VERIFIED = 1e-11
"""Largest residual of the contact laws, relative to the forces."""

_MOST = 100
"""Largest number of combinations of modes that are all tried."""

_SAME = 1e-8
"""Accelerations that differ by less, relative to the largest, are the same solution."""

_EXCHANGES, _HALVINGS = 40, 8

_PARALLEL = 1.0 - 1e-12
"""Cosine of headings that are the same: from headings that are merely close, exchanges can lead elsewhere."""

SHARE = "how the contacts share their load is open, and with it the friction of those that slide"

_BOUND = 1e-7
"""Margins of undetermined forces that count as the least, over the forces."""

_SIDES = 6
"""Covering vectors tried where combinations are too many."""


class JammedFriction(NumericalFailure):
    """No forces satisfy the laws of contact; with less friction some do."""


class PainleveParadox(JammedFriction):
    """No forces satisfy the laws of sliding contacts."""


class ModeSearch:
    """Candidates of one problem, and what is wrong with them."""

    def __init__(self, problem: ContactProblem) -> None:
        self.problem = problem
        self.natural = problem.natural_modes()
        self.undecided = candidates.undecided(problem)
        self.acceleration_unit = float(np.max(np.abs(problem.free) / problem.row_scale(), initial=0.0)) or 1.0
        self.force_unit = float(np.max(np.abs(problem.free) / problem.row_scale() ** 2, initial=0.0)) or 1.0
        self.best: tuple[float, str] = (np.inf, "")
        self.started: frozenset[int] = frozenset()
        self.unique = False  # whether a sufficient condition for that holds
        self._last: tuple[ModeSolution, StickingMargin] | None = None
        self.family: ModeSolution | None = None  # a solution of modes that leave accelerations open

    @cached_property
    def pyramids(self) -> candidates.PyramidProblem:
        """The problem with inscribed pyramids for cones."""
        return candidates.PyramidProblem(self.problem)

    def prefer(self, previous: Modes | None, opened: list[int], started: Mapping[int, Array]) -> Modes | None:
        """Return the modes to try first."""
        if previous is None and not opened and not started:
            return None
        modes, self.started = previous or self.natural, frozenset(started)
        for i in opened:
            modes = modes.opened(i)
        for j, heading in started.items():
            modes = modes.with_friction(
                j, candidates.slips(self.problem.friction[j], self.natural.friction[j], heading)
            )
        return modes

    def decide(
        self, preferred: Modes | None, exhaustive: bool
    ) -> tuple[ModeSolution, tuple[ModeSolution, ...], bool | None]:
        """Return the first admissible solution, the others, and whether there are none."""
        self.unique = proven_unique(self.problem)
        found = self.first(preferred)
        if found is None or found is self.family or (self.family is not None and self.differs(found, self.family)):
            raise self.failure()
        if self.unique:
            return found, (), True
        others: list[ModeSolution] = []
        # contacts that are wedged hold whatever acts on them, and may slip apart as well
        exhaustive = exhaustive or bool(found.undetermined.shape[1] and self._margin(found).wedged)
        all_tried = exhaustive and candidates.count(self.problem) <= _MOST
        for one in self.all() if all_tried else self._elsewhere(found):
            if self._sticks_rather(one, found):
                found, others = one, [other for other in others if self.differs(one, other)]
            elif all(self.differs(one, other) for other in (found, *others)):
                others.append(one)
        if self.family is not None and self.differs(found, self.family):
            raise self.failure()
        return found, tuple(others), False if others else True if all_tried else None

    def _elsewhere(self, found: ModeSolution) -> Iterator[ModeSolution]:
        """Yield the solutions reached from all held, from all open, and by Lemke's method from several sides.

        What breaks away without acceleration goes on along its own force. Several sets that do so at once need not be
        able to move along all of their forces, and headings like those may lead elsewhere.
        """
        count = len(self.problem.normals) + len(self.undecided)
        tried, passed = [] if len(self.started) > 1 else [found.modes], [found.modes]
        coverings = np.random.default_rng(0).uniform(0.05, 1.0, size=(_SIDES, count))
        opened = Modes(np.zeros(len(self.problem.normals), dtype=bool), self.natural.friction)
        guesses = map(self.pyramids.guess, coverings)
        for modes in (self.natural, opened, *self._slips_one_by_one(), *guesses):
            if modes is not None and not any(alike(modes, one) for one in tried):
                tried.append(modes)
                solved = self.exchanged(modes, passed)
                if solved is not None:
                    yield solved

    def _slips_one_by_one(self) -> Iterator[Modes]:
        """Yield modes in which one set slips that is at its bound where all is held.

        The widest margin of undetermined forces has several there, and which of them slips is a choice of the search:
        what has a larger coefficient while it sticks may hold where another one slips.
        """
        if any(self.problem.friction[j].static > self.problem.friction[j].kinetic for j in self.undecided):
            margin = self._margin(Headings(self.problem, self.natural).solved())
            reached = margin.of_friction < min(margin.value + _BOUND * self.force_unit, 0.0)
            for j in np.flatnonzero(reached).tolist():
                yield self.natural.with_friction(j, self._slip_of(j, margin))

    def _slip_of(self, j: int, margin: StickingMargin) -> FrictionMode:
        """Return the mode in which a friction set slips against the force of a margin."""
        one, base = self.problem.friction[j], self.natural.friction[j]
        return candidates.slips(one, base, -(base.held.T @ base.held @ margin.force[list(one.rows)]))

    def first(self, preferred: Modes | None) -> ModeSolution | None:
        """Return the first admissible candidate."""
        for modes in self._candidates(preferred):
            found = self.exchanged(modes)
            if found is not None:
                return self._calmed(found)
        if candidates.count(self.problem) > _MOST:
            return self.family
        return next(self.all(), None) or self.family

    def _calmed(self, solved: ModeSolution) -> ModeSolution:
        """Return the solution with all held that does not move, if that is admissible and has not just broken away.

        Where forces are undetermined, friction at its bound can leave at rest what friction within its bound holds.
        """
        weight, modes = self.problem.row_scale(), solved.modes
        for j in set(self.undecided) - self.started:
            rows, natural = list(self.problem.friction[j].rows), self.natural.friction[j]
            moves = np.max(np.abs(natural.held @ (solved.acceleration[rows] / weight[rows])))
            if not len(modes.friction[j].held) and moves <= _SAME * self.acceleration_unit:
                modes = modes.with_friction(j, natural)
        if modes is solved.modes:
            return solved
        calm = self._checked(Headings(self.problem, modes).solved())
        return solved if calm is None or self.differs(calm, solved) else calm

    def _candidates(self, preferred: Modes | None) -> Iterator[Modes]:
        if preferred is not None:
            yield preferred
        if self.unique:  # any admissible one will do
            yield self.natural
        for outer in (False, True):
            modes = (candidates.PyramidProblem(self.problem, outer) if outer else self.pyramids).guess()
            if modes is not None:
                yield modes
        yield self.natural

    def all(self, known: ModeSolution | None = None) -> Iterator[ModeSolution]:
        """Yield every admissible combination but those of the accelerations of a known one."""
        free = self.problem.free
        headings = {j: free[list(self.problem.friction[j].rows)] for j in self.undecided}
        headings = {j: u if np.any(u) else np.eye(len(u))[0] for j, u in headings.items()}
        for modes in candidates.all_modes(self.problem, headings):
            for solved in Headings(self.problem, modes).all():
                if known is None or self.differs(solved, known):
                    checked = self._checked(solved)
                    if checked is not None:
                        yield checked

    def _checked(self, solved: ModeSolution) -> ModeSolution | None:
        """Return the solution if it satisfies all laws, with undetermined forces within their cones.

        One whose undetermined forces load what slides is one of a family of solutions, and kept as that: with the force
        of the widest margin, since that of least norm may be one without what is left open.
        """
        if not solved.consistent or not (solved.singular or self._moves_right(solved)):
            return None
        if not solved.undetermined.shape[1]:
            return solved if self._lawful(solved) else None
        least = admissible_force(self.problem, solved, partial(self._margin, solved))
        if not solved.singular:
            solved = replace(solved, force=least)
            return solved if self._lawful(solved) else None
        for force in (self._margin(solved).force, least):
            one = replace(solved, force=force, acceleration=self.problem.acceleration(force))
            if self._moves_right(one) and self._lawful(one):
                self.family = one
                break
        return None

    def _lawful(self, solved: ModeSolution) -> bool:
        """Return whether a solution satisfies the laws, and note the best that does not."""
        missed = residual(self.problem, solved.force, solved.acceleration)
        worst = int(np.argmax(missed)) if len(missed) else 0
        if len(missed) and missed[worst] < self.best[0]:
            self.best = (float(missed[worst]), self.problem.names[worst])
        return float(np.max(missed, initial=0.0)) <= VERIFIED

    def _margin(self, solved: ModeSolution) -> StickingMargin:
        """Return the margin of a solution; that of the last one is kept."""
        if self._last is None or self._last[0] is not solved:
            self._last = solved, sticking_margin(self.problem, solved.modes, solved)
        return self._last[1]

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
                weight = float(self.problem.row_scale()[rows].sum()) / len(rows)
                yield float(fixed @ solved.acceleration[rows]) / weight, j

    def exchanged(self, modes: Modes, passed: list[Modes] | None = None) -> ModeSolution | None:
        """Exchange violated modes until none is left; None if a combination recurs.

        None too where the modes become those of `passed`, which is added to: exchanges lead from there to the same end.
        """
        seen: set[tuple[object, ...]] = set()
        for _ in range(_EXCHANGES):
            if passed is not None:
                if any(alike(modes, one, _PARALLEL) for one in passed):
                    return None
                passed.append(modes)
            solved = Headings(self.problem, modes).solved()
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
        margin = self._margin(solved)
        unit = self.force_unit
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
            return modes.with_friction(j, self._slip_of(j, margin))
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
        held, as_well = self._held(one), self._held(other)
        if not np.array_equal(held, as_well) and (np.all(held >= as_well) or np.all(held <= as_well)):
            return False
        return self._apart(one, other)

    def _apart(self, one: ModeSolution, other: ModeSolution) -> bool:
        """Return whether the accelerations of two solutions differ by more than rounding."""
        weight = self.problem.row_scale()
        unit = max(float(np.max(np.abs(s.acceleration) / weight)) for s in (one, other)) or 1.0
        unit = max(unit, float(np.max(np.abs(self.problem.free) / weight)))
        least = max(_SAME * unit, self.problem.rounding)
        return bool(np.max(np.abs(one.acceleration - other.acceleration) / weight) > least)

    def _held(self, solved: ModeSolution) -> Array:
        """Return the number of held directions of each set whose static coefficient is the larger one."""
        sets = [j for j in self.undecided if self.problem.friction[j].static > self.problem.friction[j].kinetic]
        return np.array([len(solved.modes.friction[j].held) for j in sets], dtype=int)

    def _sticks_rather(self, one: ModeSolution, found: ModeSolution) -> bool:
        """Return whether a solution holds what another lets slide, and nothing that has just broken away."""
        held, before = self._held(one), self._held(found)
        starts = all(len(one.modes.friction[j].held) == len(found.modes.friction[j].held) for j in self.started)
        return starts and bool(np.all(held >= before) and np.any(held > before)) and self._apart(one, found)

    def failure(self) -> NumericalFailure:
        """Return the error of a problem without a solution."""
        held = [n for n in self.problem.normals if not np.any(self.problem.delassus[n])]
        for n in held:
            if self.problem.free[n] < 0.0:
                what = "joints or drives press its bodies together, and no force of contact parts them"
                return NumericalFailure(f"{self.problem.names[n]}: {what}")
        if len(self.problem.normals) == 1 and not self.undecided:
            n = self.problem.normals[0]
            if held:
                what = "joints carry its load as well, how much is open, and with it its friction"
                return NumericalFailure(f"the laws of {self.problem.names[n]} allow several accelerations: {what}")
            _, S, _ = columns_and_rows(self.problem, self.natural)
            slope = float((self.problem.delassus @ S)[n, 0])
            return PainleveParadox(
                f"{self.problem.names[n]}: sliding friction jams (Painleve): g'' = A N + B with A = {slope:.12g} 1/kg "
                f"and B = {self.problem.free[n]:.12g} m/s^2 has no solution; an impact without collision would have to "
                "follow"
            )
        names = in_words(self.problem.names)
        if self.family is not None:
            return NumericalFailure(f"the laws of {names} allow several accelerations: {SHARE}")
        share = self._bearable()
        if share is not None:
            return JammedFriction(
                f"{names}: friction jams (Painleve): no forces satisfy the laws of contact; with {share:.2g} of the "
                "coefficients of friction there are some"
            )
        missed, name = self.best
        best = f"the best candidate violates that of {name} by {missed:.3g} of the forces"
        why = best if name else "their rows depend on one another, and no combination that was tried is consistent"
        also = f"; {SHARE}" if self._shared() else ""
        return NumericalFailure(f"no modes of {names} satisfy the laws of contact: {why}{also}")

    def _bearable(self) -> float | None:
        """Return the largest share of the coefficients of friction found with which there is a solution, or None."""
        low, high = -1.0, 1.0
        for share in (0.0, *([None] * _HALVINGS)):
            tried = 0.5 * (low + high) if share is None else share
            sets = (
                one if one.load is None else replace(one, kinetic=tried * one.kinetic, static=tried * one.static)
                for one in self.problem.friction
            )
            found = ModeSearch(replace(self.problem, friction=tuple(sets))).first(None)
            low, high = (low, tried) if found is None else (tried, high)
            if high == 0.0:
                return None
        return low

    def _shared(self) -> bool:
        """Return whether normal forces alone are undetermined: several contacts carry one body."""
        normals = list(self.problem.normals)
        weight = self.problem.row_scale()[normals]
        compliance = self.problem.delassus[np.ix_(normals, normals)] / np.outer(weight, weight)
        return bool(np.linalg.matrix_rank(compliance, RANK, hermitian=True) < len(normals))


def alike(one: Modes, other: Modes, least: float = 0.9) -> bool:
    """Return whether two sets of modes agree in what is closed, what slides and, to a least cosine, where to."""
    return bool(np.array_equal(one.closed, other.closed)) and all(
        a.name == b.name and float(a.drag @ b.drag) >= least * float(np.linalg.norm(a.drag) * np.linalg.norm(b.drag))
        for a, b in zip(one.friction, other.friction, strict=True)
    )
