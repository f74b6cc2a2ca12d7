"""Rows of screws, drives, couplings, rolling bodies and skates against differences; motions against closed forms.

Mechanisms are drawn in skew axes, with centres of mass off the joint axes.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import truth
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    Control,
    Coupling,
    Drive,
    Frame,
    Friction,
    Function,
    Initial,
    Joint,
    JointSpring,
    Load,
    Mechanism,
    Rolling,
    Skate,
    Spring,
    State,
    body_point,
    centres_of_mass,
    constant,
    constraint_gamma,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    count_turns,
    drawing_state,
    initial_state,
    joint_coordinates,
    joint_rates,
    joint_spring_motion,
    kinetic_energy,
    linear,
    move,
    potential_energy,
    quaternion_from_rotation_vector,
    quaternion_product,
    relative_motion,
    rotation_from_quaternion,
    sine,
    through,
    world_inertias,
)
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.motion import rotations
from consilience.reference.formulations import descriptor
from consilience.reference.solver import accelerations, simulate
from mechanisms import ELEMENTS, PITCH, chain, drawn_joint, rotation, states_of

BAR = 1e-10
NOW = 0.37
"""Time at which rows are evaluated, s: not zero, so that a missing time argument shows."""

# ---------------------------------------------------------------- rows


def between() -> Mechanism:
    """Return a chain with every row between two moving bodies: screw, drive of a distance, gear, cam, geared screw."""
    base = chain("free", "revolute", "cylindrical", "screw", seed=51, backwards=(2,))
    profile = Function(np.array([0.1, 0.3, -0.2]), np.array([[0.3, 2.0, 0.4]]))
    return replace(
        base,
        drives=(Drive("pump", "j2", "distance", sine(0.2, 5.0, 0.3)), Drive("turn", "j1", "angle", profile)),
        couplings=(
            Coupling("gear", "j1", "angle", "j3", "angle", linear(-2.5, 0.1)),
            Coupling("cam", "j2", "angle", "j2", "distance", profile),
            Coupling("rack", "j2", "distance", "j3", "angle", profile),
        ),
        rollings=(Rolling("r", "b1", [0.1, 0.2, -0.1], [0.3, -1.0, 0.5], 0.4, [0.1, 0.0, -0.3], [0.2, 0.4, 1.0], 0.1),),
        skates=(Skate("s", "b2", [0.1, 0.2, -0.1], [0.3, -1.0, 0.5]),),
    )


ROWS = {name: m for name, m in ELEMENTS.items() if name != "powered"} | {"between": between()}


def scattered(mechanism, seed):
    """Return a moving state near the drawing, off all constraints, with angles well away from half a turn."""
    rng = np.random.default_rng(seed)
    state = move(drawing_state(mechanism), 0.2 * rng.normal(size=6 * len(mechanism.bodies)))
    v, w = rng.normal(size=(2, len(mechanism.bodies), 3))
    return State(state.p_WB, state.quat_WB, v, w)


def along(state, t):
    """Return the state after the time t at constant velocities of the origins and constant angular velocities."""
    later = move(state, t * np.hstack([state.v_WB_W, state.w_WB_W]).ravel())
    return State(later.p_WB, later.quat_WB, state.v_WB_W, state.w_WB_W)


def rate(f, h=1e-3):
    """Return the derivative at zero by an eighth-order central difference."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (f(k * h) - f(-k * h)) for k, w in weights.items()) / h


def compiled(mechanism, state, t):
    """Return the workspace of the compiled rows, and the velocities (v of the centre of mass, w') in their columns."""
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    rotations(y, ws.A)
    constraints.evaluate(model, t, y, np.zeros(len(model.coordinate)), ws)
    return ws, y[: len(mechanism.bodies), 7:13].ravel()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", ROWS)
def test_jacobian_in_each_of_the_six_directions_of_each_body(name, seed):
    mechanism, state = ROWS[name], scattered(ROWS[name], seed)
    count = mechanism.holonomic_count
    Q = constraint_jacobian(mechanism, state, t=NOW)[:count]
    found, from_kernels = np.empty_like(Q), np.empty_like(Q)
    for k in range(Q.shape[1]):
        one = np.zeros((len(mechanism.bodies), 6))
        one.flat[k] = 1.0
        moving = State(state.p_WB, state.quat_WB, one[:, :3], one[:, 3:])
        found[:, k] = rate(lambda h, s=moving: constraint_residual(mechanism, along(s, h), NOW))
        ws, u = compiled(mechanism, moving, NOW)
        from_kernels[:, k] = (ws.Q @ u)[:count]
    bar = BAR * np.maximum(1.0, np.max(np.abs(Q), axis=1, initial=0.0))[:, None]
    assert np.all(np.abs(Q - found) < bar)
    assert np.all(np.abs(from_kernels - found) < bar)


