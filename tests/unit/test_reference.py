"""The reference solver against dense NumPy, closed forms, and conservation laws that the solver does not impose."""

import functools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg

import truth
from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    JointSpring,
    Load,
    Mechanism,
    Spring,
    State,
    body_point,
    centres_of_mass,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    determinate_reactions,
    elementary_rotation,
    joint_rates,
    kinetic_energy,
    potential_energy,
    quaternion_from_rotation,
    relative_motion,
    rotation_angle_between,
    rotation_from_quaternion,
)
from consilience.mechanism.conditioning import mass_matrix_condition
from consilience.mechanism.observables import angular_momentum, linear_momentum, load_potentials
from consilience.reference import NumericalFailure, accelerations, simulate
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import flatten, pack, unpack, workspace
from consilience.reference.bodies.joint_rows import full_turns
from consilience.reference.bodies.mass_metric import mass_matrix
from consilience.reference.bodies.motion import rotations
from consilience.reference.bodies.projection import project
from consilience.reference.formulations import descriptor
from consilience.reference.formulations.compiled_choice import FORMULATIONS
from consilience.reference.formulations.null_space import basis
from consilience.reference.integrators.coefficients import DORMAND_PRINCE
from consilience.reference.integrators.tsitouras import TSITOURAS
from consilience.reference.kernel.factorisation import least_norm, pivoted_qr
from mechanisms import (
    ELEMENTS,
    GRAVITY,
    LOOPS,
    TREES,
    chain,
    drawn_joint,
    is_conservative,
    lumpy_body,
    rotation,
    states_of,
)

ALL = TREES | LOOPS | ELEMENTS
EPS = np.finfo(float).eps
ORIGIN = Frame(np.zeros(3), np.eye(3))


@functools.cache
def expected(name):
    """Return states of a mechanism, and their accelerations and reactions by dense NumPy."""
    states = states_of(ALL[name])
    return states, [truth.solve(ALL[name], s) for s in states]


def relative(found, wanted):
    return np.max(np.abs(found - wanted)) / np.max(np.abs(wanted))


def states_along(answer):
    arrays = (answer.p_WB, answer.quat_WB, answer.v_WB_W, answer.w_WB_W)
    return [State(*(a[n] for a in arrays)) for n in range(len(answer.time))]


# ---------------------------------------------------------------- accelerations, reactions, multipliers


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ALL)
def test_accelerations_are_those_of_dense_numpy(name, formulation):
    mechanism = ALL[name]
    states, solutions = expected(name)
    answer = accelerations(mechanism, states, formulation)
    found = np.concatenate([answer.a_WB_W, answer.alpha_WB_W], axis=2)
    ratios = [
        relative(f, np.hstack(s[:2])) / (1e-11 + 4 * EPS * mass_matrix_condition(mechanism, state))
        for f, s, state in zip(found, solutions, states, strict=True)
    ]
    assert np.max(ratios) < 1.0


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", [name for name in ALL if name != "single_free"])
def test_determined_reactions_are_those_of_dense_numpy(name, formulation):
    mechanism = ALL[name]
    states, solutions = expected(name)
    answer = accelerations(mechanism, states, formulation)
    errors = []
    for n, (state, solution) in enumerate(zip(states, solutions, strict=True)):
        known = determinate_reactions(mechanism, state)
        assert known.any()
        errors.append(
            relative(np.hstack([answer.force_F[n], answer.torque_F[n]])[known], np.hstack(solution[2:])[known])
        )
    assert np.max(errors) < 1e-10


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_free_joint_exerts_nothing(formulation):
    states, _ = expected("single_free")
    answer = accelerations(ALL["single_free"], states, formulation)
    assert np.all(answer.force_F == 0)
    assert np.all(answer.torque_F == 0)


@pytest.mark.parametrize("name", ALL)
def test_multipliers_satisfy_the_equations_and_have_least_norm(name):
    """``M a = f + Q^T lam``, ``Q a = gamma``, and lam has no part in the null space of ``Q^T``."""
    mechanism = ALL[name]
    model = flatten(mechanism)
    ws, a = workspace(model), np.empty(6 * len(mechanism.bodies))
    y = pack(mechanism, states_of(mechanism)[2])
    turns = np.zeros(len(model.coordinate))
    forces.count_turns(model, y, ws, turns)
    lam = descriptor.multipliers(model, 0.0, y, turns, ws, a)
    M, size = mass_matrix(model), max(1.0, np.max(np.abs(a)))
    np.testing.assert_allclose(M @ a, ws.f + ws.Q.T @ lam, rtol=0, atol=1e-11 * size)
    np.testing.assert_allclose(ws.Q @ a, ws.gamma, rtol=0, atol=1e-11 * size)
    open_space = scipy.linalg.null_space(ws.Q.T, rcond=1e-8) if len(lam) else np.zeros((0, 0))
    np.testing.assert_allclose(open_space.T @ lam, 0, atol=1e-11 * size)


