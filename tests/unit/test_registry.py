"""Formulations by name: as a library, as engines of the harness, with other integrators and with a Python callback."""

import numpy as np
import pytest

import truth
from consilience.engine import Question, Route, load_engine
from consilience.errors import InvalidInput
from consilience.mechanism import Load, rotation_from_quaternion
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import FORMULATIONS, accelerations, formulation, simulate, unsupported
from mechanisms import ELEMENTS, LOOPS, TREES, chain, states_of

EPS = np.finfo(float).eps


@pytest.mark.parametrize("name", FORMULATIONS)
def test_every_formulation_answers_by_its_name(name):
    mechanism = LOOPS["slider_crank"]
    (state,) = states_of(mechanism, 1)
    equations = formulation(name, mechanism)
    assert equations.name == name
    a, alpha, _, _ = truth.solve(mechanism, state)
    found = accelerations(mechanism, [state], name)
    wanted = np.hstack([a, alpha])
    error = np.max(np.abs(np.hstack([found.a_WB_W[0], found.alpha_WB_W[0]]) - wanted)) / np.max(np.abs(wanted))
    assert error < 1e-10 + 10 * EPS * mass_matrix_condition(mechanism, state)


@pytest.mark.parametrize("name", FORMULATIONS)
def test_coordinates_and_canonical_state_are_inverse(name):
    mechanism = TREES["long_chain"]
    (state,) = states_of(mechanism, 1)
    equations = formulation(name, mechanism)
    back = equations.state(equations.coordinates(state))
    same = np.sign(np.sum(back.quat_WB * state.quat_WB, axis=1))[:, None]
    np.testing.assert_allclose(back.p_WB, state.p_WB, rtol=0, atol=1e-13)
    np.testing.assert_allclose(same * back.quat_WB, state.quat_WB, rtol=0, atol=1e-13)
    np.testing.assert_allclose(back.v_WB_W, state.v_WB_W, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.w_WB_W, state.w_WB_W, rtol=0, atol=1e-12)


def test_an_unknown_formulation_is_refused_with_the_known_ones():
    mechanism = TREES["single_revolute"]
    with pytest.raises(InvalidInput, match=r"formulation 'nul_space': there is none.*null_space_qr"):
        accelerations(mechanism, states_of(mechanism, 1), "nul_space")


@pytest.mark.parametrize("name", ["lagrange", "point_coordinates"])
def test_a_mechanism_that_cannot_be_represented_is_refused_with_the_reason(name):
    mechanism = ELEMENTS["rolling_disc"]
    reasons = unsupported(name, mechanism)
    assert reasons
    assert all(r.reason for r in reasons)
    with pytest.raises(InvalidInput, match="Choose another formulation"):
        formulation(name, mechanism)


# ---------------------------------------------------------------- engines of the harness


def test_a_formulation_is_an_engine_of_the_harness():
    mechanism = LOOPS["four_bar"]
    engine = load_engine("reference:lagrange")
    (method,) = engine.methods(mechanism, Question.INSTANT)
    assert (method.name, method.route) == ("lagrange", Route.REFERENCE)
    states = states_of(mechanism, 2)
    wanted = load_engine("reference").instant(mechanism, states, method)
    found = engine.instant(mechanism, states, method)
    np.testing.assert_allclose(found.a_WB_W, wanted.a_WB_W, rtol=0, atol=1e-10 * np.max(np.abs(wanted.a_WB_W)))
    (trajectory,) = engine.methods(mechanism, Question.TRAJECTORY)
    assert len(trajectory.tolerances) >= 3
    assert engine.unsupported(ELEMENTS["driven"], Question.INSTANT)
    assert engine.unsupported(ELEMENTS["driven"], Question.MODEL) == ()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("reference:nothing", r"reference has no variant 'nothing'. It has: relative, descriptor, null_space"),
        ("mujoco:fast", r"mujoco has no variant 'fast'. It has: none"),
        ("nosuch:descriptor", r"engine 'nosuch:descriptor': it is not installed"),
    ],
)
def test_a_variant_that_is_not_there_is_refused(name, message):
    with pytest.raises(InvalidInput, match=message):
        load_engine(name)


@pytest.mark.parametrize(
    ("name", "tolerance", "bar"), [("descriptor_index_2", 1e-10, 1e-8), ("descriptor_index_3", 1e-8, 1e-5)]
)
def test_a_system_of_higher_index_is_integrated_by_its_name(name, tolerance, bar):
    mechanism = LOOPS["four_bar"]
    (state,) = states_of(mechanism, 1)
    times = np.linspace(0.0, 0.2, 3)
    wanted = simulate(mechanism, state, times)
    found = simulate(mechanism, state, times, tolerance, name)
    np.testing.assert_allclose(found.p_WB, wanted.p_WB, rtol=0, atol=bar)
    assert found.counters["factorisations"] > 0
    with pytest.raises(InvalidInput, match=f"integrator: {name} takes none"):
        simulate(mechanism, state, times, tolerance, name, "rkf45")
    (method,) = load_engine(f"reference:{name}").methods(mechanism, Question.TRAJECTORY)
    assert method.order is None
    assert len(method.tolerances) >= 3


