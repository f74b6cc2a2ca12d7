"""Impacts against closed forms: bouncing, collisions, rough planes, stops, several simultaneous contacts."""

import numpy as np
import pytest

from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    centres_of_mass,
    kinetic_energy,
    quaternion_from_rotation,
)
from consilience.reference.contact import simulate_with_impacts, solve_impact
from mechanisms import lumpy_body, rotation

BAR = 1e-9
ONE = np.eye(3)
ZERO = np.zeros(3)
X, Y, Z = ONE
AT_HOME = Frame(ZERO, ONE)


def ball(name, mass, radius):
    return Body(name, mass, ZERO, 0.4 * mass * radius**2 * ONE, AT_HOME)


def floating(*bodies, gravity=ZERO):
    joints = tuple(Joint(f"free_{b.name}", "free", GROUND, b.name, AT_HOME, AT_HOME) for b in bodies)
    return Mechanism("floating", gravity, bodies, joints)


def state(p, v, w=None, R=None):
    n = len(p)
    quats = np.tile([1.0, 0, 0, 0], (n, 1)) if R is None else quaternion_from_rotation(np.array(R))
    return State(np.array(p, float), quats, np.array(v, float), np.zeros((n, 3)) if w is None else np.array(w, float))


def floor(body, radius, restitution, friction=0.0, center=ZERO, normal=Z):
    return SpherePlane(
        f"floor_{body}", body, center, radius, GROUND, ZERO, normal, restitution=restitution, friction=friction
    )


# --- bouncing -------------------------------------------------------------------------------------------------------


def bounce(height, g, s, t):
    """Height and velocity of a bouncing ball by the geometric series; times and speeds of its impacts."""
    times, speeds = [np.sqrt(2 * height / g)], [np.sqrt(2 * height * g)]
    while times[-1] <= t[-1]:
        speeds.append(s * speeds[-1])
        times.append(times[-1] + 2 * speeds[-1] / g)
    z, v = [], []
    for now in t:
        n = int(np.searchsorted(times, now, side="right"))
        if n == 0:
            z.append(height - g * now**2 / 2)
            v.append(-g * now)
        else:
            dt = now - times[n - 1]
            z.append(speeds[n] * dt - g * dt**2 / 2)
            v.append(speeds[n] - g * dt)
    return np.array(z), np.array(v), np.array(times[:-1]), np.array(speeds[:-1])


@pytest.mark.parametrize("s", [1.0, 0.8, 0.5])
def test_spinning_lumpy_body_with_a_sphere_about_its_centre_of_mass_bounces_in_a_geometric_series(s):
    rng = np.random.default_rng(1)
    R, g = rotation(rng), 9.81  # skew world: "up" is the last column of R
    body = lumpy_body("b", rng)
    mechanism = floating(body, gravity=-g * R[:, 2])
    A, w = rotation(rng), np.array([1.0, -2.0, 1.5])
    start = R @ [0.3, -0.2, 0.25 + 1.3] - A @ body.com
    drift = R @ [0.4, 0.1, 0.0]
    initial = state([start], [drift - np.cross(w, A @ body.com)], [w], [A])
    contact = floor("b", 0.25, s, center=body.com, normal=3.0 * R[:, 2])
    times = np.linspace(0.0, 0.98 * (1 + 2 * (s + s**2 + s**3 + s**4 + s**5)) * np.sqrt(2 * 1.3 / g), 41)
    answer, impacts = simulate_with_impacts(mechanism, initial, times, (contact,))
    z, v, at, speeds = bounce(1.3, g, s, times)
    assert len(at) == len(impacts) >= 5
    np.testing.assert_allclose([i.time for i in impacts], at, rtol=0, atol=BAR)
    np.testing.assert_allclose([-i.velocity_before[0] @ R[:, 2] for i in impacts], speeds, rtol=0, atol=BAR)
    np.testing.assert_allclose([i.normal[0] for i in impacts], body.mass * (1 + s) * speeds, rtol=0, atol=BAR)
    for n, t in enumerate(times):
        sample = State(*(a[n] for a in (answer.p_WB, answer.quat_WB, answer.v_WB_W, answer.w_WB_W)))
        r, r_dot = centres_of_mass(mechanism, sample)
        along = drift * t + R @ [0.3, -0.2, 0.25]
        np.testing.assert_allclose(r[0], along + z[n] * R[:, 2], rtol=0, atol=BAR)
        np.testing.assert_allclose(r_dot[0], drift + v[n] * R[:, 2], rtol=0, atol=BAR)


