"""Number of levels and softnesses asked of an engine: as many as the verdict needs, for errors of known order."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Case
from consilience.compare import ReferenceMotion, Verdict
from consilience.compare.coprime_steps import COUNT
from consilience.compare.judge import REFERENCE, judge_case, stable_levels
from consilience.compare.power import MotionSensitivity
from consilience.compare.rules import RULES
from consilience.compare.softness import SCALES
from consilience.compare.uncertainty import LEVEL_BUDGET, MOST_LEVELS
from consilience.engine import (
    CONTACT_MODES,
    EVENT_KINDS,
    Method,
    Profile,
    Question,
    Route,
    Run,
    Status,
    TrajectoryAnswer,
)
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan
from consilience.mechanism import GROUND, Body, Frame, Initial, Joint, JointSpring, Mechanism, SpherePlane
from consilience.suite.coprime_runs import finest_affordable
from consilience.suite.engine_runs import EngineCase
from mechanisms import chain
from situations import MECHANISM, SHAPE, SITUATIONS, SIZE, TIMES, TRUE, Situation, motion

SAMPLE = float(TIMES[1])
CASE = Case("c", "c.toml", "a body on a circle", MECHANISM, Initial(), float(TIMES[-1]), SAMPLE, 8, 1, 1)
YARD = ReferenceMotion(TRUE, np.zeros(len(TIMES)), CASE.digits)
THREE = [10, 20, 40]


class Known:
    """A worker whose motions have a known error; the worker records the requests."""

    engine = "known"

    def __init__(self, error, cpu, rate):
        self.error, self.cpu, self.rate, self.asked = error, cpu, rate, []

    def ask(self, request):
        softness = request.method.softness
        self.asked.append((round(SAMPLE / request.step), softness))
        if request.step * self.rate > 2.8:
            return Reply(None, returned=False, reason="not finite")
        return Reply(motion(SIZE * SHAPE * self.error(request.step, softness or 0.0)), returned=True, cpu=self.cpu)


def asked(error, soft=False, yard=YARD, cpu=0.0, case=CASE, **more):
    """Return the substeps asked at the method's own softness, and (substeps, softness) asked at others."""
    worker = Known(error, cpu, case.fastest_rate)
    method = Method("m", Route.NATIVE, 2, tuple(THREE), softness=1.0 if soft else None, **more)
    ladder = EngineCase(worker, case, Plan({}, {}, {}), reference_motion=yard).ladder
    list(ladder(Question.TRAJECTORY, method, [SAMPLE / n for n in THREE]))
    own = [n for n, s in worker.asked if s in (None, 1.0)]
    return own, [(n, s) for n, s in worker.asked if s not in (None, 1.0)]


def test_three_levels_that_agree_are_enough():
    assert asked(lambda h, s: 1e-4 * h**2, soft=True) == (THREE, [])


def test_a_level_that_will_agree_is_asked_and_no_other():
    # errors: 3.1e-8 at 40 substeps, 7.8e-9 at 80; the case asks for 1e-8
    assert asked(lambda h, s: 2e-2 * h**2, soft=True) == ([*THREE, 80], [])


def test_steps_that_lead_to_the_reference_are_followed_no_further_than_that():
    assert asked(lambda h, s: h**2, soft=True) == (THREE, [])


def test_a_clear_order_elsewhere_needs_no_finer_steps_but_softness():
    elsewhere, scales = asked(lambda h, s: h**2 + 1e-4 * s, soft=True)
    assert elsewhere == THREE
    assert scales == [(40, s) for s in SCALES[Profile.MATCHED]]


def test_an_order_elsewhere_by_chance_is_asked_once_more():
    """Three levels of order 2.18 whose limit is 1.5e-6 off; the fourth has left the error of the first ones behind."""
    errors = {10: 8e-6, 20: 3e-6, 40: 1.9e-6, 80: 1e-9}
    assert asked(lambda h, s: errors[round(SAMPLE / h)])[0] == [*THREE, 80]


def test_a_limit_just_beyond_the_band_is_asked_until_the_band_is_clear_of_it():
    """Clean levels of order two: the band of three is 5/4 of a third of the last change, that of four a quarter."""
    plateau = 1.5 * 1.25 * 0.1 / 40**2
    assert asked(lambda h, s: plateau + 0.1 * (h / SAMPLE) ** 2)[0] == [*THREE, 80]


