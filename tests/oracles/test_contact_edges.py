"""Motions with contact at the edges of closed forms: a slide that never ends, a slip that grazes, many bounces."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from consilience.case import load_case
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Function,
    Joint,
    Load,
    Mechanism,
    SpherePlane,
    SphereSphere,
    State,
    quaternion_from_rotation,
)
from consilience.reference.contact import simulate_with_contacts
from contact_problems import BALL, FEET, LEVEL, G, Lab, incline, turned

LAB = Lab()
STATE, TIME = 1e-10, 1e-11


@pytest.mark.parametrize(("share", "end"), [(1.0, 1.0), (1.3, 0.5)])
def test_a_block_thrown_across_an_incline_follows_its_hodograph(share, end):
    """With mu = tan slope it never stops. Speed over heading: C tan(th/2)^kappa / sin th, kappa = mu / tan slope.

    From ``v' = g sin a (cos th - kappa)`` and ``v th' = -g sin a sin th``.
    """
    slope, v0, th0 = np.radians(20.0), 2.0, np.radians(110.0)
    mechanism = LAB.free_body(2.0, (0.05, 0.06, 0.07), incline(20.0), LAB.points(FEET, friction=share * np.tan(slope)))
    start = LAB.state((0.0, 0.0, 0.1), (v0 * np.cos(th0), v0 * np.sin(th0), 0.0))
    scale = v0 * np.sin(th0) / np.tan(th0 / 2) ** share

    def speed(th):
        return scale * np.tan(th / 2) ** share / np.sin(th)

    def over(th, what):
        return quad(lambda x: what(x) * speed(x) / (G * np.sin(slope) * np.sin(x)), th, th0, epsabs=1e-13, limit=200)[0]

    th = brentq(lambda x: over(x, lambda _: 1.0) - end, 1e-3, th0 - 1e-9, xtol=1e-14)
    along = [over(th, lambda x: speed(x) * np.cos(x)), over(th, lambda x: speed(x) * np.sin(x))]
    answer, events = simulate_with_contacts(mechanism, start, np.array([0.0, end]), 1e-13)
    p, v, w = LAB.centre(answer)
    assert not events
    assert p == pytest.approx([*along, 0.1], abs=STATE)
    assert v == pytest.approx([speed(th) * np.cos(th), speed(th) * np.sin(th), 0.0], abs=STATE)
    assert w == pytest.approx(np.zeros(3), abs=STATE)


def test_a_slider_that_slips_on_a_belt_swings_until_it_grazes_the_speed_of_the_belt():
    """``x = c + (v/w) sin w (t - t1)`` after the slip at ``x = c = mu m g / k``: each turn as fast as the belt."""
    k, mu, belt = 40.0, 0.3, 0.5
    case = load_case("belt_catch")  # released where the spring is longer by 0.25 m
    feet = tuple(replace(foot, friction=mu) for foot in case.mechanism.contacts)
    given, block = case.initial_state, case.mechanism.body_index["block"]
    place, speeds = given.p_WB.copy(), given.v_WB_W.copy()
    place[block, 0] -= 0.25
    speeds[block, 0] = belt
    start = replace(given, p_WB=place, v_WB_W=speeds)
    c, rate = mu * G / k, np.sqrt(k)
    slips, end = c / belt, c / belt + 0.9 * 2.0 * np.pi / rate
    answer, events = simulate_with_contacts(replace(case.mechanism, contacts=feet), start, np.array([0.0, end]), 1e-13)
    assert [event.kind for event in events] == ["slips"] * 3
    assert [event.time for event in events] == pytest.approx([slips] * 3, abs=TIME)
    gone = answer.p_WB[-1, block] - place[block]
    assert gone == pytest.approx([c + belt / rate * np.sin(rate * (end - slips)), 0.0, 0.0], abs=STATE)


def test_a_lively_ball_comes_to_rest_after_the_sum_of_its_bounces():
    """``t1 (1 + e)/(1 - e)``, after more than a hundred impacts: the last are short beside rounding of the gap."""
    e, first = 0.9, np.sqrt(2.0 / G)
    mechanism = LAB.free_body(2.0, BALL, LEVEL, [LAB.sphere(0.1, restitution=e)])
    start = LAB.state((0.0, 0.0, 1.1), (0.0, 0.0, 0.0))
    answer, events = simulate_with_contacts(mechanism, start, np.array([0.0, 9.0]), 1e-13)
    assert [event.time for event in events if event.kind == "bounces end"] == pytest.approx(
        [first * (1.0 + e) / (1.0 - e)], abs=1e-9
    )
    assert LAB.centre(answer)[0] == pytest.approx([0.0, 0.0, 0.1], abs=1e-9)


def test_what_a_turning_push_breaks_away_turns_at_once_and_asks_for_no_short_steps():
    """Speed s and heading th of a block: ``s' = P/m cos(phi - th) - mu g``, ``s th' = P/m sin(phi - th)``.

    Near rest the heading follows the push at the rate ``mu g / s``: from ``s = P' tau^2 / (2 m)``, ``th = phi``.
    """
    mu, mass, end = 0.4, 2.0, 0.01
    along, across = Polynomial([6.0, 1.0]), Polynomial([0.0, 0.5, 3.0])
    found = LAB.free_body(
        mass, (0.02, 0.03, 0.04), LEVEL, LAB.points(FEET * [1.0, 1.0, 0.0], friction=mu), [(1, 0, 0), (0, 1, 0)]
    )
    histories = (Function(along.coef), Function(across.coef))
    loads = tuple(replace(load, history=h) for load, h in zip(found.loads, histories, strict=True))

    def push(t):
        return np.hypot(along(t), across(t)), np.arctan2(across(t), along(t))

    start = brentq(lambda t: push(t)[0] - mu * mass * G, 0.0, 3.0, xtol=1e-15)
    size, phi = push(start)
    grows = (along(start) * along.deriv()(start) + across(start) * across.deriv()(start)) / size

    def planar(tau, z):
        (P, turned), (s, th) = push(start + tau), z[:2]
        slides = P / mass * np.cos(turned - th) - mu * G
        return [slides, P / mass * np.sin(turned - th) / s, s * np.cos(th), s * np.sin(th)]

    tau = 1e-6
    s = grows / mass * tau**2 / 2.0
    begun = [s, push(start + tau)[1], s * np.cos(phi) * tau / 3.0, s * np.sin(phi) * tau / 3.0]
    s, th, x, y = solve_ivp(planar, (tau, end), begun, method="Radau", rtol=1e-12, atol=1e-18).y[:, -1]
    times = np.array([0.0, start, start + end])
    answer, events = simulate_with_contacts(replace(found, loads=loads), LAB.state((0, 0, 0), (0, 0, 0)), times, 1e-13)
    assert [event.time for event in events] == pytest.approx([start] * 3, abs=TIME)
    p, v, w = LAB.centre(answer)
    assert [*p, *v] == pytest.approx([x, y, 0.0, s * np.cos(th), s * np.sin(th), 0.0], abs=STATE)
    assert w == pytest.approx(np.zeros(3), abs=STATE)
    assert answer.counters["steps"] < 500  # explicit steps are hundreds of thousands


@pytest.mark.parametrize("drawn", [np.eye(3), LAB.axes, turned(0.4, -0.3, 1.9)])
@pytest.mark.parametrize("balls", [2, 3, 5])
def test_a_row_of_balls_that_touch_is_pushed_and_rolls(balls, drawn):
    """All roll with ``v = w r`` and slide on one another, upwards and downwards, under the forces P between them.

    ``7/5 m a = P_i - P_{i+1} - mu (P_i + P_{i+1})``, where the push ``P_0 = F`` at the centre has no friction. The
    axes of a ball come along the line of centres as it turns, or start there.
    """
    m, r, mu, push, end, R = 2.0, 0.1, 0.1, 20.0, 0.5, LAB.axes
    here, centre = Frame(np.zeros(3), np.eye(3)), np.zeros(3)
    p = LAB.origin + np.array([[2.0 * r * k, 0.0, r] for k in range(balls)]) @ R.T
    bodies = tuple(Body(f"b{k}", m, centre, 0.4 * m * r * r * np.eye(3), Frame(p[k], drawn)) for k in range(balls))
    floors = [SpherePlane(f"f{k}", f"b{k}", centre, r, GROUND, LAB.origin, R[:, 2], friction=0.3) for k in range(balls)]
    between = [SphereSphere(f"s{k}", f"b{k + 1}", centre, r, f"b{k}", centre, r, friction=mu) for k in range(balls - 1)]
    joints = tuple(Joint(f"free {b.name}", "free", GROUND, b.name, here, here) for b in bodies)
    load = Load("push", "force", "b0", push * R[:, 0], "world")
    mechanism = Mechanism("row", R @ LEVEL, bodies, joints, contacts=(*floors, *between), loads=(load,))
    rest = np.zeros((balls, 3))
    start = State(p, np.tile(quaternion_from_rotation(drawn), (balls, 1)), rest, rest)

    pressed = np.zeros((balls, balls + 1))  # columns P_0 to P_n, the last of which is zero
    pressed[np.arange(balls), np.arange(balls)] = 1.0 - mu
    pressed[np.arange(balls), np.arange(balls) + 1] = -1.0 - mu
    pressed[0, 0] = 1.0
    unknown = np.column_stack([np.full(balls, 1.4 * m), -pressed[:, 1:balls]])
    a, *P = np.linalg.solve(unknown, push * pressed[:, 0])
    assert min(P) > 0.0
    assert 0.4 * m * a + mu * (P[0] + max(P[1:], default=0.0)) < 0.3 * (m * G - mu * push)

    answer, events = simulate_with_contacts(mechanism, start, np.linspace(0.0, end, 6), 1e-11)
    assert not events
    moved = (answer.p_WB[-1] - p) @ R
    assert moved == pytest.approx(np.tile([0.5 * a * end**2, 0.0, 0.0], (balls, 1)), abs=STATE)
    assert answer.w_WB_W[-1] @ R == pytest.approx(np.tile([0.0, a * end / r, 0.0], (balls, 1)), abs=STATE)
    impulse = np.array([one @ R for one in np.sum(answer.contact_impulse, axis=0)[balls:]])
    assert impulse == pytest.approx(end * np.outer(P, [1.0, 0.0, -mu]), abs=STATE)


@pytest.mark.parametrize("tilt", [0.05, 0.15, 0.3])
@pytest.mark.parametrize("across", [(0.0,), (-0.1, 0.1)])
def test_a_box_that_rocks_to_rest_loses_the_weight_times_the_fall_of_its_centre(across, tilt):
    """It starts at rest on an edge, on two feet or four, and lies flat in the end: all of m g (z - c) is lost."""
    m, a, c = 2.0, 0.1, 0.2
    law = {"friction": 0.6, "restitution": 0.3}
    feet = LAB.points([(x, y, -c) for x in (-a, a) for y in across], **law)
    mechanism = LAB.free_body(m, (m * 0.05 / 3.0, m * 0.05 / 3.0, m * 0.02 / 3.0), LEVEL, feet)
    z = a * np.sin(tilt) + c * np.cos(tilt)
    start = LAB.state((0.0, 0.0, z), (0.0, 0.0, 0.0), turn=turned(0.0, tilt, 0.0))
    answer, _ = simulate_with_contacts(mechanism, start, np.array([0.0, 1.5]), 1e-11)
    p, v, w = LAB.centre(answer)
    assert [p[2], *v, *w] == pytest.approx([c, *np.zeros(6)], abs=STATE)
    assert answer.contact_loss[-1] == pytest.approx(m * G * (z - c), abs=1e-11)
