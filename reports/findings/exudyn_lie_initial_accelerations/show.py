"""Exudyn: initial accelerations of a constrained body on a NodeRigidBodyRotVecLG are wrong by per cents once it turns.

A body on a spherical joint, turned by 1 rad, w = (1, -2, 1.5) rad/s in its own axes. Euler's equation about the joint,
I alpha = c x R^T m g - w x I w, gives alpha. The same body on a NodeRigidBodyEP agrees with it to 1e-7. Second route:
with w = 0, or with a rotation vector of zero, the rotation-vector node is right too: only the convective term is wrong.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

exu.config.printToConsole = False
MASS, GRAVITY = 2.0, np.array([0.0, 0.0, -9.81])
COM, POINT = np.array([0.3, 0.1, -0.2]), np.array([-0.4, 0.2, 0.1])  # centre of mass and joint, from the body's origin
AXIS, SPIN = np.array([0.6, -0.48, 0.64]), np.array([1.0, -2.0, 1.5])


def steiner(c):
    """Moment of inertia of the mass at c."""
    return MASS * (c @ c * np.eye(3) - np.outer(c, c))


INERTIA = np.diag([0.3, 0.4, 0.5])  # about the centre of mass


def rotation(vector):
    """Rotation matrix by Rodrigues."""
    angle = np.linalg.norm(vector)
    K = np.cross(np.eye(3), vector / max(angle, 1e-300))
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def euler_node(p, v, r, w):
    """Node with Euler parameters e: de/dt = 1/2 G^T w."""
    angle = np.linalg.norm(r)
    e = np.array([np.cos(angle / 2), *(np.sin(angle / 2) * AXIS)])
    G = np.array([[-e[1], e[0], e[3], -e[2]], [-e[2], -e[3], e[0], e[1]], [-e[3], e[2], -e[1], e[0]]])
    return ii.NodeRigidBodyEP(referenceCoordinates=[*p, *e], initialVelocities=[*v, *(0.5 * G.T @ w)])


def lie_node(p, v, r, w):
    """Node with a rotation vector, on the Lie group: its velocity is w."""
    return ii.NodeRigidBodyRotVecLG(referenceCoordinates=[*p, *r], initialVelocities=[*v, *w])


def relative_error(make_node, r, w):
    """Error of the initial angular acceleration relative to Euler's equation."""
    R, container = rotation(r), exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(make_node(-R @ POINT, R @ np.cross(w, -POINT), r, w))
    I = INERTIA + steiner(COM)
    six = [I[0, 0], I[1, 1], I[2, 2], I[1, 2], I[0, 2], I[0, 1]]
    body = mbs.AddObject(ii.ObjectRigidBody(mass=MASS, inertia=six, centerOfMass=COM, nodeNumber=node))
    at_mass = mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=body))
    mbs.AddLoad(ii.LoadMassProportional(markerNumber=at_mass, loadVector=GRAVITY))
    ends = [(mbs.AddObject(ii.ObjectGround()), np.zeros(3)), (body, POINT)]
    markers = [mbs.AddMarker(ii.MarkerBodyRigid(bodyNumber=b, localPosition=p)) for b, p in ends]
    mbs.AddObject(ii.ObjectJointSpherical(markerNumbers=markers))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    exu.MainSolverImplicitSecondOrder().InitializeSolver(mbs, settings)
    observed = np.array(mbs.GetObjectOutputBody(body, exu.OutputVariableType.AngularAcceleration, [0, 0, 0]))
    about_joint, c = INERTIA + steiner(COM - POINT), COM - POINT
    moment = np.cross(c, R.T @ (MASS * GRAVITY)) - np.cross(w, about_joint @ w)
    expected = R @ np.linalg.solve(about_joint, moment)
    return float(np.max(np.abs(observed - expected)) / np.max(np.abs(expected)))


print(f"exudyn {exu.__version__}: error of the initial angular acceleration, relative to Euler's equation")
print("turned by   w       Euler parameters   rotation vector, Lie group")
found = {}
for angle, w in ((0.0, SPIN), (0.1, SPIN), (0.5, SPIN), (1.0, SPIN), (2.0, SPIN), (1.0, 0.0 * SPIN)):
    both = [relative_error(node, angle * AXIS, w) for node in (euler_node, lie_node)]
    found[angle, bool(w.any())] = both
    print(f"{angle:4.1f} rad    {'spins' if w.any() else 'rests'}       {both[0]:.1e}            {both[1]:.1e}")
shown = all(euler < 1e-6 for euler, _ in found.values()) and found[1.0, True][1] > 1e-2
shown = shown and found[0.0, True][1] < 1e-6 and found[1.0, False][1] < 1e-6
print("wrong on the rotation-vector node only" if shown else "right, or wrong in another way")
sys.exit(0 if shown else 1)
