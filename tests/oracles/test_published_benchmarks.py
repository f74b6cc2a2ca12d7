"""The reference solver on published benchmark problems.

A value that was printed with its problem is compared to the digits it carries. Where a problem was published without
a trajectory, the tables here were computed elsewhere from its definition, and are never used alone: each is compared
with a closed form or with equations in few coordinates, integrated in this file's modules, and so is the solver.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from consilience.kinematics import joint_frames
from consilience.mechanism import GROUND
from consilience.observe import kinetic_energy, potential_energy
from consilience.reference import accelerations
from consilience.reference.analyses import count_freedom, inverse_dynamics, static_equilibrium
from consilience.spatial import (
    quaternion_from_rotation,
    quaternion_product,
    rotation_angle_between,
    rotation_from_quaternion,
)
from oracles import double_pendulum, four_bar
from oracles.benchmarks import andrews, bricard, chrono_joints, governor, iiwa, planar, spatial_slider_crank, windows
from oracles.benchmarks.build import X, Y, Z, body, mechanism, placed, run, run_disguised, started
from oracles.closed_forms.free_body import Asymmetric, symmetric
from oracles.closed_forms.heavy_top import HeavyTop
from oracles.integrate import integrate
from oracles.test_published_values import A01

BAR = 1e-10


def table(rows):
    """Times (n_t,) and the other columns (n_t, n) of rows that start with a time."""
    rows = np.array(rows, dtype=float)
    return rows[:, 0], rows[:, 1:]


def far(found, expected):
    """Largest difference, of the largest expected magnitude or of one."""
    return np.max(np.abs(found - expected)) / max(1.0, np.max(np.abs(expected)))


def turned(found, expected):
    """Difference of angles modulo a turn."""
    return (np.asarray(found) - expected + np.pi) % (2 * np.pi) - np.pi


# --- A01: simple pendulum -------------------------------------------------------------------------------------------


def point_mass():
    """On a massless rod; what the body's own inertia is does not matter, since it does not turn."""
    rod = np.column_stack([Y, Z, X])
    return mechanism(
        "a01", -9.81 * Y, [body("mass", 1, -X, (0.1, 0.2, 0.25))], [("rod", "rod", GROUND, "mass", 0 * X, rod, -X)]
    )


def equivalent_body():
    """A body on a pin whose centre of oscillation, J / (m l) = 1 m from the pin, moves as the mass does."""
    return mechanism(
        "a01", -9.81 * Y, [body("mass", 2, -0.4 * X, 3 * (2 * 0.24,))], [("pin", "revolute", GROUND, "mass", 0 * X, Z)]
    )


@pytest.mark.parametrize("make", [point_mass, equivalent_body])
def test_a01_simple_pendulum(make):
    plain = make()
    times = np.array(list(A01))
    for motion in (run(plain, started(plain), times), run_disguised(plain, started(plain), times, seed=2)):
        found = np.column_stack([motion.point("mass", -X)[:, :2], motion.point_velocity("mass", -X)])
        expected = np.array(list(A01.values()))
        assert far(found[:, :2], expected[:, :2]) < BAR
        # the speed is |phi'| on a radius of 1 m
        assert far(np.linalg.norm(found[:, 2:], axis=1), np.abs(expected[:, 2])) < BAR


# --- A02: N four-bars -----------------------------------------------------------------------------------------------

# theta, theta', and the end B0 of the first rod. The library's result file agrees to its printed digits
A02 = {
    1: [(10, 31.9147412977380, 1.96693471944032, 0.478385057760970, 0.878150178791209)],
    2: [
        (1, 3.33787080310510, 6.80738524086945, -0.195020301949435, -0.980799205662174),
        (2, 6.34103336131233, 1.01896459143854, 0.0578157957680114, 0.998327267863455),
        (5, 16.6543534866535, 6.10506755351962, -0.811310461005107, -0.584615545348976),
        (10, 31.7505971869861, 1.50664218084183, 0.328458111540815, 0.944518538178601),
    ],
}


@pytest.mark.parametrize("count", A02)
def test_a02_closed_form(count):
    times, expected = table(A02[count])
    theta, rate = windows.angle(count, times)
    assert far(np.column_stack([theta, rate, np.sin(theta), np.cos(theta)]), expected) < 1e-13


def a02_errors(count, times):
    """Largest errors of the ends and of the rates of all upright rods against the closed form."""
    plain, state = windows.windows(count)
    theta, rate = windows.angle(count, times)
    motion = run(plain, state, times)
    uprights = [f"up{i}" for i in range(count + 1)]
    ends = np.array([(motion.point(name, i * X + Y) - i * X)[:, :2] for i, name in enumerate(uprights)])
    spins = np.array([motion.spin(name)[:, 2] for name in uprights])
    return far(ends, np.column_stack([np.sin(theta), np.cos(theta)])), far(spins, -rate)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a02_windows(count):
    plain, state = windows.windows(count)
    freedom = count_freedom(plain, state)
    assert (freedom.freedom, freedom.redundant) == (1, 3 * count)
    assert max(a02_errors(count, np.array([0.2, 0.4, 0.6]))) < BAR


@pytest.mark.parametrize("count", [1, 2])
def test_a02_windows_through_flat_poses(count):
    # near 0.73 s all rods lie on one line for the first time: N + 1 degrees of freedom in place of one
    assert max(a02_errors(count, np.array([1.0, 2.0]))) < BAR


# --- A03: Andrews' squeezer -----------------------------------------------------------------------------------------