def test_one_sample_at_the_end_of_many_bounces_gives_the_same_end():
    mechanism = floating(ball("b", 1.0, 0.1), gravity=-9.81 * Z)
    initial = state([[0, 0, 1.1]], [ZERO])
    answer, impacts = simulate_with_impacts(mechanism, initial, np.array([0.0, 2.3]), (floor("b", 0.1, 0.9),))
    z, v, at, _ = bounce(1.0, 9.81, 0.9, np.array([0.0, 2.3]))
    assert len(impacts) == len(at)
    assert abs(answer.p_WB[-1, 0, 2] - 0.1 - z[-1]) < BAR
    assert abs(answer.v_WB_W[-1, 0, 2] - v[-1]) < BAR


# --- two spheres ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.0, 0.13, -0.2])
@pytest.mark.parametrize("s", [1.0, 0.6, 0.0])
def test_two_smooth_spheres_exchange_momentum_along_the_line_of_centres(s, offset):
    m1, m2, r1, r2 = 1.2, 0.7, 0.2, 0.15
    mechanism = floating(ball("a", m1, r1), ball("b", m2, r2))
    v1, v2 = np.array([2.0, 0.0, 0.0]), np.array([-0.5, 0.0, 0.0])
    initial = state([[0, 0, 0], [1.0, offset, 0]], [v1, v2])
    contact = SphereSphere("pair", "a", ZERO, r1, "b", ZERO, r2, restitution=s)
    answer, (hit,) = simulate_with_impacts(mechanism, initial, np.array([0.0, 1.0]), (contact,))
    at = (1.0 - np.sqrt((r1 + r2) ** 2 - offset**2)) / 2.5
    n = np.array([-(1.0 - 2.5 * at), -offset, 0.0]) / (r1 + r2)  # from b to a
    N = -(1 + s) * n @ (v1 - v2) * m1 * m2 / (m1 + m2)
    assert abs(hit.time - at) < BAR
    assert abs(hit.normal[0] - N) < BAR
    np.testing.assert_allclose(answer.v_WB_W[-1], [v1 + N * n / m1, v2 - N * n / m2], rtol=0, atol=BAR)
    assert abs(hit.velocity_after[0] @ n + s * hit.velocity_before[0] @ n) < BAR
    loss = 0.5 * m1 * m2 / (m1 + m2) * (1 - s**2) * (n @ (v1 - v2)) ** 2
    assert abs(hit.energy_before - hit.energy_after - loss) < BAR
    assert abs(hit.restitution_loss - loss) < BAR


@pytest.mark.parametrize(("miss", "count"), [(1e-6, 0), (-1e-6, 1)])
def test_spheres_that_pass_within_a_micrometre_are_told_from_spheres_that_graze(miss, count):
    mechanism = floating(ball("a", 1.0, 0.2), ball("b", 1.0, 0.1))
    initial = state([[0, 0, 0], [5.0, 0.3 + miss, 0]], [4 * X, -1 * X])
    contact = SphereSphere("pair", "a", ZERO, 0.2, "b", ZERO, 0.1, restitution=1.0)
    _, impacts = simulate_with_impacts(mechanism, initial, np.array([0.0, 3.0]), (contact,))
    assert len(impacts) == count
    if count:
        assert abs(impacts[0].time - (1.0 - np.sqrt(0.3**2 - (0.3 + miss) ** 2) / 5.0)) < BAR