def test_three_multipliers_of_the_planar_four_bar_are_open():
    """20 rows on 18 velocities leave one freedom: rank 17, so the null space of Q^T has dimension 3."""
    model = flatten(LOOPS["four_bar"])
    ws = workspace(model)
    y = pack(LOOPS["four_bar"], states_of(LOOPS["four_bar"])[0])
    assert ws.Q.shape == (20, 18)
    assert descriptor.accelerations(model, 0.0, y, np.zeros(0), ws, np.empty(18)) == 17


@pytest.mark.parametrize("name", ALL)
def test_null_space_basis_spans_what_the_rows_annihilate(name):
    mechanism = ALL[name]
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, states_of(mechanism)[1])
    rotations(y, ws.A)
    constraints.evaluate(model, 0.0, y, np.zeros(len(model.coordinate)), ws)
    J, abar = basis(ws.Q, ws.gamma, len(ws.Q))
    rank = np.linalg.matrix_rank(ws.Q, tol=1e-8) if len(ws.Q) else 0
    assert J.shape[1] == 6 * len(mechanism.bodies) - rank
    np.testing.assert_allclose(J.T @ J, np.eye(J.shape[1]), rtol=0, atol=1e-13)
    np.testing.assert_allclose(ws.Q @ J, 0, atol=1e-13)
    np.testing.assert_allclose(ws.Q @ abar, ws.gamma, rtol=0, atol=1e-11 * max(1, np.max(np.abs(ws.gamma), initial=0)))
    np.testing.assert_allclose(J.T @ abar, 0, atol=1e-11 * max(1, np.max(np.abs(ws.gamma), initial=0)))


@pytest.mark.parametrize("name", ALL)
def test_packing_a_state_and_unpacking_it_gives_it_back(name):
    mechanism = ALL[name]
    state = states_of(mechanism)[0]
    y, n = pack(mechanism, state), len(mechanism.bodies)
    r, v = centres_of_mass(mechanism, state)
    np.testing.assert_allclose(y[:n, 0:3], r, rtol=0, atol=1e-15 * 10)
    np.testing.assert_allclose(y[:n, 7:10], v, rtol=0, atol=1e-15 * 40)
    assert y[n:].size == (13 if mechanism.controls else 0)  # integrals of controllers
    assert np.all(y[n:] == 0)
    for found, wanted in zip(
        unpack(mechanism, y), (state.p_WB, state.quat_WB, state.v_WB_W, state.w_WB_W), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14)


# ---------------------------------------------------------------- factorisation


def matrix_of_rank(n, q, rank, seed):
    """Return a random matrix of given rank, with nonzero singular values between 0.5 and 2."""
    rng = np.random.default_rng(seed)
    U, V = np.linalg.qr(rng.normal(size=(n, n)))[0], np.linalg.qr(rng.normal(size=(q, q)))[0]
    return U[:, :rank] * rng.uniform(0.5, 2.0, size=rank) @ V[:, :rank].T


def factor(matrix):
    n, q = matrix.shape
    packed, tau = matrix.copy(), np.zeros(min(n, q))
    pivot, norms = np.zeros(q, dtype=np.int64), np.zeros(q)
    return packed, tau, pivot, pivoted_qr(packed, tau, pivot, norms, 0.0, packed.shape[1])


SHAPES = [(6, 6, 6), (12, 5, 5), (18, 20, 17), (18, 17, 9), (6, 9, 6), (5, 5, 1), (4, 3, 0)]


@pytest.mark.parametrize(("n", "q", "rank"), SHAPES)
def test_pivoted_qr_is_a_factorisation_and_finds_the_rank(n, q, rank):
    matrix = matrix_of_rank(n, q, rank, seed=n + q)
    packed, tau, pivot, found = factor(matrix)
    assert found == np.linalg.matrix_rank(matrix, tol=1e-10) == rank
    assert sorted(pivot) == list(range(q))
    H = np.eye(n)
    for k in range(rank):
        v = np.concatenate([np.zeros(k), [1.0], packed[k + 1 :, k]])
        H = H @ (np.eye(n) - tau[k] * np.outer(v, v))
    np.testing.assert_allclose(H.T @ H, np.eye(n), rtol=0, atol=1e-14)
    R = np.vstack([np.triu(packed[:rank]), np.zeros((n - rank, q))])
    np.testing.assert_allclose(H @ R, matrix[:, pivot], rtol=0, atol=1e-14)


