"""The reference solver on published four-bars: single ones, rows of windows, in and out of equilibrium.

A printed value is compared to all its digits. Where a problem was published without a trajectory, the tables here were
computed from its definition independently. Both the solver and these tables are also compared with a closed form or
with equations in few coordinates, integrated in `oracles.benchmarks`.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from consilience.mechanism import kinetic_energy, potential_energy, rotation_from_quaternion
from consilience.reference.analyses import count_freedom, static_equilibrium
from oracles import double_pendulum, four_bar
from oracles.benchmarks import planar, windows
from oracles.benchmarks.build import X, Y, run, started
from oracles.benchmarks.compare import BAR, far, table, turned

# --- A02: N four-bars -----------------------------------------------------------------------------------------------

# theta, theta', and position of the end B0 of the first rod
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


# end B0 of the first of 40 windows: result file of the library, computed with ADAMS, whose steps leave errors of 3e-6
A02_FILE = [
    (11.5, -0.335638, 0.941991),
    (12.0, 0.221098, 0.975252),
    (15.0, -0.999878, -0.0156064),
    (17.0, -0.989581, 0.143979),
    (20.0, 0.410902, 0.911679),
]
# end B0 of the first of 2 windows and its velocity at 10 s; Exudyn with steps of 1.25e-4: six digits are right
A02_EXUDYN = ((0.3284573768, 0.9445187937), (1.423050003, -0.4948670827))


def test_a02_closed_form_against_the_library_s_file():
    times, expected = table(A02_FILE)
    theta, _ = windows.angle(40, times)
    assert far(np.column_stack([np.sin(theta), np.cos(theta)]), expected) < 3e-6


def a02_errors(count, times):
    """Largest errors, against the closed form, of the ends and of the rates of all upright rods."""
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
    # near 0.73 s all rods are collinear for the first time: a singular pose with N + 1 degrees of freedom, not one
    assert max(a02_errors(count, np.array([1.0, 2.0]))) < BAR


def test_a02_windows_to_the_end():
    # ten seconds pass ten singular poses, and each costs digits; Exudyn's own results are 1e-6 from the closed form
    plain, state = windows.windows(2)
    times = np.array([5.0, 10.0])
    theta, rate = windows.angle(2, times)
    motion = run(plain, state, times)
    end, velocity = motion.point("up0", Y)[:, :2], motion.point_velocity("up0", Y)[:, :2]
    along = np.column_stack([np.cos(theta), -np.sin(theta)])
    assert far(end, np.column_stack([np.sin(theta), np.cos(theta)])) < 2e-8
    assert far(velocity, rate[:, None] * along) < 2e-8
    assert far(end[-1], np.array(A02_EXUDYN[0])) < 2e-6
    assert far(velocity[-1], np.array(A02_EXUDYN[1])) < 2e-6


# --- pendulums and four-bars of other projects ----------------------------------------------------------------------

# two angles from x and their rates; slider, angle and their rates; equations of Project Chrono, integrated
# independently to 18 digits
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
# angle of the shoulder from hanging, relative elbow angle, rates; Drake's parameters, integrated independently
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
    # both links turn about y: cosine and sine stand in the first and third row
    angles = np.arctan2(motion.R[:, :, 0, 2], motion.R[:, :, 0, 0])
    found = np.column_stack([angles, motion.w[:, :, 1]])
    absolute = expected @ np.array([[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1.0]])
    assert np.max(np.abs(turned(found[:, :2], absolute[:, :2]))) < BAR
    assert far(found[:, 2:], absolute[:, 2:]) < BAR


# crank and rocker angle and their rates, released at rest, and started at 0.5 rad/s; integrated independently
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
    # printed rounded: 75.52 and 104.48 degrees; exactly arctan(sqrt 15)
    plain = planar.drake_four_bar()
    R = rotation_from_quaternion(static_equilibrium(plain, started(plain, coordinates={"crank_pivot": 0.3})).quat_WB)
    angles = np.arctan2(-R[:, 2, 0], R[:, 0, 0])
    assert np.abs(turned(angles, (np.arctan(np.sqrt(15)), np.pi, np.pi - np.arctan(np.sqrt(15))))) == pytest.approx(
        0, abs=BAR
    )
    assert np.degrees(angles[[0, 2]]) == pytest.approx((75.52, 104.48), abs=0.005)
