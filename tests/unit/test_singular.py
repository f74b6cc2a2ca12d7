"""Singular poses against counts by hand: change points, dead centres, mechanisms that lock; others are regular."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Case
from consilience.compare import ReferenceMotion, Verdict
from consilience.compare.judge import REFERENCE, judge_case
from consilience.compare.reference_motion import first_samples
from consilience.compare.rules import NO_POWER
from consilience.engine import Method, Question, Route, Run, Status, TrajectoryAnswer
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan
from consilience.errors import CannotAssemble
from consilience.mechanism import (
    Drive,
    Initial,
    first_singular,
    initial_state,
    is_singular,
    linear,
    random_states,
    singular_pose,
)
from consilience.mechanism.perturbation import GRAVITY, Perturbation
from consilience.reference import accelerations
from consilience.suite.engine_runs import EngineCase
from linkages import FLAT_PARALLELOGRAM, FOLDED_RHOMBUS, four_bar_of, in_other_units, platform, slider_crank, with_crank
from mechanisms import ELEMENTS, LOOPS, TREES, states_of

HELD_AT_DEAD_CENTRE = slider_crank((0.2, 0.0), 0.7, drives=(Drive("push", "rail", "distance", linear(0.0, 0.7)),))
"""The slider stands at its end, 0.2 m + 0.5 m: the crank can only tremble."""

SINGULAR = {
    "folded rhombus": (FOLDED_RHOMBUS, 2, (1, 1)),
    "change point": (FLAT_PARALLELOGRAM, 2, (1, 1)),
    "held at its dead centre": (HELD_AT_DEAD_CENTRE, 1, ()),
    "platform that locks": (platform(0.8), 1, ()),
}


@pytest.mark.parametrize("length", [1.0, 1e-3, 1e3])
@pytest.mark.parametrize("name", SINGULAR)
def test_mobility_at_a_singular_pose_and_on_its_branches_is_that_counted_by_hand(name, length):
    mechanism, freedom, branches = SINGULAR[name]
    scaled = in_other_units(mechanism, length)
    found = singular_pose(scaled, initial_state(scaled))
    assert found is not None
    assert (found.freedom, found.branches) == (freedom, branches)


REGULAR = {
    **TREES,
    **LOOPS,
    **ELEMENTS,
    "parallelogram": four_bar_of([(0.0, 0.0), (0.1, 0.3), (0.6, 0.3), (0.5, 0.0)]),
    "platform of parallel bars": platform(0.5),
    "dead centre, not driven": slider_crank((0.2, 0.0), 0.7),
}


@pytest.mark.parametrize("name", REGULAR)
def test_regular_poses_are_not_called_singular(name):
    mechanism = REGULAR[name]
    assert not any(is_singular(mechanism, state) for state in [initial_state(mechanism), *states_of(mechanism)])


def test_assembly_names_the_dead_centre():
    pushed = Drive("push", "rail", "distance", linear(0.3, 0.6))
    with pytest.raises(CannotAssemble, match=r"drive 'push'.*singular \(a dead centre\)"):
        initial_state(slider_crank((0.2, 0.0), 0.7, drives=(pushed,)))
    beside = slider_crank((0.2 * np.cos(0.3), 0.2 * np.sin(0.3)), 0.6873, drives=(pushed,))
    assert initial_state(beside).p_WB.shape == (3, 3)


def test_velocities_name_the_dead_centre_where_no_motion_has_the_held_rate():
    held = Initial(rates={"rail": {"distance": 0.1}})
    with pytest.raises(CannotAssemble, match="singular pose"):
        initial_state(slider_crank((0.2, 0.0), 0.7), held)
    both = Initial(rates={"rail": {"distance": 0.1}, "ground_crank": {"angle": 0.1}})
    with pytest.raises(CannotAssemble, match="the held rates contradict the joints"):
        initial_state(slider_crank((0.1, 0.17), 0.57), both)


@pytest.mark.parametrize(
    ("angles", "first"), [([-0.5, -0.3, -0.1, 0.1, 0.3], 3), ([-0.5, -0.3, -0.1], None), ([0.0, 0.2], 0)]
)
def test_a_motion_through_a_change_point_is_known(angles, first):
    states = [with_crank(FLAT_PARALLELOGRAM, angle) for angle in angles]
    assert first_singular(FLAT_PARALLELOGRAM, states, np.arange(float(len(angles)))) == first


def case_of(mechanism):
    return Case("c", "c.toml", "a linkage", mechanism, Initial(), 0.4, 0.1, 6, 1, 1)


METHOD = Method("m", Route.NATIVE, None)


def judged(case, question, truth, answers):
    runs = [
        Run("c", engine, question, METHOD, 0, None, Status.ANSWERED, answer)
        for engine, answer in ((REFERENCE, truth), ("e", answers))
    ]
    return next(c for c in judge_case(case, runs) if c.engine == "e")


def test_an_instant_at_a_singular_pose_is_unresolved_whatever_is_answered():
    case = case_of(FOLDED_RHOMBUS)
    truth = accelerations(case.mechanism, case.states)
    for factor in (1.0, 1.5):
        found = judged(case, Question.INSTANT, truth, replace(truth, a_WB_W=factor * truth.a_WB_W))
        assert (found.verdict, found.rule) == (Verdict.UNRESOLVED, "singular pose")
        assert "mobility 2 at the pose, 1 on each of two branches" in found.why


@pytest.mark.parametrize("question", [Question.INSTANT, Question.TRAJECTORY])
def test_a_singular_pose_is_unresolved_where_the_reference_has_no_answer(question):
    """Velocities that lead along no branch have no accelerations: that is no failure of the reference."""
    case = case_of(FOLDED_RHOMBUS)
    failed = Run("c", REFERENCE, question, METHOD, 0, None, Status.FAILED, reason="no accelerations")
    answered = Run("c", "e", question, METHOD, 0, None, Status.ANSWERED)
    died = replace(failed, engine="d")
    stopped = replace(failed, engine="s", reason="RuntimeError: the solver stopped")
    found = {c.engine: c for c in judge_case(case, [failed, answered, died, stopped])}
    motion = question is Question.TRAJECTORY  # an engine may stop where it begins
    assert found["s"].verdict is (Verdict.UNRESOLVED if motion else Verdict.FAILED)
    assert "the solver stopped" in found["s"].why
    assert {found[name].rule for name in (REFERENCE, "e")} == {"singular pose"}
    assert {found[name].verdict for name in (REFERENCE, "e")} == {Verdict.UNRESOLVED}
    assert found["d"].verdict is Verdict.FAILED
    locks = replace(case_of(platform(0.8)), instants=3)  # its random states lead nowhere
    assert judge_case(locks, [failed])[0].rule == "singular pose"
    regular = case_of(four_bar_of([(0.0, 0.0), (0.1, 0.3), (0.6, 0.3), (0.5, 0.0)]))
    assert judge_case(regular, [failed])[0].verdict is Verdict.FAILED


def test_instants_of_a_mechanism_that_locks_are_unresolved_on_all_engines():
    """No engine can be asked for accelerations on a branch that is a single pose; one that crashes has failed."""
    locks = replace(case_of(platform(0.8)), instants=3)
    failed = Run("c", REFERENCE, Question.INSTANT, None, 0, None, Status.FAILED, reason=locks.undrawn)
    died = replace(failed, engine="d", reason="the worker died")
    found = {c.engine: c for c in judge_case(locks, [failed, replace(failed, engine="e"), died])}
    for name in (REFERENCE, "e"):
        assert (found[name].verdict, found[name].rule) == (Verdict.UNRESOLVED, "singular pose")
        assert "mobility 1 at the pose alone: it locks" in found[name].why
        assert "led nowhere" in found[name].why
    assert found["d"].verdict is Verdict.FAILED


def through_a_change_point():
    """Motion whose third sample is the last before the change point."""
    states = [with_crank(FLAT_PARALLELOGRAM, angle) for angle in (-0.25, -0.15, -0.05, 0.05, 0.15)]
    parts = [np.array([getattr(s, name) for s in states]) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")]
    return case_of(FLAT_PARALLELOGRAM), TrajectoryAnswer(0.1 * np.arange(5.0), *parts)


def test_a_motion_through_a_change_point_is_judged_up_to_it():
    """Another branch behind the change point is no error; a difference before it is one."""
    case, truth = through_a_change_point()
    behind, before = (np.array(f)[:, None, None] for f in ([0.0, 0.0, 0.0, 0.01, 0.02], [0.0, 0.01, 0.02, 0.01, 0.02]))
    found = judged(case, Question.TRAJECTORY, truth, replace(truth, p_WB=truth.p_WB + behind))
    assert (found.verdict, found.horizon) == (Verdict.AGREES, pytest.approx(0.2))
    assert "a singular pose comes before 0.3 s" in found.why
    found = judged(case, Question.TRAJECTORY, truth, replace(truth, p_WB=truth.p_WB + before))
    assert found.verdict is Verdict.MODEL
    at_once = replace(truth, **{k: getattr(truth, k)[2:] for k in ("time", "p_WB", "quat_WB", "v_WB_W", "w_WB_W")})
    found = judged(case, Question.TRAJECTORY, at_once, replace(at_once, p_WB=at_once.p_WB + behind[2:]))
    assert (found.verdict, found.rule) == (Verdict.UNRESOLVED, "singular pose")


@pytest.mark.parametrize(("before", "rule"), [(1e-3, "agreement"), (0.0, NO_POWER)])
def test_power_is_that_before_a_change_point(before, rule):
    """Gravity off by a thousandth shows behind the change point, where another branch would show as well."""
    case, truth = through_a_change_point()
    off = np.array([0.0, before, 2.0 * before, 0.1, 0.2])[:, None, None]
    known = Run("c", REFERENCE, Question.TRAJECTORY, METHOD, 0, None, Status.ANSWERED, truth)
    heavier = replace(
        known, answer=replace(truth, p_WB=truth.p_WB + off), perturbation=Perturbation(GRAVITY, "g", 1e-3)
    )
    found = next(c for c in judge_case(case, [known, heavier, replace(known, engine="e")]) if c.engine == "e")
    assert found.rule == rule
    (power,) = found.power
    # 2e-3 of a length for each thousandth, 1e-6 passes
    assert power.limit == (pytest.approx(1e-6 / 2.0, rel=1.0) if before else np.inf)


class Locks:
    """A worker whose engine stops at the change point; its motions have an error besides that of steps."""

    engine = "e"

    def __init__(self, truth, error, passes=0.0):
        self.truth, self.error, self.passes = truth, error, passes  # it passes the pose by steps below `passes`

    def ask(self, request):
        count = len(request.times)
        if count > 3 and request.step >= self.passes:
            return Reply(None, returned=False, reason="RuntimeError: the solver stopped")
        own = first_samples(self.truth, count)
        off = (1e-3 * request.step**2 + self.error) * np.arange(count)[:, None, None]
        return Reply(replace(own, p_WB=own.p_WB + off), returned=True)


@pytest.mark.parametrize("passes", [0.0, 0.006])
@pytest.mark.parametrize(("error", "verdict"), [(0.0, Verdict.AGREES), (1e-3, Verdict.MODEL)])
def test_an_engine_that_fails_at_a_change_point_is_judged_up_to_it(error, verdict, passes):
    case, truth = through_a_change_point()
    method = Method("m", Route.NATIVE, 2, (10, 20, 40))
    yard = ReferenceMotion(truth, np.zeros(5), case.digits)
    asked = EngineCase(Locks(truth, error, passes), case, Plan({}, {}, {}), reference_motion=yard)
    runs = list(asked.ladder(Question.TRAJECTORY, method, [0.01, 0.005, 0.0025]))
    assert "the solver stopped" in runs[0].log
    known = Run("c", REFERENCE, Question.TRAJECTORY, METHOD, 0, None, Status.ANSWERED, truth)
    found = next(c for c in judge_case(case, [known, *runs]) if c.engine == "e")
    assert (found.verdict, found.horizon) == (verdict, pytest.approx(0.2))
    assert "a singular pose comes before 0.3 s, and nothing is judged behind it, where the engine fails" in found.why
    assert [len(level.difference) for level in found.levels] == [len(found.times)] * len(runs)


def test_a_band_widened_behind_a_change_point_hides_no_other_model_before_it():
    """Steps err by 0.0125 behind the pose and the model by 6e-5 before it: the stated power is that before it."""
    case, truth = through_a_change_point()
    known = Run("c", REFERENCE, Question.TRAJECTORY, METHOD, 0, None, Status.ANSWERED, truth)

    def judged(error):
        runs = []
        for level, step in enumerate((0.01, 0.005, 0.0025)):
            off = (
                np.array([0.0, 1.0, 2.0, 0.0, 0.0]) * (step**2 + error)
                + np.array([0.0, 0.0, 0.0, 1.0, 2.0]) * 1e3 * step**2
            )
            answer = replace(truth, p_WB=truth.p_WB + off[:, None, None])
            method = Method("m", Route.NATIVE, 2, (10, 20, 40))
            runs.append(replace(known, engine="e", method=method, level=level, step=step, answer=answer))
        return next(c for c in judge_case(case, [known, *runs]) if c.engine == "e")

    assert judged(0.0).verdict is Verdict.DISCRETISATION
    assert judged(3e-5).verdict is Verdict.MODEL
    assert "a singular pose comes before 0.3 s" in judged(3e-5).why


def test_random_states_of_a_mechanism_that_locks_say_so():
    mechanism = platform(0.8)
    with pytest.raises(CannotAssemble, match="it can move at the start alone, a singular pose, and locks"):
        random_states(mechanism, initial_state(mechanism), 1, 0)
