"""Contact that lasts, against closed forms: sliding, rolling, cones, stops, dry friction, accumulated bounces.

All motions are in a world turned by `TURN`, of bodies whose origins are off their centres of mass; vectors in the tests
have the axes x, y in the plane of contact and z along its normal. Times and places follow from elementary mechanics or,
where the docstring says so, from quadratures of one variable to more digits than are printed.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from consilience.case import load_case
from consilience.case.families import family_table
from consilience.case.file.reader import cases_from_tables
from consilience.compare.energies import energies_over_time
from consilience.errors import NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    CapsulePlane,
    Cone,
    DryFriction,
    Frame,
    Function,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    Stop,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from consilience.reference.contact import contact_instant, simulate_with_contacts, solve_impact
from mechanisms import rotation

TURN = rotation(np.random.default_rng(35))
OFF = np.array([0.03, -0.02, 0.05])
"""Centre of mass of every free body from its origin."""

STATE, TIME, BOUNCES = 1e-10, 1e-11, 1e-9
G, ZERO, (X, Y, Z) = 9.81, np.zeros(3), np.eye(3)
HOME = Frame(ZERO, np.eye(3))


def about_y(angle):
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def body(name, mass, moments):
    return Body(name, mass, OFF, np.diag(moments), HOME)


def floating(bodies, contacts, gravity=-G * Z, loads=()):
    joints = tuple(Joint(f"free {b.name}", "free", GROUND, b.name, HOME, HOME) for b in bodies)
    return Mechanism("floating", TURN @ gravity, tuple(bodies), joints, contacts=tuple(contacts), loads=loads)


def state(p, v=None, w=None, R=None):
    """Return a state from the motions of centres of mass."""
    p = np.array(p, dtype=float)
    v, w = (np.zeros(p.shape) if a is None else np.array(a, dtype=float) for a in (v, w))
    A = TURN @ (np.tile(np.eye(3), (len(p), 1, 1)) if R is None else np.array(R))
    w = w @ TURN.T
    return State(p @ TURN.T - A @ OFF, quaternion_from_rotation(A), v @ TURN.T - np.cross(w, A @ OFF), w)


def centre(answer, sample, b=0):
    """Position and velocity of a centre of mass, and angular velocity, along x, y, z."""
    s = answer.state(sample)
    arm = s.R_WB[b] @ OFF
    velocity = s.v_WB_W[b] + np.cross(s.w_WB_W[b], arm)
    return (s.p_WB[b] + arm) @ TURN, velocity @ TURN, s.w_WB_W[b] @ TURN


def on_plane(name, corner, mu, b="b", **law):
    return PointPlane(name, b, OFF + corner, GROUND, ZERO, TURN @ Z, friction=mu, **law)


def ball(mass, radius):
    return body("b", mass, [0.4 * mass * radius**2] * 3)


def rolls_on(radius, mu, normal=Z, name="c", **law):
    return SpherePlane(name, "b", OFF, radius, GROUND, ZERO, TURN @ normal, friction=mu, **law)


def tripod(mu, gravity=-G * Z, moments=(0.05, 0.06, 0.07), loads=(), **law):
    """Body of 2 kg on three feet, its centre of mass 0.1 m above them."""
    angles = 2 * np.pi * np.arange(3) / 3
    feet = [on_plane(f"foot {n}", [0.3 * np.cos(a), 0.3 * np.sin(a), -0.1], mu, **law) for n, a in enumerate(angles)]
    return floating([body("b", 2.0, moments)], feet, gravity, loads)


def down(angle):
    """Gravity on an incline, x down the slope."""
    return G * np.array([np.sin(angle), 0.0, -np.cos(angle)])


def run(mechanism, start, *times, tolerance=1e-13):
    return simulate_with_contacts(mechanism, start, np.array([0.0, *times]), tolerance)


def when(events, kind, n=0, name=""):
    return [e.time for e in events if e.kind == kind and name in e.name][n]


def close(found, expected, bar=STATE):
    np.testing.assert_allclose(found, expected, rtol=0, atol=bar)


# --- blocks ---------------------------------------------------------------------------------------------------------

SLOPE = np.radians(20.0)


@pytest.mark.parametrize("speed", [3.0, -3.0])
def test_a_block_that_slides_on_an_incline_stops_where_friction_has_used_its_energy(speed):
    mu = 0.5
    slowing = G * (mu * np.cos(SLOPE) - np.sign(speed) * np.sin(SLOPE))
    stop = abs(speed) / slowing
    answer, events = run(tripod(mu, down(SLOPE)), state([0.1 * Z], [speed * X]), stop + 0.7)
    assert [e.kind for e in events] == ["sticks"] * 3
    close([e.time for e in events], stop, TIME)
    p, v, w = centre(answer, 1)
    close([*p, *v, *w], [speed * stop / 2, 0, 0.1, *np.zeros(6)])
    assert answer.contact_mode.tolist() == [[1, 1, 1], [2, 2, 2]]
    lost = 2.0 * (speed**2 / 2 + G * np.sin(SLOPE) * speed * stop / 2)
    assert abs(answer.contact_loss[1] - lost) < STATE
    impulse = -2.0 * down(SLOPE) * (stop + 0.7) - 2.0 * speed * X
    close(np.sum(answer.contact_impulse[1], axis=0) @ TURN, impulse)


def test_a_block_that_slides_up_a_slope_of_little_friction_turns_and_slides_back():
    answer, _ = run(tripod(0.25, down(SLOPE)), state([0.1 * Z], [-3 * X]), 2.0)
    turn = 3 / (G * (np.sin(SLOPE) + 0.25 * np.cos(SLOPE)))
    back = G * (np.sin(SLOPE) - 0.25 * np.cos(SLOPE))
    p, v, _ = centre(answer, 1)
    close([p[0], v[0]], [-1.5 * turn + back * (2 - turn) ** 2 / 2, back * (2 - turn)])


def test_a_block_thrown_across_an_incline_stops_by_its_hodograph():
    """Speed over heading: |u| = U sin th0 / sin th (tan(th/2) / tan(th0/2))^kappa, kappa = mu / tan slope > 1."""
    th0 = np.radians(110)
    mechanism, start = tripod(0.5, down(SLOPE)), state([0.1 * Z], [[2 * np.cos(th0), 2 * np.sin(th0), 0]])
    kappa = 0.5 / np.tan(SLOPE)
    stop = 2 * (kappa + np.cos(th0)) / (G * np.sin(SLOPE) * (kappa**2 - 1))
    answer, events = run(mechanism, start, 1.0)
    close(when(events, "sticks"), stop, TIME)
    close(centre(answer, 1)[0], [0.0595594518147915, 0.411502204528544, 0.1])  # quadrature of the hodograph


C30, S30 = np.cos(np.pi / 6), np.sin(np.pi / 6)


@pytest.mark.parametrize(
    ("cone", "stop", "place"),
    [
        (Cone(), 3 / (0.4 * G), np.array([C30, S30]) * 9 / (0.8 * G)),
        (Cone("pyramid", tangent=tuple(TURN @ X)), 1.04436192949881, (1.14678899082569, 0.993148398835365)),
        (Cone("box", tangent=tuple(TURN @ X)), 3 * C30 / (0.4 * G), (9 * C30**2 / (0.8 * G), 9 * S30**2 / (0.8 * G))),
        (Cone("pyramid", 8, tangent=tuple(TURN @ X)), 0.820437450283629, (1.10771310354251, 0.514091440463333)),
    ],
    ids=["circle", "diamond", "box", "octagon"],
)
def test_a_block_that_slides_askew_stops_where_its_friction_cone_says(cone, stop, place):
    """Pyramids: the vertex nearest to the heading brakes, until the heading is on a bisector: then along it."""
    answer, events = run(tripod(0.4, cone=cone), state([0.1 * Z], [[3 * C30, 3 * S30, 0]]), 1.2)
    close(when(events, "sticks"), stop, TIME)
    close(centre(answer, 1)[0], [*place, 0.1])


@pytest.mark.parametrize(
    ("cone", "start"),
    [(Cone(), 1.962), (Cone("pyramid", tangent=tuple(TURN @ X)), 1.962 / (C30 + S30))],
    ids=["circle", "diamond"],
)
def test_a_block_under_a_growing_push_breaks_away_at_the_boundary_of_its_cone(cone, start):
    push = Load("push", "force", "b", TURN @ [C30, S30, 0], "world", OFF - 0.1 * Z, Function([0.0, 4.0]))
    answer, events = run(tripod(0.4, loads=(push,), cone=cone), state([0.1 * Z]), 3.0)
    close(when(events, "slips"), start, TIME)
    if cone.kind == "circle":
        t = 3.0 - start
        gone = (4 * (start * t**2 / 2 + t**3 / 6) - 0.4 * 2 * G * t**2 / 2) / 2
        close(centre(answer, 1)[0], [gone * C30, gone * S30, 0.1])


def test_a_tripod_that_slides_and_spins_follows_its_equations_of_motion():
    """Independent integration of planar equations: three feet, loads from three balances."""
    answer, _ = run(tripod(0.35, moments=(0.02, 0.02, 0.04)), state([0.1 * Z], [[1.2, 0.3, 0]], [8 * Z]), 0.1, 0.3)
    close(centre(answer, 1)[0][:2], [0.113692456631494, 0.0295610828271143])
    p, v, w = centre(answer, 2)
    close(
        [*p[:2], *v[:2], w[2]],
        [0.268932909539885, 0.0683292593686934, 0.465206877057222, 0.104016199456826, 0.300541242906497],
    )


# --- balls ----------------------------------------------------------------------------------------------------------


def test_a_bowling_ball_slips_along_a_parabola_until_it_rolls_and_keeps_its_spin_about_the_normal():
    r, mu, v0, w0 = 0.11, 0.2, np.array([3.0, 1.0, 0.0]), np.array([25.0, 10.0, 40.0])
    u0 = v0 + np.cross(w0, -r * Z)
    speed = np.linalg.norm(u0)
    t = 2 * speed / (7 * mu * G)
    answer, events = run(floating([ball(1.0, r)], [rolls_on(r, mu)]), state([r * Z], [v0], [w0]), 2.0)
    close(when(events, "sticks"), t, TIME)
    end = v0 - 2 * u0 / 7
    p, v, w = centre(answer, 1)
    close(p, v0 * t - mu * G * u0 / speed * t**2 / 2 + end * (2 - t) + r * Z)
    close([*v, *w], [*end, -end[1] / r, end[0] / r, 40.0])
    assert abs(answer.contact_loss[1] - speed**2 / 7) < STATE


@pytest.mark.parametrize("mu", [0.17, 0.16])
def test_a_ball_on_an_incline_rolls_above_two_sevenths_of_the_slope_and_slides_below(mu):
    slope, r = np.radians(30), 0.1
    answer, _ = run(floating([ball(1.0, r)], [rolls_on(r, mu)], down(slope)), state([r * Z]), 1.0)
    rolls = mu > 2 / 7 * np.tan(slope)
    slip = G * (np.sin(slope) - mu * np.cos(slope))
    p, _, w = centre(answer, 1)
    close(p[0], 5 / 14 * G * np.sin(slope) if rolls else slip / 2)
    close(w[1], 5 / 7 * G * np.sin(slope) / r if rolls else 2.5 * mu * G * np.cos(slope) / r)


def test_a_ball_that_bounces_and_slips_infinitely_often_rolls_in_the_end():
    r, e, mu, v0, w0 = 0.1, 0.5, 0.05, np.array([2.5, 0.6, 0.0]), np.array([30.0, -20.0, 5.0])
    first = np.sqrt(2 * 0.5 / G)
    end = first * (1 + e) / (1 - e)
    u0 = v0 + np.cross(w0, -r * Z)
    d, total = u0 / np.linalg.norm(u0), G * first * (1 + e) / (1 - e)  # of all impacts, per mass
    v1 = v0 - mu * total * d
    slip = np.linalg.norm(u0) - 3.5 * mu * total
    roll = end + 2 * slip / (7 * mu * G)
    mechanism = floating([ball(1.0, r)], [rolls_on(r, mu, restitution=e)])
    answer, events = run(mechanism, state([(r + 0.5) * Z], [v0], [w0]), end, roll + 0.1)
    close([when(events, "bounces end"), when(events, "sticks")], [end, roll], BOUNCES)
    close(centre(answer, 1)[1], v1, BOUNCES)
    close(centre(answer, 2)[1], v0 - 2 * u0 / 7, BOUNCES)
    close(answer.contact_impulse[1:, 0] @ TURN[:, 2], [G * end, G * (roll + 0.1 - end)], BOUNCES)


def test_a_ball_in_a_trough_rolls_though_its_forces_are_not_determined():
    slope, r, s = np.radians(20), 0.1, np.sqrt(0.5)
    walls = [rolls_on(r, 0.5, np.array([0, y, s]), name) for name, y in (("left", s), ("right", -s))]
    mechanism = floating([ball(2.0, r)], walls, down(slope))
    answer, events = run(mechanism, state([r / s * Z]), 1.0)
    a = G * np.sin(slope) / (1 + 0.4 / 0.5)
    assert not events
    close(centre(answer, 1)[0], [a / 2, 0, r / s])
    close(np.sum(answer.contact_impulse[1], axis=0) @ TURN, 2 * (a * X - down(slope)))


def test_a_ball_that_spins_in_a_corner_presses_itself_against_the_wall():
    r, mu, w0 = 0.2, 0.3, 30.0
    contacts = [rolls_on(r, mu, Z, "floor"), rolls_on(r, mu, X, "wall")]
    N = 1.5 * G / (1 + mu**2)
    slowing = mu * N * (1 + mu) * r / (0.4 * 1.5 * r**2)
    answer, events = run(floating([ball(1.5, r)], contacts), state([[r, 0, r]], None, [-w0 * Y]), 0.3, 1.0)
    close(when(events, "sticks"), w0 / slowing, TIME)
    close(answer.contact_impulse[1, 0] @ TURN, 0.3 * N * np.array([-mu, 0, 1]))
    close(centre(answer, 2)[0], [r, 0, r])


def test_a_ball_that_rolls_off_a_ball_slips_and_leaves_where_quadratures_say():
    on_ball = SphereSphere("c", "b", OFF, 0.1, GROUND, ZERO, 0.5, friction=0.4)
    start = 0.6 * np.array([np.sin(0.1), 0, np.cos(0.1)])
    answer, events = run(floating([ball(1.0, 0.1)], [on_ball]), state([start]), 0.76921516375589, 0.9)
    close([when(events, "slips"), when(events, "opens")], [0.76921516375589, 0.855736946074596], TIME)
    p, _, _ = centre(answer, 1)
    close(np.arctan2(p[0], p[2]), 0.688531342069622)
    close(centre(answer, 2)[2][1], 15.8555057063817, 2e-10)  # the printed value has twelve digits


# --- rods, stacks, rocking ------------------------------------------------------------------------------------------


def test_a_ladder_leaves_its_smooth_wall_at_two_thirds_of_its_height():
    rod, up = body("b", 1.0, [1e-3, 1 / 3, 1 / 3]), np.radians(60)
    foot, top = on_plane("foot", -X, 0.0), PointPlane("top", "b", OFF + X, GROUND, ZERO, TURN @ X)
    along = np.array([-np.cos(up), 0, np.sin(up)])
    start = state([[np.cos(up), 0, np.sin(up)]], R=[about_y(np.arctan2(-along[2], along[0]))])
    answer, events = run(floating([rod], [foot, top]), start, 0.6)
    assert [e.kind for e in events] == ["opens"]
    close(events[0].time, 0.459662826377381, TIME)  # quadrature
    rate = -np.sqrt(1.5 * G * np.sin(up) / 3)  # height down by a third
    close(centre(answer, 1)[1][0], -rate * 2 / 3 * np.sin(up))


@pytest.mark.parametrize(
    ("law", "impulse"), [("newton", 0.6), ("moreau", 0.731707317073171), ("poisson", 0.673170731707)]
)
def test_a_slip_that_reverses_shows_the_law_of_impact_of_the_contact(law, impulse):
    """Rod at 45 degrees that hits with its tip, e 0.5, mu 0.3: normal impulses by hand, on 1 kg and without gravity."""
    tip = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
    rod = body("b", 1.0, [1e-3, 1 / 3, 1 / 3])
    contact = on_plane("tip", X, 0.3, restitution=0.5, impact_law=law)
    start = state([0.1 * Z - tip], [[-0.2, 0.0, -1.0]], R=[about_y(np.pi / 4)])
    answer, events = run(floating([rod], [contact], gravity=ZERO), start, 0.15)
    assert [e.kind for e in events] == ["impact"]
    close(events[0].time, 0.1, TIME)
    close(centre(answer, 1)[1][2], impulse - 1.0)


@pytest.mark.parametrize("kind", ["box", "pyramid"])
def test_an_impact_that_loses_energy_passes_though_its_friction_adds_some(kind):
    """The rod above, faster: N = 1.5/2.05 by hand, and the slip reverses from -0.4 to less, so that friction adds."""
    tip = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
    rod, along = body("b", 1.0, [1e-3, 1 / 3, 1 / 3]), tuple(TURN @ X)
    contact = on_plane("tip", X, 0.3, restitution=0.5, cone=Cone(kind, tangent=along))
    start = state([0.1 * Z - tip], [[-0.4, 0.0, -1.0]], R=[about_y(np.pi / 4)])
    answer, _ = run(floating([rod], [contact], gravity=ZERO), start, 0.15)
    N = 1.5 / 2.05
    _, v, w = centre(answer, 1)
    close(v, [-0.4 - 0.3 * N, 0.0, N - 1.0])
    close(w, np.cross(tip, [-0.3 * N, 0.0, N]) * 3.0)
    close(answer.contact_loss[1], 0.5 * (1.16 - v @ v - w @ w / 3.0))


@pytest.mark.parametrize("law", [{}, {"static_friction": 0.6}, {"torsional": 0.02, "rolling": 0.01}])
def test_bodies_that_touch_and_fall_together_fall_freely(law):
    """Nothing presses: what the contact has to decide is rounding."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        turns, n, places = [rotation(rng), rotation(rng)], rotation(rng)[:, 0], rng.normal(size=(2, 3))
        at = 0.2 * rng.normal(size=3)  # centre of a sphere, from the centre of mass of the first body
        touched = turns[1].T @ (places[0] + turns[0] @ at - 0.1 * n - places[1])
        contact = SpherePlane("c", "a", OFF + at, 0.1, "b", OFF + touched, turns[1].T @ n, friction=0.4, **law)
        pair = floating([body("a", 1.1, (0.05, 0.06, 0.07)), body("b", 2.3, (0.08, 0.05, 0.06))], [contact])
        v = rng.normal(size=3)
        answer, _ = run(pair, state(places, [v, v], R=turns), 0.25, 0.5)
        for sample, t in ((1, 0.25), (2, 0.5)):
            for b in (0, 1):
                close(centre(answer, sample, b)[0], places[b] + t * v - [0.0, 0.0, 0.5 * G * t**2])


