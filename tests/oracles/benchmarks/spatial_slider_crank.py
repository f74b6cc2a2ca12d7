"""Spatial slider-crank: IFToMM library [Haug 1989, section 12.2].

Crank 0.08 m about x at A, rod 0.3 m, slider on the x axis. A ball joint at B; a universal joint at C with one axis
along x in the slider and the other perpendicular to the rod. The printed inertia of 4e-4 is taken about the rod's own
axis.
"""

import numpy as np
from scipy.optimize import brentq

from consilience.mechanism import GROUND
from oracles.benchmarks.build import X, Z, body, mechanism, started

A = np.array([0.0, 0.1, 0.12])
MASSES = np.array([0.12, 0.5, 2.0])
INERTIAS = np.array([[1e-4, 1e-4, 1e-5], [4e-4, 4e-3, 4e-3], [1e-4, 1e-4, 1e-4]])


def poses(theta):
    """Centres of mass (3, 3) and principal axes (3, 3, 3) of crank, rod and slider."""
    c, s = np.cos(theta), np.sin(theta)
    crank = np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])
    B = A + 0.08 * crank[:, 2]
    C = np.sqrt(0.3**2 - B @ B) * X
    along = (C - B) / 0.3
    square = np.cross(X, along)
    across = square / np.sqrt(square @ square)  # no np.linalg.norm: it takes magnitudes of complex numbers
    rod = np.column_stack([along, across, np.cross(along, across)])
    return np.array([(A + B) / 2, (B + C) / 2, C]), np.array([crank, rod, np.eye(3)])


def slider_crank():
    """The mechanism and its initial state: the crank upright and turning at 6 rad/s."""
    (crank, rod, slider), R = poses(0.0)
    B, C = A + 0.08 * Z, slider
    rows = zip(("crank", "rod", "slider"), MASSES, (crank, rod, slider), INERTIAS, R, strict=True)
    bodies = [body(name, m, c, inertia, R=axes) for name, m, c, inertia, axes in rows]
    universal = np.column_stack([R[1][:, 1], np.cross(X, R[1][:, 1]), X])
    joints = [
        ("pivot", "revolute", GROUND, "crank", A, X),
        ("ball", "spherical", "crank", "rod", B, np.eye(3)),
        ("cross", "universal", "slider", "rod", C, universal),
        ("slide", "prismatic", GROUND, "slider", C, X),
    ]
    plain = mechanism("spatial_slider_crank", -9.81 * Z, bodies, joints)
    return plain, started(plain, {"pivot": 6.0})


def solve(times):
    """Crank angle with full turns counted, and its rate, shape (n_t, 2), from energy: ``theta' = sqrt(2 (E - V) / J)``.

    The crank never stops, so that ``dt / d theta`` is a periodic function of theta; its Fourier series is integrated
    term by term. Derivatives of the poses by theta are complex steps, exact to rounding.
    """

    def energies(theta):
        c, R = poses(theta + 1e-30j)
        c_q, R_q = c.imag / 1e-30, R.imag / 1e-30
        tilde = np.swapaxes(R.real, 1, 2) @ R_q
        w = np.stack([tilde[:, 2, 1], tilde[:, 0, 2], tilde[:, 1, 0]], axis=1)
        J = MASSES @ np.sum(c_q**2, axis=1) + np.sum(INERTIAS * w**2)
        return J, 9.81 * float(MASSES @ c[:, 2].real)

    J, V = energies(0.0)
    E = J * 6.0**2 / 2 + V

    def rate(theta):
        J, V = energies(theta)
        return np.sqrt(2 * (E - V) / J)

    count = 512
    series = np.fft.rfft([1 / rate(2 * np.pi * n / count) for n in range(count)]) / count
    assert abs(series[-1]) < 1e-16 * abs(series[0])
    mean, k = series[0].real, np.arange(1, count // 2)
    waves = series[1:-1] / (1j * k)

    def late(theta, time):
        return mean * theta + 2 * np.sum(waves * (np.exp(1j * k * theta) - 1)).real - time

    turn = 2 * np.pi
    theta = [brentq(late, t / mean - turn, t / mean + turn, args=(t,), xtol=1e-15, rtol=1e-15) for t in times]
    return np.column_stack([theta, [rate(q) for q in theta]])
