"""Closed forms: each fulfils its own equation of motion, and the reference solver agrees to 1e-10."""

import numpy as np
import pytest

from consilience.mechanism import (
    GROUND,
    Drive,
    JointSpring,
    Spring,
    joint_frames,
    linear,
    rotation_from_euler_zxz,
    rotation_from_quaternion,
)
from consilience.reference import accelerations
from consilience.reference.analyses import linearise
from mechanisms import rotation
from oracles.benchmarks.build import Disguise, X, Y, Z, body, mechanism, placed, run, run_disguised, started
from oracles.benchmarks.compare import BAR, far
from oracles.closed_forms.driven_crank import DrivenCrank
from oracles.closed_forms.free_body import Asymmetric, symmetric
from oracles.closed_forms.heavy_top import HeavyTop, steady_spin
from oracles.closed_forms.nonlinear_springs import coasting, cubic, cubic_period, quadratic
from oracles.closed_forms.oscillator import oscillator
from oracles.closed_forms.pendulum import Pendulum

TIMES = np.linspace(0.0, 10.0, 81)
SEEDS = (None, 3, 4)
"""As built, and twice in disguise: turned world, origins off the centre of mass, skew joint frames."""


def moved(plain, state, seed, times=TIMES):
    return run(plain, state, times) if seed is None else run_disguised(plain, state, times, seed)