# at t = 0.03: the test set for initial value problems prints 16 digits, of which about 10 are right (its own solver
# and ours of long double differ by 1.4e-9 rad in beta, and by 6e-8 of the smallest rate)
PUBLISHED_Q = (
    15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
    0.5244099658805304, 0.5347301163226948, 1.048080741042263,
)  # fmt: skip
PUBLISHED_RATES = (
    1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385,
    0.5735699284790808, -19.29337464421385, 0.3231791658026955,
)  # fmt: skip
PUBLISHED_ACCELERATIONS = (
    -24631.76316945196, 51850.37701610329, 324102.5686413781, 566749.3645176213,
    16743.62929479361, -566749.3645176222, 9826.520791458422,
)  # fmt: skip
PUBLISHED_LAMBDA = (
    199.1753333731910, -29.75531228015052, 23.06654119098399,
    31.45271365475927, 22.64249232082739, 11.61740700019673,
)  # fmt: skip

# beta, theta, gamma, phi, delta, epsilon integrated elsewhere in long double, at two tolerances
ANDREWS = [
    (0.01, 2.16011313153152650, -1.88336423110704432, 0.158516758001226693,
     -0.328641075174670306, 0.525154774797729461, 1.06842720463240115),
    (0.02, 8.18490588966167555, -7.89050536373044951, 0.209536913384697556,
     -0.238325596595851249, 0.522536917155996372, 1.08627510859987324),
    (0.03, 15.8107711951537071, -15.7563710584118395, 0.0408222401196458022,
     -0.534730116342079595, 0.524409965879954070, 1.04808074104193788),
]  # fmt: skip
ANDREWS_RATES = (
    1139.92030225910606,
    -1424.37929517754007,
    11.0329119106185959,
    19.2933741050320448,
    0.573569914829502582,
    -19.2933741050320448,
    0.323179149249130995,
)


@pytest.fixture(scope="module")
def squeezed():
    plain = andrews.squeezer()
    start = started(plain)
    return plain, start, run(plain, start, [row[0] for row in ANDREWS])


def forces_at_E(plain, state):
    """Forces of the pins at E on bodies 3, 4 and 6, world axes: the six multipliers of the test set."""
    answer = accelerations(plain, [state])
    found = []
    for name in ("E3", "E4", "E6"):
        n = plain.joint_index[name]
        found.append((joint_frames(plain, state, plain.joints[n]).U @ answer.force_F[0, n])[:2])
    return answer, np.concatenate(found)


def test_a03_start(squeezed):
    plain, start, _ = squeezed
    # printed with 28 digits; reproduced from other equations to 9
    answer, lam = forces_at_E(plain, start)
    expected = np.array([14222.4439199541138705911625887, -10666.8329399655854029433719415, 0, 0, 0, 0, 0])
    assert far(andrews.COMBINE @ answer.alpha_WB_W[0, :, 2], expected) < 1e-12
    assert far(lam, np.array([98.5668703962410896057654982170, -6.12268834425566265503114393122, 0, 0, 0, 0])) < 1e-12


def test_a03_against_the_published_end(squeezed):
    plain, _, motion = squeezed
    q, rates = (a[-1] for a in andrews.angles(motion))
    assert np.max(np.abs(turned(q, PUBLISHED_Q))) < 2.5e-9
    error = np.abs(rates - PUBLISHED_RATES)
    assert error[0] < 2e-10 * 1139.92
    assert np.max(error / np.abs(PUBLISHED_RATES)) < 6e-8
    state = motion.state(-1)
    answer, lam = forces_at_E(plain, state)
    # the reference's velocities carry 8 digits, its accelerations 6
    assert far(andrews.COMBINE @ answer.alpha_WB_W[0, :, 2], np.array(PUBLISHED_ACCELERATIONS)) < 2e-7
    assert far(lam, np.array(PUBLISHED_LAMBDA)) < 1e-7


def test_a03_against_long_double(squeezed):
    _, _, motion = squeezed
    q, rates = andrews.angles(motion)
    _, expected = table(ANDREWS)
    assert np.max(np.abs(turned(q[:, [0, 1, 2, 3, 4, 6]], expected))) < 1e-9
    assert far(rates[-1], np.array(ANDREWS_RATES)) < BAR


def test_a03_energy(squeezed):
    plain, start, motion = squeezed
    # the motor's work is 0.033 N m times beta's travel, which the angle modulo a turn leaves open by whole turns
    energy = [kinetic_energy(plain, s) + potential_energy(plain, s) for s in (start, motion.state(-1))]
    assert energy[1] - energy[0] == pytest.approx(0.033 * (PUBLISHED_Q[0] - andrews.START[0]), abs=1e-10)


# --- A04: Bricard's mechanism ---------------------------------------------------------------------------------------

# P3 (the end of the second rod), x and z of the end of the first, rate of the crank; integrated elsewhere
BRICARD = [
    (0.25, 0.940056968341, -0.998308063961, -0.058146448137, 0.998092502259, -0.061736188202, 0.498589214617),
    (0.5, 0.774717808039, -0.979815047656, -0.199906158953, 0.968283679107, -0.249853390562, 1.033553666309),
    (1, 0.274481319265, -0.886707938735, -0.462330002687, 0.510501461187, -0.859876885447, 2.036415380970),
    (2, -0.778135373033, -0.980352683443, -0.197252670617, -0.969340344778, -0.245721989220, 1.024431027733),
    (3, -0.771281358969, -0.979269329840, -0.202562532654, -0.967199800049, -0.254016823824, -1.042680725760),
    (5, 0.999932742302, -0.999999997738, -0.000067255436, 0.999999997738, -0.000067259960, 0.016229914864),
    (7.5, -0.999848674421, -0.999999988552, -0.000151314130, -0.999999988549, -0.000151337029, -0.024345554302),
    (10, 0.999730987304, -0.999999963826, -0.000268976512, 0.999999963806, -0.000269048880, 0.032462011741),
]


