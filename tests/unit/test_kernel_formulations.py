"""Formulations on compiled kernels: against dense NumPy, each other and closed forms; requirements on coordinates u."""

import functools
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import truth
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Initial,
    JointSpring,
    Load,
    Mechanism,
    Spring,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    determinate_reactions,
    free_directions,
    initial_state,
    rotation_from_quaternion,
    world_inertias,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.reference import NumericalFailure, simulate
from consilience.reference.bodies import constraints
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.motion import rotations
from consilience.reference.formulations import null_space, null_space_qr, partitioning
from consilience.reference.formulations.body_velocities import KERNELS, TREE_KERNELS, KernelFormulation, unsupported
from consilience.reference.integrators.adaptive import integrate
from mechanisms import ELEMENTS, LOOPS, TREES, chain, drawn_joint, lumpy_body, rotation, states_of

ALL = TREES | LOOPS | ELEMENTS
NAMES = [*KERNELS, *TREE_KERNELS]
EPS = np.finfo(float).eps


def time_of(mechanism):
    """Return a time at which the sampled states are consistent: any time, unless drives prescribe joints."""
    return 0.0 if mechanism.drives else 0.37


@functools.cache
def expected(name):
    """Return three states of a mechanism, and their accelerations and reactions by dense NumPy."""
    mechanism = ALL[name]
    states = states_of(mechanism, 3)
    return states, [truth.solve(mechanism, s, time_of(mechanism)) for s in states]


@functools.cache
def conditions(name):
    """Return the condition number of the mass matrix and the determinate reactions at these states."""
    mechanism = ALL[name]
    return [(mass_matrix_condition(mechanism, s), determinate_reactions(mechanism, s)) for s in expected(name)[0]]


@functools.cache
def formulation(name, kernel):
    return KernelFormulation(ALL[name], kernel)


def relative(found, wanted):
    return np.max(np.abs(found - wanted)) / np.max(np.abs(wanted))


# ---------------------------------------------------------------- accelerations, reactions


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", ALL)
def test_accelerations_are_those_of_dense_numpy(name, kernel):
    for state, solution, (condition, _) in zip(*expected(name), conditions(name), strict=True):
        found = formulation(name, kernel).accelerations(state, time_of(ALL[name]))
        bar = 1e-11 + 4 * EPS * condition
        assert relative(np.hstack(found), np.hstack(solution[:2])) < bar


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", [n for n, m in ALL.items() if any(j.rows for j in m.joints)])
def test_determined_reactions_are_those_of_dense_numpy(name, kernel):
    for state, solution, (_, known) in zip(*expected(name), conditions(name), strict=True):
        assert known.any()
        found = formulation(name, kernel).reactions(state, time_of(ALL[name]))
        assert relative(np.hstack(found)[known], np.hstack(solution[2:])[known]) < 1e-10


@pytest.mark.parametrize("kernel", NAMES)
def test_a_free_joint_exerts_nothing(kernel):
    state = expected("single_free")[0][0]
    for found in formulation("single_free", kernel).reactions(state):
        np.testing.assert_array_equal(found, np.zeros((1, 3)))


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", LOOPS)
def test_multipliers_have_least_norm_and_hold_the_momentum_balance(name, kernel):
    """``sum F = d/dt (m v)`` for every body with all multipliers; lam has no part in the null space of ``Q^T``."""
    mechanism = ALL[name]
    state = expected(name)[0][0]
    lam = formulation(name, kernel).multipliers(state)
    Q = constraint_jacobian(mechanism, state)
    a, alpha = formulation(name, kernel).accelerations(state)
    wrench = (truth.applied_wrenches(mechanism, state).ravel() + Q.T @ lam).reshape(-1, 6)
    R, inertias = rotation_from_quaternion(state.quat_WB), world_inertias(mechanism, state)
    for b, body in enumerate(mechanism.bodies):
        c, w = R[b] @ body.com, state.w_WB_W[b]
        force = body.mass * (a[b] + np.cross(alpha[b], c) + np.cross(w, np.cross(w, c)))
        torque = inertias[b] @ alpha[b] + np.cross(w, inertias[b] @ w) + np.cross(c, force)
        size = max(1.0, np.max(np.abs(wrench)), np.max(np.abs(lam)))
        np.testing.assert_allclose(wrench[b], np.concatenate([force, torque]), rtol=0, atol=1e-11 * size)
    open_space = scipy.linalg.null_space(Q.T, rcond=1e-8)
    assert open_space.shape[1] == len(Q) - 6 * len(mechanism.bodies) + free_directions(mechanism, state).shape[1]
    np.testing.assert_allclose(open_space.T @ lam, 0, atol=1e-11 * max(1.0, np.max(np.abs(lam))))


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", ["long_chain", "four_bar", "powered"])
def test_forces_from_python_are_those_of_loads(name, kernel):
    """A world-fixed force at a point and a torque: once as loads, once as wrenches at the body origins."""
    mechanism, state = ALL[name], expected(name)[0][0]
    last, rng = mechanism.bodies[-1].name, np.random.default_rng(6)
    F, T, point = rng.normal(size=(3, 3))
    loads = (Load("F", "force", last, F, "world", point), Load("T", "torque", last, T, "world"))
    wanted = KernelFormulation(replace(mechanism, loads=(*mechanism.loads, *loads)), kernel)

    def forces(t, at):
        arm = rotation_from_quaternion(at.quat_WB[-1]) @ point
        rest = np.zeros((len(mechanism.bodies) - 1, 6))
        return np.vstack([rest, np.concatenate([F, T + np.cross(arm, F)])])

    found = KernelFormulation(mechanism, kernel, forces)
    for question in ("accelerations", "reactions"):
        pairs = zip(getattr(found, question)(state), getattr(wanted, question)(state), strict=True)
        for a, b in pairs:
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * np.max(np.abs(b)))
    u = found.coordinates(state)
    rates = found.derivative(0.1, u), wanted.derivative(0.1, u)
    np.testing.assert_allclose(rates[0], rates[1], rtol=0, atol=1e-11 * np.max(np.abs(rates[1])))


