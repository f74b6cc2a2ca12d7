"""Orientation coordinates against complex-step derivatives of independently written rotation matrices.

The rotations of the tests are matrix exponentials and Cayley transforms, which take complex arguments: their
derivatives are exact to rounding, and no formula is shared with the module.
"""

import pickle

import numpy as np
import pytest
from scipy.linalg import expm

from consilience.errors import ConsilienceError
from consilience.mechanism import quaternion_from_rotation_vector, rotation_from_quaternion
from consilience.reference.formulations.orientations import (
    NEAR_SINGULAR,
    ORIENTATIONS,
    SingularOrientation,
    switch_chart,
)

CHARTS = sorted(ORIENTATIONS)
SINGULAR_CHARTS = [name for name in CHARTS if name != "euler_parameters"]
SEEDS = range(12)
X, Y, Z = np.eye(3)
PI = np.pi


def tilde(a):
    """Return the skew matrix of a real or complex vector."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def turns(axes, angles):
    first, second, third = (expm(tilde(axis) * angle) for axis, angle in zip(axes, angles, strict=True))
    return first @ second @ third


def by_parameters(p):
    """Return the rotation by definition: ``v -> p v p*``, p as matrices of left and right multiplication."""
    left = np.block([[p[:1, None], -p[None, 1:]], [p[1:, None], p[0] * np.eye(3) + tilde(p[1:])]])
    right = np.block([[p[:1, None], -p[None, 1:]], [p[1:, None], p[0] * np.eye(3) - tilde(p[1:])]])
    return (left @ right.T)[1:, 1:]


INDEPENDENT = {
    "euler_parameters": by_parameters,
    "euler_angles": lambda x: turns((Z, X, Z), x),
    "bryant_angles": lambda x: turns((X, Y, Z), x),
    "rodrigues_parameters": lambda g: np.linalg.solve(np.eye(3) - tilde(g), np.eye(3) + tilde(g)),
    "rotation_vector": lambda phi: expm(tilde(phi)),
}


def random_point(name, rng, size=2.0):
    """Return coordinates away from singularities, and rates that keep the norm of Euler parameters."""
    while True:
        x, x_dot = rng.uniform(-size, size, (2, ORIENTATIONS[name].size))
        if name == "euler_parameters":
            x /= np.linalg.norm(x)
            x_dot -= x * (x @ x_dot)
        if ORIENTATIONS[name].distance_to_singularity(x) > 0.2:
            return x, x_dot


def angular_velocity(name, x, x_dot):
    """Return the vector of ``R' R^T`` by a complex step."""
    step = 1e-30
    spin = INDEPENDENT[name](x + 1j * step * x_dot).imag / step @ INDEPENDENT[name](x).real.T
    return np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]]) / 2


def slope(f, t=0.0, step=2e-3):
    """Return the derivative of f by a sixth-order central difference."""
    odd = [f(t + k * step) - f(t - k * step) for k in (1, 2, 3)]
    return (45 * odd[0] - 9 * odd[1] + odd[2]) / (60 * step)


def close(actual, desired, tolerance):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=tolerance * max(1.0, np.max(np.abs(desired))))


@pytest.fixture(params=CHARTS)
def name(request):
    return request.param


@pytest.fixture
def chart(name):
    return ORIENTATIONS[name]


def test_rotation_is_the_one_of_the_definition(name, chart):
    for seed in SEEDS:
        x, _ = random_point(name, np.random.default_rng(seed))
        assert x.shape == (chart.size,)
        close(chart.rotation(x), INDEPENDENT[name](x), 1e-14)


def test_h_matrix_gives_the_angular_velocity_of_the_rotation(name, chart):
    for seed in SEEDS:
        x, x_dot = random_point(name, np.random.default_rng(seed))
        assert chart.H(x).shape == (3, chart.size)
        close(chart.H(x) @ x_dot, angular_velocity(name, x, x_dot), 1e-13)


def test_h_vector_completes_the_angular_acceleration(name, chart):
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        x, x_dot = random_point(name, rng)
        x_ddot = rng.normal(size=chart.size)

        def w(t, x=x, x_dot=x_dot, x_ddot=x_ddot):
            return chart.H(x + t * x_dot + t * t / 2 * x_ddot) @ (x_dot + t * x_ddot)

        close(chart.H(x) @ x_ddot + chart.h(x, x_dot), slope(w), 1e-10)