def test_a04_reduced_to_its_crank():
    times, expected = table(BRICARD)
    one = bricard.reduced()
    q, rate = one.solve(np.zeros(2), times).T
    assert far(one.energy(q, rate), np.full_like(q, one.V(0.0))) < 1e-11
    centres = one.centre(q)
    first = 2 * centres[:, 0]  # the first rod starts at the origin
    found = np.column_stack([2 * centres[:, 1] - first, first[:, [0, 2]], rate])
    assert far(found, expected) < 2e-11


def test_a04_bricard():
    plain = bricard.bricard()
    state = started(plain)
    freedom = count_freedom(plain, state)
    assert (freedom.kutzbach, freedom.freedom, freedom.redundant) == (0, 1, 1)
    times, expected = table(BRICARD)
    motion = run(plain, state, times)
    found = [motion.point("rod2", X - Y), motion.point("rod1", X)[:, [0, 2]], motion.spin("rod1")[:, 1:2]]
    # the table carries 12 decimals
    assert far(np.hstack(found), expected) < BAR
    one = bricard.reduced()
    q, rate = one.solve(np.zeros(2), times).T
    assert far(motion.point("rod3", X - Y + 0.5 * Z), one.centre(q)[:, 2]) < BAR
    assert far(motion.spin("rod1")[:, 1], rate) < BAR


# --- A05: flyball governor ------------------------------------------------------------------------------------------

# s, s', beta, beta', omega, integrated elsewhere in long double
GOVERNOR = [
    (0.05, 0.506100897243677845, 0.243219012062343474,
     0.516486931214894961, -0.280681576012405720, 6.23504021598127205),
    (0.1, 0.523836475569575694, 0.459271810436133884,
     0.496173869075900256, -0.522673929753980218, 6.10371780883086277),
    (0.2, 0.585079811820783198, 0.721372338210696603,
     0.427720468325408409, -0.792978613554616861, 5.72238064560001695),
    (0.5, 0.743249424786325722, 0.0521197801583734189,
     0.259491381543413121, -0.0539052184987424721, 5.10341542197153530),
    (1, 0.501420922379567651, -0.122151492897728916,
     0.521833301625546231, 0.140885579479526919, 6.27112574187655480),
]  # fmt: skip


def test_a05_governor():
    # the dampers' time constant is 4e-5 s: an explicit integrator takes the time it takes, and one second is enough
    times, expected = table(GOVERNOR)
    equations = governor.solve(times)
    assert far(equations, expected) < 1e-11
    plain, state = governor.governor()
    motion = run(plain, state, times)
    hinge = 0.05 * X + Z
    arm = motion.point("right", hinge + X) - motion.point("right", hinge)
    along = motion.turn("right") @ np.array([np.cos(np.pi / 6), 0, -0.5])
    omega = motion.spin("shaft")
    lift = np.einsum("ti,ti->t", np.cross(motion.spin("right") - omega, along), Z + 0 * arm)
    beta = -np.arcsin(along[:, 2])
    height = motion.point("slider", 0.5 * Z)[:, 2]
    found = np.column_stack(
        [height, motion.point_velocity("slider", 0.5 * Z)[:, 2], beta, -lift / np.cos(beta), omega[:, 2]]
    )
    assert far(found, equations) < BAR
    assert far(found, expected) < BAR


# --- spatial slider-crank -------------------------------------------------------------------------------------------

# slider position and velocity, crank angle and rate, integrated elsewhere
SLIDER_CRANK = [
    (0.1, 0.226787188553, 0.305277006935, 0.560031482093, 5.828888134655),
    (0.5, 0.184952629778, -0.004560290657, 5.583762553282, 14.408160810041),
    (1, 0.211721661399, -0.503491864949, 4.630405422560, 10.427593000283),
    (2, 0.289085197061, 0.216539424014, 2.223188600585, 22.584240021010),
    (5, 0.240719573760, -0.595984412103, 4.067849710284, 11.494996267281),
]


def test_spatial_slider_crank_start():
    plain, state = spatial_slider_crank.slider_crank()
    # printed in a test of Exudyn
    assert state.v_WB_W[2] == pytest.approx((0.24, 0, 0), abs=1e-15)
    assert state.v_WB_W[1] == pytest.approx((0.12, -0.24, 0), abs=1e-15)
    assert state.w_WB_W[1] == pytest.approx((1.92, -0.96, 0.48), abs=1e-14)
    energy = kinetic_energy(plain, state) + potential_energy(plain, state)
    assert energy == pytest.approx(0.766435680, abs=5e-10)


def test_spatial_slider_crank():
    times, expected = table(SLIDER_CRANK)
    plain, state = spatial_slider_crank.slider_crank()
    motion = run(plain, state, times)
    crank = motion.turn("crank")
    angle = np.arctan2(crank[:, 2, 1], crank[:, 1, 1])
    found = [motion.p[:, 2, 0], motion.v[:, 2, 0], angle, motion.spin("crank")[:, 0]]
    q, rate = spatial_slider_crank.solve(times).T
    slider = np.array([spatial_slider_crank.poses(theta)[0][2, 0] for theta in q])
    assert far(found[0], slider) < BAR
    assert np.max(np.abs(turned(found[2], q))) < BAR
    assert far(found[3], rate) < BAR
    # the table was integrated at 1e-12, which leaves 6e-10
    assert far(np.column_stack(found[:2]), expected[:, :2]) < 1e-9
    assert np.max(np.abs(turned(found[2], expected[:, 2]))) < 1e-9
    assert far(found[3], expected[:, 3]) < 1e-9