def test_a_rocking_block_loses_its_rate_by_a_constant_ratio_at_each_impact():
    """Housner: times by quadrature of the pendulum equation of each half period."""
    alpha, m = np.arctan2(0.1, 0.3), 2.0
    block = body("b", m, [m / 12 * 0.4] * 3)
    corners = [on_plane(name, [x, 0, -0.3], 1.0) for name, x in (("left", -0.1), ("right", 0.1))]
    tilt = about_y(0.6 * alpha)
    start = state([0.1 * X - tilt @ [0.1, 0, -0.3]], R=[tilt])
    answer, events = run(floating([block], corners), start, 0.3, 0.34, 0.9)
    close([when(events, "impact", n) for n in (0, 1)], [0.325571861264741, 0.76063220538894], TIME)
    assert [e.kind for e in events] == ["impact", "opens"] * 2
    ratio = 1 - 1.5 * np.sin(alpha) ** 2
    energy = answer.contact_loss[1:]
    before = 0.5 * m * 4 / 3 * 0.1 * 1.41529774120317**2  # about a corner, just before the first impact
    close(energy, [0, before * (1 - ratio**2), before * (1 - ratio**4)], 1e-9)


def test_the_upper_of_two_boxes_slips_when_the_lower_one_is_pulled_hard_enough():
    low, up = body("low", 3.0, [0.05] * 3), body("up", 1.0, [0.02] * 3)
    start = state([0.1 * Z, 0.3 * Z])
    along = np.column_stack([Y, Z, X])
    rail = Joint("rail", "prismatic", GROUND, "low", Frame(start.p_WB[0], TURN @ along), Frame(ZERO, along))
    free = Joint("free", "free", GROUND, "up", HOME, HOME)
    feet = tuple(
        PointPlane(f"up {n}", "up", OFF + np.array([x, y, -0.1]), "low", OFF + 0.1 * Z, Z, friction=0.35)
        for n, (x, y) in enumerate(((0.1, 0), (-0.1, 0.1), (-0.1, -0.1)))
    )
    pull = Load("pull", "force", "low", TURN @ X, "world", OFF, Function([0.0, 5.0]))
    ground = DryFriction("low", "rail", "distance", bound=0.2 * 4 * G)
    mechanism = Mechanism(
        "boxes", -G * TURN @ Z, (low, up), (rail, free), contacts=feet, loads=(pull,), dry_frictions=(ground,)
    )
    answer, events = run(mechanism, start, 4.6)
    both, upper = 0.2 * 4 * G / 5, (0.35 + 0.2) * 4 * G / 5
    close([when(events, "slips", name="low"), when(events, "slips", name="up")], [both, upper], TIME)
    together = 5 / 4 * (upper - both) ** 2 / 2
    close(centre(answer, 1, 1)[1], (together + 0.35 * G * (4.6 - upper)) * X)


