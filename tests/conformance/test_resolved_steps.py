"""Steps against the rates of a case, on real engines: too coarse ones are no model and hide none."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Case
from consilience.compare import Verdict
from consilience.compare.judge import STABLE, judge_case
from consilience.engine import Question
from consilience.engine.worker.client import InProcessEngine
from consilience.mechanism import GROUND, Initial, JointSpring, Spring, drawing_state, joint_frames
from consilience.suite.engine_runs import ask_case
from mechanisms import chain

MOTION = [Question.TRAJECTORY]
PASSES = (Verdict.AGREES, Verdict.DISCRETISATION, Verdict.REGULARISATION)


def case_of(mechanism, start, duration):
    return Case("c", "c.toml", "own", mechanism, start, duration, 0.05, 6, 1, 1)


def judged(case, engine, about=None):
    """Comparisons of the matched motions of an engine with a case, by method; `about` is the case that it is told."""
    runs = [run for name, told in (("reference", case), (engine, about or case)) for run in asked(name, told)]
    return {c.method: c for c in judge_case(case, runs) if c.engine == engine and c.profile == "matched"}


def asked(engine, case):
    return list(ask_case(InProcessEngine(engine), case, MOTION))


def test_a_stiff_damper_gets_steps_at_which_explicit_methods_are_stable():
    """A slide that a damper of 5e4 1/s slows: RK4 diverges at the usual steps of 1.25 to 5 ms."""
    slide = chain("prismatic", seed=3)
    damper = JointSpring("d", "j0", "distance", 0.0, 5e4 * slide.bodies[0].mass, 0.0)
    case = case_of(replace(slide, joint_springs=(damper,)), Initial(), 0.2)
    assert case.fastest_rate == pytest.approx(5e4, rel=1e-5)
    found = judged(case, "mujoco")
    assert {c.verdict for c in found.values()} <= set(PASSES), found
    assert found["RK4"].verdict is Verdict.AGREES
    assert found["RK4"].levels[0].step * case.fastest_rate <= STABLE < 1.25e-3 * case.fastest_rate


def test_a_spring_thrown_through_its_anchor_is_unresolved():
    """Its force jumps by 2 k L0 where the ends meet: no order is observed, and no model is wrong."""
    slide = replace(chain("prismatic", seed=3), gravity=np.zeros(3))
    state, joint = drawing_state(slide), slide.joints[0]
    axis = joint_frames(slide, state, joint).U[:, 2]
    anchor = state.p_WB[0] - 0.31 * axis
    spring = Spring("s", GROUND, "b0", anchor, np.zeros(3), 100.0, 0.5, 0.1)
    found = judged(case_of(replace(slide, springs=(spring,)), Initial(), 0.5), "mujoco")
    assert (found["RK4"].verdict, found["RK4"].rule) == (Verdict.UNRESOLVED, "unresolved rate")
    assert "its force jumps" in found["RK4"].why
    assert Verdict.MODEL not in {c.verdict for c in found.values()}


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 2.0, 0.0, -1.0])
def test_steps_so_coarse_that_motions_saturate_pass_no_gravity(factor):
    """A lumpy body on a universal joint, 30 rad/s about its second axis: Euler's levels are a radian apart."""
    start = Initial(rates={"j0": {"angle1": 3.0, "angle2": 30.0}})
    case = case_of(chain("universal", seed=6), start, 3.0)
    wrong = replace(case, mechanism=replace(case.mechanism, gravity=factor * case.mechanism.gravity))
    verdict = judged(case, "mujoco", wrong)["Euler"].verdict
    assert verdict not in PASSES
    assert verdict is not Verdict.MODEL or factor != 1.0
