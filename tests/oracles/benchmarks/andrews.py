"""Andrews' squeezer: a planar mechanism of seven bodies and a motor [Schiehlen 1990; Hairer & Wanner 1996, VII.7].

Angles beta, theta, gamma, phi, delta, Omega, epsilon, ``e(a) = (cos a, sin a)``, ``n(a) = (sin a, -cos a)``:
F = rr e(beta), E = F - d e(beta + theta) = B + ss n(gamma) = A + zt e(delta) + e n(phi + delta)
= A + u n(epsilon) + zf e(Omega + epsilon), G = A + zt e(delta), H = A + u n(epsilon).

Moments of inertia about axes in the plane have no effect on a planar motion; they are set to the one about the normal.
"""

import numpy as np

from consilience.mechanism import GROUND, Load, Spring
from oracles.benchmarks.build import Z, body, mechanism

MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
MOMENTS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
A, B, C = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), np.array([0.014, 0.072])
START = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)
PINS = {
    "O": (GROUND, "1"),
    "F": ("1", "2"),
    "E3": ("2", "3"),
    "E4": ("2", "4"),
    "E6": ("2", "6"),
    "B": (GROUND, "3"),
    "A5": (GROUND, "5"),
    "A7": (GROUND, "7"),
    "G": ("5", "4"),
    "H": ("7", "6"),
}


def points(q):
    """Centres of mass "1" to "7", pins, and the end D of the spring, as vectors in the plane."""
    beta, theta, gamma, phi, delta, Omega, epsilon = q

    def e(a):
        return np.array([np.cos(a), np.sin(a)])

    def n(a):
        return np.array([np.sin(a), -np.cos(a)])

    F, G, H = 0.007 * e(beta), A + 0.04 * e(delta), A + 0.04 * n(epsilon)
    E = F - 0.028 * e(beta + theta)
    return {
        "1": 0.00092 * e(beta),
        "2": F - 0.0115 * e(beta + theta),
        "3": B + 0.01874 * n(gamma) + 0.01043 * e(gamma),
        "4": G + (0.02 - 0.01421) * n(phi + delta),
        "5": A + 0.02308 * e(delta) - 0.00916 * n(delta),
        "6": H + (0.02 - 0.01421) * e(Omega + epsilon),
        "7": A + 0.01228 * n(epsilon) - 0.00449 * e(epsilon),
        "O": np.zeros(2),
        "D": B + 0.02 * e(gamma) + 0.018 * n(gamma),
        **{name: E for name in ("E3", "E4", "E6")},
        **{"F": F, "G": G, "H": H, "B": B, "A5": A, "A7": A},
    }


def squeezer():
    """The mechanism, drawn in its initial pose."""
    at = {name: np.append(p, 0.0) for name, p in points(START).items()}
    bodies = [body(str(i + 1), MASSES[i], at[str(i + 1)], 3 * [MOMENTS[i]]) for i in range(7)]
    joints = [(name, "revolute", *pair, at[name], Z) for name, pair in PINS.items()]
    spring = Spring("c", GROUND, "3", np.append(C, 0.0), at["D"] - at["3"], 4530.0, 0.0, 0.07785)
    motor = Load("motor", "torque", "1", 0.033 * Z, "world")
    return mechanism("squeezer", np.zeros(3), bodies, joints, springs=(spring,), loads=(motor,))


# the seven angles and their rates are linear combinations of the rotation angles of bodies 1 to 7
COMBINE = np.array(
    [
        [1, 0, 0, 0, 0, 0, 0],
        [-1, 1, 0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 0, 0],
        [0, 0, 0, 1, -1, 0, 0],
        [0, 0, 0, 0, 1, 0, 0],
        [0, 0, 0, 0, 0, 1, -1],
        [0, 0, 0, 0, 0, 0, 1],
    ]
)


def angles(motion):
    """The seven angles, modulo a full turn, and their rates, each shape (n_t, 7)."""
    turns = np.array([np.arctan2(motion.turn(str(i))[:, 1, 0], motion.turn(str(i))[:, 0, 0]) for i in range(1, 8)])
    return np.array(START) + turns.T @ COMBINE.T, motion.w[:, :, 2] @ COMBINE.T