@pytest.mark.parametrize(
    ("mu", "slips", "tip"), [(0.3, 0.354921133381657, 0.0294390990842267), (0.5, 0.582512839658347, 0.0437181044606162)]
)
def test_a_falling_rod_slips_and_lands_where_independent_equations_say(mu, slips, tip):
    flat = {0.3: 0.73081327519658, 0.5: 0.736690808785787}[mu]
    rod = body("b", 1.0, [1e-4, 1 / 12, 1 / 12])
    start = state([0.5 * np.array([np.sin(0.2), 0, np.cos(0.2)])], R=[about_y(0.2 - np.pi / 2)])
    ends = [on_plane("tip", -0.5 * X, mu), on_plane("top", 0.5 * X, 0.0)]
    answer, events = run(floating([rod], ends), start, flat + 1e-3)
    close([when(events, "slips"), when(events, "impact")], [slips, flat], TIME)
    p, v, _ = centre(answer, 1)
    close(p[0] - 0.5 - 1e-3 * v[0], tip, 1e-5)


# --- joints ---------------------------------------------------------------------------------------------------------


def hinge(moment, stops=(), friction=(), angle=0.0, rate=0.0, arm=0.0, gravity=ZERO, mass=1.0):
    """Body on a revolute joint about y, its centre of mass at `arm` along x, and its state."""
    b = Body("b", mass, arm * X, np.diag([0.01, moment, moment]), HOME)
    pin = np.column_stack([Z, X, Y])
    joint = Joint("j", "revolute", GROUND, "b", Frame(ZERO, TURN @ pin), Frame(ZERO, pin))
    A = TURN @ about_y(angle)
    start = State(np.zeros((1, 3)), quaternion_from_rotation(A[None]), np.zeros((1, 3)), rate * (TURN @ Y)[None])
    mechanism = Mechanism("hinge", TURN @ gravity, (b,), (joint,), stops=tuple(stops), dry_frictions=tuple(friction))
    return mechanism, start


