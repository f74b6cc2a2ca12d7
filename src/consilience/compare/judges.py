"""Judges of the questions: each compares the answers of an engine to one question of one case with the reference.

The table of questions (`consilience.engine.questions`) names the judge of each question.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from consilience.case import Case
from consilience.compare.coarser_levels import coarser_levels
from consilience.compare.evidence import OTHER_LAW
from consilience.compare.instant import compare_instant, compare_model
from consilience.compare.instants import Instants, instants_at
from consilience.compare.judge import REFERENCE, at_singular_pose, reference_motion_of
from consilience.compare.other_laws import answer_under, cause_of, hardened
from consilience.compare.other_methods import lost_by_solver
from consilience.compare.power_of_bars import at_first_states, instants_at_first_states, with_power
from consilience.compare.published import dispute, start_against_published
from consilience.compare.reference_motion import OtherLaw, ReferenceMotion
from consilience.compare.result import CoarserLevel, Comparison, Quantity, Verdict
from consilience.compare.rules import OTHER_LAWS
from consilience.compare.trajectory import compare_trajectory
from consilience.engine import Method, ModelAnswer, Profile, Question, Run
from consilience.mechanism import characteristic_length, is_singular


class QuestionJudge:
    """Judge of one question of one case.

    Parameters
    ----------
    case : Case
    references : sequence of Run
        Answered runs of the reference, one at least: the best first, then those that bound its uncertainty, then those
        about mechanisms with an error.
    before : sequence of Comparison
        Comparisons of the earlier questions of the table.
    """

    def __init__(self, case: Case, references: Sequence[Run], before: Sequence[Comparison]) -> None:
        self.case, self.references, self.before = case, references, before
        self.reference = references[0].answer
        self.perturbed = [run for run in references if run.perturbation is not None]

    def compare(self, levels: Sequence[Run], softer: Sequence[Run]) -> Comparison:
        """Compare the answers of an engine by one method with the reference.

        Parameters
        ----------
        levels : sequence of Run
            Answered runs, coarse to fine; one where the question has no levels. Behind them those at coprime steps.
        softer : sequence of Run
            Answered runs of the finest level with other softness of constraints; often none.
        """
        raise NotImplementedError

    def coarser(self, runs: Sequence[Run]) -> tuple[CoarserLevel, ...]:
        """Compare motions at longer steps than those of the levels; none of other questions."""
        return ()


def method_of(run: Run) -> Method:
    """Return the method of an answered run."""
    assert run.method is not None
    return run.method


class ModelJudge(QuestionJudge):
    """Compare mass properties and degrees of freedom."""

    def compare(self, levels: Sequence[Run], softer: Sequence[Run]) -> Comparison:
        """Compare with fixed bars; lengths are relative to the size of the mechanism."""
        run, case = levels[-1], self.case
        length = max(float(np.max(np.abs(case.initial_state.p_WB))), characteristic_length(case.mechanism))

        def judged(answer: ModelAnswer) -> Comparison:
            return compare_model(case.name, run.engine, method_of(run), answer, self.reference, length)

        return with_power(judged(run.answer), self.perturbed, lambda one: judged(one.answer).quantities)


class InstantJudge(QuestionJudge):
    """Compare accelerations, reactions and energies at the states of a case."""

    def __init__(self, case: Case, references: Sequence[Run], before: Sequence[Comparison]) -> None:
        super().__init__(case, references, before)
        self.instants = Instants.of(case.mechanism, case.states)
        self.regular = [n for n, state in enumerate(case.states) if not is_singular(case.mechanism, state)]
        self.known = start_against_published(case.mechanism, case.published, self.reference, self.instants)

    def compare(self, levels: Sequence[Run], softer: Sequence[Run]) -> Comparison:
        """Compare with bars that depend on the condition; a disputed reference fails no engine."""
        run, soft = levels[-1], [run.answer for run in softer]
        if len(self.regular) < len(self.case.states):
            return self._beside_singular_poses(run)
        compared = compare_instant(
            self.case.name, run.engine, method_of(run), run.answer, self.reference, self._instants(run), soft
        )
        compared = self._under_its_law(run, compared)
        compared = with_power(compared, self.perturbed, lambda one: self._in_place_of(run, one))
        if run.engine == REFERENCE:
            compared = replace(compared, quantities=(*compared.quantities, *self.known))
        disputed = dispute(self.known)
        if not disputed:
            return compared
        why = f"the reference is disputed: {disputed}"
        return replace(compared, verdict=Verdict.UNRESOLVED, rule="disputed reference", why=why)

    def _under_its_law(self, run: Run, compared: Comparison) -> Comparison:
        """Name the law of contact as the cause of a difference that the reference's answer with that law explains."""
        method = method_of(run)
        under = answer_under(method.law, self.references)
        if compared.verdict is not Verdict.MODEL or under is None or method.law is None:
            return compared
        cause = cause_of(method.law, self.case.mechanism)
        again = compare_instant(self.case.name, run.engine, method, run.answer, under.answer, self.instants)
        off, rest = (
            next(q.difference for q in one.quantities if q.name == "accelerations") for one in (compared, again)
        )
        if not cause or not rest <= OTHER_LAW * off:
            return compared
        verdict = next(verdict for name, verdict, _ in OTHER_LAWS if name == cause)
        why = f"accelerations differ by {off:.2g}, and by {rest:.2g} from the reference's with {method.contact_law}"
        return replace(compared, verdict=verdict, rule=cause, why=why)

    def _beside_singular_poses(self, run: Run) -> Comparison:
        """Compare at the states that are not at singular poses; if none of them decides, there is no verdict."""
        case, method = self.case, method_of(run)
        if self.regular:
            answer, reference = (instants_at(given, self.regular) for given in (run.answer, self.reference))
            instants = Instants.of(case.mechanism, [case.states[n] for n in self.regular])
            compared = compare_instant(case.name, run.engine, method, answer, reference, instants)
            if compared.verdict is Verdict.MODEL:
                return compared
        return Comparison(
            *(case.name, run.engine, Question.INSTANT, method.name, method.route, Verdict.UNRESOLVED),
            why=at_singular_pose(case),
            rule="singular pose",
            profile=method.profile,
        )

    def _in_place_of(self, run: Run, perturbed: Run) -> tuple[Quantity, ...]:
        """Compare the answer about a mechanism with an error as that of an engine, at its states."""
        answer, count = perturbed.answer, len(perturbed.answer.kinetic)
        if run.answer.force_F is None:
            answer = replace(answer, force_F=None, torque_F=None)
        reference = at_first_states(self.reference, count)
        instants = instants_at_first_states(self.instants, count)
        return compare_instant("", run.engine, method_of(run), answer, reference, instants).quantities

    def _instants(self, run: Run) -> Instants:
        """Return the properties of the states; both of two answers of the reference may be off by a bar."""
        return replace(self.instants, answers=2) if run.engine == REFERENCE else self.instants


