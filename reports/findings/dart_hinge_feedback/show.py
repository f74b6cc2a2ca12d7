"""DART: the error feedback of RevoluteJointConstraint and CylindricalJointConstraint drives their axes apart.

A body whose axis is tilted by 0.01 rad from the one it is held to, at rest, no gravity, error reduction parameter e.
A step takes the fraction e of the error away: the tilt goes as (1 - e)^n. Observed: it goes as (1 + e)^n. Second route:
the same hinge made of two BallJointConstraints on its axis, and a WeldJointConstraint, go as (1 - e)^n. Third: a
pendulum that starts without any error, on the default e = 0.01, gains its energy from the feedback.
"""

import sys

import dartpy as dart
import numpy as np

TILT, Z = 0.01, np.array([0.0, 0.0, 1.0])
CONSTRAINTS = {
    "RevoluteJointConstraint": lambda body: [dart.constraint.RevoluteJointConstraint(body, np.zeros(3), Z)],
    "CylindricalJointConstraint": lambda body: [dart.constraint.CylindricalJointConstraint(body, np.zeros(3), Z)],
    "two BallJointConstraints": lambda body: [dart.constraint.BallJointConstraint(body, p) for p in (0.0 * Z, 0.5 * Z)],
    "WeldJointConstraint": lambda body: [dart.constraint.WeldJointConstraint(body)],
}


def held_body(name, gravity, com, reduction):
    """World with one free body at the identity, held by constraints to where it is."""
    world, skeleton = dart.simulation.World(), dart.dynamics.Skeleton()
    body = skeleton.createFreeJointAndBodyNodePair()[1]
    body.setInertia(dart.dynamics.Inertia(1.0, com, np.diag([0.1, 0.2, 0.3])))
    world.addSkeleton(skeleton)
    world.setGravity(gravity)
    world.setTimeStep(1e-3)
    dart.constraint.WeldJointConstraint.setErrorReductionParameter(reduction)  # of all kinds: it is one number
    for constraint in CONSTRAINTS[name](body):
        world.getConstraintSolver().addConstraint(constraint)
    return world, skeleton, body


def tilt_after(name, reduction, steps):
    """Angle between the axis of the body and z."""
    world, skeleton, body = held_body(name, [0.0, 0.0, 0.0], np.zeros(3), reduction)
    skeleton.setPositions([TILT, 0.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(steps):
        world.step()
    axis = body.getWorldTransform().rotation()[:, 2]
    return float(np.arctan2(np.hypot(axis[0], axis[1]), axis[2]))


def pendulum(name, seconds):
    """Energy gained, and the tilt of the axis, of a pendulum that starts at rest without any error."""
    world, skeleton, body = held_body(name, [0.0, -9.81, 0.0], np.array([0.5, 0.0, 0.2]), 0.01)
    before = skeleton.computeKineticEnergy() + skeleton.computePotentialEnergy()
    for _ in range(round(seconds / 1e-3)):
        world.step()
    after = skeleton.computeKineticEnergy() + skeleton.computePotentialEnergy()
    return after - before, 1.0 - body.getWorldTransform().rotation()[2, 2]


print(f"dartpy {dart.__version__}: tilt after 3 steps, from {TILT} rad")
print(f"{'':27s} e = 0.01   e = 0.1    e = 0.5")
for sign in (-1.0, 1.0):
    print(f"{f'(1 {sign:+.0f} e)^3':27s}", *(f"{TILT * (1.0 + sign * e) ** 3:.3e} " for e in (0.01, 0.1, 0.5)))
factors = {}
for name in CONSTRAINTS:
    tilts = [tilt_after(name, e, 3) for e in (0.01, 0.1, 0.5)]
    factors[name] = tilts[2] / TILT
    print(f"{name:27s}", *(f"{tilt:.3e} " for tilt in tilts))
swing = {name: pendulum(name, 3.0) for name in ("RevoluteJointConstraint", "two BallJointConstraints")}
print("pendulum on the default e, 3 s: energy gained (of 9.8 J range), 1 - cosine of the tilt")
for name, (gained, tilt) in swing.items():
    print(f"{name:27s} {gained:8.3f} J  {tilt:.1e}")
shown = all(abs(factors[name] - 1.5**3) < 0.05 for name in list(CONSTRAINTS)[:2])
shown = shown and all(abs(factors[name] - 0.5**3) < 0.01 for name in list(CONSTRAINTS)[2:])
print("of the wrong sign" if shown else "of the right sign")
sys.exit(0 if shown else 1)