def angle_of(answer, sample):
    A = TURN.T @ rotation_from_quaternion(answer.quat_WB[sample, 0])
    return np.arctan2(A[0, 2], A[0, 0])


@pytest.mark.parametrize("arm", [0.0, 1e-10], ids=["on the axis", "as good as on it"])
def test_a_hinge_with_dry_friction_bounces_between_its_stops_until_it_sticks(arm):
    """The arm is the only length of the mechanism: a gap in rad does not close to a fraction of it."""
    I, C, e = 0.5, 0.2, 0.8
    mechanism, start = hinge(
        I, [Stop("s", "j", "angle", 0.0, 1.0, e)], [DryFriction("d", "j", "angle", bound=C)], 0.5, 3.0, arm
    )
    t, q, w, impacts = 0.0, 0.5, 3.0, []
    slowing = C / I
    while w**2 > 2 * slowing * (1 - q if w > 0 else q):
        way = 1 - q if w > 0 else q
        after = np.sqrt(w**2 - 2 * slowing * way)
        t += (abs(w) - after) / slowing
        q, w = (1.0, -e * after) if w > 0 else (0.0, e * after)
        impacts.append(t)
    answer, events = run(mechanism, start, 5.0)
    close([x.time for x in events if x.kind == "impact"], impacts, TIME)
    close(when(events, "sticks"), t + abs(w) / slowing, TIME)
    close(angle_of(answer, 1), q + np.sign(w) * w**2 / (2 * slowing))


