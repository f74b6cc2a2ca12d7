"""Pinocchio: `ADMMConstraintSolver` leaves its penalty in the Delassus operator, and the next solver takes it for mass.

A mass of 1 kg pressed on a plane by 1 N: the normal force is 1. The same operator is given to the ADMM solver and then
to `PGSConstraintSolver`, and its matrix is read before and after. Second route: PGS with a new operator.
"""

import sys

import numpy as np
import pinocchio as pin

MODEL = pin.Model()
MODEL.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
PLACE = pin.SE3.Identity()
PRESSED = np.array([0.0, 0.0, -1.0])

models, data = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
models.append(pin.PointContactConstraintModel(MODEL, 0, PLACE, 1, PLACE))
data.append(models[0].createData())


def pgs(operator):
    """Normal force by PGS, and whether the solver says that it has converged."""
    result = pin.PGSSolverResult()
    said = pin.PGSConstraintSolver().solve(operator, PRESSED, models, data, pin.PGSSolverSettings(), result)
    return float(result.retrieveConstraintImpulses()[2]), said


operator = pin.DelassusOperatorDense(np.eye(3))
before = float(operator.matrix()[2, 2])
result = pin.ADMMSolverResult()
pin.ADMMConstraintSolver().solve(operator, PRESSED, models, data, pin.ADMMSolverSettings(), result)
after = float(operator.matrix()[2, 2])
first = float(result.retrieveConstraintImpulses()[2])
second, said = pgs(operator)
fresh, _ = pgs(pin.DelassusOperatorDense(np.eye(3)))

print(f"pin {pin.__version__}: normal force, expected 1")
print(f"ADMM {first:.6f}; diagonal of the operator {before:.6f} before, {after:.6f} after")
print(f"PGS with the same operator {second:.6f}, converged {said}; with a new one {fresh:.6f}")
shown = before == 1.0 and after > 1.5 and abs(first - 1.0) < 1e-4 and said and second < 0.6 and abs(fresh - 1.0) < 1e-6
print("the penalty stays" if shown else "the operator is as it was")
sys.exit(0 if shown else 1)
