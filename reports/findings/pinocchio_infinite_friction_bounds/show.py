"""Pinocchio: joint friction between minus and plus infinity gives no force to a negative velocity, as converged.

A force without bounds holds a coordinate: f = -y / G, whatever the sign of y. With G = 1 and y = -1 that is 1. Second
routes: the opposite sign of y; bounds of 1000, which the force does not reach; a point anchor.
"""

import sys

import numpy as np
import pinocchio as pin

MODEL = pin.Model()
MODEL.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
JOINTS = pin.StdVec_Index()
JOINTS.append(1)
PLACE = pin.SE3.Identity()


def friction(bound):
    """Joint friction between minus and plus a bound."""
    return pin.JointFrictionConstraintModel(MODEL, JOINTS, np.array([-bound]), np.array([bound]))


def solve(constraint, y):
    """Force of the last row, and whether the solver says that it has converged."""
    models, data = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    models.append(constraint)
    data.append(models[0].createData())
    result = pin.ADMMSolverResult()
    operator = pin.DelassusOperatorDense(np.eye(len(y)))
    said = pin.ADMMConstraintSolver().solve(operator, np.array(y), models, data, pin.ADMMSolverSettings(), result)
    return float(result.retrieveConstraintImpulses()[-1]), said


print(f"pin {pin.__version__}: force f with f + y = 0, expected -y")
cases = {
    "infinite bounds, y = -1": solve(friction(np.inf), [-1.0]),
    "infinite bounds, y = +1": solve(friction(np.inf), [1.0]),
    "bounds of 1000,  y = -1": solve(friction(1000.0), [-1.0]),
    "point anchor,    y = -1": solve(pin.PointAnchorConstraintModel(MODEL, 0, PLACE, 1, PLACE), [0.0, 0.0, -1.0]),
}
for name, (force, said) in cases.items():
    print(f"{name}: force {force:+.6f}, converged {said}")
(wrong, said), *others = cases.values()
right = all(abs(force - wanted) < 1e-3 for (force, _), wanted in zip(others, (-1.0, 1.0, 1.0), strict=True))
shown = wrong == 0.0 and said and right
print("no force, and converged" if shown else "the force holds")
sys.exit(0 if shown else 1)
