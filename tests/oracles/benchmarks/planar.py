"""Planar pendulums and four-bars from the tests of other projects.

Moments of inertia about axes in the plane have no effect.
"""

import numpy as np

from consilience.mechanism import GROUND
from oracles.benchmarks.build import X, Y, Z, body, damper, mechanism, thin_rod
from oracles.integrate import integrate


def double_pendulum():
    """Two links with m = l = J = 1, centres of mass in the middle, drawn along x; g = 10. From Project Chrono."""
    bodies = [body("one", 1, X / 2, (1, 1, 1), at=0 * X), body("two", 1, 1.5 * X, (1, 1, 1), at=X)]
    joints = [("top", "revolute", GROUND, "one", 0 * X, Z), ("mid", "revolute", "one", "two", X, Z)]
    return mechanism("double_pendulum", -10 * Y, bodies, joints)


def slider_pendulum():
    """A 1 kg slider along x, on a spring of 10 N/m, with a link of `double_pendulum` along x. Project Chrono."""
    bodies = [body("slider", 1, 0 * X, (1, 1, 1)), body("link", 1, X / 2, (1, 1, 1), at=0 * X)]
    joints = [("slide", "prismatic", GROUND, "slider", 0 * X, X), ("pin", "revolute", "slider", "link", 0 * X, Z)]
    spring = damper("slide", 0.0, stiffness=10.0, coordinate="distance")
    return mechanism("slider_pendulum", -10 * Y, bodies, joints, joint_springs=(spring,))


def slider_pendulum_solve(times):
    """Slider position, link angle from x, and their rates, shape (n_t, 4); released at rest with both zero."""

    def rhs(y):
        x, phi, _, rate = y
        c, s = np.cos(phi), np.sin(phi)
        M = np.array([[2.0, -0.5 * s], [-0.5 * s, 1.25]])
        return np.concatenate([y[2:], np.linalg.solve(M, [-10 * x + 0.5 * c * rate**2, -5 * c])])

    return integrate(rhs, np.zeros(4), times)


def acrobot():
    """Drake's acrobot, drawn hanging: m = 1, 1, l = 1, 2, centres at 0.5, 1, J = 0.083, 0.33, damping 0.1; g = 9.81."""
    bodies = [body("upper", 1, -0.5 * Z, 3 * (0.083,), at=0 * Z), body("lower", 1, -2.0 * Z, 3 * (0.33,), at=-Z)]
    joints = [("shoulder", "revolute", GROUND, "upper", 0 * Z, Y), ("elbow", "revolute", "upper", "lower", -Z, Y)]
    springs = (damper("shoulder", 0.1), damper("elbow", 0.1))
    return mechanism("acrobot", -9.81 * Z, bodies, joints, joint_springs=springs)


def acrobot_solve(start, times):
    """Shoulder angle from hanging, relative elbow angle, and their rates [Spong 1995], shape (n_t, 4)."""
    g, I1, I2, lc1 = 9.81, 0.083, 0.33, 0.5

    def rhs(y):
        q1, q2, v1, v2 = y
        c, s = np.cos(q2), np.sin(q2)
        M12 = I2 + 1 + c
        M = np.array([[I1 + I2 + lc1**2 + 2 + 2 * c, M12], [M12, I2 + 1]])
        lower = g * np.sin(q1 + q2)
        bias = [-s * (2 * v1 * v2 + v2 * v2) + (lc1 + 1) * g * np.sin(q1) + lower, s * v1 * v1 + lower]
        return np.concatenate([y[2:], np.linalg.solve(M, -np.array(bias) - 0.1 * y[2:])])

    return integrate(rhs, start, times)


def _loop(name, gravity, axis, corners, masses, moments):
    """Four-bar of uniform rods; corners: crank pivot, crank pin, rocker pin, rocker pivot."""
    names = ("crank", "coupler", "rocker")
    ends = ((corners[0], corners[1]), (corners[1], corners[2]), (corners[3], corners[2]))
    bodies = [thin_rod(*row) for row in zip(names, masses, ends, moments, strict=True)]
    pairs = ((GROUND, "crank"), ("crank", "coupler"), ("coupler", "rocker"), (GROUND, "rocker"))
    pins = ("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot")
    joints = [(pin, "revolute", *pair, at, axis) for pin, pair, at in zip(pins, pairs, corners, strict=True)]
    return mechanism(name, gravity, bodies, joints)


def rigid_body_dynamics_four_bar():
    """Four-bar of RigidBodyDynamics.jl's tests: ground 1.1, crank 0.5, coupler 1.2, rocker 0.75 m."""
    theta, phi = 1.6707963267948966, 1.5397303602625536
    D = 1.1 * X
    B = 0.5 * (np.cos(theta) * X + np.sin(theta) * Y)
    C = D + 0.75 * (np.cos(phi) * X + np.sin(phi) * Y)
    return _loop("four_bar", -9.81 * Y, Z, (0 * X, B, C, D), (0.5, 1.0, 0.75), (0.333, 0.537, 0.4))


def drake_four_bar():
    """Drake's four-bar, its loop closed by a joint: rods of 4 m and 20 kg hanging in equilibrium, axes along y."""
    A = np.arctan(np.sqrt(15.0))
    P, D = 4 * (np.cos(A) * X - np.sin(A) * Z), -2 * X
    Q = D + 4 * (-np.cos(A) * X - np.sin(A) * Z)
    moment = 29.0 + 7 / 15  # printed rounded, as 29.4666667
    return _loop("drake_four_bar", -9.81 * Z, Y, (0 * X, P, Q, D), 3 * (20.0,), 3 * (moment,))
