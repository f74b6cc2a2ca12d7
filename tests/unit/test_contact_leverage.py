"""Contacts that joints all but hold, and impacts that have taken up nearly all speed: what is small is solved."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.mechanism import GROUND, Body, Frame, Joint, Mechanism, PointPlane, drawing_state
from consilience.reference.contact import contact_instant, simulate_with_contacts
from consilience.reference.contact.decision import decide
from consilience.reference.contact.impulse import solve_impulse
from consilience.reference.contact.problem import ContactProblem, FrictionSet
from contact_problems import G, turned

SHARES = [1e-2, 1e-4, 8e-6, 1e-6, 1e-7]
"""What joints leave of the rows of a contact, over the rows."""


@pytest.mark.parametrize("arm", [0.1, 1e-4, 1e-5, 2e-6, 3e-7])
def test_lever_that_rests_on_its_short_arm(arm):
    # moments about the pivot: N arm = m g reach
    mass, reach, height = 1.7, 0.35, 0.4
    R, origin = turned(0.4, -0.3, 0.8), np.array([0.3, -0.7, 0.4])
    X, Y, Z = R.T
    base = turned(-0.5, 0.9, 0.3)
    inertia = base @ np.diag([0.04, 0.05, 0.03]) @ base.T
    frame = Frame(origin, turned(0.2, 0.5, -0.9))
    place = frame.R.T @ (arm * X - height * Z)
    lever = Body("lever", mass, frame.R.T @ (reach * X + 0.1 * Y + 0.2 * Z), 0.5 * (inertia + inertia.T), frame)
    axis = np.column_stack([Z, X, Y])
    pivot = Joint("pivot", "revolute", GROUND, "lever", Frame(origin, axis), Frame(np.zeros(3), frame.R.T @ axis))
    foot = PointPlane("foot", "lever", place, GROUND, origin - height * Z, Z)
    mechanism = Mechanism("lever", -G * Z, (lever,), (pivot,), contacts=(foot,))
    state, expected = drawing_state(mechanism), mass * G * reach / arm * Z
    instant = contact_instant(mechanism, [state])
    # the arm is known to the rounding of the coordinates
    np.testing.assert_allclose(instant.contact_force[0, 0], expected, atol=4e-15 / arm * np.linalg.norm(expected))
    motion, events = simulate_with_contacts(mechanism, state, np.linspace(0.0, 0.5, 6))
    assert not events
    np.testing.assert_allclose(motion.p_WB, state.p_WB[None].repeat(6, axis=0), atol=1e-14 + 1e-15 / arm)
    # a gap of rounding turns the lever by that over the arm, which changes the arm by height times as much
    near = (1e-10 + 1e-15 * height / arm**2) * np.linalg.norm(expected)
    np.testing.assert_allclose(motion.contact_impulse[1:, 0], 0.1 * expected[None].repeat(5, axis=0), atol=0.1 * near)


def body(free: tuple[float, ...], mu: float) -> ContactProblem:
    """A contact with friction whose rows act on one another."""
    J = np.array([[1.0, 0.3, 0.0], [0.2, 0.9, -0.1], [-0.1, 0.4, 1.1]])
    return ContactProblem(J @ J.T, np.array(free), ("c",) * 3, (0,), (FrictionSet("c", (1, 2), mu, mu, 0),))


def of_share(problem: ContactProblem, share: float) -> ContactProblem:
    """The problem of a mechanism whose joints leave this share of all rows; forces are those over the share."""
    left = replace(problem, delassus=share**2 * problem.delassus, free=share * problem.free)
    return replace(left, scale=problem.row_scale())


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize(("free", "mu"), [((-1.0, 0.1, 0.05), 0.8), ((-1.0, 0.9, -0.7), 0.1), ((1.0, 0.4, 0.1), 0.5)])
def test_modes_do_not_depend_on_what_joints_leave(free, mu, share):
    whole = decide(body(free, mu))
    found = decide(of_share(body(free, mu), share))
    assert [mode.name for mode in found.modes.friction] == [mode.name for mode in whole.modes.friction]
    np.testing.assert_allclose(share * found.force, whole.force, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(found.acceleration / share, whole.acceleration, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("law", ["newton", "moreau"])
@pytest.mark.parametrize(("free", "mu"), [((-1.0, 0.1, 0.05), 0.8), ((-1.0, 0.9, -0.7), 0.1)])
def test_impulses_do_not_depend_on_what_joints_leave(free, mu, law, share):
    whole = solve_impulse(body(free, mu), np.array([0.5]), law)
    found = solve_impulse(of_share(body(free, mu), share), np.array([0.5]), law)
    assert found.modes == whole.modes
    np.testing.assert_allclose(share * found.impulse, whole.impulse, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("left", [1.0, 1e-3, 1e-5, 1e-7])
def test_rebound_of_the_last_speed_of_a_linkage(left):
    # three contacts of a mechanism of one degree of freedom, of which the first alone rebounds: u+ = -e u-, the others
    # follow it, whatever rounding of the speed before has left of their velocities
    k = np.array([1.3, 0.09, 0.26])
    rounding = 1e-15 * np.array([0.7, -1.0, 0.4])
    problem = ContactProblem(np.outer(k, k), -left * k + rounding, tuple("abc"), (0, 1, 2), scale=4.0 * k, size=1.0)
    found = solve_impulse(problem, np.array([0.5, 0.0, 0.0]), "moreau")
    np.testing.assert_allclose(found.velocity, 0.5 * left * k, atol=1e-14)
