"""Analyses where contacts, stops or dry friction act, of whose forces their equations know nothing.

A slider of 1 kg on a spring of 100 N/m, whose rest is 1 m away, with a wall after 0.2 m: it rests at the wall, and
neither at the rest of the spring nor with the frequency of the free slider.
"""

from dataclasses import replace

import numpy as np
import pytest

import consilience as cs
from consilience.case import Case
from consilience.compare.instants import Instants
from consilience.engine import Question
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    DryFriction,
    Frame,
    Initial,
    Joint,
    JointSpring,
    Mechanism,
    SpherePlane,
    Stop,
    initial_state,
)
from consilience.reference import ForwardDynamics
from consilience.reference.analyses import (
    count_freedom,
    driven_dynamics,
    inverse_dynamics,
    inverse_kinematics,
    kinematic_motion,
    linearise,
    linearise_steady_motion,
    sensitivity,
    static_equilibrium,
    trajectory_sensitivity,
)
from consilience.report.anatomy import anatomy
from consilience.report.record import lines
from consilience.suite import Results

X, Z, ZERO = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3)
ALONG_X = Frame(ZERO, np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))


def slider(rest, **elements):
    body = Body("slider", 1.0, ZERO, 0.1 * np.eye(3), Frame(ZERO, np.eye(3)))
    joint = Joint("slide", "prismatic", GROUND, "slider", ALONG_X, ALONG_X)
    spring = JointSpring("spring", "slide", "distance", 100.0, 0.0, rest)
    return Mechanism("slider", ZERO, (body,), (joint,), joint_springs=(spring,), **elements)


ACTING = {
    "contact 'wall'": {"contacts": (SpherePlane("wall", "slider", ZERO, 0.1, GROUND, 0.3 * X, -X),)},
    "stop 'end'": {"stops": (Stop("end", "slide", "distance", upper=0.2),)},
    "dry friction 'guide'": {"dry_frictions": (DryFriction("guide", "slide", "distance", bound=200.0),)},
}


def at(mechanism, distance):
    return initial_state(mechanism, Initial(coordinates={"slide": {"distance": distance}}))


@pytest.mark.parametrize("name", ACTING)
def test_analyses_refuse_by_name_what_acts_and_is_none_of_their_forces(name):
    mechanism, still = slider(1.0, **ACTING[name]), {"slide": {"distance": 0.0}}
    held, times = replace(mechanism, joint_springs=()), np.linspace(0.0, 1.0, 3)
    motion = kinematic_motion(held, {("slide", "distance"): lambda t: (0.2 * t, 0.2, 0.0)}, times, at(held, 0.0))
    wall = at(mechanism, 0.2)
    for analysis in (
        lambda: static_equilibrium(mechanism, at(mechanism, 0.0)),
        lambda: linearise(mechanism, wall),
        lambda: linearise_steady_motion(mechanism, wall, ()),
        lambda: inverse_dynamics(mechanism, wall, still),
        lambda: driven_dynamics(held, motion),
        lambda: trajectory_sensitivity(mechanism, lambda m: at(m, 0.0), times, ["body.slider.mass"]),
        lambda: ForwardDynamics(mechanism),
    ):
        with pytest.raises(InvalidInput, match=name):
            analysis()


def test_a_sensitivity_of_a_motion_with_contacts_is_told_where_it_is_found():
    """A box slides to rest in the way v^2/(2 mu g), whose derivative by mu is -1/mu of it."""
    draw = cs.Drawing("box", gravity=(0.0, 0.0, -9.81))
    draw.body("box", mass=2.0, inertia=(0.03, 0.03, 0.05), at=(0.0, 0.0, 0.1))
    draw.joint("flight", "free", "ground", "box", at=(0.0, 0.0, 0.1))
    floor = {"point": (0.0, 0.0, 0.0), "normal": (0.0, 0.0, 1.0), "friction": 0.3}
    draw.add("contact", "floor", body="box", at=(0.0, 0.0, 0.1), half_sizes=(0.2, 0.2, 0.1), **floor)
    case, times = draw.case(rates={"flight": {"position": [1.0, 0.0, 0.0]}}), [0.0, 1.0]
    paths = ["contact.floor.friction"]
    with pytest.raises(InvalidInput, match=r"contact 'floor': .* no contact.*Use sensitivity: differences"):
        trajectory_sensitivity(case.mechanism, lambda m: case.initial_state, times, paths)
    found = sensitivity(case.mechanism, lambda m: cs.simulate(m, case.initial_state, times).p_WB[-1, 0, 0], paths)
    assert found.value == pytest.approx(1.0 / (2.0 * 0.3 * 9.81), rel=1e-10)
    assert found.derivatives[0] == pytest.approx(-1.0 / (2.0 * 0.3**2 * 9.81), rel=1e-8)


@pytest.mark.parametrize("name", ACTING)
def test_instants_know_whether_anything_acts_at_one_of_their_states(name):
    mechanism = slider(1.0, **ACTING[name])
    away, near = at(mechanism, 0.1), at(mechanism, 0.2)
    assert Instants.of(mechanism, [away, near]).touching
    assert Instants.of(mechanism, [away]).touching == (name == "dry friction 'guide'")


