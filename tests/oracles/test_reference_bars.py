"""Accuracy of the reference on the cases with a full oracle, by identities and by its second formulation."""

import numpy as np
import pytest

from consilience.case import load_case
from consilience.mechanism import (
    State,
    constraint_jacobian,
    constraint_residual,
    kinetic_energy,
    potential_energy,
    random_states,
    rotation_angle_between,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.mechanism.observables import load_potentials
from consilience.reference import formulation, simulate
from mechanisms import is_conservative
from oracles.shipped import TRAJECTORIES

CASES = {name: load_case(name) for name in TRAJECTORIES}
EPS = np.finfo(float).eps


def states(answer):
    arrays = (answer.p_WB, answer.quat_WB, answer.v_WB_W, answer.w_WB_W)
    return [State(*(a[n] for a in arrays)) for n in range(len(answer.time))]


@pytest.mark.parametrize("name", CASES)
def test_formulations_agree_at_1000_states(name):
    """States of motions from random states, which take a hundredth of the time of random ones."""
    case = CASES[name]
    starts = random_states(case.mechanism, case.initial_state, 20, seed=7)
    times = np.linspace(0.0, 10.0, 50)
    sample = [s for start in starts for s in states(simulate(case.mechanism, start, times, 1e-12, "relative"))]
    forms = [formulation(name, case.mechanism) for name in ("descriptor", "null_space")]
    a, b = (np.array([np.hstack(form.accelerations(state)).ravel() for state in sample]) for form in forms)
    difference = np.max(np.abs(a - b), axis=1) / np.max(np.abs(a), axis=1)
    assert np.max(difference) < 1e-11


@pytest.fixture(scope="module", params=CASES)
def motion(request):
    case = CASES[request.param]
    times = np.arange(101) * 0.05
    return case, simulate(case.mechanism, case.initial_state, times, 1e-13)


def test_energy_is_constant_over_5_s(motion):
    case, answer = motion
    assert is_conservative(case.mechanism)
    m = case.mechanism
    T = np.array([kinetic_energy(m, s) for s in states(answer)])
    E = T + np.array([potential_energy(m, s) + load_potentials(m, s) for s in states(answer)])
    assert np.max(np.abs(E - E[0])) < 1e-11 * np.max(T)


def test_constraints_hold_over_5_s_at_position_and_velocity_level(motion):
    case, answer = motion
    for s in states(answer):
        assert np.max(np.abs(constraint_residual(case.mechanism, s)), initial=0) < 1e-13
        rate = constraint_jacobian(case.mechanism, s) @ np.hstack([s.v_WB_W, s.w_WB_W]).ravel()
        assert np.max(np.abs(rate), initial=0) < 1e-13 * max(1.0, np.max(np.abs(s.v_WB_W)), np.max(np.abs(s.w_WB_W)))


@pytest.mark.parametrize(("tolerance", "formulation"), [(1e-12, "descriptor"), (1e-12, "null_space")])
def test_another_tolerance_and_formulation_give_the_same_motion_over_5_s(motion, tolerance, formulation):
    case, answer = motion
    other = simulate(case.mechanism, case.initial_state, answer.time, tolerance, formulation)
    assert np.max(np.abs(other.p_WB - answer.p_WB)) < 1e-10
    assert np.max(rotation_angle_between(other.quat_WB, answer.quat_WB)) < 1e-10


@pytest.mark.parametrize("name", CASES)
def test_condition_of_the_mass_matrix_stays_small_so_that_the_bars_mean_something(name):
    case = CASES[name]
    assert max(mass_matrix_condition(case.mechanism, s) for s in case.states) * 4 * EPS < 1e-11
