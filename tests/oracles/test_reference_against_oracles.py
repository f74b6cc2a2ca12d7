"""The reference solver against closed forms and independent reductions: 1e-11 over 10 s, 1e-10 over 5 s."""

import numpy as np
import pytest

from consilience.mechanism import quaternion_from_rotation, rotation_angle_between
from oracles.shipped import TRAJECTORIES, answer


def simulated(case):
    """Motion of a case by the reference solver."""
    from consilience.reference import simulate

    return simulate(case.mechanism, case.initial_state, case.times, tolerance=1e-12, formulation="descriptor")


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_trajectory(name):
    case, p_WB, R_WB = answer(name)
    motion = simulated(case)
    bar = 1e-11 if name.startswith("simple_pendulum") else 1e-10
    assert np.array_equal(motion.time, case.times)
    assert np.max(np.abs(motion.p_WB - p_WB)) < bar
    assert np.max(rotation_angle_between(motion.quat_WB, quaternion_from_rotation(R_WB))) < bar
