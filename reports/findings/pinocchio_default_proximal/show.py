"""Pinocchio: constraintDynamics with its default proximal settings returns NaN, or wrong numbers, for redundant loops.

A planar four-bar whose last link is welded to the ground frame it meets: six rows of rank three. The accelerations are
unique: at rest, on the null space N of the rows, N^T M N y = -N^T b. Nothing is raised. Second route: the same call
with mu = 1e-6 and 20 iterations is right at every pose.
"""

import sys

import numpy as np
import pinocchio as pin

CRANK, COUPLER, ROCKER, GROUND = 0.5, 1.2, 0.9, 1.1
turn = pin.exp3(np.array([0.3, -0.7, 0.4]))  # a plane in no special position


def four_bar(angle):
    """Joint angles of the closed loop with its crank at `angle`."""
    B = CRANK * np.array([np.cos(angle), np.sin(angle)])
    d = np.array([GROUND, 0.0]) - B
    length = np.hypot(*d)
    q2 = np.arctan2(d[1], d[0]) + np.arccos((COUPLER**2 + length**2 - ROCKER**2) / (2 * COUPLER * length))
    C = B + COUPLER * np.array([np.cos(q2), np.sin(q2)])
    q3 = np.arctan2(-C[1], GROUND - C[0])
    return np.array([angle, q2 - angle, q3 - q2, -q3])


model = pin.Model()
model.gravity = pin.Motion(turn @ np.array([0.0, -9.81, 0.0]), np.zeros(3))
last, placement = 0, pin.SE3(turn, np.zeros(3))
for name, length in (("crank", CRANK), ("coupler", COUPLER), ("rocker", ROCKER), ("base", 0.0)):
    last = model.addJoint(last, pin.JointModelRZ(), placement, name)
    inertia = pin.Inertia(1.0, np.array([length / 2, 0, 0]), np.diag([0.01, 0.1, 0.1]))
    model.appendBodyToJoint(last, inertia, pin.SE3.Identity())
    placement = pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
pivot = pin.SE3(turn, turn @ np.array([GROUND, 0.0, 0.0]))
models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
weld = pin.ContactType.CONTACT_6D
models.append(pin.RigidConstraintModel(weld, model, last, pin.SE3.Identity(), 0, pivot, pin.LOCAL))
datas.append(models[0].createData())
data = model.createData()
pin.initConstraintDynamics(model, data, models, datas)
zero = np.zeros(model.nv)


def expected(q):
    """Joint accelerations at rest, by the null space of the weld."""
    pin.computeJointJacobians(model, data, q)
    N = np.linalg.svd(pin.getJointJacobian(model, data, last, pin.LOCAL))[2][3:].T
    M, b = pin.crba(model, data, q), pin.nle(model, data, q, zero)
    return N @ np.linalg.solve(N.T @ M @ N, -N.T @ b)


def errors(settings):
    """Relative error at each pose; nan where the answer is not a number."""
    found = []
    for angle in np.linspace(0.3, 2.5, 200):
        q = four_bar(angle)
        truth = expected(q)
        a = pin.constraintDynamics(model, data, q, zero, zero, models, datas, settings())
        found.append(np.max(np.abs(a - truth)) / np.max(np.abs(truth)))
    return np.array(found)


default, proximal = errors(pin.ProximalSettings), errors(lambda: pin.ProximalSettings(1e-14, 1e-6, 20))
nan = int(np.sum(np.isnan(default)))
wrong = int(np.sum(default[~np.isnan(default)] > 1e-6))
print(f"pin {pin.__version__}: 200 poses, relative error of the accelerations, expected about 1e-13")
print(
    f"default settings    not a number at {nan} poses, wrong by more than 1e-6 at {wrong}, right at {200 - nan - wrong}"
)
print(f"mu 1e-6, 20 times   worst {np.max(proximal):.1e}")
sys.exit(0 if nan and np.max(proximal) < 1e-9 else 1)
