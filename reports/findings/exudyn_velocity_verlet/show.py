"""Exudyn: VelocityVerlet is of order one where forces depend on velocities, a turning rigid body included.

A damped mass, v' = -v from v = 1: v(1) = 1/e. Halving the step should divide the error of a method of order two by
four. Second route: a torque-free rigid body against RK67. Without velocities in the forces the order is two.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

exu.config.printToConsole = False


def solve(mbs, solver, steps):
    """One second with a fixed step."""
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = 1.0
    settings.timeIntegration.automaticStepSize = False
    mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))


def mass_point(solver, steps, stiffness, damping):
    """Velocity after a second of a unit mass that starts at zero with 1 m/s."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(ii.NodePoint(referenceCoordinates=[0, 0, 0], initialVelocities=[1, 0, 0]))
    ends = [mbs.AddObject(ii.ObjectGround()), mbs.AddObject(ii.ObjectMassPoint(mass=1.0, nodeNumber=node))]
    markers = [mbs.AddMarker(ii.MarkerBodyPosition(bodyNumber=body)) for body in ends]
    mbs.AddObject(
        ii.ObjectConnectorCartesianSpringDamper(markerNumbers=markers, stiffness=[stiffness] * 3, damping=[damping] * 3)
    )
    solve(mbs, solver, steps)
    return np.array(mbs.GetNodeOutput(node, exu.OutputVariableType.Velocity))[:1]


def free_body(solver, steps):
    """Angular velocity after a second of a free body with moments 1, 2, 3."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(ii.NodeRigidBodyRotVecLG(referenceCoordinates=[0] * 6, initialVelocities=[0, 0, 0, 1, 2, 0.5]))
    mbs.AddObject(ii.ObjectRigidBody(mass=1.0, inertia=[1, 2, 3, 0, 0, 0], nodeNumber=node))
    solve(mbs, solver, steps)
    return np.array(mbs.GetNodeOutput(node, exu.OutputVariableType.AngularVelocityLocal))


cases = {
    "spring, k = 4": (lambda s, n: mass_point(s, n, 4.0, 0.0), np.array([np.cos(2.0)])),
    "damper, c = 1": (lambda s, n: mass_point(s, n, 0.0, 1.0), np.array([np.exp(-1.0)])),
    "free rigid body": (free_body, free_body("RK67", 4000)),
}
print(f"exudyn {exu.__version__}: order from halving the step, 200 to 400 (and the error at 400)")
orders = {}
for name, (run, truth) in cases.items():
    for solver in ("VelocityVerlet", "ExplicitMidpoint"):
        coarse, fine = (np.max(np.abs(run(solver, n) - truth)) for n in (200, 400))
        orders[name, solver] = np.log2(coarse / fine)
        print(f"{name:16s} {solver:17s} {orders[name, solver]:.2f}  ({fine:.1e})")
verlet = [orders[name, "VelocityVerlet"] for name in cases]
shown = np.allclose(verlet, [2.0, 1.0, 1.0], atol=0.1)
shown = shown and np.allclose([orders[name, "ExplicitMidpoint"] for name in cases], 2.0, atol=0.1)
sys.exit(0 if shown else 1)