def test_a_pendulum_pressed_on_its_stop_comes_to_rest_after_infinitely_many_bounces():
    stop = Stop("s", "j", "angle", 0.3, None, 0.5)
    mechanism, start = hinge(1 / 12, [stop], angle=1.0, arm=0.5, gravity=G * X)
    answer, events = run(mechanism, start, 1.7)
    close([when(events, "impact", n) for n in (0, 3)], [0.35370093125674, 1.42164441413941], TIME)  # elliptic integrals
    close(when(events, "bounces end"), 1.62123620515096, BOUNCES)
    close(angle_of(answer, 1), 0.3, BOUNCES)


def test_a_pendulum_with_dry_friction_turns_where_its_energy_says_and_rests():
    """cos a' - cos a = (C / P) (a + a'); times by quadrature."""
    mechanism, start = hinge(
        1 / 12, friction=[DryFriction("d", "j", "angle", bound=0.5)], angle=1.5, arm=0.5, gravity=G * X
    )
    answer, events = run(mechanism, start, 6.0)
    turns, angle, share = [], 1.5, 0.5 / (0.5 * G)
    while not turns or share < np.sin(turns[-1]):  # gravity beats the friction: the pendulum swings back
        angle = brentq(lambda x, a=angle: np.cos(x) - np.cos(a) - share * (a + x), 0.0, angle)
        turns.append(angle)
    assert [e.kind for e in events] == [*["slips"] * (len(turns) - 1), "sticks"]
    close(turns[-1], 0.0994902036052787)
    close(events[-1].time, 5.1743414539097, TIME)
    close(angle_of(answer, 1), turns[-1])