@pytest.mark.parametrize(("n", "q", "rank"), SHAPES)
def test_pivoted_qr_takes_the_pivots_of_lapack(n, q, rank):
    matrix = matrix_of_rank(n, q, rank, seed=n + q)
    packed, _, pivot, _ = factor(matrix)
    R, P = scipy.linalg.qr(matrix, mode="r", pivoting=True)
    np.testing.assert_array_equal(pivot[:rank], P[:rank])
    diagonal = np.abs(np.diag(packed)[:rank])
    np.testing.assert_allclose(diagonal, np.abs(np.diag(R)[:rank]), rtol=1e-13)
    assert np.all(np.diff(diagonal) <= 0)


@pytest.mark.parametrize(("n", "q", "rank"), SHAPES)
def test_least_norm_is_that_of_the_pseudo_inverse(n, q, rank):
    matrix = matrix_of_rank(n, q, rank, seed=n + q)
    c = matrix.T @ np.random.default_rng(1).normal(size=n)  # consistent by construction
    packed, tau, pivot, found = factor(matrix)
    z = np.empty(n)
    least_norm(packed, tau, pivot, found, c, z)
    np.testing.assert_allclose(z, np.linalg.pinv(matrix.T, rcond=1e-10) @ c, rtol=0, atol=1e-13)


# ---------------------------------------------------------------- the Runge-Kutta pair


@functools.cache
def rooted_trees(order):
    """Return the rooted trees of that order, each as the sorted tuple of its subtrees [Butcher]."""

    def forests(nodes, largest):
        if nodes == 0:
            yield ()
        for size in range(min(nodes, largest[0]), 0, -1):
            for index, tree in enumerate(rooted_trees(size)):
                if (size, index) <= largest:
                    for rest in forests(nodes - size, (size, index)):
                        yield (tree, *rest)

    return list(forests(order - 1, (order, 0)))


def nodes(tree):
    return 1 + sum(nodes(t) for t in tree)


def density(tree):
    return nodes(tree) * int(np.prod([density(t) for t in tree], dtype=int))


def weights(tree, A):
    """Return the elementary weights of the stages, ``phi_i = prod over the subtrees of sum_j a_ij phi_j``."""
    return np.prod([A @ weights(t, A) for t in tree], axis=0) if tree else np.ones(len(A))


PAIRS = {"dop853": DORMAND_PRINCE, "tp86": TSITOURAS}


# numbers of rooted trees [Hairer, Norsett, Wanner, table II.2.1]
@pytest.mark.parametrize(("order", "count"), list(enumerate([1, 1, 2, 4, 9, 20, 48, 115], start=1)))
@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_pairs_of_order_eight_satisfy_every_order_condition(pair, order, count):
    trees = rooted_trees(order)
    assert len(trees) == len(set(trees)) == count
    errors = [pair.b @ weights(tree, pair.A) - float(Fraction(1, density(tree))) for tree in trees]
    assert np.max(np.abs(errors)) < 3e-14


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_pairs_of_order_eight_are_not_of_order_nine(pair):
    errors = [pair.b @ weights(tree, pair.A) - 1.0 / density(tree) for tree in rooted_trees(9)]
    assert np.max(np.abs(errors)) > 1e-7


@pytest.mark.parametrize(
    ("pair", "estimate", "order"),
    [
        (DORMAND_PRINCE, DORMAND_PRINCE.E[1], 3),
        (DORMAND_PRINCE, DORMAND_PRINCE.E[0], 5),
        (TSITOURAS, TSITOURAS.E[0], 6),
    ],
    ids=["dop853, E3", "dop853, E5", "tp86"],
)
def test_error_estimates_are_differences_to_methods_of_their_order(pair, estimate, order):
    below = [estimate @ weights(t, pair.A) for n in range(1, order + 1) for t in rooted_trees(n)]
    above = [estimate @ weights(t, pair.A) for t in rooted_trees(order + 1)]
    assert np.max(np.abs(below)) < 3e-14
    assert np.max(np.abs(above)) > 1e-5


def all_stages(pair):
    """Return the coefficients of all stages: those of the step, its end point, and those of the dense output."""
    s = len(pair.b)
    A = np.zeros((len(pair.D[0]), len(pair.D[0])))
    A[:s, :s], A[s, :s], A[s + 1 :] = pair.A, pair.b, pair.A_dense
    return A


def dense_weights(pair, x):
    """Return the weights of all stages in the dense output at the fraction x of a step, from its nested form."""
    ends, step = np.eye(len(pair.D[0])), np.append(pair.b, np.zeros(len(pair.D[0]) - len(pair.b)))
    first, last = ends[0], ends[len(pair.b)]
    total = np.zeros(len(pair.D[0]))
    for i, row in reversed(list(enumerate([step, first - step, 2 * step - first - last, *pair.D]))):
        total = (total + row) * (1 - x if i % 2 else x)
    return total


