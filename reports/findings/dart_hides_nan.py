"""DART: a joint position that is not a number gives finite accelerations, with a warning on the console only."""

import math
import sys

import dartpy as dart

skeleton = dart.dynamics.Skeleton()
joint, body = skeleton.createRevoluteJointAndBodyNodePair()
joint.setPositions([math.nan])
skeleton.computeForwardDynamics()
acceleration = float(skeleton.getAccelerations()[0])
print(f"dartpy {dart.__version__}: position nan, acceleration {acceleration}")
sys.exit(0 if math.isfinite(acceleration) else 1)