def test_forces_of_another_shape_are_refused():
    f = KernelFormulation(ALL["four_bar"], "descriptor", lambda t, state: np.zeros((2, 6)))
    with pytest.raises(InvalidInput, match=r"forces: shape \(2, 6\)"):
        f.accelerations(expected("four_bar")[0][0])


@pytest.mark.parametrize("returned", ["text", True, 1j])
def test_forces_that_are_no_numbers_are_refused(returned):
    f = KernelFormulation(ALL["four_bar"], "descriptor", lambda t, state: returned)
    with pytest.raises(InvalidInput, match=r"forces: it is no array of numbers\. Return force and torque"):
        f.accelerations(expected("four_bar")[0][0])


# ---------------------------------------------------------------- null-space bases


def rows(name, n=1):
    """Return the workspace with Q and gamma of a state."""
    mechanism = ALL[name]
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, states_of(mechanism, 3)[n])
    rotations(y, ws.A)
    constraints.evaluate(model, 0.0, y, np.zeros(len(model.coordinate)), ws)
    return ws


def by_partitioning(ws):
    return partitioning.basis(ws.Q, ws.gamma, len(ws.Q))


BASES = {"null_space_qr": null_space_qr.basis, "coordinate_partitioning": by_partitioning}


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("name", ALL)
def test_bases_span_what_the_rows_annihilate(name, basis):
    ws = rows(name)
    J, abar = BASES[basis](ws)
    mechanism = ALL[name]
    assert J.shape[1] == free_directions(mechanism, states_of(mechanism, 3)[1]).shape[1]
    size = max(1.0, np.max(np.abs(ws.gamma), initial=0.0))
    np.testing.assert_allclose(ws.Q @ J, 0, atol=1e-12)
    np.testing.assert_allclose(ws.Q @ abar, ws.gamma, rtol=0, atol=1e-12 * size)
    assert np.linalg.matrix_rank(J) == J.shape[1]


