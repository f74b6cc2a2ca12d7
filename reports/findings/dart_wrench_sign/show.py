"""DART: getWrenchToChildBodyNode is the wrench on the parent, and getWrenchToParentBodyNode that on the child.

A body of 2 kg hangs on a weld, its centre of mass 0.3 m along x; gravity 9.81 m/s^2 along -z. Statics: the joint holds
the child up with 19.62 N along z and the moment (0, -5.886, 0) Nm about the joint. Second route: BodyNode.getBodyForce,
documented as the wrench transmitted from the parent. Third: a free body to which that wrench is applied stays at rest.
"""

import sys

import dartpy as dart
import numpy as np

MASS, G, COM = 2.0, 9.81, np.array([0.3, 0.0, 0.0])
inertia = dart.dynamics.Inertia(MASS, COM, 0.1 * np.eye(3))

skeleton = dart.dynamics.Skeleton()
skeleton.setGravity([0.0, 0.0, -G])
joint, body = skeleton.createWeldJointAndBodyNodePair()
body.setInertia(inertia)
skeleton.computeForwardDynamics()
force = np.array([0.0, 0.0, MASS * G])
expected = np.concatenate([np.cross(COM, force), force])
to_child, to_parent = np.array(joint.getWrenchToChildBodyNode()), np.array(joint.getWrenchToParentBodyNode())
body_force = np.array(body.getBodyForce())


def acceleration(wrench):
    """Largest acceleration of the same body, free under gravity and `wrench` about its origin."""
    free = dart.dynamics.Skeleton()
    free.setGravity([0.0, 0.0, -G])
    node = free.createFreeJointAndBodyNodePair()[1]
    node.setInertia(inertia)
    node.addExtTorque(wrench[:3])
    node.addExtForce(wrench[3:], np.zeros(3))
    free.computeForwardDynamics()
    return float(np.max(np.abs(free.getAccelerations())))


print(f"dartpy {dart.__version__}                   torque, force; acceleration of the body under it")
rows = {"statics, on the child": expected, "getBodyForce": body_force}
rows |= {"getWrenchToChildBodyNode": to_child, "getWrenchToParentBodyNode": to_parent}
for name, wrench in rows.items():
    print(f"{name:26s}", np.round(wrench + 0.0, 6), f"  {acceleration(wrench):.3g}")
shown = np.allclose(body_force, expected) and np.allclose(to_child, -expected) and np.allclose(to_parent, expected)
shown = shown and acceleration(expected) < 1e-12 and acceleration(to_child) > 1.0
print("the two names are exchanged" if shown else "as the names say")
sys.exit(0 if shown else 1)