def test_levels_whose_finest_agrees_by_chance_are_asked_until_the_plateau_shows():
    """Errors of the steps of 1.8e-8 and a plateau of 2.5e-8 leave 0.7e-8 at 40 substeps; asked is 1e-8."""
    assert asked(lambda h, s: 1.8e-8 * (40 * h / SAMPLE) ** 2 - 2.5e-8)[0] == [*THREE, 80]


@pytest.mark.parametrize(
    ("motion", "friction", "other"),
    [
        ({"contact_mode": np.full((len(TIMES), 1), CONTACT_MODES.index("sticking"))}, 0.3, True),
        ({"contact_mode": np.eye(1, len(TIMES), 3, dtype=int).T}, 0.3, False),
        ({"contact_mode": np.eye(1, len(TIMES), 3, dtype=int).T}, 0.0, True),
        ({"event_kind": np.array([EVENT_KINDS.index("closes")])}, 0.3, True),
        ({"event_kind": np.array([EVENT_KINDS.index("slips")])}, 0.3, False),
        ({"event_kind": np.array([EVENT_KINDS.index("impact")])}, 0.0, False),
    ],
    ids=["sticks", "slides at a sample", "slides without friction", "closes", "slips between samples", "hits"],
)
def test_a_softness_that_leads_to_the_law_at_rest_alone_is_not_varied_where_the_reference_slides_or_hits(
    motion, friction, other
):
    times = {"event_time": np.array([0.5]), "event_contact": np.array([0])} if "event_kind" in motion else {}
    yard = replace(YARD, answer=replace(TRUE, **motion, **times))
    name, zero = MECHANISM.bodies[0].name, np.zeros(3)
    floor = SpherePlane("floor", name, zero, 0.1, GROUND, zero, np.array([2.0, -1.0, 2.0]), friction=friction)
    case = replace(CASE, mechanism=replace(MECHANISM, contacts=(floor,)))
    for at_rest in (True, False):
        _, scales = asked(lambda h, s: h**2 + 1e-2 * s, soft=True, yard=yard, case=case, soft_at_rest=at_rest)
        assert bool(scales) == (other or not at_rest)


@pytest.mark.parametrize(
    ("inertia", "center", "excepted"),
    [
        ((0.4, 0.4, 0.4), (0.1, -0.2, 0.3), True),
        ((0.4, 0.4, 0.401), (0.1, -0.2, 0.3), False),
        ((0.4, 0.4, 0.4), (0.1, -0.2, 0.301), False),
    ],
    ids=["even ball", "uneven inertia", "off its centre"],
)
def test_a_cone_that_lifts_what_slides_pushes_an_even_ball_along_its_slip_alone(inertia, center, excepted):
    center, zero = np.array(center), np.zeros(3)
    here = Frame(zero, np.eye(3))
    ball = Body("ball", 1.0, np.array([0.1, -0.2, 0.3]), np.diag(inertia), here)
    floor = SpherePlane("floor", "ball", center, 0.1, GROUND, zero, np.array([2.0, -1.0, 2.0]), friction=0.3)
    free = Joint("free", "free", GROUND, "ball", here, here)
    mechanism = Mechanism("ball", np.array([0.0, 0.0, -9.81]), (ball,), (free,), contacts=(floor,))
    slides = np.full((len(TIMES), 1), CONTACT_MODES.index("sliding"))
    motion = replace(YARD, answer=replace(TRUE, contact_mode=slides))
    assert motion.slides_or_hits(mechanism) != excepted
    on_a_rail = replace(mechanism, joints=(replace(free, kind="planar"),))
    assert motion.slides_or_hits(on_a_rail)


def test_an_order_that_does_not_settle_is_followed_to_the_end():
    levels, scales = asked(lambda h, s: 1e-2 * h, soft=True)
    assert levels == [10 * 2**n for n in range(MOST_LEVELS)]
    assert scales == [(levels[-1], s) for s in SCALES[Profile.MATCHED]]


def test_steps_that_hardly_move_an_answer_are_not_halved_before_softness_is_asked():
    levels, scales = asked(lambda h, s: 1e-2 * h + 1e-3 * s, soft=True)
    assert levels == THREE
    assert scales == [(40, s) for s in SCALES[Profile.MATCHED]]