@pytest.mark.parametrize("x", [0.1, 0.37, 0.5, 0.81, 1.0])
@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_dense_outputs_satisfy_every_condition_of_order_seven(pair, x):
    A = all_stages(pair)
    np.testing.assert_allclose(A.sum(axis=1), [*pair.c, 1.0, *pair.c_dense], rtol=0, atol=3e-14)
    w = dense_weights(pair, x)
    errors = [
        [w @ weights(tree, A) - x**order / density(tree) for tree in rooted_trees(order)] for order in range(1, 9)
    ]
    assert max(np.max(np.abs(one)) for one in errors[:7]) < 3e-14
    assert np.max(np.abs(errors[7])) > 1e-7 or x == 1.0


def test_tp86_nodes_are_those_of_the_paper():
    """Published fractions, except c9 and c12, and c4 = 3/2 c3 [Tsitouras and Papakostas 1999, NEW8(6)]."""
    c4 = Fraction(12257, 79497)
    fractions = [0, Fraction(9, 142), c4 * 2 / 3, c4, *map(Fraction, ("50/129", "34/73", "23/148", "142/141"))]
    np.testing.assert_allclose(TSITOURAS.c[:8], [float(f) for f in fractions], rtol=0, atol=3e-14)
    np.testing.assert_allclose(TSITOURAS.c[9:], [83 / 91, 143 / 149, 1.0], rtol=0, atol=3e-14)
    assert np.all(np.triu(TSITOURAS.A) == 0)


def test_dop853_nodes_are_those_of_the_book():
    """Row sums: c4, c5 = (6 -+ sqrt 6)/30, c3 = 2/3 c4, c2 = 2/3 c3, the others rational [HNW section II.5, II.10]."""
    c4, c5 = (6 - np.sqrt(6)) / 30, (6 + np.sqrt(6)) / 30
    fractions = [1 / 3, 1 / 4, 4 / 13, 127 / 195, 3 / 5, 6 / 7, 1]
    np.testing.assert_allclose(DORMAND_PRINCE.c, [0, 4 / 9 * c4, 2 / 3 * c4, c4, c5, *fractions], rtol=0, atol=3e-14)
    assert np.all(np.triu(DORMAND_PRINCE.A) == 0)


# ---------------------------------------------------------------- projection


