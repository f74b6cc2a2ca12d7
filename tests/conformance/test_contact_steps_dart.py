"""Steps of the DART adapter that are extrapolated: what presses stays closed, and turns are those of the spin."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from consilience.case import load_case
from consilience.engine import Question, Route
from consilience.mechanism import (
    GROUND,
    Body,
    BoxPlane,
    Drive,
    Frame,
    Initial,
    Joint,
    Mechanism,
    SpherePlane,
    SphereSphere,
    initial_state,
    linear,
)
from consilience_dart import DartEngine
from consilience_dart.contacts import INSIDE
from consilience_dart.small_turns import mend_rotations
from consilience_dart.stepping import stepper
from contact_problems import LEVEL, G, Lab, incline

LAB = Lab()
HERE = Frame(np.zeros(3), np.eye(3))
TIMES = np.linspace(0.0, 0.2, 11)


def extrapolated(mechanism, state, times, step):
    engine = DartEngine()
    methods = engine.methods(mechanism, Question.TRAJECTORY)
    method = next(m for m in methods if m.route is Route.EXTRAPOLATED)
    return engine.trajectory(mechanism, state, times, method, step)


def tipped(times):
    """Angles and rates of a box of 0.2 x 0.2 x 0.6 m that tips about an edge on an incline of 25 degrees."""
    arm, lever = np.hypot(0.1, 0.3), np.arctan2(0.1, 0.3)
    moment = (0.2**2 + 0.6**2) / 12.0 + arm**2  # about the edge, of 1 kg

    def rates(_, y):
        return [y[1], G * arm * np.sin(y[0] + np.radians(25.0) - lever) / moment]

    return solve_ivp(rates, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-13, atol=1e-14).y


def test_a_box_tips_about_its_edge_as_a_pendulum_with_the_declared_order():
    """Corners that turn leave their plane by the square of the step: contacts would act in some of the steps alone."""
    contact = BoxPlane(
        *("box", "body", LAB.com, np.array([0.1, 0.1, 0.3]), GROUND, LAB.origin, LAB.axes[:, 2]),
        orientation=LAB.principal,
        friction=0.6,
    )
    mechanism = LAB.free_body(2.0, (0.2 / 3.0, 0.2 / 3.0, 0.04 / 3.0), incline(25.0), [contact])
    angles, rates = tipped(TIMES)
    errors = []
    for step in (1e-2, 5e-3):
        found = extrapolated(mechanism, LAB.state((0.0, 0.0, 0.3), (0.0, 0.0, 0.0)), TIMES, step)
        centres = [LAB.centre(found, n) for n in range(len(TIMES))]
        spins = np.array([[w[0], w[1] - rate, w[2]] for (_, _, w), rate in zip(centres, rates, strict=True)])
        assert np.max(np.abs(spins)) < 5e-8
        truth = [[0.1 + np.hypot(0.1, 0.3) * np.sin(a - np.arctan2(0.1, 0.3)), 0.0] for a in angles]
        errors.append(np.max(np.abs(np.array([p[:2] for p, _, _ in centres]) - truth)))
    assert errors[1] < 1e-8
    assert errors[0] / errors[1] == pytest.approx(8.0, rel=0.3)


def on_a_ball(speed):
    """Smooth ball of 0.1 m at rest on one of 0.2 m, 0.3 rad from its top, that a lift moves upwards at a speed."""
    carrier = Body("carrier", 5.0, np.array([0.02, 0.03, -0.01]), 0.3 * np.eye(3), HERE)
    place = 0.3 * np.array([np.sin(0.3), 0.0, np.cos(0.3)])
    ball = Body("ball", 2.0, np.zeros(3), 8e-3 * np.eye(3), Frame(place, np.eye(3)))
    joints = (
        Joint("lift", "prismatic", GROUND, "carrier", HERE, HERE),
        Joint("free", "free", GROUND, "ball", HERE, HERE),
    )
    drive = Drive("drive", "lift", "distance", linear(speed))
    contact = SphereSphere("touch", "ball", np.zeros(3), 0.1, "carrier", np.zeros(3), 0.2)
    mechanism = Mechanism("balls", LEVEL, (carrier, ball), joints, drives=(drive,), contacts=(contact,))
    up = ((0.0, 0.0, speed), (0.0, 0.0, 0.0))
    return mechanism, initial_state(mechanism, Initial(velocities={"ball": up, "carrier": up}))


@pytest.mark.parametrize("speed", [0.0, 0.7])
def test_a_smooth_ball_slides_down_another_as_a_pendulum(speed):
    times = np.linspace(0.0, 0.24, 7)
    mechanism, state = on_a_ball(speed)
    truth = solve_ivp(
        lambda _, y: [y[1], G * np.sin(y[0]) / 0.3], (0.0, 0.24), [0.3, 0.0], t_eval=times, rtol=1e-12, atol=1e-13
    ).y[0]
    found = extrapolated(mechanism, state, times, 1.25e-3)
    apart = found.p_WB[:, 1] - found.p_WB[:, 0]
    np.testing.assert_allclose(np.arctan2(apart[:, 0], apart[:, 2]), truth, atol=2e-7)
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), 0.3, atol=2e-7)


def test_a_sphere_that_presses_no_more_has_its_own_size():
    """A smooth ball from rest at 0.3 rad leaves another where ``cos = 2/3 cos 0.3``."""
    mechanism, state = on_a_ball(0.0)
    stepping = replace(stepper(mechanism, state), mended=True)
    stepping.world.setTimeStep(1e-3)
    (sphere,) = stepping.touching._spheres.values()
    sizes = []
    for _ in range(400):
        stepping.step(1)
        sizes.append(sphere._shape.getRadius())
    z, apart = stepping.model.nodes[1].getWorldTransform().translation(), max(sizes)
    assert apart > 0.1 + 1e-5
    assert np.linalg.norm(z) > 0.31
    assert sizes[-1] == pytest.approx(0.1 + INSIDE, rel=0, abs=1e-15)


def test_a_ball_on_a_plane_that_moves_keeps_its_own_size():
    """A sphere that slides on a plane leaves it by rounding alone."""
    mechanism = LAB.free_body(2.0, (8e-3,) * 3, LEVEL, [LAB.sphere(0.1)])
    stepping = replace(stepper(mechanism, LAB.state((0, 0, 0.1), (1.0, 0, 0), (1.0, 2.0, 3.0))), mended=True)
    stepping.world.setTimeStep(1e-3)
    stepping.step(200)
    (sphere,) = stepping.touching._spheres.values()
    assert abs(sphere._shape.getRadius() - 0.1 - INSIDE) < 1e-11
    assert isinstance(mechanism.contacts[0], SpherePlane)


@pytest.mark.parametrize("start", [(1e-5, -2e-5, 1e-5), (0.4, -0.3, 0.8), (1.7, 1.5, -1.9)])
@pytest.mark.parametrize("turn", [2e-4, 9e-4, 3e-3])
def test_what_dart_adds_to_small_turns_is_taken_away(start, turn):
    """A turn t below 1e-3 rad that DART makes one of ``t + t^3/6`` is t; rotations of SciPy."""
    case = load_case("tippe_top")
    model = stepper(case.mechanism, case.initial_state).model
    first, axis = Rotation.from_rotvec(start), np.array([0.6, 0.0, 0.8])
    wrong = turn + turn**3 / 6.0 if turn < 1e-3 else turn
    q = model.skeleton.getPositions()
    q[:3] = (Rotation.from_rotvec(wrong * axis) * first).as_rotvec()
    model.skeleton.setPositions(q)
    mend_rotations(model, np.concatenate([start, q[3:]]))
    found = Rotation.from_rotvec(model.skeleton.getPositions()[:3])
    off = found * (Rotation.from_rotvec(turn * axis) * first).inv()
    assert np.linalg.norm(off.as_rotvec()) < 1e-15 + 0.6 * turn**5
