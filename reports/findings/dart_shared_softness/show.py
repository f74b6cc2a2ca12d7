"""DART: error reduction and force mixing belong to the process, not to a constraint, a kind of constraint or a world.

Two pendulums in two worlds, each held by a constraint of another kind and started 1 mm off. Expected by what the names
of the setters say: setting the parameter of weld constraints changes no ball joint. Second route: the motion itself;
the error that one step takes out of the ball joint is e h times the parameter that the *weld* was given.
"""

import sys

import dartpy as dart
import numpy as np

Weld, Ball = dart.constraint.WeldJointConstraint, dart.constraint.BallJointConstraint


def gap_after_step(reduction_of_welds):
    """Distance of a ball joint from its anchor after a step, 1 mm before it, and the parameter it reports."""
    world, skeleton = dart.simulation.World(), dart.dynamics.Skeleton()
    body = skeleton.createFreeJointAndBodyNodePair()[1]
    world.addSkeleton(skeleton)
    world.setGravity([0.0, 0.0, 0.0])
    constraint = Ball(body, np.zeros(3))
    world.getConstraintSolver().addConstraint(constraint)
    skeleton.setPositions([0.0, 0.0, 0.0, 1e-3, 0.0, 0.0])
    Weld.setErrorReductionParameter(reduction_of_welds)
    world.step()
    return float(np.linalg.norm(skeleton.getPositions()[3:])), Ball.getErrorReductionParameter()


print(f"dartpy {dart.__version__}: default of ball joints {Ball.getErrorReductionParameter()}")
print("set on welds   ball joints report   gap of a ball joint after a step (1 mm before)")
found = {reduction: gap_after_step(reduction) for reduction in (0.01, 0.2, 0.8)}
for reduction, (gap, reported) in found.items():
    print(f"{reduction:8.2f}       {reported:8.2f}             {1e3 * gap:.6f} mm")
shown = all(reported == reduction for reduction, (_, reported) in found.items())
shown = shown and found[0.01][0] > found[0.2][0] > found[0.8][0]
print("one parameter for all" if shown else "each its own")
sys.exit(0 if shown else 1)
