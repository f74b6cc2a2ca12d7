"""Mechanisms of one degree of freedom from their poses alone: ``J q'' + J_q q'^2 / 2 + V_q = 0``.

Poses are sampled at Chebyshev points of the coordinate and differentiated as polynomials, so that neither velocities
nor constraint equations are needed: ``J = sum m c_q . c_q + w . I w``, w the vector of ``R^T R_q``, and
``V = -sum m g . c``.
"""

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebfit, chebpts1

from oracles.integrate import integrate


class Reduced:
    """Equation of motion in one coordinate, from sampled poses.

    Parameters
    ----------
    sample : callable
        ``sample(q)`` gives centres of mass (n_b, 3) and rotations (n_b, 3, 3); q is the coordinate.
    masses : array_like, shape (n_b,)
    inertias : array_like, shape (n_b, 3)
        Principal moments in the axes of the rotations.
    interval : tuple of float
        Range of the coordinate.
    degree : int
        Of the polynomials; their last coefficients must be at rounding level.
    """

    def __init__(self, sample, masses, inertias, gravity, interval, degree):
        low, high = interval
        self.domain, self.degree, x = interval, degree, chebpts1(degree + 1)
        poses = [sample(low + (high - low) * (s + 1) / 2) for s in x]
        c, R = (np.array([p[k] for p in poses]) for k in (0, 1))
        self.centres, self.rotations = self._fit(x, c), self._fit(x, R)
        c_q, R_q = self._slope(self.centres, x), self._slope(self.rotations, x)
        c_q, R_q = c_q.reshape(c.shape), R_q.reshape(R.shape)
        tilde = np.swapaxes(R, -1, -2) @ R_q
        w = np.stack([tilde[..., 2, 1], tilde[..., 0, 2], tilde[..., 1, 0]], axis=-1)
        J = np.einsum("b,xbi,xbi->x", masses, c_q, c_q) + np.einsum("bi,xbi,xbi->x", inertias, w, w)
        self.J = self._series(chebfit(x, J, degree))
        self.V = self._series(chebfit(x, -(c @ gravity) @ masses, degree))

    def _series(self, coefficients):
        return Chebyshev(coefficients, domain=self.domain)

    def _fit(self, x, values):
        return [self._series(k) for k in chebfit(x, values.reshape(len(x), -1), self.degree).T]

    def _slope(self, series, x):
        low, high = self.domain
        q = low + (high - low) * (x + 1) / 2
        return np.array([s.deriv()(q) for s in series]).T

    def centre(self, q):
        """Centres of mass, shape (n_t, n_b, 3)."""
        return np.array([s(q) for s in self.centres]).T.reshape(len(q), -1, 3)

    def solve(self, start, times):
        """q and q' at `times`, shape (n_t, 2)."""
        J, V_q, J_q = self.J, self.V.deriv(), self.J.deriv()

        def rhs(y):
            return np.array([y[1], -(V_q(y[0]) + J_q(y[0]) * y[1] ** 2 / 2) / J(y[0])])

        return integrate(rhs, start, times)

    def energy(self, q, rate):
        return self.J(q) * rate**2 / 2 + self.V(q)
