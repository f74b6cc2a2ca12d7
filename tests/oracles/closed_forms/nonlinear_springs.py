"""Oscillators with a cubic or quadratic part of the spring, by Jacobi's elliptic functions; a rotor that coasts down.

[A. Nayfeh, D. Mook, Nonlinear Oscillations, 1979, sections 2.2 and 3.3; NIST Digital Library of Mathematical Functions,
section 22.19]
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk


def cubic(mass, k, k2, start, times):
    """x and x' of ``m x'' + k x + k2 x^3 = 0``, each shape (n_t,), from rest at `start`.

    A spring that hardens: ``x = A cn(w t)``. One that softens, within its hills: ``x = A sn(w t + K)``.
    """
    t = np.asarray(times, dtype=float)
    if k2 >= 0.0:
        square = (k + k2 * start**2) / mass
        w, p = np.sqrt(square), k2 * start**2 / (2.0 * mass * square)
        sn, cn, dn, _ = ellipj(w * t, p)
        return start * cn, -start * w * sn * dn
    square = (k + 0.5 * k2 * start**2) / mass
    w, p = np.sqrt(square), -0.5 * k2 * start**2 / (mass * square)
    sn, cn, dn, _ = ellipj(w * t + ellipk(p), p)
    return start * sn, start * w * cn * dn


def cubic_period(mass, k, k2, start):
    """Period of a spring that hardens: four quarter periods K over w."""
    square = (k + k2 * start**2) / mass
    return 4.0 * ellipk(k2 * start**2 / (2.0 * mass * square)) / np.sqrt(square)


def quadratic(mass, k, k1, start, times):
    """x and x' of ``m x'' + k x + k1 x^2 = 0``, each shape (n_t,), from rest at the outer turning point `start`.

    ``m x'^2 / 2 = (k1/3) (e1 - x) (x - e2) (x - e3)`` with ``e1 = start`` has ``x = e1 - (e1 - e2) sn^2(w t)``; k1 and
    `start` are positive, and the energy is below the hill.
    """
    t = np.asarray(times, dtype=float)
    b = start + 1.5 * k / k1  # k1 x^3 / 3 + k x^2 / 2 - E = (k1/3) (x - e1) (x^2 + b x + b e1)
    e3, e2 = np.sort(np.roots([1.0, b, b * start]))
    w, p = np.sqrt(k1 * (start - e3) / (6.0 * mass)), (start - e2) / (start - e3)
    sn, cn, dn, _ = ellipj(w * t, p)
    return start - (start - e2) * sn**2, -2.0 * (start - e2) * w * sn * cn * dn


def coasting(moment, damping, start, time):
    """Angle and speed of ``J v' = -(c + c1 v + c2 v^2) v`` from the speed `start` > 0; ``4 c c2 > c1^2``.

    By partial fractions of dt and of v dt over dv.
    """
    c, c1, c2 = damping
    root = np.sqrt(4.0 * c * c2 - c1**2)

    def arc(v):
        return np.arctan((2.0 * c2 * v + c1) / root)

    def clock(v):
        return (np.log(v) - 0.5 * np.log(c + c1 * v + c2 * v**2) - c1 / root * arc(v)) / c

    gone = time / moment
    v = start if gone == 0.0 else brentq(lambda v: clock(start) - clock(v) - gone, start * 1e-9, start, xtol=1e-16)
    return 2.0 * moment / root * (arc(start) - arc(v)), v
