"""Planar mechanisms of one degree of freedom: one equation of motion in the crank angle.

With every position a function of the angle ``q``, Lagrange's equation is ``J q'' + h q'^2 = Q``: ``J`` is the effective
moment of inertia ``sum m c_q.c_q + I a_q^2``, ``h = J_q / 2`` and ``Q = sum m g.c_q``, where ``c`` are the centres of
mass, ``a`` the angles of the bodies, and the index is the derivative with respect to ``q``.
"""

from dataclasses import dataclass

import numpy as np

from oracles.integrate import integrate
from oracles.planar import dot, held


@dataclass(frozen=True)
class Motion:
    """One body as a function of the crank angle: position of one of its points, rotation, and two derivatives of each.

    Attributes
    ----------
    drawn : complex
        Position of the point in the drawing.
    anchor, anchor_q, anchor_qq : complex ndarray
        Position of the point, and derivatives.
    turn : complex ndarray
        ``exp(i a)``, ``a`` the angle relative to the drawing.
    a_q, a_qq : ndarray
    """

    drawn: complex
    anchor: np.ndarray
    anchor_q: np.ndarray
    anchor_qq: np.ndarray
    turn: np.ndarray
    a_q: np.ndarray
    a_qq: np.ndarray

    def com_derivatives(self, body):
        """First and second derivative of the centre of mass with respect to q."""
        arm = self.turn * (body.com - self.drawn)
        return self.anchor_q + 1j * self.a_q * arm, self.anchor_qq + (1j * self.a_qq - self.a_q**2) * arm


class OneFreedom:
    """A planar loop; `motions(q)` closes the loop and gives the `Motion` of each body."""

    def __init__(self, plane, motions):
        self.plane = plane
        self.motions = motions
        self.bodies = list(plane.bodies())

    def coefficients(self, q):
        """Coefficients J, h and Q."""
        J = h = Q = 0.0
        for body, motion in zip(self.bodies, self.motions(q), strict=True):
            c_q, c_qq = motion.com_derivatives(body)
            J = J + body.mass * dot(c_q, c_q) + body.inertia * motion.a_q**2
            h = h + body.mass * dot(c_q, c_qq) + body.inertia * motion.a_q * motion.a_qq
            Q = Q + body.mass * dot(self.plane.gravity, c_q)
        return J, h, Q

    def solve(self, start, times):
        """Angle and rate of the crank at `times`, shape (n_t, 2)."""

        def rhs(y):
            J, h, Q = self.coefficients(y[0])
            return np.array([y[1], (Q - h * y[1] ** 2) / J])

        return integrate(rhs, start, times, longest=0.004)

    def energy(self, y):
        """Kinetic and potential energy; the potential is zero at the world's origin."""
        J, _, _ = self.coefficients(y[:, 0])
        height = 0.0
        for body, motion in zip(self.bodies, self.motions(y[:, 0]), strict=True):
            c = motion.anchor + motion.turn * (body.com - motion.drawn)
            height = height - body.mass * dot(self.plane.gravity, c)
        return 0.5 * J * y[:, 1] ** 2, height

    def trajectory(self, case, crank, times):
        """World poses of all bodies; `crank` names the joint whose angle is ``q``."""
        q = self.solve(held(case, crank), times)[:, 0]
        poses = [
            self.plane.place(n, motion.drawn, np.broadcast_to(motion.anchor, q.shape), motion.turn)
            for n, motion in enumerate(self.motions(q))
        ]
        return np.stack([p for p, _ in poses], axis=1), np.stack([R for _, R in poses], axis=1)
