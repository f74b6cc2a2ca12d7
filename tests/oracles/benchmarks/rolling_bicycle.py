"""Whipple bicycle: Lagrange's equations with multipliers (Voss, Hamel) in nine coordinates, derived by CasADi.

Coordinates: centre of the rear wheel x, y, z; yaw, lean, pitch of the rear frame, ``Rz Rx Ry``; steer; rotation angles
of both wheels. The lowest material point of each wheel has zero velocity, three rows per wheel, ``A q' = 0``:

    d/dt T_v - T_q + V_q = A^T lam,        A q'' = -A' q'
"""

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from oracles.benchmarks import bicycle

NAMES = ("x", "y", "z", "yaw", "lean", "pitch", "steer", "rear", "front")
DOWN = ca.DM([0, 0, 1])


def _about(axis, angle):
    K = ca.skew(ca.DM(axis))
    return ca.DM.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * K @ K


class Equations:
    def __init__(self):
        q, v = ca.SX.sym("q", 9), ca.SX.sym("v", 9)
        X, Y, Z = np.eye(3)
        B = _about(Z, q[3]) @ _about(X, q[4]) @ _about(Y, q[5])
        H = B @ _about(bicycle.STEER_AXIS, q[6])
        turns = {"B": B, "H": H, "R": B @ _about(Y, q[7]), "F": H @ _about(Y, q[8])}
        drawn = {b.name: b.drawing.p for b in bicycle.BODIES}
        steered = q[:3] + B @ ca.DM(bicycle.STEER_POINT - drawn["R"])
        centres = {"R": q[:3], "B": q[:3] + B @ ca.DM(drawn["B"] - drawn["R"])}
        centres |= {name: steered + H @ ca.DM(drawn[name] - bicycle.STEER_POINT) for name in ("H", "F")}

        def rate(x):
            return ca.jtimes(x, q, v)

        def spin(R):
            return ca.inv_skew(ca.reshape(rate(ca.vec(R)), 3, 3) @ R.T)

        T = V = 0
        for b in bicycle.BODIES:
            c, R = centres[b.name], turns[b.name]
            w = R.T @ spin(R)
            T += b.mass * ca.sumsqr(rate(c)) / 2 + ca.dot(w, ca.DM(b.inertia) @ w) / 2
            V -= b.mass * bicycle.G * c[2]
        rows = []
        for name, frame, radius in (("R", B, bicycle.REAR), ("F", H, bicycle.FRONT)):
            axle = frame @ ca.DM(Y)
            lowest = DOWN - ca.dot(DOWN, axle) * axle
            rows.append(rate(centres[name]) + ca.cross(spin(turns[name]), radius * lowest / ca.norm_2(lowest)))
        slip = ca.vertcat(*rows)
        momenta = ca.gradient(T, v)
        A = ca.jacobian(slip, v)
        f = ca.gradient(T - V, q) - rate(momenta)
        self.terms = ca.Function("terms", [q, v], [ca.jacobian(momenta, v), f, A, -rate(slip)])
        poses = ca.horzcat(*(centres[b.name] for b in bicycle.BODIES))
        self.read = ca.Function("read", [q, v], [poses, rate(poses), B])

    def start(self, speed, lean_rate):
        """Coordinates and rates of the upright bicycle, straight ahead; rates from the rolling constraints."""
        q, v = np.zeros(9), np.zeros(9)
        q[2] = -bicycle.REAR
        v[4], v[7] = lean_rate, -speed / bicycle.REAR
        A = np.array(self.terms(q, v)[2])
        open_ones = [0, 1, 2, 3, 5, 8]
        v[open_ones] = np.linalg.solve(A[:, open_ones], -A[:, [4, 7]] @ v[[4, 7]])
        return np.concatenate([q, v])

    def solve(self, speed, lean_rate, times):
        """Coordinates and rates, shape (n_t, 18)."""

        def rhs(_, y):
            M, f, A, gamma = (np.array(x) for x in self.terms(*np.split(y, 2)))
            saddle = np.block([[M, -A.T], [A, np.zeros((6, 6))]])
            return np.concatenate([y[9:], np.linalg.solve(saddle, np.vstack([f, gamma]))[:9, 0]])

        start, end = self.start(speed, lean_rate), max(times)
        done = solve_ivp(rhs, (0.0, end), start, "DOP853", times, rtol=1e-13, atol=1e-13, max_step=0.02)
        assert done.success, done.message
        return done.y.T
