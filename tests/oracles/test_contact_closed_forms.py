"""Closed forms of contact: each obeys its law between events, by differences, and at its events, by balances."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from oracles.closed_forms import collisions, events, sliding
from oracles.test_closed_forms import difference

G = 9.81


def slopes(function, times, h=2e-4):
    """Derivative of a function of one time at several times, none within 4 h of an event."""
    return difference(lambda ts: np.array([function(t) for t in ts]), np.array(times), h)


def along(u):
    return u / np.linalg.norm(u)


# --- sliding --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("B", [2.0, 3.4, 3.5, 6.0])
@pytest.mark.parametrize("start", [(-0.7, 1.9), (1.5, -0.4), (-2.0, 0.0), (1.0, 0.0)])
def test_a_slide_obeys_coulombs_law_until_it_stops(B, start):
    A = np.array([3.5, 0.0])
    stop = sliding.coulomb_slide(A, B, start, 0.0)[2]
    times = np.linspace(0.05, min(stop, 1.5) - 0.05, 7)
    u = np.array([sliding.coulomb_slide(A, B, start, t)[0] for t in times])
    assert sliding.coulomb_slide(A, B, start, 0.0)[0] == pytest.approx(start, abs=1e-14)
    expected = A - B * u / np.linalg.norm(u, axis=1)[:, None]
    assert slopes(lambda t: sliding.coulomb_slide(A, B, start, t)[0], times) == pytest.approx(expected, abs=1e-9)
    assert slopes(lambda t: sliding.coulomb_slide(A, B, start, t)[1], times) == pytest.approx(u, abs=1e-9)
    if np.isfinite(stop):
        before, after = (sliding.coulomb_slide(A, B, start, stop + dt)[1] for dt in (-1e-9, 1e-9))
        assert np.linalg.norm(sliding.coulomb_slide(A, B, start, stop - 1e-6)[0]) < 1e-4
        assert after == pytest.approx(before, abs=1e-8)


POLYGONS = {n: np.array([[np.cos(a), np.sin(a)] for a in 0.2 + 2 * np.pi * np.arange(n) / n]) for n in (4, 5, 8)}


@pytest.mark.parametrize("vertices", [*POLYGONS.values(), np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])])
@pytest.mark.parametrize("heading", [0.4, 1.9, 4.0])
def test_a_slide_in_a_polygon_dissipates_most(vertices, heading):
    B, start = 3.0, 2.0 * np.array([np.cos(heading), np.sin(heading)])
    stop = sliding.polygon_slide(vertices, B, start, 0.0)[2]
    for t in np.linspace(0.02, stop - 0.02, 23):
        u = sliding.polygon_slide(vertices, B, start, t)[0]
        steps = [sliding.polygon_slide(vertices, B, start, t + dt) for dt in (-1e-7, 1e-7)]
        force = (steps[1][0] - steps[0][0]) / 2e-7 / B
        assert -force @ u == pytest.approx(np.max(-vertices @ u), abs=1e-6)
        assert (steps[1][1] - steps[0][1]) / 2e-7 == pytest.approx(u, abs=1e-6)
        across = np.array([-u[1], u[0]]) / np.linalg.norm(u)
        assert np.min(vertices @ across) - 1e-6 <= force @ across <= np.max(vertices @ across) + 1e-6
    assert np.linalg.norm(sliding.polygon_slide(vertices, B, start, stop)[0]) < 1e-12


def test_a_ball_slides_by_the_balance_of_momenta_and_rolls():
    r, mu_g, A, n = 0.2, 2.0, np.array([1.5, -0.7, 0.0]), np.array([0.0, 0.0, 1.0])
    start = (A[:2], mu_g, r, np.array([1.0, -2.0, 0.0]), np.array([12.0, 5.0, -3.0]))
    rolls = sliding.ball_slide(*start, 0.0)[3]
    for t in (0.3 * rolls, 0.8 * rolls, 1.5 * rolls):
        _, v, w, _ = sliding.ball_slide(*start, t)
        force = slopes(lambda s: sliding.ball_slide(*start, s)[1], [t])[0] - A  # per mass
        turn = slopes(lambda s: sliding.ball_slide(*start, s)[2], [t])[0]
        slip = v + np.cross(w, -r * n)
        assert slopes(lambda s: sliding.ball_slide(*start, s)[0], [t])[0] == pytest.approx(v, abs=1e-9)
        assert 0.4 * r**2 * turn == pytest.approx(np.cross(-r * n, force), abs=1e-9)
        if t < rolls:
            assert force == pytest.approx(-mu_g * along(slip), abs=1e-8)
        else:
            assert np.linalg.norm(slip) < 1e-12
            assert np.linalg.norm(force) < mu_g


@pytest.mark.parametrize(("e", "mu"), [(0.5, 0.05), (0.8, 0.15), (0.7, 0.0)])
def test_a_bouncing_ball_keeps_its_momentum_about_the_contact_line(e, mu):
    """Friction acts at the contact: the momentum about it is constant along the plane; the normal motion is free."""
    r, v0, w0, n = 0.1, np.array([2.5, 0.6, 0.3]), np.array([30.0, -20.0, 5.0]), np.array([0.0, 0.0, 1.0])
    ball = lambda t: sliding.bouncing_ball(G, r, e, mu, 0.5, v0, w0, t)  # noqa: E731
    about = lambda v, w: 0.4 * r**2 * w + r * np.cross(n, v)  # noqa: E731
    down = np.sqrt(v0[2] ** 2 + 2 * G * 0.5)
    hits = [(v0[2] + down) / G]
    for k in range(1, 4):
        hits.append(hits[-1] + 2 * e**k * down / G)
    for k, hit in enumerate(hits):
        (_, v, w), (_, after, spun) = ball(hit - 1e-10), ball(hit + 1e-10)
        assert about(after, spun)[:2] == pytest.approx(about(v, w)[:2], abs=1e-12)
        assert after[2] == pytest.approx(-e * v[2], abs=1e-8)
        slip, still = ((u + np.cross(s, -r * n))[:2] for u, s in ((v, w), (after, spun)))
        J = np.linalg.norm((after - v)[:2])
        assert mu * (1 + e) * e**k * down * (1 + 1e-9) >= J
        assert np.linalg.norm(still) < 1e-12 or pytest.approx(mu * (1 + e) * e**k * down) == J
        assert still @ slip >= -1e-15
    if mu == 0.05:
        end = hits[0] + 2 * e * down / (G * (1 - e))
        (_, v, w), (p, after, spun) = ball(hits[-1] + 1e-10), ball(end + 0.1)
        assert p[2] == 0.0
        assert about(after, spun)[:2] == pytest.approx(about(v, w)[:2], abs=1e-12)
        rest = mu * ((1 + e) * e**4 * down / (1 - e) + G * 0.1)  # later impacts, and sliding for 0.1 s
        assert np.linalg.norm((after - v)[:2]) == pytest.approx(rest, rel=1e-8)


# --- one freedom ----------------------------------------------------------------------------------------------------

W, BELT = 3.0, np.sqrt(40.0)
LAWS = {
    "stopped": (lambda t: events.stopped_pendulum(W, 1.0, 0.0, -0.1, 0.7, t), lambda q, v: -(W**2) * np.sin(q), 2.0),
    "pressed": (lambda t: events.stopped_pendulum(W, 1.0, 0.0, 0.3, 0.5, t), lambda q, v: -(W**2) * np.sin(q), 1.0),
    "coasting": (
        lambda t: events.coasting_between_stops(0.5, 3.0, 0.4, 0.0, 1.0, 0.8, t),
        lambda q, v: -0.4 * np.sign(v),
        3.0,
    ),
    "dry spring": (lambda t: events.dry_oscillator(BELT, 0.02, 0.25, t), lambda q, v: -40 * q - 0.8 * np.sign(v), 2.0),
    "dry pendulum": (
        lambda t: events.dry_pendulum(4.905, 0.5, 1 / 3, 1.5, t),
        lambda q, v: -3 * (4.905 * np.sin(q) + 0.5 * np.sign(v)),
        4.0,
    ),
    "belt": (
        lambda t: events.on_belt(BELT, 0.05, 0.09, 0.5, 0.25, 0.0, t),
        lambda q, v: 0.0 if abs(v - 0.5) < 1e-9 else -40 * (q - 0.05),
        2.0,
    ),
    "bead": (lambda t: events.bead_on_rod(2.0, 0.3, 0.2, 0.5, t), lambda q, v: 4 * q - 1.2 * v, 1.0),
    "rocking": (
        lambda t: events.rocking(0.1, 0.3, G, 0.19, t),
        lambda q, v: -np.sign(q) * 0.75 * G / np.sqrt(0.1) * np.sin(np.arctan(1 / 3) - abs(q)),
        1.0,
    ),
}
"""Motion as angle and rate, its acceleration between events, and how long."""


@pytest.mark.parametrize("name", LAWS)
def test_a_motion_obeys_its_law_between_events(name):
    motion, law, end = LAWS[name]
    h, kept = 1e-4, 0
    for t in np.linspace(0.013, end, 24):
        around = np.array([motion(t + k * h) for k in range(-4, 5)])
        if np.ptp(around[:, 1]) > 20 * h * (1 + abs(law(*around[4]))) or np.ptp(np.sign(around[:, 1])):
            continue  # an event is near
        weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
        if abs(law(*around[0]) - law(*around[8])) > 0.3:
            continue
        kept += 1
        assert weights @ around == pytest.approx([around[4, 1], law(*around[4])], abs=1e-7), t
    assert kept > 12


def jump(motion, low, high):
    """Time of the one jump of the rate in an interval, by bisection, and the state on both sides."""
    for _ in range(36):
        middle = (low + high) / 2
        a, b, c = motion(low), motion(middle), motion(high)
        low, high = (low, middle) if abs(b[1] - a[1]) > abs(c[1] - b[1]) else (middle, high)
    return low, motion(low), motion(high)


@pytest.mark.parametrize(
    ("name", "low", "high", "place", "ratio"),
    [
        ("stopped", 0.55, 0.7, -0.1, -0.7),
        ("pressed", 0.3, 0.5, 0.3, -0.5),
        ("coasting", 0.16, 0.18, 1.0, -0.8),
        ("rocking", 0.315, 0.323, 0.0, 1 - 1.5 * 0.1),  # sin^2 alpha = 0.1; the sense of turning stays
    ],
)
def test_an_impact_obeys_its_law(name, low, high, place, ratio):
    _, before, after = jump(LAWS[name][0], low, high)
    assert (before[0], after[0]) == pytest.approx((place, place), abs=1e-9)
    assert after[1] / before[1] == pytest.approx(ratio, abs=1e-9)


@pytest.mark.parametrize("static", [0.05, 0.09])
def test_the_belt_carries_until_the_spring_is_longer_than_sticking_allows(static):
    motion = lambda t: events.on_belt(BELT, 0.05, static, 0.5, 0.25, 0.0, t)  # noqa: E731
    caught = next(t for t in np.arange(0.0, 1.0, 1e-3) if motion(t)[1] == 0.5)
    slips = caught + (static - motion(caught)[0]) / 0.5
    assert motion(slips - 1e-9)[1] == 0.5
    assert motion(slips + 0.05)[1] < 0.5
    assert motion(slips)[0] == pytest.approx(static, abs=1e-12)


def test_dry_friction_keeps_what_it_can():
    assert abs(events.dry_oscillator(BELT, 0.02, 0.25, 50.0)[0]) <= 0.02
    q, rate = events.dry_pendulum(4.905, 0.5, 1 / 3, 1.5, 6.0)
    assert rate == 0.0
    assert 4.905 * abs(np.sin(q)) <= 0.5


def test_a_block_on_a_shaken_table_needs_no_more_than_its_friction():
    motion = lambda t: events.on_shaken_table(0.05, 10.0, 2.943, t)  # noqa: E731
    for t in np.linspace(0.01, 1.2, 61):
        a = (motion(t + 1e-6)[1] - motion(t - 1e-6)[1]) / 2e-6
        slip = motion(t)[1] - 0.5 * np.cos(10 * t)
        assert abs(a) <= 2.943 + 1e-5
        if abs(slip) > 1e-4:
            assert a == pytest.approx(-2.943 * np.sign(slip), abs=1e-5)


def test_a_ball_on_a_bouncing_table_is_above_it_and_falls_freely():
    motion = lambda t: events.on_bouncing_table(0.02, 30.0, G, t)  # noqa: E731
    for t in np.linspace(0.001, 0.6, 101):
        a = (motion(t + 1e-7)[1] - motion(t - 1e-7)[1]) / 2e-7
        gap = motion(t)[0] - 0.02 * np.sin(30 * t)
        assert gap >= -1e-12
        assert a == pytest.approx(-G, abs=1e-4) if gap > 1e-9 else a >= -G - 1e-4


# --- bodies in the plane, by another set of equations ---------------------------------------------------------------


def test_the_ladder_by_its_equation_in_cartesian_coordinates():
    """Multipliers of floor and wall in x, z, th: ``m x'' = W``, ``m z'' = F - m g``, ``I th'' = l (W sin - F cos)``."""
    l, start = 1.0, np.pi / 3

    def forces(th, rate, wall):
        """F and W from ``z = l sin th`` and, on the wall, ``x = l cos th``."""
        s, c = np.sin(th), np.cos(th)
        # th'' = 3 (W s - F c)/l;  z'' = l (c th'' - s th'^2) = F - g;  x'' = -l (s th'' + c th'^2) = W
        M = np.array([[1 + 3 * c * c, -3 * s * c], [-3 * s * c, 1 + 3 * s * s]])
        right = np.array([G - l * s * rate**2, -l * c * rate**2])
        return np.linalg.solve(M, right) if wall else np.array([right[0] / M[0, 0], 0.0])

    def motion(wall):
        def f(t, y):
            F, W = forces(y[2], y[3], wall)
            return [y[1], W, y[3], 3 * (W * np.sin(y[2]) - F * np.cos(y[2])) / l]

        return f

    event = lambda t, y: forces(y[2], y[3], True)[1]  # noqa: E731
    event.terminal = True
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    first = solve_ivp(motion(True), (1e-9, 1), [np.cos(start), 0, start, 0], events=event, **options)
    leaves, y = first.t[-1], first.y[:, -1]
    second = solve_ivp(motion(False), (leaves, 0.65), y, **options)
    for t, (x, _, th, rate) in ((leaves, y), (0.65, second.y[:, -1])):
        found = events.ladder(l, G, start, t)
        assert found == pytest.approx((th, rate, x, l * np.sin(th)), abs=1e-8)


def test_the_ball_on_the_ball_by_momentum_balances():
    R, r, mu, start = 0.5, 0.1, 0.4, 0.1
    l = R + r
    normal = lambda th, rate: G * np.cos(th) - l * rate**2  # noqa: E731
    ball = lambda t: np.array(events.ball_off_ball(R, r, G, mu, start, t))  # noqa: E731
    for t in (0.4, 0.7, 0.79, 0.84):
        (th, rate, spin), (dth, dv, dw) = ball(t), slopes(ball, [t])[0]
        F = l * dv - G * np.sin(th)  # friction along the motion, per mass
        assert dth == pytest.approx(rate, abs=1e-7)
        assert 0.4 * r * dw == pytest.approx(-F, abs=1e-6)
        if t < 0.769:
            assert spin * r == pytest.approx(l * rate, abs=1e-12)
            assert abs(F) < mu * normal(th, rate)
        else:
            assert l * rate - r * spin > 1e-6
            assert pytest.approx(-mu * normal(th, rate), abs=1e-6) == F
    with pytest.raises(ValueError, match="flies"):
        ball(0.86)


# --- collisions and piecewise uniform motion ------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.1, 0.8])
def test_rough_spheres_keep_momenta_and_obey_restitution_and_cone(mu):
    rng = np.random.default_rng(4)
    m, r, inertia, n = np.array([1.2, 2.5]), np.array([0.2, 0.3]), np.array([0.02, 0.1]), along(rng.normal(size=3))
    v, w = rng.normal(size=(2, 3)), 3 * rng.normal(size=(2, 3))
    v[0] -= 4 * n
    after, spun = collisions.rough_spheres(m, r, inertia, 0.7, mu, v, w, n)
    centers = np.array([r[0] * n, -r[1] * n])  # about the contact point
    total = lambda v, w: (m @ v, (m[:, None] * np.cross(centers, v) + inertia[:, None] * w).sum(axis=0))  # noqa: E731
    relative = lambda v, w: v[0] + np.cross(w[0], -r[0] * n) - v[1] - np.cross(w[1], r[1] * n)  # noqa: E731
    for old, new in zip(total(v, w), total(after, spun), strict=True):
        assert new == pytest.approx(old, abs=1e-12)
    own = inertia[0] * (spun - w)[0] + m[0] * np.cross(centers[0], (after - v)[0])
    assert own == pytest.approx(np.zeros(3), abs=1e-12)
    u, left = relative(v, w), relative(after, spun)
    assert left @ n == pytest.approx(-0.7 * (u @ n))
    J = m[0] * (after - v)[0]
    slip, still = u - (u @ n) * n, left - (left @ n) * n
    push = J - (J @ n) * n
    assert np.linalg.norm(push) <= mu * (J @ n) * (1 + 1e-12)
    assert np.cross(push, slip) == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.linalg.norm(still) < 1e-12 or np.linalg.norm(push) == pytest.approx(mu * (J @ n))


def test_balls_in_line_keep_momentum_and_their_law():
    for n in (3, 5):
        for e in (1.0, 0.5):
            v = collisions.balls_in_line([1.0] * n, [0.0] * (n - 1), e, 1.0, 1.0)[1]
            assert v == pytest.approx([(1 - (n - 1) * e) / n, *[(1 + e) / n] * (n - 1)])
    m, e = np.array([1.0, 2.0, 3.0, 0.5]), 0.9
    gaps = np.array([0.1, 0.02, 0.03])
    v, x = np.eye(4)[0], np.zeros(4)
    for k, t in ((0, 0.1), (1, None), (2, None)):  # the order in which the gaps close
        dt = t or (gaps[k] + x[k + 1] - x[k]) / (v[k] - v[k + 1])
        x = x + v * dt
        assert np.all(gaps + np.diff(x) > -1e-12)
        both, common = m[k] + m[k + 1], m[k : k + 2] @ v[k : k + 2]
        v[k : k + 2] = (common + np.array([-m[k + 1], m[k]]) * e * (v[k] - v[k + 1])) / both
    assert collisions.balls_in_line(m, gaps, e, 1.0, 1.0)[1] == pytest.approx(v)


def test_pulled_boxes_obey_newtons_law_with_their_friction():
    pulled = lambda t: collisions.pulled_boxes([3.0, 1.0], [0.2, 0.35], G, 5.0, t)  # noqa: E731
    for t in (1.0, 2.0, 4.0, 5.0):
        x, v = slopes(lambda s: pulled(s)[0], [t])[0], slopes(lambda s: pulled(s)[1], [t])[0]
        assert x == pytest.approx(pulled(t)[1], abs=1e-8)
        between, floor = v[1], 5.0 * t - 3.0 * v[0] - v[1]
        if t == 1.0:
            assert np.all(v == 0.0)
            assert floor <= 0.2 * 4 * G
        else:
            assert floor == pytest.approx(0.2 * 4 * G, abs=1e-7)
            assert between <= 0.35 * G + 1e-9
            assert pulled(t)[1][0] == pulled(t)[1][1] or between == pytest.approx(0.35 * G, abs=1e-7)


@pytest.mark.parametrize("mu", [0.5, 0.05])
def test_the_ball_in_the_trough_obeys_both_momenta(mu):
    slope, half, r = 0.4, 0.7, 0.1
    a, turn = collisions.ball_in_trough(slope, half, r, G, mu)
    friction = G * np.sin(slope) - a  # of both walls, along, per mass
    N = G * np.cos(slope) / np.cos(half)  # of both walls
    assert 0.4 * r**2 * turn == pytest.approx(friction * r * np.cos(half))
    slip = a - turn * r * np.cos(half)
    assert friction <= mu * N + 1e-12
    assert abs(slip) < 1e-12 or (slip > 0 and friction == pytest.approx(mu * N))


def test_the_spin_in_the_corner_balances():
    m, r, mu = 1.5, 0.2, 0.3
    turned, _ = collisions.spin_in_corner(m, r, G, mu, -30.0, 5.0)
    N = m * G / (1 + mu**2)
    assert N + mu * (mu * N) == pytest.approx(m * G)  # the wall, pressed by the friction of the floor, carries the rest
    work = (mu * N + mu * mu * N) * r * abs(turned)
    assert work == pytest.approx(0.2 * m * r**2 * 30.0**2)


def test_the_disc_at_rest_by_eulers_equation():
    """With the centre at rest ``dL/dt = r x N``; the contact point does not slip."""
    r, tilt = 0.1, np.radians(30)
    precession, spin = collisions.disc_at_rest(r, G, tilt)
    n = np.array([0.0, 0.0, 1.0])

    def axis(t):
        return np.array([np.sin(tilt) * np.cos(precession * t), np.sin(tilt) * np.sin(precession * t), np.cos(tilt)])

    def momentum(t):
        w = precession * n + spin * axis(t)
        return r**2 / 4 * (w + (w @ axis(t)) * axis(t))

    a = axis(0.3)
    lowest = -r * along(n - (n @ a) * a)
    assert slopes(momentum, [0.3])[0] == pytest.approx(np.cross(lowest, G * n), abs=1e-8)
    assert np.cross(precession * n + spin * a, lowest) == pytest.approx(np.zeros(3), abs=1e-12)


def test_the_crank_keeps_its_energy_but_for_the_stop():
    data = (0.1, 0.3, [1.0, 0.6, 0.5], [0.001, 0.0045], np.pi / 2, -10.0, 0.39, 0.6)
    crank = lambda t: collisions.slider_crank_with_stop(*data, t)  # noqa: E731

    def points(t):
        q = crank(t)[0]
        pin = 0.1 * np.array([np.cos(q), np.sin(q)])
        slider = np.array([pin[0] + np.sqrt(0.09 - pin[1] ** 2), 0.0])
        return np.array([pin / 2, (pin + slider) / 2, slider, [q, np.arcsin(pin[1] / 0.3)]])

    def energy(t):
        v = slopes(points, [t], 1e-5)[0]
        return (v[:3] ** 2).sum(axis=1) @ [1.0, 0.6, 0.5] / 2 + v[3] ** 2 @ [0.001, 0.0045] / 2

    start = energy(1e-3)
    assert energy(0.08) == pytest.approx(start, rel=1e-8)
    assert energy(0.3) == pytest.approx(0.36 * start, rel=1e-8)
    assert energy(0.7) == pytest.approx(0.36 * start, rel=1e-8)
    hit, before, after = jump(crank, 0.1, 0.12)
    assert points(hit)[2, 0] == pytest.approx(0.39, abs=1e-9)
    assert after[1] / before[1] == pytest.approx(-0.6, abs=1e-9)


@pytest.mark.parametrize("slip", [0.5, -0.2])
def test_the_rod_hits_the_floor_by_marching_the_normal_impulse(slip):
    """Routh: friction opposes the slip of each instant; the impulse of expansion is e times that of compression."""
    half, mu, e, angle = 1.0, 0.3, 0.5, np.pi / 4
    M = np.linalg.inv(np.diag([1.0, 1.0, half**2 / 3]))
    J = np.array([[1.0, 0.0, half * np.sin(angle)], [0.0, 1.0, half * np.cos(angle)]])  # x, z, turn counter-clockwise
    G, u, p, dN, compressed = J @ M @ J.T, np.array([slip, -1.0]), np.zeros(2), 1e-5, None
    while compressed is None or p[1] < (1 + e) * compressed:
        dp = np.array([-mu * np.sign(u[0]), 1.0]) * dN
        u, p = u + G @ dp, p + dp
        compressed = p[1] if compressed is None and u[1] >= 0 else compressed
    found = collisions.rod_impact(half, 1.0, angle, mu, e, (slip, -1.0), "poisson")
    assert found == pytest.approx(p, abs=3e-5)
    F, N = collisions.rod_impact(half, 1.0, angle, mu, e, (slip, -1.0), "newton")
    after = np.array([slip, -1.0]) + G @ [F, N]
    assert after[1] == pytest.approx(e)
    assert after[0] > 0
    assert (pytest.approx(-mu * N) if slip > 0 else 0.0) == F


def test_the_ball_on_the_spring_obeys_its_law_and_keeps_its_energy():
    ball = lambda t: np.array(collisions.ball_on_spring(1.3, G, 2e4, 0.1, t))  # noqa: E731
    for t in np.linspace(0.01, 0.9, 33):
        z, v = ball(t)
        assert G * z + v * v / 2 + 2e4 / 1.3 * min(z, 0.0) ** 2 / 2 == pytest.approx(0.1 * G)
        assert slopes(ball, [t], 1e-6)[0][0] == pytest.approx(v, abs=1e-5)
    assert min(ball(t)[0] for t in np.linspace(0.1, 0.2, 50)) < -5e-3
