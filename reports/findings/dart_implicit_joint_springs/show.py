"""DART: the acceleration of a sprung joint by computeForwardDynamics depends on the time step of the skeleton.

Inertia I about the axis, spring k, damper c: a = -(k q + c v) / I. What comes back is the acceleration of an implicit
step, -(k (q + h v) + c v) / (I + h c + h^2 k), h being the skeleton's time step, 1 ms unless told, even though nothing
is stepped. Second route: with a time step of zero the same call gives the first formula.
"""

import sys

import dartpy as dart
import numpy as np

INERTIA, K, C, Q, V = 0.5, 200.0, 3.0, 0.2, 1.5
skeleton = dart.dynamics.Skeleton()
skeleton.setGravity([0.0, 0.0, 0.0])
joint, body = skeleton.createRevoluteJointAndBodyNodePair()
joint.setAxis([0.0, 0.0, 1.0])
body.setInertia(dart.dynamics.Inertia(1.0, [0.0, 0.0, 0.0], INERTIA * np.eye(3)))
joint.setSpringStiffness(0, K)
joint.setDampingCoefficient(0, C)
joint.setPosition(0, Q)
joint.setVelocity(0, V)

expected = -(K * Q + C * V) / INERTIA
print(f"dartpy {dart.__version__}: expected acceleration {expected}")
print("time step   observed            implicit step")
errors = {}
for step in (skeleton.getTimeStep(), 1e-2, 0.0):
    skeleton.setTimeStep(step)
    skeleton.computeForwardDynamics()
    observed = float(skeleton.getAccelerations()[0])
    implicit = -(K * (Q + step * V) + C * V) / (INERTIA + step * C + step**2 * K)
    errors[step] = (abs(observed - expected), abs(observed - implicit))
    print(f"{step:8.1e}   {observed:18.12f}  {implicit:18.12f}")
shown = all(of_step < 1e-10 for _, of_step in errors.values()) and errors[0.0][0] < 1e-10 and errors[1e-2][0] > 1.0
print("it is that of an implicit step" if shown else "it is not that of an implicit step")
sys.exit(0 if shown else 1)
