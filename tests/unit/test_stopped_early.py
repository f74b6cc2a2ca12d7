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


def judged(errors, off=0.0, shape=SHAPE):
    """Compare levels of order one with these errors, in `UNIT`, of an engine with a parameter that is off."""
    method = Method("m", Route.NATIVE, 1, substeps=(10, 20, 40))
    levels = [motion(SIZE * (SHAPE * UNIT * error + off * EFFECT * shape)) for error in errors]
    runs = [
        Run("c", "e", Question.TRAJECTORY, method, n, h, Status.ANSWERED, level)
        for n, (h, level) in enumerate(zip(HALVES, levels, strict=False))
    ]
    pair = TRUE, motion(SIZE * EFFECT * SMALL * shape)
    effect = np.maximum.accumulate(EFFECT * np.abs(shape))
    acting = MotionSensitivity("gravity", "gravity", effect, pair, SMALL)
    return compare_trajectory(MECHANISM, runs, ReferenceMotion(TRUE, np.zeros(len(TIMES)), 8, sensitivities=(acting,)))


LIMIT_OFF = (7.2, 4.4, 2.9, 1.91)
"""Errors whose third level has a limit 1.4 off, half of its own difference, and whose fourth leads to the reference."""


def test_a_limit_that_an_error_cancels_at_an_earlier_level_raises_the_stated_error():
    """By the fourth level a quarter of 1.91 passes; at the third 1.4 do, which take its limit to the reference."""
    found = judged(LIMIT_OFF)
    assert found.verdict is Verdict.DISCRETISATION
    assert found.power[0].limit == pytest.approx(1.4 * UNIT / EFFECT, rel=1e-6)
    # the engine with that error ends at the third level, and passes there; with twice the error it does not
    assert judged(LIMIT_OFF[:3], off=-found.power[0].limit).verdict is Verdict.DISCRETISATION
    assert judged(LIMIT_OFF[:3], off=-2.0 * found.power[0].limit).verdict is not Verdict.DISCRETISATION


def test_an_error_that_changes_the_motion_at_other_times_cancels_nothing():
    late = np.where(TIMES > 1.9, np.max(np.abs(SHAPE)), 0.0)
    assert judged(LIMIT_OFF, shape=late).power[0].limit == pytest.approx(0.25 * 1.91 * UNIT / EFFECT, rel=0.01)


def test_three_levels_have_no_earlier_one():
    assert judged((8.0, 4.0, 2.0)).power[0].limit == pytest.approx(0.25 * 2.0 * UNIT / EFFECT, rel=0.01)
