"""Fastest rates of mechanisms against closed forms of one freedom; lumpy bodies in skew frames."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.compare.evidence import Evidence
from consilience.compare.rules import decide
from consilience.mechanism import (
    GROUND,
    Friction,
    JointSpring,
    Spring,
    drawing_state,
    fastest_rate,
    joint_frames,
    turning_rate,
)
from consilience.mechanism.observables import SampledMotion, body_point
from mechanisms import chain

SLIDE, HINGE = chain("prismatic", seed=3), chain("revolute", seed=4)


def sprung(mechanism, coordinate, stiffness, damping):
    return replace(mechanism, joint_springs=(JointSpring("k", "j0", coordinate, stiffness, damping, 0.1),))


@pytest.mark.parametrize(("stiffness", "damping"), [(400.0, 0.0), (400.0, 3.0), (0.0, 5e4), (50.0, 900.0)])
def test_a_sprung_slide_has_the_roots_of_its_quadratic(stiffness, damping):
    """Roots of ``m x'' + c x' + k x = 0``, oscillating or decaying."""
    mechanism, mass = sprung(SLIDE, "distance", stiffness, damping), SLIDE.bodies[0].mass
    roots = np.roots([mass, damping, stiffness])
    assert fastest_rate(mechanism, drawing_state(mechanism)) == pytest.approx(np.max(np.abs(roots)), rel=1e-6)


def test_a_sprung_hinge_swings_about_its_own_axis():
    """``sqrt(k / I)`` with the moment of inertia about the hinge; gravity is 1e-8 of the spring."""
    mechanism, (body,) = sprung(HINGE, "angle", 1e9, 0.0), HINGE.bodies
    state = drawing_state(mechanism)
    R = state.R_WB[0]
    axis = joint_frames(mechanism, state, mechanism.joints[0]).U[:, 2]
    at, _ = body_point(mechanism, state, body.name, mechanism.joints[0].M.p)
    arm = np.cross(axis, state.p_WB[0] + R @ body.com - at)
    inertia = axis @ R @ body.inertia @ R.T @ axis + body.mass * arm @ arm
    assert fastest_rate(mechanism, state) == pytest.approx(np.sqrt(1e9 / inertia), rel=1e-6)


def test_friction_is_fastest_where_it_creeps():
    """At rest the slope of ``F tanh(v / s)`` is F / s."""
    mechanism = replace(SLIDE, frictions=(Friction("f", "j0", "distance", 0.5, 8.0, 1e-3),))
    expected = (0.5 + 8.0 / 1e-3) / SLIDE.bodies[0].mass
    assert fastest_rate(mechanism, drawing_state(mechanism)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("distance", [0.3, 1e-5, 0.0])
def test_a_spring_turns_fastest_where_it_is_shortest(distance):
    """Past the anchor on a straight line at the distance d and the speed v: v / d, between two samples."""
    body, speed, time = SLIDE.bodies[0], 5.0, np.linspace(0.0, 1.0, 11) - 0.4321
    R, zero = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0], np.zeros((11, 1, 3))
    p = (np.outer(time, speed * R[0]) + distance * R[1])[:, None]
    motion = SampledMotion(p, np.tile(np.eye(3), (11, 1, 1, 1)), zero + speed * R[0], zero)
    bent = Spring("s", GROUND, body.name, np.zeros(3), np.zeros(3), 100.0, 0.5, 0.2)
    found = turning_rate(replace(SLIDE, springs=(bent,)), motion, time)
    assert found == pytest.approx(speed / distance, rel=1e-6) if distance else found > 1e12
    assert turning_rate(replace(SLIDE, springs=(replace(bent, free_length=0.0),)), motion, time) == 0.0


@pytest.mark.parametrize(("rate", "rule"), [(7.9e4, "unresolved rate"), (10.0, "converged elsewhere")])
def test_a_vibration_that_every_level_damps_away_is_no_other_model(rate, rule):
    """Implicit Euler damps by (h w)^2 / 2 a step: of 7.9e4 1/s nothing is left after 0.1 s at 4e-6 s, of 10 1/s all."""
    levels = {"limit": 1e-3, "band": 0.0, "spread": 0.0, "order": 0.0, "declared": 1, "step": 4e-6}
    found, why = decide(Evidence(1e-6, judged=0.1, duration=0.1, reference=0.0, finest=1e-3, rate=rate, **levels))
    assert found.name == rule, why
