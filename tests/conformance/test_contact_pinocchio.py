"""Contacts, stops and dry friction of the Pinocchio adapter against closed forms; each test fails for its own mistake.

Numbers without a formula are high-precision quadratures of the closed equations of one mode, and steps of the harness
have an error of the first order: bars of motions through changes of modes are for the step that the test takes.
"""

from dataclasses import replace

import numpy as np
import pytest

from consilience.audit.fuzz.population import specimen
from consilience.case import load_case
from consilience.engine import Question, Route
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    Cone,
    Frame,
    Function,
    Initial,
    Joint,
    Load,
    Mechanism,
    Stop,
    in_units,
    initial_state,
)
from consilience.reference.contact import simulate_with_contacts
from consilience_pinocchio import PinocchioEngine
from consilience_pinocchio.cones import ONE_SIDED, Circle, ConeSolver, Interval
from consilience_pinocchio.export import export_model
from contact_problems import LEVEL, G, Lab, close, pendulum, rolling_ball, sliding_ball, turned

LAB = Lab()
HERE = Frame(np.zeros(3), np.eye(3))
BOX, MOMENTS = (0.3, 0.3, 0.1), (0.07, 0.06, 0.12)


def move(mechanism, state, times, step, extrapolated=False):
    engine = PinocchioEngine()
    assert engine.unsupported(mechanism, Question.TRAJECTORY) == ()
    method = engine.methods(mechanism, Question.TRAJECTORY)[1 if extrapolated else 0]
    assert method.route is Route.HARNESS_STEPPING
    return engine.trajectory(mechanism, state, np.asarray(times, dtype=float), method, step)


def instant(mechanism, state):
    engine = PinocchioEngine()
    assert engine.unsupported(mechanism, Question.INSTANT) == ()
    return engine.instant(mechanism, [state], engine.methods(mechanism, Question.INSTANT)[0])


def box(gravity=LEVEL, half_sizes=BOX, mass=2.0, moments=MOMENTS, **law):
    """Box on the floor, with its centre of mass at its centre."""
    contact = BoxPlane(
        *("box", "body", LAB.com, np.array(half_sizes), GROUND, LAB.origin, LAB.axes[:, 2]),
        orientation=LAB.principal,
        **law,
    )
    return LAB.free_body(mass, moments, gravity, [contact])


def ball(radius=0.11, mass=2.0, gravity=LEVEL, loads=(), **law):
    moment = 0.4 * mass * radius**2
    return LAB.free_body(mass, (moment,) * 3, gravity, [LAB.sphere(radius, **law)], loads)


def test_balls_that_touch_take_part_in_the_impact_of_one():
    """Three equal balls, e 0.5, all contacts at once: the first stops, the others leave at half its speed."""
    case = load_case("balls_touching")
    answer = move(case.mechanism, case.initial_state, case.times, case.sample / 10)
    speeds = np.linalg.norm(answer.v_WB_W[-1], axis=1)
    np.testing.assert_allclose(speeds, [0.0, 0.5, 0.5], atol=1e-11)


def test_a_rocking_block_loses_what_housner_says():
    half, high = 0.1, 0.3
    tilt = 0.6 * np.arctan2(half, high)
    mechanism = box(
        half_sizes=(half, 0.05, high), moments=(2 / 3 * (0.0025 + 0.09), 2 / 3 * 0.1, 2 / 3 * 0.0125), friction=1.0
    )
    R = turned(0.0, tilt, 0.0)
    state = LAB.state(-R @ [half, 0.0, -high], (0, 0, 0), turn=R)
    found = move(mechanism, state, np.linspace(0.0, 0.34, 171), 1e-3)
    rates = np.array([LAB.centre(found, n)[2][1] for n in range(171)])
    hit = int(np.argmin(rates))
    assert found.time[hit] == pytest.approx(0.325571861264741, abs=2.5e-3)
    assert rates[hit] == pytest.approx(-1.41529774120317, abs=0.015)
    assert rates[hit + 1] / rates[hit] == pytest.approx(1 - 1.5 * np.sin(np.arctan2(half, high)) ** 2, abs=0.02)


