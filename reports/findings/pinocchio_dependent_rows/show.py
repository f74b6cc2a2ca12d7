"""Pinocchio: forwardDynamics with dependent constraint rows and no damping is wrong, without an error.

A planar chain of four links whose end is welded: six rows of rank three. The acceleration is unique: on the null space
N of the rows, N^T M N y = -N^T b. Second route: the constraint itself, J a = 0, and the same call with a damping of
1e-12, which is right.
"""

import sys

import numpy as np
import pinocchio as pin

model = pin.Model()
model.gravity = pin.Motion(np.array([0.0, -9.81, 0.0]), np.zeros(3))
for i in range(4):
    placement = pin.SE3(np.eye(3), np.array([0.5 if i else 0.0, 0.0, 0.0]))
    joint = model.addJoint(i, pin.JointModelRZ(), placement, str(i))
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.25, 0, 0]), 0.1 * np.eye(3)), pin.SE3.Identity())
data = model.createData()
zero = np.zeros(4)


def compare(seed):
    """Relative errors without and with damping, and |J a| without, at a drawn pose and in drawn axes of the rows."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.0, 2.0, 4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pin.computeJointJacobians(model, data, q)
    J = np.kron(np.eye(2), turn) @ pin.getJointJacobian(model, data, 4, pin.LOCAL_WORLD_ALIGNED)
    M, b = pin.crba(model, data, q).copy(), pin.nle(model, data, q, zero).copy()
    N = np.linalg.svd(J)[2][3:].T
    expected = N @ np.linalg.solve(N.T @ M @ N, -N.T @ b)
    plain, damped = (pin.forwardDynamics(model, data, q, zero, zero, J, np.zeros(6), d).copy() for d in (0.0, 1e-12))
    scale = np.max(np.abs(expected))
    return [np.max(np.abs(a - expected)) / scale for a in (plain, damped)] + [np.max(np.abs(J @ plain))]


errors = np.array([compare(seed) for seed in range(200)])
bad = np.sum(errors[:, 0] > 1e-2)
print(f"pin {pin.__version__}: six rows of rank three, 200 poses, relative error of the accelerations, expected 0")
print(f"no damping     worst {errors[:, 0].max():.1e}, above 1e-2 in {bad} poses, worst |J a| {errors[:, 2].max():.1e}")
print(f"damping 1e-12  worst {errors[:, 1].max():.1e}")
shown = bad > 0 and errors[:, 2].max() > 1e-2 and errors[:, 1].max() < 1e-6 and np.all(np.isfinite(errors))
print("wrong and finite" if shown else "right, or not a number")
sys.exit(0 if shown else 1)
