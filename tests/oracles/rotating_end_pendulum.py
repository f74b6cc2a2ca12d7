"""Symmetric gyrostat on a ball joint, released horizontally: Jacobi elliptic functions and integrals.

Each body has equal moments of inertia about every axis through its centre of mass, and both centres of mass lie on the
bearing's line through the ball joint. Then the axial spins of arm and rotor are constant (neither gravity nor a joint
has a moment about the line), and the unit vector ``e`` along the line moves as that of a symmetric top with transverse
inertia ``It`` about the ball joint and constant axial momentum ``Ls``. Let ``u = cos(theta)`` be the upward component
of ``e``. Energy and vertical angular momentum, both zero for a release at rest from ``u = 0``, give

    phi' = -b u / (1 - u^2),   u'^2 = a u (u^2 - (b^2 / a) u - 1) = a u (u - u1)(u - u3),   u1 <= u <= 0 < u3

with ``a = 2 m g l / It`` and ``b = Ls / It``; hence ``u = u1 cn^2(K + p t)``, ``p^2 = a (u3 - u1) / 4``,
``m = -u1 / (u3 - u1)``. The azimuth and the turns about ``e`` are integrals of ``1 / (1 -+ u)``, elliptic ones of the
third kind.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ellipj, ellipk, elliprf, elliprj

from oracles.planar import drawn_frame, held


def incomplete_third(n, amplitude, m):
    """Legendre's integral ``Pi(n; amplitude | m)`` for any amplitude, from Carlson's forms [DLMF 19.25.14]."""
    turns = np.round(amplitude / np.pi)
    rest = amplitude - np.pi * turns

    def within(angle):
        s, c2 = np.sin(angle), np.cos(angle) ** 2
        delta, pole = 1 - m * s * s, 1 - n * s * s
        return s * elliprf(c2, delta, 1.0) + n / 3 * s**3 * elliprj(c2, delta, 1.0, pole)

    return within(rest) + 2 * turns * within(np.pi / 2)


@dataclass(frozen=True)
class Gyrostat:
    """Constants: transverse inertia about the ball joint, axial momentum, moment of the weight ``m g l``."""

    transverse: float
    axial_momentum: float
    weight_moment: float

    def solve(self, times):
        """``u = cos(theta)``, azimuth ``phi`` and axial turn ``psi`` of a body without axial spin, each shape (n_t,).

        The axial turn is relative to the meridian: ``psi' = -phi' u`` cancels the axial part of the precession.
        """
        times = np.asarray(times, dtype=float)
        a, b = 2 * self.weight_moment / self.transverse, self.axial_momentum / self.transverse
        half = b * b / (2 * a)
        u3 = half + np.sqrt(half * half + 1)
        u1 = -1 / u3
        m, p = u1 / (u1 - u3), np.sqrt(a * (u3 - u1)) / 2
        K = ellipk(m)
        _, cn, _, amplitude = ellipj(K + p * times, m)
        u = u1 * cn**2

        def integral(n):
            """Integral over time of ``1 / (1 - n sn^2)``."""
            return (incomplete_third(n, amplitude, m) - incomplete_third(n, np.array(np.pi / 2), m)) / p

        # 1 -+ u = (1 -+ u1)(1 - n sn^2) with sn^2 + cn^2 = 1
        minus, plus = integral(-u1 / (1 - u1)) / (1 - u1), integral(u1 / (1 + u1)) / (1 + u1)
        phi = -b * (minus - plus) / 2  # u / (1 - u^2) = (1/(1 - u) - 1/(1 + u)) / 2
        psi = b * ((minus + plus) / 2 - times)  # u^2 / (1 - u^2) = 1/(1 - u^2) - 1
        return u, phi, psi


def gyrostat(case):
    """Constants of a case with an arm on the joint ball and a rotor on the joint bearing, drawn horizontally."""
    mechanism = case.mechanism
    ball = drawn_frame(mechanism, mechanism.joints[mechanism.joint_index["ball"]])[0]
    e = drawn_frame(mechanism, mechanism.joints[mechanism.joint_index["bearing"]])[1][:, 2]
    assert e @ mechanism.gravity == 0
    transverse = weight = 0.0
    for body in mechanism.bodies:
        moment = body.inertia[0, 0]
        assert np.array_equal(body.inertia, moment * np.eye(3))
        arm = body.drawing.p + body.drawing.R @ body.com - ball
        assert np.linalg.norm(np.cross(arm, e)) == 0
        transverse += moment + body.mass * (arm @ e) ** 2
        weight += body.mass * (arm @ e) * np.linalg.norm(mechanism.gravity)
    spin = held(case, "bearing")[1]
    return Gyrostat(transverse, mechanism.bodies[1].inertia[0, 0] * spin, weight)


def trajectory(case, times):
    """Poses p_WB (n_t, 2, 3) and R_WB (n_t, 2, 3, 3) of arm and rotor."""
    mechanism = case.mechanism
    ball = drawn_frame(mechanism, mechanism.joints[mechanism.joint_index["ball"]])[0]
    e = drawn_frame(mechanism, mechanism.joints[mechanism.joint_index["bearing"]])[1][:, 2]
    u, phi, psi = gyrostat(case).solve(times)
    up = -mechanism.gravity / np.linalg.norm(mechanism.gravity)
    level = np.column_stack([e, np.cross(up, e), up])  # initial axes: along the pendulum, sideways, up
    sine = np.sqrt(1 - u * u)
    c, s, zero = np.cos(phi), np.sin(phi), np.zeros_like(u)
    # meridian frame: down the meridian, along the parallel, along e
    down = np.stack([u * c, u * s, -sine], axis=-1)
    along = np.stack([-s, c, zero], axis=-1)
    out = np.stack([sine * c, sine * s, u], axis=-1)
    meridian = level @ np.stack([down, along, out], axis=-1)
    start = np.column_stack([-up, level[:, 1], e])  # the meridian frame at t = 0
    spin = held(case, "bearing")[1]
    poses = [
        _placed(body, ball, meridian, start, psi + turn)
        for body, turn in zip(mechanism.bodies, (zero, spin * np.asarray(times)), strict=True)
    ]
    return np.stack([p for p, _ in poses], axis=1), np.stack([R for _, R in poses], axis=1)


def _placed(body, ball, meridian, start, angle):
    """Poses of a body that is turned by `angle` about e relative to the meridian frame."""
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    about_e = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1], axis=-1).reshape(-1, 3, 3)
    turn = meridian @ about_e @ start.T
    return ball + turn @ (body.drawing.p - ball), turn @ body.drawing.R