def test_a_falling_rod_keeps_its_tip_on_the_floor_to_the_second_order():
    R = turned(0.0, 0.2, 0.0)
    mechanism = LAB.free_body(1.0, (1 / 12, 1 / 12, 1e-4), LEVEL, LAB.points([[0.0, 0.0, -0.5]], friction=0.3))
    state = LAB.state(R @ [0.0, 0.0, 0.5], (0, 0, 0), turn=R)
    slips = 0.354921133381657
    found = move(mechanism, state, np.linspace(0.0, slips, 2), slips / 200)
    p, _, _ = LAB.centre(found)
    assert np.arccos(p[2] / 0.5) == pytest.approx(0.413452062926488, abs=2e-3)
    assert abs(found.contact_gap[-1, 0]) < 3e-6
    assert list(found.contact_mode[:, 0]) == [2, 2]
    fine = move(mechanism, state, np.linspace(0.0, slips, 2), slips / 20, extrapolated=True)
    p = LAB.centre(fine)[0]
    assert np.arccos(p[2] / 0.5) == pytest.approx(0.413452062926488, abs=1e-6)


def released(mechanism, angle):
    return initial_state(mechanism, Initial(coordinates={"hinge": {"angle": angle}}))


def rates(mechanism, answer):
    return answer.w_WB_W[:, 0] @ (mechanism.joints[0].F.R[:, 2])


@pytest.mark.parametrize("steps", [10, 13, 17])
def test_a_stop_without_rebound_takes_the_whole_speed_at_once(steps):
    """A rod that swings up from below reaches the stop at ``sqrt(1 - 3 g (1 - cos 0.2)) = 0.64`` rad/s."""
    mechanism = pendulum(LAB, stop={"lower": -0.2})
    state = LAB.state((0.0, 0.0, 0.5), (-0.5, 0.0, 0.0), (0.0, -1.0, 0.0))
    found = move(mechanism, state, np.linspace(0.0, 0.4, steps + 1), 0.4 / steps)
    turning = rates(mechanism, found)
    assert np.all((turning < -0.6) | (turning > -1e-9))
    assert min(LAB.angle(found, n)[0] for n in range(steps + 1)) > -0.2 - 1e-12


@pytest.mark.parametrize("speed", [3.0, 1e-4])
def test_an_instant_slides_along_its_velocity(speed):
    mass, push = 2.0, (3.0, 1.0, 0.0)
    mechanism = ball(0.11, mass, loads=[push], friction=0.5)
    state = LAB.state((0, 0, 0.11), (speed, 0, 0), (0, 0, 4.0))
    at = instant(mechanism, state)
    acceleration, alpha = LAB.acceleration(at, state)
    np.testing.assert_allclose(acceleration, [1.5 - 0.5 * G, 0.5, 0.0], atol=1e-10)
    np.testing.assert_allclose(alpha, [0.0, 0.5 * mass * G * 0.11 / (0.4 * mass * 0.11**2), 0.0], atol=1e-8)
    np.testing.assert_allclose(LAB.axes.T @ at.contact_force[0, 0], mass * G * np.array([-0.5, 0, 1]), atol=1e-10)
    np.testing.assert_allclose([at.force_F, at.torque_F], 0.0, atol=1e-9)


@pytest.mark.parametrize("mass", [1e-9, 1e9])
@pytest.mark.parametrize("problem", [rolling_ball, sliding_ball])
def test_accelerations_do_not_depend_on_the_unit_of_mass(problem, mass):
    """The solver adds an absolute 1e-6 to inverse masses: a ball of 2 mg was 8e-6 off, one of 2000 t had no answer."""
    mechanism, state, (a, alpha, force) = problem(LAB)
    answer = instant(in_units(mechanism, mass=mass), state)
    close((*LAB.acceleration(answer, state), answer.contact_force[0] @ LAB.axes / mass), (a, alpha, force), 1e-10)


