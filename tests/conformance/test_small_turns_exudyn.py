"""Turns of free bodies in Exudyn that are small in a step, where body, world and node begin with the same axes."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.mechanism import GROUND, BoxPlane, Load, PointPlane
from contact_problems import LEVEL, Lab

pytest.importorskip("exudyn")

from consilience_exudyn.contact_motion import contact_motion

LAB = Lab(origin=np.zeros(3), axes=np.eye(3))
TIMES = np.linspace(0.0, 0.5, 6)
FAR = PointPlane("tip", "body", np.zeros(3), GROUND, np.array([0.0, 0.0, -9.0]), np.array([0.0, 0.0, 1.0]))
FALLS_FREELY = LAB.free_body(2.0, (0.2, 0.3, 0.4), np.zeros(3), [FAR])


@pytest.mark.parametrize("turn", [1e-6, 1e-8, 1e-10])
def test_a_body_that_turns_slowly_turns_by_its_rate_times_the_time(turn):
    """About a principal axis of a lumpy body: the quaternion is half the angle along it."""
    step = 1e-3
    rate = turn / step * LAB.principal[:, 2]
    answer = contact_motion(FALLS_FREELY, LAB.state((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), rate, LAB.principal), TIMES, step)
    assert np.linalg.norm(answer.quat_WB[-1, 0, 1:] - 0.25 * rate) < 1e-5 * np.linalg.norm(0.25 * rate)


def test_loads_are_in_the_axes_of_the_body():
    """Force and torque along a principal axis through the centre of mass: F t^2 / (2 m), the angle T t^2 / (2 I)."""
    axis = LAB.principal[:, 2]
    loads = (
        Load("push", "force", "body", 3.0 * axis, "body", LAB.com),
        Load("screw", "torque", "body", 0.4 * axis, "body"),
    )
    start = LAB.state((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), turn=LAB.principal)
    answer = contact_motion(replace(FALLS_FREELY, loads=loads), start, TIMES, 1e-3)
    np.testing.assert_allclose(LAB.centre(answer)[0], 3.0 * axis * 0.25 / 4.0, atol=1e-12)
    np.testing.assert_allclose(answer.quat_WB[-1, 0, 1:], np.sin(0.5 * 0.25 / 2.0) * axis, atol=1e-10)


def test_a_box_that_has_slid_to_rest_rests():
    """It stops after v / (mu g) = 0.23 s; what its corners rock at that moment dies away."""
    origin, up = np.zeros(3), np.array([0.0, 0.0, 1.0])
    box = BoxPlane("floor", "body", LAB.com, np.array([0.2, 0.2, 0.1]), GROUND, origin, up, friction=0.5)
    mechanism = LAB.free_body(2.0, (0.03, 0.03, 0.05), LEVEL, [box])
    start = LAB.state((0.0, 0.0, 0.1), (1.0, 0.5, 0.0), turn=LAB.principal)
    answer = contact_motion(mechanism, start, TIMES, 1.5625e-5, 1.0)
    assert np.max(np.abs(answer.v_WB_W[-1])) < 1e-10
    assert np.max(np.abs(answer.w_WB_W[-1])) < 1e-10
