"""Pendulum released at rest from any amplitude: Jacobi elliptic functions [Landau & Lifshitz, Mechanics, section 11].

With ``phi`` from hanging, ``k = sin(amplitude / 2)`` and ``w = sqrt(g / L)``: ``sin(phi / 2) = k sn(K + w t)``, so
``cos(phi / 2) = dn(K + w t)`` and ``phi' = 2 k w cn(K + w t)``.
"""

import numpy as np
from scipy.special import ellipj, ellipk

from oracles.planar import drawn_frame


def swing(amplitude, length, gravity, times):
    """sin(phi), cos(phi) and phi' of a pendulum released at rest at phi = `amplitude`, each shape (n_t,)."""
    k, w = np.sin(amplitude / 2), np.sqrt(gravity / length)
    K = ellipk(k * k)
    # subtract whole periods first: the error of sn grows with its argument
    sn, cn, dn, _ = ellipj(K + np.mod(w * np.asarray(times), 4 * K), k * k)
    return 2 * k * sn * dn, 1 - 2 * (k * sn) ** 2, 2 * k * w * cn


def _about(axis, angles):
    """Rotation matrices about a unit axis, shape (n_t, 3, 3)."""
    x, y, z = axis
    tilde = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    c, s = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    return c * np.eye(3) + s * tilde + (1 - c) * np.outer(axis, axis)


def trajectory(case, times):
    """Poses p_WB (n_t, 1, 3) and R_WB (n_t, 1, 3, 3) of a body at rest on a rod, spinning about a principal axis."""
    body, rod = case.mechanism.bodies[0], case.mechanism.joints[0]
    pivot = drawn_frame(case.mechanism, rod)[0]
    start = case.initial.poses[body.name]
    velocity, spin = (np.asarray(v) for v in case.initial.velocities[body.name])
    assert not np.any(velocity)
    assert not np.any(body.com)
    assert not np.any(rod.M.p)
    assert np.allclose(start.R @ body.inertia @ start.R.T @ spin, spin @ spin * spin * _moment(body, start, spin))
    g = np.linalg.norm(case.mechanism.gravity)
    down = case.mechanism.gravity / g
    arm = start.p - pivot
    side = arm - (arm @ down) * down
    across = side / np.linalg.norm(side)
    amplitude = np.arctan2(arm @ across, arm @ down)
    sine, cosine, _ = swing(amplitude, rod.length, g, times)
    p_WB = pivot + rod.length * (sine[:, None] * across + cosine[:, None] * down)
    rate = np.linalg.norm(spin)
    R_WB = _about(spin / rate if rate else down, rate * np.asarray(times)) @ start.R
    return p_WB[:, None], R_WB[:, None]


def _moment(body, start, spin):
    """Quotient ``(w.I w) / (w.w)^2`` for the spin w; zero without spin."""
    rate2 = spin @ spin
    return float(spin @ start.R @ body.inertia @ start.R.T @ spin) / rate2**2 if rate2 else 0.0