def slider_crank():
    """Crank 0.1 m, rod 0.3 m and slider in line on x, with a stop of the slider (numbers in the test)."""

    def bar(name, mass, length, inertia, at, turn):
        R = turned(0, 0, turn)
        return Body(name, mass, np.array([length / 2, 0, 0]), np.diag([1e-4, inertia, inertia]), Frame(at, R))

    elbow, pin = np.array([0, 0.1, 0]), np.array([np.sqrt(0.08), 0, 0])
    lean = -np.arcsin(1 / 3)
    bodies = (
        bar("crank", 1.0, 0.1, 0.001, np.zeros(3), np.pi / 2),
        bar("rod", 0.6, 0.3, 0.0045, elbow, lean),
        Body("slider", 0.5, np.zeros(3), 1e-3 * np.eye(3), Frame(pin, np.eye(3))),
    )
    ahead = turned(0, np.pi / 2, 0)  # z along x
    joints = (
        Joint("motor", "revolute", GROUND, "crank", HERE, HERE),
        Joint("elbow", "revolute", "crank", "rod", Frame(np.array([0.1, 0, 0]), np.eye(3)), HERE),
        Joint("pin", "revolute", "rod", "slider", Frame(np.array([0.3, 0, 0]), np.eye(3)), HERE),
        Joint("guide", "prismatic", GROUND, "slider", Frame(np.zeros(3), ahead), Frame(np.zeros(3), ahead)),
    )
    stops = (Stop("buffer", "guide", "distance", upper=0.39, restitution=0.6),)
    mechanism = Mechanism("slider-crank", np.zeros(3), bodies, joints, stops=stops)
    return mechanism, initial_state(mechanism, Initial({}, {"motor": {"angle": -10.0}}))


def test_a_slider_crank_hits_a_stop_within_its_loop():
    mechanism, state = slider_crank()
    found = move(mechanism, state, np.linspace(0, 0.12, 61), 2e-4)
    rate = found.w_WB_W[:, 0, 2]
    hit = int(np.argmin(rate))
    assert found.time[hit] == pytest.approx(0.110903845715477, abs=2.5e-3)
    assert rate[hit] == pytest.approx(-13.7838093767061, rel=1e-2)
    assert found.v_WB_W[hit + 1, 2, 0] / found.v_WB_W[hit, 2, 0] == pytest.approx(-0.6, abs=0.03)
    # the impulse at the buffer turns the slider: 3.366 N s over the change of its speed, taken by the loss
    assert found.contact_loss[-1] == pytest.approx(0.5 * 3.3659906710061 * 0.4 * 0.689247305402231, rel=0.03)


def test_what_the_solver_cannot_state_is_named():
    engine = PinocchioEngine()

    def refused(mechanism, question=Question.TRAJECTORY):
        return " ".join(f"{u.feature} {u.reason}" for u in engine.unsupported(mechanism, question))

    assert "pyramid cone" in refused(ball(friction=0.2, cone=Cone("pyramid")))
    assert "Poisson impact" in refused(ball(restitution=0.2, impact_law="poisson"))
    assert "torsional friction" in refused(ball(friction=0.2, torsional=0.01))
    two = [LAB.sphere(0.1, "a", friction=0.2), LAB.sphere(0.1, "b", friction=0.2, associated=True)]
    assert "one setting for all" in refused(LAB.free_body(1.0, (1.0,) * 3, LEVEL, two))


def test_a_script_has_no_contacts():
    mechanism = pendulum(LAB, stop={"lower": 0.1})
    with pytest.raises(InvalidInput, match="stop 'stop'"):
        export_model("stopped", mechanism, released(mechanism, 0.5))