@pytest.mark.parametrize("name", ROWS)
def test_value_changes_with_the_velocity_and_the_rate_of_the_drive(name):
    """``d value / dt = Q v - rate``, with explicit dependence on time."""
    mechanism, state = ROWS[name], scattered(ROWS[name], 5)
    v = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    count = mechanism.holonomic_count
    expected = rate(lambda h: constraint_residual(mechanism, along(state, h), NOW + h))
    found = constraint_jacobian(mechanism, state, t=NOW) @ v - constraint_rates(mechanism, NOW)
    ws, u = compiled(mechanism, state, NOW)
    bar = BAR * max(1.0, np.max(np.abs(expected)))
    np.testing.assert_allclose(found[:count], expected, rtol=0, atol=bar)
    np.testing.assert_allclose((ws.Q @ u - ws.rate)[:count], expected, rtol=0, atol=bar)
    np.testing.assert_allclose(
        rate(lambda h: compiled(mechanism, along(state, h), NOW + h)[0].value)[:count], expected, rtol=0, atol=bar
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ROWS)
def test_gamma_is_what_the_velocities_alone_do_to_the_rate(name, seed):
    """``d/dt (Q v - rate) = Q a - gamma`` for all rows, the non-holonomic ones included; origins have a = 0."""
    mechanism, state = ROWS[name], scattered(ROWS[name], seed)
    v = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()

    def rate_of_rows(h):
        Q = constraint_jacobian(mechanism, along(state, h), t=NOW + h)
        return Q @ v - constraint_rates(mechanism, NOW + h)

    def rate_of_kernels(h):
        ws, u = compiled(mechanism, along(state, h), NOW + h)
        return ws.Q @ u - ws.rate

    expected = -rate(rate_of_rows)
    bar = BAR * max(1.0, np.max(np.abs(expected)))
    np.testing.assert_allclose(constraint_gamma(mechanism, state, t=NOW), expected, rtol=0, atol=bar)
    ws, _ = compiled(mechanism, state, NOW)
    a = rate(lambda h: compiled(mechanism, along(state, h), NOW)[1])  # centres of mass accelerate, origins do not
    np.testing.assert_allclose(ws.gamma, ws.Q @ a - rate(rate_of_kernels), rtol=0, atol=bar)


