"""One body on a plane with soft convex cones of friction, in steps: the law that MuJoCo documents, solved by itself.

Of each contact that overlaps, by r > 0 and at the rate u, the relative acceleration u' and the force p obey

    p = proj_K(aref - u')/R,      aref = -b u + k d(r) r n,      R = (1 - d)/d A,

with A the inverse mass, and K a circular cone, or the four edges ``n +- mu t`` of a pyramid, which are rows of their
own, with ``R = 2 mu^2 (1 - d)/d A (1 + mu^2)`` (https://mujoco.readthedocs.io/en/stable/computation/index.html,
"Constraint model", "Regularization"). The impedance d rises from 0.9 to 0.95 over 1 mm. Contact points are in the
middle of the overlap. Steps are those of the semi-implicit Euler method, of the centre of mass: a step that turns the
body by an angle at once sets another point of it off by half the square of that angle.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from consilience.mechanism import (
    contact_parts,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_from_quaternion,
    skew,
)

LEAST, MOST, WIDTH, TIME = 0.9, 0.95, 1e-3, 0.02
STIFFNESS, DAMPING = 1.0 / (MOST * TIME) ** 2, 2.0 / (MOST * TIME)
"""1/s^2 and 1/s: of ``solref = (0.02, 1)``, critical damping."""

NEWTON, SOLVED = 60, 1e-12


def impedance(overlap):
    x = np.minimum(overlap / WIDTH, 1.0)
    y = np.where(x <= 0.5, 2.0 * x**2, 1.0 - 2.0 * (1.0 - x) ** 2)
    return LEAST + y * (MOST - LEAST)


def onto_circle(y, mu):
    """Point of the cone ``|t| <= mu n`` nearest to (n, t1, t2), and its derivative."""
    n, t = y[0], np.linalg.norm(y[1:])
    if t <= mu * n:
        return y, np.eye(3)
    if mu * t <= -n:
        return np.zeros(3), np.zeros((3, 3))
    edge, x = np.concatenate([[1.0], mu * y[1:] / t]), (n + mu * t) / (1.0 + mu**2)
    slope = np.outer(edge, edge) / (1.0 + mu**2)
    slope[1:, 1:] += mu * x / t * (np.eye(2) - np.outer(edge[1:], edge[1:]) / mu**2)
    return x * edge, slope


@dataclass(frozen=True)
class SoftContact:
    """Contact of points with a plane at rest, `mechanism.contacts[0]`; first tangent of a pyramid; None: circle."""

    mechanism: object
    tangent: np.ndarray | None = None

    @cached_property
    def plane(self):
        return self.mechanism.contacts[0]

    @cached_property
    def points(self):
        return np.array([part.center for part in contact_parts(self.plane)])

    @cached_property
    def rows(self):
        """Rows of one contact, shape (r, 3), and which of them the overlap pushes."""
        n = np.asarray(self.plane.normal)
        t = np.eye(3)[np.argmin(np.abs(n))] if self.tangent is None else self.tangent
        t1 = t - (t @ n) * n
        t1 = t1 / np.linalg.norm(t1)
        t2 = np.cross(n, t1)
        if self.tangent is None:
            return np.array([n, t1, t2]), np.array([1.0, 0.0, 0.0])
        return np.array([n + s * self.plane.friction * e for e in (t1, t2) for s in (1.0, -1.0)]), np.ones(4)

    def force(self, y):
        """R p of all rows, and its derivative."""
        if self.tangent is not None:
            return np.maximum(y, 0.0), np.diag(1.0 * (y > 0.0))
        slope = np.zeros((len(y), len(y)))
        found = np.zeros(len(y))
        for k in range(0, len(y), 3):
            found[k : k + 3], slope[k : k + 3, k : k + 3] = onto_circle(y[k : k + 3], self.plane.friction)
        return found, slope

    def acceleration(self, inertia, centre, arms, v, w):
        """Accelerations (v', w') of the centre of mass; arms of the points from it, world axes."""
        mass, mu, n = self.mechanism.bodies[0].mass, self.plane.friction, np.asarray(self.plane.normal)
        M = np.block([[mass * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), inertia]])
        free = np.concatenate([self.mechanism.gravity, -np.linalg.solve(inertia, np.cross(w, inertia @ w))])
        overlap = -(centre + arms - self.plane.point) @ n
        low = np.flatnonzero(overlap > 0.0)
        if not len(low):
            return free
        (rows, pushed), d = self.rows, impedance(overlap[low])
        middle = arms[low] + 0.5 * overlap[low, None] * n
        J = np.vstack([np.hstack([rows, -rows @ skew(r)]) for r in middle])
        aref = np.outer(STIFFNESS * d * overlap[low], pushed).ravel() - DAMPING * J @ np.concatenate([v, w])
        R = np.repeat((1.0 - d) / d / mass, len(rows)) * (1.0 if self.tangent is None else 2.0 * mu**2 * (1.0 + mu**2))
        return self._solved(M, J, free, aref, R)

    def _solved(self, M, J, free, aref, R):
        """Newton's method on ``M (a - free) = J^T p(a)``, whose potential is convex."""

        def missed(a):
            p, slope = self.force(aref - J @ a)
            return np.linalg.solve(M, J.T @ (p / R)) - (a - free), slope / R

        a = free
        for _ in range(NEWTON):
            off, slope = missed(a)
            if np.max(np.abs(off)) < SOLVED * (1.0 + np.max(np.abs(aref))):
                break
            step, size = np.linalg.solve(M + J.T @ slope @ J, M @ off), 1.0
            while size > 1e-3 and np.linalg.norm(missed(a + size * step)[0]) >= np.linalg.norm(off):
                size *= 0.5
            a = a + size * step
        return a

    def stop(self, state, end, h):
        """Place of the centre of mass after steps of h."""
        body = self.mechanism.bodies[0]
        p, q, v, w = (part[0] for part in (state.p_WB, state.quat_WB, state.v_WB_W, state.w_WB_W))
        r = rotation_from_quaternion(q) @ body.com
        p, v = p + r, v + np.cross(w, r)
        for _ in range(round(end / h)):
            A = rotation_from_quaternion(q)
            a = self.acceleration(A @ body.inertia @ A.T, p, (self.points - body.com) @ A.T, v, w)
            v, w_B = v + h * a[:3], A.T @ (w + h * a[3:])
            p, q = p + h * v, quaternion_product(q, quaternion_from_rotation_vector(h * w_B))
            q = q / np.linalg.norm(q)
            w = rotation_from_quaternion(q) @ w_B
        return p