@pytest.mark.parametrize("name", [n for n, m in ALL.items() if m.constraint_count()])
def test_projection_brings_a_drifted_state_back(name):
    mechanism = ALL[name]
    model = flatten(mechanism)
    ws = workspace(model)
    y = pack(mechanism, states_of(mechanism)[0])
    rng = np.random.default_rng(11)
    y += 1e-6 * rng.normal(size=y.shape)
    drifted = y.copy()
    project(model, 0.0, y, np.zeros(len(model.coordinate)), ws)
    state = State(*unpack(mechanism, y))
    n = len(mechanism.bodies)
    speed = max(1.0, np.max(np.abs(y[:n, 7:])))
    assert np.max(np.abs(constraint_residual(mechanism, state))) < 1e-14 * max(1.0, np.max(np.abs(y[:, :3])))
    rates = constraint_jacobian(mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    assert np.max(np.abs(rates - constraint_rates(mechanism))) < 1e-14 * speed
    np.testing.assert_array_equal(y[n:], drifted[n:])  # projection does not change integrals of controllers
    assert 0 < np.max(np.abs(y - drifted)) < 1e-4  # the state changes, but only slightly


@pytest.mark.parametrize("name", ALL)
def test_projection_leaves_a_consistent_state_alone(name):
    mechanism = ALL[name]
    model = flatten(mechanism)
    y = pack(mechanism, states_of(mechanism)[0])
    before = y.copy()
    project(model, 0.0, y, np.zeros(len(model.coordinate)), workspace(model))
    assert np.max(np.abs(y - before)) < 1e-14 * max(1.0, np.max(np.abs(y)))


def test_projection_moves_as_little_mass_as_it_can():
    """The displacement is M-orthogonal to the free directions: ``J^T M step = 0``."""
    mechanism = LOOPS["loop_spherical"]
    model = flatten(mechanism)
    ws = workspace(model)
    y = pack(mechanism, states_of(mechanism)[0])
    y[:, 7:] += 1e-3 * np.random.default_rng(12).normal(size=(3, 6))
    before = y.copy()
    project(model, 0.0, y, np.zeros(len(model.coordinate)), ws)
    J, _ = basis(ws.Q, ws.gamma, len(ws.Q))
    change = (y - before)[:, 7:].ravel()
    assert np.linalg.norm(change) > 1e-4
    np.testing.assert_allclose(J.T @ mass_matrix(model) @ change, 0, atol=1e-15)


# ---------------------------------------------------------------- closed forms


def hinged(kind, seed=31, gravity=(0.0, 0.0, 0.0), **elements):
    """Return a lumpy body on a joint whose axis passes through its centre of mass."""
    rng = np.random.default_rng(seed)
    body, R = lumpy_body("b", rng), rotation(rng)
    at = body.drawing.p + body.drawing.R @ body.com
    joint = drawn_joint("j", kind, {"b": body}, GROUND, "b", at, R)
    return Mechanism(kind, np.array(gravity), (body,), (joint,), **elements)


def start(mechanism, angle=0.0, distance=0.0, rate=0.0, speed=0.0):
    """Return the state of the only body at given joint coordinates and rates, from the drawing."""
    body, joint = mechanism.bodies[0], mechanism.joints[0]
    axis = joint.F.R[:, 2]
    turn = joint.F.R @ elementary_rotation(2, angle) @ joint.F.R.T
    p = joint.F.p + turn @ (body.drawing.p - joint.F.p) + distance * axis
    quat = quaternion_from_rotation(turn @ body.drawing.R)
    w = rate * axis
    return State(p[None], quat[None], (speed * axis + np.cross(w, p - joint.F.p))[None], w[None])


def damped(t, x0, v0, omega, zeta):
    """Return the free response of ``x'' + 2 zeta omega x' + omega^2 x = 0``, zeta < 1."""
    wd = omega * np.sqrt(1 - zeta**2)
    return np.exp(-zeta * omega * t) * (x0 * np.cos(wd * t) + (v0 + zeta * omega * x0) / wd * np.sin(wd * t))


@pytest.mark.parametrize("zeta", [0.0, 0.1])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_torsion_spring_wound_over_several_turns_is_an_exact_cosine(zeta, formulation):
    """``I_axis theta'' = -k (theta - theta0) - c theta'``, axis through the centre of mass, amplitude 15 rad."""
    bare = hinged("revolute")
    body, joint = bare.bodies[0], bare.joints[0]
    axis = joint.M.R[:, 2]
    inertia, omega, rest = float(axis @ body.inertia @ axis), 1.3, 0.4
    spring = JointSpring("k", "j", "angle", inertia * omega**2, 2 * zeta * omega * inertia, rest)
    mechanism = replace(bare, joint_springs=(spring,))
    times, first, rate = np.linspace(0, 8, 81), 0.9, 20.0
    answer = simulate(mechanism, start(mechanism, angle=first, rate=rate), times, 1e-13, formulation)
    theta = rest + damped(times, first - rest, rate, omega, zeta)
    assert np.ptp(theta) > 4 * np.pi
    wanted = [start(mechanism, angle=angle).quat_WB[0] for angle in theta]
    assert np.max(rotation_angle_between(answer.quat_WB[:, 0], np.array(wanted))) < 1e-10


@pytest.mark.parametrize("element", ["joint_spring", "spring"])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_mass_on_a_slide_with_spring_and_damper_under_gravity(element, formulation):
    """``m x'' = m g.z - k (x - x0) - c x'``: a damped oscillation about the static position."""
    bare = hinged("prismatic", gravity=GRAVITY)
    body, joint = bare.bodies[0], bare.joints[0]
    k, c, axis = 40.0, 1.5, joint.F.R[:, 2]
    if element == "joint_spring":
        neutral = 0.15
        mechanism = replace(bare, joint_springs=(JointSpring("k", "j", "distance", k, c, neutral),))
    else:  # a spring along the slide, from a point 2 m behind the body: length 2 + x
        neutral = 0.15
        spring = Spring("k", GROUND, "b", joint.F.p - 2.0 * axis, joint.M.p, k, c, 2.0 + neutral)
        mechanism = replace(bare, springs=(spring,))
    sagged = neutral + body.mass * GRAVITY @ axis / k
    omega = np.sqrt(k / body.mass)
    times, x0, v0 = np.linspace(0, 5, 51), 0.3, -0.8
    answer = simulate(mechanism, start(mechanism, distance=x0, speed=v0), times, 1e-13, formulation)
    x = (answer.p_WB[:, 0] - body.drawing.p) @ axis
    wanted = sagged + damped(times, x0 - sagged, v0, omega, c / (2 * body.mass * omega))
    np.testing.assert_allclose(x, wanted, rtol=0, atol=1e-11)


def free_body(*loads, gravity=(0.0, 0.0, 0.0)):
    """Return a floating body with principal axes along those of B and its centre of mass off the origin."""
    inertia = np.diag([0.05, 0.08, 0.11])
    body = Body("b", 1.7, np.array([0.1, -0.2, 0.3]), inertia, ORIGIN)
    joint = drawn_joint("j", "free", {"b": body}, GROUND, "b", np.zeros(3), np.eye(3))
    return Mechanism("free", np.array(gravity), (body,), (joint,), loads=loads)


def moving(p=(0, 0, 0), v=(0, 0, 0), w=(0, 0, 0)):
    return State(np.array([p], float), np.array([[1.0, 0, 0, 0]]), np.array([v], float), np.array([w], float))


def com_of(mechanism, answer):
    return np.array([centres_of_mass(mechanism, s)[0][0] for s in states_along(answer)])


def test_a_thrown_body_falls_on_a_parabola_whatever_its_spin():
    mechanism = free_body(gravity=GRAVITY)
    state, t = moving(v=(1.0, 2.0, 3.0), w=(2.0, -3.0, 1.0)), np.linspace(0, 2, 21)
    answer = simulate(mechanism, state, t, 1e-13)
    (r0,), (v0,) = centres_of_mass(mechanism, state)
    wanted = r0 + np.outer(t, v0) + 0.5 * np.outer(t**2, GRAVITY)
    np.testing.assert_allclose(com_of(mechanism, answer), wanted, rtol=0, atol=1e-11)


def test_a_thrown_body_keeps_its_momenta():
    mechanism = free_body()
    answer = simulate(mechanism, moving(v=(1.0, 2.0, 3.0), w=(2.0, -3.0, 1.0)), np.linspace(0, 5, 21), 1e-13)
    along = states_along(answer)
    linear = np.array([linear_momentum(mechanism, s) for s in along])
    angular = np.array([angular_momentum(mechanism, s) for s in along])
    kinetic = np.array([kinetic_energy(mechanism, s) for s in along])
    np.testing.assert_allclose(linear, np.broadcast_to(linear[0], linear.shape), rtol=1e-12)
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), rtol=0, atol=1e-10)
    np.testing.assert_allclose(kinetic, kinetic[0], rtol=1e-11)
    assert np.ptp(answer.w_WB_W[:, 0], axis=0).max() > 1.0  # the motion is not trivial: the body tumbles