class TrajectoryJudge(QuestionJudge):
    """Compare motions at several step sizes."""

    def __init__(self, case: Case, references: Sequence[Run], before: Sequence[Comparison]) -> None:
        super().__init__(case, references, before)
        self.reference_motion, self.known = reference_motion_of(case, references)

    def compare(self, levels: Sequence[Run], softer: Sequence[Run]) -> Comparison:
        """Compare by the rules; the coarser levels of the best reference are shown with the published values.

        Where the motion passes a singular pose, a difference counts only before it: there a motion may take another
        branch. An engine that fails there has answered up to it. The power is that of the motion before it, which a
        band widened by what follows must not hide: both have to pass.
        """
        own = [run for run in levels if run is not self.references[0]]
        earlier, mechanism, motion = self._earlier(levels[0]), self.case.mechanism, self._motion(method_of(levels[0]))
        lost = lost_by_solver(self.before, levels[0].engine, method_of(levels[0]).profile)
        compared = compare_trajectory(mechanism, own, motion, softer, earlier, lost)
        if self._first_singular is not None:
            up_to = replace(motion, singular=self._first_singular)
            before = compare_trajectory(mechanism, own, up_to, softer, earlier, lost)
            short = any(len(run.answer.time) < len(motion.answer.time) for run in own)
            if short or any(one.verdict in (Verdict.MODEL, Verdict.UNRESOLVED) for one in (compared, before)):
                at = motion.answer.time[self._first_singular]
                why = f"{before.why}; a singular pose comes before {at:.3g} s, and nothing is judged behind it"
                compared = replace(before, why=f"{why}, where the engine fails" if short else why)
            compared = replace(compared, power=before.power)
        return compared if len(own) == len(levels) else replace(compared, quantities=self.known)

    def coarser(self, runs: Sequence[Run]) -> tuple[CoarserLevel, ...]:
        """Compare with the reference motion."""
        return coarser_levels(self.case.mechanism, runs, self.reference_motion)

    def _motion(self, method: Method) -> ReferenceMotion:
        """Return the reference motion, with those under the law of contact of a method and its softness beside it."""
        under, soft = (answer_under(law, self.references) for law in (method.law, method.soft_law))
        found = self.reference_motion if soft is None else replace(self.reference_motion, soft=soft.answer)
        cause = "" if under is None or method.law is None else cause_of(method.law, self.case.mechanism)
        if under is None or not cause:
            return found
        hard = answer_under(hardened(method.law), self.references)
        other = OtherLaw(cause, method.contact_law, under.answer, None if hard is None else hard.answer)
        return replace(found, other_law=other)

    @cached_property
    def _first_singular(self) -> int | None:
        """First sample of the reference motion at or behind a singular pose."""
        return self.reference_motion.first_singular(self.case.mechanism)

    def _earlier(self, run: Run) -> str:
        """Describe the difference of an engine at `model`, or at `instant` if all methods of the profile differ."""
        own = [c for c in self.before if c.engine == run.engine]
        model = [c for c in own if c.question is Question.MODEL and c.verdict is Verdict.MODEL]
        if model:
            return f"model: {model[0].why}"
        instants = [c for c in own if c.question is Question.INSTANT]
        same = [c for c in instants if c.profile is method_of(run).profile]
        same = same or [c for c in instants if c.profile is Profile.MATCHED]
        if same and all(c.verdict is Verdict.MODEL for c in same):
            return f"instant: {same[0].why}"
        return ""