@pytest.mark.parametrize("name", ALL)
def test_qr_and_singular_values_give_the_same_space_and_the_same_least_norm(name):
    ws = rows(name)
    J, abar = null_space_qr.basis(ws)
    J_svd, abar_svd = null_space.basis(ws.Q, ws.gamma, len(ws.Q))
    np.testing.assert_allclose(J.T @ J, np.eye(J.shape[1]), rtol=0, atol=1e-13)
    np.testing.assert_allclose(J @ J.T, J_svd @ J_svd.T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(abar, abar_svd, rtol=0, atol=1e-12 * max(1.0, np.max(np.abs(abar_svd))))


@pytest.mark.parametrize("name", ALL)
def test_as_many_velocities_are_independent_as_there_are_freedoms(name):
    """Coordinate partitioning: in the rows of independent velocities, J is a unit matrix and abar is zero."""
    ws = rows(name)
    J, abar = by_partitioning(ws)
    order = np.empty(J.shape[0], dtype=np.int64)
    rank = partitioning.partition(np.column_stack([ws.Q, ws.gamma]), order, len(ws.Q))
    independent = order[rank:]
    assert sorted(order) == list(range(J.shape[0]))
    assert len(independent) == J.shape[1]
    np.testing.assert_array_equal(J[independent], np.eye(J.shape[1]))
    np.testing.assert_array_equal(abar[independent], 0)


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", ALL)
def test_rank_is_that_of_the_rows(name, kernel):
    for state in expected(name)[0]:
        f = formulation(name, kernel)
        f.coordinates(state)
        assert len(f.chart) == 6 * len(ALL[name].bodies) - free_directions(ALL[name], state).shape[1]


@pytest.mark.parametrize(("q", "n", "rank"), [(5, 12, 5), (20, 18, 17), (17, 18, 9), (6, 6, 6), (4, 5, 0)])
def test_dependent_columns_are_those_with_the_largest_pivots(q, n, rank):
    """By definition, each pivot is the largest entry of the Schur complement of the pivots before."""
    rng = np.random.default_rng(q + n)
    C = np.column_stack([rng.normal(size=(q, rank)) @ rng.normal(size=(rank, n)), np.zeros(q)])
    Q, gamma = C[:, :n].copy(), C[:, :n] @ rng.normal(size=n)
    C[:, n] = gamma
    order = np.empty(n, dtype=np.int64)
    assert partitioning.partition(C, order, q) == rank
    left, chosen = Q.copy(), []
    for _ in range(rank):
        r, c = np.unravel_index(np.argmax(np.abs(left)), left.shape)
        left = left - np.outer(left[:, c], left[r]) / left[r, c]
        chosen.append(c)
    assert list(order[:rank]) == chosen
    Q_d, Q_i = Q[:, order[:rank]], Q[:, order[rank:]]
    wanted = np.linalg.lstsq(Q_d, np.column_stack([Q_i, gamma]), rcond=None)[0]
    np.testing.assert_allclose(
        C[:rank, rank:], wanted, rtol=0, atol=1e-11 * max(1.0, np.max(np.abs(wanted), initial=0))
    )


# ---------------------------------------------------------------- requirements on the coordinates u


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "powered", "rolling_torus"])
def test_rows_that_depend_on_others_do_so_off_the_manifold_too(name, kernel):
    """Stages are off the manifold, here by 1e-6: if dependent rows counted as independent, the four-bar would lock."""
    mechanism, f = ALL[name], formulation(name, kernel)
    u = f.coordinates(expected(name)[0][0])
    exact = f.derivative(0.0, u)
    drifted = u.copy()
    drifted[: 13 * len(mechanism.bodies)] += 1e-6 * np.random.default_rng(1).normal(size=13 * len(mechanism.bodies))
    assert relative(f.derivative(0.0, drifted), exact) < 1e-3


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", ["four_bar", "powered", "coupled", "driven", "rolling_torus"])
def test_derivatives_depend_on_nothing_but_time_coordinates_and_chart(name, kernel):
    f, fresh = formulation(name, kernel), KernelFormulation(ALL[name], kernel)
    us = [f.coordinates(s) for s in expected(name)[0]]
    forward, chart = [f.derivative(0.2, u) for u in us], f.chart
    f.reactions(expected(name)[0][1], 0.9)
    f.settle(0.0, us[2])
    f.chart = fresh.chart = chart
    for n in (2, 0, 1):
        np.testing.assert_array_equal(f.derivative(0.2, us[n]), forward[n])
        np.testing.assert_array_equal(fresh.derivative(0.2, us[n]), forward[n])


