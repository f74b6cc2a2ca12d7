"""Stiff flyball governor: problem A05 of the IFToMM library.

By symmetry three coordinates: slider height s, angle beta of both rods below the horizontal, and angle of the shaft,
whose angular momentum ``Iz(beta) omega`` is constant. With l the length of the springs and ``f = k (l - l0) + c l'``:
``ms s'' = -ms g - 2 f l_s``, ``2 Ih beta'' = Iz_beta omega^2 / 2 + 2 g cos(beta) (mr / 2 + mt) - 2 f l_beta``.
"""

from math import cos, hypot, sin

import numpy as np

from consilience.mechanism import GROUND, Spring
from oracles.benchmarks.build import X, Y, Z, body, mechanism, placed
from oracles.integrate import integrate

G, K, C, FREE = 9.81, 8e5, 4e4, 0.5
SHAFT = ROD = 0.3
SLIDER, TIP = 3.0, 5.0
ACROSS, ALONG = 0.3 * (1 + 1e-4) / 12, 0.3 * 2e-4 / 12
CUBE = 3.0 * 0.02 / 12
START = (0.5, 0.0, np.pi / 6, 0.0, 2 * np.pi)


def _rod(name, side):
    """A rod and the point mass at its tip as one body, and the midpoint of the rod."""
    e = np.array([side * np.cos(np.pi / 6), 0.0, -np.sin(np.pi / 6)])
    hinge = np.array([side * 0.05, 0.0, 1.0])
    com = hinge + (ROD * 0.5 + TIP) / (ROD + TIP) * e
    moment = ACROSS + ROD * TIP / (ROD + TIP) * 0.5**2
    inertia = moment * np.eye(3) - (moment - ALONG) * np.outer(e, e)
    return body(name, ROD + TIP, com, inertia), hinge, hinge + 0.5 * e


def governor():
    """The mechanism and its initial state."""
    shaft = body("shaft", SHAFT, 0.5 * Z, (ACROSS, ACROSS, ALONG))
    slider = body("slider", SLIDER, 0.5 * Z, 3 * (CUBE,))
    bodies, springs = [shaft, slider], []
    joints = [
        ("bearing", "revolute", GROUND, "shaft", np.zeros(3), Z),
        ("slide", "prismatic", "shaft", "slider", 0.5 * Z, Z),
    ]
    for name, side in (("right", 1.0), ("left", -1.0)):
        rod, hinge, middle = _rod(name, side)
        bodies.append(rod)
        joints.append((f"hinge_{name}", "revolute", "shaft", name, hinge, Y))
        springs.append(Spring(f"k_{name}", "slider", name, side * 0.05 * X, middle - rod.drawing.p, K, C, FREE))
    plain = mechanism("governor", -G * Z, bodies, joints, springs=tuple(springs))
    spin = START[4] * Z
    return plain, placed(plain, {b.name: (np.cross(spin, b.drawing.p), spin) for b in bodies})


def solve(times):
    """s, s', beta, beta', omega at `times`, shape (n_t, 5)."""
    Ih = ACROSS + ROD * 0.25 + TIP

    def Iz(c, s):
        """Moment of inertia about the shaft from cosine and sine of beta, and its derivative with respect to beta."""
        each = ROD * (0.05 + 0.5 * c) ** 2 + ACROSS * c * c + ALONG * s * s + TIP * (0.05 + c) ** 2
        value = ALONG + CUBE + 2 * each
        slope = -2 * s * (ROD * (0.05 + 0.5 * c) + 2 * (ACROSS - ALONG) * c + 2 * TIP * (0.05 + c))
        return value, slope

    momentum = Iz(cos(START[2]), sin(START[2]))[0] * START[4]

    def rhs(y):
        s, v, beta, rate = y.tolist()
        C_b, S_b = cos(beta), sin(beta)
        x, z = 0.5 * C_b, 1 - 0.5 * S_b - s
        l = hypot(x, z)
        l_s, l_beta = -z / l, (-x * S_b - z * C_b) / (2 * l)
        f = K * (l - FREE) + C * (l_s * v + l_beta * rate)
        value, slope = Iz(C_b, S_b)
        moment = slope * (momentum / value) ** 2 / 2 + 2 * G * C_b * (ROD / 2 + TIP) - 2 * f * l_beta
        return np.array([v, -G - 2 * f * l_s / SLIDER, rate, moment / (2 * Ih)])

    y = integrate(rhs, START[:4], times)
    return np.column_stack([y, momentum / Iz(np.cos(y[:, 2]), np.sin(y[:, 2]))[0]])