# --- heavy top ------------------------------------------------------------------------------------------------------

# centre of mass, angular velocity in world axes; integrated elsewhere in long double [Bruels, Cardona & Arnold 2012]
HEAVY_TOP = [
    (0.2, 0.605550561377119770, 0.598957681794919158, -0.523983027430003185,
     86.3716932570613419, 92.4316581220029613, -80.7944509109773862),
    (0.8, -0.418162424317115400, 0.907207967946476336, -0.0459770571443834391,
     -64.1485311685308134, 135.201596966414634, -11.2997367694526692),
    (1, 0.173343964098386042, 0.640088592070568781, -0.748490791133581312,
     20.1397865057640207, 96.2433438658260551, -113.434425787882206),
    (2, -0.150416822745641763, -0.724165591636895654, -0.673022269560444092,
     -27.6585155258232697, -106.163804143124448, -102.462463805326103),
]  # fmt: skip
HEAVY_TOP_QUATERNIONS = [
    (0.2, -0.708279152974312562, 0.438781088126581897, 0.545728396145417673, 0.0893997528240050102),
    (1, 0.732943980679663718, -0.278285719337612680, 0.531824611334162617, -0.320176142736249282),
    (2, 0.122947135041533465, -0.491079892550027017, 0.350430030343620960, -0.787986887550485669),
]
W0 = np.array([0.0, 150.0, -4.61538])


@pytest.fixture(scope="module")
def topped():
    top = body("top", 15, Y, (0.234375, 0.46875, 0.234375), at=0 * Y)
    plain = mechanism("heavy_top", -9.81 * Z, [top], [("ball", "spherical", GROUND, "top", 0 * Y, np.eye(3))])
    state = placed(plain, {"top": (np.zeros(3), W0)})
    return run(plain, state, [0.01, 0.2, 0.8, 1.0, 2.0])


def heavy_top_equations(times):
    """Quaternion and angular velocity in body axes from Euler's equations about the fixed point."""
    moments = np.array([15.234375, 0.46875, 15.234375])

    def rhs(y):
        quat, w = y[:4] / np.linalg.norm(y[:4]), y[4:]
        weight = -15 * 9.81 * rotation_from_quaternion(quat)[2]
        torque = np.cross(Y, weight)
        return np.concatenate(
            [0.5 * quaternion_product(quat, np.append(0.0, w)), (torque - np.cross(w, moments * w)) / moments]
        )

    y = integrate(rhs, np.concatenate([[1.0, 0, 0, 0], W0]), times, longest=0.01)
    return rotation_from_quaternion(y[:, :4] / np.linalg.norm(y[:, :4], axis=1)[:, None]), y[:, 4:]


def test_heavy_top(topped):
    times, expected = table(HEAVY_TOP)
    found = np.hstack([topped.point("top", Y), topped.spin("top")])[1:]
    assert far(found[:, :3], expected[:, :3]) < BAR
    assert far(found[:, 3:], expected[:, 3:]) < BAR
    asked, quats = table(HEAVY_TOP_QUATERNIONS)
    rows = np.searchsorted([0.01, 0.2, 0.8, 1.0, 2.0], asked)
    assert np.max(rotation_angle_between(quaternion_from_rotation(topped.R[rows, 0]), quats)) < BAR * 150
    R, w = heavy_top_equations(times)
    assert far(topped.R[1:, 0], R) < 2 * BAR
    assert far(topped.spin("top")[1:], np.einsum("tij,tj->ti", R, w)) < BAR
    # height of the centre of mass, in closed form; the azimuth is lost where the axis passes through straight down
    angles = (np.pi, np.pi / 2, 0.0)
    top = HeavyTop(15.234375, 0.46875, 15 * 9.81, angles, (-4.61538, 0.0, 150.0))
    assert far(found[:, 2], np.cos(top.solve(times)[:, 1])) < BAR


def test_heavy_top_against_printed_values(topped):
    # a regression test of Kynema prints 15 digits from steps of 2e-6, of which six are right
    assert topped.point("top", Y)[-1] - Y == pytest.approx(
        (-0.150416985652933, -1.724164450779749, -0.673023460701136), abs=2e-6
    )
    # Exudyn's: 12 digits at 2 s; at 0.01 s from a coarse step
    assert topped.spin("top")[-1, 1] == pytest.approx(-106.163804143, abs=1e-8)
    assert topped.spin("top")[0, 1] == pytest.approx(149.8473939540758, rel=1e-7)


# --- Project Chrono's joints ----------------------------------------------------------------------------------------

CHRONO_TIMES = np.array([0.5, 1.0, 2.0, 3.5, 5.0])
# centre of mass at 5 s, and where printed the angular velocity; evaluated elsewhere, and within 5e-6 of files that
# Project Chrono computed with ADAMS
CHRONO = {
    "Revolute_01": ((-1.9996838688835, 0, -0.0355587475452), (0, 0.4124360654751, 0)),
    "Revolute_02": ((1.2099605074076, 3.4063990517149, 1.5936009482851), (0, 1.8340986528578, 1.8340986528578)),
    "Cylindrical_03": ((1.2099605074076, -57.8851634482851, -59.697961551715), None),
}