def test_a_floating_chain_keeps_its_momenta_without_gravity():
    """All joints of the chain are between bodies: their reactions and springs have no resultant."""
    mechanism = replace(TREES["floating_chain"], gravity=np.zeros(3))
    answer = simulate(mechanism, states_of(mechanism)[1], np.linspace(0, 1, 11), 1e-13)
    along = states_along(answer)
    for momentum in (linear_momentum, angular_momentum):
        values = np.array([momentum(mechanism, s) for s in along])
        assert np.max(np.abs(values - values[0])) < 1e-11 * np.max(np.abs(values[0]))


def test_a_force_fixed_in_the_world_at_the_centre_of_mass_gives_a_parabola():
    F = np.array([0.3, -0.4, 0.5])
    com = free_body().bodies[0].com
    mechanism = free_body(Load("f", "force", "b", F, "world", com))
    t = np.linspace(0, 2, 11)
    answer = simulate(mechanism, moving(), t, 1e-13)
    np.testing.assert_allclose(com_of(mechanism, answer), com + np.outer(t**2, F) / (2 * 1.7), rtol=0, atol=1e-12)
    np.testing.assert_allclose(answer.w_WB_W, 0, atol=1e-13)


def test_a_force_fixed_in_a_spinning_body_drives_its_centre_on_a_cycloid():
    """Spin W about the principal z: ``m r'' = F (cos Wt, sin Wt)``, so r = F/(m W^2) (1 - cos Wt, Wt - sin Wt)."""
    com, F, W = free_body().bodies[0].com, 0.9, 1.6
    mechanism = free_body(Load("f", "force", "b", np.array([F, 0, 0]), "body", com))
    w = np.array([0.0, 0.0, W])
    t = np.linspace(0, 6, 31)
    answer = simulate(mechanism, moving(v=-np.cross(w, com), w=w), t, 1e-13)
    x, y = F / (1.7 * W**2) * np.array([1 - np.cos(W * t), W * t - np.sin(W * t)])
    wanted = com + np.column_stack([x, y, 0 * t])
    np.testing.assert_allclose(com_of(mechanism, answer), wanted, rtol=0, atol=1e-11)


@pytest.mark.parametrize("frame", ["world", "body"])
def test_a_torque_about_a_principal_axis_winds_the_body_up_evenly(frame):
    torque = np.array([0.0, 0.5, 0.0])
    mechanism = free_body(Load("t", "torque", "b", torque, frame))
    t = np.linspace(0, 3, 31)
    answer = simulate(mechanism, moving(), t, 1e-13)
    np.testing.assert_allclose(answer.w_WB_W[:, 0], np.outer(t, torque) / 0.08, rtol=0, atol=1e-11)
    half = 0.5 * (0.5 * t**2 * 0.5 / 0.08)
    wanted = np.column_stack([np.cos(half), 0 * t, np.sin(half), 0 * t])
    assert np.max(rotation_angle_between(answer.quat_WB[:, 0], wanted)) < 1e-11
    com = mechanism.bodies[0].com
    np.testing.assert_allclose(com_of(mechanism, answer), np.broadcast_to(com, (31, 3)), rtol=0, atol=1e-11)