def test_rates_invert_h_on_the_constraint(name, chart):
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        x, x_dot = random_point(name, rng)
        close(chart.rates(x, chart.H(x) @ x_dot), x_dot, 1e-13)
        w = rng.normal(size=3)
        close(chart.H(x) @ chart.rates(x, w), w, 1e-13)


def test_rates_of_euler_parameters_keep_their_length():
    p, _ = random_point("euler_parameters", np.random.default_rng(0))
    assert abs(p @ ORIENTATIONS["euler_parameters"].rates(p, np.array([1.0, -2.0, 3.0]))) < 1e-15


def test_coordinates_of_a_rotation_give_it_back(name, chart):
    for seed in SEEDS:
        quat = np.random.default_rng(seed).normal(size=4)
        quat /= np.linalg.norm(quat)
        R = rotation_from_quaternion(quat)
        for sign in (1, -1):
            close(chart.rotation(chart.from_quaternion(sign * quat)), R, 2e-15 / abs(quat[0]))
        close(chart.rotation(chart.from_rotation(R)), R, 4e-15 / abs(quat[0]))


def test_angles_come_out_in_their_ranges():
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        low, high = np.array([-PI, 0, -PI]), np.array([PI, PI, PI])
        for name, shift in (("euler_angles", 0.0), ("bryant_angles", PI / 2)):
            x = rng.uniform(low, high) - np.array([0, shift, 0])
            close(ORIENTATIONS[name].from_rotation(INDEPENDENT[name](x)), x, 1e-13)
            beyond = x + 2 * PI * rng.integers(-2, 3, size=3)
            close(ORIENTATIONS[name].from_rotation(INDEPENDENT[name](beyond)), x, 1e-13)


def motion(t):
    """Return unit Euler parameters along a smooth motion away from all singularities."""
    vector = np.array([0.9 + 0.4 * np.sin(1.1 * t), 0.7 * np.cos(0.6 * t), 0.5 + 0.5 * np.sin(0.8 * t + 1.0)])
    return quaternion_from_rotation_vector(vector)


@pytest.mark.parametrize("t", np.linspace(0.0, 2.0, 9))
def test_all_charts_agree_along_a_motion(t):
    R_dot, R = slope(lambda s: rotation_from_quaternion(motion(s)), t), rotation_from_quaternion(motion(t))
    spin = R_dot @ R.T
    w = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    assert np.linalg.norm(w) > 0.1
    accelerations = []
    for chart in ORIENTATIONS.values():

        def x_at(s, chart=chart):
            return chart.from_quaternion(motion(s))

        x, x_dot = x_at(t), slope(x_at, t)
        x_ddot = slope(lambda s, x_at=x_at: slope(x_at, s), t)
        close(chart.H(x) @ x_dot, w, 1e-9)
        close(chart.rates(x, w), x_dot, 1e-9)
        accelerations.append(chart.H(x) @ x_ddot + chart.h(x, x_dot))
    for acceleration in accelerations[1:]:
        close(acceleration, accelerations[0], 1e-8)


RIGHT = np.array([0.6, 0.0, 0.8])

SINGULAR_POSES = [
    ("euler_angles", [0.3, 0.0, -0.7], "theta", 0.0),
    ("euler_angles", [0.3, PI, -0.7], "theta", PI),
    ("euler_angles", [0.3, -PI, -0.7], "theta", -PI),
    ("bryant_angles", [0.3, PI / 2, -0.7], "beta", PI / 2),
    ("bryant_angles", [0.3, -PI / 2, -0.7], "beta", -PI / 2),
    ("rodrigues_parameters", 1e9 * RIGHT, "|phi|", PI),
    ("rotation_vector", 2 * PI * RIGHT, "|phi|", 2 * PI),
    ("rotation_vector", -4 * PI * RIGHT, "|phi|", 4 * PI),
]


