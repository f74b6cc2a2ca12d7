"""Heavy symmetric top on a fixed point [Lagrange; Goldstein, Poole & Safko 2002, section 5.7].

With ``u = cos(theta)``, theta from upward, ``P = p_phi / I1``, ``S = p_psi / I1``, ``b = 2 m g l / I1``:

    u'^2 = f(u) = (1 - u^2)(a - b u) - (P - S u)^2,   u = u1 + (u2 - u1) sn^2(q t + const),   q^2 = b (u3 - u1) / 4
    phi' = (P - S u) / (1 - u^2),   psi' = p_psi / I3 - phi' u

u1 <= u2 <= u3 are the roots of f. Azimuth and spin are elliptic integrals of the third kind.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ellipkinc

from oracles.closed_forms.pendulum import amplitude
from oracles.rotating_end_pendulum import incomplete_third


@dataclass(frozen=True)
class HeavyTop:
    """Moments about the fixed point, moment of weight m g l, and initial Euler angles (z x z) and rates.

    Attributes
    ----------
    angles, rates : tuple of float
        (phi, theta, psi), and their derivatives, at time zero.
    """

    transverse: float
    axial: float
    weight_moment: float
    angles: tuple
    rates: tuple

    def constants(self):
        """Constants a, b, P, S and the roots of f."""
        phi_dot, theta_dot, psi_dot = self.rates
        u = np.cos(self.angles[1])
        spin = self.axial * (psi_dot + phi_dot * u)
        S = spin / self.transverse
        P = phi_dot * (1 - u * u) + S * u
        b = 2 * self.weight_moment / self.transverse
        a = theta_dot**2 + phi_dot**2 * (1 - u * u) + b * u
        cubic = np.polynomial.Polynomial([a - P * P, 2 * P * S - b, -a - S * S, b])
        roots = np.sort(cubic.roots().real)
        for _ in range(3):
            roots = roots - cubic(roots) / cubic.deriv()(roots)
        return a, b, P, S, roots

    def _amplitudes(self, times):
        _, b, _, _, (u1, u2, u3) = self.constants()
        q, m = np.sqrt(b * (u3 - u1)) / 2, (u2 - u1) / (u3 - u1)
        u0 = np.cos(self.angles[1])
        # u' has the sign of -theta', and of sn cn dn
        up = 1.0 if self.rates[1] <= 0 else -1.0
        at = np.clip([u0 - u1, u2 - u0], 0, None)
        start = ellipkinc(np.arctan2(np.sqrt(at[0]), up * np.sqrt(at[1])), m)
        am, sn, _, _ = amplitude(q * np.asarray(times, dtype=float) + start, m)
        am0 = amplitude(np.array([start]), m)[0]
        return am, am0, sn, q, m

    def solve(self, times):
        """Euler angles (n_t, 3); phi and psi count full turns."""
        times = np.asarray(times, dtype=float)
        _, _, P, S, (u1, u2, _) = self.constants()
        am, am0, sn, q, m = self._amplitudes(times)
        u = u1 + (u2 - u1) * sn**2

        def integral(n):
            return (incomplete_third(n, am, m) - incomplete_third(n, am0, m)) / q

        # 1 -+ u = (1 -+ u1)(1 - n sn^2)
        minus = (P - S) / 2 * integral((u2 - u1) / (1 - u1)) / (1 - u1)
        plus = (P + S) / 2 * integral(-(u2 - u1) / (1 + u1)) / (1 + u1)
        spin = S * self.transverse / self.axial
        phi = self.angles[0] + minus + plus
        psi = self.angles[2] + (spin - S) * times - minus + plus
        return np.column_stack([phi, np.arccos(u), psi])


def steady_spin(transverse, axial, weight_moment, precession, tilt):
    """Relative spin psi' at which a top precesses steadily at a given rate and tilt; moments about the fixed point."""
    return weight_moment / (axial * precession) + (transverse - axial) / axial * precession * np.cos(tilt)
