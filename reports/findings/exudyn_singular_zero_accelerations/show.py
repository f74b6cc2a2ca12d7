"""Exudyn: with dependent constraints the initial accelerations are zero, or not numbers, and the solver says "done".

A pendulum on two coincident revolute joints, released at rest: alpha = -m g l / I whatever holds its axis. The solver
warns on the console only; InitializeSolver returns True. Second route: the pendulum on one joint, and on both with the
linear solver that ignores singular matrices, has the right acceleration.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name

exu.config.printToConsole = False
MASS, G, LENGTH, INERTIA = 2.0, 9.81, 0.5, 0.1


def initial_acceleration(joints, linear_solver, ignore_singular=False):
    """What InitializeSolver returns, and the angular acceleration about z that it leaves."""
    mbs = CONTAINER.AddSystem()
    node = mbs.AddNode(ii.NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, 1, 0, 0, 0]))
    moment = INERTIA + MASS * LENGTH**2
    body = mbs.AddObject(
        ii.ObjectRigidBody(
            mass=MASS, inertia=[INERTIA, moment, moment, 0, 0, 0], centerOfMass=[LENGTH, 0, 0], nodeNumber=node
        )
    )
    at_mass = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=body))
    mbs.AddLoad(ii.LoadMassProportional(markerNumber=at_mass, loadVector=[0, -G, 0]))
    ground = mbs.AddObject(ii.ObjectGround())
    for _ in range(joints):
        markers = [mbs.AddMarker(ii.MarkerBodyRigid(bodyNumber=b)) for b in (ground, body)]
        mbs.AddObject(ii.ObjectJointRevoluteZ(markerNumbers=markers))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.linearSolver.solverType = getattr(exu.LinearSolverType, linear_solver)
    settings.linearSolver.ignoreSingularJacobian = ignore_singular
    solver = exu.MainSolverImplicitSecondOrder()
    done = solver.InitializeSolver(mbs, settings)
    return done, mbs.GetObjectOutputBody(body, exu.OutputVariableType.AngularAcceleration, [0, 0, 0])[2]


CONTAINER = exu.SystemContainer()
expected = -MASS * G * LENGTH / (INERTIA + MASS * LENGTH**2)
print(f"exudyn {exu.__version__}: expected {expected:.6f} rad/s^2")
cases = [(joints, solver, False) for joints in (1, 2) for solver in ("EXUdense", "EigenSparse", "EigenDense")]
found = {case: initial_acceleration(*case) for case in [*cases, (2, "EigenDense", True)]}
for (joints, solver, ignore), (done, alpha) in found.items():
    note = ", ignoreSingularJacobian" if ignore else ""
    print(f"joints {joints}, {solver + note:36s} InitializeSolver {done}, observed {alpha:.6f}")
right = [abs(alpha - expected) < 1e-6 for _, alpha in found.values()]
shown = all(done for done, _ in found.values()) and right == [True, True, True, False, False, False, True]
print("zero or not a number, and no error" if shown else "right, or an error")
sys.exit(0 if shown else 1)
