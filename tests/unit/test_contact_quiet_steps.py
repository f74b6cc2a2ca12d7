"""Compiled steps in which nothing happens: those of Python, and none over an event."""

import numpy as np
import pytest

from consilience.case import load_cases
from consilience.mechanism import GROUND, SphereSphere
from consilience.reference.contact import simulate_with_contacts
from consilience.reference.contact.march import QuietSteps
from consilience.reference.contact.mode_system import sliding_indicator
from consilience.reference.contact.simulation import ContactSimulation
from consilience.reference.contact.stepper import Stepper
from contact_problems import Lab


def case_of(name):
    return next(case for case in load_cases(name.partition("-")[0]) if case.name == name)


def motion(name, tolerance=1e-10):
    case = case_of(name)
    return simulate_with_contacts(case.mechanism, case.initial_state, case.times, tolerance)[0]


@pytest.mark.parametrize(
    "name",
    ["tippe_top", "trough_rolls", "bowling-backspin", "ball_across_incline", "hinge_between_stops", "crank_at_a_stop"],
)
def test_quiet_steps_are_those_that_python_takes(name, monkeypatch):
    """Slip that turns, forces that are open, slip along a line to its end, impacts, a loop: one by one."""
    taken = []
    advance = Stepper.advance
    monkeypatch.setattr(Stepper, "advance", lambda self, bound: taken.append(bound) or advance(self, bound))
    marched, few = motion(name), len(taken)
    monkeypatch.setattr(QuietSteps, "watch", lambda *_: None)
    taken.clear()
    plain = motion(name)
    assert marched.counters["steps"] == plain.counters["steps"]
    assert few < 0.8 * len(taken)
    for part in ("p_WB", "v_WB_W", "w_WB_W", "contact_gap", "contact_impulse", "contact_loss", "event_time"):
        assert getattr(marched, part) == pytest.approx(getattr(plain, part), rel=1e-10, abs=1e-12)


def test_no_step_passes_over_a_gap_that_closes_between_the_nodes_of_a_step():
    """A ball of the speed 1 m/s, that overlaps with another one for 0.2 ms: it hits at the first instant of these."""
    lab, t = Lab(), 0.50313
    still = {"restitution": 0.0, "friction": 0.0}
    ball = SphereSphere("balls", "body", lab.com, 0.1, GROUND, lab.origin, 0.2, **still)
    mechanism = lab.free_body(1.5, (0.006, 0.006, 0.006), np.zeros(3), [ball])
    start = lab.state([-t, 0.0, np.sqrt(0.3**2 - 1e-8)], [1.0, 0.0, 0.0])
    answer, events = simulate_with_contacts(mechanism, start, np.linspace(0.0, 1.0, 3), 1e-10)
    assert [event.kind for event in events] == ["impact"]
    assert answer.event_time == pytest.approx([t - 1e-4], abs=1e-11)


def test_slip_along_a_line_keeps_to_it_whatever_the_tolerance():
    """The slip of a homogeneous ball keeps its direction; errors of the integration are no reason for short steps."""
    assert motion("bowling-hook", 1e-8).counters["steps"] < 120


def test_the_determinant_of_modes_bounds_how_far_sliding_is_from_jamming():
    """Against NumPy: ``det E G S`` with rows of length one, which is at most that over the one without friction."""
    case = case_of("tripod")
    run = ContactSimulation(case.mechanism, case.initial_state, case.times, 1e-10)
    run.integrate()
    equations, stepper = run.equations, run.stepper
    found = equations.determinant(stepper.t, stepper.y, stepper.turns)
    response = stepper.respond(stepper.t, stepper.y)
    G, scale, (S, E) = response.K @ response.K.T, np.linalg.norm(response.load, axis=0), equations.columns()
    weight = np.abs(E) @ scale
    assert found == pytest.approx(np.linalg.det((E @ G @ S) / np.outer(weight, weight)), rel=1e-10)
    assert 0.0 < found < 0.9 < sliding_indicator(G, scale, S, E)


def test_samples_beyond_the_room_for_them_are_of_steps_that_python_takes():
    """More samples in a step than there is room for: Python takes the step."""
    case = case_of("ball_rolls")
    times = np.linspace(0.0, 1.0, 5001)
    answer = simulate_with_contacts(case.mechanism, case.initial_state, times, 1e-10)[0]
    few = simulate_with_contacts(case.mechanism, case.initial_state, times[::1000], 1e-10)[0]
    assert answer.p_WB[::1000] == pytest.approx(few.p_WB, abs=1e-13)
    assert answer.contact_impulse.sum(axis=0) == pytest.approx(few.contact_impulse.sum(axis=0), rel=1e-12)
