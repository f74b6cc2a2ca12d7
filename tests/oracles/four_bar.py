"""Four-bar linkage: loop closure by intersection of two circles, then one equation of motion for the crank."""

import numpy as np

from oracles.one_freedom import Motion, OneFreedom
from oracles.planar import Plane, components


def linkage(case):
    """The linkage of a case with joints crank_pivot A, crank_pin B, rocker_pin C, rocker_pivot D."""
    plane = Plane(case.mechanism, "crank_pivot")
    A, B0, C0, D = (plane.pin(name) for name in ("crank_pivot", "crank_pin", "rocker_pin", "rocker_pivot"))
    coupler, rocker = C0 - B0, C0 - D
    branch = np.sign((coupler * np.conj(D - B0)).imag)

    def motions(q):
        crank = (B0 - A) * np.exp(1j * q)
        B = A + crank
        # C = B + z (D - B); |C - B| and |C - D| are the lengths of coupler and rocker
        f2 = abs(D - B) ** 2
        along = (abs(coupler) ** 2 - abs(rocker) ** 2 + f2) / (2 * f2)
        z = along + 1j * branch * np.sqrt(abs(coupler) ** 2 / f2 - along**2)
        r, s = z * (D - B), (z - 1) * (D - B)
        # first and second derivative of B + r = D + s
        B_q, B_qq = 1j * crank, -crank
        b_q, c_q = components(1j * r, -1j * s, -B_q)
        b_qq, c_qq = components(1j * r, -1j * s, -B_qq + r * b_q**2 - s * c_q**2)
        one = np.ones_like(q)
        return [
            Motion(A, A, 0.0, 0.0, crank / (B0 - A), one, 0.0 * one),
            Motion(B0, B, B_q, B_qq, r / coupler, b_q, b_qq),
            Motion(D, D, 0.0, 0.0, s / rocker, c_q, c_qq),
        ]

    return OneFreedom(plane, motions)


def trajectory(case, times):
    """Poses p_WB (n_t, 3, 3) and R_WB (n_t, 3, 3, 3) of crank, coupler, rocker."""
    return linkage(case).trajectory(case, "crank_pivot", times)
