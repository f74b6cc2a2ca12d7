"""Contacts, stops and dry friction in MuJoCo, against closed forms; lumpy bodies in turned worlds."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import load_case
from consilience.engine import Profile, Question, Route, defects
from consilience.mechanism import (
    GROUND,
    Body,
    DiscPlane,
    DryFriction,
    Frame,
    Initial,
    Joint,
    Mechanism,
    SpherePlane,
    Stop,
    initial_state,
    rotation_with_z_axis,
)
from consilience.reference.contact import simulate_with_contacts
from contact_instants import PROBLEMS, error
from contact_motions import PROBLEMS as MOTIONS
from contact_problems import BALL, LEVEL, G, Lab, ball, close, pendulum, stacked, turned

pytest.importorskip("mujoco")

import mujoco

from consilience_mujoco import MujocoEngine
from consilience_mujoco.contact_motion import damping_ratio, rebound
from consilience_mujoco.messages import EngineWarningError
from consilience_mujoco.mutants import CONTACT_MUTANTS

I, T = Question.INSTANT, Question.TRAJECTORY
LAB = Lab()
CORNERS = [(x, y, -0.1) for x in (0.3, -0.3) for y in (0.3, -0.3)]
ENGINE = MujocoEngine()


def instant(mechanism, state):
    """Accelerations of the first body and forces of the contacts, in axes of the lab."""
    assert ENGINE.unsupported(mechanism, I) == ()
    answer = ENGINE.instant(mechanism, [state], ENGINE.methods(mechanism, I)[0])
    assert defects(answer, I, mechanism, 1) == []
    return (*LAB.acceleration(answer, state), answer.contact_force[0] @ LAB.axes)


def motion(mechanism, state, end, samples=20, level=-1, kind=Route.TUNED, profile=Profile.MATCHED, nth=0):
    assert ENGINE.unsupported(mechanism, T) == ()
    fits = [m for m in ENGINE.methods(mechanism, T) if m.profile is profile and m.route is kind]
    times = np.linspace(0.0, end, samples + 1)
    step = (times[1] - times[0]) / fits[nth].substeps[level]
    answer = ENGINE.trajectory(mechanism, state, times, fits[nth], step)
    assert defects(answer, T, mechanism, len(times)) == []
    return answer


def test_an_instant_of_an_impact_is_refused():
    with pytest.raises(EngineWarningError, match=r"closes at 0\.5 m/s"):
        instant(ball(LAB, 0.5, (0, 0, 0)), LAB.state([0, 0, 0.1], [0, 0, -0.5]))


def test_a_ball_bounces_with_its_restitution_whatever_its_mass():
    """The spring holds the ball for pi / 1000 s; a softness of a quarter is sixteen times the stiffness."""
    t1, u = np.sqrt(2.0 / G), np.sqrt(2.0 * G)
    later = 0.7 - t1
    truth = [0, 0, 0.1 + 0.5 * u * later - 0.5 * G * later**2], [0, 0, 0.5 * u - G * later]
    for mass, softness, bar in ((1.3, 1.0, 3e-2), (40.0, 0.25, 1e-2)):
        mechanism = LAB.free_body(mass, [0.4 * mass * 0.01] * 3, LEVEL, [LAB.sphere(0.1, restitution=0.5)])
        method = replace(ENGINE.methods(mechanism, T)[0], softness=softness)
        answer = ENGINE.trajectory(
            mechanism, LAB.state([0, 0, 1.1], [0, 0, 0]), np.linspace(0, 0.7, 15), method, 2.5e-5
        )
        close(LAB.centre(answer)[:2], truth, bar)


def test_the_rebound_of_a_damping_ratio():
    for restitution in (1.0, 0.8, 0.5, 0.2, 0.01):
        assert rebound(damping_ratio(restitution)) == pytest.approx(restitution, abs=1e-12)
    assert rebound(1.0) == pytest.approx(np.exp(-2.0))


def test_a_stop_without_restitution_catches_a_joint_that_the_tree_passes_backwards():
    here = Frame(np.zeros(3), np.eye(3))
    hinge = Joint("hinge", "revolute", "wheel", GROUND, here, here)
    wheel = Body("wheel", 1.0, np.zeros(3), 0.5 * np.eye(3), here)
    stop, brake = Stop("stop", "hinge", "angle", -1.0, 0.2), DryFriction("brake", "hinge", "angle", 0.3)
    mechanism = Mechanism("wheel", np.zeros(3), (wheel,), (hinge,), stops=(stop,), dry_frictions=(brake,))
    state = initial_state(mechanism, Initial({"hinge": {"angle": 0.0}}, {"hinge": {"angle": 3.0}}))
    start = ENGINE.instant(mechanism, [state], ENGINE.methods(mechanism, I)[0])
    close((start.alpha_WB_W,), ([0.0, 0.0, 0.6],), 1e-12)
    answer = motion(mechanism, state, 0.2, 4)
    close((2.0 * np.arctan2(answer.quat_WB[-1, 0, 3], answer.quat_WB[-1, 0, 0]),), (-0.2,), 1e-3)


def test_dry_friction_brakes_a_loop():
    """By CG the solver stopped early, at 1e-4 of the forces: no answer."""
    case = load_case("slider_crank").with_span(0.25, None)
    braked = replace(case.mechanism, dry_frictions=(DryFriction("dry", "slide", "distance", bound=3.0),))
    state = initial_state(braked, case.initial)
    right, _ = simulate_with_contacts(braked, state, case.times, 1e-10)
    answer = ENGINE.trajectory(braked, state, case.times, ENGINE.methods(braked, T)[0], case.sample / 50)
    free, _ = simulate_with_contacts(case.mechanism, state, case.times, 1e-10)
    assert np.max(np.abs(free.p_WB - right.p_WB)) > 1e-3
    close((answer.p_WB,), (right.p_WB,), 1e-6)


def at_defaults(mechanism, state, softness):
    """Return a motion of 1 s at MuJoCo's defaults, with their softness scaled."""
    method = next(m for m in ENGINE.methods(mechanism, T) if m.profile is Profile.DEFAULT)
    assert method.softness == 1.0
    times = np.linspace(0.0, 1.0, 11)
    return ENGINE.trajectory(mechanism, state, times, replace(method, softness=softness), 5e-4)


