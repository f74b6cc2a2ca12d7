"""Rigid body without torque: symmetric [Kane, Likins & Levinson 1983] and asymmetric [Landau & Lifshitz, section 37].

Asymmetric body: in principal axes with moments I1, I2, I3, either increasing or decreasing, so that ``L^2 - 2 T I2``
has the sign of ``I3 - I2``, the angular velocity is ``w = (A1 cn, A2 sn, A3 dn)`` of ``p t + u0``. The third axis is
the polar axis of Euler angles about the constant angular momentum; the azimuth has the rate
``L (I1 w1^2 + I2 w2^2) / (I1^2 w1^2 + I2^2 w2^2)``, whose integral is an elliptic one of the third kind.
"""

import numpy as np
from scipy.special import ellipkinc

from oracles.closed_forms.pendulum import amplitude
from oracles.rotating_end_pendulum import incomplete_third


def symmetric(transverse, axial, w0, times):
    """Quaternions (n_t, 4) relative to time zero and angular velocities (n_t, 3), body axes; z is the symmetry axis."""
    t = np.asarray(times, dtype=float)
    wx, wy, wz = w0
    s = (1 - axial / transverse) * wz
    q = axial * wz / transverse
    p = np.sqrt(wx**2 + wy**2 + q**2)
    c, n = np.cos(s * t), np.sin(s * t)
    w = np.column_stack([wx * c + wy * n, -wx * n + wy * c, np.full_like(t, wz)])
    c, n, cp, sp = np.cos(s * t / 2), np.sin(s * t / 2), np.cos(p * t / 2), np.sin(p * t / 2) / p
    quats = [cp * c - q * sp * n, sp * (wx * c + wy * n), sp * (wy * c - wx * n), q * sp * c + cp * n]
    return np.column_stack(quats), w


def _order(moments, w):
    """Right-handed principal axes (columns) with monotonic I1, I2, I3, rotation about the third axis, and w3 > 0."""
    momentum2, energy2 = np.sum((moments * w) ** 2), np.sum(moments * w**2)
    axes = np.eye(3)[:, np.argsort(moments)]
    if momentum2 < energy2 * np.sort(moments)[1]:
        axes = axes[:, ::-1]
    axes = axes * np.array([1.0, np.linalg.det(axes), 1.0])
    return axes if axes[:, 2] @ w > 0 else axes * np.array([-1.0, 1.0, -1.0])


class Asymmetric:
    """Torque-free body of three different principal moments about its centre of mass.

    Parameters
    ----------
    moments : array_like, shape (3,), kg m^2
        In the order of the body axes, which are principal ones.
    w : array_like, shape (3,), rad/s
        Angular velocity at time zero in body axes.
    """

    def __init__(self, moments, w):
        moments, w = np.asarray(moments, dtype=float), np.asarray(w, dtype=float)
        self.axes = _order(moments, w)
        I1, I2, I3 = self.I = self.axes.T**2 @ moments
        w1, w2, _ = w = self.axes.T @ w
        self.L = float(np.sqrt(np.sum((self.I * w) ** 2)))
        # 2 T I3 - L^2 and L^2 - 2 T I1, written as sums to avoid cancellation
        low = I2 * (I3 - I2) * w2**2 + I1 * (I3 - I1) * w1**2  # 2 T I3 - L^2
        high = I2 * (I2 - I1) * w2**2 + I3 * (I3 - I1) * w[2] ** 2  # L^2 - 2 T I1
        A1, A3 = np.sqrt(low / (I1 * (I3 - I1))), np.sqrt(high / (I3 * (I3 - I1)))
        self.p = np.sqrt((I3 - I2) * high / (I1 * I2 * I3))
        self.m = (I2 - I1) * low / ((I3 - I2) * high)
        self.A = np.array([A1, I1 * A1 * self.p / ((I3 - I2) * A3), A3])
        self.u0 = ellipkinc(np.arctan2(w2 / self.A[1], w1 / A1), self.m)
        self.w0 = w

    def _at(self, times):
        am, sn, cn, dn = amplitude(self.p * np.asarray(times, dtype=float) + self.u0, self.m)
        return am, np.column_stack([self.A[0] * cn, self.A[1] * sn, self.A[2] * dn])

    def rates(self, times):
        """Angular velocities in body axes, shape (n_t, 3)."""
        return self._at(times)[1] @ self.axes.T

    def _azimuth(self, am):
        """Azimuth about the angular momentum as a function of the amplitude."""
        (a, b, _), (I1, I2, _) = self.A**2, self.I
        # integral of (c0 + c1 s^2) / (d0 + d1 s^2), s = sn
        c0, c1, d0, d1 = I1 * a, I2 * b - I1 * a, I1**2 * a, I2**2 * b - I1**2 * a
        whole = c1 / d1
        third = incomplete_third(-d1 / d0, am, self.m)
        return self.L / self.p * (whole * ellipkinc(am, self.m) + (c0 / d0 - whole) * third)

    def _frames(self, am, w):
        """Rotations of the principal axes relative to a frame with its third axis along the angular momentum."""
        l = self.I * w / self.L  # direction of the angular momentum in body axes
        azimuth = self._azimuth(am)
        flat = np.hypot(l[:, 0], l[:, 1])
        # rows: body components of the horizontal e3 x l, of l x (e3 x l), of l
        e1 = np.column_stack([-l[:, 1], l[:, 0], np.zeros(len(l))]) / flat[:, None]
        rows = np.stack([e1, np.cross(l, e1), l], axis=1)
        c, s, zero = np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)
        about = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1], axis=-1).reshape(-1, 3, 3)
        return about @ rows

    def orientations(self, times):
        """Rotations R (n_t, 3, 3): they take components in body axes to components in the body axes of time zero."""
        am, w = self._at(times)
        start = self._frames(*self._at(np.zeros(1)))[0]
        return self.axes @ start.T @ self._frames(am, w) @ self.axes.T
