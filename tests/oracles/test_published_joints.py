"""The reference solver on published single joints, and inverse dynamics of a published arm.

A printed value is compared to all its digits. Where a problem was published without a trajectory, the tables here were
computed from its definition independently. Both the solver and these tables are also compared with a closed form or
with equations in few coordinates, integrated in `oracles.benchmarks`.
"""

import numpy as np
import pytest

from consilience.mechanism import rotation_from_quaternion
from consilience.reference.analyses import inverse_dynamics
from oracles import double_pendulum
from oracles.benchmarks import chrono_joints, iiwa
from oracles.benchmarks.build import Y, Z, run, started
from oracles.benchmarks.compare import BAR, far, table
from oracles.integrate import integrate

# --- Project Chrono's joints ----------------------------------------------------------------------------------------

CHRONO_TIMES = np.array([0.5, 1.0, 2.0, 3.5, 5.0])
# centre of mass at 5 s, and angular velocity where printed; computed independently, and within 5e-6 of ADAMS
# result files of Project Chrono
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


# centre of mass and angular velocity of Universal_03, integrated independently; ADAMS's own file is 8e-4 off
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
    # computed independently, 8 decimals
    assert angle == pytest.approx((0.15082832, 0.07128263, 0.09781871), abs=5e-9)
    assert far(motion.p[:, 0], 2 * np.column_stack([np.cos(angle), 0 * angle, -np.sin(angle)])) < BAR
    assert far(motion.spin("rod"), rate[:, None] * Y) < BAR


def test_chrono_springs_to_the_centre_of_mass():
    times = np.array([0.5, 1.0, 5.0])
    # free length zero, released where the spring has length zero: z'' = -g - 10 z - 0.5 z'. The direction of a spring
    # of length zero is undefined, so that the simulation starts after a short fall
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
    # polar coordinates: a point mass on a spring of 2 m, k = 100, c = 5, released level
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
    # closed form of a simple pendulum of 2 m, released level
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
    # result files of Project Chrono from ADAMS, 7 digits
    adams = [(1.588488, -3.670108), (-3.933407, -0.6840368), (-3.560198, -1.820738), (-0.5504151, -3.960353)]
    assert far(motion.p[:4, 0, 1:], np.array(adams)) < 6e-7
    # computed independently, 11 decimals
    expected = [(0, 1.58848777941, -3.67010774355), (0, 3.95575937986, -0.30158652672)]
    assert far(motion.p[[0, 4], 0], np.array(expected)) < BAR
    assert motion.spin("rod")[[0, 4], 0] == pytest.approx((-3.06249111477, -0.63031604099), abs=2e-10)
    # a double pendulum in the yz plane whose first link, the massless rod, has no inertia
    two = double_pendulum.DoublePendulum(0.0, 1.0, 0.0, 0.1, 0j, 2 + 0j, 2 + 0j, -1j * chrono_joints.G)
    a, b, _, rate = two.solve(np.zeros(4), times).T
    r = 2 * np.exp(1j * a) + 2 * np.exp(1j * b)
    assert far(motion.p[:, 0], np.column_stack([0 * a, r.real, r.imag])) < BAR
    assert far(motion.spin("rod")[:, 0], rate) < BAR


# --- KUKA iiwa ------------------------------------------------------------------------------------------------------

IIWA_Q = np.radians([60, 30, 60, 30, 60, 30, 60])


def arm_state(plain, q, v):
    return started(plain, {f"j{n + 1}": r for n, r in enumerate(v)}, {f"j{n + 1}": a for n, a in enumerate(q)})


def arm_torques(plain, q, v, a):
    answer = inverse_dynamics(plain, arm_state(plain, q, v), {f"j{n + 1}": {"angle": x} for n, x in enumerate(a)})
    return np.array([answer.efforts[f"j{n + 1}"]["angle"] for n in range(7)])


def test_iiwa_kinematics():
    # printed with 16 digits in a test of Drake; computed with MotionGenesis
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
    # computed with Pinocchio, 9 digits
    printed = (0.867426635, -37.6151598, -5.56805039, -4.71607774, 0.441057618, 0.0541491531, 0.00399311188)
    assert found == pytest.approx(printed, rel=2e-9)
    assert far(found, iiwa.torques(IIWA_Q, v, a, 9.81)) < 1e-13
