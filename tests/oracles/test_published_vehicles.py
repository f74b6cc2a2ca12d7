"""The reference solver on published vehicles: the car axis (drives) and the Whipple bicycle (rolling)."""

import numpy as np
import pytest
from scipy.linalg import expm

from consilience.mechanism import (
    constraint_jacobian,
    constraint_residual,
    kinetic_energy,
    potential_energy,
    rotation_from_quaternion,
)
from consilience.reference import accelerations
from oracles.benchmarks import bicycle, car_axis
from oracles.benchmarks.build import X, Y, run, run_disguised
from oracles.benchmarks.compare import BAR, far

# --- car axis -------------------------------------------------------------------------------------------------------

# at 3 s: left and right mass, their velocities, multipliers of the line and of the rod. Printed with 18 and more
# digits by the test set; an independent solution differs by 2e-13 in positions and 5e-12 in velocities
CAR_POINTS = ((0.493455784275402809122e-1, 0.496989460230171153861), (1.04174252488542151681, 0.373911027265361256927))
CAR_VELOCITIES = (
    (-0.770583684040972357970e-1, 0.744686658723778553466e-2),
    (0.175568157537232222276e-1, 0.770341043779251976443),
)
CAR_LAMBDA = (-0.473688659084893324729e-2, -0.110468033125734368808e-2)


@pytest.fixture(scope="module", params=car_axis.MAKES)
def driven(request):
    plain, start = car_axis.car_axis(request.param)
    return plain, start, run(plain, start, [3.0])


def test_car_axis(driven):
    plain, start, motion = driven
    points = [plain.body_index[name] for name in ("left", "right")]
    for found in (motion, run_disguised(plain, start, [3.0], seed=3)):
        assert far(found.p[0, points, :2], np.array(CAR_POINTS)) < 2e-12
        assert far(found.v[0, points, :2], np.array(CAR_VELOCITIES)) < BAR


def test_car_axis_multipliers(driven):
    plain, _, motion = driven
    end = motion.state(0)
    left, right = (end.p_WB[plain.body_index[name]] for name in ("left", "right"))
    forces = accelerations(plain, [end], t=3.0).force_F[0]
    # forces on the left mass: lam1 times the vector to the right wheel, of length one; 2 lam2 (l - r)
    line, rod = (forces[plain.joint_index[name]] for name in ("upright", "bar"))
    assert line == pytest.approx((0, 0, CAR_LAMBDA[0]), abs=1e-12)
    assert car_axis.ACROSS @ rod == pytest.approx(2 * CAR_LAMBDA[1] * (left - right), abs=1e-12)


# --- Whipple bicycle ------------------------------------------------------------------------------------------------

# Meijaard, Papadopoulos, Ruina & Schwab 2007: coefficients of the linear equations, 15 digits
M = np.array([(80.81722, 2.31941332208709), (2.31941332208709, 0.29784188199686)])
C1 = np.array([(0, 33.86641391492494), (-0.85035641456978, 1.68540397397560)])
K0 = np.array([(-80.95, -2.59951685249872), (-2.59951685249872, -0.80329488458618)])
K2 = np.array([(0, 76.59734589573222), (0, 2.65431523794604)])
# speed v; eigenvalues of castering, capsize and weave (real and imaginary part); 1/s
EIGENVALUES = [
    (1, -7.11008014637442, -3.13423125066578, 3.52696170990070, 0.80774027519931),
    (2, -8.67387984831735, -3.07158645641514, 2.68234517512745, 1.68066296590675),
    (3, -10.35101467245920, -2.63366137253667, 1.70675605663975, 2.31582447384325),
    (4, -12.15861426576450, -1.42944427361326, 0.41325331521125, 3.07910818603206),
    (5, -14.07838969279820, -0.32286642900409, -0.77534188219585, 4.46486771378823),
    (6, -16.08537123098030, -0.00406690076970, -1.52644486584142, 5.87673060598709),
    (7, -18.15788466125262, 0.10268170574766, -2.13875644258362, 7.19525913329805),
    (8, -20.27940894394569, 0.14327879765713, -2.69348683581097, 8.46037971396931),
    (9, -22.43788559040858, 0.15790184030917, -3.21675402252485, 9.69377351531791),
    (10, -24.62459635017404, 0.16105338653172, -3.72016840437287, 10.90681139476287),
]
AT_REST = (-5.53094371765393, -3.13164324790656, 3.13164324790656, 5.53094371765393)
WEAVE_SPEED, WEAVE_FREQUENCY, CAPSIZE_SPEED = 4.29238253634111, 3.43503384866144, 6.02426201538837


def eigenvalues(in_angles, in_rates):
    """Eigenvalues of lean and steer from the linear parts of their accelerations, sorted by real part."""
    return np.sort_complex(np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [in_angles, in_rates]])))


@pytest.mark.parametrize("speed", [0.0, 1.0, 5.0, 10.0])
def test_bicycle_linear_equations(speed):
    in_torques, in_angles, in_rates = bicycle.response(speed)
    mass = np.linalg.inv(in_torques)
    # relative to the largest entry: rounding of the differences
    assert far(mass, M) < 1e-12
    assert far(-mass @ in_angles, bicycle.G * K0 + speed**2 * K2) < 1e-12
    assert far(-mass @ in_rates, speed * C1) < 1e-12