@pytest.mark.parametrize(("name", "x", "angle", "value"), SINGULAR_POSES)
def test_a_singular_pose_is_refused_with_body_and_angle(name, x, angle, value):
    chart = ORIENTATIONS[name]
    assert chart.distance_to_singularity(np.array(x)) < 1e-8
    with pytest.raises(SingularOrientation) as caught:
        chart.rates(np.array(x), X, "coupler")
    error = caught.value
    assert isinstance(error, ConsilienceError)
    assert (error.body, error.coordinates, error.angle) == ("coupler", chart.name, angle)
    assert error.singular_value == pytest.approx(value, abs=1e-15)
    assert error.value == pytest.approx(value, abs=1e-8)
    for word in ("coupler", chart.name, angle, f"{value:.6f}", "rad away"):
        assert word in str(error)


TRUE_SINGULAR_POSES = [pose[:3] for pose in SINGULAR_POSES if pose[0] != "rotation_vector"]


@pytest.mark.parametrize(("name", "x", "angle"), TRUE_SINGULAR_POSES)
def test_coordinates_of_a_singular_rotation_are_refused(name, x, angle):
    R = np.diag([-1.0, -1.0, 1.0]) if name == "rodrigues_parameters" else INDEPENDENT[name](np.array(x))
    with pytest.raises(SingularOrientation, match=f"^link 2: .*{angle.replace('|', '.')} = ") as caught:
        ORIENTATIONS[name].from_rotation(R, "link 2")
    assert abs(caught.value.value - caught.value.singular_value) < 1e-15


def test_the_rotation_vector_describes_half_turns_and_no_turn():
    chart = ORIENTATIONS["rotation_vector"]
    half = chart.from_rotation(np.diag([-1.0, 1.0, -1.0]))
    close(np.abs(half), PI * Y, 1e-15)
    close(chart.from_rotation(np.eye(3)), np.zeros(3), 1e-15)


def pose_at(name, gap):
    """Return coordinates whose critical angle is `gap` (rad) short of the singular value."""
    return {
        "euler_angles": np.array([0.3, PI - gap, -0.7]),
        "bryant_angles": np.array([0.3, gap - PI / 2, -0.7]),
        "rodrigues_parameters": RIGHT / np.tan(gap / 2),
        "rotation_vector": (2 * PI - gap) * RIGHT,
    }[name]


SLOPE_OF_DISTANCE = {
    "euler_angles": 1.0,
    "bryant_angles": 1.0,
    "rodrigues_parameters": 0.5,
    "rotation_vector": 0.5 / PI,
}
"""Derivative of the distance to the singularity by the angle, 1/rad."""


@pytest.mark.parametrize("name", SINGULAR_CHARTS)
def test_rates_hold_up_to_the_stated_tolerance(name):
    chart, w = ORIENTATIONS[name], np.array([0.7, -0.4, 1.1])
    edge = NEAR_SINGULAR / SLOPE_OF_DISTANCE[name]
    assert chart.distance_to_singularity(pose_at(name, edge)) == pytest.approx(NEAR_SINGULAR, rel=1e-5)
    just_outside = pose_at(name, 1.001 * edge)
    close(chart.H(just_outside) @ chart.rates(just_outside, w), w, 1e-9)
    R = chart.rotation(just_outside)
    if name != "rotation_vector":
        close(chart.rotation(chart.from_rotation(R)), R, 1e-9)
    with pytest.raises(SingularOrientation) as caught:
        chart.rates(pose_at(name, 0.5 * edge), w)
    assert abs(caught.value.value - caught.value.singular_value) == pytest.approx(0.5 * edge, rel=1e-8)


@pytest.mark.parametrize("angle", [6.0, 7.0, 9.0, 14.0])
def test_rotation_vectors_of_more_than_a_turn_are_as_good_as_any_between_the_turns(angle):
    chart, w = ORIENTATIONS["rotation_vector"], np.array([0.7, -0.4, 1.1])
    phi_dot = chart.rates(angle * RIGHT, w)
    close(angular_velocity("rotation_vector", angle * RIGHT, phi_dot), w, 1e-12)


@pytest.mark.parametrize("gap", [2e-6, 1e-4])
@pytest.mark.parametrize("name", ["euler_angles", "bryant_angles"])
def test_near_a_singularity_angles_keep_the_rotation_to_rounding(name, gap):
    chart = ORIENTATIONS[name]
    R = INDEPENDENT[name](pose_at(name, gap))
    close(chart.rotation(chart.from_rotation(R)), R, 2e-15)