@pytest.mark.parametrize("case", chrono_joints.PLACES)
def test_chrono_pendulum(case):
    plain = chrono_joints.pendulum(case)
    motion = run(plain, started(plain), CHRONO_TIMES)
    r, w = chrono_joints.pendulum_motion(case, CHRONO_TIMES)
    assert far(motion.p[:, 0], r) < BAR
    assert far(motion.spin("rod"), w) < BAR
    if case in CHRONO:
        centre, spin = CHRONO[case]
        assert far(motion.p[-1, 0], np.array(centre)) < BAR
        if spin is not None:
            assert far(motion.spin("rod")[-1], np.array(spin)) < BAR


# centre of mass of Universal_03 and its angular velocity, integrated elsewhere; ADAMS's own file is 8e-4 off
UNIVERSAL = [
    (1, -0.63624922138, -0.61408089100, -1.79390400735),
    (2, -1.39997092834, -1.36073938566, -0.43413099881),
    (3, 1.31839049145, 1.31792239460, -0.72451851176),
    (5, -1.43495469707, -1.39257801165, -0.04039181635),
]


@pytest.mark.parametrize("case", chrono_joints.UNIVERSALS)
def test_chrono_universal(case):
    plain = chrono_joints.universal(case)
    times, expected = table(UNIVERSAL)
    motion = run(plain, started(plain), times)
    r, w = chrono_joints.universal_motion(case, times)
    assert far(motion.p[:, 0], r) < BAR
    assert far(motion.spin("rod"), w) < BAR
    if case == "Universal_03":
        assert far(motion.p[:, 0], expected) < BAR
        assert motion.spin("rod")[0] == pytest.approx((-2.75259693630, 1.40297121980, -1.98946489349), abs=2e-10)
        assert motion.spin("rod")[-1] == pytest.approx((-0.31167906317, 0.31006162123, -0.00102757195), abs=2e-10)


def test_chrono_torsion_spring():
    plain = chrono_joints.torsion()
    times = np.array([0.5, 1.0, 5.0])
    motion = run(plain, started(plain), times)
    angle, rate = chrono_joints.torsion_motion(times).T
    # evaluated elsewhere, 8 decimals
    assert angle == pytest.approx((0.15082832, 0.07128263, 0.09781871), abs=5e-9)
    assert far(motion.p[:, 0], 2 * np.column_stack([np.cos(angle), 0 * angle, -np.sin(angle)])) < BAR
    assert far(motion.spin("rod"), rate[:, None] * Y) < BAR


def test_chrono_springs_to_the_centre_of_mass():
    times = np.array([0.5, 1.0, 5.0])
    # free length zero, released where the spring has no length: z'' = -g - 10 z - 0.5 z'. The direction of a spring of
    # no length is undefined, so that this starts a short fall later
    w = np.sqrt(10 - 0.0625)
    middle = -chrono_joints.G / 10

    def z(t):
        e = np.exp(-0.25 * t)
        s, c = np.sin(w * t), np.cos(w * t)
        return middle * (1 - e * (c + 0.25 / w * s)), middle * e * 10 / w * s

    assert z(1.0)[0] == pytest.approx(-1.7450166, abs=5e-8)
    assert z(5.0)[0] == pytest.approx(-1.26242287, abs=5e-9)
    begin = 0.1
    height, speed = z(begin)
    plain = chrono_joints.held_by_spring(height * Z, 10.0, 0.5, 0.0)
    motion = run(plain, started(plain, velocities={"rod": (speed * Z, np.zeros(3))}), times - begin)
    assert far(motion.p[:, 0, 2], z(times)[0]) < BAR
    assert far(motion.v[:, 0, 2], z(times)[1]) < BAR


def test_chrono_swinging_spring():
    # polar coordinates: a point on a spring of 2 m, k = 100, c = 5, from level
    def rhs(y):
        l, angle, l_dot, rate = y
        along = l * rate**2 + chrono_joints.G * np.cos(angle) - 100 * (l - 2) - 5 * l_dot
        return np.array([l_dot, rate, along, -(2 * l_dot * rate + chrono_joints.G * np.sin(angle)) / l])

    times = np.array([1.0, 5.0])
    l, angle, _, _ = integrate(rhs, np.array([2.0, np.pi / 2, 0.0, 0.0]), times).T
    plain = chrono_joints.held_by_spring(2 * Y, 100.0, 5.0, 2.0)
    motion = run(plain, started(plain), times)
    assert far(motion.p[:, 0], np.column_stack([0 * l, l * np.sin(angle), -l * np.cos(angle)])) < BAR


def test_chrono_distance_at_the_centre_of_mass():
    # a simple pendulum of 2 m from level, in closed form
    times = CHRONO_TIMES
    plain = chrono_joints.distance(2 * Y, np.eye(3))
    motion = run(plain, started(plain), times)
    angle, rate = chrono_joints.Pendulum(np.sqrt(chrono_joints.G / 2), np.pi / 2, 0.0).solve(times)
    assert far(motion.p[:, 0], 2 * np.column_stack([0 * angle, np.sin(angle), -np.cos(angle)])) < BAR
    assert far(motion.v[:, 0, 1], 2 * np.cos(angle) * rate) < BAR


