"""Steps of motions with contact: as many as events and curvature ask for."""

import numpy as np
import pytest

from consilience.case import load_cases
from consilience.errors import NumericalFailure
from consilience.mechanism import GROUND, Body, Frame, Joint, Mechanism, PointPlane, State
from consilience.reference.contact import simulate_with_contacts, simulation
from consilience.reference.contact.event_functions import EventFunctions
from consilience.reference.contact.events import Watch, first_zero, nodes_of
from consilience.reference.contact.simulation import ContactSimulation
from consilience.reference.contact.slip_headings import STOPPED


@pytest.mark.parametrize("name", ["bowling-backspin", "bounces_that_slide"])
def test_samples_lie_on_the_motion_and_cost_no_steps(name):
    """A parabola and a line, infinitely many bounces: the same samples whether they are few or many."""
    case = next(c for c in load_cases(name.partition("-")[0]) if c.name == name)
    m, start, end = case.mechanism, case.initial_state, case.times[-1]
    few, many = (simulate_with_contacts(m, start, np.linspace(0.0, end, n), 1e-12)[0] for n in (3, 301))
    assert many.counters["steps"] == few.counters["steps"]
    for part in ("p_WB", "v_WB_W", "w_WB_W", "contact_loss"):
        assert getattr(many, part)[::150] == pytest.approx(getattr(few, part), abs=1e-10)
    assert np.cumsum(many.contact_impulse, axis=0)[-1] == pytest.approx(np.sum(few.contact_impulse, axis=0), abs=1e-10)


def test_what_starts_to_slide_along_a_line_asks_for_no_short_steps():
    """Four feet and a push: slip from zero, across whose heading the equations are stiff without bound."""
    (case,) = load_cases("pulled_boxes")
    answer, events = simulate_with_contacts(case.mechanism, case.initial_state, case.times, 1e-12)
    assert [event.kind for event in events] == ["slips", "slips"]
    assert answer.counters["steps"] < 100


def test_a_motion_that_is_a_polynomial_of_time_asks_for_few_steps():
    """The integrator solves it exactly, impulses and losses too: steps grow from the first as fast as they may."""
    case = next(c for c in load_cases("block_incline") if c.name == "block_incline-down")
    answer, events = simulate_with_contacts(case.mechanism, case.initial_state, case.times, 1e-12)
    assert not [event for event in events if event.kind != "sticks"]
    assert answer.counters["steps"] <= 10


def test_steps_that_never_end_before_a_slip_has_passed_zero_end_the_motion_by_name(monkeypatch):
    """The middle of two neighbouring numbers is one of them: a step halved further would end there for ever."""
    case = next(c for c in load_cases("bowling") if c.name == "bowling-hook")
    monkeypatch.setattr(simulation.ContactSimulation, "_stops", lambda *_: False)
    monkeypatch.setattr(EventFunctions, "now", lambda *_: -1.0)
    with pytest.raises(NumericalFailure, match=r"t = 0\.60.*within what the time resolves"):
        simulate_with_contacts(case.mechanism, case.initial_state, case.times, 1e-12)


@pytest.mark.parametrize(("rise", "expected"), [(1e-17, None), (1e-3, (pytest.approx(0.5, abs=1e-12), 0))])
def test_a_gap_of_rounding_between_bodies_of_one_speed_never_closes(rise, expected):
    """``g = rise sin(2 pi t)``: of a gap that opens the zero is at 1/2, one of rounding has none."""

    def values(times):
        turn = 2.0 * np.pi * times[:, None]
        return rise * np.sin(turn), 2.0 * np.pi * rise * np.cos(turn)

    found = first_zero(values, nodes_of(0.0, 0.9, 1.0), np.zeros(1, dtype=bool), [Watch("gap", 0, 1.0)])
    assert found == expected


def test_touching_balls_that_are_hit_ask_for_no_step_but_those_of_the_motion():
    """Behind the impact two balls touch and move at one speed: what rounding makes of their gap is no event."""
    (case,) = load_cases("balls_touching")
    counts = []
    for tolerance in (1e-4, 1e-10):
        answer, events = simulate_with_contacts(case.mechanism, case.initial_state, case.times, tolerance)
        assert [event.kind for event in events] == ["impact", "opens"]
        counts.append(answer.counters["steps"])
    assert max(counts) <= 7  # four of the motion, and the impact


def test_feet_that_turn_about_one_axis_halt_together_though_one_moves_faster():
    """Slips a w and r w, the first slower than what counts as rest: where it halts, so does the other, ten times it."""
    near, reach, w = 0.2, 2.0, 4e-9
    X, Y, Z = np.eye(3)
    here = Frame(np.zeros(3), np.eye(3))
    table = Body("table", 2.0, 0.1 * X, np.diag([3.0, 3.0, 2.0]), here)
    weight = Body("weight", 0.7, np.zeros(3), np.diag([0.03, 0.04, 0.05]), here)
    axis = Joint("axis", "cylindrical", GROUND, "table", here, here)
    guide = Joint("guide", "prismatic", "table", "weight", Frame(reach * X, np.eye(3)), here)
    feet = (
        PointPlane("near", "table", near * Y, GROUND, np.zeros(3), Z, friction=0.3),
        PointPlane("far", "weight", np.zeros(3), GROUND, np.zeros(3), Z, friction=0.3),
    )
    mechanism = Mechanism("turntable", -9.81 * Z, (table, weight), (axis, guide), contacts=feet)
    still = State(np.array([0 * X, reach * X]), np.tile([1.0, 0, 0, 0], (2, 1)), np.zeros((2, 3)), np.zeros((2, 3)))
    moving = State(still.p_WB, still.quat_WB, np.array([0 * Y, reach * w * Y]), np.tile(w * Z, (2, 1)))
    simulation = ContactSimulation(mechanism, moving, np.array([0.0, 1.0]), 1e-10)
    slips = simulation.equations.rows.u.copy()
    assert near * w < STOPPED * simulation.speed < reach * w
    speeds = simulation.speed, simulation.speed
    halted, _ = simulation.small.halt(frozenset([0]), slips, np.ones(2, dtype=bool), speeds)
    assert halted == [row for one in simulation.layout.friction for row in one.rows]
    assert not np.any(slips[halted])
    assert simulation.stepper.state().w_WB_W == pytest.approx(0.0, abs=1e-20)


def test_what_leaves_its_line_turns_to_its_slip_even_from_behind():
    """Friction opposes the slip: a heading kept on its side would push what runs off by more than a right angle."""
    case = next(c for c in load_cases("bowling") if c.name == "bowling-skid")
    run = ContactSimulation(case.mechanism, case.initial_state, case.times, 1e-10)
    run._settle(frozenset(), {}, frozenset(), first=True)
    rows = run.equations.move(run.stepper.t, run.stepper.y, run.stepper.turns)
    slip = rows.u[list(run.layout.friction[0].rows)]
    size = np.linalg.norm(slip)
    for leaving, side in ((set(), -1.0), ({0}, 1.0)):
        run.stepper.turn((np.array([-0.6 * slip[0] + 0.8 * slip[1], -0.6 * slip[1] - 0.8 * slip[0]]) / size,))
        run.slips.leaving = leaving
        run.slips.turn(run.stepper, run.speed, run.speed)
        np.testing.assert_allclose(run.stepper.modes.heading[0], side * slip / size, atol=1e-12)