def test_levels_that_have_met_elsewhere_are_not_halved_further():
    assert asked(lambda h, s: 1e-2 * h + 1e-3)[0] == [*THREE, 80]


def test_where_neither_softness_nor_model_is_clear_finer_levels_are_asked_with_softness_of_their_own():
    # softness moves the answer by less than a quarter of the difference, and steps by less, without an order
    levels, scales = asked(lambda h, s: 1e-3 + 1e-4 * (s + np.sin(1e6 * h)), soft=True)
    assert len(levels) > len(THREE)
    assert scales == [(n, s) for n in (40, levels[-1]) for s in SCALES[Profile.MATCHED]]


def test_levels_that_cost_little_are_asked_until_the_bound_of_impacts_has_power():
    # twice the rate 1/s times the step: 1.6e-4 at 640 substeps, 7.8e-5 at 1280; 10 % in gravity make 1.2e-4
    hit = {"event_time": np.array([0.5]), "event_contact": np.array([0]), "event_kind": np.array([0])}
    acting = (MotionSensitivity("gravity", "gravity", np.full(len(TIMES), 1.2e-3)),)
    yard = replace(YARD, answer=replace(TRUE, **hit), sensitivities=acting)
    assert asked(lambda h, s: 1e-2 * h, yard=yard) == ([10 * 2**n for n in range(8)], [])


def test_a_difference_that_does_not_fall_is_followed_beyond_what_impacts_excuse():
    # twice the rate 1/s times the step: 2.5e-3 at 40 substeps, 6.2e-4 at 160; 2e-3 is more than twice as much there
    hit = {"event_time": np.array([0.5]), "event_contact": np.array([0]), "event_kind": np.array([0])}
    yard = replace(YARD, answer=replace(TRUE, **hit))
    assert asked(lambda h, s: 2e-3, yard=yard)[0] == [*THREE, 80, 160]
    assert asked(lambda h, s: 1.6 * h, yard=yard)[0] == THREE


def test_a_finer_level_has_to_be_afforded():
    assert asked(lambda h, s: 1e-2 * h, cpu=LEVEL_BUDGET / 2.0) == (THREE, [])


def test_without_a_reference_nothing_is_decided():
    assert asked(lambda h, s: 1e-4 * h**2, soft=True, yard=None)[1] == [(40, s) for s in SCALES[Profile.MATCHED]]


def test_past_the_horizon_nothing_more_is_asked():
    chaotic = replace(YARD, growth=np.full(len(TIMES), 1e12))
    assert asked(lambda h, s: 1e-2 * h, soft=True, yard=chaotic) == (THREE, [])


def damped(rate):
    """The case with a damper of this rate, 1/s, on a slide beside its body."""
    slide = chain("prismatic", seed=3)
    damper = JointSpring("d", "j0", "distance", 0.0, rate * slide.bodies[0].mass, 0.0)
    return replace(CASE, mechanism=replace(slide, joint_springs=(damper,)))


def test_a_ladder_without_a_stable_step_begins_anew_at_one():
    """Steps of 1.25 ms at 1e4 1/s are unstable, 5 ms / 32 are not."""
    levels, _ = asked(lambda h, s: h**2, case=damped(1e4))
    assert levels == [*THREE, *(32 * n for n in THREE)]


def test_unstable_levels_before_stable_ones_are_left_out():
    """Steps of 5 ms at 1e3 1/s are unstable, the others are not."""
    case, method = damped(1e3), Method("m", Route.NATIVE, 2, tuple(THREE))
    worker = Known(lambda h, s: 1e-4 * h**2, 0.0, case.fastest_rate)
    ladder = EngineCase(worker, case, Plan({}, {}, {}), reference_motion=YARD).ladder
    runs = list(ladder(Question.TRAJECTORY, method, [SAMPLE / n for n in THREE]))
    assert [run.status for run in runs] == [Status.FAILED, Status.ANSWERED, Status.ANSWERED]
    assert [run.level for run in stable_levels(case, runs)] == [1, 2]


class Sampling(Known):
    """The same at the samples that are asked; its motions die at steps above 0.3 s."""

    def ask(self, request):
        reply = super().ask(request)
        at = np.searchsorted(TIMES, request.times)
        fields = ("time", "p_WB", "quat_WB", "v_WB_W", "w_WB_W")
        some = TrajectoryAnswer(*(getattr(reply.value, name)[at] for name in fields))
        return replace(reply, value=some, returned=request.step < 0.3, cpu=1e-3)


