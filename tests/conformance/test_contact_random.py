"""Random mechanisms with contacts whose modes an adapter finds by trying: accelerations are those of the reference."""

import numpy as np
import pytest

import consilience as cs
from consilience.audit.fuzz.population import specimen
from consilience.case import load_cases
from consilience.engine import CannotRepresent, Question, load_engine
from consilience.mechanism import determinate_forces, rotation_from_bryant_xyz
from consilience.reference.contact import simulate_with_contacts

LAB, G = rotation_from_bryant_xyz([0.3, -0.7, 0.5]), 9.81


def accelerations(engine, case):
    """Return the accelerations of all bodies at the first state, one column, by the headline method."""
    engine = load_engine(engine)
    answer = engine.instant(case.mechanism, case.states[:1], engine.methods(case.mechanism, Question.INSTANT)[0])
    return np.concatenate([answer.a_WB_W.ravel(), answer.alpha_WB_W.ravel()])


@pytest.mark.parametrize(
    ("engine", "seed", "digits"),
    [
        pytest.param("mujoco", 35050, 12, id="loops beside a contact that slides"),
        pytest.param("mujoco", 35063, 12, id="a box that leaves a plane, held by loops"),
        pytest.param("mujoco", 35071, 9, id="a contact that opens, and closes again as others slide"),
        pytest.param("mujoco", 35085, 12, id="loops that hold everything, with five contacts"),
        pytest.param("pinocchio", 35072, 10, id="a contact whose rows depend on those of a loop"),
        pytest.param("dart", 8936, 8, id="loops that the first solver of friction leaves open"),
        pytest.param("dart", 36018, 7, id="a sphere whose rows turn, and loops"),
        pytest.param("dart", 36009, 7, id="an end of a capsule that turns"),
        pytest.param("dart", 36096, 8, id="forces that still change in the second step"),
        pytest.param("pinocchio", 135, 9, id="a stop that a loop holds"),
    ],
)
def test_modes_of_several_contacts_settle(engine, seed, digits):
    case = specimen(seed, contacts=True).case
    found, wanted = accelerations(engine, case), accelerations("reference", case)
    assert np.max(np.abs(found - wanted)) <= 10.0**-digits * max(1.0, np.max(np.abs(wanted)))


def gripped(arm):
    """Return Exudyn's answer for a body that turns and slides along an axis, on a rough plane by a tip beside the axis.

    A spring twists with ``mu m g arm / 2``: the tip holds with half the friction that it has.
    """
    draw = cs.Drawing("gripped", gravity=LAB @ (0.0, 0.0, -G))
    draw.body("b", mass=2.0, at=LAB @ (0.0, 0.0, 0.3), com=LAB @ (0.05, -0.02, 0.1), inertia=(0.02, 0.03, 0.04))
    draw.joint("c", "cylindrical", "ground", "b", at=LAB @ (0.0, 0.0, 0.3), axis=LAB[:, 2])
    draw.add("joint_spring", "twist", joint="c", coordinate="angle", stiffness=1.0, rest=0.5 * 0.5 * 2.0 * G * arm)
    plane = {"point": (0.0, 0.0, 0.0), "normal": LAB[:, 2]}
    draw.add("contact", "tip", body="b", at=LAB @ (arm, 0.0, 0.0), friction=0.5, **plane)
    case, engine = draw.case(duration=1.0, sample=0.1), load_engine("exudyn")
    return engine.instant(case.mechanism, [case.initial_state], engine.methods(case.mechanism, Question.INSTANT)[0])


def test_a_contact_close_to_the_axis_of_its_body_grips():
    answer = gripped(1e-4)
    assert np.max(np.abs(answer.alpha_WB_W)) <= 1e-9
    np.testing.assert_allclose((answer.contact_force[0, 0] @ LAB)[1:], [-0.5 * G, 2.0 * G], atol=1e-5)


def test_a_contact_on_the_axis_of_its_body_but_for_rounding_has_no_answer():
    with pytest.raises(ArithmeticError, match="accelerations of joints and of closed contacts stay at"):
        gripped(1e-5)


@pytest.mark.parametrize("seed", [8966, 9063])
def test_a_contact_carries_what_is_beyond_the_dry_friction_beside_it(seed):
    case = specimen(seed, contacts=True).case
    mechanism, state = case.mechanism, case.states[0]
    known, found = determinate_forces(mechanism, state).reactions, []
    for engine in map(load_engine, ("exudyn", "reference")):
        answer = engine.instant(mechanism, [state], engine.methods(mechanism, Question.INSTANT)[0])
        assert answer.force_F is not None
        assert answer.torque_F is not None
        found.append(np.hstack([answer.force_F[0], answer.torque_F[0]])[known])
    np.testing.assert_allclose(*found, atol=1e-10 * np.max(np.abs(found[1])))


@pytest.mark.parametrize("seed", [35071, 9094])
def test_contacts_that_fit_in_no_way_at_rest_start_to_slide(seed):
    case = specimen(seed, contacts=True).case
    with pytest.raises(CannotRepresent, match="starts to slide"):
        accelerations("exudyn", case)


@pytest.mark.parametrize("engine", ["dart", "pinocchio"])
def test_impacts_with_friction_are_those_of_the_law_that_is_named(engine):
    """Two impacts without rebound, in which friction opposes the velocity before or, by Moreau's law, after."""
    engine, case, times = load_engine(engine), specimen(51006, contacts=True).case, np.linspace(0.0, 0.2, 11)
    method = engine.methods(case.mechanism, Question.TRAJECTORY)[0]
    assert method.law is not None
    laws = "newton", method.law.impact_law
    of_case, of_law = (simulate_with_contacts(case.mechanism, case.initial_state, times, 1e-12, law)[0] for law in laws)
    found = engine.trajectory(case.mechanism, case.initial_state, times, method, 5e-4)
    assert np.max(np.abs(of_law.p_WB - of_case.p_WB)) > 6e-3
    assert np.max(np.abs(found.p_WB - of_law.p_WB)) < 1e-3


@pytest.mark.parametrize("engine", ["dart", "exudyn", "mujoco", "pinocchio"])
@pytest.mark.parametrize("name", ["bounces_to_rest", "hinge_between_stops", "rod_hits_floor"])
def test_what_bounces_has_no_order_above_one(engine, name):
    engine, mechanism = load_engine(engine), load_cases(name)[0].mechanism
    if not engine.unsupported(mechanism, Question.TRAJECTORY):
        assert {method.order for method in engine.methods(mechanism, Question.TRAJECTORY)} == {1}


@pytest.mark.parametrize("engine", ["dart", "exudyn", "mujoco", "pinocchio"])
@pytest.mark.parametrize("name", ["ball_slips", "trough_slides", "tripod"])
def test_what_slides_without_a_rebound_has_an_extrapolated_method(engine, name):
    engine, mechanism = load_engine(engine), load_cases(name)[0].mechanism
    assert max(method.order for method in engine.methods(mechanism, Question.TRAJECTORY)) >= 3
