"""Angles of motions whose samples are more than half a turn apart, against turning at a constant rate."""

import numpy as np
import pytest

import consilience as cs
from consilience.mechanism import with_full_turns
from consilience.report.curves import curve_sets

RATE, END = 23.0, 2.0


def wheel():
    """A wheel that turns freely."""
    draw = cs.Drawing("wheel", gravity=(0, 0, 0))
    draw.body("wheel", mass=2.0, at=(0.1, 0.2, 0), com=(0, 0, 0), inertia=(0.4, 0.4, 0.4))
    draw.joint("hinge", "revolute", "ground", "wheel", at=(0.1, 0.2, 0), axis=(1, 2, 2))
    return draw.case(start={"hinge": {"angle": 0.7}}, rates={"hinge": {"angle": RATE}}, duration=END, sample=0.25)


def test_a_wheel_turns_on_between_samples():
    """5.75 rad between samples: the least way would be -0.53 rad."""
    motion = cs.simulate(wheel())
    np.testing.assert_allclose(motion.coordinates("hinge"), 0.7 + RATE * motion.time, atol=1e-9)


def test_a_wheel_of_a_study_turns_on_between_samples():
    study = cs.study(wheel(), {"body.wheel.mass": [1.0, 2.0]})
    np.testing.assert_allclose(study.coordinates("hinge"), [0.7 + RATE * study.time] * 2, atol=1e-9)


def test_a_curve_of_coordinates_turns_on_between_samples():
    motion = cs.simulate(wheel())
    (drawn,) = [one for one in curve_sets(motion.mechanism, motion) if one.what == "coordinates"]
    np.testing.assert_allclose(drawn.values[:, 0], 0.7 + RATE * drawn.time, atol=1e-9)


@pytest.mark.parametrize("samples", [3, 40])
def test_turns_are_those_of_a_pendulum_that_whirls(samples):
    """``q = 4 t + sin(t)``, known within half a turn: the mean of both rates leads to within half a turn of it."""
    t = np.linspace(0.0, 2.0, samples)
    q = 4.0 * t + np.sin(t)
    within = np.arctan2(np.sin(q), np.cos(q))
    np.testing.assert_allclose(with_full_turns(within, 4.0 + np.cos(t), t), q, atol=1e-12)