def test_a_slider_on_a_spring_with_dry_friction_rests_within_its_dead_band():
    along = Frame(ZERO, np.column_stack([Y, Z, X]))
    joint = Joint("j", "prismatic", GROUND, "b", Frame(ZERO, TURN @ along.R), along)
    spring, friction = JointSpring("k", "j", "distance", 50.0, 0.0, 0.0), DryFriction("d", "j", "distance", bound=0.981)
    mechanism = Mechanism(
        "slider",
        ZERO,
        (Body("b", 1.0, ZERO, np.eye(3), HOME),),
        (joint,),
        joint_springs=(spring,),
        dry_frictions=(friction,),
    )
    start = State((0.25 * TURN @ X)[None], quaternion_from_rotation(TURN[None]), np.zeros((1, 3)), np.zeros((1, 3)))
    answer, events = run(mechanism, start, 3.0)
    close(when(events, "sticks"), 6 * np.pi / np.sqrt(50.0), TIME)  # each half period loses twice the dead band
    close(answer.p_WB[1, 0] @ TURN, [0.25 - 12 * 0.981 / 50, 0, 0])


# --- instants -------------------------------------------------------------------------------------------------------


def test_a_tall_box_tips_about_its_lower_edge():
    slope, m = np.radians(25), 2.0
    box = body("b", m, [m / 12 * 0.4, m / 12 * 0.4, m / 12 * 0.08])
    corners = [on_plane(f"{x}{y}", [0.1 * x, 0.1 * y, -0.3], 0.6) for x in (-1, 1) for y in (-1, 1)]
    found = contact_instant(floating([box], corners, down(slope)), [state([0.3 * Z])])
    turn = G * (0.3 * np.sin(slope) - 0.1 * np.cos(slope)) / (0.4 / 12 + 0.1)
    close(found.alpha_WB_W[0, 0] @ TURN, turn * Y)
    force = np.sum(found.contact_force[0], axis=0) @ TURN
    close(force, m * (np.array([0.3 * turn, 0, 0.1 * turn]) - down(slope)))
    close(found.contact_force[0, :2], 0.0)


