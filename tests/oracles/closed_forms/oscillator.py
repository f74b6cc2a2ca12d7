"""Damped oscillator ``m x'' + c x' + k x = 0`` about its rest position: under-, over- and critically damped."""

import numpy as np


def oscillator(mass, damping, stiffness, start, rate, times):
    """x and x' at `times`, each shape (n_t,), from ``x(0) = start``, ``x'(0) = rate``."""
    t = np.asarray(times, dtype=float)
    d, square = damping / (2 * mass), stiffness / mass - (damping / (2 * mass)) ** 2
    if square > 0:
        w = np.sqrt(square)
        c, s = np.cos(w * t), np.sin(w * t) / w
    elif square < 0:
        w = np.sqrt(-square)
        c, s = np.cosh(w * t), np.sinh(w * t) / w
    else:
        c, s = np.ones_like(t), t
    decay = np.exp(-d * t)
    x = decay * (start * c + (rate + d * start) * s)
    # derivatives: c' = -square s, s' = c
    return x, decay * (rate * c - (d * rate + (d * d + square) * start) * s)