@pytest.mark.parametrize("name", list(ACTING)[:2])
def test_what_nothing_touches_vibrates_as_without_walls(name):
    mechanism = slider(0.1, **ACTING[name])
    rests = static_equilibrium(mechanism, at(mechanism, 0.0))
    assert rests.p_WB[0] == pytest.approx([0.1, 0.0, 0.0], abs=1e-12)
    assert linearise(mechanism, rests).frequencies == pytest.approx([10.0], abs=1e-8)
    assert inverse_dynamics(mechanism, rests, {"slide": {"distance": 2.0}}).efforts["slide"]["distance"] == (
        pytest.approx(2.0, abs=1e-10)
    )


def test_turns_of_a_driven_joint_tell_whether_its_stop_is_reached():
    """A stop at 7 rad, driven through 6.9 rad, which a pose alone does not tell from 0.6 rad."""
    body = Body("arm", 1.0, ZERO, 0.1 * np.eye(3), Frame(ZERO, np.eye(3)))
    hinge = Joint("hinge", "revolute", GROUND, "arm", Frame(ZERO, np.eye(3)), Frame(ZERO, np.eye(3)))
    for end in (7.0, 6.9, 6.5):
        arm = Mechanism("arm", ZERO, (body,), (hinge,), stops=(Stop("end", "hinge", "angle", upper=end),))
        turning = {("hinge", "angle"): lambda t: (6.9 * t * t, 13.8 * t, 13.8)}
        if end == 6.5:
            with pytest.raises(
                InvalidInput, match=r"stop 'end': angle 6\.[5-9].* of 'hinge' is beyond the limit 6\.5 .* at "
            ):
                kinematic_motion(arm, turning, np.linspace(0.0, 1.0, 11), initial_state(arm))
            continue
        motion = kinematic_motion(arm, turning, np.linspace(0.0, 1.0, 11), initial_state(arm))
        if end == 7.0:
            assert driven_dynamics(arm, motion).efforts["hinge"]["angle"] == pytest.approx(1.38, abs=1e-12)
            continue
        with pytest.raises(InvalidInput, match=r"stop 'end'.*is 6\.9"):
            driven_dynamics(arm, motion)


@pytest.mark.parametrize("name", list(ACTING)[:2])
def test_no_driven_motion_passes_through_a_wall_or_beyond_a_stop(name):
    """Driven by 0.3 t, the slider reaches both at 2/3 s, touches for a moment there, and is never beyond 0.2 m."""
    mechanism, times = replace(slider(1.0, **ACTING[name]), joint_springs=()), np.linspace(0.0, 1.0, 7)
    touching = {("slide", "distance"): lambda t: (0.2 * np.sin(np.pi * t), 0.0, 0.0)}
    assert len(kinematic_motion(mechanism, touching, times, at(mechanism, 0.0)).states) == 7
    through = {("slide", "distance"): lambda t: (0.3 * t, 0.3, 0.0)}
    with pytest.raises(InvalidInput, match=rf"{name}: .* by .* at 0\.[6-9].*Drive it elsewhere, or leave it out"):
        kinematic_motion(mechanism, through, times, at(mechanism, 0.0))


def test_parameters_of_a_mechanism_with_a_wall_are_refused():
    free = replace(slider(1.0), joint_springs=())
    walled = replace(free, **ACTING["contact 'wall'"])
    with pytest.raises(InvalidInput, match="contact 'wall'"):
        ForwardDynamics(free).parameters([free, walled])


@pytest.mark.parametrize("name", list(ACTING)[:2])
def test_no_pose_is_found_through_a_wall_or_beyond_a_stop(name):
    """The wall and the stop let the slider go by 0.2 m, and touch there."""
    mechanism = slider(1.0, **ACTING[name])
    start = at(mechanism, 0.0)
    reached = inverse_kinematics(mechanism, "slider", ZERO, 0.2 * X, start)
    assert reached.p_WB[0] == pytest.approx([0.2, 0.0, 0.0], abs=1e-12)
    with pytest.raises(InvalidInput, match=rf"{name}: .* by 0\.1 .*in the pose that meets the target"):
        inverse_kinematics(mechanism, "slider", ZERO, 0.3 * X, start)


def test_a_reaction_that_a_support_shares_is_undetermined():
    """A beam that is clamped at one end and lies on a floor at the other, 1 m away: the floor's force N is open.

    With it are the clamp's force along z and its torque about y, by moments about the clamp.
    """
    beam = Body("beam", 1.0, 0.5 * X, 0.1 * np.eye(3), Frame(ZERO, np.eye(3)))
    clamp = Joint("clamp", "rigid", GROUND, "beam", Frame(ZERO, np.eye(3)), Frame(ZERO, np.eye(3)))
    for height, undetermined in ((0.0, {"clamp": ("force z", "torque y")}), (-0.01, {})):
        floor = SpherePlane("floor", "beam", X, 0.1, GROUND, (height - 0.1) * Z, Z)
        mechanism = Mechanism("beam", -9.81 * Z, (beam,), (clamp,), contacts=(floor,))
        state = initial_state(mechanism)
        assert count_freedom(mechanism, state).undetermined == tuple(undetermined)
        assert anatomy(mechanism, state).undetermined == undetermined
        found = lines(Results([Case.of(mechanism, duration=1.0, sample=0.1)], [Question.INSTANT]), 0.0)
        (case,) = [line for line in found if line["record"] == "case"]
        assert case["undetermined"] == {joint: [0, 0, 20, 0, 20, 0] for joint in undetermined}
