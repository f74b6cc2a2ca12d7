"""Motions in closed form: the pendulum of any energy, the heavy symmetric top, the damped oscillator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # loads `scipy.special` on first use
from numpy.typing import ArrayLike

from consilience.mechanism import Array

PENDULUM = "closed form: phi'' = -w^2 sin(phi) in Jacobi elliptic functions, Landau & Lifshitz, Mechanics, section 11"
TOP = "closed form: heavy symmetric top, Goldstein, Poole & Safko, Classical Mechanics, 2002, section 5.7"


def _amplitude(u: Array, m: float) -> tuple[Array, Array, Array, Array]:
    """Jacobi's amplitude am, sn, cn, dn; whole periods are taken off first to keep the digits."""
    period = 4 * scipy.special.ellipk(m)
    turns = np.floor(u / period)
    sn, cn, dn, am = scipy.special.ellipj(u - turns * period, m)
    return am + 2 * np.pi * turns, sn, cn, dn


def pendulum(frequency: float, angle: float, rate: float, times: ArrayLike) -> tuple[Array, Array]:
    """Return angle from the stable pose, over full turns, and rate of ``phi'' = -w^2 sin(phi)``, each shape (n_t,).

    With ``m = (phi' / 2 w)^2 + sin(phi / 2)^2`` at the start: it swings where m < 1,
    ``sin(phi / 2) = k sn(w t + u0 | m)``, ``k^2 = m``; it turns over where m > 1,
    ``phi / 2 = am(k w t + u0 | 1 / m)`` [Landau & Lifshitz, section 11].

    Parameters
    ----------
    frequency : float, rad/s
        w, of small oscillations.
    angle, rate : float, rad and rad/s
        At the start.
    """
    w, t = frequency, np.asarray(times, dtype=float)
    base = 2 * np.pi * np.round(angle / (2 * np.pi))
    start = angle - base
    m = (rate / (2 * w)) ** 2 + np.sin(start / 2) ** 2
    k = np.sqrt(m)
    if m > 1:
        sense = np.sign(rate)
        am, _, _, dn = _amplitude(k * w * t + scipy.special.ellipkinc(sense * start / 2, 1 / m), 1 / m)
        return base + 2 * sense * am, 2 * sense * k * w * dn
    u0 = scipy.special.ellipkinc(np.arctan2(np.sin(start / 2) / k, rate / (2 * k * w)), m)
    _, sn, cn, _ = _amplitude(w * t + u0, m)
    return base + 2 * np.arcsin(k * sn), 2 * k * w * cn


def oscillator(frequency: float, damping_ratio: float, start: float, rate: float, times: ArrayLike) -> Array:
    """Return the displacement of ``x'' + 2 zeta w x' + w^2 x = 0``, shape (n_t,).

    Parameters
    ----------
    frequency : float, rad/s
        w.
    damping_ratio : float
        zeta, 0 <= zeta < 1.
    start, rate : float, m and m/s
        x and x' at the time zero.
    times : array_like, shape (n_t,), s
    """
    t = np.asarray(times, dtype=float)
    decay, w = damping_ratio * frequency, frequency * np.sqrt(1 - damping_ratio**2)
    swing = start * np.cos(w * t) + (rate + decay * start) / w * np.sin(w * t)
    return np.asarray(np.exp(-decay * t) * swing)


def _third(n: float, phi: Array, m: float) -> Array:
    """Incomplete elliptic integral of the third kind, ``int_0^phi dx / ((1 - n sin^2 x) sqrt(1 - m sin^2 x))``."""
    turns = np.round(phi / np.pi)
    s, c2 = np.sin(phi - np.pi * turns), np.cos(phi) ** 2
    d = 1 - m * s * s
    R_F, R_J = scipy.special.elliprf, scipy.special.elliprj
    whole = 2 * (R_F(0.0, 1 - m, 1.0) + n / 3 * R_J(0.0, 1 - m, 1.0, 1 - n))
    return np.asarray(turns * whole + s * R_F(c2, d, 1.0) + n / 3 * s**3 * R_J(c2, d, 1.0, 1 - n * s * s))


