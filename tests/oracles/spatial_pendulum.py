"""Chain of revolute joints: Lagrange's equations in the joint angles, differentiated by complex step.

Kinetic energy ``T = q'.M(q) q' / 2`` from the Jacobians of the bodies, potential energy ``V(q)``; then
``M q'' = -M' q' + d(q'.M q' / 2)/dq - dV/dq``. All derivatives of M and V with respect to q are complex steps,
``df/dq = Im f(q + i h) / h`` with h so small that the truncation error vanishes: no cross product of two angular
velocities and no Coriolis term is written by hand.
"""

import numpy as np

from oracles.integrate import integrate
from oracles.planar import drawn_frame, held

STEP = 1e-30


def _about(axis, angle):
    """Rotation about a unit axis by each of an array of (complex) angles, shape (n, 3, 3)."""
    x, y, z = axis
    tilde = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    c, s = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    return c * np.eye(3) + s * tilde + (1 - c) * np.outer(axis, axis)


def _cross(a, b):
    """Vector product along the last axis, without the overhead of np.cross on small arrays."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


class Chain:
    """Bodies in a chain of revolute joints, in order from the ground."""

    def __init__(self, mechanism):
        self.bodies = mechanism.bodies
        self.gravity = mechanism.gravity
        frames = [drawn_frame(mechanism, joint) for joint in mechanism.joints]
        self.pins = [p for p, _ in frames]
        self.axes = [R[:, 2] for _, R in frames]
        self.coms = [b.drawing.p + b.drawing.R @ b.com for b in self.bodies]
        self.inertias = [b.drawing.R @ b.inertia @ b.drawing.R.T for b in self.bodies]

    def displacements(self, q):
        """Rotation (n, 3, 3) and translation (n, 3) of each body from the drawing; `q` is (n, joints)."""
        R, t, placed = np.eye(3), np.zeros(3), []
        for n, (pin, axis) in enumerate(zip(self.pins, self.axes, strict=True)):
            pin_now = R @ pin + t
            R = R @ _about(axis, q[:, n])
            t = pin_now - R @ pin
            placed.append((R, t))
        return placed

    def mass_matrix_and_potential(self, q):
        """M (n, joints, joints) and V (n,) at complex angles `q` (n, joints)."""
        n, count = q.shape
        M, V = np.zeros((n, count, count), dtype=complex), np.zeros(n, dtype=complex)
        pins, axes = np.zeros((2, n, count, 3), dtype=complex)
        for k, (R, t) in enumerate(self.displacements(q)):
            pins[:, k], axes[:, k] = R @ self.pins[k] + t, R @ self.axes[k]
            com = R @ self.coms[k] + t
            spin = axes[:, : k + 1]  # a joint turns every body beyond it
            velocity = _cross(spin, com[:, None] - pins[:, : k + 1])
            local = spin @ R
            M[:, : k + 1, : k + 1] += self.bodies[k].mass * velocity @ np.swapaxes(velocity, 1, 2)
            M[:, : k + 1, : k + 1] += local @ self.inertias[k] @ np.swapaxes(local, 1, 2)
            V -= self.bodies[k].mass * com @ self.gravity
        return M, V

    def rhs(self, y):
        """Derivative of (angles, rates)."""
        q, rates = np.split(y, 2)
        steps = np.vstack([np.zeros(len(q)), np.eye(len(q))])
        M, V = self.mass_matrix_and_potential(q + 1j * STEP * steps)
        M_q, V_q = M[1:].imag / STEP, V[1:].imag / STEP  # first index: the angle of differentiation
        M_rate = np.einsum("kij,k,j", M_q, rates, rates)
        return np.concatenate(
            [rates, np.linalg.solve(M[0].real, -M_rate + 0.5 * np.einsum("kij,i,j->k", M_q, rates, rates) - V_q)]
        )

    def energy(self, y):
        """Kinetic plus potential energy, shape (n_t,)."""
        q, rates = np.split(y, 2, axis=1)
        M, V = self.mass_matrix_and_potential(q.astype(complex))
        return (0.5 * np.einsum("ni,nij,nj->n", rates, M, rates) + V).real


def start(case):
    """Angles and rates at which the case holds its joints."""
    pairs = np.array([held(case, joint.name) for joint in case.mechanism.joints])
    return pairs.T.ravel()


def trajectory(case, times):
    """Poses p_WB (n_t, n_b, 3) and R_WB (n_t, n_b, 3, 3)."""
    chain = Chain(case.mechanism)
    y = integrate(chain.rhs, start(case), times)
    poses = [
        (R @ b.drawing.p + t, R @ b.drawing.R)
        for (R, t), b in zip(chain.displacements(y[:, : y.shape[1] // 2]), chain.bodies, strict=True)
    ]
    return np.stack([p for p, _ in poses], axis=1), np.stack([R for _, R in poses], axis=1)
