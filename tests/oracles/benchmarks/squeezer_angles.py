"""Andrews' squeezer in the seven angles of its publications: planar Lagrange equations with six multipliers.

Angles and letters are those of `oracles.benchmarks.andrews`; derivatives are taken by CasADi.
"""

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from oracles.benchmarks.andrews import COMBINE, MASSES, MOMENTS, START, A, B, C


def e(a):
    return ca.vertcat(ca.cos(a), ca.sin(a))


def n(a):
    return ca.vertcat(ca.sin(a), -ca.cos(a))


class Equations:
    def __init__(self):
        q, v = ca.SX.sym("q", 7), ca.SX.sym("v", 7)
        beta, theta, gamma, phi, delta, Omega, epsilon = ca.vertsplit(q)
        F, G, H = 0.007 * e(beta), ca.DM(A) + 0.04 * e(delta), ca.DM(A) + 0.04 * n(epsilon)
        centres = (
            0.00092 * e(beta),
            F - 0.0115 * e(beta + theta),
            ca.DM(B) + 0.01874 * n(gamma) + 0.01043 * e(gamma),
            G + 0.00579 * n(phi + delta),
            ca.DM(A) + 0.02308 * e(delta) - 0.00916 * n(delta),
            H + 0.00579 * e(Omega + epsilon),
            ca.DM(A) + 0.01228 * n(epsilon) - 0.00449 * e(epsilon),
        )
        turns = ca.DM(np.linalg.inv(COMBINE)) @ v  # angular velocities of the bodies
        T = 0
        for c, m, moment, turn in zip(centres, MASSES, MOMENTS, ca.vertsplit(turns), strict=True):
            T += m * ca.sumsqr(ca.jtimes(c, q, v)) / 2 + moment * turn**2 / 2
        D = ca.DM(B) + 0.02 * e(gamma) + 0.018 * n(gamma)
        V = 4530 * (ca.norm_2(D - ca.DM(C)) - 0.07785) ** 2 / 2
        E = F - 0.028 * e(beta + theta)
        ways = (ca.DM(B) + 0.035 * n(gamma), G + 0.02 * n(phi + delta), H + 0.02 * e(Omega + epsilon))
        closure = ca.vertcat(*(E - way for way in ways))
        rows = ca.jacobian(closure, q)
        momenta = ca.gradient(T, v)
        f = ca.gradient(T - V, q) - ca.jtimes(momenta, q, v)
        f[0] += 0.033
        self.terms = ca.Function("terms", [q, v], [ca.jacobian(momenta, v), f, rows, -ca.jtimes(rows @ v, q, v)])
        self.closure = ca.Function("closure", [q], [closure, rows])

    def start(self, beta):
        """Consistent angles at a crank angle near that of the test set."""
        q = np.array([beta, *START[1:]])
        for _ in range(8):
            value, G = (np.array(x) for x in self.closure(q))
            q[1:] -= np.linalg.solve(G[:, 1:], value[:, 0])
        return q

    def solve(self, beta, times):
        """Angles and rates, released at rest, shape (n_t, 14)."""

        def rhs(_, y):
            M, f, G, gamma = (np.array(x) for x in self.terms(*np.split(y, 2)))
            saddle = np.block([[M, -G.T], [G, np.zeros((6, 6))]])
            return np.concatenate([y[7:], np.linalg.solve(saddle, np.vstack([f, gamma]))[:7, 0]])

        start = np.concatenate([self.start(beta), np.zeros(7)])
        done = solve_ivp(rhs, (0.0, max(times)), start, "DOP853", times, rtol=1e-13, atol=1e-13, max_step=1e-4)
        assert done.success, done.message
        return done.y.T