@pytest.mark.parametrize("row", EIGENVALUES, ids=lambda row: f"v={row[0]}")
def test_bicycle_eigenvalues(row):
    speed, castering, capsize, re, im = row
    _, in_angles, in_rates = bicycle.response(float(speed))
    expected = np.sort_complex([castering, capsize, complex(re, im), complex(re, -im)])
    assert eigenvalues(in_angles, in_rates) == pytest.approx(expected, abs=1e-11)


def test_bicycle_eigenvalues_at_rest():
    _, in_angles, in_rates = bicycle.response(0.0)
    assert eigenvalues(in_angles, in_rates) == pytest.approx(np.array(AT_REST), abs=1e-11)


def test_bicycle_stability_limits():
    # the bicycle is stable between the speed where weave stops growing and the speed where capsize sets in
    weave = eigenvalues(*bicycle.response(WEAVE_SPEED)[1:])
    assert weave[np.argmax(weave.imag)] == pytest.approx(1j * WEAVE_FREQUENCY, abs=1e-11)
    capsize = eigenvalues(*bicycle.response(CAPSIZE_SPEED)[1:])
    assert np.min(np.abs(capsize)) < 1e-11


def test_bicycle_follows_its_linear_equations():
    # by symmetry the first nonlinear term is of third order; the push is small enough to make that term rounding
    plain, push, times = bicycle.bicycle(), 1e-5, np.linspace(0, 3, 7)
    speed = 5.0
    inverse = np.linalg.inv(M)
    K = bicycle.G * K0 + speed**2 * K2
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -speed * inverse @ C1]])
    motion = run(plain, bicycle.state(plain, speed, lean_rate=push), times)
    expected = np.array([(expm(A * t) @ (0, 0, push, 0))[:2] for t in times])
    assert np.max(np.abs(np.column_stack(bicycle.lean_and_steer(motion.R)) - expected)) < 2e-9 * push


# Basu-Mandal, Chatterjee & Papadopoulos 2007: a state of the same bicycle far from upright, and its accelerations
LEAN, STEER, PITCH = 0.6206670416476966, -0.2311385135743, 0.3300446174593725
RATES = {"lean": -0.6068425835418, "steer": -0.4859824687093, "yaw": -0.7830033527065, "pitch": 0.0119185528069}
SPINS = (-8.912989661489, -8.0133620584155)
LEAN_AND_STEER_ACCELERATIONS = (7.855528112824374, 4.6198904039391895)
SPIN_ACCELERATIONS = (-1.8472554144218631, -2.4548072904552343)


def test_bicycle_far_from_upright():
    plain = bicycle.bicycle()
    speed = -SPINS[0] * bicycle.REAR
    state = bicycle.state(plain, speed, LEAN, STEER, RATES["lean"], RATES["steer"])
    R, w = rotation_from_quaternion(state.quat_WB), state.w_WB_W
    # their pitch angle is that of the steer axis
    assert np.arctan2(*(R[0].T @ np.cross(X, R[0] @ Y))[[0, 2]]) == pytest.approx(bicycle.TILT - PITCH, abs=1e-12)
    assert w[0, 1] / np.cos(LEAN) == pytest.approx(RATES["pitch"], abs=1e-12)
    assert w[0, 2] - np.tan(LEAN) * w[0, 1] == pytest.approx(RATES["yaw"], abs=1e-12)
    axles = R[:2] @ Y
    assert np.sum((w[2:] - w[:2]) * axles, axis=1) == pytest.approx(SPINS, abs=1e-11)
    found = bicycle.lean_and_steer_accelerations(plain, [state])[0]
    assert found == pytest.approx(LEAN_AND_STEER_ACCELERATIONS, abs=1e-11)
    alpha = accelerations(plain, [state]).alpha_WB_W[0]
    assert np.sum((alpha[2:] - alpha[:2]) * axles, axis=1) == pytest.approx(SPIN_ACCELERATIONS, abs=1e-11)


# initial speed and lean rate: the manoeuvres of the IFToMM library
@pytest.mark.parametrize(("speed", "lean_rate"), [(4.0, 0.05), (4.6, 0.5), (8.0, 0.05)])
def test_bicycle_manoeuvre(speed, lean_rate):
    plain, times = bicycle.bicycle(), np.linspace(0, 5, 26)
    start = bicycle.state(plain, speed, lean_rate=lean_rate)
    motion = run(plain, start, times)
    states = [motion.state(n) for n in range(len(times))]
    energies = [kinetic_energy(plain, s) + potential_energy(plain, s) for s in states]
    # the library's score, in percent, requires 1e-3
    assert 100 * np.ptp(energies) / energies[0] < 1e-10
    assert max(np.max(np.abs(constraint_residual(plain, s))) for s in states) < 1e-13
    slips = [constraint_jacobian(plain, s) @ np.hstack([s.v_WB_W, s.w_WB_W]).ravel() for s in states]
    assert np.max(np.abs(slips)) < 1e-13
    # the same on a sloping road in a turned world, with other body frames and another formulation
    other = run_disguised(plain, start, times[-1:], seed=5, formulation="null_space")
    assert far(motion.p[-1:], other.p) < BAR
    assert far(motion.R[-1:], other.R) < BAR