def test_a_ball_that_hits_a_free_plate_off_its_centre_turns_it():
    plate = Body("plate", 3.0, ZERO, np.diag([0.3, 0.5, 0.7]), AT_HOME)
    mechanism = floating(ball("a", 0.8, 0.1), plate)
    contact = SpherePlane("hit", "a", ZERO, 0.1, "plate", np.array([0, 0, 0.05]), Z, restitution=0.75)
    initial = state([[0.4, 0.0, 1.0], [0, 0, 0]], [[0.3, 0, -2.0], ZERO])
    _, (hit,) = simulate_with_impacts(mechanism, initial, np.array([0.0, 0.6]), (contact,))
    t = (1.0 - 0.15) / 2.0
    lever = 0.4 + 0.3 * t
    N = 1.75 * 2.0 / (1 / 0.8 + 1 / 3.0 + lever**2 / 0.5)
    assert abs(hit.time - t) < BAR
    assert abs(hit.normal[0] - N) < BAR
    np.testing.assert_allclose(hit.after.v_WB_W, [[0.3, 0, -2 + N / 0.8], [0, 0, -N / 3]], rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.w_WB_W[1], [0, lever * N / 0.5, 0], rtol=0, atol=BAR)


# --- rough planes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.999, 1.001, 4.0])
def test_ball_with_backspin_slides_below_and_sticks_above_two_sevenths(fraction):
    m, r, s, fall = 0.6, 0.15, 0.7, 2.0
    v, w = np.array([1.5, -0.8, -fall]), np.array([3.0, -12.0, 5.0])
    slip = np.array([v[0] - r * w[1], v[1] + r * w[0], 0.0])  # slip of the contact point, v + w x (-r z)
    mu = fraction * (2 / 7) * np.linalg.norm(slip) / ((1 + s) * fall)
    hit = solve_impact(floating(ball("b", m, r)), state([[0, 0, r]], [v], [w]), (floor("b", r, s, mu),))
    N = m * (1 + s) * fall
    pt = -min(2 * m / 7 * np.linalg.norm(slip), mu * N) * slip / np.linalg.norm(slip)
    assert hit.modes == ({0.0: "frictionless", 4.0: "sticking", 1.001: "sticking"}.get(fraction, "sliding"),)
    np.testing.assert_allclose(hit.velocity_before[0], slip - fall * Z, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.tangential[0], pt, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.v_WB_W[0], v + (pt + N * Z) / m, rtol=0, atol=BAR)
    spin = w + np.cross(-r * Z, pt) / (0.4 * m * r**2)
    np.testing.assert_allclose(hit.after.w_WB_W[0], spin, rtol=0, atol=BAR)
    assert abs(hit.restitution_loss - 0.5 * m * (1 - s**2) * fall**2) < BAR
    assert abs(hit.energy_before - hit.energy_after - hit.restitution_loss - hit.friction_loss) < BAR


M_ROD, A_ROD = 1.4, 0.5
I_ROD = M_ROD * A_ROD**2 / 3


def rod(angle, v, w, s, mu):
    """Impact of the lower end of a rod (half-length 0.5 m) inclined by `angle`; motion in the xz plane."""
    body = Body("rod", M_ROD, ZERO, np.diag([1e-3 * I_ROD, I_ROD, I_ROD]), AT_HOME)
    along = np.array([np.cos(angle), 0, np.sin(angle)])
    R = np.column_stack([along, Y, np.cross(along, Y)])
    tip = PointPlane("tip", "rod", np.array([-A_ROD, 0, 0]), GROUND, ZERO, Z, restitution=s, friction=mu)
    r = -A_ROD * along
    hit = solve_impact(floating(body), state([-r], [v], [w], [R]), (tip,))
    return hit, r[0], r[2]


def compliance_of_rod(rx, rz):
    """Change of the tip's velocity per unit impulse (x, z); the rod turns about y, ``dw = (rz px - rx pz) / I``."""
    return np.eye(2) / M_ROD + np.array([[rz**2, -rx * rz], [-rx * rz, rx**2]]) / I_ROD


