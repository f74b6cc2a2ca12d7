"""A motion with contact checks itself against the laws, and tells row and time; friction that jams is told by name."""

import re

import numpy as np
import pytest

from consilience.case import load_cases
from consilience.errors import NumericalFailure
from consilience.mechanism import (
    GROUND,
    Body,
    Drive,
    Frame,
    Function,
    Initial,
    Joint,
    Mechanism,
    PointPlane,
    initial_state,
)
from consilience.reference.contact import simulate_with_contacts
from consilience.reference.contact.energy_balance import is_conservative
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.event_functions import EventFunctions
from consilience.reference.contact.march import QuietSteps
from contact_problems import LEVEL, Lab


def motion(name):
    (case, *_) = load_cases(name)
    return simulate_with_contacts(case.mechanism, case.initial_state, case.times, 1e-12)


def without(kind, monkeypatch):
    """Let a motion miss the events of one kind."""
    values = EventFunctions.at

    def missing(self, times, states, stepper):
        found, rates = values(self, times, states, stepper)
        for w, watch in enumerate(self.watches):
            if watch.kind == kind:
                found[:, w], rates[:, w] = watch.scale, 0.0
        return found, rates

    monkeypatch.setattr(EventFunctions, "at", missing)


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("gap", "bounces_to_rest", "contact 'floor', t = 0.5 s: shapes overlap"),
        ("normal", "ladder_leaves_wall", "contact 'head', t = 0.5 s: a contact pulls"),
        ("group", "breakaway", "contact 'foot.*', t = 2 s: friction is beyond its bound"),
        ("slip", "skew_slide_box", "contact 'floor.*', t = .* s: friction does not oppose the slip"),
    ],
)
def test_a_motion_that_misses_an_event_is_refused_with_row_and_time(kind, name, message, monkeypatch):
    without(kind, monkeypatch)
    with pytest.raises(NumericalFailure) as failure:
        motion(name)
    assert re.match(message, str(failure.value))


def test_a_motion_with_too_little_friction_is_refused(monkeypatch):
    """The compiled derivative is wrong alone: the laws know the coefficient of the contact."""
    activate = ContactEquations.activate

    def weaker(self, modes):
        activate(self, modes)
        self._modes.disc[:] *= 0.99

    monkeypatch.setattr(ContactEquations, "activate", weaker)
    with pytest.raises(NumericalFailure, match=r"contact 'floor', t = 0 s: friction does not oppose the slip"):
        motion("bowling")


@pytest.mark.parametrize("name", ["ball_slips", "dry_spring", "pendulum_at_a_stop", "ball_on_spring"])
def test_energy_that_vanishes_between_samples_is_told(name, monkeypatch):
    """The projection after a step takes a millionth of the speeds, which violates no law of contact at a sample."""
    project = ContactEquations.project

    def losing(self, t, Y, turns, halted=()):
        project(self, t, Y, turns, halted)
        bodies = len(self.model.mass)
        Y[: 13 * bodies].reshape(bodies, 13)[:, 7:13] *= 1.0 - 1e-6

    monkeypatch.setattr(ContactEquations, "project", losing)
    monkeypatch.setattr(QuietSteps, "watch", lambda *_: None)
    with pytest.raises(NumericalFailure, match=r"energy, t = \S+ s: it has changed by -\S+ J since the start"):
        motion(name)


def test_energy_that_drives_and_dampers_give_or_take_is_no_fault():
    for name in ("bouncing_table", "belt_catch", "breakaway"):
        answer, _ = motion(name)
        assert not is_conservative(load_cases(name)[0].mechanism)
        assert len(answer.time) > 1


def test_friction_that_jams_is_told_by_name_and_time():
    """A rod of length l, pushed over a belt, at phi from the normal: ``A = l^2 sin phi (sin phi - mu cos phi)/I``.

    Its hinge rises from 0.6 l at l/5 a second, until ``tan phi = mu`` at the height ``l/sqrt(1 + mu^2)``.
    """
    lab, length, mu = Lab(), 0.5, 0.8
    jams = (1.0 / np.sqrt(1.0 + mu**2) - 0.6) / 0.2
    lumpy = 1e-2 * np.array([[3.0, 0.2, -0.1], [0.2, 4.0, 0.3], [-0.1, 0.3, 5.0]])
    here = Frame(lab.origin, lab.axes)
    centres = {"carriage": np.zeros(3), "rod": np.array([0.0, 0.0, -0.25]), "belt": np.zeros(3)}
    bodies = tuple(Body(name, 1.0, com, lumpy, here) for name, com in centres.items())
    along_x, along_y = np.eye(3)[:, [1, 2, 0]], np.eye(3)[:, [2, 0, 1]]
    none = np.zeros(3)
    joints = (
        Joint("lift", "prismatic", GROUND, "carriage", here, Frame(none, np.eye(3))),
        Joint("hinge", "revolute", "carriage", "rod", Frame(none, along_y), Frame(none, along_y)),
        Joint("run", "prismatic", GROUND, "belt", Frame(lab.origin, lab.axes @ along_x), Frame(none, along_x)),
    )
    drives = (
        Drive("up", "lift", "distance", Function([0.6 * length, 0.2 * length])),
        Drive("on", "run", "distance", Function([0.0, -1.0])),
    )
    tip = PointPlane("tip", "rod", np.array([0.0, 0.0, -length]), "belt", none, np.array([0, 0, 1.0]), friction=mu)
    mechanism = Mechanism("chalk", lab.axes @ LEVEL, bodies, joints, drives=drives, contacts=(tip,))
    angle, rate = np.arccos(0.6), 0.2 / np.sin(np.arccos(0.6))
    start = initial_state(mechanism, Initial({"hinge": {"angle": -angle}}, {"hinge": {"angle": rate}}))
    with pytest.raises(NumericalFailure, match=r"contact 'tip', t = .*sliding friction jams") as failure:
        simulate_with_contacts(mechanism, start, np.linspace(0.0, 1.5, 4), 1e-10)
    assert float(re.search(r"t = ([0-9.]+) s", str(failure.value))[1]) == pytest.approx(jams, abs=1e-3)