@pytest.mark.parametrize("name", ALL)
def test_settling_brings_a_drifted_state_back_and_leaves_its_argument_alone(name):
    mechanism, f = ALL[name], formulation(name, "null_space_qr")
    u = f.coordinates(expected(name)[0][0])
    rank = len(f.chart)
    u[: 13 * len(mechanism.bodies)] += 1e-6 * np.random.default_rng(2).normal(size=13 * len(mechanism.bodies))
    before = u.copy()
    settled = f.settle(0.0, u)
    state = f.state(settled)
    speed = max(1.0, np.max(np.abs(settled)))
    rates = constraint_jacobian(mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    np.testing.assert_array_equal(u, before)
    np.testing.assert_allclose(constraint_residual(mechanism, state), 0, atol=1e-14 * speed)
    np.testing.assert_allclose(rates, constraint_rates(mechanism), rtol=0, atol=1e-13 * speed)
    np.testing.assert_allclose(settled[: f.coordinates(state).size], f.coordinates(state), rtol=0, atol=1e-13 * speed)
    assert len(f.chart) == rank
    assert np.max(np.abs(settled - before)) < 1e-4


def test_a_state_has_unit_quaternions_and_comes_back():
    mechanism, f = ALL["powered"], formulation("powered", "descriptor")
    state = expected("powered")[0][0]
    u = f.coordinates(state)
    stretched = u.copy()
    for b in range(len(mechanism.bodies)):
        stretched[13 * b + 3 : 13 * b + 7] *= 1.001
    for found in (f.state(u), f.state(stretched)):
        for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W"):
            np.testing.assert_allclose(getattr(found, name), getattr(state, name), rtol=0, atol=1e-14)


# ---------------------------------------------------------------- motions


@functools.cache
def moved(name):
    """Return a state, and the motion from it by the reference's own integrator."""
    state = states_of(ALL[name], 1)[0]
    return state, simulate(ALL[name], state, np.linspace(0.0, 1.0, 5), 1e-12)


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("name", ["long_chain", "four_bar", "powered", "coupled", "rolling_torus"])
def test_motion_is_that_of_the_reference(name, kernel):
    state, wanted = moved(name)
    f = formulation(name, kernel)
    states = integrate(f, f.coordinates(state), wanted.time, 1e-12, "dop853").states
    for quantity in ("p_WB", "v_WB_W", "w_WB_W"):
        found = np.array([getattr(s, quantity) for s in states])
        assert relative(found, getattr(wanted, quantity)) < 1e-9
    turned = np.abs(np.sum(np.array([s.quat_WB for s in states]) * wanted.quat_WB, axis=2))
    np.testing.assert_allclose(turned, 1.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kernel", NAMES)
@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_a_torsion_spring_counts_its_turns(kernel, method):
    """``I theta'' = -k (theta - rest)`` about an axis through the centre of mass: a cosine of 30 rad peak to peak."""
    rng = np.random.default_rng(90)
    body = lumpy_body("b", rng)
    at = body.drawing.p + body.drawing.R @ body.com
    joint = drawn_joint("j", "revolute", {"b": body}, GROUND, "b", at, rotation(rng))
    axis, omega, rest = joint.M.R[:, 2], 1.3, 0.4
    spring = JointSpring("k", "j", "angle", float(axis @ body.inertia @ axis) * omega**2, 0.0, rest)
    mechanism = Mechanism("wound", np.zeros(3), (body,), (joint,), joint_springs=(spring,))
    first, rate = 0.9, 20.0
    state = initial_state(mechanism, Initial({"j": {"angle": first}}, {"j": {"angle": rate}}))
    tolerance, bar = {"dop853": (1e-12, 1e-9), "radau": (1e-7, 1e-5)}[method]
    times = np.linspace(0.0, 4.0, 9)
    f = KernelFormulation(mechanism, kernel)
    found = integrate(f, f.coordinates(state), times, tolerance, method).samples[:, -1]
    wanted = rest + (first - rest) * np.cos(omega * times) + rate / omega * np.sin(omega * times)
    assert np.ptp(wanted) > 8 * np.pi
    np.testing.assert_allclose(found, wanted, rtol=0, atol=bar)


# ---------------------------------------------------------------- refusals


def test_every_element_is_supported():
    assert all(unsupported(mechanism) == () for mechanism in ALL.values())


def test_an_unknown_kernel_is_refused_with_the_names():
    with pytest.raises(InvalidInput, match=r"formulation 'lagrange'.*descriptor, null_space, .*composite_body"):
        KernelFormulation(ALL["four_bar"], "lagrange")


@pytest.mark.parametrize("kernel", NAMES)
def test_a_spring_without_length_is_a_failure_and_not_a_number(kernel):
    bare = chain("revolute", "free", seed=91)
    state = initial_state(bare)
    # the attachment must equal the packed centre of mass exactly: rounding would leave a length above zero
    r = pack(bare, state)[1, :3]
    mechanism = replace(bare, springs=(Spring("k", GROUND, "b1", r, bare.bodies[1].com, 10.0, 0.0, 0.5),))
    f = KernelFormulation(mechanism, kernel)
    for question in (f.accelerations, f.reactions):
        with pytest.raises(NumericalFailure, match=kernel):
            question(state)
