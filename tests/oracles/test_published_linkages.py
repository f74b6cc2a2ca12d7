"""The reference solver on published linkages: squeezer, Bricard's mechanism, governor, spatial slider-crank.

A printed value is compared to all its digits. Where a problem was published without a trajectory, the tables here were
computed from its definition independently. Both the solver and these tables are also compared with a closed form or
with equations in few coordinates, integrated in `oracles.benchmarks`.
"""

import numpy as np
import pytest

from consilience.mechanism import joint_frames, kinetic_energy, potential_energy
from consilience.reference import accelerations
from consilience.reference.analyses import count_freedom
from oracles.benchmarks import andrews, bricard, governor, spatial_slider_crank
from oracles.benchmarks.build import X, Y, Z, run, started
from oracles.benchmarks.compare import BAR, far, table, turned

# --- A03: Andrews' squeezer -----------------------------------------------------------------------------------------

# at t = 0.03: the test set for initial value problems prints 16 digits, of which about 10 are right (its solver and
# an integration in long double differ by 1.4e-9 rad in beta, and by 6e-8 of the smallest rate)
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

# beta, theta, gamma, phi, delta, epsilon integrated independently in long double, at two tolerances
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
    # printed with 28 digits; 9 of them confirmed by other equations
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
    # the velocities of the test set carry 8 digits, its accelerations 6
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
    # the motor's work is 0.033 N m times the travel of beta, which an angle modulo a turn leaves open by whole turns
    energy = [kinetic_energy(plain, s) + potential_energy(plain, s) for s in (start, motion.state(-1))]
    assert energy[1] - energy[0] == pytest.approx(0.033 * (PUBLISHED_Q[0] - andrews.START[0]), abs=1e-10)


# --- A04: Bricard's mechanism ---------------------------------------------------------------------------------------

# P3 (end of the second rod), x and z of the end of the first rod, rate of the crank; integrated independently
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


@pytest.fixture(scope="module")
def one_crank():
    times, _ = table(BRICARD)
    one = bricard.reduced()
    return one, *one.solve(np.zeros(2), times).T


def test_a04_reduced_to_its_crank(one_crank):
    _, expected = table(BRICARD)
    one, q, rate = one_crank
    assert far(one.energy(q, rate), np.full_like(q, one.V(0.0))) < 1e-11
    centres = one.centre(q)
    first = 2 * centres[:, 0]  # the first rod starts at the origin
    found = np.column_stack([2 * centres[:, 1] - first, first[:, [0, 2]], rate])
    assert far(found, expected) < 2e-11


def test_a04_bricard(one_crank):
    plain = bricard.bricard()
    state = started(plain)
    freedom = count_freedom(plain, state)
    assert (freedom.kutzbach, freedom.freedom, freedom.redundant) == (0, 1, 1)
    times, expected = table(BRICARD)
    motion = run(plain, state, times)
    found = [motion.point("rod2", X - Y), motion.point("rod1", X)[:, [0, 2]], motion.spin("rod1")[:, 1:2]]
    # the table carries 12 decimals
    assert far(np.hstack(found), expected) < BAR
    one, q, rate = one_crank
    assert far(motion.point("rod3", X - Y + 0.5 * Z), one.centre(q)[:, 2]) < BAR
    assert far(motion.spin("rod1")[:, 1], rate) < BAR


# --- A05: flyball governor ------------------------------------------------------------------------------------------

# s, s', beta, beta', omega, integrated independently in long double
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
    # the dampers' time constant is 4e-5 s: stability limits the steps of an explicit integrator, so that at any
    # tolerance the error is rounding; a second is long enough
    times, expected = table(GOVERNOR)
    equations = governor.solve(times)
    assert far(equations, expected) < 1e-11
    plain, state = governor.governor()
    motion = run(plain, state, times, tolerance=1e-10)
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

# slider position and velocity, crank angle and rate, integrated independently
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
    # the table was integrated at a tolerance of 1e-12, which leaves an error of 6e-10
    assert far(np.column_stack(found[:2]), expected[:, :2]) < 1e-9
    assert np.max(np.abs(turned(found[2], expected[:, 2]))) < 1e-9
    assert far(found[3], expected[:, 3]) < 1e-9
