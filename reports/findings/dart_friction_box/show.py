"""DART: friction is a box along the axes of the world by default: a cube slides 12 degrees off its straight line.

A cube on four small spheres slides at 3 m/s, 20 degrees from x, with friction 0.5: it stays on its line and stops after
v^2 / (2 mu g). A box bounds the force along x and y apart: each speed falls by mu g, and the cube turns towards x.
Second route: `FbfFrictionSolver`, whose cone is a circle, on the same world.
"""

import sys

import dartpy
import numpy as np

MU, G, SPEED, HEADING, STEP = 0.5, 9.81, 3.0, np.radians(20.0), 1e-3


def slide(circle):
    """Place where the cube stops."""
    world = dartpy.simulation.World()
    world.setTimeStep(STEP)
    world.setGravity([0, 0, -G])
    solver = world.getConstraintSolver()
    solver.setCollisionDetector(dartpy.collision.DARTCollisionDetector())
    if circle:
        solver.setBoxedLcpSolver(dartpy.constraint.FbfFrictionSolver())
    ground, cube = dartpy.dynamics.Skeleton("ground"), dartpy.dynamics.Skeleton("cube")
    _, floor = ground.createWeldJointAndBodyNodePair()
    _, node = cube.createFreeJointAndBodyNodePair()
    pieces = [floor.createShapeNode(dartpy.dynamics.PlaneShape([0, 0, 1.0], 0.0))]
    for x in (-0.05, 0.05):
        for y in (-0.05, 0.05):
            foot = node.createShapeNode(dartpy.dynamics.SphereShape(1e-3))
            foot.setRelativeTranslation([x, y, -0.049])
            pieces.append(foot)
    for piece in pieces:
        piece.createCollisionAspect()
        piece.createDynamicsAspect()
        piece.getDynamicsAspect().setFrictionCoeff(MU)
    node.setInertia(dartpy.dynamics.Inertia(1.0, [0, 0, 0], np.eye(3) / 600.0))
    world.addSkeleton(ground)
    world.addSkeleton(cube)
    cube.setPositions([0, 0, 0, 0, 0, 0.05 - 1e-9])
    cube.setVelocities([0, 0, 0, SPEED * np.cos(HEADING), SPEED * np.sin(HEADING), 0])
    for _ in range(800):
        world.step()
    return np.array(cube.getPositions()[3:5])


print(f"dartpy {dartpy.__version__}: a cube slides at 20 degrees with friction {MU}")
straight = SPEED**2 / (2 * MU * G) * np.array([np.cos(HEADING), np.sin(HEADING)])
box = SPEED**2 / (2 * MU * G) * np.array([np.cos(HEADING), np.sin(HEADING)]) ** 2
found = {"default": slide(circle=False), "FbfFrictionSolver": slide(circle=True)}
for name, place in found.items():
    angle = np.degrees(np.arctan2(place[1], place[0]))
    print(f"{name}: stops at {place[0]:.4f}, {place[1]:.4f} m, {angle:.2f} degrees from x")
print(f"expected {straight[0]:.4f}, {straight[1]:.4f} m; a box along x and y {box[0]:.4f}, {box[1]:.4f} m")
off_box, off_circle = np.abs(found["default"] - box).max(), np.abs(found["FbfFrictionSolver"] - straight).max()
shown = off_box < 3e-3 and off_circle < 3e-3 and np.abs(box - straight).max() > 0.05
print("a box of the world" if shown else "a circle")
sys.exit(0 if shown else 1)
