"""DART: the rotation of a ball joint by a small angle is wrong by about the cube of the angle over six.

The rotation by t about z has the entry sin t; what comes back below 1e-3 rad is t itself. Second route: the same
rotation has the other name t - 2 pi, and under that name it comes back right. Third: a body that spins freely about a
principal axis turns by w T, and World.step, which moves it by small rotations, gains (w h)^3 / 6 in every step.
"""

import math
import sys

import dartpy as dart

skeleton = dart.dynamics.Skeleton()
joint, body = skeleton.createBallJointAndBodyNodePair()


def entry(angle):
    """R[1, 0] of the rotation of the joint by `angle` about z."""
    joint.setPositions([0.0, 0.0, angle])
    return body.getTransform().matrix()[1, 0]


print(f"dartpy {dart.__version__}")
print("angle      expected                observed                error     angle^3 / 6   error as angle - 2 pi")
worst = other = 0.0
for angle in (1e-4, 3e-4, 9e-4, 1.1e-3, 3e-3):
    error = entry(angle) - math.sin(angle)
    renamed = entry(angle - 2.0 * math.pi) - math.sin(angle)
    worst, other = max(worst, abs(error)), max(other, abs(renamed))
    print(f"{angle:7.1e}  {math.sin(angle):22.16e}  {entry(angle):22.16e}", end="")
    print(f"  {error:8.1e}  {angle**3 / 6:8.1e}  {renamed:8.1e}")


def excess(step):
    """Angle that a body spinning at 1 rad/s gains in a second over the one it should have."""
    world, free = dart.simulation.World(), dart.dynamics.Skeleton()
    node = free.createFreeJointAndBodyNodePair()[1]
    node.setInertia(dart.dynamics.Inertia(1.0, [0.0, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]))
    world.addSkeleton(free)
    world.setGravity([0.0, 0.0, 0.0])
    world.setTimeStep(step)
    free.setVelocities([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    count = round(1.0 / step)
    for _ in range(count):
        world.step()
    R = node.getWorldTransform().rotation()
    return math.atan2(R[1, 0], R[0, 0]) - count * step


drift = {step: excess(step) for step in (2e-3, 8e-4)}
for step, gained in drift.items():
    print(f"World.step of {step:g} s, 1 rad/s, 1 s: expected excess 0, observed {gained:.2e}", end="")
    print(f", 1/h (w h)^3 / 6 = {step**2 / 6:.2e}")
shown = worst > 1e-10 and other < 1e-14 and abs(drift[8e-4] / (8e-4**2 / 6) - 1.0) < 0.05 and abs(drift[2e-3]) < 1e-12
print("wrong below 1e-3 rad" if shown else "right, or wrong in another way")
sys.exit(0 if shown else 1)
