"""DART: a rebound of up to 0.1 m/s is none, and one above 100 m/s is 100; there is nothing to set either.

A ball with restitution 0.5 hits a plane without gravity: it leaves at half the speed. Speeds of 0.19, 0.25 and 300 m/s.
Second route: the impulse of DART's contact over the mass is the change of the speed.
"""

import sys

import dartpy
import numpy as np


def ball(speed):
    """Speed of rebound, and impulse over mass, of a ball that hits the plane in the first step."""
    world = dartpy.simulation.World()
    world.setGravity([0, 0, 0])
    options = world.getDeactivationOptions()
    options.mEnabled = False
    world.setDeactivationOptions(options)
    world.getConstraintSolver().setCollisionDetector(dartpy.collision.DARTCollisionDetector())
    ground, body = dartpy.dynamics.Skeleton("ground"), dartpy.dynamics.Skeleton("ball")
    _, floor = ground.createWeldJointAndBodyNodePair()
    _, node = body.createFreeJointAndBodyNodePair()
    for place, shape, restitution in (
        (floor, dartpy.dynamics.PlaneShape([0, 0, 1.0], 0.0), 1.0),
        (node, dartpy.dynamics.SphereShape(0.1), 0.5),
    ):
        piece = place.createShapeNode(shape)
        piece.createCollisionAspect()
        piece.createDynamicsAspect()
        piece.getDynamicsAspect().setRestitutionCoeff(restitution)
    node.setInertia(dartpy.dynamics.Inertia(1.0, [0, 0, 0], 0.004 * np.eye(3)))
    world.addSkeleton(ground)
    world.addSkeleton(body)
    body.setPositions([0, 0, 0, 0, 0, 0.1 - 1e-9])
    body.setVelocities([0, 0, 0, 0, 0, -speed])
    world.step()
    push = sum(abs(contact.force[2]) for contact in world.getLastCollisionResult().getContacts())
    return float(body.getVelocities()[5]), push * world.getTimeStep()


print(f"dartpy {dartpy.__version__}: restitution 0.5, expected rebound half of the speed")
found = {speed: ball(speed) for speed in (0.19, 0.25, 300.0)}
for speed, (rebound, impulse) in found.items():
    print(f"speed {speed:g} m/s: rebound {rebound:.6f}, expected {speed / 2:g}; impulse over mass {impulse:.6f}")
rebounds = [rebound for rebound, _ in found.values()]
agree = all(abs(impulse - speed - rebound) < 1e-3 * speed for speed, (rebound, impulse) in found.items())
shown = agree and abs(rebounds[0]) < 1e-4 and abs(rebounds[1] - 0.125) < 1e-4 and abs(rebounds[2] - 100.0) < 0.1
print("no rebound below, no more above" if shown else "half of the speed")
sys.exit(0 if shown else 1)
