"""Pendulum of any energy: ``phi'' = -w^2 sin(phi)`` [Landau & Lifshitz, section 11].

With ``m = (phi'^2 / 2 + w^2 (1 - cos phi)) / (2 w^2)``: the pendulum swings if m < 1, with
``sin(phi / 2) = k sin(am(u | m))``, ``k^2 = m``, ``u = w t + u0``, and turns over if m > 1, with
``phi / 2 = am(k u | 1 / m)``.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ellipj, ellipk, ellipkinc


def amplitude(u, m):
    """Jacobi's amplitude, sn, cn and dn of any argument; whole periods are subtracted first to keep the digits."""
    period = 4 * ellipk(m)
    turns = np.floor(u / period)
    sn, cn, dn, am = ellipj(u - turns * period, m)
    return am + 2 * np.pi * turns, sn, cn, dn


@dataclass(frozen=True)
class Pendulum:
    """Natural frequency at small amplitude (rad/s), and initial angle from hanging and rate."""

    frequency: float
    angle: float
    rate: float

    @property
    def parameter(self):
        """Parameter m: the pendulum swings if m < 1 and turns over if m > 1."""
        return (self.rate / (2 * self.frequency)) ** 2 + np.sin(self.angle / 2) ** 2

    def solve(self, times):
        """Angle, with full turns counted, and rate, each shape (n_t,)."""
        w, m = self.frequency, self.parameter
        k = np.sqrt(m)
        if m > 1:
            sense = np.sign(self.rate)
            start = ellipkinc(sense * self.angle / 2, 1 / m)
            am, _, _, dn = amplitude(k * w * np.asarray(times) + start, 1 / m)
            return 2 * sense * am, 2 * sense * k * w * dn
        start = ellipkinc(np.arctan2(np.sin(self.angle / 2) / k, self.rate / (2 * k * w)), m)
        _, sn, cn, _ = amplitude(w * np.asarray(times) + start, m)
        return 2 * np.arcsin(k * sn), 2 * k * w * cn

    @property
    def period(self):
        """Period of a swing, or of one full turn."""
        m = self.parameter
        return 4 * ellipk(m) / self.frequency if m < 1 else 2 * ellipk(1 / m) / np.sqrt(m) / self.frequency
