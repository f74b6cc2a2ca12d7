"""Planted errors of contact in the Pinocchio and DART adapters are far off the closed forms that the adapters meet."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.engine import CannotRepresent, Question
from consilience.mechanism import GROUND, Body, Frame, Initial, Joint, Mechanism, Stop, initial_state
from consilience_dart import DartEngine
from consilience_dart.mutants import CONTACT_MUTANTS as IN_DART
from consilience_pinocchio import PinocchioEngine
from consilience_pinocchio.mutants import CONTACT_MUTANTS as IN_PINOCCHIO
from contact_problems import LEVEL, G, Lab, fallen_rod

LAB = Lab()
ENGINES = {"pinocchio": PinocchioEngine, "dart": DartEngine}


def ball(**law):
    """Ball of 2 kg and 0.11 m on the floor, inside a larger one that touches another floor alone, far below."""
    ghost = replace(LAB.sphere(0.2, "ghost"), point=LAB.origin - 5.0 * LAB.axes[:, 2])
    return LAB.free_body(2.0, (0.8 * 0.11**2,) * 3, LEVEL, [LAB.sphere(0.11, **law), ghost])


def at(engine, mechanism, state):
    found = engine.instant(mechanism, [state], engine.methods(mechanism, Question.INSTANT)[0])
    return LAB.acceleration(found, state), found.contact_force[0] @ LAB.axes


def sliding(engine):
    """Acceleration, spin and force of a ball that slides."""
    mechanism, state = ball(friction=0.5), LAB.state((0, 0, 0.11), (3.0, 0, 0))
    (a, alpha), forces = at(engine, mechanism, state)
    spin = 0.5 * G * 0.11 / (0.4 * 0.11**2)
    return [a / G - [-0.5, 0, 0], alpha / spin - [0, 1.0, 0], forces[0] / (2 * G) - [-0.5, 0, 1.0]]


def turning(engine):
    """Normal force at the tip of a rod; at rest, where an engine refuses a tip that turns."""
    rate = 0.0 if isinstance(engine, DartEngine) else 2.0
    mechanism, state, alpha, normal = fallen_rod(LAB, 0.8, rate)
    (_, found), forces = at(engine, mechanism, state)
    return [found[1] / alpha - 1.0, forces[0] / normal - [0, 0, 1.0]]


def motion(engine, mechanism, state, time):
    method = engine.methods(mechanism, Question.TRAJECTORY)[0]
    return engine.trajectory(mechanism, state, np.array([0.0, time]), method, 1e-3)


def skidding(engine):
    """Velocity and height of a ball that slides at an angle to all axes."""
    along = np.array([np.cos(0.5), np.sin(0.5), 0.0])
    found = motion(engine, ball(friction=0.2), LAB.state((0, 0, 0.11), 3.0 * along), 0.1)
    p, v, _ = LAB.centre(found)
    return [v - (3.0 - 0.02 * G) * along, p[2] - 0.11]


def bouncing(engine):
    """Speed of rebound, and where the ball turns, without gravity."""
    mechanism = replace(ball(restitution=0.5), gravity=np.zeros(3))
    found = motion(engine, mechanism, LAB.state((0, 0, 0.151), (0, 0, -2.0)), 0.04)
    p, v, _ = LAB.centre(found)
    return [v[2] - 1.0, (p[2] - 0.11 - (0.04 - 0.0205)) / 10.0]


def stopping(engine):
    """End of a hinge that the tree passes backwards on the nearer of two stops."""
    here = Frame(np.zeros(3), np.eye(3))
    hinge = Joint("hinge", "revolute", "wheel", GROUND, here, here)
    wheel, stop = Body("wheel", 1.0, np.zeros(3), 0.5 * np.eye(3), here), Stop("stop", "hinge", "angle", -1.0, 0.2)
    mechanism = Mechanism("stopped", np.zeros(3), (wheel,), (hinge,), stops=(stop,))
    state = initial_state(mechanism, Initial({"hinge": {"angle": 0.0}}, {"hinge": {"angle": 3.0}}))
    found = motion(engine, mechanism, state, 0.2)
    return [2.0 * np.arctan2(found.quat_WB[-1, 0, 3], found.quat_WB[-1, 0, 0]) + 0.2]


CHECKS = (sliding, turning, skidding, bouncing, stopping)


def off(engine):
    """Largest difference to the closed forms; infinite where the engine refuses or fails."""
    worst = 0.0
    for check in CHECKS:
        try:
            worst = max(worst, *(float(np.max(np.abs(value))) for value in check(engine)))
        except (ArithmeticError, CannotRepresent):
            return np.inf
    return worst


@pytest.mark.parametrize("name", ENGINES)
def test_the_adapters_meet_the_closed_forms(name):
    assert off(ENGINES[name]()) < 2e-4


@pytest.mark.parametrize(
    ("name", "mutant"),
    [("pinocchio", m) for m in IN_PINOCCHIO] + [("dart", m) for m in IN_DART],
    ids=lambda x: x if isinstance(x, str) else x.name,
)
def test_a_planted_error_is_far_off(name, mutant):
    with mutant.plant(ENGINES[name](), mutant.magnitudes[0]) as engine:
        assert off(engine) > 1e-3
