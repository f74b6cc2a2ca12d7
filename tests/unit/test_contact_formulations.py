"""Time stepping beside the motion from event to event: a closed form, its band, and what the band catches."""

from dataclasses import replace

import numpy as np
import pytest

from consilience import Drawing, simulate
from consilience.audit.formulations.contacts import FLOOR, LEVELS, SAFETY, TIMES, band_of, campaign, compare, summary
from consilience.audit.fuzz.population import specimen
from consilience.audit.random_contacts import random_contacts
from consilience.errors import NumericalFailure
from consilience.mechanism import State, contact_parts, rotation_from_quaternion
from consilience.reference.contact import simulate_with_contacts, time_stepping
from consilience.reference.contact.decision import decide
from consilience.reference.contact.problem import ContactProblem
from consilience.reference.contact.time_stepping import step_with_contacts
from contact_problems import BALL, FEET, LEVEL, G, Lab


def test_a_block_stops_within_a_step_of_where_friction_has_used_its_energy():
    """``x = v^2 / (2 mu g)``: steps are exact but for the one in which it stops, off by ``mu g h^2 / 2`` at most."""
    lab, mu, v, h = Lab(), 0.35, np.array([1.2, 0.9, 0.0]), 0.01
    mechanism = lab.free_body(2.0, (0.02, 0.03, 0.04), LEVEL, lab.points(FEET, friction=mu))
    motion = step_with_contacts(mechanism, lab.state([0, 0, 0.1], v), np.array([0.0, 0.6]), 60)
    state = State(motion.p_WB[-1], motion.quat_WB[-1], motion.v_WB_W[-1], motion.w_WB_W[-1])
    centre = lab.axes.T @ (state.p_WB[0] + state.R_WB[0] @ lab.com - lab.origin)
    stop = v * np.linalg.norm(v) / (2 * mu * G) + [0.0, 0.0, 0.1]
    assert np.linalg.norm(centre - stop) < 0.5 * mu * G * h**2
    assert np.linalg.norm(state.v_WB_W) < 1e-10
    normal, *_ = np.sum(motion.impulse[-1].reshape(-1, 3), axis=0)
    assert normal == pytest.approx(2.0 * G * 0.6, rel=1e-10)


def test_time_stepping_lifts_what_slides_under_an_associated_cone_by_one_order():
    """The first hop is ``(mu u / (1 + mu^2))^2 / (2 g)`` high."""
    lab, mu, v = Lab(), 0.4, np.array([1.2, 0.9, 0.0])
    mechanism = lab.free_body(2.0, (0.02, 0.03, 0.04), LEVEL, lab.points(FEET, friction=mu, associated=True))
    rise = mu * 1.5 / (1 + mu**2)
    heights = []
    for steps in (50, 100):
        motion = step_with_contacts(mechanism, lab.state([0, 0, 0.1], v), np.array([0.0, rise / G]), steps)
        at = motion.p_WB[-1, 0] + rotation_from_quaternion(motion.quat_WB[-1, 0]) @ lab.com
        heights.append((lab.axes.T @ (at - lab.origin))[2] - 0.1)
    errors = np.array(heights) / (0.5 * rise**2 / G) - 1.0
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.05)
    assert abs(2 * errors[1] - errors[0]) < 5e-4


def test_random_contacts_are_those_of_their_seed_and_start_apart_or_touching():
    for seed in range(1, 30):
        (m, start), (again, _) = random_contacts(seed), random_contacts(seed)
        assert 1 <= len(m.bodies) <= 4
        assert 1 <= sum(len(contact_parts(c)) for c in m.contacts) <= 8
        assert np.array_equal(start.v_WB_W, random_contacts(seed)[1].v_WB_W)
        assert [c.name for c in m.contacts] == [c.name for c in again.contacts]


