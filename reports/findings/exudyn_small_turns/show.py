"""Exudyn: a node with a rotation vector loses turns below 2e-8 rad in a step near a rotation vector of zero.

A free body with equal moments of inertia turns at a constant rate: after n steps by n times the turn of a step. From a
rotation vector of zero it does not turn at all, though its angular velocity stays. Second route: the same body on a
node that is half a turn away at the start.
"""

import sys

import exudyn
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

STEP, COUNT = 1e-3, 1000
HALF_TURN = np.pi * np.full(3, 3.0**-0.5)

exudyn.config.printToConsole = False


def turned(solver, start, turn):
    """Angle about y by which a body has turned, over that of its angular velocity, and the angular velocity's share."""
    system = exudyn.SystemContainer().AddSystem()
    velocity = np.array([0.0, turn / STEP, 0.0])
    angle = np.linalg.norm(start)
    K = np.cross(np.eye(3), start / max(angle, 1e-300))
    R = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    node = system.AddNode(
        ii.NodeRigidBodyRotVecLG(referenceCoordinates=[0, 0, 0, *start], initialVelocities=[0, 0, 0, *(R.T @ velocity)])
    )
    body = system.AddObject(ii.ObjectRigidBody(mass=1.0, inertia=[0.3] * 3 + [0] * 3, nodeNumber=node))
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.adaptiveStep = False
    settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.endTime = STEP * COUNT
    settings.timeIntegration.numberOfSteps = COUNT
    system.SolveDynamic(settings, solverType=solver)
    kinds = exudyn.OutputVariableType
    R_end = np.array(system.GetObjectOutputBody(body, kinds.RotationMatrix, [0, 0, 0])).reshape(3, 3) @ R.T
    spin = system.GetObjectOutputBody(body, kinds.AngularVelocity, [0, 0, 0])
    found = np.arctan2(0.5 * (R_end[0, 2] - R_end[2, 0]), 0.5 * (np.trace(R_end) - 1.0))
    return found / (turn * COUNT), spin[1] / velocity[1]


print(f"exudyn {exudyn.__version__}: angle after {COUNT} steps, over that of the angular velocity")
print("turn of a step   solver            from zero   from half a turn")
shown = True
for turn in (1e-3, 1e-7, 1e-8, 1e-9):
    for name in ("RK44", "ExplicitEuler"):
        solver = getattr(exudyn.DynamicSolverType, name)
        (zero, spin), (half, _) = turned(solver, np.zeros(3), turn), turned(solver, HALF_TURN, turn)
        print(f"{turn:.0e} rad        {name:15s} {zero:11.8f}   {half:11.8f}")
        expected = 0.0 if turn < 2e-8 else 1.0
        shown = shown and abs(zero - expected) < 2e-4 and abs(half - 1.0) < 1e-5 and abs(spin - 1.0) < 1e-9
print("small turns are lost from a rotation vector of zero" if shown else "turns are right, or wrong in another way")
sys.exit(0 if shown else 1)
