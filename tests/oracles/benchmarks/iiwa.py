"""Seven-axis arm: the KUKA LBR iiwa of a benchmark of Drake, and its inverse dynamics by Newton and Euler's laws."""

import numpy as np

from consilience.mechanism import GROUND, Body, Frame, Joint, Mechanism, elementary_rotation
from oracles.benchmarks.build import Z

MASSES = (5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2)
COMS = np.array(
    [
        (0, -0.03, 0.12),
        (0.0003, 0.059, 0.042),
        (0, 0.03, 0.13),
        (0, 0.067, 0.034),
        (0.0001, 0.021, 0.076),
        (0, 0.0006, 0.0004),
        (0, 0, 0.02),
    ]
)
INERTIAS = np.array(
    [
        (0.033, 0.0333, 0.0123),
        (0.0305, 0.0304, 0.011),
        (0.025, 0.0238, 0.0076),
        (0.017, 0.0164, 0.006),
        (0.01, 0.0087, 0.00449),
        (0.0049, 0.0047, 0.0036),
        (0.001, 0.001, 0.001),
    ]
)
# rotation in the parent in quarter turns about x, y, z (roll, pitch, yaw), and origin in the parent
JOINTS = (
    ((0, 0, 0), (0, 0, 0.1575)),
    ((1, 0, 2), (0, 0, 0.2025)),
    ((1, 0, 2), (0, 0.2045, 0)),
    ((1, 0, 0), (0, 0, 0.2155)),
    ((-1, 2, 0), (0, 0.1845, 0)),
    ((1, 0, 0), (0, 0, 0.2155)),
    ((-1, 2, 0), (0, 0.081, 0)),
)


def _frame(quarters, origin):
    roll, pitch, yaw = (elementary_rotation(k, np.pi / 2 * n) for k, n in enumerate(quarters))
    return Frame(origin, np.round(yaw @ pitch @ roll))


def arm(gravity):
    """The mechanism, drawn with all angles zero; `gravity` along -z."""
    frames = [_frame(*j) for j in JOINTS]
    bodies, joints, p, R = [], [], np.zeros(3), np.eye(3)
    for n, frame in enumerate(frames):
        p, R = p + R @ frame.p, R @ frame.R
        bodies.append(Body(f"link{n + 1}", MASSES[n], COMS[n], np.diag(INERTIAS[n]), Frame(p, R)))
        parent = bodies[n - 1].name if n else GROUND
        joints.append(Joint(f"j{n + 1}", "revolute", parent, f"link{n + 1}", frame, Frame(np.zeros(3), np.eye(3))))
    return Mechanism("iiwa", -gravity * Z, tuple(bodies), tuple(joints))


def torques(q, v, a, gravity):
    """Torques about the joint axes: an outward pass for motions, an inward pass for moments, all in world axes."""
    p, R, w, alpha, acceleration = np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3), gravity * Z
    axes, origins, forces, moments, centres = [], [], [], [], []
    for n, joint in enumerate(JOINTS):
        frame = _frame(*joint)
        arm = R @ frame.p
        acceleration = acceleration + np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))
        p, R = p + arm, R @ frame.R @ elementary_rotation(2, q[n])
        axis = R[:, 2]
        alpha = alpha + a[n] * axis + v[n] * np.cross(w, axis)
        w = w + v[n] * axis
        c = R @ COMS[n]
        inertia = R @ np.diag(INERTIAS[n]) @ R.T
        forces.append(MASSES[n] * (acceleration + np.cross(alpha, c) + np.cross(w, np.cross(w, c))))
        moments.append(inertia @ alpha + np.cross(w, inertia @ w))
        axes.append(axis)
        origins.append(p)
        centres.append(p + c)
    return np.array(
        [
            axes[n] @ sum(moments[i] + np.cross(centres[i] - origins[n], forces[i]) for i in range(n, 7))
            for n in range(7)
        ]
    )