def test_associated_cones_lift_a_sliding_box():
    """On the convex cone of one point the relative velocity is normal to the cone: it lifts at mu times the slip."""
    mechanism = ball(0.11, 2.0, friction=0.5, associated=True)
    found = move(mechanism, LAB.state((0, 0, 0.11), (3.0, 0, 0)), [0.0, 1e-3], 1e-3)
    _, v, w = LAB.centre(found)
    slip = v[0] - 0.11 * w[1]
    assert v[2] == pytest.approx(0.5 * slip, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 20.0])
def test_the_lift_of_associated_cones_is_that_of_the_reference_with_this_law(heading):
    """A cube thrown at 6 m/s with mu 0.5 lifts by 293.6 mm, ``(mu v / (1 + mu^2))^2 / (2 g)``, whatever the step."""
    cube = {"half_sizes": (0.05,) * 3, "mass": 1.0, "moments": (1 / 600,) * 3}
    mechanism, angle = box(**cube, friction=0.5, associated=True), np.radians(heading)
    start = LAB.state((0, 0, 0.05), (6.0 * np.cos(angle), 6.0 * np.sin(angle), 0.0))
    times = 2.4 / G * np.array([0.0, 0.5, 1.0])
    exact, _ = simulate_with_contacts(mechanism, start, times)
    coarse, fine = (move(mechanism, start, times, 2.4 / G / n).p_WB[-1] for n in (200, 400))
    moved = exact.p_WB[-1] - exact.p_WB[0]
    assert (LAB.axes.T @ moved[0])[2] == pytest.approx(0.5 * 2.4**2 / G, rel=1e-9)
    np.testing.assert_allclose(2 * fine - coarse, exact.p_WB[-1], atol=1e-3 * 0.5 * 2.4**2 / G)


