"""Slider-crank: loop closure by intersection of a circle with the slide's line, then one equation for the crank."""

import numpy as np

from oracles.one_freedom import Motion, OneFreedom
from oracles.planar import Plane, components, drawn_frame


def linkage(case):
    """The linkage of a case with joints crank_pivot A, crank_pin B, wrist_pin C and slide."""
    plane = Plane(case.mechanism, "crank_pivot")
    A, B0, C0 = (plane.pin(name) for name in ("crank_pivot", "crank_pin", "wrist_pin"))
    slide = case.mechanism.joints[case.mechanism.joint_index["slide"]]
    u = plane.flat(drawn_frame(case.mechanism, slide)[1][:, 2])
    rod = C0 - B0
    branch = np.sign((rod * np.conj(u)).real)

    def motions(q):
        crank = (B0 - A) * np.exp(1j * q)
        B = A + crank
        # C = C0 + s u; |C - B| is the length of the rod
        to_B = (B - C0) * np.conj(u)
        s = to_B.real + branch * np.sqrt(abs(rod) ** 2 - to_B.imag**2)
        C = C0 + s * u
        r = C - B
        # first and second derivative of B + r = C0 + s u
        B_q, B_qq = 1j * crank, -crank
        b_q, s_q = components(1j * r, -u, -B_q)
        b_qq, s_qq = components(1j * r, -u, -B_qq + r * b_q**2)
        one = np.ones_like(q)
        return [
            Motion(A, A, 0.0, 0.0, crank / (B0 - A), one, 0.0 * one),
            Motion(B0, B, B_q, B_qq, r / rod, b_q, b_qq),
            Motion(C0, C, s_q * u, s_qq * u, one + 0j, 0.0 * one, 0.0 * one),
        ]

    return OneFreedom(plane, motions)


def trajectory(case, times):
    """Poses p_WB (n_t, 3, 3) and R_WB (n_t, 3, 3, 3) of crank, rod, slider."""
    return linkage(case).trajectory(case, "crank_pivot", times)
