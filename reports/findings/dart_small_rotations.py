"""DART: the rotation of a ball joint by a small angle is wrong by about the cube of the angle over six.

The rotation matrix of a rotation by t about z has the entry sin t; what comes back is t itself below about 1e-3 rad.
"""

import math
import sys

import dartpy as dart

skeleton = dart.dynamics.Skeleton()
joint, body = skeleton.createBallJointAndBodyNodePair()
worst = 0.0
print("angle      error of R[1, 0]   angle^3 / 6")
for angle in (1e-4, 3e-4, 9e-4, 1.1e-3, 3e-3):
    joint.setPositions([0.0, 0.0, angle])
    error = abs(body.getTransform().matrix()[1, 0] - math.sin(angle))
    worst = max(worst, error)
    print(f"{angle:8.1e}   {error:14.2e}   {angle**3 / 6:10.2e}")
print(f"dartpy {dart.__version__}: {'wrong beyond rounding' if worst > 1e-12 else 'right'}")
sys.exit(0 if worst > 1e-12 else 1)