def test_the_solver_s_traps():
    """Infinite bounds give no force to a negative acceleration; anchors hold it."""
    assert ConeSolver().forces(np.eye(1), np.array([-1.0]), [Interval(-np.inf, np.inf)])[0] == 0.0
    np.testing.assert_allclose(ConeSolver().forces(np.eye(1), np.array([-1.0]), [Interval(-5.0, 5.0)]), 1.0)
    solver, G2 = ConeSolver(), np.diag([1.0, 1.0, 2.0])
    first = solver.forces(G2, np.array([1.0, 0.0, -4.0]), [Circle(0.2)])
    np.testing.assert_allclose(first, [-0.4, 0.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(solver.forces(G2, np.array([1.0, 0.0, -4.0]), [Circle(0.2)]), first, atol=1e-12)


def test_a_contact_near_a_jam_takes_as_many_iterations_as_it_needs():
    """A point on two axes that slides: no normal velocity, and friction against the slip; the normal force is
    ``-y_n/(G_nn - mu G_nt d)`` with the slip's direction d, a denominator of a sixth of G_nn.
    """
    mu, G3 = (
        0.2837583494211008,
        np.array(
            [
                [0.10208636926766734, 0.08722959399752117, 0.00477354385811654],
                [0.08722959399752117, 0.9391606328327211, 0.04098711619221698],
                [0.00477354385811654, 0.04098711619221699, 0.00179871351264373],
            ]
        ),
    )
    check_sliding(mu, G3, np.array([-513.1592936465248, 114.29096636520201, -0.5771123024609146]))


def test_a_contact_at_which_an_adapted_penalty_does_not_converge_is_solved_with_a_constant_one():
    """The same law, where no number of iterations is enough (reports/findings/pinocchio_admm_adapted_penalty)."""
    rows = np.array([[1.59, 0.11], [0.11, 0.88], [-1.19, -0.16]])
    check_sliding(0.56, rows @ rows.T, np.array([4.4, 0.76, -3.54]))


def check_sliding(mu, G3, y):
    f = ConeSolver().forces(G3, y, [Circle(mu)])
    u = G3 @ f + y
    along = u[:2] / np.linalg.norm(u[:2])
    np.testing.assert_allclose(f[:2], -mu * f[2] * along, rtol=1e-9)
    assert f[2] == pytest.approx(-y[2] / (G3[2, 2] - mu * G3[2, :2] @ along), rel=1e-9)


@pytest.mark.parametrize("push", [5.0, 1450.0, 2700.0])
def test_a_stop_beside_dry_friction_takes_all_that_friction_does_not(push):
    """Both act on one coordinate: ``f_1 + f_2`` is determined, whatever the size of the data."""
    forces = ConeSolver().forces(np.full((2, 2), 1.07955), np.full(2, -push), [ONE_SIDED, Interval(-0.2, 0.2)])
    assert np.sum(forces) == pytest.approx(push / 1.07955, rel=1e-9)
    assert abs(forces[1]) < 0.2 + 1e-9


@pytest.mark.parametrize("mismatch", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize("tipped", [[1.0, 1.0], [1.0, 0.4]])
def test_smooth_contacts_that_one_freedom_shares_bear_it_together(tipped, mismatch):
    """Two rows of one coordinate, data apart by rounding over the square of the step: ``J . f`` is determined."""
    J = np.array(tipped)
    forces = ConeSolver().forces(0.7 * np.outer(J, J), -G * J + [0.0, mismatch], [ONE_SIDED, ONE_SIDED])
    assert J @ forces == pytest.approx(G / 0.7, rel=3e-9)
    assert np.min(forces) >= 0.0


@pytest.mark.parametrize(("seed", "samples"), [(55034, 6), (55008, 2)])
def test_rows_of_joints_that_depend_on_one_another_leave_the_contacts_a_motion(seed, samples):
    """A planar four-bar that strikes a ball, and a contact whose normal the joints hold but for rounding."""
    case = specimen(seed, contacts=True).case
    times = case.times[:samples]
    exact = simulate_with_contacts(case.mechanism, case.initial_state, times, 1e-10)[0].p_WB
    coarse, fine = (
        np.max(np.abs(move(case.mechanism, case.initial_state, times, h).p_WB - exact)) for h in (4e-3, 2e-3)
    )
    assert fine == pytest.approx(0.5 * coarse, rel=0.1)
    assert fine < 3e-4


def test_the_law_of_moreau_is_that_of_the_steps():
    """A tip whose slip the normal impulse alone reverses: by Newton's law without friction, not by Moreau's."""
    hits = load_case("rod_hits_floor-backward")
    (tip,) = hits.mechanism.contacts
    moreau = replace(hits.mechanism, contacts=(replace(tip, impact_law="moreau"),))
    answer = move(moreau, hits.initial_state, hits.times, hits.sample / 20)
    truths = [simulate_with_contacts(m, hits.initial_state, hits.times)[0] for m in (moreau, hits.mechanism)]
    np.testing.assert_allclose(answer.v_WB_W[-1], truths[0].v_WB_W[-1], atol=1e-12)
    assert np.max(np.abs(answer.v_WB_W[-1] - truths[1].v_WB_W[-1])) > 0.1


@pytest.mark.parametrize("steps", [7, 16, 23, 34, 61])
def test_an_impact_without_rebound_has_moreau_s_law_wherever_in_a_step_it_is(steps):
    """A rod whose normal impulse alone reverses the slip: friction opposes the slip after the whole impulse.

    Shared by two steps, the impulse slides one way in the first and the other way in the second.
    """
    arm, moment, mu, slip, fall = -np.sqrt(0.5), 1.0 / 3.0, 0.3, 0.2, 1.0
    R, lever = turned(0.0, np.pi / 4.0, 0.0), arm**2 / moment
    normal = fall / (1.0 + lever - mu * lever)  # u_n + (G_nn + mu G_nt) N = 0, G_nt = -lever
    assert slip + (mu * (1.0 + lever) - lever) * normal < 0.0
    after = (slip + mu * normal, 0.0, normal - fall), (0.0, arm * (mu * normal - normal) / moment, 0.0)
    mechanism = LAB.free_body(1.0, (moment, moment, 1e-3), np.zeros(3), LAB.points([[0.0, 0.0, -1.0]], friction=mu))
    found = move(mechanism, LAB.state((0.0, 0.0, 0.02 - arm), (slip, 0.0, -fall), turn=R), [0.0, 0.05], 0.05 / steps)
    close(LAB.centre(found)[1:], after, 1e-9)


@pytest.mark.parametrize("seed", [907, 922])
def test_what_hits_beside_closed_contacts_leads_to_moreau_s_law(seed):
    """Errors in proportion to the step; of impacts that two steps share they are as large at any step."""
    case = specimen(seed, contacts=True).case
    rubbing = tuple(replace(contact, impact_law="moreau") for contact in case.mechanism.contacts)
    exact = simulate_with_contacts(replace(case.mechanism, contacts=rubbing), case.initial_state, case.times)[0].p_WB
    steps = 0.04 / np.array([12, 36, 108])
    errors = [np.max(np.abs(move(case.mechanism, case.initial_state, case.times, h).p_WB - exact)) for h in steps]
    np.testing.assert_allclose(np.array(errors[1:]) / errors[:-1], 1.0 / 3.0, rtol=0.2)


def sliding_oscillator(time):
    """Place of the oscillator of `belt_stick_slip` in its first slide, from where its spring overcomes sticking."""
    rate, tied, let_go, speed = np.sqrt(40.0), 0.25 * G / 40.0, 0.4 * G / 40.0, 0.5
    phase = rate * (time - (let_go - 0.024525) / speed)
    return tied + (let_go - tied) * np.cos(phase) + speed / rate * np.sin(phase)


def test_an_oscillator_leaves_its_belt_when_its_spring_overcomes_sticking():
    """Three feet at once: the error is in proportion to the step, wherever in a step they break away."""
    case = load_case("belt_stick_slip")
    block, times = case.mechanism.bodies[0], np.linspace(0.0, 0.8, 17)

    def error(step, extrapolated=False):
        state = move(case.mechanism, case.initial_state, times, step, extrapolated).state(-1)
        return (state.p_WB[0] + state.R_WB[0] @ block.com)[0] - sliding_oscillator(0.8)

    over_step = np.array([error(step) / step for step in (0.05 / n for n in (10, 14, 20, 28))])
    np.testing.assert_allclose(over_step, over_step[-1], rtol=0.05)
    assert abs(error(0.05 / 8, extrapolated=True)) < 0.05 * abs(error(0.05 / 32))


@pytest.mark.parametrize("still", [0.0703, 0.1907])
def test_a_pulled_box_slides_from_where_the_force_overcomes_its_static_coefficient(still):
    """``m x'' = pull (t - still) + (mu_s - mu) m g`` from the instant at which the force, that grows, is mu_s m g."""
    pull, mass = 0.5 * 2.0 * G / still, 2.0
    mechanism = box(friction=0.3, static_friction=0.5)
    load = Load("pull", "force", "body", LAB.axes[:, 0], "world", LAB.com, Function(np.array([0.0, pull])))
    mechanism = replace(mechanism, loads=(load,))
    gone = 0.5 - still
    place = (0.2 * G * gone**2 / 2.0) + pull * gone**3 / (6.0 * mass)
    errors = []
    for step in (2e-3, 1e-3, 5e-4):
        found = move(mechanism, LAB.state((0, 0, 0.1), (0, 0, 0)), np.linspace(0.0, 0.5, 11), step)
        errors.append(LAB.centre(found)[0][0] - place)
    np.testing.assert_allclose(np.array(errors[:2]) / errors[1:], 2.0, rtol=0.05)
    assert abs(2.0 * errors[2] - errors[1]) < 1e-2 * abs(errors[2])