def test_chrono_distance_at_the_end():
    times = np.array([1.0, 2.0, 3.0, 3.5, 5.0])
    plain = chrono_joints.distance(4 * Y, chrono_joints.turned(Z, -90))
    motion = run(plain, started(plain), times)
    # files of Project Chrono computed with ADAMS, 7 digits
    adams = [(1.588488, -3.670108), (-3.933407, -0.6840368), (-3.560198, -1.820738), (-0.5504151, -3.960353)]
    assert far(motion.p[:4, 0, 1:], np.array(adams)) < 6e-7
    # evaluated elsewhere, 11 decimals
    expected = [(0, 1.58848777941, -3.67010774355), (0, 3.95575937986, -0.30158652672)]
    assert far(motion.p[[0, 4], 0], np.array(expected)) < BAR
    assert motion.spin("rod")[[0, 4], 0] == pytest.approx((-3.06249111477, -0.63031604099), abs=2e-10)
    # a double pendulum whose first link, the massless rod, has no inertia; in the plane of y and z
    two = double_pendulum.DoublePendulum(0.0, 1.0, 0.0, 0.1, 0j, 2 + 0j, 2 + 0j, -1j * chrono_joints.G)
    a, b, _, rate = two.solve(np.zeros(4), times).T
    r = 2 * np.exp(1j * a) + 2 * np.exp(1j * b)
    assert far(motion.p[:, 0], np.column_stack([0 * a, r.real, r.imag])) < BAR
    assert far(motion.spin("rod")[:, 0], rate) < BAR


# --- pendulums and four-bars of other projects ----------------------------------------------------------------------

# two angles from x and their rates; slider, angle and their rates: Project Chrono's equations, integrated elsewhere to
# 18 digits
CHRONO_DOUBLE = [
    (0.5, -0.769181566831688478, -0.213179908033865019, -2.89966987704458644, -1.06951203013420581),
    (1, -2.22720283996553233, -1.48968770110750401, -1.94959746087621001, -3.94804270979394147),
    (2, -1.87970008772534938, -4.91293511614811111, 1.84944188826103186, -2.33188004630741785),
    (5, -0.914598784383932876, -7.57771090698668658, 2.77925407646548067, 2.69242294100563044),
    (10, -2.20291137113016772, -11.1904578139703284, 2.58716811357081929, 0.350238623133251432),
]
CHRONO_SLIDER = [
    (0.5, 0.0291151559268185753, -0.498096469668436274, 0.221064670172464318, -1.97585518710694801),
    (1, 0.245029342917678153, -1.81291841836223771, 0.343720163146325904, -2.80089641830529779),
    (2, -0.315911924167537251, -2.87325377090738178, -0.661650544169587199, 0.862073274741237659),
    (5, -0.504537462593491689, -2.16114924596010914, -1.37978849375287438, -0.873267630490025902),
    (10, 0.127713965889685427, -1.62677891000383473, -0.568458638222927936, 2.94575657309170043),
]
# angle of the shoulder from hanging, relative angle of the elbow, rates; Drake's parameters, integrated elsewhere
ACROBOT = [
    (0.5, 0.358240811872682, 0.906898477825872, -1.13506332251141, -2.59722732681958),
    (1, -0.280495837451974, -0.477891543034082, -4.32982027775226, 3.49790935543272),
    (2, -0.0880781984885500, -1.28968809077677, 2.39376498885591, 0.164654403027459),
    (5, -0.321126815532474, -0.678380119447155, 1.53962016405320, 1.06714614055856),
    (10, -0.390333106718216, -0.404230104874929, -2.20476285180479, 1.06802561157626),
]


def test_chrono_double_pendulum():
    times, expected = table(CHRONO_DOUBLE)
    plain = planar.double_pendulum()
    motion = run(plain, started(plain), times)
    turns = motion.R[:, :, :, 0]
    assert np.max(np.abs(turned(np.arctan2(turns[:, :, 1], turns[:, :, 0]), expected[:, :2]))) < BAR
    assert far(motion.w[:, :, 2], expected[:, 2:]) < BAR
    equations = double_pendulum.DoublePendulum(1.0, 1.0, 1.0, 1.0, 0.5 + 0j, 0.5 + 0j, 1.0 + 0j, -10j)
    assert far(motion.w[:, :, 2], equations.solve(np.zeros(4), times)[:, 2:]) < BAR


def test_chrono_slider_pendulum():
    times, expected = table(CHRONO_SLIDER)
    assert far(planar.slider_pendulum_solve(times), expected) < 1e-11
    plain = planar.slider_pendulum()
    motion = run(plain, started(plain), times)
    angle = np.arctan2(motion.R[:, 1, 1, 0], motion.R[:, 1, 0, 0])
    found = np.column_stack([motion.p[:, 0, 0], motion.v[:, 0, 0], motion.w[:, 1, 2]])
    assert far(found, expected[:, [0, 2, 3]]) < BAR
    assert np.max(np.abs(turned(angle, expected[:, 1]))) < BAR


def test_acrobot():
    times, expected = table(ACROBOT)
    assert far(planar.acrobot_solve((1.0, 1.0, 0.0, 0.0), times), expected) < 1e-11
    plain = planar.acrobot()
    motion = run(plain, started(plain, coordinates={"shoulder": 1.0, "elbow": 1.0}), times)
    # both turn about y: cosine and sine stand in the first and third row
    angles = np.arctan2(motion.R[:, :, 0, 2], motion.R[:, :, 0, 0])
    found = np.column_stack([angles, motion.w[:, :, 1]])
    absolute = expected @ np.array([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1.0]])
    assert np.max(np.abs(turned(found[:, :2], absolute[:, :2]))) < BAR
    assert far(found[:, 2:], absolute[:, 2:]) < BAR


