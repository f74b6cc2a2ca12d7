"""Rotations and frames against SciPy, the matrix exponential, Rodrigues' formula and worked examples."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from consilience.mechanism import (
    continuous_in_time,
    cross,
    elementary_rotation,
    euler_parameter_matrix,
    orthogonal_triad,
    quaternion_from_rotation,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_angle_between,
    rotation_from_bryant_xyz,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
    rotation_from_three_points,
    rotation_vector_from_quaternion,
    rotation_with_z_axis,
    skew,
)

SEEDS = range(8)
AXES = np.eye(3)


def random_quaternion(rng):
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def same_rotation(p, q, atol=1e-15):
    np.testing.assert_allclose(np.outer(p, p), np.outer(q, q), rtol=0, atol=atol)


@pytest.mark.parametrize("seed", SEEDS)
def test_skew_is_the_cross_product(seed):
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(skew(a).T, -skew(a))
    np.testing.assert_array_equal(cross(a, b), np.cross(a, b))


@pytest.mark.parametrize("seed", SEEDS)
def test_matrix_of_a_quaternion_is_that_of_scipy(seed):
    q = random_quaternion(np.random.default_rng(seed))
    expected = Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix()  # SciPy has the scalar last
    np.testing.assert_allclose(rotation_from_quaternion(q), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("axis", range(3))
def test_quarter_turns_are_known_by_heart(axis):
    q = np.zeros(4)
    q[0] = q[1 + axis] = np.sqrt(0.5)
    b, d = AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]
    for R in (rotation_from_quaternion(q), elementary_rotation(axis, np.pi / 2)):
        np.testing.assert_allclose(R @ AXES[axis], AXES[axis], rtol=0, atol=1e-15)
        np.testing.assert_allclose(R @ b, d, rtol=0, atol=1e-15)
        np.testing.assert_allclose(R @ d, -b, rtol=0, atol=1e-15)


def test_a_stack_of_quaternions_is_converted_one_by_one():
    q = np.random.default_rng(3).normal(size=(2, 5, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    R = rotation_from_quaternion(q)
    assert R.shape == (2, 5, 3, 3)
    expected = Rotation.from_quat(q[1, 4, [1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(R[1, 4], expected, rtol=0, atol=1e-15)
    back = quaternion_from_rotation(R)
    assert back.shape == (2, 5, 4)
    same_rotation(back[1, 4], q[1, 4])


@pytest.mark.parametrize("largest", range(4))
@pytest.mark.parametrize("size", [1.0, 1e-4, 1e-9, 0.0])
def test_quaternion_comes_back_from_its_matrix_whichever_component_is_largest(largest, size):
    q = size * np.array([0.3, -0.2, 0.25, 0.35])
    q[largest] = 1.0
    q /= np.linalg.norm(q)
    back = quaternion_from_rotation(rotation_from_quaternion(q))
    np.testing.assert_allclose(back, q, rtol=0, atol=4e-16)  # in both, the largest component is positive
    assert np.linalg.norm(back) == pytest.approx(1.0, abs=3e-16)


@pytest.mark.parametrize("seed", SEEDS)
def test_product_of_quaternions_is_the_product_of_matrices(seed):
    rng = np.random.default_rng(seed)
    p, q = random_quaternion(rng), random_quaternion(rng)
    R = rotation_from_quaternion(quaternion_product(p, q))
    np.testing.assert_allclose(R, rotation_from_quaternion(p) @ rotation_from_quaternion(q), rtol=0, atol=2e-15)


def test_quaternion_units_multiply_by_hamiltons_rules():
    one, i, j, k = np.eye(4)
    for a, b, ab in [(i, j, k), (j, k, i), (k, i, j), (i, i, -one), (j, j, -one), (k, k, -one), (one, k, k)]:
        np.testing.assert_array_equal(quaternion_product(a, b), ab)
    np.testing.assert_array_equal(quaternion_product(np.array([i, j]), np.array([j, k])), [k, i])


@pytest.mark.parametrize("seed", SEEDS)
def test_rotation_vector_is_the_logarithm_of_the_matrix(seed):
    phi = np.random.default_rng(seed).uniform(-1.8, 1.8, size=3)  # length at most 3.12 < pi
    q = quaternion_from_rotation_vector(phi)
    np.testing.assert_allclose(rotation_from_quaternion(q), expm(skew(phi)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(rotation_vector_from_quaternion(q), phi, rtol=0, atol=2e-15)
    np.testing.assert_allclose(rotation_vector_from_quaternion(-q), phi, rtol=0, atol=2e-15)


@pytest.mark.parametrize("angle", [1e-3, 1e-6, 1.9e-9, 2.1e-9, 1e-12, 1e-160])
def test_small_rotations_keep_all_their_digits(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = quaternion_from_rotation_vector(angle * axis)
    np.testing.assert_allclose(q[1:], np.sin(angle / 2) * axis, rtol=1e-15)
    np.testing.assert_allclose(rotation_vector_from_quaternion(q), angle * axis, rtol=1e-15)


def test_no_rotation_has_the_zero_vector():
    np.testing.assert_array_equal(quaternion_from_rotation_vector(np.zeros(3)), [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(rotation_vector_from_quaternion([1.0, 0.0, 0.0, 0.0]), np.zeros(3))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("angle", [-2.5, 0.3, 7.0])
def test_elementary_rotation_is_the_exponential(axis, angle):
    expected = expm(angle * skew(AXES[axis]))
    np.testing.assert_allclose(elementary_rotation(axis, angle), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("function", "sequence"), [(rotation_from_euler_zxz, "ZXZ"), (rotation_from_bryant_xyz, "XYZ")]
)
def test_angles_turn_about_the_carried_axes_as_in_scipy(function, sequence, seed):
    angles = np.random.default_rng(seed).uniform(-3, 3, size=3)
    expected = Rotation.from_euler(sequence, angles).as_matrix()  # capital letters: body-fixed axes
    np.testing.assert_allclose(function(angles), expected, rtol=0, atol=1e-15)


def test_frame_of_three_points_worked_example():
    """INTRO: O (1,2,3), P (0,2,3), Q (-1,1,3) gives i = (-1,0,0), k = (0,0,1), so j = k x i = (0,-1,0)."""
    R = rotation_from_three_points([1, 2, 3], [0, 2, 3], [-1, 1, 3])
    np.testing.assert_array_equal(R, np.array([[-1.0, 0, 0], [0, -1, 0], [0, 0, 1]]).T)


@pytest.mark.parametrize("seed", SEEDS)
def test_frame_of_three_points_has_p_on_x_and_q_in_the_upper_half_of_xy(seed):
    O, P, Q = np.random.default_rng(seed).normal(size=(3, 3))
    R = rotation_from_three_points(O, P, Q)
    np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-15)
    p, q = R.T @ (P - O), R.T @ (Q - O)
    np.testing.assert_allclose(p, [np.linalg.norm(P - O), 0, 0], rtol=0, atol=1e-15 * 10)
    assert abs(q[2]) < 1e-14
    assert q[1] > 0


def test_three_points_on_a_line_make_no_frame():
    with pytest.raises(ValueError, match="one line"):
        rotation_from_three_points([1, 2, 3], [2, 4, 6], [5, 10, 15])


def test_orthogonal_triad_worked_example():
    """INTRO: a = (1,0,-3) gives a1 = (3,-3,1) and a2 = (9,10,3)."""
    a1, a2 = orthogonal_triad([1, 0, -3])
    np.testing.assert_array_equal(a1, [3, -3, 1])
    np.testing.assert_array_equal(a2, [9, 10, 3])


@pytest.mark.parametrize("a", [*np.eye(3), *-np.eye(3), *np.random.default_rng(1).normal(size=(4, 3))], ids=str)
def test_orthogonal_triad_is_orthogonal_and_right_handed(a):
    a1, a2 = orthogonal_triad(a)
    assert max(abs(a @ a1), abs(a @ a2), abs(a1 @ a2)) < 1e-14
    np.testing.assert_allclose(np.cross(a, a2), (a @ a) * a1, rtol=0, atol=1e-14)  # a x (a1 x a), |a| |a1| > 0
    assert np.linalg.norm(a1) > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_frame_of_an_axis_has_it_as_z_and_the_second_in_the_upper_half_of_xz(seed):
    axis, second = np.random.default_rng(seed).normal(size=(2, 3))
    for R in (rotation_with_z_axis(axis, second), rotation_with_z_axis(axis)):
        np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=5e-15)
        assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-15)
        np.testing.assert_allclose(R[:, 2], axis / np.linalg.norm(axis), rtol=0, atol=1e-15)
    components = rotation_with_z_axis(axis, second).T @ second
    assert components[0] > 0
    assert abs(components[1]) < 1e-14


@pytest.mark.parametrize("angle", [1e-2, 1e-5, 1e-8])
def test_frame_of_two_nearly_parallel_axes_is_still_orthogonal_to_rounding(angle):
    axis, across = np.array([2.0, -1.0, 2.0]) / 3.0, np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)
    R = rotation_with_z_axis(axis, np.cos(angle) * axis + np.sin(angle) * across)
    np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=2e-15)


@pytest.mark.parametrize(
    ("axis", "second", "message"),
    [([0, 0, 0], None, "zero vector"), ([0, 0, 2], [0, 0, -3], "parallel"), ([0, 0, 2], [0, 0, 0], "zero")],
)
def test_axes_that_make_no_frame_are_refused(axis, second, message):
    with pytest.raises(ValueError, match=message):
        rotation_with_z_axis(axis, second)


@pytest.mark.parametrize("seed", SEEDS)
def test_euler_parameter_matrix_turns_rates_into_body_angular_velocity(seed):
    rng = np.random.default_rng(seed)
    q, w_body, h = random_quaternion(rng), rng.normal(size=3), 1e-5
    G = euler_parameter_matrix(q)
    np.testing.assert_allclose(G @ G.T, np.eye(3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(G @ q, np.zeros(3), rtol=0, atol=1e-15)
    # rotation at constant w': q(t) = q exp(w' t / 2)
    ahead, behind = (quaternion_product(q, quaternion_from_rotation_vector(s * h * w_body)) for s in (1, -1))
    rate = (ahead - behind) / (2 * h)
    np.testing.assert_allclose(0.5 * G.T @ w_body, rate, rtol=0, atol=1e-9)
    np.testing.assert_allclose(2.0 * G @ rate, w_body, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [1e-12, 1e-8, 1e-3, 1.0, 3.0, np.pi])
@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1)])
def test_angle_between_orientations_is_the_angle_of_the_turn_between_them(angle, signs):
    rng = np.random.default_rng(4)
    a, axis = random_quaternion(rng), rng.normal(size=3)
    turn = quaternion_from_rotation_vector(angle * axis / np.linalg.norm(axis))
    b = quaternion_product(a, turn)
    assert rotation_angle_between(signs[0] * a, signs[1] * b) == pytest.approx(angle, rel=1e-12, abs=1e-15)


def test_angle_between_orientations_works_on_stacks():
    q = np.random.default_rng(5).normal(size=(4, 2, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    expected = (Rotation.from_quat(q[0][:, [1, 2, 3, 0]]).inv() * Rotation.from_quat(q[1][:, [1, 2, 3, 0]])).magnitude()
    np.testing.assert_allclose(rotation_angle_between(q[0], q[1]), expected, rtol=1e-14)


def test_a_continuous_series_of_quaternions_is_what_signs_made_of_it():
    """Two bodies through two turns: random signs of the samples are removed."""
    angles = np.linspace(0.2, 4 * np.pi, 60)
    axes = np.array([[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])
    steady = np.array([[quaternion_from_rotation_vector(a * axis) for axis in axes] for a in angles])
    signs = np.random.default_rng(6).choice([-1.0, 1.0], size=(60, 2, 1))
    np.testing.assert_array_equal(continuous_in_time(steady * signs), steady)
    single = continuous_in_time(steady[:, 0] * signs[:, 0])
    np.testing.assert_array_equal(single, steady[:, 0])
    assert continuous_in_time(np.zeros((0, 2, 4))).shape == (0, 2, 4)


def test_a_continuous_series_leaves_its_argument_alone():
    q = np.array([[-1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(continuous_in_time(q), [[1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    assert q[0, 0] == -1.0