def after_rod(rx, rz, px, pz, v):
    return v + np.array([px, 0, pz]) / M_ROD, np.array([0, (rz * px - rx * pz) / I_ROD, 0])


@pytest.mark.parametrize("angle", [0.3, 0.9, 2.1])
def test_smooth_rod_dropped_obliquely_turns_by_the_closed_form(angle):
    s, fall = 0.6, 3.0
    hit, rx, rz = rod(angle, -fall * Z, ZERO, s, 0.0)
    N = (1 + s) * fall * M_ROD / (1 + 3 * np.cos(angle) ** 2)
    v, w = after_rod(rx, rz, 0.0, N, -fall * Z)
    assert abs(hit.normal[0] - N) < BAR
    np.testing.assert_allclose(hit.after.v_WB_W[0], v, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.w_WB_W[0], w, rtol=0, atol=BAR)
    np.testing.assert_allclose(w[1], N * A_ROD * np.cos(angle) / I_ROD, rtol=0, atol=BAR)


@pytest.mark.parametrize("fraction", [0.5, 0.99, 1.01, 3.0])
@pytest.mark.parametrize("angle", [0.4, 1.0, 2.2])
def test_rough_rod_dropped_without_sliding_sticks_above_its_critical_friction_and_else_starts_to_slide(angle, fraction):
    s, fall = 0.5, 2.0
    # ratio of tangential to normal impulse of a tip that sticks
    critical = np.sin(angle) * np.cos(angle) / (1 / 3 + np.sin(angle) ** 2)
    mu = fraction * abs(critical)
    hit, rx, rz = rod(angle, -fall * Z, ZERO, s, mu)
    ratio = np.sign(critical) * min(mu, abs(critical))
    N = (1 + s) * fall / (1 / M_ROD + rx**2 / I_ROD - ratio * rx * rz / I_ROD)
    v, w = after_rod(rx, rz, ratio * N, N, -fall * Z)
    assert hit.modes == ("sticking" if fraction > 1 else "starting",)
    assert abs(hit.normal[0] - N) < BAR
    np.testing.assert_allclose(hit.tangential[0], [ratio * N, 0, 0], rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.v_WB_W[0], v, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.w_WB_W[0], w, rtol=0, atol=BAR)
    assert hit.energy_after <= hit.energy_before


# initial slip, friction -> mode; at this angle the normal impulse drives the tip towards -x
@pytest.mark.parametrize(
    ("slip", "mu", "mode"),
    [(-4.0, 0.2, "sliding"), (6.0, 0.1, "sliding"), (1.4, 0.9, "sticking"), (0.5, 0.9, "unopposed")],
)
def test_rod_that_slides_before_obeys_the_law_of_the_source_until_friction_would_reverse_it(slip, mu, mode):
    s, fall, angle = 0.5, 1.0, 1.0
    v = np.array([slip, 0, -fall])
    hit, rx, rz = rod(angle, v, ZERO, s, mu)
    C = compliance_of_rod(rx, rz)
    rest = np.array([-slip, (1 + s) * fall])  # change of velocity (x, z) of a tip that sticks
    if mode == "sticking":
        px, pz = np.linalg.solve(C, rest)
    else:
        ratio = -np.sign(slip) * mu if mode == "sliding" else 0.0
        pz = rest[1] / (C[1, 1] + ratio * C[1, 0])
        px = ratio * pz
    assert hit.modes == (mode,)
    expected_v, expected_w = after_rod(rx, rz, px, pz, v)
    np.testing.assert_allclose(hit.after.v_WB_W[0], expected_v, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.w_WB_W[0], expected_w, rtol=0, atol=BAR)
    assert hit.energy_after <= hit.energy_before


# --- stops ----------------------------------------------------------------------------------------------------------


