"""Bricard's mechanism: problem A04 of the IFToMM library. Six revolutes, thirty joint equations of rank 29.

Five rods of 1 m and 1 kg, square section 0.1 m, between the points below; the joint axes at the points are
Y, Z, X, Y, Z, X.
"""

import numpy as np

from consilience.mechanism import GROUND, elementary_rotation
from oracles.benchmarks.build import Y, mechanism, thin_rod
from oracles.benchmarks.reduced import Reduced

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1.0]])
AXES = (1, 2, 0, 1, 2, 0)
AXIAL, TRANSVERSE = 1 / 600, 1.01 / 12


def bricard():
    rods = [thin_rod(f"rod{i + 1}", 1.0, POINTS[i : i + 2], TRANSVERSE, AXIAL) for i in range(5)]
    names = [GROUND, *(r.name for r in rods), GROUND]
    joints = [(f"j{i}", "revolute", names[i], names[i + 1], POINTS[i], np.eye(3)[AXES[i]]) for i in range(6)]
    return mechanism("bricard", -9.81 * Y, rods, joints)


def _chain(angles):
    """Points (6, 3) and rotations (7, 3, 3) of the chain; each joint angle counts from the drawing."""
    p, R, points, rotations = np.zeros(3), np.eye(3), [np.zeros(3)], [np.eye(3)]
    for i, a in enumerate(angles):
        R = R @ elementary_rotation(AXES[i], a)
        rotations.append(R)
        if i < 5:
            p = p + R @ (POINTS[i + 1] - POINTS[i])
            points.append(p)
    return np.array(points), np.array(rotations)


def _close(crank, angles):
    """Angles of all joints at a crank angle, by Newton's method from an initial guess."""
    angles = np.concatenate([[crank], angles[1:]])
    for _ in range(8):
        p, R = _chain(angles)
        turn = R[6]
        tilde = (turn - turn.T) / 2
        error = np.concatenate([p[5] - POINTS[5], [tilde[2, 1], tilde[0, 2], tilde[1, 0]]])
        axes = np.array([R[i + 1][:, AXES[i]] for i in range(6)])
        columns = np.hstack([np.cross(axes, p[5] - p), axes])[1:].T
        angles[1:] -= np.linalg.lstsq(columns, error, rcond=None)[0]
    assert np.max(np.abs(error)) < 1e-14
    return angles


def reduced():
    """The mechanism reduced to its crank angle: from -0.02 to pi + 0.02, about +y from the drawing."""
    state = {"angles": np.zeros(6)}

    def sample(crank):
        start = state["angles"][0]
        for step in np.linspace(start, crank, 2 + int(abs(crank - start) / 0.05))[1:]:
            state["angles"] = _close(step, state["angles"])
        p, R = _chain(state["angles"])
        along = [np.argmax(np.abs(POINTS[i + 1] - POINTS[i])) for i in range(5)]
        # axes of each rod, its longitudinal axis first
        turned = np.array([np.roll(R[i + 1], -along[i], axis=1) for i in range(5)])
        return (p[1:] + p[:-1]) / 2, turned

    inertias = np.array(5 * [[AXIAL, TRANSVERSE, TRANSVERSE]])
    return Reduced(sample, np.ones(5), inertias, -9.81 * Y, (-0.02, np.pi + 0.02), 60)
