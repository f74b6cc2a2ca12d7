"""Constraint rows, coordinates and forces against finite differences of a moving mechanism.

Rows exist twice: in NumPy on body origins and world angular velocity, compiled on centres of mass and body angular
velocity. Both are compared.
"""

from dataclasses import replace

import numpy as np
import pytest

import truth
from consilience.mechanism import (
    BASIC_CONSTRAINTS,
    GROUND,
    JOINT_KINDS,
    Frame,
    Joint,
    Mechanism,
    RelativeMotion,
    State,
    constraint_gamma,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    elementary_rotation,
    free_directions,
    joint_coordinates,
    joint_frames,
    joint_rates,
    move,
    quaternion_from_rotation_vector,
    quaternion_product,
    reaction_in_F,
    relative_motion,
    rotation_from_quaternion,
    rotation_vector_from_quaternion,
    row_gamma,
    row_jacobian,
    row_value,
)
from consilience.mechanism.joint_rows import row_jacobians
from consilience.reference.bodies import constraints, forces
from consilience.reference.bodies.arrays import flatten, pack, workspace
from consilience.reference.bodies.motion import rotations
from mechanisms import ELEMENTS, GRAVITY, LOOPS, TREES, chain, drawn_joint, lumpy_body, rotation, states_of

ALL = TREES | LOOPS | ELEMENTS
SEEDS = range(4)
H = 1e-4
"""Step of the differences, s. Truncation error H^4, rounding eps / H (first) and eps / H^2 (second derivative)."""


def first_difference(f):
    """Return the first derivative at zero by a fourth-order central difference."""
    return (f(-2 * H) - 8 * f(-H) + 8 * f(H) - f(2 * H)) / (12 * H)


def second_difference(f, h=2e-3):
    return (-f(2 * h) + 16 * f(h) - 30 * f(0.0) + 16 * f(-h) - f(-2 * h)) / (12 * h * h)


def flying_pair(seed, kind="free"):
    """Return two lumpy bodies in free flight and a joint between them, none of whose rows is satisfied."""
    rng = np.random.default_rng(seed)
    bodies = {n: lumpy_body(n, rng) for n in ("i", "j")}
    F, M = (Frame(rng.normal(size=3), rotation(rng)) for _ in range(2))
    joints = (Joint("k", kind, "i", "j", F, M), drawn_joint("f", "free", bodies, GROUND, "i", np.zeros(3), np.eye(3)))
    quat = np.array([quaternion_from_rotation_vector(rng.normal(size=3)) for _ in range(2)])
    state = State(rng.normal(size=(2, 3)), quat, rng.normal(size=(2, 3)), rng.normal(size=(2, 3)))
    return Mechanism("pair", GRAVITY, tuple(bodies.values()), joints), state, rng.normal(size=(2, 6))


def at(state, acceleration, t):
    """Return the state after the time t: parabolas of the origins, rotations of constant angular acceleration.

    The rotation vector of ``w(t) = w + alpha t`` is ``w t + alpha t^2/2 + (alpha x w) t^3/12 + O(t^4)`` [Magnus].
    """
    v, w, a, alpha = state.v_WB_W, state.w_WB_W, acceleration[:, :3], acceleration[:, 3:]
    turn = w * t + 0.5 * alpha * t**2 + np.cross(alpha, w) * t**3 / 12
    quat = np.array(
        [quaternion_product(quaternion_from_rotation_vector(d), q) for d, q in zip(turn, state.quat_WB, strict=True)]
    )
    quat /= np.linalg.norm(quat, axis=1)[:, None]
    return State(state.p_WB + v * t + 0.5 * a * t**2, quat, v + a * t, w + alpha * t)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("row", BASIC_CONSTRAINTS)
def test_row_jacobian_is_the_rate_of_the_row(row, seed):
    mechanism, state, acceleration = flying_pair(seed)
    joint = mechanism.joints[0]
    velocity = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    found = row_jacobian(joint_frames(mechanism, state, joint), row) @ velocity
    expected = first_difference(lambda t: row_value(joint_frames(mechanism, at(state, acceleration, t), joint), row))
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-10)