@pytest.mark.parametrize("name", [n for n, m in ROWS.items() if m.rollings])
def test_the_slip_rows_are_the_velocity_of_the_lowest_point(name):
    """Slip rows give the velocity of the body at the lowest point of the torus, found by search."""
    mechanism, state = ROWS[name], scattered(ROWS[name], 8)
    (rolling,) = mechanism.rollings
    i = mechanism.body_index[rolling.body]
    A = rotation_from_quaternion(state.quat_WB[i])
    a, n = A @ rolling.axis, rolling.normal
    e = np.linalg.svd(a[None])[2][1:]
    angles = np.linspace(0, 2 * np.pi, 200_001)
    circle = A @ rolling.center + rolling.radius * (np.cos(angles)[:, None] * e[0] + np.sin(angles)[:, None] * e[1])
    lowest = circle[np.argmin(circle @ n)] - rolling.rounding * n
    velocity = state.v_WB_W[i] + np.cross(state.w_WB_W[i], lowest)
    found = constraint_jacobian(mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    contact, first = mechanism.holonomic_count - 1, mechanism.holonomic_count
    slip = found[first : first + 2]
    assert found[contact] == pytest.approx(n @ velocity, abs=1e-4)
    assert np.hypot(*slip) == pytest.approx(np.linalg.norm(velocity - n * (n @ velocity)), abs=1e-4)
    height = constraint_residual(mechanism, state)[contact]
    assert height == pytest.approx(n @ (state.p_WB[i] + lowest - rolling.point), abs=1e-9)


# ---------------------------------------------------------------- closed forms of motions

_RNG = np.random.default_rng(77)
S = rotation(_RNG)
"""Skew axes of the mechanisms below: x, y, z in their docstrings are the columns of S."""
O = _RNG.normal(size=3)
X, Y, Z = S.T


def body(name, mass, com, moments, at=(0.0, 0.0, 0.0), seed=5):
    """Return a body from its centre of mass and principal moments in axes S at O; its own frame is random."""
    rng = np.random.default_rng(seed)
    pose = Frame(O + S @ (np.array(at) + 0.2 * rng.normal(size=3)), rotation(rng))
    inertia = S @ np.diag(moments) @ S.T
    inertia = pose.R.T @ inertia @ pose.R
    return Body(name, mass, pose.R.T @ (O + S @ np.array(com) - pose.p), 0.5 * (inertia + inertia.T), pose)


def built(bodies, joints, gravity=(0.0, 0.0, 0.0), **elements):
    """Return a mechanism drawn in S, of joints ``(kind, predecessor, successor, at)`` along Z, or ``(..., axes)``."""
    by_name = {b.name: b for b in bodies}
    made = [
        drawn_joint(f"j{n}", kind, by_name, i, j, O + S @ np.array(at), S @ np.array(axes[0]) if axes else S)
        for n, (kind, i, j, at, *axes) in enumerate(joints)
    ]
    return Mechanism("oracle", S @ np.array(gravity), tuple(bodies), tuple(made), **elements)


def coordinate_of(mechanism, answer, joint, name, rates=False):
    """Return the time series of a joint coordinate, with full turns counted, or of its rate."""
    target = mechanism.joints[mechanism.joint_index[joint]]
    values = []
    for n in range(len(answer.time)):
        state = state_at(answer, n)
        motion = relative_motion(mechanism, state, target)
        values.append(float((joint_rates if rates else joint_coordinates)(target, motion)[name]))
    return np.unwrap(values) if name == "angle" and not rates else np.array(values)


def state_at(answer, n):
    unit = answer.quat_WB[n] / np.linalg.norm(answer.quat_WB[n], axis=1)[:, None]
    return State(answer.p_WB[n], unit, answer.v_WB_W[n], answer.w_WB_W[n])


def run(mechanism, times, **initial):
    return simulate(mechanism, initial_state(mechanism, Initial(**initial)), np.asarray(times), 1e-13)


def test_a_screw_advances_by_its_pitch_in_every_turn():
    """``(J + m (p/2 pi)^2) q'' = T - m g p/2 pi`` with gravity along the axis."""
    moments, mass, torque, g = np.array([0.3, 0.4, 0.5]), 2.0, 3.0, 4.0
    nut = body("nut", mass, (0.1, 0.2, 0.3), moments)
    load = Load("t", "torque", "nut", torque * Z, "world")
    m = built([nut], [("screw", GROUND, "nut", (0, 0, 0))], (0, 0, -g), loads=(load,))
    h = PITCH / (2 * np.pi)
    J = moments[2] + mass * (0.1**2 + 0.2**2)
    times = np.linspace(0, 6, 121)
    answer = run(m, times, rates={"j0": {"angle": 1.5}})
    expected = 1.5 * times + 0.5 * (torque - mass * g * h) / (J + mass * h * h) * times**2
    assert expected[-1] > 10 * 2 * np.pi
    angle = coordinate_of(m, answer, "j0", "angle")
    np.testing.assert_allclose(angle, expected, rtol=0, atol=BAR * expected[-1])
    advance = [relative_motion(m, state_at(answer, n), m.joints[0]).p[2] for n in range(len(times))]
    np.testing.assert_allclose(advance, h * expected, rtol=0, atol=BAR * expected[-1])


def gears(torque=6.0, ratio=-0.1):
    """Return Chrono's example of shafts: J1 = 10, J2 = 100 kg m^2, ratio -0.1, torque 6 N m on the first."""
    one = body("one", 2.0, (0.3, 0.0, 0.2), (8.0, 7.0, 10.0 - 2.0 * 0.09), seed=1)
    two = body("two", 5.0, (1.0, 0.4, 0.0), (60.0, 70.0, 100.0 - 5.0 * 0.16), seed=2)
    return built(
        [one, two],
        [("revolute", GROUND, "one", (0, 0, 0)), ("revolute", GROUND, "two", (1, 0, 0))],
        loads=(Load("t", "torque", "one", torque * Z, "world"),),
        couplings=(Coupling("gear", "j0", "angle", "j1", "angle", linear(ratio)),),
    )


def test_a_gear_pair_accelerates_as_chrono_s_shafts_do():
    """``q'' = T / (J1 + J2 r^2)`` over many turns, which the constraint has to count."""
    m = gears()
    expected = 6.0 / (10.0 + 100.0 * 0.1**2)
    found = accelerations(m, [initial_state(m)]).alpha_WB_W[0]
    np.testing.assert_allclose(found, [expected * Z, -0.1 * expected * Z], rtol=0, atol=1e-14)
    times = np.linspace(0, 20, 401)
    answer = run(m, times)
    angle = coordinate_of(m, answer, "j0", "angle")
    assert angle[-1] > 17 * 2 * np.pi
    np.testing.assert_allclose(angle, 0.5 * expected * times**2, rtol=0, atol=BAR * angle[-1])
    np.testing.assert_allclose(coordinate_of(m, answer, "j1", "angle"), -0.1 * angle, rtol=0, atol=BAR)
    counted = {}
    for n in range(len(times)):
        state = state_at(answer, n)
        assert abs(constraint_residual(m, state, times[n], counted)[-1]) < BAR
        counted = count_turns(m, state, counted)
    assert counted["j0"] == pytest.approx(angle[-1], rel=1e-10)


def test_gears_leave_the_torque_about_their_axes_out_of_the_joint_reactions():
    m = gears()
    reaction = accelerations(m, [initial_state(m)]).torque_F[0]
    np.testing.assert_allclose(reaction[:, 2], 0, atol=1e-13)


def test_rack_and_pinion():
    """``x'' = F / (m + J / R^2)``, and the rack moves by R times the angle."""
    R, force, mass, J = 0.3, 5.0, 3.0, 0.7
    pinion = body("pinion", 2.0, (0, 0, 0.1), (0.5, 0.6, J), seed=3)
    rack = body("rack", mass, (0.3, 1.0, 0.2), (0.3, 0.4, 0.5), seed=4)
    along_x = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    m = built(
        [pinion, rack],
        [("revolute", GROUND, "pinion", (0, 0, 0)), ("prismatic", GROUND, "rack", (0, 1, 0), along_x)],
        loads=(Load("f", "force", "rack", force * X, "world", rack.com),),
        couplings=(Coupling("rack", "j0", "angle", "j1", "distance", linear(R)),),
    )
    times = np.linspace(0, 5, 101)
    answer = run(m, times)
    expected = 0.5 * force / (mass + J / R**2) * times**2
    assert expected[-1] / R > 2 * 2 * np.pi
    np.testing.assert_allclose(coordinate_of(m, answer, "j1", "distance"), expected, rtol=0, atol=BAR)
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "angle"), expected / R, rtol=0, atol=10 * BAR)