# 29: a slip that turns by more than a right angle on one vertex of a pyramid; 67: a contact that joints hold; 98: slip
# stops where it turns to another vertex; 110: slip stops within a step that left its line; 128: a contact of two bodies
# of one joint; 201: impacts in turn at one instant; 217: joints hold all that touches; 250: an impact beside what rests
# 244: an impact beside contacts at rest, whose rates are rounding; 336: joints all but hold a contact;
# 393: impacts take up the speed in turn; 394, 528: contacts at rest of what moves
@pytest.mark.parametrize(
    "seed",
    [
        *(2, 244, 264, 393),
        *(
            pytest.param(n, marks=pytest.mark.slow)
            for n in (11, 14, 29, 67, 98, 110, 128, 201, 217, 250, 336, 394, 528)
        ),
    ],
)
def test_motions_from_event_to_event_lie_within_the_band_of_time_stepping(seed):
    found = compare(seed)
    assert not found.reason
    assert found.difference <= found.band < 1e-2
    assert f"1 of the 1 compared lie within the band; {found.events} events" in summary([found])


def test_open_forces_that_come_near_their_bounds_ask_for_no_short_steps():
    """Forces within a narrow margin move with the mechanism; those of a step go along."""
    motion, _ = simulate_with_contacts(*random_contacts(128), TIMES, 1e-10, "moreau")
    assert motion.counters["steps"] < 60


@pytest.mark.parametrize(("seed", "instant"), [(184, "0"), (46, "0.346333596")])
def test_other_accelerations_are_found_beyond_those_that_are_known(seed, instant):
    with pytest.raises(NumericalFailure, match=rf"t = {instant}\d* s: .* several accelerations"):
        simulate_with_contacts(*random_contacts(seed), TIMES, 1e-10, "moreau")


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9, 1e-10, 1e-12])
def test_what_breaks_away_without_acceleration_is_asked_for_headings_near_those_of_its_forces(tolerance):
    """Three friction sets reach their bounds at one instant; before it, too, they could slide, by other forces."""
    with pytest.raises(NumericalFailure, match=r"t = 0.117363\d* s: .* several accelerations"):
        simulate_with_contacts(*random_contacts(380), TIMES, tolerance, "moreau")


def test_wedged_contacts_that_may_slip_apart_are_told():
    """Contacts of three hinged bodies hold one another by any forces; time stepping slips them from the start."""
    case = specimen(55160, contacts=True).case
    with pytest.raises(NumericalFailure, match=r"t = 0 s: .* several accelerations"):
        simulate_with_contacts(case.mechanism, case.initial_state, case.times, 1e-9)


def test_rows_that_depend_on_one_another_are_told_where_no_modes_are_consistent():
    """What two contacts hold from both sides is pressed into both."""
    wedged = ContactProblem(np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([-1.0, -1.0]), ("a", "b"), (0, 1))
    with pytest.raises(NumericalFailure, match=r"no modes of a, b .*: their rows depend on one another"):
        decide(wedged)


def test_a_slip_far_slower_than_what_rounding_leaves_of_velocities_is_passed():
    """There a difference quotient by velocities has no step but that of rounding."""
    motion, _ = simulate_with_contacts(*random_contacts(230), TIMES, 1e-10, "moreau")
    assert motion.counters["impacts"] > 10


@pytest.mark.slow
def test_a_step_in_which_friction_jams_under_the_rebound_goes_on_without_it():
    """Drift makes a resting contact approach; from event to event it rests."""
    mechanism, start = random_contacts(117)
    motion, _ = simulate_with_contacts(mechanism, start, TIMES, 1e-10, "moreau")
    steps = step_with_contacts(mechanism, start, TIMES, 16)
    np.testing.assert_allclose(steps.p_WB, motion.p_WB, atol=1e-3)


def test_what_breaks_away_at_a_vertex_of_a_pyramid_slips_once():
    """Slip of rounding has no direction: at another vertex friction would drive it, and it would stick again."""
    mechanism, start = random_contacts(250)
    _, events = simulate_with_contacts(mechanism, start, np.array([0.0, 0.15]), 1e-10, "moreau")
    assert [event.kind for event in events] == ["impact", "slips"]


# 17: a normal force is open that loads a friction which slides; 53: the same in an impact
@pytest.mark.parametrize(("seed", "instant"), [(17, "t = 0 s: "), (53, "t = 0.0938")])
def test_forces_that_are_open_and_load_what_slides_leave_the_motion_open(seed, instant):
    found = compare(seed)
    assert found.reason == "indeterminate"
    assert found.agrees
    assert instant in found.message


