"""DART: a box on a plane has one contact with two of the collision detectors, where it rests on four corners.

A cube lies on a floor, friction 0.5, and spins about its vertical axis at 3 rad/s. Friction at the four corners stops
it: by Coulomb's law after w^2 I / (2 mu m g r), r from the axis to a corner, with bounds along x and y of the world,
DART's default, earlier. One contact alone holds no moment about the normal, and none that rights a cube which tilts.
Second route: a large `BoxShape` in place of the `PlaneShape`, the same world else.
"""

import sys

import dartpy
import numpy as np

MU, G, MASS, HALF, SPIN, STEP = 0.5, 9.81, 1.0, 0.1, 3.0, 1e-3
INERTIA = MASS * (2 * HALF) ** 2 / 6


def spin(detector, floor, offset):
    """Numbers of contacts, turn and spin after 1 s, and how deep the cube sinks and tilts."""
    world = dartpy.simulation.World()
    world.setTimeStep(STEP)
    world.setGravity([0, 0, -G])
    if detector is not None:
        world.getConstraintSolver().setCollisionDetector(detector())
    ground, cube = dartpy.dynamics.Skeleton("ground"), dartpy.dynamics.Skeleton("cube")
    _, base = ground.createWeldJointAndBodyNodePair()
    _, node = cube.createFreeJointAndBodyNodePair()
    pieces = [base.createShapeNode(floor), node.createShapeNode(dartpy.dynamics.BoxShape([2 * HALF] * 3))]
    pieces[0].setRelativeTranslation([0, 0, offset])
    for piece in pieces:
        piece.createCollisionAspect()
        piece.createDynamicsAspect()
        piece.getDynamicsAspect().setFrictionCoeff(MU)
    node.setInertia(dartpy.dynamics.Inertia(MASS, [0, 0, 0], INERTIA * np.eye(3)))
    world.addSkeleton(ground)
    world.addSkeleton(cube)
    cube.setPositions([0, 0, 0, 0, 0, HALF])
    cube.setVelocities([0, 0, SPIN, 0, 0, 0])
    counts, turn, sunk, tilt = set(), 0.0, 0.0, 0.0
    for _ in range(1000):
        world.step()
        counts.add(world.getLastCollisionResult().getNumContacts())
        q = np.array(cube.getPositions())
        turn += STEP * cube.getVelocities()[2]
        sunk, tilt = max(sunk, HALF - q[5]), max(tilt, float(np.hypot(q[0], q[1])))
    return counts, turn, float(np.linalg.norm(cube.getVelocities()[:3])), sunk, tilt


stops = SPIN**2 * INERTIA / (2 * MU * MASS * G * HALF * np.sqrt(2))
print(f"dartpy {dartpy.__version__}: a cube spins on a floor; Coulomb's friction stops it after {stops:.4f} rad")
plane, box = dartpy.dynamics.PlaneShape([0, 0, 1.0], 0.0), dartpy.dynamics.BoxShape([10.0, 10.0, 1.0])
names = ("DARTCollisionDetector", "FCLCollisionDetector", "BulletCollisionDetector", "OdeCollisionDetector")
detectors = {"default": None, **{name: getattr(dartpy.collision, name) for name in names}}
found = {}
for name, detector in detectors.items():
    for floor, shape, offset in (("plane", plane, 0.0), ("box", box, -0.5)):
        found[name, floor] = counts, turn, left, sunk, tilt = spin(detector, shape, offset)
        told = ", ".join(map(str, sorted(counts)))
        print(f"{name}, {floor}: {told} contacts; turned by {turn:.4f} rad, {left:.1e} rad/s left, ", end="")
        print(f"sunk by {sunk:.1e} m, tilted by {tilt:.1e} rad")
lost = [found[name, "plane"] for name in ("default", "DARTCollisionDetector", "FCLCollisionDetector")]
held = [found[name, "box"] for name in detectors] + [found["OdeCollisionDetector", "plane"]]
shown = all(counts == {1} and turn > 10 * stops for counts, turn, *_ in lost)
shown = shown and all(4 in counts and turn < stops and left < 1e-9 for counts, turn, left, *_ in held)
print("corners of a box on a plane are lost" if shown else "a box on a plane has four corners")
sys.exit(0 if shown else 1)