def test_a_follower_follows_its_cam_turn_after_turn():
    """A cam at constant speed: the distance of the follower is the profile, the force its mass times acceleration."""
    w, mass = 7.0, 1.5
    x = np.linspace(0.0, 2 * np.pi, 25)
    profile = through(x, 0.2 * np.sin(x) ** 2 + 0.05 * np.cos(x), True)
    cam = body("cam", 2.0, (0.1, 0, 0), (0.5, 0.6, 0.7), seed=6)
    follower = body("follower", mass, (0.4, 1.0, 0.2), (0.3, 0.4, 0.5), seed=7)
    along_x = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    m = built(
        [cam, follower],
        [("revolute", GROUND, "cam", (0, 0, 0)), ("prismatic", GROUND, "follower", (0, 1, 0), along_x)],
        (-9.81, 0, 0),
        drives=(Drive("turn", "j0", "angle", linear(w)),),
        couplings=(Coupling("cam", "j0", "angle", "j1", "distance", profile),),
    )
    times = np.linspace(0, 3, 151)
    answer = run(m, times)
    law = np.array([profile.at(w * t) for t in times])
    assert w * times[-1] > 3 * 2 * np.pi
    np.testing.assert_allclose(coordinate_of(m, answer, "j1", "distance"), law[:, 0], rtol=0, atol=BAR)
    np.testing.assert_allclose(coordinate_of(m, answer, "j1", "distance", True), w * law[:, 1], rtol=0, atol=BAR)
    found = accelerations(m, [state_at(answer, 40)], t=times[40]).a_WB_W[0]
    np.testing.assert_allclose(found[1], w * w * law[40, 2] * X, rtol=0, atol=1e-9)


def multipliers(mechanism, state, t):
    """Return the multipliers of all rows; those of drives and couplings are efforts on the successor."""
    model = flatten(mechanism)
    ws, y, a = workspace(model), pack(mechanism, state), np.empty(6 * len(mechanism.bodies))
    turns = np.zeros(len(model.coordinate))
    descriptor.accelerations(model, t, y, turns, ws, a)
    return np.array(descriptor.multipliers(model, t, y, turns, ws, a))


def test_a_driven_pendulum_does_as_told_and_needs_the_torque_of_inverse_dynamics():
    """``q = f(t)``; the drive torque is J f'' + m g l sin f, and no part of it is in the joint reaction."""
    mass, length, g, Jcm = 2.0, 0.7, 9.81, 0.5
    f = Function(np.array([0.1, 4.0, -0.3]), np.array([[0.4, 5.0, 0.2]]))
    bob = body("bob", mass, (length, 0, 0.1), (0.3, 0.4, Jcm))
    m = built([bob], [("revolute", GROUND, "bob", (0, 0, 0))], (g, 0, 0), drives=(Drive("d", "j0", "angle", f),))
    times = np.linspace(0, 4, 161)
    answer = run(m, times)
    law = np.array([f.at(t) for t in times])
    assert law[-1, 0] > 2 * np.pi
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "angle"), law[:, 0], rtol=0, atol=BAR)
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "angle", True), law[:, 1], rtol=0, atol=BAR)
    for n in (0, 33, 120):
        state = state_at(answer, n)
        torque = (Jcm + mass * length**2) * law[n, 2] + mass * g * length * np.sin(law[n, 0])
        assert multipliers(m, state, times[n])[-1] == pytest.approx(torque, rel=1e-9)
        assert accelerations(m, [state], t=times[n]).torque_F[0, 0, 2] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("k", [0.4, 2 / 3], ids=["solid", "shell"])
def test_a_ball_rolls_down_an_incline(k):
    """``a = g sin(slope) / (1 + k)`` with I = k m R^2, 5/7 g sin(slope) for a solid ball, for any body axes."""
    R, mass, slope, g = 0.25, 3.0, 0.4, 9.81
    ball = body("ball", mass, (0, 0, R), np.full(3, k * mass * R**2))
    contact = Rolling("r", "ball", ball.com, [1.0, 0, 0], 0.0, O, Z, R)
    gravity = g * np.array([np.sin(slope), 0, -np.cos(slope)])
    m = built([ball], [("free", GROUND, "ball", (0, 0, 0))], gravity, rollings=(contact,))
    times = np.linspace(0, 2, 41)
    answer = run(m, times)
    moved = np.array([centres_of_mass(m, state_at(answer, n))[0][0] for n in range(len(times))]) - O
    travel = 0.5 * g * np.sin(slope) / (1 + k) * times**2
    np.testing.assert_allclose(moved @ S, np.outer(travel, [1, 0, 0]) + np.array([0, 0, R]), rtol=0, atol=BAR)
    np.testing.assert_allclose(answer.w_WB_W[-1, 0], g * np.sin(slope) / (1 + k) * 2 / R * Y, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("R", "r"), [(0.4, 0.0), (0.4, 0.07)], ids=["disc", "torus"])
