"""Pinocchio: what `ADMMConstraintSolver` finds depends on the unit of mass.

A mass m is pressed on a plane by the force m times 1 m/s^2: the normal force over m is 1, whatever m is. All tolerances
are 1e-13. Second route: the same with the Delassus operator times m, and the force found divided by m.
"""

import sys

import numpy as np
import pinocchio as pin

MODEL = pin.Model()
MODEL.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
PLACE = pin.SE3.Identity()

models, data = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
models.append(pin.PointContactConstraintModel(MODEL, 0, PLACE, 1, PLACE))
data.append(models[0].createData())

settings = pin.ADMMSolverSettings()
settings.max_iterations = 10000
for kind in ("feasibility", "complementarity"):
    for scale in ("absolute", "relative"):
        setattr(settings, f"{scale}_{kind}_tol", 1e-13)


def pressed(mass):
    """Normal force, whether the solver says that it has converged, and its iterations."""
    result = pin.ADMMSolverResult()
    operator = pin.DelassusOperatorDense(np.eye(3) / mass)
    said = pin.ADMMConstraintSolver().solve(operator, np.array([0.0, 0.0, -1.0]), models, data, settings, result)
    return float(result.retrieveConstraintImpulses()[2]), said, int(result.iterations)


print(f"pin {pin.__version__}: normal force over mass, expected 1")
found = {}
for mass in (1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6):
    force, said, iterations = pressed(mass)
    found[mass] = abs(force / mass - 1.0), said
    print(f"{mass:8.0e} kg: {force / mass:.12f}, converged {said}, {iterations} iterations")
own, said, _ = pressed(1.0)  # the operator times m
print(f"in units of the mass itself: {own:.12f}, converged {said}")
shown = found[1e-9][0] > 1e-6 and found[1e-9][1] and not found[1e6][1] and abs(own - 1.0) < 1e-12 and said
print("it depends on the unit of mass" if shown else "it does not depend on the unit of mass")
sys.exit(0 if shown else 1)