# crank and rocker angle and their rates, released at rest, and at 0.5 rad/s; integrated elsewhere
FOUR_BAR = {
    0.0: [
        (0.5, 1.710334452143, 1.566686637758, 0.183090399661, 0.124675970210),
        (1, 1.919887590653, 1.707913636477, 0.788858265137, 0.524397730433),
        (2, -0.979645088759, 2.016665602469, 3.991220338035, -2.955313343718),
        (3, 1.365303665362, 1.331227024685, 0.751187223320, 0.508536570027),
    ],
    0.5: [
        (0.5, 2.052084586088, 1.794731895228, 1.271685983740, 0.823861498720),
        (1, -2.840060364400, 2.422082792650, 5.113775574560, 0.926318468205),
        (2, 0.941097706977, 1.057513978096, 2.055120467786, 1.220520846337),
        (3, 1.773200649240, 1.609392344975, 0.623493851933, 0.422398210172),
    ],
}
# crank, coupler (absolute) and rocker angle, rates of crank and rocker
DRAKE = [
    (0.25, 2.009525744742, -2.753000763862, 2.587224181727, 2.450518515513, 3.024141221106),
    (0.5, 2.520069917205, -2.311501720422, -2.985237435833, 1.632550550705, 2.598083135525),
    (1, 3.040691257122, -1.516290279730, -2.026879144862, 0.613640522173, 1.240549037548),
    (2, -3.111070591828, -1.256859935313, -1.762701273576, -0.310869494567, -0.615977094169),
    (3, 2.102132650717, -2.688150232925, 2.703660050265, -2.328625919976, -2.984260489546),
    (5, -1.481981611883, 1.150697464926, -0.083105570097, 0.110215363251, 0.056900579098),
]


def by_closure(plain, rate, times):
    """Turns out of the drawing (n_t, 3) and rates (n_t, 3) of crank, coupler and rocker, by intersecting circles."""
    linkage = four_bar.linkage(SimpleNamespace(mechanism=plain))
    y = linkage.solve(np.array([0.0, rate]), times)
    motions = linkage.motions(y[:, 0])
    turns = np.column_stack([np.angle(np.broadcast_to(m.turn, times.shape)) for m in motions])
    return turns, np.column_stack([m.a_q * y[:, 1] for m in motions])


@pytest.mark.parametrize("rate", FOUR_BAR)
def test_rigid_body_dynamics_four_bar(rate):
    times, expected = table(FOUR_BAR[rate])
    plain = planar.rigid_body_dynamics_four_bar()
    motion = run(plain, started(plain, {"crank_pivot": rate}), times)
    angles = np.arctan2(motion.R[:, :, 1, 0], motion.R[:, :, 0, 0])
    turns, rates = by_closure(plain, rate, times)
    drawn = [np.arctan2(*b.drawing.R[1::-1, 0]) for b in plain.bodies]
    assert np.max(np.abs(turned(angles, turns + drawn))) < BAR
    assert far(motion.w[:, :, 2], rates) < BAR
    assert np.max(np.abs(turned(angles[:, [0, 2]], expected[:, :2]))) < BAR
    assert far(motion.w[:, [0, 2], 2], expected[:, 2:]) < BAR


def test_drake_four_bar():
    times, expected = table(DRAKE)
    plain = planar.drake_four_bar()
    state = started(plain, {"crank_pivot": 3.0})
    assert kinetic_energy(plain, state) + potential_energy(plain, state) == pytest.approx(848.5913349482, abs=1e-7)
    motion = run(plain, state, times)
    # a rotation about y takes x to (cos, 0, -sin)
    angles = np.arctan2(-motion.R[:, :, 2, 0], motion.R[:, :, 0, 0])
    turns, rates = by_closure(plain, 3.0, times)
    drawn = [np.arctan2(-b.drawing.R[2, 0], b.drawing.R[0, 0]) for b in plain.bodies]
    assert np.max(np.abs(turned(angles, turns + drawn))) < BAR
    assert far(motion.w[:, :, 1], rates) < BAR
    assert np.max(np.abs(turned(angles, expected[:, :3]))) < BAR
    assert far(motion.w[:, [0, 2], 1], expected[:, 3:]) < BAR


def test_drake_four_bar_equilibrium():
    # printed: 75.52 and 104.48 degrees; exactly arctan(sqrt 15)
    plain = planar.drake_four_bar()
    R = rotation_from_quaternion(static_equilibrium(plain, started(plain, coordinates={"crank_pivot": 0.3})).quat_WB)
    angles = np.arctan2(-R[:, 2, 0], R[:, 0, 0])
    assert np.abs(turned(angles, (np.arctan(np.sqrt(15)), np.pi, np.pi - np.arctan(np.sqrt(15))))) == pytest.approx(
        0, abs=BAR
    )
    assert np.degrees(angles[[0, 2]]) == pytest.approx((75.52, 104.48), abs=0.005)


# --- KUKA iiwa ------------------------------------------------------------------------------------------------------

IIWA_Q = np.radians([60, 30, 60, 30, 60, 30, 60])


def arm_state(plain, q, v):
    return started(plain, {f"j{n + 1}": r for n, r in enumerate(v)}, {f"j{n + 1}": a for n, a in enumerate(q)})


def arm_torques(plain, q, v, a):
    answer = inverse_dynamics(plain, arm_state(plain, q, v), {f"j{n + 1}": {"angle": x} for n, x in enumerate(a)})
    return np.array([answer.efforts[f"j{n + 1}"]["angle"] for n in range(7)])


def test_iiwa_kinematics():
    # printed with 16 digits in a test of Drake, from MotionGenesis
    plain = iiwa.arm(9.81)
    zero = np.zeros(7)
    state = arm_state(plain, IIWA_Q, zero)
    R = [
        [-0.5939002959880204, 0.8043869080239565, -0.015625],
        [-0.8043869080239565, -0.5932991120359317, 0.03094940802395521],
        [0.015625, 0.03094940802395527, 0.9993988160479114],
    ]
    assert far(rotation_from_quaternion(state.quat_WB[-1]), np.array(R)) < 1e-14
    assert far(state.p_WB[-1], np.array([0.2970356451892219, 0.1727696964662288, 1.154681973689345])) < 1e-14
    assert far(arm_state(plain, zero, zero).p_WB[-1], np.array([0, 0, 1.261])) < 1e-15