def test_a_disc_rolls_steadily_in_a_circle(R, r):
    """Precession W about the normal n, tilt th of the axis a from n, w = W n + (w3 - W cos th) a.

    With V = w3 (R + r sin th) - r W sin th cos th the speed of the centre, the balance of moments about it is
    W sin th (C w3 - A W cos th) = -m (V W (R sin th + r) + R g cos th)  [Newton and Euler; r = 0: Routh].
    """
    mass, g, W, th = 2.0, 9.81, 2.1, 1.2
    C, A = 0.5 * mass * R**2, 0.25 * mass * R**2 + 0.01
    s, c = np.sin(th), np.cos(th)
    known = A * W**2 * s * c - mass * R * g * c + mass * W**2 * r * s * c * (R * s + r)
    w3 = known / (W * s * C + mass * W * (R * s + r) * (R + r * s))
    V = w3 * (R + r * s) - r * W * s * c
    axis = np.array([s, 0, c])  # h is along x, the tangent n x h along y; the centre has the velocity -V y
    disc = body("disc", mass, (0, 0, R * s + r), (1.0, 1.0, 1.0))
    inertia = S @ (A * np.eye(3) + (C - A) * np.outer(axis, axis)) @ S.T
    inertia = disc.drawing.R.T @ inertia @ disc.drawing.R
    disc = replace(disc, inertia=0.5 * (inertia + inertia.T))
    contact = Rolling("r", "disc", disc.com, disc.drawing.R.T @ S @ axis, R, O, Z, r)
    m = built([disc], [("free", GROUND, "disc", (0, 0, 0))], (0, 0, -g), rollings=(contact,))
    spin = w3 - W * c
    w0 = S @ (W * np.array([0, 0, 1]) + spin * axis)
    arm = disc.drawing.R @ disc.com
    v_com = S @ np.array([0, -V, 0])
    drawn = initial_state(m)
    state = State(drawn.p_WB, drawn.quat_WB, [v_com - np.cross(w0, arm)], [w0])
    assert np.max(np.abs(constraint_residual(m, state))) < 1e-14
    assert np.max(np.abs(constraint_jacobian(m, state) @ np.concatenate([state.v_WB_W[0], w0]))) < 1e-13
    times = np.linspace(0, 5, 51)
    answer = simulate(m, state, times, 1e-13)
    # circle about the vertical through `middle`: the velocity -V y has the radius -V / W along x
    middle = O + S @ np.array([V / W, 0, R * s + r])
    for n, t in enumerate(times):
        about_n, about_a = (quaternion_from_rotation_vector(x) for x in (W * t * Z, spin * t * (S @ axis)))
        quat = quaternion_product(about_n, quaternion_product(about_a, drawn.quat_WB[0]))
        com = middle + rotation_from_quaternion(about_n) @ (O + S @ np.array([0, 0, R * s + r]) - middle)
        origin = com - rotation_from_quaternion(quat) @ disc.com
        np.testing.assert_allclose(answer.p_WB[n, 0], origin, rtol=0, atol=BAR)
        assert 1 - abs(answer.quat_WB[n, 0] @ quat) < BAR


def sleigh(com, gravity):
    """Return a Chaplygin sleigh on the plane z = 0, edge at O, blade along x."""
    mass, J = 2.0, 0.3
    b = body("sleigh", mass, (com, 0, 0), (0.2, 0.25, J))
    point = b.drawing.R.T @ (O - b.drawing.p)
    edge = Skate("edge", "sleigh", point, b.drawing.R.T @ Y)
    return built([b], [("planar", GROUND, "sleigh", (0, 0, 0))], gravity, skates=(edge,)), mass, J


def test_a_sleigh_on_an_incline_draws_a_cycloid_and_does_not_slide_down():
    """``x = g sin(a) sin^2(wt) / 2 w^2`` downhill, ``y = g sin(a) (wt - sin(2wt)/2) / 2 w^2`` across [Neimark]."""
    slope, g, w = 0.5, 9.81, 2.3
    m, _, _ = sleigh(0.0, g * np.array([np.sin(slope), 0, -np.cos(slope)]))
    times = np.linspace(0, 6, 61)
    answer = run(m, times, rates={"j0": {"angle": w, "x": 0.0, "y": 0.0}})
    k = g * np.sin(slope) / (2 * w * w)
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "x"), k * np.sin(w * times) ** 2, rtol=0, atol=BAR)
    np.testing.assert_allclose(
        coordinate_of(m, answer, "j0", "y"), k * (w * times - np.sin(2 * w * times) / 2), rtol=0, atol=BAR
    )