def test_world_and_body_torques_part_once_the_body_has_turned():
    """After a quarter turn about x, z' is -y of the world: the torque about z' differs from that about z."""
    inertia = np.array([0.05, 0.08, 0.11])
    quarter = State(
        np.zeros((1, 3)), np.array([[np.sqrt(0.5), np.sqrt(0.5), 0, 0]]), np.zeros((1, 3)), np.zeros((1, 3))
    )
    torque = np.array([0.0, 0.0, 0.6])
    alphas = [
        accelerations(free_body(Load("t", "torque", "b", torque, frame)), [quarter]).alpha_WB_W[0, 0]
        for frame in ("body", "world")
    ]
    np.testing.assert_allclose(alphas[0], [0, -0.6 / inertia[2], 0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(alphas[1], [0, 0, 0.6 / inertia[1]], rtol=0, atol=1e-14)  # z of the world is now y'


# ---------------------------------------------------------------- energy


CONSERVATIVE = [
    *("long_chain", "branched", "forced_chain", "four_bar", "loop_rod", "loop_universal"),
    # scleronomic constraints of elements do no work, the non-holonomic ones included
    *(name for name, m in ELEMENTS.items() if is_conservative(m)),
]


def undamped(mechanism):
    return replace(
        mechanism,
        springs=tuple(replace(s, damping=0.0) for s in mechanism.springs),
        joint_springs=tuple(replace(s, damping=0.0) for s in mechanism.joint_springs),
        loads=tuple(load for load in mechanism.loads if load.kind == "force" and load.frame == "world"),
    )


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", CONSERVATIVE)
def test_energy_of_a_conservative_mechanism_is_constant(name, formulation):
    mechanism = undamped(ALL[name])
    answer = simulate(mechanism, states_of(mechanism)[0], np.linspace(0, 0.5, 6), 1e-13, formulation)
    along = states_along(answer)
    kinetic = np.array([kinetic_energy(mechanism, s) for s in along])
    total = kinetic + [potential_energy(mechanism, s) + load_potentials(mechanism, s) for s in along]
    assert np.ptp(kinetic) > 0.1 * np.max(kinetic)  # the test needs an exchange of energy
    assert np.max(np.abs(total - total[0])) < 1e-11 * np.max(kinetic)


def power(mechanism, state):
    """Return the power of forces without a potential: dampers, torques, forces fixed in a body."""
    total = 0.0
    for spring in mechanism.springs:
        (p_i, v_i), (p_j, v_j) = (
            body_point(mechanism, state, spring.predecessor, spring.point_predecessor),
            body_point(mechanism, state, spring.successor, spring.point_successor),
        )
        rate = (p_j - p_i) @ (v_j - v_i) / np.linalg.norm(p_j - p_i)
        total -= spring.damping * rate**2
    for spring in mechanism.joint_springs:
        joint = mechanism.joints[mechanism.joint_index[spring.joint]]
        rate = joint_rates(joint, relative_motion(mechanism, state, joint))[spring.coordinate]
        total -= spring.damping * rate**2
    for load in mechanism.loads:
        i = mechanism.body_index[load.body]
        vector = load.vector if load.frame == "world" else rotation_from_quaternion(state.quat_WB[i]) @ load.vector
        if load.kind == "torque":
            total += vector @ state.w_WB_W[i]
        elif load.frame == "body":
            total += vector @ body_point(mechanism, state, load.body, load.point)[1]
    return float(total)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_energy_changes_by_the_work_of_dampers_and_loads(formulation):
    """``E(T) - E(0) = integral of the power``, by Gauss quadrature on the sampled motion."""
    mechanism, T = TREES["forced_chain"], 0.4
    x, w = np.polynomial.legendre.leggauss(30)
    times = np.concatenate([[0.0], 0.5 * T * (1 + x), [T]])
    along = states_along(simulate(mechanism, states_of(mechanism)[0], times, 1e-13, formulation))
    ends = (along[0], along[-1])
    energy = [
        kinetic_energy(mechanism, s) + potential_energy(mechanism, s) + load_potentials(mechanism, s) for s in ends
    ]
    work = 0.5 * T * w @ np.array([power(mechanism, s) for s in along[1:-1]])
    assert abs(work) > 0.1
    assert energy[1] - energy[0] == pytest.approx(work, rel=0, abs=1e-11 * max(map(abs, energy)))


# ---------------------------------------------------------------- control of the error


SWINGING = chain("revolute", "spherical", "universal", seed=62)


@functools.cache
def swinging(tolerance, samples=2, state=0):
    return simulate(SWINGING, states_of(SWINGING, 12)[state], np.linspace(0.0, 1.0, samples), tolerance)


def test_error_is_proportional_to_the_tolerance():
    """In the mean over twelve states: at the end of a single motion errors of its steps may cancel."""
    tolerances, errors = np.array([1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11]), []
    for state in range(12):
        best = swinging(1e-14, state=state).p_WB[-1]
        errors.append([np.max(np.abs(swinging(t, state=state).p_WB[-1] - best)) for t in tolerances])
    assert np.all(errors < 10 * tolerances)
    slope = np.polyfit(np.log10(tolerances), np.mean(np.log10(errors), axis=0), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.2)


def test_steps_grow_with_the_eighth_root_of_the_tolerance():
    """The controlled error of a step goes with h^8: a tolerance 10^-4 times smaller needs sqrt(10) as many steps."""
    coarse, fine = (swinging(t).counters["steps"] for t in (1e-8, 1e-12))
    assert fine / coarse == pytest.approx(10.0**0.5, rel=0.1)


def test_samples_do_not_disturb_the_motion():
    few, many = swinging(1e-13), swinging(1e-13, samples=201)
    np.testing.assert_allclose(many.p_WB[-1], few.p_WB[-1], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(many.time, np.linspace(0.0, 1.0, 201))
    assert many.counters["steps"] >= 200 > few.counters["steps"]
    assert many.counters["evaluations"] == 12 * (many.counters["steps"] + many.counters["rejected"])


def test_a_single_sample_is_the_initial_state():
    mechanism = TREES["long_chain"]
    state = states_of(mechanism)[0]
    answer = simulate(mechanism, state, np.array([0.0]))
    np.testing.assert_allclose(answer.p_WB[0], state.p_WB, rtol=0, atol=1e-14)
    np.testing.assert_allclose(answer.w_WB_W[0], state.w_WB_W, rtol=0, atol=1e-14)


def test_time_may_start_anywhere():
    mechanism = TREES["long_chain"]
    state = states_of(mechanism)[0]
    late = simulate(mechanism, state, np.array([7.0, 7.25]))
    early = simulate(mechanism, state, np.array([0.0, 0.25]))
    np.testing.assert_allclose(late.p_WB, early.p_WB, rtol=0, atol=1e-11)


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"formulation": "kane"}, "formulation 'kane'.*descriptor, null_space"),
        ({"tolerance": 1e-15}, "tolerance.*1e-14 to 1e-3"),
        ({"tolerance": 0.1}, "tolerance"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"times": [0.0, 1.0, 1.0]}, "times"),
        ({"times": [0.0, -1.0]}, "times"),
        ({"times": []}, "times"),
        ({"times": [[0.0, 1.0]]}, "times"),
        ({"times": [0.0, float("nan")]}, "times"),
        ({"times": [0.0, float("inf")]}, "times"),
    ],
)
def test_arguments_that_mean_nothing_are_refused(arguments, message):
    mechanism = free_body()
    with pytest.raises(InvalidInput, match=message):
        simulate(mechanism, moving(), **{"times": np.array([0.0, 0.1]), **arguments})