@pytest.mark.parametrize("softness", [0.01, 0.0025])
def test_a_ball_at_rest_at_the_defaults_sinks_by_the_softness(softness):
    """``R N = k d r``: R is (1 - d)/d over the mass times the softness, d is 0.9, k is 1/(0.95 0.02 s)^2."""
    mechanism = LAB.free_body(1.3, [0.4 * 1.3 * 0.01] * 3, LEVEL, [LAB.sphere(0.1, friction=0.0)])
    centre = LAB.centre(at_defaults(mechanism, LAB.state([0, 0, 0.1], [0, 0, 0]), softness))[0]
    assert 0.1 - centre[2] == pytest.approx(softness * (0.1 / 0.9) * G * (0.95 * 0.02) ** 2 / 0.9, rel=1e-3)


LEVER = """
<mujoco><worldbody>
  <geom name="floor" type="plane" size="0 0 1" pos="0 0 -.05" contype="0" conaffinity="0"/>
  <body><joint axis="0 1 0"/><inertial pos=".5 0 .1" mass="2" diaginertia=".03 .2 .21"/>
    <geom name="tip" type="sphere" size=".05" pos="1 0 0" mass="0" contype="0" conaffinity="0"/></body>
</worldbody><contact><pair geom1="floor" geom2="tip" condim="1"/></contact></mujoco>"""


def test_a_lever_at_rest_at_the_defaults_sinks_as_in_a_model_that_mujoco_reads_itself():
    model = mujoco.MjModel.from_xml_string(LEVER)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    lever = Body("lever", 2.0, np.array([0.5, 0.0, 0.1]), np.diag([0.03, 0.2, 0.21]), Frame(np.zeros(3), np.eye(3)))
    hinge = Frame(np.zeros(3), rotation_with_z_axis(np.array([0.0, 1.0, 0.0])))
    pin = Joint("pin", "revolute", GROUND, "lever", hinge, hinge)
    tip = SpherePlane("tip", "lever", np.array([1.0, 0.0, 0.0]), 0.05, GROUND, np.array([0.0, 0.0, -0.05]), -LEVEL / G)
    mechanism = Mechanism("lever", LEVEL, (lever,), (pin,), contacts=(tip,))
    start = initial_state(mechanism, Initial())
    answer = motion(mechanism, start, 2.0, kind=Route.NATIVE, profile=Profile.DEFAULT, level=1)
    assert answer.contact_gap[-1] == pytest.approx(data.contact.dist, rel=1e-6)


@pytest.mark.parametrize("softness", [1.0, 0.01])
def test_dry_friction_that_sticks_at_the_defaults_creeps_by_the_softness(softness):
    """``R T = b v``: R is in proportion to the softness, b = 2/(0.95 0.02 s) to one over its root."""
    mechanism = pendulum(LAB, bound=0.5)
    state = initial_state(mechanism, Initial({"hinge": {"angle": 0.05}}))
    w = (LAB.axes.T @ at_defaults(mechanism, state, softness).w_WB_W[-1, 0])[1]
    creep = (0.1 / 0.9) * 3.0 * 0.5 * G * np.sin(0.05) * 0.5 * 0.95 * 0.02
    assert -w == pytest.approx(softness**1.5 * creep, rel=0.03)