def test_a_step_that_fails_otherwise_is_not_repeated_without_its_rebound(monkeypatch):
    """A ball falls on the floor: only jammed friction may cost it its rebound."""
    asked = []

    def fails(problem):
        asked.append(problem)
        raise NumericalFailure("singular values did not converge")

    monkeypatch.setattr(time_stepping, "project_impulses", lambda *_: False)
    monkeypatch.setattr(time_stepping, "decide", fails)
    mechanism = Lab().free_body(2.0, BALL, LEVEL, [Lab().sphere(0.1, restitution=0.5)])
    with pytest.raises(NumericalFailure, match="did not converge"):
        step_with_contacts(mechanism, Lab().state([0, 0, 0.11], [0, 0, -1.0]), np.array([0.0, 0.1]), 10)
    assert len(asked) == 1


def test_friction_that_jams_under_a_rebound_alone_is_told_as_such():
    """Impulses without rebound always exist (Stewart and Trinkle 1996)."""
    found = compare(7)
    assert found.reason == "painleve"
    assert found.message.startswith("t = 0 s: contact 'contact_0', contact 'contact_1'")
    assert "jams (Painleve) under the rebound" in found.message


@pytest.mark.parametrize("tolerance", [1e-8, 1e-10, 1e-12])
def test_steps_that_find_no_end_before_a_jam_tell_the_jam(tolerance):
    """The determinant of the sliding contacts falls through zero; a coarse step lands behind it, finer ones do not."""
    case = specimen(55114, contacts=True).case
    with pytest.raises(NumericalFailure, match=r"t = 0\.17666702\d+ s: .*jams \(Painleve\)"):
        simulate_with_contacts(case.mechanism, case.initial_state, case.times, tolerance)


@pytest.mark.slow
def test_a_mechanism_that_takes_too_long_costs_the_others_nothing():
    found = list(campaign([24, 32], limit=0.2))
    assert [(one.seed, one.reason, one.agrees) for one in found] == [(24, "timed out", False), (32, "timed out", False)]


@pytest.mark.slow
def test_the_band_catches_friction_that_is_a_tenth_too_large():
    mechanism, start = random_contacts(3)
    wrong = replace(mechanism, contacts=tuple(replace(c, friction=1.1 * c.friction) for c in mechanism.contacts))
    levels = [step_with_contacts(mechanism, start, TIMES, steps).p_WB for steps in LEVELS]
    motion, _ = simulate_with_contacts(wrong, start, TIMES, 1e-10, "moreau")
    off = np.max(np.abs(motion.p_WB - levels[-1]), axis=(1, 2))
    assert np.max(off / (SAFETY * band_of(levels) + FLOOR)) > 3.0


def test_contacts_whose_accelerations_are_open_are_named():
    """A slab between two jaws: either pair of points may carry all that presses, and the slab turns about its axis."""
    draw = Drawing("jaws", gravity=(0.0, 0.0, -9.81))
    draw.body("slab", mass=0.3, com=(0.0, 0.004, 0.003), inertia=(3e-4, 2e-4, 2.5e-4))
    draw.joint("flight", "free", "ground", "slab", at=(0.0, 0.0, 0.0))
    for side, jaw in ((-1.0, "left"), (1.0, "right")):
        draw.body(jaw, mass=0.2, inertia=(1e-4, 1e-4, 1e-4))
        draw.joint(f"{jaw}_slide", "prismatic", "ground", jaw, at=(0.0, 0.0, 0.0), axis=(1.0, 0.0, 0.0))
        press = {"joint": f"{jaw}_slide", "coordinate": "distance", "stiffness": 2e3, "damping": 0.0}
        draw.add("joint_spring", f"{jaw}_spring", rest=-0.02 * side, **press)
        for name, y in (("near", 0.0), ("far", 0.02)):
            wall = {"partner": "slab", "point": (0.02 * side, y, 0.0), "normal": (side, 0.0, 0.0), "friction": 0.5}
            draw.add("contact", f"{jaw}_{name}", body=jaw, at=(0.025 * side, y, 0.0), radius=0.005, **wall)
    with pytest.raises(NumericalFailure, match=r"several accelerations of contact '(left|right)_(near|far)'"):
        simulate(draw.case(duration=0.1, sample=0.05))
