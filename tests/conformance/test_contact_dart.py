"""Contacts, stops and dry friction of the DART adapter against closed forms; each test fails for its own mistake."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import load_case, load_cases
from consilience.compare.instant import CONTACT
from consilience.engine import CannotRepresent, Profile, Question, Route
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    BoxPlane,
    Cone,
    Initial,
    PointPlane,
    SpherePlane,
    initial_state,
    quaternion_from_rotation_vector,
    rotation_from_quaternion,
)
from consilience.reference.contact import contact_instant as contact_instant_of_reference
from consilience.reference.engine import ReferenceEngine
from consilience_dart import DartEngine, contact_instant
from consilience_dart.export import export_model
from consilience_dart.stepping import stepper
from contact_problems import LEVEL, G, Lab, pendulum, turned

LAB = Lab()
HEADLINE, EXTRAPOLATED, DEFAULT = range(3)


def move(mechanism, state, times, step, which=HEADLINE):
    engine = DartEngine()
    assert engine.unsupported(mechanism, Question.TRAJECTORY) == ()
    method = engine.methods(mechanism, Question.TRAJECTORY)[which]
    return engine.trajectory(mechanism, state, np.asarray(times, dtype=float), method, step)


def instant(mechanism, state):
    engine = DartEngine()
    assert engine.unsupported(mechanism, Question.INSTANT) == ()
    return engine.instant(mechanism, [state], engine.methods(mechanism, Question.INSTANT)[0])


def box(lab, gravity=LEVEL, half_sizes=(0.3, 0.3, 0.1), moments=(0.07, 0.06, 0.12), **law):
    """Box of 2 kg on the floor, with its centre of mass at its centre."""
    contact = BoxPlane(
        *("box", "body", lab.com, np.array(half_sizes), GROUND, lab.origin, lab.axes[:, 2]),
        orientation=lab.principal,
        **law,
    )
    return lab.free_body(2.0, moments, gravity, [contact])


def ball(radius=0.11, gravity=LEVEL, loads=(), **law):
    """Ball of 2 kg."""
    return LAB.free_body(2.0, (0.8 * radius**2,) * 3, gravity, [LAB.sphere(radius, **law)], loads)


@pytest.mark.parametrize("level", [True, False])
def test_the_default_is_the_box_that_its_law_states(level):
    """The stop of a block under independent bounds along two axes, each deceleration mu g until its speed is gone."""
    lab = Lab(axes=np.eye(3)) if level else LAB
    mechanism = box(lab, friction=0.4)
    engine = DartEngine()
    method = engine.methods(mechanism, Question.TRAJECTORY)[DEFAULT]
    assert method.profile is Profile.DEFAULT
    assert method.law is not None
    assert method.law.cone.kind == "box"
    assert "box" in method.contact_law
    assert "0.1 m/s" in method.contact_law
    t1, t2 = (lab.axes.T @ t for t in method.law.cone.tangents(mechanism.contacts[0].normal))
    velocity = 3.0 * (np.cos(0.6) * t1 + np.sin(0.6) * t2)
    stop = [np.sign(velocity @ t) * (velocity @ t) ** 2 / (0.8 * G) for t in (t1, t2)]
    found = engine.trajectory(mechanism, lab.state((0, 0, 0.1), velocity), np.array([0.0, 0.8]), method, 1e-3)
    p, _, _ = lab.centre(found)
    np.testing.assert_allclose([p @ t1, p @ t2], stop, atol=3e-3)
    straight = 9.0 / (0.8 * G) * velocity / 3.0
    assert np.linalg.norm(p[:2] - straight[:2]) > 0.05


def test_planes_without_one_box_have_no_law():
    first = LAB.sphere(0.1, friction=0.2)
    wall = replace(LAB.sphere(0.1, "wall", friction=0.2), normal=np.array([0.6, 0.0, 0.8]))
    mechanism = LAB.free_body(1.0, (1.0,) * 3, LEVEL, [first, wall])
    assert DartEngine().methods(mechanism, Question.TRAJECTORY)[DEFAULT].law is None


def test_a_ball_that_spins_in_the_air_turns_by_its_spin_at_steps_above_and_below_a_milliradian():
    """Rotations below 1e-3 rad are truncated by DART, at two of the three steps that are extrapolated here."""
    spin = np.array([0.6, 0.0, 0.8])
    state = LAB.state((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), spin)
    found = move(ball(gravity=(0.0, 0.0, 0.0)), state, [0.0, 0.9], 1.8e-3, EXTRAPOLATED)
    turned_by = LAB.axes.T @ found.state(-1).R_WB[0] @ state.R_WB[0].T @ LAB.axes
    truth = rotation_from_quaternion(quaternion_from_rotation_vector(0.9 * spin))
    np.testing.assert_allclose(turned_by, truth, atol=1e-11)


def test_a_ball_bounces_down_to_the_threshold_of_restitution():
    mechanism = ball(0.1, restitution=0.5)
    found = move(mechanism, LAB.state((0, 0, 1.1), (0, 0, 0)), np.linspace(0, 1.5, 151), 1e-3)
    assert LAB.centre(found, 100)[0][2] - 0.1 == pytest.approx(0.0612555656575454, abs=5e-3)
    assert LAB.centre(found)[0][2] == pytest.approx(0.1, abs=1e-3)
    for speed, rebound in ((0.19, 0.0), (0.25, 0.125)):
        found = move(replace(mechanism, gravity=np.zeros(3)), LAB.state((0, 0, 0.11), (0, 0, -speed)), [0.0, 0.1], 1e-3)
        assert LAB.centre(found)[1][2] == pytest.approx(rebound, abs=2e-5)
        assert LAB.axes.T[2] @ found.contact_impulse[1, 0] == pytest.approx(2.0 * (speed + rebound), rel=1e-4)


def released(mechanism, angle, rate=0.0):
    return initial_state(mechanism, Initial({"hinge": {"angle": angle}}, {"hinge": {"angle": rate}}))


def test_an_instant_of_a_wheel_whose_slip_changes_fast():
    """Friction turns the rim of `braked_wheel` by 100 m/s^2 and more: a step must not change the slip by much."""
    case = load_case("braked_wheel")
    mechanism, state, reference = case.mechanism, case.states[2], ReferenceEngine()
    truth = reference.instant(mechanism, [state], reference.methods(mechanism, Question.INSTANT)[0])
    np.testing.assert_allclose(instant(mechanism, state).alpha_WB_W, truth.alpha_WB_W, atol=1e-4)


def test_an_instant_at_which_a_foot_starts_to_slip():
    """Friction is against the acceleration of the foot, which friction itself turns: fixed point of the direction."""
    moments, foot, mu, push, n = np.array([0.1, 0.2, 0.12]), [0.3, 0.2, -0.4], 0.2, [9.0, 4.0, 0.0], np.eye(3)[2]
    cross = np.array([[0.0, -foot[2], foot[1]], [foot[2], 0.0, -foot[0]], [-foot[1], foot[0], 0.0]])
    A = np.eye(3) / 2.0 - cross @ (cross / moments[:, None])
    free, along = np.array(push) / 2.0 - G * n, np.array(push)
    for _ in range(100):
        unit = n - mu * along / np.linalg.norm(along)
        force = -free[2] / (A @ unit)[2] * unit
        along = free + A @ force
    mechanism = LAB.free_body(2.0, moments, LEVEL, LAB.points([foot], friction=mu), [push])
    at = instant(mechanism, LAB.state((-foot[0], -foot[1], -foot[2]), (0, 0, 0)))
    assert abs(along[2]) < 1e-12
    np.testing.assert_allclose(LAB.axes.T @ at.contact_force[0, 0], force, rtol=0, atol=2e-7)


def test_an_instant_does_not_depend_on_those_before_it():
    """Two walls share the weight of a ball as the solver begins: answers of states in any order are the same."""
    case, engine = load_case("trough_rolls"), DartEngine()
    method = engine.methods(case.mechanism, Question.INSTANT)[0]
    forward, backward = (engine.instant(case.mechanism, s, method) for s in (case.states, case.states[::-1]))
    np.testing.assert_allclose(backward.contact_force[::-1], forward.contact_force, rtol=0, atol=1e-6)
    np.testing.assert_allclose(backward.alpha_WB_W[::-1], forward.alpha_WB_W, rtol=0, atol=1e-6)


def test_forces_that_still_change_are_an_error_of_their_force_mixing():
    """A box pulled across four feet: what a newton more in a step makes of the acceleration at a foot."""
    stepping = stepper(box(LAB, friction=0.4), LAB.state((0, 0, 0.1), (0, 0, 0)))
    stepping.world.setTimeStep(1e-3)
    stepping.step(1)
    J = np.array([0.3**2 / 0.07 + 0.3**2 / 0.12, 0.3**2 / 0.06 + 0.3**2 / 0.12]) + 0.5
    found = contact_instant._mixed(stepping.touching, stepping.model, np.array([[0.0, 0.0, 1.0]]))
    assert 1e-5 * 0.5 < found < 1e-5 * np.max(J) * 2.0


def rod_on_its_tip(height, spin, gravity, friction=0.0):
    """Instant of a rod of 1 m and 1 kg at 0.8 rad, its centre above its tip, or with a negative height below it.

    Returns the acceleration of the centre of mass, the angular one about y, and the force, in axes of the problem.
    """
    R = turned(0.0, 0.8, 0.0)
    tip = [0.0, 0.0, -0.5 * height]
    mechanism = LAB.free_body(1.0, (1 / 12, 1 / 12, 1e-3), gravity, LAB.points([tip], friction=friction))
    arm = -R @ tip
    v = np.cross([0.0, spin, 0.0], arm) if friction else [0.0, 0.0, -spin * arm[0]]
    state = LAB.state(arm, v, (0.0, spin, 0.0), R)
    at = instant(mechanism, state)
    a, alpha = LAB.acceleration(at, state)
    return a, alpha[1], LAB.axes.T @ at.contact_force[0, 0]


@pytest.mark.parametrize("spin", [0.0, 2.0, 4.5])
def test_an_instant_of_a_turning_tip_has_the_acceleration_of_its_turning(spin):
    """``N (1 + 3 sin^2) = m (g - l w^2 cos)`` of a smooth tip, from the height l cos of the centre."""
    a, alpha, force = rod_on_its_tip(1.0, spin, LEVEL)
    pressing = (G - 0.5 * spin**2 * np.cos(0.8)) / (1.0 + 3.0 * np.sin(0.8) ** 2)
    np.testing.assert_allclose(force, [0.0, 0.0, pressing], atol=1e-6)
    np.testing.assert_allclose([*a, alpha], [0.0, 0.0, pressing - G, 6.0 * pressing * np.sin(0.8)], atol=1e-6)


def test_a_tip_that_turns_too_fast_lifts_and_one_above_the_centre_is_pressed_by_turning_alone():
    a, _, force = rod_on_its_tip(1.0, 6.0, LEVEL)
    np.testing.assert_allclose([*force, *a], [0.0, 0.0, 0.0, 0.0, 0.0, -G], atol=1e-7)
    _, _, force = rod_on_its_tip(-1.0, 3.0, np.zeros(3))
    pressing = 0.5 * 9.0 * np.cos(0.8) / (1.0 + 3.0 * np.sin(0.8) ** 2)
    np.testing.assert_allclose(force, [0.0, 0.0, pressing], atol=1e-6)


def test_a_tip_that_sticks_holds_a_pendulum():
    """``w' = 3 g sin / (2 L)``, and the force that the centre on its circle needs."""
    w, l = 2.0, 0.5
    a, alpha, force = rod_on_its_tip(1.0, w, LEVEL, friction=2.0)
    turns = 1.5 * G * np.sin(0.8)
    along, up = turns * l * np.cos(0.8) - w**2 * l * np.sin(0.8), -turns * l * np.sin(0.8) - w**2 * l * np.cos(0.8)
    np.testing.assert_allclose([*a, alpha], [along, 0.0, up, turns], atol=1e-6)
    np.testing.assert_allclose(force, [along, 0.0, up + G], atol=1e-6)