@dataclass(frozen=True)
class HeavyTop:
    """Heavy symmetric top on a fixed point, in Euler angles (phi, theta, psi) z x z, theta from upward.

    With ``u = cos(theta)``, ``P = p_phi / I1``, ``S = p_psi / I1``, ``b = 2 m g l / I1``:

        u'^2 = (1 - u^2)(a - b u) - (P - S u)^2,    u = u1 + (u2 - u1) sn^2(q t + const),    q^2 = b (u3 - u1) / 4
        phi' = (P - S u) / (1 - u^2),    psi' = p_psi / I3 - phi' u

    u1 <= u2 <= u3 the roots of the cubic; azimuth and spin are elliptic integrals of the third kind [Goldstein].

    Attributes
    ----------
    transverse, axial : float, kg m^2
        Moments of inertia about the fixed point.
    weight_moment : float, N m
        m g l.
    angles, rates : (float, float, float), rad and rad/s
        At the start; the rate of theta not zero.
    """

    transverse: float
    axial: float
    weight_moment: float
    angles: tuple[float, float, float]
    rates: tuple[float, float, float]

    def solve(self, times: ArrayLike) -> Array:
        """Return Euler angles, phi and psi over full turns, shape (n_t, 3), rad."""
        t = np.asarray(times, dtype=float)
        S, P, b, (u1, u2, u3) = self._constants()
        q, m = np.sqrt(b * (u3 - u1)) / 2, (u2 - u1) / (u3 - u1)
        u0 = np.cos(self.angles[1])
        # u' has the sign of -theta', and of sn cn
        rising = 1.0 if self.rates[1] <= 0 else -1.0
        phase = scipy.special.ellipkinc(np.arctan2(np.sqrt(max(u0 - u1, 0.0)), rising * np.sqrt(max(u2 - u0, 0.0))), m)
        am, sn, _, _ = _amplitude(q * np.append(t, 0.0) + phase, m)
        u = u1 + (u2 - u1) * sn[:-1] ** 2

        def integral(n: float) -> Array:
            third = _third(n, am, m)
            return (third[:-1] - third[-1]) / q

        # 1 -+ u = (1 -+ u1)(1 - n sn^2)
        minus = (P - S) / 2 * integral((u2 - u1) / (1 - u1)) / (1 - u1)
        plus = (P + S) / 2 * integral(-(u2 - u1) / (1 + u1)) / (1 + u1)
        spin = S * self.transverse / self.axial
        phi, psi = self.angles[0] + minus + plus, self.angles[2] + (spin - S) * t - minus + plus
        return np.column_stack([phi, np.arccos(u), psi])

    def _constants(self) -> tuple[float, float, float, Array]:
        """S, P, b and the roots, in increasing order."""
        phi_dot, theta_dot, psi_dot = self.rates
        u = np.cos(self.angles[1])
        S = self.axial * (psi_dot + phi_dot * u) / self.transverse
        P = phi_dot * (1 - u * u) + S * u
        b = 2 * self.weight_moment / self.transverse
        a = theta_dot**2 + phi_dot**2 * (1 - u * u) + b * u
        cubic = np.polynomial.Polynomial([a - P * P, 2 * P * S - b, -a - S * S, b])
        roots = np.sort(cubic.roots().real)
        for _ in range(3):
            roots = roots - cubic(roots) / cubic.deriv()(roots)
        return float(S), float(P), float(b), roots


def second_kind_inverse(m: float, start: float, value: float) -> float:
    """Return phi with ``E(phi | m) - E(start | m) = value``, m < 1, by Newton's method."""
    phi, E = start, scipy.special.ellipeinc
    for _ in range(50):
        step = (value - (E(phi, m) - E(start, m))) / np.sqrt(1 - m * np.sin(phi) ** 2)
        phi += step
        if abs(step) < 1e-16 * max(1.0, abs(phi)):
            break
    return float(phi)