def pendulum(h):
    """Rod-like body of mass 2 that swings about y, centre of mass 0.4 m from the pivot; a stop at the distance h."""
    inertia = np.diag([0.05, 0.06, 0.03])
    body = Body("arm", 2.0, np.array([0.4, 0, 0]), inertia, AT_HOME)
    turn = np.column_stack([Z, X, Y])  # joint axes z, x, y along y, z, x of the world
    joint = Joint("pivot", "revolute", GROUND, "arm", Frame(ZERO, turn), Frame(ZERO, turn))
    stop = PointPlane("stop", "arm", np.array([h, 0, 0]), GROUND, ZERO, X, restitution=0.6)
    return Mechanism("pendulum", -9.81 * Z, (body,), (joint,)), stop


I_PIVOT = 0.06 + 2.0 * 0.4**2


@pytest.mark.parametrize("h", [0.2, I_PIVOT / (2.0 * 0.4), 0.9])
def test_pendulum_at_a_stop_reverses_by_s_and_its_pivot_feels_nothing_at_the_centre_of_percussion(h):
    mechanism, stop = pendulum(h)
    answer, impacts = simulate_with_impacts(mechanism, state([ZERO], [ZERO]), np.array([0.0, 0.7]), (stop,))
    hit = impacts[0]
    w = np.sqrt(2 * 2.0 * 9.81 * 0.4 / I_PIVOT)  # falls from horizontal to hanging, about +y
    np.testing.assert_allclose(hit.before.w_WB_W[0], [0, w, 0], rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.w_WB_W[0], [0, -0.6 * w, 0], rtol=0, atol=BAR)
    N = 1.6 * I_PIVOT * w / h
    assert abs(hit.normal[0] - N) < BAR
    # along the world's x, which is y of F: m dv = N + R; dv = +1.6 w 0.4, since the arm moves towards -x before impact
    pivot = 2.0 * 0.4 * 1.6 * w - N
    np.testing.assert_allclose(hit.force_F[0], [0, pivot, 0], rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.torque_F[0], ZERO, rtol=0, atol=BAR)
    if h == I_PIVOT / (2.0 * 0.4):
        assert abs(hit.force_F[0, 1]) < BAR
    rise = kinetic_energy(mechanism, hit.after) / (2.0 * 9.81)
    assert abs(rise - 0.36 * 0.4) < BAR
    assert answer.counters["impacts"] == len(impacts)


# --- several contacts at once ---------------------------------------------------------------------------------------


def row_of_balls(gap, s):
    r = 0.1
    balls = [ball(name, 0.5, r) for name in "abc"]
    contacts = tuple(SphereSphere(f"{p}{q}", p, ZERO, r, q, ZERO, r, restitution=s) for p, q in ("ab", "bc"))
    initial = state([[-1.0, 0, 0], ZERO, [2 * r + gap, 0, 0]], [2.0 * X, ZERO, ZERO])
    return floating(*balls), initial, contacts


@pytest.mark.parametrize("s", [1.0, 0.5, 0.0])
def test_three_touching_balls_share_the_impact_as_the_simultaneous_law_says(s):
    mechanism, initial, contacts = row_of_balls(0.0, s)
    answer, (hit,) = simulate_with_impacts(mechanism, initial, np.array([0.0, 1.0]), contacts)
    assert abs(hit.time - 0.4) < BAR
    share = (1 + s) / 3  # p_ab = 2 m v (1 + s) / 3, p_bc half of it; speeds at s = 1: -1/3, 2/3, 2/3
    np.testing.assert_allclose(answer.v_WB_W[-1] / 2.0, [(1 - 2 * share) * X, share * X, share * X], rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.normal, [0.5 * 2 * 2.0 * share, 0.5 * 2.0 * share], rtol=0, atol=BAR)


def test_three_balls_with_a_gap_hand_the_speed_on_one_by_one():
    mechanism, initial, contacts = row_of_balls(1e-3, 1.0)
    answer, impacts = simulate_with_impacts(mechanism, initial, np.array([0.0, 1.0]), contacts)
    np.testing.assert_allclose([i.time for i in impacts], [0.4, 0.4 + 5e-4], rtol=0, atol=BAR)
    np.testing.assert_allclose(answer.v_WB_W[-1], [ZERO, ZERO, 2 * X], rtol=0, atol=BAR)


