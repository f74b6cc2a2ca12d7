"""Steps of Exudyn's motions with contacts: what the numbers of contacts make of errors as the step vanishes."""

from dataclasses import replace

import numpy as np
import pytest

from consilience import simulate
from consilience.case import load_case
from consilience.engine import Question, Route
from consilience.mechanism import contact_velocity, nearest_points
from contact_problems import FEET, G, Lab, incline

pytest.importorskip("exudyn")

from consilience_exudyn import ExudynEngine
from consilience_exudyn.contact_motion import contact_motion, halved_motions
from consilience_exudyn.contact_rows import contact_row

LAB = Lab()


def test_a_box_that_tips_errs_in_proportion_to_the_step():
    """Two corners open at once: the bound of their force, and so their zone of friction, is that of the others."""
    case = load_case("box_tips")
    reference = simulate(case)
    errors = []
    for step in (1e-4, 5e-5, 2.5e-5):
        answer = contact_motion(case.mechanism, case.initial_state, case.times, step)
        errors.append(np.linalg.norm(answer.p_WB[-1] - reference.p_WB[-1]))
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, atol=0.05)


def test_rounding_does_not_turn_the_forces_of_points():
    """Feet that slide down an incline at 20 degrees, s = v t + (sin - mu cos) g t^2 / 2, by small steps."""
    mu, angle, times = 0.2, np.radians(20.0), np.linspace(0.0, 0.5, 3)
    mechanism = LAB.free_body(2.0, (0.02, 0.02, 0.04), incline(20.0), LAB.points(FEET, friction=mu))
    start = LAB.state((0.0, 0.0, -FEET[0][2]), (1.0, 0.0, 0.0))
    p, _, _ = LAB.centre(contact_motion(mechanism, start, times, 1e-5))
    s = 0.5 + 0.125 * G * (np.sin(angle) - mu * np.cos(angle))
    assert np.linalg.norm(p - [s, 0.0, -FEET[0][2]]) < 4e-9


def test_a_block_slides_as_far_from_any_place_of_its_plane():
    """Rounding turns the forces of points by another part at each place; the limit of steps multiplies what is left."""
    case = load_case("block_incline-down")
    start, along = case.initial_state, case.initial_state.v_WB_W[0] / np.linalg.norm(case.initial_state.v_WB_W[0])
    ways = []
    for shift in (0.0, 1.2345678e-3, 2.4691356e-3):
        shifted = replace(start, p_WB=start.p_WB + shift * along)
        (motion,) = halved_motions(case.mechanism, shifted, case.times, 7.8125e-5, 1)
        ways.append((motion.p_WB[-1, 0] - shifted.p_WB[0]) @ along)
    assert np.ptp(ways) < 2e-8


def test_corners_without_load_widen_no_zone():
    """What sticks on an incline creeps by the zone, ``tan(angle)/mu`` of it in a second: by that of its feet alone."""
    feet, times = np.concatenate([FEET, FEET * [1.0, 1.0, -1.0]]), np.linspace(0.0, 0.2, 3)
    start, ways = LAB.state((0.0, 0.0, -FEET[0][2]), (0.0, 0.0, 0.0)), []
    for points in (FEET, feet):
        mechanism = LAB.free_body(2.0, (0.02, 0.02, 0.04), incline(20.0), LAB.points(points, friction=0.5))
        p, _, _ = LAB.centre(contact_motion(mechanism, start, times, 2e-4))
        ways.append(p[0])
    assert ways[1] == pytest.approx(ways[0], rel=0.01)


def test_a_stop_without_rebound_catches_within_steps():
    """A wheel that starts half a radian before the stop has turned by that at all samples after the impact."""
    case = load_case("wheel_caught_by_stop")
    answer = contact_motion(case.mechanism, case.initial_state, case.times, 2.5e-5, 1.0)
    cosine = np.abs(answer.quat_WB[:, 0] @ answer.quat_WB[0, 0])
    np.testing.assert_allclose(2.0 * np.arccos(cosine[case.times > 0.168]), 0.5, atol=1e-6)


def test_motions_that_are_extrapolated_have_zones_in_proportion_to_their_steps():
    """A wheel is braked until it locks by a force that grows tenfold: all have the bounds of the first motion."""
    case, engine = load_case("braked_wheel"), ExudynEngine()
    methods = engine.methods(case.mechanism, Question.TRAJECTORY)
    (method,) = [one for one in methods if one.route is Route.EXTRAPOLATED]
    reference = simulate(case)
    answer = engine.trajectory(case.mechanism, case.initial_state, case.times, method, 5e-4)
    assert np.max(np.abs(answer.quat_WB - reference.quat_WB)) < 1e-5


def test_boxes_start_to_slip_with_errors_in_powers_of_the_step():
    """``v = 25 (t - t1)^2/(m1 + m2)`` once 50 t exceeds the friction of the floor; the corners have one zone."""
    case, pull = load_case("pulled_boxes"), np.array([0.6, 0.8, 0.0])
    exact = 25.0 * (0.2 - 0.2 * 4.0 * G / 50.0) ** 2 / 4.0
    motions = halved_motions(case.mechanism, case.initial_state, np.linspace(0.0, 0.2, 5), 0.05 / 160, 4)
    over_step = [2**n * (motion.v_WB_W[-1, 0] @ pull - exact) for n, motion in enumerate(motions)]
    first, second, third = np.diff(over_step)
    np.testing.assert_allclose([first / second, second / third], 2.0, atol=0.01)


@pytest.mark.parametrize("name", ["rough_spheres_grip", "colliding_spheres"])
def test_rows_of_shapes_that_are_apart_have_the_levers_of_their_own_surfaces(name):
    case = load_case(name)
    mechanism, state, contact = case.mechanism, case.initial_state, case.mechanism.contacts[0]
    row = contact_row(mechanism, state, contact, 0)
    slip = contact_velocity(mechanism, state, contact, nearest_points(mechanism, state, contact))
    velocities = np.concatenate([state.v_WB_W, state.w_WB_W], axis=1).ravel()
    assert row.gap > 0.1
    np.testing.assert_allclose(row.J @ velocities, slip, atol=1e-14)
    np.testing.assert_allclose(row.u, slip, atol=1e-14)


def test_rough_spheres_grip_at_steps_that_resolve_the_hit():
    """Closed form of the case, sixteen steps to the hit; a zone wider than the slip would leave half of the spin."""
    case = load_case("rough_spheres_grip")
    answer = contact_motion(case.mechanism, case.initial_state, case.times, 1e-4, 1.0)
    spin = [p.value for p in case.published if (p.of, p.observable) == ("first", "w_WB_W")]
    assert np.linalg.norm(answer.w_WB_W[-1, 0] - spin) < 0.02 * np.linalg.norm(spin)


@pytest.mark.parametrize("steps", [400, 1600])
def test_a_contact_that_loses_its_load_at_once_keeps_no_speed_of_its_spring(steps):
    """The ball in the corner stops spinning, and with it what pressed it on the wall: it rests."""
    case = load_case("ball_in_corner-stays")
    answer = contact_motion(case.mechanism, case.initial_state, case.times, case.sample / steps, 1.0)
    assert np.linalg.norm(answer.v_WB_W[-1, 0]) < 1e-9
    assert np.linalg.norm(answer.w_WB_W[-1, 0]) < 1e-9