def test_rows_together_are_each_by_itself():
    mechanism, state, _ = flying_pair(9)
    frames = joint_frames(mechanism, state, mechanism.joints[0])
    alone = [row_jacobian(frames, row) for row in BASIC_CONSTRAINTS]
    np.testing.assert_array_equal(row_jacobians(frames, tuple(BASIC_CONSTRAINTS)), alone)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("row", BASIC_CONSTRAINTS)
def test_row_gamma_is_what_is_missing_of_the_second_rate(row, seed):
    """``d2 phi / dt2 = Q a - gamma`` along a motion with the accelerations a."""
    mechanism, state, acceleration = flying_pair(seed)
    joint = mechanism.joints[0]
    frames = joint_frames(mechanism, state, joint)
    found = row_jacobian(frames, row) @ acceleration.ravel() - row_gamma(frames, row)
    second = second_difference(lambda t: row_value(joint_frames(mechanism, at(state, acceleration, t), joint), row))
    assert found == pytest.approx(second, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("row", BASIC_CONSTRAINTS)
def test_row_gamma_is_the_rate_of_the_jacobian_too(row):
    """``gamma = -dQ/dt v``: a first difference, more accurate than the second difference above."""
    mechanism, state, acceleration = flying_pair(9)
    joint = mechanism.joints[0]
    velocity = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    rate = first_difference(lambda t: row_jacobian(joint_frames(mechanism, at(state, acceleration, t), joint), row))
    assert row_gamma(joint_frames(mechanism, state, joint), row) == pytest.approx(-rate @ velocity, rel=1e-9, abs=1e-9)


def compiled(mechanism, state):
    """Return values, rows and gamma of the compiled kernels."""
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    rotations(y, ws.A)
    constraints.evaluate(model, 0.0, y, np.zeros(len(model.coordinate)), ws)
    return ws


def change_of_columns(mechanism, state):
    """Return T of ``(v_B, w_W) = T (v_cm, w')`` and the velocity terms of a_B that T leaves out, shape (6 n_b,).

    ``v_B = v_cm - w x c``, ``w = A w'``; hence ``a_B = a_cm - alpha x c - w x (w x c)``, ``alpha = A dw'/dt``.
    """
    n = len(mechanism.bodies)
    T, rest = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    for b, body in enumerate(mechanism.bodies):
        A = rotation_from_quaternion(state.quat_WB[b])
        c, w, o = A @ body.com, state.w_WB_W[b], 6 * b
        T[o : o + 3, o : o + 3] = np.eye(3)
        T[o : o + 3, o + 3 : o + 6] = np.column_stack([-np.cross(column, c) for column in A.T])
        T[o + 3 : o + 6, o + 3 : o + 6] = A
        rest[o : o + 3] = -np.cross(w, np.cross(w, c))
    return T, rest


def all_rows():
    """Return a joint kind with all thirteen basic constraints."""
    return replace(JOINT_KINDS["free"], rows=BASIC_CONSTRAINTS)


@pytest.mark.parametrize("seed", SEEDS)
def test_compiled_rows_are_those_of_numpy_for_all_thirteen(seed, monkeypatch):
    monkeypatch.setitem(JOINT_KINDS, "all", all_rows())
    mechanism, state, _ = flying_pair(seed, "all")
    ws = compiled(mechanism, state)
    T, rest = change_of_columns(mechanism, state)
    Q = constraint_jacobian(mechanism, state)
    assert Q.shape == (13, 12)
    np.testing.assert_allclose(ws.value, constraint_residual(mechanism, state), rtol=0, atol=1e-13)
    np.testing.assert_allclose(ws.Q, Q @ T, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ws.gamma, constraint_gamma(mechanism, state) - Q @ rest, rtol=0, atol=2e-12)


@pytest.mark.parametrize("name", ALL)
def test_compiled_rows_are_those_of_numpy_in_a_mechanism(name):
    mechanism = ALL[name]
    state = states_of(mechanism)[1]
    ws = compiled(mechanism, state)
    T, rest = change_of_columns(mechanism, state)
    Q = constraint_jacobian(mechanism, state)
    held = mechanism.holonomic_count
    np.testing.assert_allclose(ws.value[:held], constraint_residual(mechanism, state), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(ws.value[held:], 0)  # the value of non-holonomic rows is zero by definition
    np.testing.assert_allclose(ws.Q, Q @ T, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(ws.rate, constraint_rates(mechanism))
    assert np.any(ws.rate) == bool(mechanism.drives)
    bar = 1e-13 * max(1.0, np.max(np.abs(rest), initial=0.0), np.max(np.abs(ws.gamma), initial=0.0))
    np.testing.assert_allclose(ws.gamma, constraint_gamma(mechanism, state) - Q @ rest, rtol=0, atol=10 * bar)


FORCED = {
    "forced_chain": TREES["forced_chain"],
    "forced_slide": chain("prismatic", "cylindrical", seed=81, forces=True),
    "forced_backwards": chain("revolute", "prismatic", "revolute", seed=82, backwards=(1, 2), forces=True),
    "weight_only": LOOPS["four_bar"],
    "powered": ELEMENTS["powered"],
}


@pytest.mark.parametrize("name", FORCED)
@pytest.mark.parametrize("n", range(3))
def test_compiled_forces_are_the_wrenches_of_numpy(name, n):
    """Columns (v_cm, w'): force, torque about the centre of mass in body axes minus the gyroscopic torque."""
    mechanism, t = FORCED[name], 0.3 * n
    state = states_of(mechanism)[n]
    model = flatten(mechanism)
    ws, y = workspace(model), pack(mechanism, state)
    rotations(y, ws.A)
    turns = np.zeros(len(model.coordinate))
    forces.evaluate(model, t, y, turns, ws)
    T, _ = change_of_columns(mechanism, state)
    expected = (T.T @ truth.applied_wrenches(mechanism, state, t).ravel()).reshape(-1, 6)
    for b, body in enumerate(mechanism.bodies):
        w_body = rotation_from_quaternion(state.quat_WB[b]).T @ state.w_WB_W[b]
        expected[b, 3:] -= np.cross(w_body, body.inertia @ w_body)
    np.testing.assert_allclose(ws.f, expected.ravel(), rtol=0, atol=1e-13 * max(1, np.max(np.abs(expected))))


@pytest.mark.parametrize("name", ALL)
def test_inner_forces_add_up_to_nothing(name):
    """Forces between bodies, in joints or not, have no resultant: action and reaction."""
    mechanism = ALL[name]

    def between_bodies(elements):
        return tuple(e for e in elements if GROUND not in _ends(mechanism.joints[mechanism.joint_index[e.joint]]))

    inner = replace(
        mechanism,
        gravity=np.zeros(3),
        loads=(),
        springs=tuple(s for s in mechanism.springs if GROUND not in (s.predecessor, s.successor)),
        joint_springs=between_bodies(mechanism.joint_springs),
        frictions=between_bodies(mechanism.frictions),
        controls=between_bodies(mechanism.controls),
    )
    state = states_of(inner)[0]
    wrench = truth.applied_wrenches(inner, state)
    total = wrench[:, 3:] + np.cross(state.p_WB, wrench[:, :3])
    np.testing.assert_allclose(wrench[:, :3].sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(total.sum(axis=0), 0, atol=1e-12)
    if inner.joint_springs or inner.frictions or inner.controls:
        assert np.max(np.abs(wrench)) > 0.1


def _ends(joint):
    return joint.predecessor, joint.successor


@pytest.mark.parametrize("name", ALL)
def test_joint_rates_are_the_rates_of_the_coordinates(name):
    """Rates are derivatives along constant velocities of the bodies; orientations are compared by angular velocity."""
    mechanism = ALL[name]
    state = states_of(mechanism)[2]
    still = np.zeros((len(mechanism.bodies), 6))
    for joint in mechanism.joints:
        # constant velocities violate the joint at second order only; rates are of first order
        def coordinates(t, joint=joint):
            motion = relative_motion(mechanism, at(state, still, t), joint)
            return joint_coordinates(joint, motion)

        rates = joint_rates(joint, relative_motion(mechanism, state, joint))
        assert list(rates) == list(JOINT_KINDS[joint.kind].coordinates)
        now = coordinates(0.0)
        for coordinate, rate in rates.items():
            if coordinate == "orientation":
                inverse = now[coordinate] * [1, -1, -1, -1]
                difference = first_difference(
                    lambda t, c=coordinate, i=inverse, f=coordinates: rotation_vector_from_quaternion(
                        quaternion_product(f(t)[c], i)
                    )
                )
            else:
                difference = first_difference(lambda t, c=coordinate, f=coordinates: f(t)[c])
            np.testing.assert_allclose(rate, difference, rtol=1e-8, atol=1e-9)


# expected rotation R and position p of M in F, from the definition of each joint kind
COORDINATES = {
    "revolute": {"angle": 0.7},
    "prismatic": {"distance": -0.4},
    "cylindrical": {"distance": 0.3, "angle": -2.9},
    "universal": {"angle1": 2.0, "angle2": -1.1},
    "planar": {"x": 0.2, "y": -0.6, "angle": 1.9},
}


@pytest.mark.parametrize("kind", COORDINATES)
def test_joint_coordinates_are_those_the_motion_is_composed_of(kind):
    c = COORDINATES[kind]
    R = elementary_rotation(2, c.get("angle", c.get("angle1", 0.0))) @ elementary_rotation(0, c.get("angle2", 0.0))
    p = np.array([c.get("x", 0.0), c.get("y", 0.0), c.get("distance", 0.0)])
    found = joint_coordinates(ALL[f"single_{kind}"].joints[0], RelativeMotion(p, R, np.zeros(3), np.zeros(3)))
    assert {k: float(v) for k, v in found.items()} == pytest.approx(c, abs=1e-15)


@pytest.mark.parametrize("name", ALL)
def test_free_directions_are_annihilated_by_the_rows_and_as_many_as_the_joints_leave(name):
    mechanism = ALL[name]
    state = states_of(mechanism)[0]
    N = free_directions(mechanism, state)
    np.testing.assert_allclose(constraint_jacobian(mechanism, state) @ N, 0, atol=1e-13)
    np.testing.assert_allclose(N.T @ N, np.eye(N.shape[1]), rtol=0, atol=1e-13)
    by_theory = {
        "four_bar": 1,  # one freedom by planar motion; -2 by the formula of Gruebler-Kutzbach
        "slider_crank": 1,
        "four_bar_spherical": 1,
        "four_bar_cylindrical": 1,
        "loop_spherical": 2,  # 18 - (5 + 3 + 3 + 5): the coupler spins about the line through its balls
        "loop_universal": 1,
        "loop_rod": 18 - (5 + 3 + 1 + 5),
    }
    joints = sum(JOINT_KINDS[j.kind].freedom for j in mechanism.joints)
    # each drive and coupling removes one freedom, a skate one, a rolling body three: the normal and two of slip
    elements = len(mechanism.drives) + len(mechanism.couplings) + len(mechanism.skates) + 3 * len(mechanism.rollings)
    assert N.shape[1] == by_theory.get(name, joints - elements)


@pytest.mark.parametrize("name", ALL)
def test_small_steps_along_free_directions_leave_the_joints_closed(name):
    """Free directions, those of slip included, are tangents: the residual grows with the square of the step."""
    mechanism = ALL[name]
    state = states_of(mechanism)[0]
    N = free_directions(mechanism, state, holonomic=True)
    slip = 2 * len(mechanism.rollings) + len(mechanism.skates)
    assert N.shape[1] == free_directions(mechanism, state).shape[1] + slip
    residuals = [np.max(np.abs(constraint_residual(mechanism, move(state, N @ (h * np.ones(N.shape[1]))))), initial=0)
                 for h in (1e-4, 1e-5)]  # fmt: skip
    assert residuals[0] < 1e-6
    assert residuals[1] < 1e-8


def test_a_wrench_is_brought_into_the_one_convention():
    """A force at any point of the successor becomes the same wrench, whichever body and point it is stated for."""
    mechanism = chain("revolute", "universal", seed=83)
    state = states_of(mechanism)[0]
    joint = mechanism.joints[1]
    f = joint_frames(mechanism, state, joint)
    p_M = state.p_WB[1] + f.s_j
    force, torque, point = np.random.default_rng(2).normal(size=(3, 3))
    found = reaction_in_F(mechanism, state, joint, force, torque, point)
    np.testing.assert_allclose(f.U @ found[0], force, rtol=0, atol=1e-14)
    np.testing.assert_allclose(f.U @ found[1], torque + np.cross(point - p_M, force), rtol=0, atol=1e-14)
    back = reaction_in_F(mechanism, state, joint, -force, -torque, point, on_predecessor=True)
    np.testing.assert_allclose(back, found, rtol=0, atol=1e-15)