def test_box_that_lands_flat_on_four_corners_bounces_without_turning():
    m, s, fall = 2.0, 0.4, 0.7
    box = Body("box", m, ZERO, np.diag([0.1, 0.2, 0.25]), AT_HOME)
    corners = [np.array([x, y, -0.1]) for x in (-0.3, 0.3) for y in (-0.2, 0.2)]
    contacts = tuple(
        PointPlane(f"c{n}", "box", c, GROUND, ZERO, Z, restitution=s, friction=0.3) for n, c in enumerate(corners)
    )
    initial = state([[0, 0, 0.1 + fall]], [ZERO])
    _, (hit, *_) = simulate_with_impacts(floating(box, gravity=-9.81 * Z), initial, np.array([0.0, 0.5]), contacts)
    speed = np.sqrt(2 * 9.81 * fall)
    assert hit.contacts == ("c0", "c1", "c2", "c3")
    np.testing.assert_allclose(hit.after.v_WB_W[0], s * speed * Z, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.w_WB_W[0], ZERO, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.normal, m * (1 + s) * speed / 4, rtol=0, atol=BAR)


def test_a_contact_that_would_have_to_pull_is_released():
    """A beam rests on two corners and is struck from above beyond one of them: the other corner lifts."""
    m, inertia, a = 1.0, 0.02, 0.3
    beam = Body("beam", m, ZERO, np.diag([0.01, inertia, inertia]), AT_HOME)
    hammer = ball("hammer", 0.5, 0.05)
    contacts = (
        PointPlane("left", "beam", np.array([-a, 0, 0]), GROUND, ZERO, Z, restitution=0.5),
        PointPlane("right", "beam", np.array([a, 0, 0]), GROUND, ZERO, Z, restitution=0.5),
        SpherePlane("blow", "hammer", ZERO, 0.05, "beam", ZERO, Z, restitution=0.5),
    )
    x = 0.5  # the hammer strikes outside the right corner
    hit = solve_impact(floating(beam, hammer), state([ZERO, [x, 0, 0.05]], [ZERO, -2 * Z]), contacts)
    # the beam pivots about the right corner: one coordinate w, lever arm x - a of the blow
    pivot = inertia + m * a**2
    N = 1.5 * 2.0 / (1 / 0.5 + (x - a) ** 2 / pivot)
    w = N * (x - a) / pivot
    assert hit.modes[0] == "released"
    np.testing.assert_allclose(hit.after.w_WB_W[0], [0, w, 0], rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.after.v_WB_W[0], [0, 0, w * a], rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.normal, [0, m * w * a + N, N], rtol=0, atol=BAR)


@pytest.mark.parametrize(("above", "below"), [(0.0, 1.0), (0.3, 0.9)])
def test_a_ball_at_rest_on_the_floor_gets_back_its_share_of_the_impulse_by_poissons_law(above, below):
    """Both impulses of compression are m u; of expansion e m u each, and what then holds the lower ball back."""
    m, r, u = 0.5, 0.1, 1.4
    laws = ({"restitution": e, "impact_law": "poisson"} for e in (below, above))
    contacts = (
        SpherePlane("floor", "lower", ZERO, r, GROUND, ZERO, Z, **next(laws)),
        SphereSphere("balls", "upper", ZERO, r, "lower", ZERO, r, **next(laws)),
    )
    initial = state([r * Z, (3 * r + 0.2) * Z], [ZERO, -u * Z])
    mechanism = floating(ball("lower", m, r), ball("upper", m, r))
    answer, (hit,) = simulate_with_impacts(mechanism, initial, np.array([0.0, 0.2]), contacts)
    np.testing.assert_allclose(answer.v_WB_W[-1, :, 2], 0.5 * below * u, rtol=0, atol=BAR)
    np.testing.assert_allclose(hit.normal, m * u * np.array([1.0 + below, 1.0 + 0.5 * below]), rtol=0, atol=BAR)
