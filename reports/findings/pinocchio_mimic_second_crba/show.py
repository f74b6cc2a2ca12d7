"""Pinocchio: crba on a model with a mimic joint is right once per Data.

A chain of three hinges, the second mimics the first, the third hangs on the second. The mass matrix is G' M G, with M
of the model without the mimic. The first call on fresh Data gives it; every further call with the same Data, model and
configuration adds to what is left in Data.Fcrb. That is the local convention, the default; the world convention is
right. Second route: the columns of rnea, on one Data throughout, and the world convention.
"""

import sys

import numpy as np
import pinocchio as pin

RATIO = -2.0
model, joint = pin.Model(), 0
for n in range(3):
    joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([1.0, 0.2 * n, 0.0])), f"j{n}")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.3, 0.1, 0.2]), np.eye(3)), pin.SE3.Identity())
geared = pin.transformJointIntoMimic(model, 1, 2, RATIO, 0.0)
G = np.array([[1.0, 0.0], [RATIO, 0.0], [0.0, 1.0]])
q = np.array([0.1, 0.2])
expected = G.T @ np.array(pin.crba(model, model.createData(), G @ q)) @ G


def by_rnea(data):
    """Mass matrix by columns of inverse dynamics."""
    zero = np.zeros(geared.nv)
    bias = np.array(pin.rnea(geared, data, q, zero, zero))
    return np.array([np.array(pin.rnea(geared, data, q, zero, e)) - bias for e in np.eye(geared.nv)]).T


def calls(data, *convention):
    """Errors of four calls with the same Data."""
    return [np.max(np.abs(np.array(pin.crba(geared, data, q, *convention)) - expected)) for _ in range(4)]


print(f"pin {pin.__version__}: error of the mass matrix in four calls with one Data, expected about 1e-15")
errors = {
    "crba, default": calls(geared.createData()),
    "crba, local convention": calls(geared.createData(), pin.Convention.LOCAL),
    "crba, world convention": calls(geared.createData(), pin.Convention.WORLD),
}
data = geared.createData()
errors["columns of rnea"] = [np.max(np.abs(by_rnea(data) - expected)) for _ in range(4)]
for name, values in errors.items():
    print(f"{name:23s}", " ".join(f"{value:.1e}" for value in values))
shown = all(errors[name][0] < 1e-12 and min(errors[name][1:]) > 0.1 for name in list(errors)[:2])
shown = shown and all(max(errors[name]) < 1e-12 for name in list(errors)[2:])
print("the second call is wrong" if shown else "all calls are right")
sys.exit(0 if shown else 1)