@pytest.mark.parametrize(("angle", "w", "what"), [(0.9, 0.0, "Painleve|no modes"), (1.1, 4.0, "several|not unique")])
def test_a_slender_rod_in_painleves_states_has_no_or_two_solutions_and_says_so(angle, w, what):
    rod = body("b", 1.0, [1e-3, 1 / 3, 1 / 3])
    along = np.array([-np.cos(angle), 0, np.sin(angle)])  # from the tip, which slides towards +x
    spin = w * Y
    start = state([along], [X + np.cross(spin, along)], [spin], [about_y(np.arctan2(-along[2], along[0]))])
    with pytest.raises(NumericalFailure, match=what):
        contact_instant(floating([rod], [on_plane("tip", -X, 1.5)]), [start])


def test_a_box_that_yaws_on_four_feet_has_no_determined_motion():
    """A ball beside its middle turns a box that is pushed: how four feet share the weight changes the friction."""
    name, table = family_table("balls_on_box:rows=1")
    beside = np.array([4.0, -2.0, 0.0])  # across the normal, (1, 2, 2)/3
    for part in (table["body"][1], table["joint"][1], table["contact"][1]):
        part["at"] = (np.array(part["at"]) + beside).tolist()
    (case,) = cases_from_tables(name, "balls.toml", table)
    with pytest.raises(NumericalFailure, match="how the contacts share their load is open"):
        simulate_with_contacts(case.mechanism, case.initial_state, case.times)


