"""Pinocchio: `ADMMConstraintSolver` with a penalty that it adapts goes round without end, where a constant one ends.

One point on two coordinates of unit mass slides on a plane: rows J of its velocity (two tangents, then the normal),
free accelerations y, Coulomb's friction mu. Second route: friction against the slip's direction d and no normal
velocity give ``N = -y_n / (G_nn - mu G_nt d)``, and the slip with this N is along d for one d alone.
"""

import sys

import numpy as np
import pinocchio as pin

J = np.array([[1.59, 0.11], [0.11, 0.88], [-1.19, -0.16]])
FRICTION, Y = 0.56, np.array([4.4, 0.76, -3.54])
G = J @ J.T
ITERATIONS, TOLERANCE = 50000, 1e-9

MODEL = pin.Model()
MODEL.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
PLACE = pin.SE3.Identity()


def with_tolerances(settings):
    """Set the tolerances and the number of iterations."""
    settings.max_iterations = ITERATIONS
    for kind in ("feasibility", "complementarity"):
        for scale in ("absolute", "relative"):
            setattr(settings, f"{scale}_{kind}_tol", TOLERANCE)
    return settings


def solved(solver, settings, result):
    """Force, whether the solver says that it has converged, and its iterations."""
    models, data = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    contact = pin.PointContactConstraintModel(MODEL, 0, PLACE, 1, PLACE)
    contact.setFriction(FRICTION)
    models.append(contact)
    data.append(models[0].createData())
    said = solver.solve(pin.DelassusOperatorDense(G), Y, models, data, with_tolerances(settings), result)
    return np.array(result.retrieveConstraintImpulses()), said, int(result.iterations)


def by_rule(rule):
    """Solution by ADMM with a rule of its penalty."""
    settings = pin.ADMMSolverSettings()
    settings.admm_update_rule, settings.solve_ncp = rule, True
    return solved(pin.ADMMConstraintSolver(), settings, pin.ADMMSolverResult())


def sliding(angle):
    """Force with friction against a direction, and the slip along and across it."""
    d = np.array([np.cos(angle), np.sin(angle)])
    push = np.array([*(-FRICTION * d), 1.0])
    force = -Y[2] / (G[2] @ push) * push
    u = G @ force + Y
    return force, u[:2] @ d, u[0] * d[1] - u[1] * d[0]


angles = np.linspace(0.0, 2.0 * np.pi, 100001)
across = np.array([sliding(angle)[2] for angle in angles])
roots = angles[:-1][across[:-1] * across[1:] < 0.0]
(truth,) = [force for force, along, _ in map(sliding, roots) if force[2] > 0.0 and along > 0.0]
print(f"pin {pin.__version__}: Coulomb's force {truth}")

wrong = []
for name, rule in pin.ADMMUpdateRule.names.items():
    force, said, iterations = by_rule(rule)
    print(f"ADMM, {name:8s}: {force}, converged {said}, {iterations} iterations")
    off = np.max(np.abs(force - truth)) / truth[2]
    wrong.append((name, off > 0.1 and not said, off < 1e-3 and said))
force, said, iterations = solved(pin.PGSConstraintSolver(), pin.PGSSolverSettings(), pin.PGSSolverResult())
print(f"PGS           : {force}, converged {said}, {iterations} iterations")
shown = all(right if name == "CONSTANT" else lost for name, lost, right in wrong)
shown = shown and said and np.max(np.abs(force - truth)) < 1e-3 * truth[2]
print("adapted penalties do not converge" if shown else "it does not show")
sys.exit(0 if shown else 1)
