"""Loads that change in time on what rests: nothing moves until a load exceeds a bound, at times in closed form.

A slider of 2 kg in a turned world. Friction holds it up to 9.81 N, or a stop carries its weight, 19.62 N.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from consilience.mechanism import (
    GROUND,
    Body,
    DryFriction,
    Frame,
    Joint,
    Load,
    Mechanism,
    SpherePlane,
    Stop,
    initial_state,
    sine,
    through,
)
from consilience.reference.contact import simulate_with_contacts
from mechanisms import rotation

TURN = rotation(np.random.default_rng(51))
MASS, WEIGHT, ZERO = 2.0, 19.62, np.zeros(3)
TORSION, REACH = 0.02, 0.5
"""Length of torsional friction, and bound of dry friction over the weight, m and 1."""


def slider(kind, **elements):
    """Body on a joint of a kind along, or about, z of the turned world, which gravity or its joint presses."""
    body = Body("slider", MASS, ZERO, np.diag([0.02, 0.03, 0.04]), Frame(ZERO, TURN))
    joint = Joint("joint", kind, GROUND, "slider", Frame(ZERO, TURN), Frame(ZERO, np.eye(3)))
    return Mechanism("rests", -WEIGHT / MASS * TURN[:, 2], (body,), (joint,), **elements)


def load(history, kind="force"):
    return (Load("load", kind, "slider", TURN[:, 2], "world", history=history),)


def ball(**law):
    return (SpherePlane("ball", "slider", ZERO, 0.1, GROUND, -0.1 * TURN[:, 2], TURN[:, 2], **law),)


def braked(history):
    """Slider without weight whose dry friction holds 9.81 N."""
    brake = DryFriction("brake", "joint", "distance", bound=REACH * WEIGHT)
    return replace(slider("prismatic", dry_frictions=(brake,), loads=load(history)), gravity=ZERO)


def events_of(mechanism, kind, tolerance, end=1.0):
    start = initial_state(mechanism)
    _, events = simulate_with_contacts(mechanism, start, np.array([0.0, 0.5 * end, end]), tolerance)
    return [one.time for one in events if one.kind == kind]


def crossings(level, frequency, every, end=1.0):
    """Times at which ``sin(w t)``, or its magnitude, rises above a level: once in a period, or in half of one."""
    times = (np.arcsin(level) + every * np.arange(int(frequency * end / every) + 1)) / frequency
    return times[times < end]


@pytest.mark.parametrize(("excess", "frequency"), [(1.01, 200.0), (1.2, 1000.0)])
@pytest.mark.parametrize("tolerance", [1e-8, 1e-12])
def test_dry_friction_breaks_away_in_each_half_of_a_period(excess, frequency, tolerance):
    """Each slip is over before the next begins: it takes back the momentum that the excess has given."""
    mechanism = braked(sine(excess * REACH * WEIGHT, frequency))
    slips = crossings(1.0 / excess, frequency, np.pi)
    assert events_of(mechanism, "slips", tolerance) == pytest.approx(slips, abs=1e-9 / frequency)


@pytest.mark.parametrize(("excess", "frequency"), [(1.01, 200.0), (1.2, 1000.0)])
def test_a_stop_is_left_in_each_period(excess, frequency):
    stop = Stop("stop", "joint", "distance", lower=0.0)
    mechanism = slider("prismatic", stops=(stop,), loads=load(sine(excess * WEIGHT, frequency)))
    opens = crossings(1.0 / excess, frequency, 2.0 * np.pi)
    assert events_of(mechanism, "opens", 1e-12) == pytest.approx(opens, abs=1e-9 / frequency)


def test_torsional_friction_loses_what_a_brake_of_the_same_bound_does():
    """A ball on the floor under a torque about its normal; a smooth ball with a brake in the joint."""
    torque = load(sine(1.05 * TORSION * WEIGHT, 300.0), "torque")
    brake = (DryFriction("brake", "joint", "angle", bound=TORSION * WEIGHT),)
    lost = []
    for elements in ({"contacts": ball(torsional=TORSION)}, {"contacts": ball(), "dry_frictions": brake}):
        mechanism = slider("cylindrical", loads=torque, **elements)
        answer, _ = simulate_with_contacts(mechanism, initial_state(mechanism), np.array([0.0, 0.5]), 1e-12)
        lost.append(answer.contact_loss[-1])
    assert lost[0] > 1e-6
    assert lost[1] == pytest.approx(lost[0], rel=1e-9)


@pytest.mark.parametrize("at", [0.162, 0.299, 0.437, 0.613, 0.871])
def test_no_step_passes_a_pulse_of_a_table(at):
    """Two milliseconds in one second, on what rests until then."""
    x = np.linspace(0.0, 1.0, 1001)
    pulse = through(x, np.where(np.abs(x - at) < 1.1e-3, 14.0, 0.0))
    begins = brentq(lambda t: pulse.at(t)[0] - REACH * WEIGHT, at - 2e-3, at - 1e-3, xtol=1e-15)
    assert events_of(braked(pulse), "slips", 1e-8) == pytest.approx([begins], abs=1e-9)