def test_a_tip_that_a_joint_lifts_as_it_turns_is_refused():
    """The lowest point of a circle: its normal velocity is zero, whatever the rate, and its gap grows by ``w^2 L``."""
    hanging = pendulum(LAB)
    tip = PointPlane("tip", "rod", LAB.in_body([0, 0, -0.5]), GROUND, LAB.origin - LAB.axes[:, 2], LAB.axes[:, 2])
    state = LAB.state((0.0, 0.0, -0.5), (-1.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    with pytest.raises(CannotRepresent, match=r"'tip'.*accelerates by 4 m/s\^2 as the bodies turn"):
        instant(replace(hanging, contacts=(tip,)), state)


def test_an_instant_of_a_tip_that_strikes_is_refused():
    R = turned(0.0, 0.8, 0.0)
    mechanism = LAB.free_body(1.0, (1 / 12, 1 / 12, 1e-3), LEVEL, LAB.points([[0.0, 0.0, -0.5]]))
    with pytest.raises(ArithmeticError, match="an impact"):
        instant(mechanism, LAB.state(R @ [0, 0, 0.5], (0, 0, -1.0), turn=R))


def test_an_instant_that_friction_leaves_open_is_refused():
    """Feet far out of a body that turns easily: the solver of friction leaves them a rate."""
    sizes = (10.0, 10.0, 0.5)
    at = instant(
        box(LAB, half_sizes=sizes, moments=(133.7, 133.7, 266.7), friction=0.4), LAB.state((0, 0, 0.5), (0, 0, 0))
    )
    assert LAB.axes.T[2] @ at.contact_force[0, 0] == pytest.approx(2.0 * G, rel=1e-6)
    with pytest.raises(ArithmeticError, match="leave the accelerations open"):
        instant(
            box(LAB, half_sizes=sizes, moments=(0.03, 0.04, 0.035), friction=0.4), LAB.state((0, 0, 0.5), (0, 0, 0))
        )


def test_steps_of_which_some_miss_a_contact_have_no_limit():
    mechanism = box(LAB, friction=0.4)
    touching = stepper(mechanism, LAB.state((0, 0, 0.1), (0, 0, 0))).touching
    found, missed = np.ones((1, 3)), np.zeros((1, 3))
    contact_instant._require_same_contacts(touching, [found, found])
    with pytest.raises(ArithmeticError, match="'box' acts in some of the halved steps"):
        contact_instant._require_same_contacts(touching, [found, missed])


@pytest.mark.parametrize("size", [1.0, 2.0])
def test_a_box_that_friction_holds_on_a_slope_has_no_acceleration(size):
    """Slope 0.5, friction 0.6: from the forces of a longer step the solver stopped at its bound, 5e-7 off."""
    sizes, moments = size * np.array([0.2, 0.3, 0.2]), size**2 * np.array([0.05, 0.05, 0.04])
    lab = Lab(axes=np.eye(3), principal=np.eye(3))
    mechanism = box(lab, size * np.array([-4.5, 0.0, -9.0]), sizes, moments, friction=0.6)
    answer = instant(mechanism, lab.state((0.0, 0.0, 0.2 * size), (0.0, 0.0, 0.0)))
    assert np.max(np.abs(answer.a_WB_W)) < 1e-8
    np.testing.assert_allclose(answer.contact_force[0, 0], size * np.array([9.0, 0.0, 18.0]), atol=1e-6)


@pytest.mark.parametrize(("spread", "answers"), [(0.2, True), (0.3, False)])
def test_an_error_of_a_third_of_the_bar_is_refused(monkeypatch, spread, answers):
    """In a loop that slides on two contacts the error was 2.7 times what two extrapolations tell."""
    found = contact_instant._Settled(np.zeros(6), np.zeros((1, 3)), spread * CONTACT.acceleration)
    monkeypatch.setattr(contact_instant, "_by", lambda *_: found)
    if answers:
        assert contact_instant._settled(None, None, None, shared=False, unsure=False) is found
        return
    with pytest.raises(ArithmeticError, match="leave the accelerations open"):
        contact_instant._settled(None, None, None, shared=False, unsure=False)


@pytest.mark.parametrize("name", ["breakaway", "pulled_boxes"])
def test_a_solver_that_tells_its_own_error_does_not_discredit_the_other(name):
    """At rest one solver is 1.7e-6 off and tells 1.4e-6; the other is right to 1e-8."""
    case = load_cases(name)[0]
    engine = DartEngine()
    method = next(m for m in engine.methods(case.mechanism, Question.INSTANT) if m.route is Route.EXTRAPOLATED)
    found = engine.instant(case.mechanism, case.states, method)
    right = contact_instant_of_reference(case.mechanism, case.states)
    np.testing.assert_allclose(found.a_WB_W, right.a_WB_W, rtol=0, atol=1e-6 * max(1.0, np.max(np.abs(right.a_WB_W))))


def test_where_forces_are_open_the_solvers_of_friction_must_agree(monkeypatch):
    def by(solver, fresh, c, state, part, steps):
        return contact_instant._Settled(np.full(6, 1e-5 * contact_instant.SOLVERS.index(solver)), np.zeros((1, 3)), 0.0)

    monkeypatch.setattr(contact_instant, "_by", by)
    assert contact_instant._settled(None, None, None, shared=False, unsure=False).a[0] == 0.0
    with pytest.raises(ArithmeticError, match="leave the accelerations open"):
        contact_instant._settled(None, None, None, shared=False, unsure=True)


def test_each_contact_of_a_body_has_its_own_law_and_touches_its_partner_alone():
    """Three feet with friction 0.1, 0.7 and none: the deceleration is that of the loads on each."""
    feet = LAB.points([[0.3, 0, -0.1], [-0.3, 0.3, -0.1], [-0.3, -0.3, -0.1]])
    rough = [replace(foot, friction=mu) for foot, mu in zip(feet, (0.1, 0.7, 0.0), strict=True)]
    ghost = replace(LAB.sphere(0.5, "ghost"), point=LAB.origin - 10 * LAB.axes[:, 2])  # of a floor far below
    mechanism = LAB.free_body(2.0, (0.07, 0.06, 0.12), LEVEL, [*rough, ghost])
    state = LAB.state((0, 0, 0.1), (3.0, 0, 0))
    at = instant(mechanism, state)
    forces = at.contact_force[0] @ LAB.axes
    np.testing.assert_allclose(forces[0, 0], -0.1 * forces[0, 2], atol=1e-5)
    np.testing.assert_allclose(forces[1, 0], -0.7 * forces[1, 2], atol=1e-5)
    np.testing.assert_allclose(forces[2, :2], 0.0, atol=1e-6)
    assert np.min(forces[1:3, 2]) > 1.0
    np.testing.assert_allclose(forces[3], 0.0, atol=1e-12)
    assert np.sum(forces[:, 2]) == pytest.approx(2.0 * G, rel=1e-6)


def test_an_open_contact_does_not_soften_a_loop():
    """A four-bar with a plane far below accelerates as without it, by DART's own solver of the weld."""
    case = load_case("four_bar")
    state, bar = case.initial_state, case.mechanism.bodies[0].name
    far = SpherePlane("far", bar, np.zeros(3), 0.1, GROUND, np.array([0.0, 0.0, -50.0]), np.array([0.0, 0.0, 1.0]))
    engine, found = DartEngine(), []
    for mechanism in (case.mechanism, replace(case.mechanism, contacts=(far,))):
        method = next(m for m in engine.methods(mechanism, Question.INSTANT) if m.route is Route.EXTRAPOLATED)
        found.append(engine.instant(mechanism, [state], method).a_WB_W)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("spreads", "chosen"),
    [
        *(((5e-8, 0.0), 0), ((2e-7, 1.5e-7), 1), ((2e-7, 2e-3), 0), ((None, 2e-7), 1), ((5e-7, 3e-6), None)),
        *(((2e-6, 3e-6, 5e-8), 2), ((2e-6, 3e-6, 2e-6, None, None, 2e-7), 5)),
    ],
)
def test_the_solver_of_friction_and_the_step_that_settle_answer(spreads, chosen, monkeypatch):
    """Spreads of both solvers in the second of the longest steps, then in the third of shorter ones; others fail."""
    asked = iter((*spreads, *[None] * (2 * len(contact_instant.SHORTER) - len(spreads))))

    def by(solver, fresh, c, state, part, steps):
        assert steps == (contact_instant.STEPS if part == 1 else contact_instant.SHARED_STEPS)
        n, spread = contact_instant.SOLVERS.index(solver) + 2 * contact_instant.SHORTER.index(part), next(asked)
        if spread is None:
            raise ArithmeticError("DART's solvers of friction leave the accelerations open")
        return contact_instant._Settled(np.full(6, n), np.zeros((1, 3)), spread)

    monkeypatch.setattr(contact_instant, "_by", by)
    if chosen is None:
        with pytest.raises(ArithmeticError, match="leave the accelerations open"):
            contact_instant._settled(None, None, None, shared=False, unsure=False)
    else:
        assert contact_instant._settled(None, None, None, shared=False, unsure=False).a[0] == chosen


def test_a_box_that_slides_keeps_to_its_line_where_friction_is_not_solved_at_once():
    """Of 800 steps, 11 ask for more than DART's hundred iterations; by a box in their place it ends 2 % astray."""
    case = load_case("skew_slide_circle")
    mechanism, state, times = case.mechanism, case.initial_state, case.times
    reference = ReferenceEngine()
    method = reference.methods(mechanism, Question.TRAJECTORY)[0]
    truth = reference.trajectory(mechanism, state, times, method, 1e-10)
    errors = []
    for substeps in (20, 40):
        found = move(mechanism, state, times, case.sample / substeps)
        assert found.counters["failed solutions of friction"] == 0
        errors.append(np.max(np.abs(found.p_WB - truth.p_WB)))
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)


def test_what_dart_cannot_state_is_named():
    engine = DartEngine()

    def refused(mechanism, question=Question.TRAJECTORY):
        return " ".join(f"{u.feature} {u.reason}" for u in engine.unsupported(mechanism, question))

    assert "pyramid cone" in refused(ball(friction=0.2, cone=Cone("pyramid")))
    assert "DART has one coefficient" in refused(ball(friction=0.2, static_friction=0.3))
    assert "do not bounce" in refused(pendulum(LAB, stop={"lower": 0.0, "restitution": 0.5}))
    with pytest.raises(InvalidInput, match="brake"):
        export_model("braked", pendulum(LAB, bound=0.1), released(pendulum(LAB, bound=0.1), 0.2))


def test_routes():
    methods = DartEngine().methods(ball(friction=0.2), Question.TRAJECTORY)
    assert [m.route for m in methods] == [Route.TUNED, Route.EXTRAPOLATED, Route.NATIVE]
    assert [m.contact_law.split(";")[0] for m in methods[:2]] == ["circle"] * 2