LEVEL_LAB = Lab(axes=np.eye(3), principal=turned(0.0, 0.0, 0.4))
TILTED_LAB = Lab(axes=rotation_with_z_axis([1.0, 2.0, 2.0], [1.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("lab", "stops"),
    [(LEVEL_LAB, (1.14678899082569, 0.993148398835365)), (TILTED_LAB, (1.44277502802545, 0.727896726196555))],
    ids=["level", "tilted"],
)
def test_the_defaults_have_a_pyramid_with_axes_from_the_world(lab, stops):
    """The block of the skew slide stops where the law says that the method declares, not where the circle says."""
    mechanism = lab.free_body(2.0, (0.0667, 0.0667, 0.12), LEVEL, lab.points(CORNERS, friction=0.4))
    state = lab.state([0, 0, 0.1], 3.0 * np.array([np.cos(np.pi / 6), 0.5, 0.0]))
    circle = np.array([0.993148398835365, 0.573394495412844])
    for nth, truth in ((0, stops), (1, circle)):
        answer = motion(mechanism, state, 1.3, 26, 1, Route.NATIVE, Profile.DEFAULT, nth)
        close((lab.centre(answer)[0][:2],), (truth,), 0.01)
    close((lab.centre(motion(mechanism, state, 1.3, 26, 0))[0][:2],), (circle,), 1e-4)
    law = ENGINE.methods(mechanism, T)[2].law
    t1, _ = law.cone.tangents(lab.axes[:, 2])
    assert (law.cone.kind, law.cone.facets, law.cone.offset) == ("pyramid", 4, 0.0)
    assert abs(t1 @ lab.axes[:, 2]) < 1e-12


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        (lambda: LAB.sphere(0.1, restitution=0.5, friction=0.1), "depends on friction and on the masses"),
        (lambda: LAB.sphere(0.1, friction=0.1, rolling=0.01), "one ellipsoid"),
        (lambda: LAB.sphere(0.1, friction=0.1, static_friction=0.2), "one coefficient"),
        (
            lambda: DiscPlane("d", "body", LAB.com, np.array([1.0, 0, 0]), 0.1, GROUND, LAB.origin, LAB.axes[:, 2]),
            "rim",
        ),
    ],
)
def test_what_mujoco_cannot_represent_is_named_with_the_reason(contact, words):
    refused = ENGINE.unsupported(LAB.free_body(2.0, BALL, LEVEL, [contact()]), T)
    assert len(refused) == 1
    assert words in refused[0].reason


def test_only_the_declared_pairs_collide():
    """A second body falls through the floor and through the first, which have pairs of their own."""
    mechanism, state = stacked(LAB, 0.0, upper=False)
    answer = motion(mechanism, state, 0.2, 4, 0)
    close((LAB.axes[:, 2] @ answer.v_WB_W[-1, 1],), ([-0.2 * G],), 1e-9)


def at_instant(name):
    assert error(ENGINE, PROBLEMS[name]()) < 1e-10


def at_motion(name):
    problem = MOTIONS[name]()
    method = ENGINE.methods(problem.mechanism, T)[0]
    assert problem.error(problem.answered(ENGINE, method, 10, 100)) < 2e-3


PLANTED = {
    "friction of one partner, MuJoCo": lambda: at_instant("ball that slides, pushed"),
    "restitution squared, MuJoCo": test_a_ball_bounces_with_its_restitution_whatever_its_mass,
    "normal of the partner, MuJoCo": lambda: at_instant("ball that rolls, pushed"),
    "contact at another point, MuJoCo": lambda: at_instant("feet that turn and slide"),
    "torsional friction on": lambda: at_motion("ball that slips, then rolls"),
    "pyramid for the circle": lambda: at_motion("tripod"),
    "soft friction": lambda: at_motion("box that stops on a slope"),
}
"""Tests that catch errors planted in the adapter."""


@pytest.mark.parametrize("mutant", CONTACT_MUTANTS, ids=lambda mutant: mutant.name)
def test_planted_errors_are_caught(mutant, monkeypatch):
    with mutant.plant(MujocoEngine(), mutant.magnitudes[0]) as planted:
        monkeypatch.setitem(globals(), "ENGINE", planted)
        with pytest.raises((AssertionError, EngineWarningError)):  # the pyramid's motion diverges
            PLANTED[mutant.name]()
