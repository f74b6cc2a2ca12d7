"""DART: a joint position that is not a number gives finite poses and accelerations, with a warning on the console only.

Expected: by the arithmetic of IEEE 754, sin(nan) and all that is computed from it are not numbers. Second route: a
position that is not a number, stepped by World.step, leaves finite poses too, so that a diverged run can look sound.
"""

import math
import sys

import dartpy as dart
import numpy as np

skeleton = dart.dynamics.Skeleton()
joint, body = skeleton.createRevoluteJointAndBodyNodePair()
joint.setAxis([1.0, 0.0, 0.0])
body.setInertia(dart.dynamics.Inertia(1.0, [0.0, 0.3, 0.0], np.eye(3)))
joint.setPositions([math.nan])
skeleton.computeForwardDynamics()
acceleration = float(skeleton.getAccelerations()[0])
pose = body.getWorldTransform().matrix()

world = dart.simulation.World()
world.addSkeleton(skeleton)
world.step()
position = float(skeleton.getPositions()[0])
after = body.getWorldTransform().matrix()

print(f"dartpy {dart.__version__}: position nan, expected nan everywhere")
print(f"acceleration by computeForwardDynamics  {acceleration}")
print(f"pose of the body                        {'identity' if np.array_equal(pose, np.eye(4)) else pose}")
print(f"after World.step: position {position}, pose {'identity' if np.array_equal(after, np.eye(4)) else after}")
shown = math.isfinite(acceleration) and np.all(np.isfinite(pose)) and np.all(np.isfinite(after))
sys.exit(0 if shown and math.isnan(position) else 1)