def test_a_rebound_below_rounding_passes():
    """Smooth balls that fall into a heap: an impact may leave a neighbour a velocity whose rebound rounding hides."""
    case = load_case("ball_lattice:restitution=0")
    answer, _ = simulate_with_contacts(case.mechanism, case.initial_state, case.times)
    energy = np.sum(energies_over_time(case.mechanism, answer, range(len(case.times))), axis=0)
    assert np.all(np.diff(energy) <= 1e-9 * abs(energy[0]))


def test_a_ball_that_hits_a_stack_leaves_impulses_that_obey_every_law():
    """Nine contacts act at once; Newton's law, the cones and the ball's momentum bound what the search may return."""
    lower, upper = (body(name, 1.0, [0.007, 0.007, 0.007]) for name in ("lower", "upper"))
    ball_ = body("ball", 2.0, [0.008] * 3)
    at = [[0.1 * i, 0.1 * j, -0.1] for i in (-1, 1) for j in (-1, 1)]
    feet = [PointPlane(f"f{k}", "lower", OFF + p, GROUND, ZERO, TURN @ Z, friction=0.5) for k, p in enumerate(at)]
    top = [PointPlane(f"t{k}", "upper", OFF + p, "lower", OFF + 0.1 * Z, Z, friction=0.5) for k, p in enumerate(at)]
    hit = SpherePlane("hit", "ball", OFF, 0.1, "upper", OFF - 0.1 * X, -X, restitution=0.2, friction=0.2)
    mechanism = floating([lower, upper, ball_], [*feet, *top, hit])
    start = state([[0, 0, 0.1], [0, 0, 0.3], [-0.2, 0.05, 0.25]], v=[[0, 0, 0], [0, 0, 0], [3, 0, -1.6]])
    found = solve_impact(mechanism, start, mechanism.contacts)
    before, after = (np.sum(found.directions * v, axis=1) for v in (found.velocity_before, found.velocity_after))
    restitution, mu = np.array([0.0] * 8 + [0.2]), np.array([0.5] * 8 + [0.2])
    rebound = after + restitution * np.minimum(before, 0.0)
    assert np.all(found.normal >= 0.0)
    assert np.all(rebound >= -1e-12)
    assert np.max(np.abs(found.normal * rebound)) < 1e-12
    assert np.all(np.linalg.norm(found.tangential, axis=1) <= mu * found.normal + 1e-12)
    momenta = [2.0 * (s.v_WB_W[2] + np.cross(s.w_WB_W[2], s.R_WB[2] @ OFF)) for s in (found.before, found.after)]
    assert momenta[1] - momenta[0] == pytest.approx(
        found.normal[8] * found.directions[8] + found.tangential[8], abs=1e-12
    )


def test_two_ends_of_a_capsule_come_to_rest_by_turns():
    """The impact of one end moves the other, whose gap is below what counts as closed: it rises, and falls back."""
    mechanism = floating([body("b", 1.0, [0.03, 0.03, 0.004])], [])
    R = rotation_from_quaternion(np.array([0.9, 0.2, 0.3, 0.1]) / np.sqrt(0.95))
    ends = (R.T @ [-0.1, 0.0, -0.05], R.T @ [0.1, 0.1, 0.1])
    at = {"start": OFF + ends[0], "end": OFF + ends[1], "radius": 0.05}
    plane = {"partner": GROUND, "point": ZERO, "normal": TURN @ Z}
    capsule = CapsulePlane("cap", "b", **at, **plane, restitution=0.4, friction=0.3)
    start = state([[0.0, 0.0, 0.5]], v=[[1.0, 0.0, 0.0]], w=[[0.0, 4.0, 6.0]], R=[R])
    answer, _ = simulate_with_contacts(replace(mechanism, contacts=(capsule,)), start, np.array([0.0, 1.0]))
    assert answer.contact_gap[1, 0] == pytest.approx(0.0, abs=STATE)
    assert np.all(answer.state(1).R_WB[0].T @ TURN @ Z @ (ends[1] - ends[0]) == pytest.approx(0.0, abs=STATE))
