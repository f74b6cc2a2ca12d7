"""DART: World.step loses the energy of a Bricard mechanism; without position feedback it locks, at every step size.

Five unit rods along the edges of a cube, and the ground, joined by six revolutes: one degree of freedom, although one
of the constraint equations depends on the others. The loop is closed by a weld of a light copy of the ground. It starts
with the velocities of the null vector of its six screws. Expected: kinetic and potential energy keep their sum. Second
route: with an error reduction of 0.5 it is kept, the better the smaller the step.
"""

import sys

import dartpy as dart
import numpy as np

G, END = 9.81, 0.3
EDGES = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0], [0, 0, -1]], dtype=float)
POINTS = np.vstack([np.zeros(3), np.cumsum(EDGES, axis=0)])
AXES = np.array([np.cross(EDGES[i - 1], EDGES[i]) for i in range(6)])
SCREWS = np.array([np.concatenate([a, np.cross(p, a)]) for a, p in zip(AXES, POINTS, strict=False)]).T
RATES = 3.0 * np.linalg.svd(SCREWS)[2][-1]


def run(reduction, step):
    """Kinetic energy and gain of energy at the end."""
    world, skeleton, body = dart.simulation.World(), dart.dynamics.Skeleton(), None
    for i, (edge, axis) in enumerate(zip(EDGES, AXES, strict=True)):
        joint, body = skeleton.createRevoluteJointAndBodyNodePair(body)
        joint.setAxis(axis)
        frame = dart.math.Isometry3()
        frame.set_translation(EDGES[i - 1] if i else np.zeros(3))
        joint.setTransformFromParentBodyNode(frame)
        mass = 1.0 if i < 5 else 1e-3
        moment = mass * (0.02 * np.eye(3) + (np.eye(3) - np.outer(edge, edge)) / 12.0)
        body.setInertia(dart.dynamics.Inertia(mass, edge / 2.0, moment))
    world.addSkeleton(skeleton)
    world.setGravity([0.0, 0.0, -G])
    world.setTimeStep(step)
    skeleton.setVelocities(RATES)
    weld = dart.constraint.WeldJointConstraint(body)
    dart.constraint.WeldJointConstraint.setErrorReductionParameter(reduction)
    world.getConstraintSolver().addConstraint(weld)
    before = skeleton.computeKineticEnergy() + skeleton.computePotentialEnergy()
    for _ in range(round(END / step)):
        world.step()
    kinetic = skeleton.computeKineticEnergy()
    return kinetic, kinetic + skeleton.computePotentialEnergy() - before


print(f"dartpy {dart.__version__}: after {END} s; expected gain of energy 0")
print("error reduction   step       kinetic energy   gain of energy")
found = {}
for reduction in (0.0, 0.01, 0.5):
    for step in (1e-3, 2.5e-4):
        found[reduction, step] = kinetic, gain = run(reduction, step)
        note = "  (the default)" if reduction == 0.01 else ""
        print(f"{reduction:8.2f}          {step:.1e}   {kinetic:8.3f} J       {gain:9.4f} J{note}")
locked = all(found[0.0, step][0] < 0.2 and found[0.0, step][1] < -5.0 for step in (1e-3, 2.5e-4))
shown = locked and found[0.01, 2.5e-4][1] < -1.0
shown = shown and abs(found[0.5, 2.5e-4][1]) < 0.01 and abs(found[0.5, 2.5e-4][1]) < abs(found[0.5, 1e-3][1])
print("locked without feedback, lossy on the default" if shown else "it keeps its energy")
sys.exit(0 if shown else 1)