def difference(function, times, h=4e-3):
    """First derivative by central differences of eighth order."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    return np.tensordot(weights, np.array([function(times + k * h) for k in (-4, -3, -2, -1, 1, 2, 3, 4)]), 1)


# --- pendulum -------------------------------------------------------------------------------------------------------

ENERGIES = {
    "small": (0.05, 0.0),
    "wide": (-2.5, 0.8),
    "almost over": (3.1, 0.0),
    "over": (0.4, 9.0),
    "back": (1.0, -7.0),
}


@pytest.mark.parametrize("start", ENERGIES.values(), ids=ENERGIES)
def test_pendulum_obeys_its_equation(start):
    pendulum = Pendulum(3.1, *start)
    angle, rate = pendulum.solve(TIMES)
    assert (angle[0], rate[0]) == pytest.approx(start, abs=1e-14)
    assert far(difference(lambda t: pendulum.solve(t)[0], TIMES), rate) < 1e-11
    assert far(difference(lambda t: pendulum.solve(t)[1], TIMES), -(3.1**2) * np.sin(angle)) < 1e-11
    later, _ = pendulum.solve(TIMES + pendulum.period)
    turns = 2 * np.pi * np.sign(start[1]) if pendulum.parameter > 1 else 0.0
    assert np.max(np.abs(later - angle - turns)) < 1e-12


def lumpy_pendulum(rng):
    """A physical pendulum about a tilted axis, drawn in equilibrium; its natural frequency and axis."""
    turn = rotation(rng)
    inertia = turn @ np.diag([0.3, 0.2, 0.15]) @ turn.T
    axis, gravity = np.array([0.6, 0.0, 0.8]), np.array([1.0, 2.0, -9.0])
    across = gravity - (gravity @ axis) * axis
    down = across / np.linalg.norm(across)
    pivot = np.array([0.2, -0.1, 0.4])
    com = pivot + 0.7 * down + 0.25 * axis
    plain = mechanism(
        "pendulum", gravity, [body("bob", 1.7, com, inertia)], [("pin", "revolute", GROUND, "bob", pivot, axis)]
    )
    moment = axis @ inertia @ axis + 1.7 * 0.7**2
    return plain, np.sqrt(1.7 * np.linalg.norm(across) * 0.7 / moment), axis


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("start", [ENERGIES["wide"], ENERGIES["over"], ENERGIES["back"]], ids=["wide", "over", "back"])
def test_physical_pendulum(start, seed):
    plain, frequency, axis = lumpy_pendulum(np.random.default_rng(1))
    angle, rate = Pendulum(frequency, *start).solve(TIMES)
    state = started(plain, {"pin": start[1]}, {"pin": start[0]})
    motion = moved(plain, state, seed)
    across = np.cross(axis, X)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    expected = c * across + s * np.cross(axis, across)
    assert far(motion.turn("bob") @ across, expected) < BAR
    assert far(motion.spin("bob"), rate[:, None] * axis) < BAR


def test_small_oscillation_of_the_physical_pendulum():
    plain, frequency, _ = lumpy_pendulum(np.random.default_rng(1))
    assert linearise(plain, started(plain)).frequencies == pytest.approx([frequency], rel=BAR)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("k", [0.001, 0.4])
def test_small_oscillations_of_the_double_pendulum(k, seed):
    # equal bodies, arms and links, with k = I / (m l^2): M = m l^2 [2 + k, 1; 1, 1 + k], K = m g l [2, 0; 0, 1]. For
    # k -> 0 the squared frequencies tend to (2 -+ sqrt 2) g / l; k = 0 is excluded because a body needs some inertia
    g, l, m = 9.81, 0.8, 1.3
    own = k * m * l**2 * np.ones(3)
    bodies = [body("upper", m, -l * Z, own, at=(0, 0, 0)), body("lower", m, -2 * l * Z, own, at=-l * Z)]
    joints = [("top", "revolute", GROUND, "upper", (0, 0, 0), X), ("mid", "revolute", "upper", "lower", -l * Z, X)]
    plain = mechanism("double", (0, 0, -g), bodies, joints)
    disguised = plain if seed is None else Disguise(plain, seed).mechanism
    squares = np.roots([(2 + k) * (1 + k) - 1, -(4 + 3 * k), 2])
    if k == 0.001:
        assert np.sort(squares) == pytest.approx(2 + np.sqrt(2) * np.array([-1, 1]), rel=6e-3)
    expected = np.sort(np.sqrt(squares * g / l))
    assert linearise(disguised, started(disguised)).frequencies == pytest.approx(expected, rel=BAR)


# --- oscillators ----------------------------------------------------------------------------------------------------

DAMPING = {"none": 0.0, "under": 0.9, "critical": 2 * np.sqrt(1.3 * 7.0), "over": 19.0}


@pytest.mark.parametrize("c", DAMPING.values(), ids=DAMPING)
def test_oscillator_obeys_its_equation(c):
    x, v = oscillator(1.3, c, 7.0, 0.4, -2.0, TIMES)
    assert (x[0], v[0]) == pytest.approx((0.4, -2.0))
    assert far(difference(lambda t: oscillator(1.3, c, 7.0, 0.4, -2.0, t)[0], TIMES), v) < 1e-11
    a = difference(lambda t: oscillator(1.3, c, 7.0, 0.4, -2.0, t)[1], TIMES)
    assert far(1.3 * a, -c * v - 7.0 * x) < 1e-11


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("element", ["joint spring", "spring"])
@pytest.mark.parametrize("c", DAMPING.values(), ids=DAMPING)
def test_mass_on_a_slide(c, element, seed):
    # a slide inclined to gravity; the point spring lies on its axis and keeps a length above zero
    axis, gravity = np.array([2.0, -1.0, 2.0]) / 3, np.array([1.0, 2.0, -9.0])
    slider = body("slider", 1.3, (0.3, 0.2, -0.1), np.diag([0.2, 0.3, 0.25]) + 0.02, at=(0.1, 0.1, 0.1))
    if element == "spring":
        behind = slider.drawing.p - 8 * axis
        forces = {"springs": (Spring("k", GROUND, "slider", behind, np.zeros(3), 7.0, c, 8.2),)}
    else:
        forces = {"joint_springs": (JointSpring("k", "slide", "distance", 7.0, c, 0.2),)}
    plain = mechanism("slide", gravity, [slider], [("slide", "prismatic", GROUND, "slider", (0, 0, 0), axis)], **forces)
    middle = 0.2 + 1.3 * (gravity @ axis) / 7.0
    x, v = oscillator(1.3, c, 7.0, 0.9 - middle, -2.0, TIMES)
    motion = moved(plain, started(plain, {"slide": -2.0}, {"slide": 0.9}), seed)
    assert far(motion.p[:, 0], slider.drawing.p + (middle + x)[:, None] * axis) < BAR
    assert far(motion.v[:, 0], v[:, None] * axis) < BAR
    assert far(motion.R[:, 0], np.eye(3)) < BAR


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("c", [0.0, 0.05, 3.0], ids=["none", "under", "over"])
def test_damped_torsion_over_full_turns(c, seed):
    # no gravity; centre of mass off the axis. Without damping the body makes more than three full turns each way
    axis = np.array([2.0, 3.0, 6.0]) / 7
    inertia = np.diag([0.2, 0.3, 0.25]) + 0.02
    arm = np.array([0.3, 0.1, -0.2])
    moment = axis @ inertia @ axis + 1.2 * (arm @ arm - (arm @ axis) ** 2)
    plain = mechanism(
        "torsion",
        (0, 0, 0),
        [body("disc", 1.2, arm, inertia)],
        [("pin", "revolute", GROUND, "disc", (0, 0, 0), axis)],
        joint_springs=(JointSpring("k", "pin", "angle", 0.9, c, -0.5),),
    )
    times = TIMES[:41]
    x, v = oscillator(moment, c, 0.9, 1.0 + 0.5, 30.0, times)
    motion = moved(plain, started(plain, {"pin": 30.0}, {"pin": 1.0}), seed, times)
    assert c == 3.0 or np.max(np.abs(x)) > 4 * np.pi
    across = np.cross(axis, X)
    expected = np.cos(x - 0.5)[:, None] * across + np.sin(x - 0.5)[:, None] * np.cross(axis, across)
    assert far(motion.turn("disc") @ across, expected) < BAR
    assert far(motion.spin("disc"), v[:, None] * axis) < BAR


# --- driven crank ---------------------------------------------------------------------------------------------------

CRANKS = {"engine": DrivenCrank(0.4, 1.3, 0.0, 0.5, 6.0), "offset": DrivenCrank(0.4, 0.9, -0.3, -1.1, -5.0)}


@pytest.mark.parametrize("crank", CRANKS.values(), ids=CRANKS)
def test_driven_crank_closes_and_differentiates(crank):
    s, rate, acceleration = crank.piston(TIMES)
    beta, turning, turning_faster = crank.rod_motion(TIMES)
    theta = crank.angle(TIMES)
    assert far(crank.crank * np.cos(theta) + crank.rod * np.cos(beta), s) < 1e-15
    assert far(crank.crank * np.sin(theta) + crank.rod * np.sin(beta), np.full_like(s, crank.offset)) < 1e-15
    for series, row, expected in (
        (crank.piston, 0, rate),
        (crank.piston, 1, acceleration),
        (crank.rod_motion, 0, turning),
        (crank.rod_motion, 1, turning_faster),
    ):
        assert far(difference(lambda t, f=series, k=row: f(t)[k], TIMES), expected) < 1e-9


def driven(crank):
    """Slider-crank of lumpy bodies in its drawing, with a driven crank."""
    wrist = crank.piston([0.0])[0][0] * X + crank.offset * Y
    pin = crank.crank * (np.cos(crank.start) * X + np.sin(crank.start) * Y)
    inertia = np.array([[0.2, 0.02, -0.01], [0.02, 0.3, 0.03], [-0.01, 0.03, 0.25]])
    bodies = [
        body("crank", 1.2, (0.1, -0.05, 0.2), inertia, at=0.1 * Z),
        body("rod", 0.8, (pin + wrist) / 2 + 0.1 * Y, inertia, at=pin),
        body("piston", 1.7, wrist + 0.1 * X + 0.05 * Y - 0.1 * Z, inertia, at=wrist),
    ]
    joints = [
        ("main", "revolute", GROUND, "crank", 0 * X, Z),
        ("pin", "revolute", "crank", "rod", pin, Z),
        ("wrist", "revolute", "rod", "piston", wrist, Z),
        ("slide", "prismatic", GROUND, "piston", wrist, X),
    ]
    drives = (Drive("motor", "main", "angle", linear(crank.speed)),)
    return mechanism("driven_crank", (2.0, -9.0, 1.0), bodies, joints, drives=drives)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("crank", CRANKS.values(), ids=CRANKS)
def test_driven_crank(crank, seed):
    times = np.linspace(0, 5, 41)
    plain = driven(crank)
    motion = moved(plain, started(plain), seed, times)
    s, rate, acceleration = crank.piston(times)
    beta, turning, turning_faster = crank.rod_motion(times)
    piston, turn = plain.body_index["piston"], motion.turn("rod")[:, :2, 0]
    assert far(motion.p[:, piston], s[:, None] * X + crank.offset * Y) < BAR
    assert far(motion.v[:, piston], rate[:, None] * X) < BAR
    assert far(turn, np.column_stack([np.cos(beta - beta[0]), np.sin(beta - beta[0])])) < BAR
    assert far(motion.spin("rod"), turning[:, None] * Z) < BAR
    wrist = plain.joints[plain.joint_index["wrist"]]
    for n in (7, 40):
        state = motion.state(n)
        found = accelerations(plain, [state], t=times[n])
        assert far(found.a_WB_W[0, piston], acceleration[n] * X) < BAR
        assert far(found.alpha_WB_W[0, plain.body_index["rod"]], turning_faster[n] * Z) < BAR
        # along the slide only the wrist pin acts on the piston
        force = joint_frames(plain, state, wrist).U @ found.force_F[0, plain.joint_index["wrist"]]
        assert force[0] == pytest.approx(1.7 * (acceleration[n] - 2.0), abs=1e-8)


# --- free bodies ----------------------------------------------------------------------------------------------------

SPINS = {
    "about the greatest": (0.3, 0.8, 2.5),
    "about the least": (2.5, -0.8, 0.3),
    "backwards": (0.3, -0.8, -2.5),
    "near the middle": (0.01, 2.0, 0.01),
}
MOMENTS = {"increasing": (1.0, 2.0, 2.5), "decreasing": (2.5, 2.0, 1.0), "mixed": (2.0, 1.0, 2.5)}


@pytest.mark.parametrize("moments", MOMENTS.values(), ids=MOMENTS)
@pytest.mark.parametrize("w0", SPINS.values(), ids=SPINS)
def test_asymmetric_body_obeys_euler(w0, moments):
    top, moments = Asymmetric(moments, w0), np.array(moments)
    w, R = top.rates(TIMES), top.orientations(TIMES)
    assert w[0] == pytest.approx(w0, abs=1e-13)
    assert far(moments * difference(top.rates, TIMES), -np.cross(w, moments * w)) < 1e-11
    assert far(R[0], np.eye(3)) < 1e-14
    assert far(np.swapaxes(R, 1, 2) @ R, np.eye(3)) < 1e-13
    tilde = np.swapaxes(R, 1, 2) @ difference(top.orientations, TIMES)
    assert far(np.column_stack([tilde[:, 2, 1], tilde[:, 0, 2], tilde[:, 1, 0]]), w) < 1e-9
    assert far(np.einsum("tij,tj->ti", R, moments * w), moments * w0) < 1e-13


@pytest.mark.parametrize("w0", [(2.0, -2.4, 5.0), (-0.3, 0.2, -4.0)])
def test_symmetric_body_obeys_euler(w0):
    def rates(t):
        return symmetric(0.04, 0.02, w0, t)[1]

    def turns(t):
        return rotation_from_quaternion(symmetric(0.04, 0.02, w0, t)[0])

    w, R, moments = rates(TIMES), turns(TIMES), np.array([0.04, 0.04, 0.02])
    assert far(R[0], np.eye(3)) < 1e-15
    assert far(np.swapaxes(R, 1, 2) @ R, np.eye(3)) < 1e-14
    assert far(moments * difference(rates, TIMES), -np.cross(w, moments * w)) < 1e-10
    tilde = np.swapaxes(R, 1, 2) @ difference(turns, TIMES)
    assert far(np.column_stack([tilde[:, 2, 1], tilde[:, 0, 2], tilde[:, 1, 0]]), w) < 1e-9


def thrown(moments, w0, axes=None, gravity=(1.0, 2.0, -9.0)):
    """A free body with principal axes `axes` in the drawing, and its state with angular velocity w0 in body axes."""
    R = np.eye(3) if axes is None else axes
    thing = body("b", 1.6, (0.2, 0.1, 0.5), moments, R=R)
    plain = mechanism("free", gravity, [thing], [("f", "free", GROUND, "b", (0, 0, 0), np.eye(3))])
    return plain, placed(plain, {"b": ((-2.0, 1.5, 8.0), R @ np.asarray(w0))})


def on_the_parabola(plain, times):
    """Positions of the centre of mass of the body of `thrown`."""
    t = times[:, None]
    return plain.bodies[0].drawing.p + np.array([-2.0, 1.5, 8.0]) * t + plain.gravity * t * t / 2


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("w0", SPINS.values(), ids=SPINS)
def test_asymmetric_body_in_flight(w0, seed):
    plain, state = thrown((1.0, 2.0, 2.5), w0)
    top, motion = Asymmetric((1.0, 2.0, 2.5), w0), moved(plain, state, seed)
    # near the separatrix (rotation about the middle axis) an initial error grows 100-fold in a half-period
    bar = 100 * BAR if w0 == SPINS["near the middle"] else BAR
    assert far(motion.p[:, 0], on_the_parabola(plain, TIMES)) < BAR
    assert far(motion.turn("b"), top.orientations(TIMES)) < bar
    assert far(np.einsum("tji,tj->ti", motion.R[:, 0], motion.spin("b")), top.rates(TIMES)) < bar


@pytest.mark.parametrize("seed", SEEDS)
def test_symmetric_body_in_flight(seed):
    w0, axes = (2.0, -2.4, 5.0), rotation(np.random.default_rng(8))
    plain, state = thrown((0.04, 0.04, 0.02), w0, axes)
    motion = moved(plain, state, seed)
    quats, w = symmetric(0.04, 0.02, w0, TIMES)
    assert far(motion.p[:, 0], on_the_parabola(plain, TIMES)) < BAR
    assert far(motion.R[:, 0], axes @ rotation_from_quaternion(quats)) < BAR
    assert far(np.einsum("tji,tj->ti", motion.R[:, 0], motion.spin("b")), w) < BAR


# --- heavy tops -----------------------------------------------------------------------------------------------------

TOPS = {
    "falling": HeavyTop(0.35, 0.12, 4.1, (0.3, 1.1, -0.4), (0.0, 0.0, 30.0)),
    "looping": HeavyTop(0.35, 0.12, 4.1, (0.3, 1.1, -0.4), (-2.0, 0.4, 35.0)),
    "hanging": HeavyTop(0.35, 0.12, 4.1, (-1.0, 2.0, 0.2), (3.0, -1.5, 2.0)),
    "flat": HeavyTop(0.20, 0.22, 4.1, (0.0, 0.9, 0.0), (1.0, 1.5, -12.0)),
}


def zxz_spin(angles, rates):
    """Angular velocities in world axes from Euler angles and their rates."""
    phi, theta, _ = angles.T
    line = np.column_stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)])
    axis = np.column_stack([np.sin(phi) * np.sin(theta), -np.cos(phi) * np.sin(theta), np.cos(theta)])
    return rates[:, :1] * Z + rates[:, 1:2] * line + rates[:, 2:] * axis


@pytest.mark.parametrize("top", TOPS.values(), ids=TOPS)
def test_heavy_top_keeps_its_momenta_and_obeys_lagrange(top):
    angles = top.solve(TIMES)
    assert angles[0] == pytest.approx(top.angles, abs=1e-14)
    rates = difference(top.solve, TIMES, 5e-4)
    assert far(rates[0], np.array(top.rates)) < 1e-9
    theta = angles[:, 1]
    spin = rates[:, 2] + rates[:, 0] * np.cos(theta)
    vertical = top.transverse * rates[:, 0] * np.sin(theta) ** 2 + top.axial * spin * np.cos(theta)
    for integral in (spin, vertical):
        assert far(integral, np.full_like(integral, integral[0])) < 1e-9
    # Lagrange's equation in theta
    gyroscopic = top.axial * spin * rates[:, 0] * np.sin(theta)
    kinetic = top.transverse * rates[:, 0] ** 2 * np.sin(theta) * np.cos(theta) - gyroscopic
    theta_ddot = difference(lambda t: difference(top.solve, t, 2e-3), TIMES, 2e-3)[:, 1]
    assert far(top.transverse * theta_ddot, kinetic + top.weight_moment * np.sin(theta)) < 1e-7


def spinning(transverse, axial, weight_moment, angles, rates):
    """Mechanism and state of a top on a ball joint at the world origin."""
    mass, g = 4.0, 9.81
    arm = weight_moment / (mass * g)
    R = rotation_from_euler_zxz(angles)
    central = np.array([transverse - mass * arm**2] * 2 + [axial])
    top = body("top", mass, arm * R[:, 2], central, at=(0, 0, 0), R=R)
    plain = mechanism("top", (0, 0, -g), [top], [("ball", "spherical", GROUND, "top", (0, 0, 0), np.eye(3))])
    w = zxz_spin(np.array([angles]), np.array([rates]))[0]
    return plain, placed(plain, {"top": (np.zeros(3), w)})


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("top", TOPS.values(), ids=TOPS)
def test_heavy_top(top, seed):
    times = np.linspace(0, 5, 41)
    plain, state = spinning(top.transverse, top.axial, top.weight_moment, top.angles, top.rates)
    expected = np.array([rotation_from_euler_zxz(a) for a in top.solve(times)])
    assert far(moved(plain, state, seed, times).R[:, 0], expected) < BAR


@pytest.mark.parametrize("seed", SEEDS)
def test_steady_precession(seed):
    tilt, precession = np.pi / 3, 2.5
    spin = steady_spin(0.35, 0.12, 4.1, precession, tilt)
    plain, state = spinning(0.35, 0.12, 4.1, (0.0, tilt, 0.0), (precession, 0.0, spin))
    times = np.linspace(0, 5, 41)
    motion = moved(plain, state, seed, times)
    expected = np.array([rotation_from_euler_zxz((precession * t, tilt, spin * t)) for t in times])
    assert far(motion.R[:, 0], expected) < BAR


def test_steady_spin_balances_lagrange():
    top = HeavyTop(0.35, 0.12, 4.1, (0.0, 1.0, 0.0), (2.5, 0.0, steady_spin(0.35, 0.12, 4.1, 2.5, 1.0)))
    _, _, _, _, (u1, u2, _) = top.constants()
    assert (u1, u2) == pytest.approx((np.cos(1.0), np.cos(1.0)), abs=1e-7)  # a double root has half the digits


# --- springs that are not linear ------------------------------------------------------------------------------------

CUBES = {"hardens": (7.0, 90.0), "cube alone": (0.0, 60.0), "softens": (7.0, -8.0)}


@pytest.mark.parametrize("law", CUBES.values(), ids=CUBES)
def test_oscillators_with_a_cube_or_a_square_obey_their_equations(law):
    k, k2 = law
    for solve, power in ((lambda t: cubic(1.3, k, k2, 0.6, t), 3), (lambda t: quadratic(1.3, 7.0, 5.0, 0.6, t), 2)):
        x, v = solve(TIMES)
        assert (x[0], v[0]) == pytest.approx((0.6, 0.0), abs=1e-13)
        assert far(difference(lambda t, f=solve: f(t)[0], TIMES), v) < 1e-11
        force = -k * x - k2 * x**3 if power == 3 else -7.0 * x - 5.0 * x**2
        assert far(1.3 * difference(lambda t, f=solve: f(t)[1], TIMES), force) < 1e-10


def test_a_rotor_coasts_down_by_its_equation():
    damping = (0.3, 0.2, 0.4)
    angle, v = np.array([coasting(1.7, damping, 6.0, t) for t in TIMES]).T
    c, c1, c2 = damping
    assert (angle[0], v[0]) == (0.0, 6.0)
    part = [lambda t, k=k: np.array([coasting(1.7, damping, 6.0, x)[k] for x in t]) for k in (0, 1)]
    rates = [difference(one, TIMES[1:]) for one in part]
    assert far(rates[0], v[1:]) < 1e-10
    assert far(1.7 * rates[1], -(c + c1 * v[1:] + c2 * v[1:] ** 2) * v[1:]) < 1e-10


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("law", [*CUBES.values(), "square"], ids=[*CUBES, "square"])
def test_mass_on_a_slide_with_a_spring_that_is_not_linear(law, seed):
    """Without gravity, from rest; the period of the one that hardens by the complete elliptic integral."""
    axis, rest = np.array([2.0, -1.0, 2.0]) / 3, 0.2
    k, higher = (7.0, (5.0,)) if law == "square" else (law[0], (0.0, law[1]))
    slider = body("slider", 1.3, (0.3, 0.2, -0.1), np.diag([0.2, 0.3, 0.25]) + 0.02, at=(0.1, 0.1, 0.1))
    forces = {"joint_springs": (JointSpring("k", "slide", "distance", k, 0.0, rest, None, higher),)}
    slide = ("slide", "prismatic", GROUND, "slider", (0, 0, 0), axis)
    plain = mechanism("slide", np.zeros(3), [slider], [slide], **forces)
    motion = moved(plain, started(plain, None, {"slide": rest + 0.6}), seed)
    x, v = quadratic(1.3, k, 5.0, 0.6, TIMES) if law == "square" else cubic(1.3, *law, 0.6, TIMES)
    assert far(motion.p[:, 0], slider.drawing.p + (rest + x)[:, None] * axis) < BAR
    assert far(motion.v[:, 0], v[:, None] * axis) < BAR
    if law == CUBES["hardens"]:
        period = cubic_period(1.3, *law, 0.6)
        later = moved(plain, started(plain, None, {"slide": rest + 0.6}), seed, np.array([0.0, period]))
        assert far(later.p[1], later.p[0]) < BAR


@pytest.mark.parametrize("seed", SEEDS)
def test_a_rotor_that_a_damper_brakes(seed):
    axis, arm, inertia = np.array([2.0, 3.0, 6.0]) / 7, np.array([0.3, 0.1, -0.2]), np.diag([0.2, 0.3, 0.25]) + 0.02
    moment = axis @ inertia @ axis + 1.2 * (arm @ arm - (arm @ axis) ** 2)
    damper = JointSpring("c", "pin", "angle", 0.0, 0.03, 0.0, None, (), (0.02, 0.01))
    pin = ("pin", "revolute", GROUND, "disc", (0, 0, 0), axis)
    plain = mechanism("rotor", np.zeros(3), [body("disc", 1.2, arm, inertia)], [pin], joint_springs=(damper,))
    motion = moved(plain, started(plain, {"pin": 9.0}), seed)
    _, v = np.array([coasting(moment, (0.03, 0.02, 0.01), 9.0, t) for t in TIMES]).T
    assert far(motion.spin("disc"), v[:, None] * axis) < BAR