@pytest.mark.parametrize(
    ("error", "longer"),
    [
        (lambda h, _: h**2, [(0.05, 2.5e-3), (0.025, 6.25e-4), (0.01, 1e-4)]),
        (
            lambda h, _: 1e-3 * h**2,
            [(0.4, None), (0.2, 4e-5), (0.1, 1e-5), (0.05, 2.5e-6), (0.025, 6.25e-7), (0.01, 1e-7)],
        ),
        (lambda _, __: 0.1, []),
    ],
    ids=["until three digits are lost", "until the motion dies", "not below three digits"],
)
def test_longer_steps_are_asked_and_decide_nothing(error, longer):
    """Samples are 0.05 s apart and the ladder begins at 0.005 s; of a step of n samples every n-th is asked."""
    method = Method("m", Route.NATIVE, 2, tuple(THREE))
    plan = Plan({Question.TRAJECTORY: ()}, {Question.TRAJECTORY: (method,)}, {})
    runs = list(EngineCase(Sampling(error, 0.0, 0.0), CASE, plan, reference_motion=YARD).question(Question.TRAJECTORY))
    truth = Run("c", REFERENCE, Question.TRAJECTORY, Method("r", Route.REFERENCE), 0, None, Status.ANSWERED, TRUE)
    judged = [run for run in runs if run.level >= 0]
    with_them, without = (
        next(c for c in judge_case(CASE, [truth, *some]) if c.engine == "known") for some in (runs, judged)
    )
    assert [level.step for level in with_them.coarser] == pytest.approx([step for step, _ in longer])
    # the largest difference is at 1.7 s; some strides pass by it, at up to 10 % less
    for level, (_, largest) in zip(with_them.coarser, longer, strict=True):
        assert level.largest == (largest if largest is None else pytest.approx(largest, rel=0.1))
    assert replace(with_them, coarser=()) == without


@pytest.mark.parametrize(
    ("died", "level", "verdict"), [(True, 2, Verdict.UNRESOLVED), (True, 1, Verdict.MODEL), (False, 2, Verdict.MODEL)]
)
def test_softness_whose_runs_died_is_not_ruled_out(died, level, verdict):
    """Levels of order two lead 1e-3 away, and softness does not move them where it can be asked: at the finest."""
    method = Method("m", Route.NATIVE, 2, tuple(THREE), softness=1.0)
    own = [(h, method) for h in (SAMPLE / n for n in THREE)]
    soft = [(own[level][0], replace(method, softness=s)) for s in SCALES[Profile.MATCHED]]
    runs = [
        Run("c", "e", Question.TRAJECTORY, how, n, h, Status.ANSWERED, motion(SIZE * SHAPE * (1e-3 + h**2)))
        for n, (h, how) in enumerate([*own, *soft])
    ]
    if died:
        runs[-1] = replace(runs[-1], status=Status.FAILED, answer=None, reason="it stepped on nothing")
    truth = Run("c", REFERENCE, Question.TRAJECTORY, Method("r", Route.REFERENCE), 0, None, Status.ANSWERED, TRUE)
    (found,) = (c for c in judge_case(CASE, [truth, *runs]) if c.engine == "e")
    assert found.verdict is verdict
    assert (found.rule == "softness unclear" and "stepped on nothing" in found.why) == (verdict is Verdict.UNRESOLVED)


def test_a_rate_beyond_all_steps_is_named():
    """At 1e9 1/s a stable ladder would take more steps than `MOST_STEPS`."""
    case = damped(1e9)
    assert asked(lambda h, s: h**2, case=case)[0] == THREE
    method = Method("m", Route.NATIVE, 2, tuple(THREE))
    run = Run("c", "e", Question.TRAJECTORY, method, 2, 1.25e-3, Status.FAILED, reason="not finite")
    truth = Run("c", REFERENCE, Question.TRAJECTORY, replace(method, order=None), 0, None, Status.ANSWERED, answer=TRUE)
    (found,) = (c for c in judge_case(case, [truth, run]) if c.engine == "e")
    assert (found.verdict, found.rule) == (Verdict.UNRESOLVED, "unresolved rate")
    assert "1e-09 s or less" in found.why
    slow = judge_case(damped(10.0), [truth, run])
    assert [c.verdict for c in slow if c.engine == "e"] == [Verdict.FAILED]