def test_the_generalised_alpha_method_is_an_engine_of_order_two():
    mechanism = LOOPS["four_bar"]
    (state,) = states_of(mechanism, 1)
    engine = load_engine("reference:generalised_alpha")
    (method,) = engine.methods(mechanism, Question.TRAJECTORY)
    assert (method.name, method.order) == ("generalised_alpha", 2)
    times = np.linspace(0.0, 0.2, 3)
    wanted = simulate(mechanism, state, times)
    errors = [
        np.max(np.abs(engine.trajectory(mechanism, state, times, method, 0.1 / n).p_WB - wanted.p_WB)) for n in (40, 80)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
    (at_once,) = engine.methods(mechanism, Question.INSTANT)
    a, alpha, _, _ = truth.solve(mechanism, state)
    found = engine.instant(mechanism, [state], at_once)
    np.testing.assert_allclose(found.a_WB_W[0], a, rtol=0, atol=1e-10 * np.max(np.abs(a)))
    np.testing.assert_allclose(found.alpha_WB_W[0], alpha, rtol=0, atol=1e-10 * np.max(np.abs(alpha)))


# ---------------------------------------------------------------- integrators and callback


@pytest.mark.parametrize(
    ("integrator", "tolerance", "bar"), [("dop853", 1e-12, 1e-10), ("rkf45", 1e-11, 1e-9), ("radau", 1e-9, 1e-8)]
)
def test_other_integrators_give_the_same_motion(integrator, tolerance, bar):
    mechanism = LOOPS["four_bar"]
    (state,) = states_of(mechanism, 1)
    times = np.linspace(0.0, 0.2, 3)
    wanted = simulate(mechanism, state, times)
    found = simulate(mechanism, state, times, tolerance, "articulated_body", integrator)
    np.testing.assert_allclose(found.p_WB, wanted.p_WB, rtol=0, atol=bar)
    np.testing.assert_allclose(found.w_WB_W, wanted.w_WB_W, rtol=0, atol=10 * bar)
    assert found.counters["steps"] > 1
    np.testing.assert_array_equal(found.state(-1).w_WB_W, found.w_WB_W[-1])


def test_an_unknown_integrator_is_refused():
    mechanism = TREES["single_revolute"]
    with pytest.raises(InvalidInput, match="rkf45"):
        simulate(mechanism, states_of(mechanism, 1)[0], np.array([0.0, 0.1]), integrator="euler")


def test_a_callback_acts_like_the_loads_it_stands_for():
    """A following force off the centre and a world-fixed torque: once as loads, once from Python."""
    bare = chain("revolute", "spherical", "prismatic", seed=81)
    point, force, torque = np.array([0.2, -0.1, 0.3]), np.array([1.0, 2.0, -1.5]), np.array([0.4, -0.2, 0.7])
    loads = (Load("f", "force", "b1", force, "body", point), Load("m", "torque", "b2", torque, "world"))
    loaded = type(bare)(bare.name, bare.gravity, bare.bodies, bare.joints, loads=loads)

    def forces(t, state):
        R = rotation_from_quaternion(state.quat_WB[1])
        wrench = np.zeros((3, 6))
        wrench[1] = np.concatenate([R @ force, np.cross(R @ point, R @ force)])
        wrench[2, 3:] = torque
        return wrench

    (state,) = states_of(bare, 1)
    times = np.linspace(0.0, 0.5, 3)
    wanted = simulate(loaded, state, times)
    found = simulate(bare, state, times, forces=forces)
    np.testing.assert_allclose(found.p_WB, wanted.p_WB, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.w_WB_W, wanted.w_WB_W, rtol=0, atol=1e-9)


def test_a_callback_of_the_wrong_shape_or_for_a_formulation_without_is_refused():
    mechanism = TREES["single_revolute"]
    (state,) = states_of(mechanism, 1)
    with pytest.raises(InvalidInput, match=r"forces: shape \(6,\)"):
        simulate(mechanism, state, np.array([0.0, 0.1]), forces=lambda t, s: np.zeros(6))
    with pytest.raises(InvalidInput, match="lagrange takes none"):
        simulate(mechanism, state, np.array([0.0, 0.1]), formulation="lagrange", forces=lambda t, s: np.zeros((1, 6)))
