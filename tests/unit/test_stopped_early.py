"""Power of ladders that another model would have ended at an earlier level."""

import numpy as np
import pytest

from consilience.compare import ReferenceMotion, Verdict, compare_trajectory
from consilience.compare.power import MotionSensitivity
from consilience.engine import Method, Question, Route, Run, Status
from situations import MECHANISM, SHAPE, SIZE, TIMES, TRUE, motion

EFFECT, SMALL = 1e-3, 1e-5
"""Change of the motion for an error of one, and the error with which the reference is asked."""

UNIT = 1e-5
HALVES = (0.02, 0.01, 0.005, 0.0025)
EARLY, LATE = np.where(TIMES < 1.0, 1.0, 0.0), np.where(TIMES > 1.9, 1.0, 0.0)

LIMIT_OFF = [SHAPE * error for error in (7.2, 4.4, 2.9, 1.91)]
"""Errors of order one whose third level has a limit 1.4 off, half of its own, and whose fourth leads on."""

BY_A_HAIR = [EARLY * early + LATE * late for early, late in ((256, 0.26), (16, 0.26), (1, 0.26), (0.0625, 0.005))]
"""Errors of order four whose third level has a limit 0.26 off where the finest differs by 1: a quarter would pass."""


def judged(errors, order, off=0.0, shape=SHAPE):
    """Compare levels with these errors over time, in `UNIT`, of an engine with a parameter that is off."""
    method = Method("m", Route.NATIVE, order, substeps=(10, 20, 40))
    levels = [motion(SIZE * (UNIT * error + off * EFFECT * shape)) for error in errors]
    runs = [
        Run("c", "e", Question.TRAJECTORY, method, n, h, Status.ANSWERED, level)
        for n, (h, level) in enumerate(zip(HALVES, levels, strict=False))
    ]
    pair = TRUE, motion(SIZE * EFFECT * SMALL * shape)
    effect = np.maximum.accumulate(EFFECT * np.abs(shape))
    acting = MotionSensitivity("gravity", "gravity", effect, pair, SMALL)
    return compare_trajectory(MECHANISM, runs, ReferenceMotion(TRUE, np.zeros(len(TIMES)), 8, sensitivities=(acting,)))


def test_a_limit_that_an_error_cancels_at_an_earlier_level_raises_the_stated_error():
    """By the fourth level a quarter of 1.91 passes; at the third 1.4 do, which take its limit to the reference."""
    found = judged(LIMIT_OFF, 1)
    assert found.verdict is Verdict.DISCRETISATION
    assert found.power[0].limit == pytest.approx(1.4 * UNIT / EFFECT, rel=1e-6)
    # the engine with that error ends at the third level, and passes there; with twice the error it does not
    assert judged(LIMIT_OFF[:3], 1, off=-found.power[0].limit).verdict is Verdict.DISCRETISATION
    assert judged(LIMIT_OFF[:3], 1, off=-2.0 * found.power[0].limit).verdict is not Verdict.DISCRETISATION


def test_an_error_that_makes_a_limit_small_beside_the_difference_raises_the_stated_error():
    """By the fourth level 1/64 passes; at the third 0.04 to 1/3 do, of which a quarter of 1 and more are above 0.26."""
    found = judged(BY_A_HAIR, 4, shape=EARLY)
    assert found.verdict is Verdict.DISCRETISATION
    assert 0.25 < found.power[0].limit * EFFECT / UNIT < 1.0 / 3.0
    assert judged(BY_A_HAIR[:3], 4, off=found.power[0].limit, shape=EARLY).verdict is Verdict.DISCRETISATION
    assert judged(BY_A_HAIR[:3], 4, off=2.0 * found.power[0].limit, shape=EARLY).verdict is Verdict.UNRESOLVED


def test_an_error_that_changes_the_motion_at_other_times_raises_nothing():
    found = judged(LIMIT_OFF, 1, shape=LATE)
    assert found.power[0].limit == pytest.approx(0.25 * 1.91 * np.max(np.abs(SHAPE)) * UNIT / EFFECT, rel=0.01)


def test_three_levels_have_no_earlier_one():
    found = judged([SHAPE * error for error in (8.0, 4.0, 2.0)], 1)
    assert found.power[0].limit == pytest.approx(0.25 * 2.0 * UNIT / EFFECT, rel=0.01)
