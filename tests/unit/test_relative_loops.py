"""Loops and samples of the relative form: sparsity of the factors, dense output, steps independent of samples."""

from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.case import load_case
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Joint,
    Load,
    Mechanism,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    initial_state,
    random_states,
    rotation_angle_between,
    rotation_from_quaternion,
    through,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import NumericalFailure, formulation, simulate
from consilience.reference.integrators.coefficients import STAGES
from consilience.reference.steppers.explicit import PAIRS, dense_output, interpolate
from consilience.reference.tree.arrays import flatten_relative

MANY_LOOPS = (
    "windows:count=6",
    "scissor:stages=4",
    "parallel_rods:rods=5",
    "closed_ring:bodies=9,hinges=skew",
    "stewart_platform",
    "bricard",
)


def loops_of(name):
    return flatten_relative(load_case(name).mechanism)[0].loops


@pytest.mark.parametrize("name", MANY_LOOPS)
def test_many_loops_have_the_accelerations_of_the_dense_equations(name):
    case = load_case(name)
    mechanism = case.mechanism
    (state,) = random_states(mechanism, case.initial_state, 1, 3)
    equations = formulation("relative", mechanism)
    found = np.hstack(equations.accelerations(state))
    right = np.hstack(truth.solve(mechanism, state)[:2])
    bar = 1e-11 + 4 * np.finfo(float).eps * mass_matrix_condition(mechanism, state)
    assert np.max(np.abs(found - right)) < bar * max(1.0, np.max(np.abs(right)))


def test_work_on_a_row_of_loops_grows_linearly():
    """Fill of the factors, and operations of the Householder reflections (entries times columns), are linear."""
    entries, touched = [], []
    for count in (20, 40, 80):
        group = loops_of(f"windows:count={count}").group
        rows = group["row_end"] - group["row"]
        columns = np.array([rows[g : reach + 1].sum() for g, reach in enumerate(group["last_reached"])])
        entries.append(np.sum(group["front_rows"] * columns))
        touched.append(np.sum(group["front_rows"] * columns * rows))
    for work in (entries, touched):
        growth = np.diff(np.log2(work))
        assert np.all(growth < 1.1), growth


@pytest.mark.parametrize("name", MANY_LOOPS)
def test_every_direction_and_every_row_has_one_place(name):
    links = flatten_relative(load_case(name).mechanism)[0]
    loops = links.loops
    rows = sorted(n for row in loops.group for n in range(row["row"], row["row_end"]))
    assert rows == list(range(len(loops.touched)))
    for g, row in enumerate(loops.group):
        for place, n in enumerate(loops.own_directions[row["own"] : row["own_end"]]):
            assert tuple(loops.owner[n]) == (g, place)
    assert len(loops.own_directions) == len(set(loops.own_directions.tolist()))
    assert np.all(np.diff(loops.group["last_reached"]) >= 0)


@pytest.mark.parametrize(("degree", "exact"), [(1, True), (4, True), (7, True), (8, False)])
@pytest.mark.parametrize(("name", "rounding"), [("dop853", 1e-15), ("tp86", 2e-15)])  # largest weights 528 and 830
def test_dense_output_is_exact_for_motions_up_to_degree_seven(name, rounding, degree, exact):
    h, x, method = 0.7, np.linspace(0.0, 1.0, 9), PAIRS[name]
    at = h * method.nodes
    K = (degree * at ** (degree - 1))[:, None]
    assert at[STAGES] == h
    z, end, F = np.zeros(1), np.array([h**degree]), np.empty((7, 1))
    interpolate(method.dense, z, end, K, h, F)
    found = np.empty((len(x), 1))
    for n, part in enumerate(x):
        dense_output(z, F, part, found[n])
    error = np.max(np.abs(found[:, 0] - (h * x) ** degree))
    assert error < rounding if exact else error > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "span"),
    # the whirling arm amplifies rounding to 3e-10 by 1.5 s, in every formulation and at any tolerance
    [("double_pendulum", 1.5), ("four_bar", 1.5), ("stewart_platform", 1.5), ("seven_axis_arm", 0.75)],
)
def test_samples_within_steps_are_as_good_as_the_ends_of_steps(name, span):
    case = load_case(name)
    times = np.array([0.0, *(np.linspace(0.013, 0.997, 24) * span)])
    sampled = simulate(case.mechanism, case.initial_state, times, 1e-12, "relative")
    for n in (5, 12, 20, 24):
        ended = simulate(case.mechanism, case.initial_state, times[[0, n]], 1e-13, "null_space")
        assert np.max(np.abs(sampled.p_WB[n] - ended.p_WB[-1])) < 1e-11
        assert np.max(rotation_angle_between(sampled.quat_WB[n], ended.quat_WB[-1])) < 1e-11
        speed = max(1.0, np.max(np.abs(ended.w_WB_W)))
        assert np.max(np.abs(sampled.w_WB_W[n] - ended.w_WB_W[-1])) < 1e-10 * speed