def test_accelerations_refuse_an_unknown_formulation():
    with pytest.raises(InvalidInput, match="formulation 'kane'"):
        accelerations(free_body(), [moving()], "kane")


def test_a_motion_that_grows_without_bound_is_a_failure_with_a_reason():
    """A spring of negative stiffness, L'' = 10^6 (L - 1): exp(1000 t) squared overflows at t = 0.35 s."""
    body = Body("b", 1.0, np.zeros(3), 0.1 * np.eye(3), ORIGIN)
    joint = drawn_joint("j", "free", {"b": body}, GROUND, "b", np.zeros(3), np.eye(3))
    spring = Spring("k", GROUND, "b", np.zeros(3), np.zeros(3), -1e6, 0.0, 1.0)
    mechanism = Mechanism("runaway", np.zeros(3), (body,), (joint,), (spring,))
    with pytest.raises(NumericalFailure, match=r"reference, descriptor, tolerance 1e-06: .*(not finite|grows)"):
        simulate(mechanism, moving(p=(2.0, 0, 0)), np.array([0.0, 1.0]), 1e-6)


def test_a_spring_without_length_has_no_direction_and_says_so():
    spring = Spring("k", GROUND, "b", np.zeros(3), np.zeros(3), 10.0, 0.0, 0.5)
    mechanism = replace(free_body(), springs=(spring,))
    with pytest.raises(NumericalFailure):
        simulate(mechanism, moving(), np.array([0.0, 0.1]))


def test_full_turns_are_those_nearest_to_the_angle_before():
    angles = np.linspace(-30.0, 30.0, 241)
    folded = np.arctan2(np.sin(angles), np.cos(angles))
    near = angles + 0.9 * np.pi * np.sin(angles)
    found = [full_turns(a, n) for a, n in zip(folded, near, strict=True)]
    np.testing.assert_allclose(found, angles, rtol=0, atol=1e-13)