def test_chaplygin_s_sleigh_turns_into_a_straight_run():
    """``u = u_m tanh(kt)``, turn rate ``w_m sech(kt)``, k = c w_m sqrt(m/J), u_m = w_m sqrt(J/m), J about the edge."""
    c, w_m = 0.25, 3.0
    m, mass, J = sleigh(c, (0, 0, -9.81))
    J = J + mass * c * c
    k, u_m = c * w_m * np.sqrt(mass / J), w_m * np.sqrt(J / mass)
    times = np.linspace(0, 5, 51)
    answer = run(m, times, rates={"j0": {"angle": w_m, "x": 0.0, "y": 0.0}})
    turned = 2 * w_m / k * np.arctan(np.tanh(k * times / 2))
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "angle"), turned, rtol=0, atol=BAR)
    np.testing.assert_allclose(
        coordinate_of(m, answer, "j0", "x", True), u_m * np.tanh(k * times) * np.cos(turned), rtol=0, atol=10 * BAR
    )


# ---------------------------------------------------------------- forces in a joint


def slider(mass=2.0, **elements):
    """Return a body on a slide along Z."""
    b = body("slider", mass, (0.2, -0.1, 0.3), (0.3, 0.4, 0.5))
    return built([b], [("prismatic", GROUND, "slider", (0, 0, 0))], **elements)


def test_coulomb_friction_stops_a_slider_by_the_law_of_the_hyperbolic_tangent():
    """``m v' = -F tanh(v/s)`` has v = s asinh(sinh(v0/s) exp(-F t / m s)), from sliding into creeping."""
    mass, F, s, v0 = 2.0, 3.0, 0.1, 2.0
    m = slider(mass, frictions=(Friction("f", "j0", "distance", 0.0, F, s),))
    times = np.linspace(0, 2, 81)
    answer = run(m, times, rates={"j0": {"distance": v0}})
    expected = s * np.arcsinh(np.sinh(v0 / s) * np.exp(-F * times / (mass * s)))
    assert expected[0] == pytest.approx(v0)
    assert expected[-1] < 1e-3 * v0
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "distance", True), expected, rtol=0, atol=BAR)


def test_viscous_friction_of_a_hinge_decays_exponentially():
    J, d = 0.5 + 2.0 * (0.2**2 + 0.1**2), 0.4
    b = body("wheel", 2.0, (0.2, -0.1, 0.3), (0.3, 0.4, 0.5))
    friction = Friction("f", "j0", "angle", d, 0.0, 1.0)
    m = built([b], [("revolute", GROUND, "wheel", (0, 0, 0))], frictions=(friction,))
    times = np.linspace(0, 3, 31)
    answer = run(m, times, rates={"j0": {"angle": 9.0}})
    np.testing.assert_allclose(
        coordinate_of(m, answer, "j0", "angle", True), 9.0 * np.exp(-d / J * times), rtol=0, atol=BAR
    )


def test_a_controlled_slider_is_a_linear_system_of_third_order():
    """``m q'' = P e + I int e + D e'``, e = r - q, r = r0 + r1 t + a sin(w t + phi); by the matrix exponential."""
    mass, P, I, D = 2.0, 30.0, 12.0, 5.0
    r0, r1, a, w, phi = 0.3, 0.2, 0.15, 4.0, 0.6
    target = Function(np.array([r0, r1]), np.array([[a, w, phi]]))
    m = slider(mass, controls=(Control("c", "j0", "distance", target, P, I, D),))
    # state z = (q, q', int e, 1, t, sin, cos) of the linear system
    A = np.zeros((7, 7))
    error = np.array([-1, 0, 0, r0, r1, a, 0])
    error_rate = np.array([0, -1, 0, r1, 0, 0, a * w])
    A[0, 1] = 1
    A[1] = (P * error + I * np.eye(7)[2] + D * error_rate) / mass
    A[2] = error
    A[4, 3], A[5, 6], A[6, 5] = 1, w, -w
    start = np.array([0.1, -0.5, 0, 1, 0, np.sin(phi), np.cos(phi)])
    times = np.linspace(0, 4, 81)
    answer = run(m, times, coordinates={"j0": {"distance": 0.1}}, rates={"j0": {"distance": -0.5}})
    expected = np.array([expm(A * t) @ start for t in times])
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "distance"), expected[:, 0], rtol=0, atol=BAR)
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "distance", True), expected[:, 1], rtol=0, atol=10 * BAR)


