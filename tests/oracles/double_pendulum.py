"""Planar double pendulum: Lagrange's equations in two absolute angles, counted from the drawing."""

from dataclasses import dataclass

import numpy as np

from oracles.integrate import integrate
from oracles.planar import Plane, dot, held


@dataclass(frozen=True)
class DoublePendulum:
    """Constants of the pendulum; vectors in the plane are complex numbers at zero angles.

    Attributes
    ----------
    arm_1, arm_2 : complex
        From the joint of each body to its centre of mass.
    link : complex
        From the first joint to the second.
    """

    mass_1: float
    mass_2: float
    inertia_1: float
    inertia_2: float
    arm_1: complex
    arm_2: complex
    link: complex
    gravity: complex

    def rhs(self, y):
        """Derivative of (angle 1, angle 2, rate 1, rate 2); angles are absolute."""
        turn_1, turn_2 = np.exp(1j * y[0]), np.exp(1j * y[1])
        z = self.mass_2 * self.link * turn_1 * np.conj(self.arm_2 * turn_2)
        A = self.inertia_1 + self.mass_1 * abs(self.arm_1) ** 2 + self.mass_2 * abs(self.link) ** 2
        B = self.inertia_2 + self.mass_2 * abs(self.arm_2) ** 2
        Q1 = dot(self.gravity, 1j * turn_1 * (self.mass_1 * self.arm_1 + self.mass_2 * self.link))
        Q2 = dot(self.gravity, 1j * turn_2 * self.mass_2 * self.arm_2)
        r1, r2 = Q1 - z.imag * y[3] ** 2, Q2 + z.imag * y[2] ** 2
        determinant = A * B - z.real**2
        return np.array([y[2], y[3], (B * r1 - z.real * r2) / determinant, (A * r2 - z.real * r1) / determinant])

    def solve(self, start, times):
        """Absolute angles and their rates at `times`, shape (n_t, 4)."""
        return integrate(self.rhs, start, times)

    def energy(self, y):
        """Kinetic plus potential energy; the potential is zero at the first joint."""
        turn_1, turn_2 = np.exp(1j * y[:, 0]), np.exp(1j * y[:, 1])
        v1 = 1j * self.arm_1 * turn_1 * y[:, 2]
        v2 = 1j * self.link * turn_1 * y[:, 2] + 1j * self.arm_2 * turn_2 * y[:, 3]
        kinetic = self.mass_1 * abs(v1) ** 2 + self.mass_2 * abs(v2) ** 2
        kinetic = kinetic + self.inertia_1 * y[:, 2] ** 2 + self.inertia_2 * y[:, 3] ** 2
        fall_1 = dot(self.gravity, self.arm_1 * turn_1)
        fall_2 = dot(self.gravity, self.link * turn_1 + self.arm_2 * turn_2)
        return 0.5 * kinetic - self.mass_1 * fall_1 - self.mass_2 * fall_2


def pendulum(case):
    """Constants and initial state of a case with the joints shoulder and elbow."""
    plane = Plane(case.mechanism, "shoulder")
    A, B = plane.pin("shoulder"), plane.pin("elbow")
    one, two = plane.bodies()
    constants = DoublePendulum(
        one.mass, two.mass, one.inertia, two.inertia, one.com - A, two.com - B, B - A, plane.gravity
    )
    (q1, r1), (q2, r2) = held(case, "shoulder"), held(case, "elbow")
    return constants, np.array([q1, q1 + q2, r1, r1 + r2])


def trajectory(case, times):
    """Poses p_WB (n_t, 2, 3) and R_WB (n_t, 2, 3, 3)."""
    plane = Plane(case.mechanism, "shoulder")
    A, B = plane.pin("shoulder"), plane.pin("elbow")
    constants, start = pendulum(case)
    y = constants.solve(start, times)
    turn_1, turn_2 = np.exp(1j * y[:, 0]), np.exp(1j * y[:, 1])
    p1, R1 = plane.place(0, A, np.full(len(y), A), turn_1)
    p2, R2 = plane.place(1, B, A + constants.link * turn_1, turn_2)
    return np.stack([p1, p2], axis=1), np.stack([R1, R2], axis=1)