def test_the_distance_is_largest_where_the_coordinates_are_best():
    best = {"euler_angles": [1, PI / 2, 2], "bryant_angles": [1, 0, 2]}
    for name, chart in ORIENTATIONS.items():
        x = np.array(best.get(name, [0.0] * chart.size), dtype=float)
        assert chart.distance_to_singularity(x) == 1.0


@pytest.mark.parametrize("rotation", [np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, -1, 1]), [Z, X, Y]])
def test_euler_parameters_take_every_orientation(rotation):
    chart, w = ORIENTATIONS["euler_parameters"], np.array([1.0, 2.0, 3.0])
    p = chart.from_rotation(rotation)
    assert chart.distance_to_singularity(p) == 1.0
    close(chart.H(p) @ chart.rates(p, w), w, 1e-14)


def test_the_error_survives_the_way_out_of_a_process():
    with pytest.raises(SingularOrientation) as caught:
        ORIENTATIONS["euler_angles"].rates(np.array([0.0, 1e-8, 0.0]), X, "top")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.args, vars(copy)) == (str(caught.value), caught.value.args, vars(caught.value))


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-5, 1e-3, 0.1])
def test_small_rotation_vectors_are_exact_to_rounding(size):
    """First terms of the exponential: ``H = 1 + ~phi/2 + ~phi^2/6 + ~phi^3/24 + ..``."""
    chart, phi = ORIENTATIONS["rotation_vector"], size * RIGHT
    phi_dot, w = np.array([0.3, -1.2, 0.5]), np.array([1.0, 0.2, -0.7])
    S, S_dot = tilde(phi), tilde(phi_dot)
    H, h, power, factor = np.eye(3), np.zeros(3), np.eye(3), 1.0
    slope_of_power = np.zeros((3, 3))
    for k in range(1, 20):
        slope_of_power = slope_of_power @ S + power @ S_dot
        power = power @ S
        factor /= k + 1
        H = H + factor * power
        h = h + factor * slope_of_power @ phi_dot if k > 1 else h  # phi' x phi' is exactly zero, its rounding is not
    np.testing.assert_allclose(chart.H(phi), H, rtol=0, atol=3e-16)
    np.testing.assert_allclose(chart.h(phi, phi_dot), h, rtol=0, atol=3e-16 * size)
    np.testing.assert_allclose(chart.rates(phi, w), np.linalg.solve(H, w), rtol=0, atol=1e-15)
    np.testing.assert_allclose(chart.from_rotation(chart.rotation(phi)), phi, rtol=0, atol=3e-16)


def test_rotation_vector_has_no_seam_at_half_a_turn():
    chart, x_dot = ORIENTATIONS["rotation_vector"], np.array([0.3, -1.2, 0.5])
    below, above = (PI - 1e-13) * RIGHT, (PI + 1e-13) * RIGHT
    close(chart.H(below), chart.H(above), 1e-12)
    close(chart.h(below, x_dot), chart.h(above, x_dot), 1e-12)
    close(chart.rates(below, x_dot), chart.rates(above, x_dot), 1e-12)


@pytest.mark.parametrize("angle", [PI + 1e-9, 4.0, 6.0, 2 * PI, 8.0, 3 * PI + 0.1, 20.0])
def test_switching_the_chart_keeps_rotation_and_angular_velocity(angle):
    for seed in SEEDS:
        chart, (phi, phi_dot) = ORIENTATIONS["rotation_vector"], np.random.default_rng(seed).normal(size=(2, 3))
        phi *= angle / np.linalg.norm(phi)
        other, other_dot = switch_chart(phi, phi_dot)
        assert np.linalg.norm(other) <= PI * (1 + 1e-15)
        close(chart.rotation(other), chart.rotation(phi), 1e-14)
        close(chart.H(other) @ other_dot, angular_velocity("rotation_vector", phi, phi_dot), 1e-13)
        if angle < 3 * PI:
            close(other, phi * (1 - 2 * PI / angle), 1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-200, 1.0, np.nextafter(PI, 0)])
def test_the_chart_stays_up_to_half_a_turn(angle):
    phi, phi_dot = angle * Y, np.array([1.0, 2.0, 3.0])
    other, other_dot = switch_chart(phi, phi_dot)
    assert other is phi
    assert other_dot is phi_dot