def _resonant(how, mass, k, a, w):
    """Return the same forced oscillator, driven by the named kind of element."""
    push, spring = sine(a, w), JointSpring("k", "j0", "distance", k, 0.0, 0.0)
    if how == "joint spring":
        return slider(mass, joint_springs=(replace(spring, actuator=push),))
    if how == "spring":
        base = slider(mass)
        pose = base.bodies[0].drawing
        end = pose.R.T @ (O + 0.8 * Z - pose.p)
        return slider(mass, springs=(Spring("s", GROUND, "slider", O, end, k, 0.0, 0.8, push),))
    frame = "world" if how == "force" else "body"
    R = np.eye(3) if frame == "world" else slider(mass).bodies[0].drawing.R.T
    load = Load("f", "force", "slider", a * R @ Z, frame, [0.1, 0.2, 0.3], sine(1.0, w))
    return slider(mass, joint_springs=(spring,), loads=(load,))


@pytest.mark.parametrize("how", ["joint spring", "spring", "force", "force of the body"])
def test_an_oscillator_forced_at_resonance_grows_without_bound(how):
    """``q = a (sin wt - wt cos wt) / 2 k`` at w = sqrt(k/m)."""
    mass, k, a = 2.0, 50.0, 1.2
    w = np.sqrt(k / mass)
    m = _resonant(how, mass, k, a, w)
    times = np.linspace(0, 6, 61)
    answer = run(m, times)
    expected = a / (2 * k) * (np.sin(w * times) - w * times * np.cos(w * times))
    np.testing.assert_allclose(coordinate_of(m, answer, "j0", "distance"), expected, rtol=0, atol=BAR)


def test_a_torque_with_a_history_turns_a_wheel_by_its_integral():
    """A torque a sin(wt) on a free wheel: ``q = a (wt - sin wt) / J w^2``."""
    J, a, w = 0.5 + 2.0 * (0.2**2 + 0.1**2), 3.0, 2.0
    b = body("wheel", 2.0, (0.2, -0.1, 0.3), (0.3, 0.4, 0.5))
    load = Load("t", "torque", "wheel", a * Z, "world", history=sine(1.0, w))
    m = built([b], [("revolute", GROUND, "wheel", (0, 0, 0))], loads=(load,))
    times = np.linspace(0, 3, 61)
    expected = a / (J * w * w) * (w * times - np.sin(w * times))
    np.testing.assert_allclose(coordinate_of(m, run(m, times), "j0", "angle"), expected, rtol=0, atol=BAR)


# ---------------------------------------------------------------- balance of energy


def power_of_forces(mechanism, state, t):
    """Return the power of all forces except gravity, elastic forces of springs, and constraint forces."""
    power = 0.0
    without = replace(mechanism, joint_springs=tuple(replace(s, stiffness=0.0) for s in mechanism.joint_springs))
    for joint, coordinate, effort in truth.joint_efforts(without, state, t):
        power += effort * joint_spring_motion(mechanism, state, joint, coordinate)[1]
    for s in mechanism.springs:
        (p_i, v_i), (p_j, v_j) = (
            body_point(mechanism, state, s.predecessor, s.point_predecessor),
            body_point(mechanism, state, s.successor, s.point_successor),
        )
        lengthening = (p_j - p_i) @ (v_j - v_i) / np.linalg.norm(p_j - p_i)
        push = s.actuator.at(t)[0] if s.actuator else 0.0
        power += (push - s.damping * lengthening) * lengthening
    for load in mechanism.loads:
        i = mechanism.body_index[load.body]
        R = np.eye(3) if load.frame == "world" else rotation_from_quaternion(state.quat_WB[i])
        v = body_point(mechanism, state, load.body, load.point)[1] if load.kind == "force" else state.w_WB_W[i]
        power += (load.history.at(t)[0] if load.history else 1.0) * (R @ load.vector) @ v
    return power


def rate_of_energy(mechanism, state, t):
    """Return d(T + V)/dt: dT/dt from the solver's accelerations, dV/dt by differences along the velocities."""
    answer = accelerations(mechanism, [state], t=t)
    kinetic = 0.0
    for i, (b, inertia) in enumerate(zip(mechanism.bodies, world_inertias(mechanism, state), strict=True)):
        c = rotation_from_quaternion(state.quat_WB[i]) @ b.com
        w, alpha = state.w_WB_W[i], answer.alpha_WB_W[0, i]
        v = state.v_WB_W[i] + np.cross(w, c)
        a = answer.a_WB_W[0, i] + np.cross(alpha, c) + np.cross(w, np.cross(w, c))
        kinetic += b.mass * v @ a + w @ (inertia @ alpha)
    return kinetic + rate(lambda h: potential_energy(mechanism, along(state, h)), 1e-3)


@pytest.mark.parametrize("name", ELEMENTS)
def test_energy_changes_by_the_power_of_drives_loads_and_friction(name):
    """Among constraints only drives do work: effort times prescribed rate."""
    mechanism = ELEMENTS[name]
    state = initial_state(mechanism, t=NOW) if mechanism.drives else states_of(mechanism)[1]
    power = power_of_forces(mechanism, state, NOW)
    power += multipliers(mechanism, state, NOW) @ constraint_rates(mechanism, NOW)
    scale = max(1.0, abs(power), kinetic_energy(mechanism, state))
    assert rate_of_energy(mechanism, state, NOW) == pytest.approx(power, rel=0, abs=1e-9 * scale)
    if name in ("powered", "driven"):
        assert abs(power) > 0.1


