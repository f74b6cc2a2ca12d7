"""Pinocchio: an axis given as a vector is not normalised, one given as three numbers is; the first makes wrong physics.

A body of unit moment of inertia about z on JointModelRevoluteUnaligned with the axis (0, 0, 2): its mass matrix is 1
about the unit axis, whatever the length of what was given. Second route: the placement of the joint at q = 0.3 is a
rotation, R R^T = 1. `Model.check` finds nothing.
"""

import sys

import numpy as np
import pinocchio as pin

AXIS, Q = (0.0, 0.0, 2.0), np.array([0.3])


def measure(joint):
    """Mass matrix, departure of the joint's rotation from orthogonality, and the answer of `check`."""
    model = pin.Model()
    index = model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(index, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    data = model.createData()
    mass = float(pin.crba(model, data, Q)[0, 0])
    pin.forwardKinematics(model, data, Q)
    R = data.oMi[index].rotation
    return mass, float(np.max(np.abs(R @ R.T - np.eye(3)))), model.check(data)


print(f"pin {pin.__version__}: axis (0, 0, 2), expected mass matrix 1, R R^T = 1")
vector = measure(pin.JointModelRevoluteUnaligned(np.array(AXIS)))
numbers = measure(pin.JointModelRevoluteUnaligned(*AXIS))
for name, (mass, defect, check) in (("as a vector", vector), ("as three numbers", numbers)):
    print(f"{name:17s} mass matrix {mass:.6f}, |R R^T - 1| {defect:.1e}, check {check}")
shown = abs(vector[0] - 1.0) > 1.0 and vector[1] > 0.1 and vector[2]
shown = shown and abs(numbers[0] - 1.0) < 1e-14 and numbers[1] < 1e-14
print("not normalised, without a word" if shown else "normalised or refused")
sys.exit(0 if shown else 1)
