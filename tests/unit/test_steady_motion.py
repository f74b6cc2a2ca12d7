"""Linear vibrations about steady motions against closed forms: tops, pendulums on shafts, a governor."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize

from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    Body,
    Frame,
    Initial,
    Joint,
    JointSpring,
    Mechanism,
    constraint_jacobian,
    elementary_rotation,
    initial_state,
    rotation_with_z_axis,
)
from consilience.reference.analyses import linearise, static_equilibrium
from consilience.reference.analyses.steady_motion import NotSteady, linearise_steady_motion
from mechanisms import ELEMENTS, LOOPS, chain, drawn_joint, lumpy_body, rotation, states_of

ORIGIN = Frame(np.zeros(3), np.eye(3))
G = 9.81

# ---------------------------------------------------------------- tops

MASS, ARM, J3, J_CENTRE = 1.7, 0.3, 0.021, 0.05
J1 = J_CENTRE + MASS * ARM**2
"""Moment of inertia about an axis through the pivot, perpendicular to the axis of symmetry."""


def top(theta):
    """Return a symmetric top on a ball joint in a skew world, drawn at theta from the vertical, body frame off axis."""
    rng = np.random.default_rng(3)
    world, R_BM, p_M = rotation(rng), rotation(rng), np.array([0.05, -0.1, 0.2])
    axis = R_BM[:, 2]
    inertia = J_CENTRE * np.eye(3) + (J3 - J_CENTRE) * np.outer(axis, axis)
    R_WB = world @ elementary_rotation(2, 0.4) @ elementary_rotation(0, theta) @ R_BM.T
    body = Body("top", MASS, p_M + ARM * axis, inertia, Frame(-R_WB @ p_M, R_WB))
    ball = Joint("ball", "spherical", GROUND, "top", Frame(np.zeros(3), world), Frame(p_M, R_BM))
    return Mechanism("top", -G * world[:, 2], (body,), (ball,)), world


def by_frequency(values):
    """Return the eigenvalues in an order that rounding does not change."""
    return sorted(values, key=lambda s: (round(float(np.imag(s)), 6), float(np.real(s))))


def moving(found):
    """Return the eigenvalues without those of cyclic coordinates, which are zero up to rounding."""
    return found.eigenvalues[found.frequencies > 1e-4 * found.frequencies[-1]]


def spinning(mechanism, w_F):
    return initial_state(mechanism, Initial(rates={"ball": {"orientation": w_F}}))


def axis_of(theta):
    """Return the axis of the top in axes of F: rotated by 0.4 rad about z, then by theta about x, in the drawing."""
    return elementary_rotation(2, 0.4) @ elementary_rotation(0, theta) @ np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(("theta", "precession"), [(0.6, 2.5), (0.6, -40.0), (1.3, 8.0), (2.4, 5.0)])
def test_nutation_of_a_top_in_steady_precession(theta, precession):
    """``a W - W^2 cos(theta) = m g l/J1`` and ``nu^2 = (a - W cos(theta))^2 + W^2 - 2 (m g l/J1) cos(theta)``.

    a = J3 w3/J1; the second from ``J1 nu^2 = V''`` of the effective potential (Landau and Lifshitz, section 35).
    """
    mechanism, _ = top(theta)
    beta, c = MASS * G * ARM / J1, np.cos(theta)
    a = (beta + precession**2 * c) / precession
    axis = axis_of(theta)
    spin = a * J1 / J3 - precession * c
    state = spinning(mechanism, precession * np.array([0, 0, 1.0]) + spin * axis)
    found = linearise_steady_motion(mechanism, state, [("ball", "orientation")])
    nutation = np.sqrt((a - precession * c) ** 2 + precession**2 - 2 * beta * c)
    assert found.frequencies[-1] == pytest.approx(nutation, rel=1e-8)
    assert abs(found.damping_ratios[-1]) < 1e-8
    assert np.all(found.frequencies[:-1] < 1e-4 * nutation)  # precession and spin: two zero eigenvalues each
    assert len(found.eigenvalues) in (3, 4, 5)
    assert found.stable
    assert found.coordinates == ("ball.orientation[0]", "ball.orientation[1]", "ball.orientation[2]")


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.1, 4.0])
def test_a_sleeping_top_is_stable_if_it_spins_fast_enough(factor):
    """The axis has ``s^2 - i a s - m g l/J1 = 0``, a = J3 w3/J1: stable from a^2 = 4 m g l/J1 on."""
    mechanism, _ = top(0.0)
    beta = MASS * G * ARM / J1
    a = 2.0 * np.sqrt(beta) * factor
    state = spinning(mechanism, np.array([0.0, 0.0, a * J1 / J3]))
    found = linearise_steady_motion(mechanism, state, [("ball", "orientation")])
    roots = np.array([0.5j * a + s * np.sqrt(beta - a * a / 4 + 0j) for s in (1, -1)])
    assert by_frequency(moving(found)) == pytest.approx(by_frequency(roots), rel=1e-7)
    assert found.stable == (factor > 1.0)


def test_nutation_shape():
    """Nutation of a fast top with little gravity is circular: phase of 90 degrees between the two tilts."""
    mechanism, _ = top(0.0)
    mechanism = replace(mechanism, gravity=1e-6 * mechanism.gravity)
    w = 100.0
    found = linearise_steady_motion(mechanism, spinning(mechanism, np.array([0.0, 0.0, w])), [("ball", "orientation")])
    x, y = found.shapes[-1][:2]
    assert found.frequencies[-1] == pytest.approx(J3 * w / J1, rel=1e-6)
    assert y / x == pytest.approx(-1j, abs=1e-6)  # same sense as the spin: counter-clockwise about z
    assert (
        np.max(np.abs(constraint_jacobian(mechanism, spinning(mechanism, [0, 0, w])) @ found.modes[-1].ravel())) < 1e-9
    )


# ---------------------------------------------------------------- rotating shafts


class Rotating:
    """Closed form of one angle b on a shaft that turns freely about z: ``T = I W^2/2 + h W b' + J b'^2/2``, V(b).

    With the momentum p of the shaft constant, ``m b'' + c b' + U' = 0`` with ``m = J - h^2/I`` and
    ``U = V + p^2/(2 I)``: the term of first degree in b' of the Routhian is a total derivative (Routh, 1877). Parts:
    mass, centre of mass and inertia as functions of b in axes of the shaft, and the angle per b by which the part
    turns about the hinge direction n.
    """

    def __init__(self, parts, gravity, n):
        self.parts, self.gravity, self.n = parts, gravity, n

    def coefficients(self, b):
        z = np.array([0.0, 0.0, 1.0])
        inertia = h = J = V = 0.0
        for mass, com, tensor, turn in self.parts:
            step = 1e-3
            c, Ic = com(b), tensor(b)
            slope = sum(w * com(b + k * step) for k, w in ((1, 8), (-1, -8), (2, -1), (-2, 1))) / (12 * step)
            w_b = turn * self.n
            inertia += mass * np.sum(np.cross(z, c) ** 2) + z @ Ic @ z
            h += mass * np.cross(z, c) @ slope + z @ Ic @ w_b
            J += mass * slope @ slope + w_b @ Ic @ w_b
            V += mass * self.gravity * c[2]
        return inertia, h, J, V

    def slope(self, b, speed):
        """Return ``dV/db - W^2 dI/db / 2``, which is zero in steady rotation at W."""

        def lagrangian(x):
            inertia, _, _, V = self.coefficients(x)
            return V - 0.5 * speed**2 * inertia

        return derivative(lagrangian, b)

    def eigenvalues(self, b, speed, damping=0.0):
        inertia, h, J, _ = self.coefficients(b)
        p = inertia * speed

        def effective(x):
            inertia, _, _, V = self.coefficients(x)
            return V + 0.5 * p**2 / inertia

        stiffness = derivative(lambda x: derivative(effective, x), b)
        return np.roots([J - h**2 / inertia, damping, stiffness])


def derivative(f, x, h=4e-3):
    """Return the derivative by a sixth-order central difference."""
    return sum(w * (f(x + k * h) - f(x - k * h)) for k, w in ((1, 45), (2, -9), (3, 1))) / (60 * h)


def turned(body, hinge, R_hinge, axis_R, sign):
    """Return, as functions of b, centre of mass and inertia of a body turned by ``sign * b`` about an axis."""
    R0 = body.drawing.R
    arm = body.drawing.p + R0 @ body.com - hinge

    def R(b):
        return axis_R @ elementary_rotation(2, sign * b) @ axis_R.T

    return (lambda b: R_hinge(b) + R(b) @ arm, lambda b: R(b) @ R0 @ body.inertia @ R0.T @ R(b).T)


def pendulum_on_a_shaft(damping=0.0):
    """Return a lumpy arm, hinged across a lumpy shaft that turns freely about the vertical, and its closed form."""
    rng = np.random.default_rng(12)
    bodies = {n: lumpy_body(n, rng) for n in ("shaft", "arm")}
    hinge = np.array([0.2, 0.1, 0.3])
    across = rotation_with_z_axis([0.6, -0.8, 0.0])
    joints = (
        drawn_joint("shaft", "revolute", bodies, GROUND, "shaft", np.zeros(3), np.eye(3)),
        drawn_joint("hinge", "revolute", bodies, "shaft", "arm", hinge, across),
    )
    springs = (JointSpring("c", "hinge", "angle", 0.0, damping, 0.0),)
    mechanism = Mechanism("on_shaft", np.array([0, 0, -G]), tuple(bodies.values()), joints, joint_springs=springs)
    still = [bodies["shaft"].drawing.p + bodies["shaft"].drawing.R @ bodies["shaft"].com, bodies["shaft"]]
    fixed = still[1].drawing.R @ still[1].inertia @ still[1].drawing.R.T
    com, tensor = turned(bodies["arm"], hinge, lambda b: hinge, across, 1.0)
    parts = [(still[1].mass, lambda b: still[0], lambda b: fixed, 0.0), (bodies["arm"].mass, com, tensor, 1.0)]
    return mechanism, Rotating(parts, G, across[:, 2])


def steady_angles(oracle, speed):
    """Return all angles of the arm in relative equilibrium on a shaft of that speed."""
    grid = np.linspace(-np.pi, np.pi, 400)
    slopes = np.array([oracle.slope(b, speed) for b in grid])
    return [
        scipy.optimize.brentq(lambda b: oracle.slope(b, speed), lo, hi, xtol=1e-14, rtol=1e-14)
        for lo, hi, s, e in zip(grid, grid[1:], slopes, slopes[1:], strict=False)
        if s * e < 0
    ]


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("speed", [2.0, 9.0])
def test_a_lumpy_pendulum_on_a_free_shaft(speed, damping):
    mechanism, oracle = pendulum_on_a_shaft(damping)
    angles = steady_angles(oracle, speed)
    assert len(angles) >= 2
    stable = []
    for angle in angles:
        state = initial_state(
            mechanism, Initial({"hinge": {"angle": angle}}, {"shaft": {"angle": speed}, "hinge": {"angle": 0.0}})
        )
        found = linearise_steady_motion(mechanism, state, [("shaft", "angle")])
        expected = oracle.eigenvalues(angle, speed, damping)
        expected = expected[expected.imag >= 0]
        assert by_frequency(moving(found)) == pytest.approx(by_frequency(expected), rel=1e-6)
        assert found.frequencies[0] < 1e-5 * found.frequencies[-1]
        stable.append(found.stable)
        assert found.stable == bool(np.all(expected.real < 1e-9))
    assert set(stable) == {True, False}


def conical(length, inertia=1e-9):
    """Return a small bob on a light arm at a universal joint with a vertical first axis."""
    body = Body("bob", 1.0, np.array([0.0, 0.0, -length]), inertia * np.eye(3), ORIGIN)
    return Mechanism(
        "conical", np.array([0, 0, -G]), (body,), (Joint("u", "universal", GROUND, "bob", ORIGIN, ORIGIN),)
    )


@pytest.mark.parametrize("angle", [0.2, 0.8, 1.3])
def test_a_conical_pendulum_vibrates_at_the_root_of_one_plus_three_cosines_squared(angle):
    """``nu = W sqrt(1 + 3 cos^2)``, ``W^2 = g/(l cos)``, exact for a point mass (Landau and Lifshitz, section 14)."""
    mechanism = conical(0.5)
    W = np.sqrt(G / (0.5 * np.cos(angle)))
    state = initial_state(mechanism, Initial({"u": {"angle2": angle}}, {"u": {"angle1": W, "angle2": 0.0}}))
    found = linearise_steady_motion(mechanism, state, [("u", "angle1")])
    assert found.frequencies[-1] == pytest.approx(W * np.sqrt(1 + 3 * np.cos(angle) ** 2), rel=1e-7)
    assert found.coordinates == ("u.angle1", "u.angle2")


# ---------------------------------------------------------------- a governor: loops with redundant rows


def governor():
    """Return a governor of shaft, two arms, two links, sleeve: lumpy bodies, planar loops with redundant rows."""
    rng = np.random.default_rng(19)
    names = ("shaft", "arm_1", "arm_2", "link_1", "link_2", "sleeve")
    bodies = {n: lumpy_body(n, rng) for n in names}
    across = rotation_with_z_axis([0.0, -1.0, 0.0])  # turns x towards z
    length, lean = 0.6, -0.7
    joints = [
        drawn_joint("shaft", "revolute", bodies, GROUND, "shaft", np.zeros(3), np.eye(3)),
        drawn_joint("slide", "prismatic", bodies, "shaft", "sleeve", np.zeros(3), np.eye(3)),
    ]
    ends = {}
    for n, side in ((1, 1.0), (2, -1.0)):
        top_pin = np.array([0.1 * side, 0.0, 0.8])
        knee = top_pin + length * np.array([side * np.cos(lean), 0.0, np.sin(lean)])
        foot = np.array([0.1 * side, 0.0, 0.8 + 2 * length * np.sin(lean)])
        ends[n] = (side, top_pin, knee)
        joints += [
            drawn_joint(f"top_{n}", "revolute", bodies, "shaft", f"arm_{n}", top_pin, across),
            drawn_joint(f"knee_{n}", "revolute", bodies, f"arm_{n}", f"link_{n}", knee, across),
            drawn_joint(f"foot_{n}", "revolute", bodies, f"link_{n}", "sleeve", foot, across),
        ]
    mechanism = Mechanism("governor", np.array([0, 0, -G]), tuple(bodies.values()), tuple(joints))

    def knee_at(side, pin):
        return lambda b: pin + length * np.array([side * np.cos(lean + b), 0.0, np.sin(lean + b)])

    parts = []
    for body in bodies.values():
        c0, I0 = body.drawing.p + body.drawing.R @ body.com, body.drawing.R @ body.inertia @ body.drawing.R.T
        if body.name == "shaft":
            parts.append((body.mass, lambda b, c=c0: c, lambda b, I=I0: I, 0.0))
        elif body.name == "sleeve":
            up = lambda b, c=c0: c + np.array([0, 0, 2 * length * (np.sin(lean + b) - np.sin(lean))])  # noqa: E731
            parts.append((body.mass, up, lambda b, I=I0: I, 0.0))
        else:
            side, pin, knee = ends[int(body.name[-1])]
            sign = side if body.name.startswith("arm") else -side
            at = (lambda b, p=pin: p) if body.name.startswith("arm") else knee_at(side, pin)
            hinge = pin if body.name.startswith("arm") else knee
            com, tensor = turned(body, hinge, at, across, sign)
            parts.append((body.mass, com, tensor, sign))
    return mechanism, Rotating(parts, G, across[:, 2])


@pytest.mark.parametrize("damping", [0.0, 1.5])
def test_a_governor_of_lumpy_bodies(damping):
    mechanism, oracle = governor()
    mechanism = replace(mechanism, joint_springs=(JointSpring("c", "top_1", "angle", 0.0, damping, 0.0),))
    angle = 0.15
    speed = np.sqrt(2 * oracle.slope(angle, 0.0) / derivative(lambda b: oracle.coefficients(b)[0], angle))
    state = initial_state(
        mechanism, Initial({"top_1": {"angle": angle}}, {"shaft": {"angle": speed}, "top_1": {"angle": 0.0}})
    )
    found = linearise_steady_motion(mechanism, state, [("shaft", "angle")])
    expected = oracle.eigenvalues(angle, speed, damping)
    expected = expected[expected.imag >= 0]
    assert by_frequency(moving(found)) == pytest.approx(by_frequency(expected), rel=1e-6)
    assert found.coordinates[0] == "shaft.angle"
    assert found.A.shape == (4, 4)


# ---------------------------------------------------------------- equilibrium, and refusals


@pytest.mark.parametrize(
    "mechanism", [chain("revolute", "universal", seed=30), LOOPS["four_bar"]], ids=["tree", "loop"]
)
def test_rest_is_a_steady_motion_with_the_frequencies_of_the_equilibrium(mechanism):
    state = static_equilibrium(mechanism, initial_state(mechanism))
    found, other = linearise_steady_motion(mechanism, state, []), linearise(mechanism, state)
    assert found.frequencies == pytest.approx(other.frequencies, rel=1e-7)
    assert found.stable


def test_motions_that_are_not_steady_say_how_far_they_are():
    mechanism, oracle = pendulum_on_a_shaft()
    angle = steady_angles(oracle, 2.0)[0]

    def state_of(b, shaft=2.0, hinge=0.0):
        return initial_state(
            mechanism, Initial({"hinge": {"angle": b}}, {"shaft": {"angle": shaft}, "hinge": {"angle": hinge}})
        )

    with pytest.raises(NotSteady, match=r"'(hinge|shaft)\.angle' accelerates by"):
        linearise_steady_motion(mechanism, state_of(angle + 0.1), [("shaft", "angle")])
    with pytest.raises(NotSteady, match=r"'hinge\.angle' is not cyclic, but moves at 0\.5"):
        linearise_steady_motion(mechanism, state_of(angle, hinge=0.5), [("shaft", "angle")])
    # a moving pendulum at its lowest point: the acceleration is zero at this instant only
    plane = Mechanism(
        "plane",
        np.array([0, 0, -G]),
        (Body("bob", 1.0, np.array([0, 0, -0.5]), np.diag([0.1, 0.2, 0.25]), ORIGIN),),
        (Joint("pin", "revolute", GROUND, "bob", *[Frame(np.zeros(3), rotation_with_z_axis([0, 1.0, 0]))] * 2),),
    )
    with pytest.raises(NotSteady, match=r"'pin\.angle' has changed by .* not cyclic"):
        linearise_steady_motion(plane, initial_state(plane, Initial({}, {"pin": {"angle": 3.0}})), [("pin", "angle")])
    mechanism, _ = top(0.6)
    with pytest.raises(NotSteady, match="'ball' nutates: "):
        linearise_steady_motion(mechanism, spinning(mechanism, [5.0, 1.0, 20.0]), [("ball", "orientation")])


def test_motions_that_joint_coordinates_do_not_describe_are_refused():
    mechanism = chain("rod", seed=3)
    rest = static_equilibrium(mechanism, initial_state(mechanism))
    with pytest.raises(InvalidInput, match="do not describe all of its 5 degrees"):
        linearise_steady_motion(mechanism, rest, [])
    mechanism = chain("revolute", seed=3)
    with pytest.raises(InvalidInput, match="no 'distance'"):
        linearise_steady_motion(mechanism, rest, [("j0", "distance")])


@pytest.mark.parametrize(("name", "what"), [("rolling_disc", "rolling"), ("skating", "skate")])
def test_rows_that_hold_velocities_are_refused(name, what):
    mechanism = ELEMENTS[name]
    (state,) = states_of(mechanism, 1)
    joint = mechanism.joints[0].name
    with pytest.raises(InvalidInput, match=f"{what} .*it holds velocities"):
        linearise_steady_motion(mechanism, state, [(joint, "rotation")])
