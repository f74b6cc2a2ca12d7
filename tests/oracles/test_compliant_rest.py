"""Bodies that come to rest on several compliant contacts with friction."""

import numpy as np
import pytest
import scipy
from scipy.spatial.transform import Rotation

import consilience as cs
from consilience.errors import NumericalFailure
from consilience.mechanism import rotation_from_quaternion
from consilience.reference.contact import slip_headings, small_steps

MASS, MU, STIFFNESS, DAMPING, END = 0.8, 0.3, 2e4, 20.0, 0.2
CENTRE, INERTIA = np.array([0.011, -0.007, 0.04]), np.array([2e-3, 3e-3, 4e-3])
TURNS = 2.0 * np.pi * np.arange(3) / 3.0 + 0.3
FEET = np.stack([np.cos(TURNS), np.sin(TURNS), 0.0 * TURNS], axis=1) * (0.1 + 0.01 * np.arange(3))[:, None]
VELOCITY, SPIN = np.array([0.3, 0.1, 0.0]), np.array([0.0, 0.0, 3.0])

BLOCK, SPRING, OFFSET = 0.3, 2000.0, 0.02
"""Mass of a block that is gripped, kg; stiffness, N/m, and the way by which springs of fingers are pressed, m."""


def crossed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products of rows, in a fifth of the time of NumPy's."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def regularised(eps: float) -> tuple[np.ndarray, np.ndarray]:
    """Place and rotation vector at the end, by Newton and Euler, with friction ``-mu N u/sqrt(u^2 + eps^2)``."""

    def rates(t, z):
        r, v, w = z[3:6], z[6:9], z[9:]
        R = Rotation.from_rotvec(r).as_matrix()
        arms = (FEET - CENTRE) @ R.T
        u = v + crossed(R @ w, arms)
        N = np.maximum(0.0, -STIFFNESS * (z[2] + arms[:, 2]) - DAMPING * u[:, 2])
        slip = u[:, :2]
        T = -MU * (N / np.sqrt(np.sum(slip**2, axis=1) + eps**2))[:, None] * slip
        F = np.column_stack([T, N])
        moment = R.T @ np.sum(crossed(arms, F), axis=0)
        a = np.sum(F, axis=0) / MASS - [0.0, 0.0, 9.81]
        size, across = np.sqrt(r @ r), crossed(r, w)
        series = 1.0 / 12.0 + size**2 / 720.0
        k = series if size < 1e-3 else 1.0 / size**2 - (1.0 + np.cos(size)) / (2.0 * size * np.sin(size))
        turn = w + 0.5 * across + k * crossed(r, across)
        return np.concatenate([v, turn, a, (moment - crossed(w, INERTIA * w)) / INERTIA])

    start = np.concatenate([CENTRE, np.zeros(3), VELOCITY + np.cross(SPIN, CENTRE), SPIN])
    with np.errstate(over="ignore"):  # steps of SciPy's difference quotients
        z = scipy.integrate.solve_ivp(rates, (0.0, END), start, method="Radau", rtol=1e-9, atol=1e-12).y[:, -1]
    return z[:3] - Rotation.from_rotvec(z[3:6]).apply(CENTRE), z[3:6]


def test_a_lumpy_block_that_slides_and_spins_to_rest_on_three_compliant_feet():
    """Its slips end within 1e-9 s, and creep while it rocks: friction that is regularised tends to the same place.

    Of the regularised places those at 1e-6 and 1e-7 m/s differ by 1e-8 m and 2e-7 rad.
    """
    drawing = cs.Drawing("block", gravity=(0.0, 0.0, -9.81))
    drawing.body("block", mass=MASS, at=(0, 0, 0), com=tuple(CENTRE), inertia=tuple(INERTIA))
    drawing.joint("flight", "free", "ground", "block", at=(0, 0, 0))
    law = {"friction": MU, "compliance": {"stiffness": STIFFNESS, "damping": DAMPING}}
    for k, at in enumerate(FEET):
        drawing.add("contact", f"foot{k}", body="block", at=tuple(at), point=(0, 0, 0), normal=(0, 0, 1), **law)
    case = drawing.case(
        rates={"flight": {"position": tuple(VELOCITY), "angular_velocity": tuple(SPIN)}}, duration=END, sample=0.02
    )
    motion = cs.simulate(case)
    place, turned = regularised(1e-7)
    np.testing.assert_allclose(motion.p_WB[-1, 0], place, atol=1e-8)
    found = Rotation.from_quat(motion.quat_WB[-1, 0, [1, 2, 3, 0]]).as_rotvec()
    np.testing.assert_allclose(found, turned, atol=3e-7)
    assert np.max(np.abs(motion.w_WB_W[-1])) < 1e-3


def gripper():
    """Two fingers that springs press on a block in the air, each by three compliant contacts."""
    drawing = cs.Drawing("gripper", gravity=(0.0, 0.0, -9.81))
    drawing.body("block", mass=BLOCK, at=(0, 0, 0), com=(0.003, 0.0, 0.002), inertia=(3e-4, 2e-4, 2.5e-4))
    drawing.joint("flight", "free", "ground", "block", at=(0, 0, 0))
    law = {"radius": 0.005, "friction": 0.5, "compliance": {"stiffness": 1e5, "damping": 50.0}}
    for side, name in ((-1, "left"), (1, "right")):
        drawing.body(name, mass=0.2, at=(side * 0.05, 0, 0), com=(0, 0, 0), inertia=(1e-4, 1e-4, 1e-4))
        drawing.joint(f"slide_{name}", "prismatic", "ground", name, at=(side * 0.05, 0, 0), axis=(1, 0, 0))
        for k, (y, z) in enumerate(((-0.01, 0.0), (0.01, 0.01), (0.0, -0.01))):
            at, point, normal = (side * 0.03, y, z), (side * 0.025, y, z), (side, 0.0, 0.0)
            drawing.add("contact", f"{name}{k}", body=name, at=at, partner="block", point=point, normal=normal, **law)
        drawing.add(
            "joint_spring",
            f"spring_{name}",
            joint=f"slide_{name}",
            coordinate="distance",
            stiffness=SPRING,
            damping=5.0,
            rest=-side * OFFSET,
        )
    return drawing.case(duration=0.3, sample=0.02)


