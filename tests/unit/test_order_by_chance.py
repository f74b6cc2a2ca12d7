"""Where modes change, an order that positions alone show does not prove another motion."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.compare import ReferenceMotion, Verdict, compare_trajectory
from consilience.engine import Method, Question, Route, Run, Status
from consilience.mechanism import GROUND, SpherePlane, quaternion_from_rotation_vector
from situations import MECHANISM, SHAPE, SIZE, STEPS, TIMES, TRUE, motion

FLOOR = SpherePlane("floor", "b0", np.zeros(3), 0.1, GROUND, np.zeros(3), np.array([0.0, 0.0, 1.0]))


def judged(mechanism, turn):
    """Verdict on an error of order two beside a plateau of 1e-3, and turns by a function of the step."""
    method = Method("m", Route.NATIVE, 2, (10, 20, 40))
    runs = []
    for n, h in enumerate(STEPS):
        answer = motion(1e-3 * (1.0 + 0.3 * (h / STEPS[-1]) ** 2) * SIZE * SHAPE)
        turned = [
            quaternion_from_rotation_vector([0.0, 0.0, t + turn(h) * s]) for t, s in zip(TIMES, SHAPE, strict=True)
        ]
        answer = replace(answer, quat_WB=np.array(turned)[:, None])
        runs.append(Run("c", "e", Question.TRAJECTORY, method, n, h, Status.ANSWERED, answer))
    return compare_trajectory(mechanism, runs, ReferenceMotion(TRUE, np.zeros(len(TIMES)), 8))


@pytest.mark.parametrize(
    ("turn", "contacts", "verdict", "rule"),
    [
        (lambda h: 0.2 * h**2, (FLOOR,), Verdict.MODEL, "elsewhere"),
        (lambda h: 5e-4 * (h < 0.008), (FLOOR,), Verdict.UNRESOLVED, "wide band"),
        (lambda h: 1e-5 * (h < 0.008), (FLOOR,), Verdict.MODEL, "elsewhere"),
        (lambda h: 5e-4 * (h < 0.008), (), Verdict.MODEL, "elsewhere"),
    ],
    ids=["both have the order", "turns have none", "turns hardly move", "no modes change"],
)
def test_positions_and_orientations_have_to_show_the_order(turn, contacts, verdict, rule):
    found = judged(replace(MECHANISM, contacts=contacts), turn)
    assert (found.verdict, found.rule) == (verdict, rule)