def test_iiwa_static_torques():
    zero = np.zeros(7)
    found = arm_torques(iiwa.arm(9.81), zero, zero, zero)
    assert far(found, np.array([0, 0.02212155, 0, -0.0034335, 0, 0, 0])) < 1e-13


def test_iiwa_last_joint_accelerated():
    found = arm_torques(iiwa.arm(0.0), np.zeros(7), np.zeros(7), [0, 0, 0, 0, 0, 0, 1000.0])
    assert far(found, np.array([1, 0, 1, 0, 1, 0, 1.0])) < 1e-12


def test_iiwa_moving():
    v, a = np.array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7]), np.array([1, -1, 0.5, -0.5, 0.25, -0.25, 2])
    found = arm_torques(iiwa.arm(9.81), IIWA_Q, v, a)
    # evaluated elsewhere with Pinocchio, 9 digits
    printed = (0.867426635, -37.6151598, -5.56805039, -4.71607774, 0.441057618, 0.0541491531, 0.00399311188)
    assert found == pytest.approx(printed, rel=2e-9)
    assert far(found, iiwa.torques(IIWA_Q, v, a, 9.81)) < 1e-13


# --- free bodies ----------------------------------------------------------------------------------------------------

# quaternion, angular velocity in body axes: evaluated elsewhere; of Drake's symmetric body, of OSRF's box and of the
# intermediate axis
KANE = [
    (1, -0.670395090985309167, -0.374160606343273625, -0.603126566220264944, -0.216362214268076944,
     -3.03862037694336302, 0.725800389104727928, 5),
]  # fmt: skip
KANE_LATER = (-0.848238737814345660, -0.283963115314360500, 0.318635398175574431, -0.313572122232800060)
BOX = [
    (1, 3.42379844155459835, 2.81918543839796545, 3.92838444946703323),
    (2, 0.336649760783955604, -4.98493293518989948, 0.382181881304556466),
    (5, 0.374990779685940981, 4.98094688100954058, -0.426603245322205413),
    (10, 2.75584040514685120, -3.73596351921621798, -3.16180900346752039),
]
BOX_QUATERNIONS = [
    (5, 0.895698731785681943, -0.0151546505110984117, -0.443235083728962313, 0.0321990527374211969),
    (10, 0.225164563413958327, -0.619927562499452423, -0.277029150687194808, 0.698745723640310061),
]
MIDDLE = [
    (1, -0.00730936993731357212, 2.00001164324388859, 0.00919106248628712518),
    (5, -1.08357528612950452, 1.68106055788878778, 0.625655762836252096),
    (10, -0.0410499679707795174, -1.99960368576615651, 0.0250672420395092802),
]
MIDDLE_QUATERNIONS = [(5, 0.271638471781739093, 0.0658515187286083238, -0.918905493601580891, -0.278368123099704185)]


def free(mass, moments, gravity):
    joints = [("f", "free", GROUND, "b", np.zeros(3), np.eye(3))]
    return mechanism("free", gravity, [body("b", mass, np.zeros(3), moments)], joints)


def apart(R, quats):
    return np.max(rotation_angle_between(quaternion_from_rotation(R), quats))


def test_symmetric_body_of_drake():
    times = np.array([1.0, 5.0])
    quats, w = symmetric(0.04, 0.02, (2, -2.4, 5), times)
    assert far(np.hstack([quats, w])[:1], table(KANE)[1]) < 1e-14
    assert far(quats[1], np.array(KANE_LATER)) < 1e-14
    plain = free(1.0, (0.04, 0.04, 0.02), 0 * Z)
    motion = run(plain, placed(plain, {"b": (0 * X, (2, -2.4, 5))}), times)
    assert apart(motion.R[:, 0], quats) < BAR


@pytest.mark.parametrize(
    ("moments", "w0", "rates", "quats"),
    [
        ((0.97, 0.82, 0.17), (0.1, 5, 0.1), BOX, BOX_QUATERNIONS),
        ((1, 2, 3), (0.01, 2, 0.01), MIDDLE, MIDDLE_QUATERNIONS),
    ],
    ids=["box", "intermediate axis"],
)
def test_asymmetric_free_body(moments, w0, rates, quats):
    times, expected = table(rates)
    asked, orientations = table(quats)
    rows = np.searchsorted(times, asked)
    top = Asymmetric(moments, w0)
    # near the separatrix an error at the start, of rounding, grows by two orders in every half-period
    assert far(top.rates(times), expected) < 3e-12
    assert apart(top.orientations(times)[rows], orientations) < 3e-12
    plain = free(12.0, moments, -9.8 * Z)
    motion = run(plain, placed(plain, {"b": ((-2, 2, 8), w0)}), times)
    found = np.einsum("tji,tj->ti", motion.R[:, 0], motion.spin("b"))
    assert far(found, expected) < BAR
    assert apart(motion.R[rows, 0], orientations) < BAR
    t = times[:, None]
    assert far(motion.p[:, 0], np.array([-2, 2, 8]) * t - 4.9 * t * t * Z) < BAR


def test_period_of_the_intermediate_axis():
    top = Asymmetric((1, 2, 3), (0.01, 2, 0.01))
    period = 21.9551458793539326
    assert far(top.rates(np.array([period])), np.array([[0.01, 2, 0.01]])) < 1e-11
