"""Symmetric heavy top and spherical pendulum by Jacobi's functions, accurate also near the vertical.

Rates included. Notation as in `oracles.closed_forms.heavy_top`. The distance ``d = 1 + u1`` of the lowest point from
straight down is a root of its own equation, ``f(-1 + d) = d (2 - d)(a + b - b d) - (P + S - S d)^2``, because
``1 + u1`` loses its digits if d is small.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ellipkinc, elliprf, elliprj

from consilience.mechanism import rotation_from_euler_zxz
from oracles.closed_forms.heavy_top import HeavyTop
from oracles.closed_forms.pendulum import amplitude
from oracles.rotating_end_pendulum import incomplete_third


def third_of_large_negative(n, amplitude, m):
    """``Pi(n; amplitude | m)`` for large negative n [Abramowitz & Stegun 17.7.15-17].

    Computed from an integral with n between m and 1. Carlson's form of Pi(n) itself is a difference of two numbers and
    loses a factor ``sqrt(-n)`` of accuracy.
    """
    turns = np.round(amplitude / np.pi)
    N, rest = (m - n) / (1 - n), (1 - m) / (1 - n)  # rest = 1 - N
    p = np.sqrt(-n * (m - n) / (1 - n))

    def within(angle):
        s, c2 = np.sin(angle), np.cos(angle) ** 2
        delta, pole = 1 - m * s * s, c2 + rest * s * s
        first = s * elliprf(c2, delta, 1.0)
        third = first + N / 3 * s**3 * elliprj(c2, delta, 1.0, pole)
        turned = np.arctan(p * s * np.cos(angle) / np.sqrt(delta))
        return (np.sqrt(rest * (1 - m / N)) * third + m / p * first + turned) / np.sqrt((1 - n) * (1 - m / n))

    return within(amplitude - np.pi * turns) + 2 * turns * within(np.pi / 2)


@dataclass(frozen=True)
class Swing:
    """Motion of the axis of a top."""

    top: HeavyTop

    def _constants(self):
        a, b, P, S, (u1, u2, u3) = self.top.constants()
        d = max(1 + u1, np.finfo(float).eps)
        for _ in range(50):
            value = d * (2 - d) * (a + b - b * d) - (P + S - S * d) ** 2
            slope = 2 * (1 - d) * (a + b - b * d) - b * d * (2 - d) + 2 * S * (P + S - S * d)
            d -= value / slope
        return a, b, P, S, d, u2, u3

    def solve(self, t):
        """Euler angles z x z and their rates."""
        top = self.top
        _, b, P, S, d, u2, u3 = self._constants()
        reach = u2 + 1 - d
        q, m = np.sqrt(b * (u3 + 1 - d)) / 2, reach / (u3 + 1 - d)
        u0 = np.cos(top.angles[1])
        up = 1.0 if top.rates[1] <= 0 else -1.0
        at = np.clip([u0 + 1 - d, u2 - u0], 0, None)
        if abs(top.rates[1]) < 1e-12:  # a turning point, upper or lower
            at[np.argmin(at)] = 0.0
        start = ellipkinc(np.arctan2(np.sqrt(at[0]), up * np.sqrt(at[1])), m)
        am, sn, cn, dn = (x[0] for x in amplitude(np.array([q * t + start]), m))
        am0 = amplitude(np.array([start]), m)[0][0]

        def integral(n):
            third = third_of_large_negative if n < -1 else incomplete_third
            return float(third(n, np.array(am), m) - third(n, np.array(am0), m)) / q

        # 1 + u = d (1 - n sn^2), n = -reach / d; 1 - u = (2 - d)(1 - n sn^2), n = reach / (2 - d)
        below = d + reach * sn**2
        u = below - 1
        minus = (P - S) / 2 * integral(reach / (2 - d)) / (2 - d)
        plus = (P + S) / 2 * integral(-reach / d) / d
        spin = S * top.transverse / top.axial
        sine = np.sqrt(below * (1 - u))
        phi_dot = (P - S * u) / (below * (1 - u))
        theta_dot = -2 * reach * q * sn * cn * dn / sine
        angles = (top.angles[0] + minus + plus, np.arctan2(sine, u), top.angles[2] + (spin - S) * t - minus + plus)
        return angles, (phi_dot, theta_dot, spin - phi_dot * u)


def _axis(angles):
    phi, theta, _ = angles
    return np.array([np.sin(phi) * np.sin(theta), -np.cos(phi) * np.sin(theta), np.cos(theta)])


def _turning(angles, rates):
    """Angular velocity in world axes."""
    phi = angles[0]
    line = np.array([np.cos(phi), np.sin(phi), 0.0])
    return rates[0] * np.array([0.0, 0.0, 1.0]) + rates[1] * line + rates[2] * _axis(angles)


def _start(e, e_dot):
    """phi and theta of an axis, and their rates."""
    level = np.hypot(e[0], e[1])
    phi, theta = np.arctan2(e[0], -e[1]), np.arctan2(level, e[2])
    return (phi, theta), ((e[0] * e_dot[1] - e[1] * e_dot[0]) / level**2, -e_dot[2] / level)


def heavy(mass, inertia, c, w, g):
    """Rotation and angular velocity of a heavy top at a time; c is its centre of mass from the fixed point."""
    l = np.linalg.norm(c)
    e = c / l
    axial = e @ inertia @ e
    transverse = (np.trace(inertia) - axial) / 2 + mass * l**2
    (phi, theta), (phi_dot, theta_dot) = _start(e, np.cross(w, e))
    angles = (phi, theta, 0.0)
    top = HeavyTop(transverse, axial, mass * g * l, angles, (phi_dot, theta_dot, w @ e - phi_dot * e[2]))
    start = rotation_from_euler_zxz(angles)

    def at(t):
        now, rates = Swing(top).solve(t)
        return rotation_from_euler_zxz(now) @ start.T, _turning(now, rates)

    return at


def spherical(arm, v, g):
    """Arm and velocity at a time of a point mass on a rod: a top without axial momentum."""
    l = np.linalg.norm(arm)
    (phi, theta), (phi_dot, theta_dot) = _start(arm / l, v / l)
    top = HeavyTop(l**2, 1.0, g * l, (phi, theta, 0.0), (phi_dot, theta_dot, -phi_dot * arm[2] / l))

    def at(t):
        angles, rates = Swing(top).solve(t)
        e = _axis(angles)
        return l * e, l * np.cross(_turning(angles, rates), e)

    return at