def hopping(limit):
    """An error that is random at any step, about a limit."""
    return lambda h, s: limit(s) + 0.01 * np.random.default_rng(round(1e9 * h)).uniform(-1.0, 1.0)


@pytest.mark.parametrize(
    ("limit", "at_rest", "touches", "rule"),
    [
        (lambda s: 0.02, False, True, "scatter elsewhere"),
        (lambda s: 0.02, True, True, "scatter elsewhere"),
        (lambda s: 0.02 * s, True, True, "not asymptotic"),
        (lambda s: 0.0, False, True, "not asymptotic"),
        (lambda s: 0.02, False, False, "not asymptotic"),
    ],
    ids=["elsewhere", "elsewhere, soft at rest", "soft", "here", "without contact"],
)
def test_motions_that_scatter_in_contact_are_asked_at_coprime_steps(limit, at_rest, touches, rule):
    name, zero = MECHANISM.bodies[0].name, np.zeros(3)
    floor = SpherePlane("floor", name, zero, 0.1, GROUND, zero, np.array([2.0, -1.0, 2.0]), friction=0.3)
    case = replace(CASE, mechanism=replace(MECHANISM, contacts=(floor,) if touches else ()))
    slips = {"event_time": [0.5], "event_kind": [EVENT_KINDS.index("slips")], "event_contact": [0]}
    yard = replace(YARD, answer=replace(TRUE, **{name: np.array(value) for name, value in slips.items()}))
    softness = {"softness": 1.0, "soft_at_rest": True, "profile": Profile.DEFAULT} if at_rest else {}
    method = Method("m", Route.NATIVE, 1, tuple(THREE), **softness)
    plan = Plan({Question.TRAJECTORY: ()}, {Question.TRAJECTORY: (method,)}, {})
    worker = Known(lambda h, s: hopping(limit)(h, s or 1.0), 0.0, 0.0)
    runs = list(EngineCase(worker, case, plan, reference_motion=yard).question(Question.TRAJECTORY))
    coprime = [run for run in runs if run.coprime]
    assert len(coprime) == (touches * (1 + at_rest)) * COUNT
    assert {run.method.softness for run in coprime} == ({None, 0.01} if at_rest else {None} if touches else set())
    assert len(runs) - len(coprime) == MOST_LEVELS
    truth = Run(
        "c", REFERENCE, Question.TRAJECTORY, Method("r", Route.REFERENCE), 0, None, Status.ANSWERED, yard.answer
    )
    (found,) = (c for c in judge_case(case, [truth, *runs]) if c.engine == "known")
    assert found.rule == rule
    assert len(found.levels) == MOST_LEVELS
    assert ("coprime steps" in found.why) == touches
    (found,) = (c for c in judge_case(case, [truth, *runs[:-1]]) if c.engine == "known")
    assert found.rule == "not asymptotic"  # one of the motions is missing


def test_motions_at_coprime_steps_take_no_longer_than_their_budget():
    """The shortest of 24 steps is a level's from which all take 7.0 times as long, and 10 s at most."""
    method = Method("m", Route.NATIVE, 1, tuple(THREE))
    levels = [Run("c", "e", Question.TRAJECTORY, method, n, SAMPLE / 10 / 2**n, Status.ANSWERED) for n in range(8)]
    assert finest_affordable([replace(run, cpu=0.01 * 2**run.level) for run in levels]) == levels[7].step
    assert finest_affordable([replace(run, cpu=0.02 * 2**run.level) for run in levels]) == levels[6].step
    assert finest_affordable([replace(run, cpu=0.05 * 2**run.level) for run in levels]) is None
    assert finest_affordable(levels[:5]) is None


@pytest.mark.parametrize("situation", [s for s in SITUATIONS if s.soft], ids=lambda s: s.name)
def test_softness_does_not_change_a_final_rule(situation: Situation):
    final = {rule.name for rule in RULES if rule.final}
    hard, soft = replace(situation, soft=False).judge(), situation.judge()
    assert (hard.rule in final) == (soft.rule in final)
    assert hard.rule not in final or hard.rule == soft.rule
