"""MuJoCo's soft contacts at its defaults: the law that its adapter names, solved by the reference, against MuJoCo."""

import mujoco
import numpy as np
import pytest

from consilience.case.library import load_cases
from consilience.compare.motion import difference_over_time, size_of_motion
from consilience.compare.result import Verdict
from consilience.compare.uncertainty import richardson
from consilience.engine import Profile, Question
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Mechanism,
    SpherePlane,
    State,
    contact_parts,
    rotation_from_quaternion,
)
from consilience.reference.contact import simulate_regularised, simulate_with_contacts
from consilience.reference.contact.regularised import _Regularised
from consilience.suite import Resources, run_suite
from consilience.suite.other_laws import with_law
from consilience_mujoco.engine import MujocoEngine
from consilience_mujoco.states import set_state

PLATEAU = 1e-3
"""Largest share that may be left of the difference to rigid contacts."""


def default_method(mechanism, name="Euler, defaults"):
    methods = MujocoEngine().methods(mechanism, Question.TRAJECTORY)
    return next(m for m in methods if m.profile is Profile.DEFAULT and m.name == name)


def ball_in_a_trough():
    """A ball, its origin in its middle, that sinks into the two smooth walls of a trough and slides along it."""
    frame = Frame(np.array([0.0, 0.1 * np.sqrt(2.0), 0.4]), np.eye(3))
    pose = np.array([0.8, -0.2, 0.4, 0.4])
    start = State(frame.p[None], pose[None], np.zeros((1, 3)), np.zeros((1, 3)))
    sides = {"left": np.array([0.0, 1.0, 1.0]), "right": np.array([0.2, -1.0, 1.0])}
    center = np.zeros(3)
    contacts = tuple(
        SpherePlane(name, "ball", center, 0.1, GROUND, frame.p - 0.1 * n / np.linalg.norm(n), n)
        for name, n in sides.items()
    )
    inertia = np.array([[0.011, 0.001, -0.002], [0.001, 0.013, 0.0005], [-0.002, 0.0005, 0.009]])
    mechanism = Mechanism(
        "trough",
        gravity=np.array([0.0, 0.0, -9.81]),
        bodies=(Body("ball", 1.7, center, inertia, frame),),
        joints=(Joint("flight", "free", GROUND, "ball", frame, Frame(np.zeros(3), np.eye(3))),),
        contacts=contacts,
    )
    return mechanism, start, np.linspace(0.0, 0.2, 5)


def box_that_tips():
    (case,) = load_cases("box_tips")
    return case.mechanism, case.initial_state, case.times


@pytest.mark.parametrize("problem", [ball_in_a_trough, box_that_tips])
def test_the_reference_with_the_law_of_the_adapter_moves_as_mujoco_does(problem):
    """The limit of MuJoCo's steps, of order one, is off by less than a thousandth of what softness makes."""
    mechanism, state, times = problem()
    method = default_method(mechanism)
    law = method.soft_law
    assert len(law.regularisation) == sum(len(contact_parts(c)) for c in mechanism.contacts)
    soft = simulate_regularised(with_law(mechanism, law), law.regularisation, state, times)
    rigid = simulate_with_contacts(mechanism, state, times, 1e-10)[0]
    size = size_of_motion(mechanism, rigid)
    steps = [(times[1] - times[0]) / n for n in (400, 800)]
    levels = [MujocoEngine().trajectory(mechanism, state, times, method, h) for h in steps]
    made, left = (float(np.max(difference_over_time(richardson(*levels, 1, 2.0), one, size))) for one in (rigid, soft))
    assert left < PLATEAU * made


@pytest.mark.parametrize("spin", [(0.0, 0.0, 0.0), (3.0, 10.0, -2.0)])
def test_accelerations_of_a_lumpy_ball_that_slides_and_spins_are_those_of_mujoco(spin):
    """Its origin is neither its middle nor its centre of mass: MuJoCo's a = J v' is of the velocity of the origin."""
    (case,) = load_cases("ball_slips")
    mechanism, start, engine = case.mechanism, case.initial_state, MujocoEngine()
    method, normal = default_method(mechanism), mechanism.contacts[0].normal
    p = start.p_WB - 1e-5 * normal / np.linalg.norm(normal)
    state = State(p, start.quat_WB, np.array([[0.3, 0.1, -0.2]]), np.array([spin]))
    translation = engine._prepare(mechanism, state, method)
    set_state(translation, state)
    data = translation.data
    mujoco.mj_forward(translation.model, data)
    assert data.ncon == 1
    law = method.soft_law
    soft = _Regularised(with_law(mechanism, law), law.regularisation, state)
    found = soft.derivative(0.0, soft.start)[7:13].reshape(2, 3)
    theirs = data.qacc[:6].reshape(2, 3)
    for accelerations, axes in (
        (found, rotation_from_quaternion(start.quat_WB[0])),
        (theirs, data.xmat[1].reshape(3, 3)),
    ):
        accelerations[1] = axes @ accelerations[1]
    np.testing.assert_allclose(found, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_the_verdict_on_soft_contacts_is_proved():
    """Through the workers, from the adapter's law to the reason: the box tips as the reference's with that law."""
    (case,) = load_cases("box_tips")
    results = run_suite([case], ["mujoco"], [Question.TRAJECTORY], resources=Resources(limit=400.0))
    why = {c.method: (c.verdict, c.why) for c in results.comparisons if c.engine == "mujoco"}
    verdict, reason = why["Euler, defaults"]
    assert verdict is Verdict.REGULARISATION
    assert reason.endswith("from the reference's motion with their law")
    assert float(reason.split("; differs by ")[-1].split()[0]) < PLATEAU * 1e-3
    assert why["Euler, defaults but elliptic"][1].endswith("not proved by re-solving")


def test_no_law_is_named_of_what_the_reference_cannot_solve():
    """Of other joints, stops and dry friction, of other cones, and of the matched settings there is none."""
    for name in ("crank_at_a_stop", "trough_rolls", "dry_spring"):
        (case,) = load_cases(name)
        assert default_method(case.mechanism).soft_law is None
    mechanism = box_that_tips()[0]
    assert default_method(mechanism, "Euler, defaults but elliptic").soft_law is None
    methods = MujocoEngine().methods(mechanism, Question.TRAJECTORY)
    assert all(m.soft_law is None for m in methods if m.profile is Profile.MATCHED)
