"""Exudyn: TorqueLocal of ObjectJointRevoluteZ is not the joint torque in the local frame of the joint.

A body of 2 kg is released at rest on a revolute joint about world z; its centre of mass c is 0.3 m along x and
0.5 m along z from the joint, gravity is along -y. Newton and Euler about the joint: I alpha = c x m g + t, alpha on z,
t without a part about z. With I the inertia about the joint that fixes alpha, then t, which lies along x. Second route:
Exudyn's own generalised reaction forces of the same joint at the same state, brought to a torque by 1/2 G.
"""

import os
import sys

os.environ["EXUDYN_NO_USER_SETTINGS"] = "1"

import exudyn as exu
import exudyn.itemInterface as ii  # noqa: N813 - Exudyn's own usual name
import numpy as np

exu.config.printToConsole = False
container = exu.SystemContainer()
mbs = container.AddSystem()
mass, g, com = 2.0, 9.81, np.array([0.3, 0.0, 0.5])
about_origin = np.diag([0.1, 0.12, 0.14]) + mass * (com @ com * np.eye(3) - np.outer(com, com))
node = mbs.AddNode(ii.NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, 1, 0, 0, 0]))
six = [about_origin[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
body = mbs.AddObject(ii.ObjectRigidBody(mass=mass, inertia=six, centerOfMass=com, nodeNumber=node))
mbs.AddLoad(
    ii.LoadMassProportional(markerNumber=mbs.AddMarker(ii.MarkerBodyMass(bodyNumber=body)), loadVector=[0, -g, 0])
)
ground = mbs.AddObject(ii.ObjectGround())
markers = [mbs.AddMarker(ii.MarkerBodyRigid(bodyNumber=b)) for b in (ground, body)]
joint = mbs.AddObject(ii.ObjectJointRevoluteZ(markerNumbers=markers))
mbs.Assemble()
settings = exu.SimulationSettings()
settings.timeIntegration.numberOfSteps = 1
settings.timeIntegration.endTime = 1e-6
settings.solution.file.write = False
mbs.SolveDynamic(settings)
force = np.array(mbs.GetObjectOutput(joint, exu.OutputVariableType.ForceLocal))
torque = np.array(mbs.GetObjectOutput(joint, exu.OutputVariableType.TorqueLocal))

alpha = -0.3 * mass * g / about_origin[2, 2]
expected = alpha * about_origin[:, 2] - np.cross(com, [0.0, -mass * g, 0.0])
generalised = np.array(mbs.ComputeItem(joint, exu.ComputeItemType.ReactionForces))[-7:]
second = 0.5 * np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) @ -generalised[3:]  # 1/2 G at the unit quaternion

print(f"exudyn {exu.__version__}")
print("torque on the body by Newton and Euler", np.round(expected, 4))
print("by Exudyn's generalised forces        ", np.round(second, 4))
print("TorqueLocal                           ", np.round(torque, 4))
print("ForceLocal                            ", np.round(force, 4))
agree = np.max(np.abs(second - expected)) < 1e-3
same = min(np.max(np.abs(torque - expected)), np.max(np.abs(torque + expected))) < 1e-3
print("as documented" if same else "not the torque, of either sign: the components are exchanged")
sys.exit(0 if agree and not same else 1)
