"""Engines where nothing acts at the start: springs at rest pull by the rounding of the pose, and dry friction holds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from consilience.case import load_case
from consilience.engine import Profile, Question
from consilience.engine.worker.requests import Request, perform
from consilience.mechanism import Initial, Load, initial_state, sine

BOUND, PUSH, RATE, STIFFNESS = 0.981, 6.0, 3.0, 50.0
"""Of the dry friction in N; of the load in N and rad/s; of the spring in N/m. The mass is 1 kg."""


@pytest.fixture
def shaken():
    """The mass of `dry_spring` in its drawing, pushed along its slide by a force that is zero at the start."""
    mechanism = load_case("dry_spring").mechanism
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    slider = mechanism.bodies[0]
    push = Load("push", "force", slider.name, PUSH * axis, "world", slider.com, sine(1.0, RATE))
    (spring,) = mechanism.joint_springs
    mechanism = replace(mechanism, loads=(push,), joint_springs=(replace(spring, rest=2e-18),))
    return mechanism, initial_state(mechanism, Initial()), axis


def matched(engine, mechanism, start, question):
    methods = perform(engine, Request(mechanism, states=[start])).methods[question]
    return next(method for method in methods if method.profile is Profile.MATCHED)


def test_nothing_moves_and_no_joint_pulls_where_nothing_acts(engine, shaken):
    mechanism, start, _ = shaken
    method = matched(engine, mechanism, start, Question.INSTANT)
    answer = perform(engine, Request(mechanism, Question.INSTANT, method, [start]))
    for value in (answer.a_WB_W, answer.alpha_WB_W, answer.force_F, answer.torque_F):
        assert value is None or np.max(np.abs(value)) < 1e-10 * BOUND


def test_what_a_growing_force_breaks_away_moves_as_by_hand(engine, shaken):
    mechanism, start, axis = shaken
    begin, times = np.arcsin(BOUND / PUSH) / RATE, np.linspace(0.0, 0.4, 9)

    def law(t, y):
        return [y[1], PUSH * np.sin(RATE * t) - STIFFNESS * y[0] - BOUND]

    moved = solve_ivp(law, (begin, times[-1]), [0.0, 0.0], rtol=1e-11, atol=1e-13, dense_output=True).sol
    expected = np.array([moved(t)[0] if t > begin else 0.0 for t in times])
    method = matched(engine, mechanism, start, Question.TRAJECTORY)
    step = times[1] / method.substeps[-1] if method.substeps else method.tolerances[-1]
    answer = perform(engine, Request(mechanism, Question.TRAJECTORY, method, [start], times, step))
    found = (answer.p_WB[:, 0] - answer.p_WB[0, 0]) @ axis
    assert np.max(np.abs(found - expected)) < 1e-2 * expected[-1]