@pytest.mark.parametrize("name", ["coupled", "rolling_torus", "rolling_ball", "skating", "backward_screw"])
def test_energy_is_conserved_by_couplings_rolling_and_skates(name):
    mechanism = ELEMENTS[name]
    state = states_of(mechanism)[0]
    answer = simulate(mechanism, state, np.linspace(0, 0.5, 6), 1e-13)
    energies = [
        kinetic_energy(mechanism, state_at(answer, n)) + potential_energy(mechanism, state_at(answer, n))
        for n in range(6)
    ]
    size = max(kinetic_energy(mechanism, state_at(answer, n)) for n in range(6))
    np.testing.assert_allclose(energies, energies[0], rtol=0, atol=1e-10 * max(1.0, size))
    assert np.ptp([kinetic_energy(mechanism, state_at(answer, n)) for n in range(6)]) > 1e-3


def test_a_coordinate_is_not_coupled_with_itself():
    with pytest.raises(InvalidInput, match="with itself"):
        Coupling("c", "j", "angle", "j", "angle", linear(2.0))
    assert Coupling("c", "j", "angle", "j", "distance", constant(0.0)).joint == "j"


# ---------------------------------------------------------------- sizes that vanish


def sprung(free_length, actuator=None):
    """A lumpy body on a skew slide, with a spring from where its end is drawn: length zero at the start."""
    mechanism = chain("prismatic", seed=61)
    body = mechanism.bodies[0]
    end = np.array([0.1, -0.2, 0.3])
    anchor = body.drawing.p + body.drawing.R @ end
    spring = Spring("s", GROUND, "b0", anchor, end, 40.0, 0.6, free_length, actuator)
    return replace(mechanism, springs=(spring,), gravity=np.zeros(3))


@pytest.mark.parametrize("formulation", ["descriptor", "null_space", "relative"])
def test_a_spring_of_free_length_zero_is_regular_where_its_ends_meet(formulation):
    """Along the slide ``m x'' = -k x - c x'``: x(t) = v exp(-d t) sin(w t) / w, and -c v / m at the start."""
    mechanism = sprung(0.0)
    (body,), (joint,) = mechanism.bodies, mechanism.joints
    start = initial_state(mechanism, Initial(rates={"j0": {"distance": 0.7}}))
    z = joint.F.R[:, 2]
    found = accelerations(mechanism, [start], formulation)
    np.testing.assert_allclose(found.a_WB_W[0, 0], -0.6 * 0.7 / body.mass * z, rtol=0, atol=1e-13)
    times = np.linspace(0.0, 2.0, 21)
    motion = simulate(mechanism, start, times, 1e-12, formulation)
    d = 0.3 / body.mass
    w = np.sqrt(40.0 / body.mass - d * d)
    expected = 0.7 * np.exp(-d * times) * np.sin(w * times) / w
    np.testing.assert_allclose((motion.p_WB[:, 0] - start.p_WB[0]) @ z, expected, rtol=0, atol=1e-10)


def test_an_acceleration_at_right_angles_to_every_row_is_an_answer():
    """A body on a slide along x, without gravity: no row of the joint has a component along -k x / m."""
    along = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    body = Body("b", 1.0, np.zeros(3), np.diag([0.01, 0.012, 0.015]), Frame([0.5, 0, 0], np.eye(3)))
    joint = Joint("j", "prismatic", GROUND, "b", Frame([0.5, 0, 0], along), Frame(np.zeros(3), along))
    spring = Spring("s", GROUND, "b", np.zeros(3), np.zeros(3), 100.0, 0.5, 0.0)
    mechanism = Mechanism("m", np.zeros(3), (body,), (joint,), springs=(spring,))
    states = [initial_state(mechanism, Initial({"j": {"distance": x}})) for x in (0.0, -0.3, -0.5)]
    for formulation in ("descriptor", "null_space"):
        found = accelerations(mechanism, states, formulation)
        np.testing.assert_allclose(found.a_WB_W[:, 0, 0], [-50.0, -20.0, 0.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("free_length", "actuator"), [(0.2, None), (0.0, constant(1.0))])
def test_a_force_without_a_direction_is_named(free_length, actuator):
    mechanism = sprung(free_length, actuator)
    start = initial_state(mechanism)
    with pytest.raises(NumericalFailure, match="spring 's' has no length at the start"):
        accelerations(mechanism, [start])
    with pytest.raises(NumericalFailure, match="spring 's' has no length at the start"):
        simulate(mechanism, start, np.linspace(0.0, 1.0, 3), formulation="relative")


def test_friction_too_steep_for_any_step_is_refused():
    mechanism = replace(chain("prismatic", seed=61), frictions=(Friction("f", "j0", "distance", 0.0, 8.0, 1e-9),))
    with pytest.raises(InvalidInput, match="friction 'f': speed: 1e-09 is too small"):
        simulate(mechanism, initial_state(mechanism), np.linspace(0.0, 1.0, 3))