@pytest.mark.parametrize("tolerance", [1e-12, 1e-13])
def test_flat_poses_of_parallelograms_cost_no_digits(tolerance):
    """The constraint is quadratic at a flat pose: a violation of 1e-14 means an error of 3e-6 in a coordinate."""
    case = load_case("n_four_bar_two-long")
    motion = simulate(case.mechanism, case.initial_state, np.array([0.0, 10.0]), tolerance, "relative")
    expected = [
        one for one in case.published if one.time == 10.0 and one.observable == "p_WB" and one.origin == "closed form"
    ]
    assert len(expected) == 3
    index = [body.name for body in case.mechanism.bodies].index(expected[0].of)
    for one in expected:
        assert abs(motion.p_WB[-1, index, one.component] - one.value) < 1e-9


@pytest.mark.parametrize("tolerance", [1e-7, 4e-9, 1e-9, 6e-12])
@pytest.mark.parametrize("name", ["four_bar", "stewart_platform", "windows:count=3", "rolling_disc"])
def test_samples_close_the_loops_to_rounding(name, tolerance):
    """Loops that share bodies, too, where fronts hold entries of other rows, in any order of elimination."""
    case = load_case(name)
    mechanism = case.mechanism
    motion = simulate(mechanism, case.initial_state, np.linspace(0.0, 1.0, 41), tolerance, "relative")
    for state in map(motion.state, range(41)):
        rates = constraint_jacobian(mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
        assert np.max(np.abs(constraint_residual(mechanism, state)), initial=0.0) < 2e-14
        assert np.max(np.abs(rates - constraint_rates(mechanism)), initial=0.0) < 1e-13


@pytest.mark.parametrize(("method", "more"), [("dop853", 3), ("tp86", 4)])
@pytest.mark.parametrize("name", ["double_pendulum", "four_bar"])
def test_samples_do_not_shorten_steps(name, method, more):
    case = load_case(name)
    few, many = (
        simulate(case.mechanism, case.initial_state, np.linspace(0.0, 2.0, n), 1e-9, "relative", method).counters
        for n in (2, 1001)
    )
    assert many["steps"] == few["steps"]
    # a step with samples needs a few more evaluations
    assert few["evaluations"] < many["evaluations"] <= few["evaluations"] + more * few["steps"] + 1


AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def pushed(push):
    """Return a slider of 2 kg on a rail, with a force along the rail."""
    ground = Frame(np.zeros(3), np.eye(3))
    return Mechanism(
        name="pushed",
        bodies=(Body("slider", 2.0, np.zeros(3), np.eye(3), ground),),
        joints=(Joint("rail", "prismatic", GROUND, "slider", Frame(np.zeros(3), AXES), Frame(np.zeros(3), AXES)),),
        gravity=np.zeros(3),
        loads=(Load("push", "force", "slider", AXES[:, 2], "world", np.zeros(3), push),),
    )


def test_a_pulse_between_samples_is_not_passed_over():
    """A force pulse of 0.1 s on 2 kg at rest: the momentum equals the impulse."""
    x = np.linspace(0.0, 6.0, 601)
    push = through(x, np.where((x > 3.0) & (x < 3.1), np.sin(np.pi * (x - 3.0) / 0.1) ** 6, 0.0))
    mechanism = pushed(push)
    t = np.linspace(0.0, 6.0, 60_001)
    impulse = np.trapezoid([push.jet(s)[0] for s in t], t)
    motion = simulate(mechanism, initial_state(mechanism), np.array([0.0, 6.0]), 1e-10, "relative")
    assert impulse > 0.02
    assert abs(motion.v_WB_W[-1, 0] @ AXES[:, 2] - impulse / 2.0) < 1e-8


def test_a_motion_may_end_where_a_table_ends():
    """The eighth node of tp86 lies beyond the end of the step, where the table has no value."""
    x = np.linspace(0.0, 1.0, 21)
    mechanism = pushed(through(x, np.cos(x)))
    asked = (mechanism, initial_state(mechanism), np.array([0.0, 0.5, 1.0]), 1e-11, "relative")
    motion = simulate(*asked)
    np.testing.assert_allclose(motion.v_WB_W[:, 0] @ AXES[:, 2], np.sin(motion.time) / 2.0, rtol=0, atol=1e-8)
    with pytest.raises(NumericalFailure, match="not finite"):
        simulate(*asked, integrator="tp86")


@pytest.mark.parametrize(
    ("formulation", "integrator", "span"),
    [("relative", "tp86", 0.5), ("relative", "dop853", 0.5), ("descriptor", "dop853", 10.0)],
)
def test_a_stage_that_overflows_rejects_the_step(formulation, integrator, span):
    """First attempts at a loose tolerance take so long a step of a stiff motion that forces overflow."""
    case = load_case("flyball_governor")
    asked = (case.mechanism, case.initial_state, np.array([0.0, span]))
    loose, fine = simulate(*asked, 1e-4, formulation, integrator), simulate(*asked, 1e-10, "relative")
    assert loose.counters["rejected"] > 0
    np.testing.assert_allclose(loose.p_WB, fine.p_WB, rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "method"),
    [("double_pendulum", "taylor"), ("four_bar", "taylor"), ("spatial_pendulum", "tp86"), ("rsur_four_bar", "tp86")],
)
def test_the_default_integrator_is_taylor_in_a_plane_and_tp86_in_space_and_another_one_agrees(name, method):
    case = load_case(name)
    asked = (case.mechanism, case.initial_state, np.linspace(0.0, 1.0, 5), 1e-11, "relative")
    motion, one, other = simulate(*asked), *(simulate(*asked, integrator=by) for by in (method, "dop853"))
    np.testing.assert_array_equal(motion.p_WB, one.p_WB)
    assert np.any(motion.p_WB != other.p_WB)
    np.testing.assert_allclose(motion.p_WB, other.p_WB, rtol=0, atol=1e-9)


def test_angles_that_no_element_reads_shorten_no_steps():
    """The last link rotates by 500 t^2; joint springs, however soft, need counted turns, which limit the step."""
    case = load_case("seven_axis_arm_upright")
    springs = tuple(replace(s, stiffness=1e-30) for s in case.mechanism.joint_springs)
    found, counted = (
        simulate(mechanism, case.initial_state, np.array([0.0, 0.2]), 1e-9, "relative")
        for mechanism in (case.mechanism, replace(case.mechanism, joint_springs=springs))
    )
    for motion in (found, counted):
        x_axis = rotation_from_quaternion(motion.quat_WB[-1, -1])[:, 0]
        np.testing.assert_allclose(x_axis, [np.cos(20.0), np.sin(20.0), 0.0], atol=1e-11)
    assert found.counters["steps"] < counted.counters["steps"] / 2
