"""The library where stops, dry friction or contacts act: reactions of what rests, starts that joints forbid."""

from dataclasses import replace

import numpy as np
import pytest

import consilience as cs
from consilience.errors import InvalidInput
from consilience.mechanism import Initial, constraint_residual, initial_state
from consilience.report.curves import curve_sets
from contact_problems import LEVEL, Lab, pendulum, rolling_ball, stop_torque

LAB = Lab()
RESTING = {"stop": {"stop": {"lower": 0.5}}, "dry friction": {"bound": 20.0}}


def resting(kind):
    """Rod at 0.5 rad on its stop, or held by its brake."""
    rod = pendulum(LAB, **RESTING[kind])
    return rod, initial_state(rod, Initial(coordinates={"hinge": {"angle": 0.5}}))


@pytest.mark.parametrize("kind", RESTING)
def test_the_pin_of_a_rod_that_rests_carries_its_weight(kind):
    rod, state = resting(kind)
    found = cs.accelerations(rod, state)
    force = rod.joints[0].F.R @ found.force_F[0, 0]
    assert LAB.axes.T @ force == pytest.approx(-LEVEL, abs=1e-12)
    assert found.torque_F[0, 0] == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.max(np.abs(found.alpha_WB_W)) < 1e-12
    assert abs(stop_torque(0.5)) > 1.0  # without the stop the rod falls


@pytest.mark.parametrize("kind", RESTING)
def test_a_motion_with_stops_or_dry_friction_has_no_reactions_of_a_free_one(kind):
    rod, state = resting(kind)
    motion = cs.simulate(rod, state, np.linspace(0.0, 0.2, 3))
    assert motion.coordinates("hinge") == pytest.approx(0.5, abs=1e-12)
    with pytest.raises(InvalidInput, match=f"more than the state: {kind}"):
        motion.reactions("hinge")
    assert not list(curve_sets(rod, motion, ["reactions"], ()))


def test_accelerations_with_contacts_have_the_forces_of_their_laws():
    ball, state, (acceleration, _, force) = rolling_ball(LAB)
    found = cs.accelerations(ball, [state])
    assert LAB.acceleration(found, state)[0] == pytest.approx(acceleration, abs=1e-12)
    assert LAB.axes.T @ found.contact_force[0, 0] == pytest.approx(force, abs=1e-12)
    with pytest.raises(InvalidInput, match="smooth equations of motion"):
        cs.accelerations(ball, [state], "descriptor")


def test_a_motion_with_contacts_does_not_start_from_a_state_that_its_joints_forbid():
    rod, state = resting("dry friction")
    off = replace(state, p_WB=state.p_WB + 0.1)
    with pytest.raises(InvalidInput, match=r"joint 'hinge'.* is violated"):
        cs.simulate(rod, off, np.linspace(0.0, 0.2, 3))
    with pytest.raises(InvalidInput, match=r"joint 'hinge'.* has a wrong rate"):
        cs.simulate(rod, replace(state, v_WB_W=state.v_WB_W + 0.1), np.linspace(0.0, 0.2, 3))
    placed = cs.simulate(rod, off, np.linspace(0.0, 0.2, 3), assemble=True)
    assert np.max(np.abs(constraint_residual(rod, placed.state(0)))) < 1e-12
    with pytest.raises(InvalidInput, match="smooth equations of motion"):
        cs.simulate(rod, state, np.linspace(0.0, 0.2, 3), integrator="radau13")
