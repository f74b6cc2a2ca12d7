"""Mechanisms with contacts, stops and dry friction in other units: the reference's states, instants and motions."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.audit.fuzz.population import specimen
from consilience.case import load_case, load_cases
from consilience.compare.motion import difference_over_time, size_of_motion
from consilience.errors import InvalidInput
from consilience.mechanism import Initial, Stop, Units, in_units, initial_state
from consilience.reference.contact import contact_instant, simulate_with_contacts, simulate_with_impacts
from mechanisms import chain
from twins.test_units import scaled

CASES = [
    ("dry_spring", Units(1e-3)),
    ("crank_at_a_stop", Units(1e-6)),
    ("bead_on_turning_rod", Units(1e-6)),  # a reaction bounds its friction
    ("breakaway", Units(time=1e6)),
    ("shaken_table", Units(time=1e6)),
]
"""Cases with contact, stops or dry friction, and units in which constants that count in SI units told."""


@pytest.mark.parametrize(("name", "units"), CASES)
def test_motions_with_contact_do_not_depend_on_units(name, units):
    """The same motion to rounding and the tolerance, by the same events."""
    case = load_cases(name)[0]
    own = scaled(case, units)
    first, _ = simulate_with_contacts(case.mechanism, case.initial_state, case.times)
    other, _ = simulate_with_contacts(own.mechanism, own.initial_state, own.times)
    back = units.inverse.convert(other)
    assert np.max(difference_over_time(back, first, size_of_motion(case.mechanism, first))) < 1e-11
    assert np.array_equal(back.event_kind, first.event_kind)
    assert back.event_time == pytest.approx(first.event_time, rel=1e-9)
    loss = np.max(first.contact_loss)
    assert back.contact_loss == pytest.approx(first.contact_loss, rel=1e-10, abs=1e-10 * loss)


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("shaken_table", Units(time=1e6)),  # without impacts; it ended where forces counted in SI units
        ("bouncing_table", Units(1e-3, 1e3)),
        ("rod_hits_floor-forward", Units(1e3, time=1e-3)),
    ],
)
def test_records_of_impacts_do_not_depend_on_units(name, units):
    """Dimensions of all fields: impulses in N s, their moments in N m s, energies in J."""
    case, times = load_case(name), np.linspace(0.0, 0.8, 9)
    own = scaled(case, units)
    motion, first = simulate_with_impacts(case.mechanism, case.initial_state, times, case.mechanism.contacts)
    again, other = simulate_with_impacts(own.mechanism, own.initial_state, times * units.time, own.mechanism.contacts)
    assert units.inverse.convert(again).p_WB == pytest.approx(motion.p_WB, abs=1e-11)
    assert len(first) == len(other)
    for a, b in zip(first, [impact.in_units(units.inverse) for impact in other], strict=True):
        assert b.contacts == a.contacts
        assert b.modes == a.modes
        for field in ("v_WB_W", "w_WB_W"):
            assert getattr(b.after, field) == pytest.approx(getattr(a.after, field), rel=1e-9, abs=1e-10)
        for field in vars(a).keys() - {"contacts", "modes", "before", "after"}:
            size = np.max(np.abs(getattr(a, field)), initial=0.0)
            assert getattr(b, field) == pytest.approx(getattr(a, field), rel=1e-9, abs=1e-9 * size + 1e-12), field


@pytest.mark.parametrize("units", [Units(1e-6), Units(1e6), Units(mass=1e-6)])
def test_instants_with_stops_do_not_depend_on_units(units):
    """Joint rows of metres and of radians count alike."""
    case = load_case("wheel_caught_by_stop")
    own = scaled(case, units)
    first = contact_instant(case.mechanism, case.states)
    back = units.inverse.convert(contact_instant(own.mechanism, own.states))
    for name in ("a_WB_W", "alpha_WB_W", "force_F", "torque_F"):
        value = getattr(first, name)
        np.testing.assert_allclose(getattr(back, name), value, rtol=0, atol=1e-12 * np.max(np.abs(value)))


@pytest.mark.parametrize("name", ["ball_rolls", "ladder_leaves_wall", "breakaway"])
@pytest.mark.parametrize("units", [Units(1e-6), Units(1e6)])
def test_random_states_in_closed_contacts_do_not_depend_on_units(name, units):
    case = load_case(name)
    for state, other in zip(case.states, scaled(case, units).states, strict=True):
        back = units.inverse.convert(other)
        for field in ("v_WB_W", "w_WB_W"):
            value = getattr(state, field)
            np.testing.assert_allclose(
                getattr(back, field), value, rtol=0, atol=1e-12 * np.max(np.abs(value), initial=1.0)
            )


def test_a_contact_that_joints_hold_leaves_random_states_alone():
    """Its row is rounding in the free directions: divided by itself it would change velocities by their size."""
    case, units = specimen(7010, contacts=True).case, Units(1.1)
    for state, other in zip(case.states, scaled(case, units).states, strict=True):
        np.testing.assert_allclose(units.inverse.convert(other).v_WB_W, state.v_WB_W, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "coordinate", "told"), [("prismatic", "distance", "0.25 m"), ("revolute", "angle", "0.25 rad")]
)
def test_what_a_joint_is_beyond_a_stop_is_told_in_metres_or_radians(kind, coordinate, told):
    found = in_units(chain(kind), 0.125)
    joint = found.joints[0].name
    start = initial_state(found, Initial({joint: {coordinate: -0.25}}))
    stopped = replace(found, stops=(Stop("end", joint, coordinate, lower=0.0),))
    with pytest.raises(InvalidInput, match=f"the joint is {told} beyond it"):
        simulate_with_contacts(stopped, start, np.array([0.0, 1.0]))