def test_fingers_that_catch_a_block_hold_it_at_six_compliant_contacts():
    """Springs press, friction stops the fall, and all that is left is rest, in balance with the weight."""
    motion = cs.simulate(gripper())
    assert np.all(motion.contact_mode[1:] == 2)
    assert motion.v_WB_W[-1, :, 1:] == pytest.approx(0.0, abs=1e-12)  # the springs swing on
    assert motion.w_WB_W[-1] == pytest.approx(0.0, abs=1e-12)
    # impulses of the contacts on the fingers, in the last interval: the block's weight, and that of their springs
    impulse = motion.contact_impulse[-1]
    np.testing.assert_allclose(np.sum(impulse, axis=0)[1:], [0.0, -BLOCK * 9.81 * 0.02], atol=1e-9)
    for k, side in ((0, -1), (1, 1)):
        moved = motion.p_WB[-1, 1 + k, 0] - side * 0.05
        pressed = SPRING * (-side * OFFSET - moved)
        np.testing.assert_allclose(np.sum(impulse[3 * k : 3 * k + 3], axis=0)[0], -0.02 * pressed, rtol=1e-6)


def test_slips_that_stop_and_turn_without_end_are_refused_by_name(monkeypatch):
    monkeypatch.setattr(small_steps, "_MOST", 1)
    with pytest.raises(NumericalFailure, match=r"contact 'left\d'.*, t = \S+ s: slips stop, start and turn 1 times"):
        cs.simulate(gripper())


def test_slips_that_turn_while_time_hardly_passes_are_refused_by_name(monkeypatch):
    """By the rounding of several threads of BLAS the gripper takes thousands of such steps, and would not end."""
    monkeypatch.setattr(slip_headings, "_MOST", 5)
    with pytest.raises(NumericalFailure, match=r"contact '\w+\d'.*, t = \S+ s: slips turn and stop in 5 steps"):
        cs.simulate(gripper())


SLEDGE, ABOUT, CORNER, BEHIND = 2.0, 0.05, np.array([0.2, -0.15]), np.array([0.03, 0.02])
"""Mass and moment of inertia of a block on two feet, place of one of them, and of its centre, m, in a plane."""


def stopping_sledge(eps: float, times: np.ndarray) -> np.ndarray:
    """Centre (x, z) of the block on two feet at times, by Newton and Euler, with friction ``-mu N tanh(u/eps)``."""
    arms = CORNER * [[-1.0, 1.0], [1.0, 1.0]] - BEHIND

    def rates(t, y):
        (_, z, turn), (vx, vz, w), a = y[:3], y[3:], np.array([0.0, -9.81, 0.0])
        for arm in arms:
            r = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ arm
            u, gap = (vx + w * r[1], vz - w * r[0]), z + r[1]
            N = max(0.0, -4000.0 * gap - 40.0 * u[1]) if gap < 0.0 else 0.0
            T = -0.35 * N * np.tanh(u[0] / eps)
            a += [T / SLEDGE, N / SLEDGE, (r[1] * T - r[0] * N) / ABOUT]
        return np.concatenate([y[3:], a])

    start = [BEHIND[0], BEHIND[1] - CORNER[1], 0.0, 3.0, 0.0, 0.0]
    options = {"method": "Radau", "rtol": 1e-9, "atol": 1e-11, "max_step": 0.002, "t_eval": times}
    with np.errstate(over="ignore"):
        return scipy.integrate.solve_ivp(rates, (0.0, times[-1]), start, **options).y[:2].T


def test_a_block_that_stops_and_rocks_on_two_compliant_feet_goes_on():
    """Where both feet hold, their distance along the plane changes as it rocks: one slips by 1e-12 m/s, and turns.

    Regularised friction creeps by 1e-6 m/s.
    """
    R = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    R = R * np.sign(np.linalg.det(R))
    drawing, height = cs.Drawing("sledge", gravity=tuple(-9.81 * R[:, 2])), -CORNER[1]
    com, inertia = R @ [BEHIND[0], 0.0, BEHIND[1]], R @ np.diag([0.05, ABOUT, 0.06]) @ R.T
    drawing.body("block", mass=SLEDGE, at=tuple(height * R[:, 2]), com=tuple(com), inertia=inertia)
    drawing.joint("flight", "free", "ground", "block", at=tuple(height * R[:, 2]))
    law = {"friction": 0.35, "compliance": {"stiffness": 4000.0, "damping": 40.0}}
    for k, side in enumerate((-1.0, 1.0)):
        at = tuple(side * CORNER[0] * R[:, 0])
        drawing.add("contact", f"foot{k}", body="block", at=at, point=(0, 0, 0), normal=tuple(R[:, 2]), **law)
    case = drawing.case(rates={"flight": {"position": tuple(3.0 * R[:, 0])}}, duration=1.5, sample=0.05)
    motion = cs.simulate(case)
    turns = rotation_from_quaternion(motion.quat_WB[:, 0])
    places = (motion.p_WB[:, 0] + turns @ com) @ R[:, [0, 2]]
    np.testing.assert_allclose(places, stopping_sledge(1e-6, motion.time), rtol=0, atol=3e-6)
