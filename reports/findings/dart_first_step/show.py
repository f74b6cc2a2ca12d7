"""DART: the first step from a consistent state does not know the centripetal acceleration of a constraint.

A body of no gravity circles the point it is held to by a BallJointConstraint at r = 0.5 m, 2 rad/s: its acceleration is
-w^2 r = -2 m/s^2, whatever the step. The constraint is one on velocities, J v = 0, at the start of the step, which the
state satisfies: the first step leaves v alone. Second route: from the second step on (v2 - v1) / h goes to -2 with h.
"""

import sys

import dartpy as dart
import numpy as np

R, W = 0.5, 2.0


def quotients(step):
    """(v1 - v0) / h and (v2 - v1) / h along the radius, without feedback of the position error."""
    world, skeleton = dart.simulation.World(), dart.dynamics.Skeleton()
    body = skeleton.createFreeJointAndBodyNodePair()[1]
    body.setInertia(dart.dynamics.Inertia(1.0, [0.0, 0.0, 0.0], 0.1 * np.eye(3)))
    world.addSkeleton(skeleton)
    world.setGravity([0.0, 0.0, 0.0])
    world.setTimeStep(step)
    skeleton.setPositions([0.0, 0.0, 0.0, R, 0.0, 0.0])
    skeleton.setVelocities([0.0, 0.0, W, 0.0, W * R, 0.0])
    constraint = dart.constraint.BallJointConstraint(body, np.zeros(3))
    dart.constraint.BallJointConstraint.setErrorReductionParameter(0.0)
    world.getConstraintSolver().addConstraint(constraint)
    v = [skeleton.getVelocities()[3]]
    for _ in range(2):
        world.step()
        v.append(skeleton.getVelocities()[3])
    return np.diff(v) / step


expected = -(W**2) * R
print(f"dartpy {dart.__version__}: expected {expected} m/s^2 along the radius")
print("step      first step   second step")
found = {step: quotients(step) for step in (1e-2, 1e-3, 1e-4, 1e-5)}
for step, (first, second) in found.items():
    print(f"{step:7.0e}   {first:10.6f}   {second:12.8f}")
shown = all(abs(first) < 1e-9 for first, _ in found.values()) and abs(found[1e-4][1] - expected) < 1e-6
print("nothing of it in the first step, whatever its size" if shown else "it is there")
sys.exit(0 if shown else 1)
