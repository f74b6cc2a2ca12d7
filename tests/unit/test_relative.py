"""Relative form (joint coordinates) against dense equations, motions of another formulation, and identities."""

from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.case import load_case
from consilience.mechanism import (
    GROUND,
    Spring,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    rotation_angle_between,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import formulation, simulate
from mechanisms import ELEMENTS, LOOPS, TREES, chain, states_of

ALL = TREES | LOOPS | ELEMENTS
EPS = np.finfo(float).eps


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


def violation(mechanism, state):
    """Return the largest violation of the constraints on poses, and of those on velocities."""
    rates = constraint_jacobian(mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    rates = np.max(np.abs(rates - constraint_rates(mechanism)))
    return np.max(np.abs(constraint_residual(mechanism, state))), rates


@pytest.mark.parametrize("name", ALL)
def test_accelerations_and_reactions_are_those_of_the_dense_equations(name):
    mechanism = ALL[name]
    equations = formulation("relative", mechanism)
    for state in states_of(mechanism, 3):
        a, alpha, force, torque = truth.solve(mechanism, state)
        bar = 1e-11 + 4 * EPS * mass_matrix_condition(mechanism, state)
        assert relative(np.hstack(equations.accelerations(state)), np.hstack([a, alpha])) < bar
        if name not in ELEMENTS and np.max(np.abs(np.hstack([force, torque]))) > 1e-6:
            assert relative(np.hstack(equations.reactions(state)), np.hstack([force, torque])) < 1e-9


@pytest.mark.parametrize("name", ALL)
def test_a_state_comes_back_from_its_coordinates(name):
    mechanism = ALL[name]
    equations = formulation("relative", mechanism)
    for state in states_of(mechanism, 2):
        found = equations.state(equations.coordinates(state))
        assert np.max(rotation_angle_between(found.quat_WB, state.quat_WB)) < 1e-12
        for field in ("p_WB", "v_WB_W", "w_WB_W"):
            assert np.max(np.abs(getattr(found, field) - getattr(state, field))) < 1e-11, field


@pytest.mark.parametrize("name", [*LOOPS, "driven", "coupled", "rolling_torus", "skating", "single_screw"])
@pytest.mark.parametrize("size", [1e-4, 1e-7])
def test_projection_closes_open_loops(name, size):
    mechanism, rng = ALL[name], np.random.default_rng(5)
    equations = formulation("relative", mechanism)
    (state,) = states_of(mechanism, 1)
    u = equations.coordinates(state)
    count = len(u) - 1 - len(mechanism.controls)
    torn = u.copy()
    torn[:count] += size * rng.normal(size=count)
    assert max(violation(mechanism, equations.state(torn))) > 1e-2 * size
    positions, rates = violation(mechanism, equations.state(equations.settle(0.0, torn)))
    assert positions < 1e-13
    assert rates < 1e-12


@pytest.mark.parametrize("name", ["long_chain", "floating_chain", "forced_chain", *LOOPS, *ELEMENTS])
def test_motions_are_those_of_the_null_space(name):
    mechanism = ALL[name]
    state = states_of(mechanism)[0]
    times = np.linspace(0.0, 0.4, 5)
    one, two = (simulate(mechanism, state, times, 1e-12, form) for form in ("relative", "null_space"))
    assert np.max(np.abs(one.p_WB - two.p_WB)) < 1e-10
    assert np.max(rotation_angle_between(one.quat_WB, two.quat_WB)) < 1e-10
    assert np.max(np.abs(one.w_WB_W - two.w_WB_W)) < 1e-8 * max(1.0, np.max(np.abs(two.w_WB_W)))


SELECTED = {
    "hookes_joint_free": (
        *("descriptor", "relative", "null_space_qr", "point_coordinates"),
        *("descriptor_euler_parameters", "descriptor_unprojected"),
    ),
    "bricard": ("coordinate_partitioning", "point_coordinates"),
}
"""Cases with redundant rows (of 14 rows 11 are independent, of 30 rows 29), and formulations that select rows."""


@pytest.mark.parametrize(("name", "form"), [(name, form) for name, forms in SELECTED.items() for form in forms])
def test_redundant_rows_cost_no_digits_within_a_step(name, form):
    """Selecting rows anew at every stage, off the manifold, would cost 1e-9 in angle."""
    case = load_case(name)
    times = np.array([0.0, 0.5, 1.0])
    one, two = (simulate(case.mechanism, case.initial_state, times, 1e-12, f) for f in (form, "null_space"))
    assert np.max(np.abs(one.p_WB - two.p_WB)) < 1e-11
    assert np.max(rotation_angle_between(one.quat_WB, two.quat_WB)) < 1e-11


def test_steps_grow_fast_after_a_short_first_step():
    """A rotation ``500 t^2`` rad is exact at order eight: three steps suffice."""
    case = load_case("seven_axis_arm_upright")
    times = np.linspace(0.0, 0.2, 6)
    motion = simulate(case.mechanism, case.initial_state, times, 1e-3, "relative")
    assert motion.counters["steps"] <= 3
    np.testing.assert_allclose(motion.w_WB_W[:, -1], np.outer(1000.0 * times, [0.0, 0.0, 1.0]), atol=1e-9)


def test_what_cannot_move_stays_under_a_spring():
    body = chain("rigid")
    spring = Spring("s", GROUND, body.bodies[-1].name, np.array([1.0, 0.2, 0.3]), np.zeros(3), 50.0, 1.0, 0.1)
    mechanism = replace(body, springs=(spring,))
    (state,) = states_of(body, 1)
    motion = simulate(mechanism, state, np.array([0.0, 1.0]), 1e-9, "relative")
    np.testing.assert_array_equal(motion.p_WB[1], motion.p_WB[0])
