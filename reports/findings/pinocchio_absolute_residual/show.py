"""Pinocchio: ProximalSettings.absolute_residual of constraintDynamics is not the residual of the constraint.

A spatial four-bar (revolute, ball, ball, revolute; no dependent rows). After convergence the loop closes at the level
of accelerations, J a + gamma = 0 to rounding, with the Jacobian and the drift that Pinocchio's kinematics give; the
field reports metres per second squared. Second route: the accelerations are those of the KKT system solved by NumPy.
The test "absolute_residual <= absolute_accuracy" can therefore never stop the iteration.
"""

import sys

import numpy as np
import pinocchio as pin

model = pin.Model()
rods = [pin.Inertia(1.0, np.array([length / 2, 0, 0]), np.diag([0.01, 0.1, 0.1])) for length in (0.5, 1.2, 0.9)]
crank = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "crank")
coupler = model.addJoint(crank, pin.JointModelSpherical(), pin.SE3(np.eye(3), np.array([0.5, 0, 0])), "coupler")
pivot = pin.SE3(pin.exp3(np.array([0.9, 0.2, 0.1])), np.array([1.0, 0.3, 0.2]))
rocker = model.addJoint(0, pin.JointModelRZ(), pivot, "rocker")
for joint, rod in zip((crank, coupler, rocker), rods, strict=True):
    model.appendBodyToJoint(joint, rod, pin.SE3.Identity())
data = model.createData()
q = pin.normalize(model, np.array([0.4, 0.1, 0.2, 0.15, 0.8, -1.1]))
pin.forwardKinematics(model, data, q)
pin.computeJointJacobians(model, data, q)
END = np.array([0.9, 0.0, 0.0])  # of the rocker; the point of the coupler that lies there closes the loop
POINTS = {coupler: data.oMi[coupler].actInv(data.oMi[rocker].act(END)), rocker: END}
zero = np.zeros(model.nv)


def jacobian(joint):
    """Jacobian of the closing point of a body, world axes."""
    J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
    return J[:3] - pin.skew(data.oMi[joint].rotation @ POINTS[joint]) @ J[3:]


def drift(joint):
    """Acceleration of the closing point of a body at zero joint accelerations, world axes."""
    at_point = pin.SE3(np.eye(3), POINTS[joint])
    v, a = at_point.actInv(data.v[joint]), at_point.actInv(data.a[joint])
    return data.oMi[joint].rotation @ (a.linear + np.cross(v.angular, v.linear))


J = jacobian(coupler) - jacobian(rocker)
v = np.linalg.svd(J)[2][3:].T @ np.array([1.0, 0.5])
pin.forwardKinematics(model, data, q, v, zero)
gamma = drift(coupler) - drift(rocker)
M, b = pin.crba(model, data, q).copy(), pin.nle(model, data, q, v).copy()
KKT = np.block([[M, J.T], [J, np.zeros((3, 3))]])
expected = np.linalg.solve(KKT, -np.concatenate([b, gamma]))[: model.nv]

models = pin.StdVec_RigidConstraintModel()
frames = [pin.SE3(np.eye(3), POINTS[joint]) for joint in (coupler, rocker)]
kind = pin.ContactType.CONTACT_3D
models.append(pin.RigidConstraintModel(kind, model, coupler, frames[0], rocker, frames[1], pin.LOCAL))


datas = pin.StdVec_RigidConstraintData()
datas.append(models[0].createData())
pin.initConstraintDynamics(model, data, models, datas)
print(f"pin {pin.__version__}: expected absolute_residual about 1e-15, as |J a + gamma|")
print("mu       iterations  absolute_residual  |J a + gamma|  error of the accelerations")
rows = []
for mu in (1e-2, 1e-4, 1e-6):
    settings = pin.ProximalSettings(1e-12, mu, 100)
    a = np.array(pin.constraintDynamics(model, data, q, v, zero, models, datas, settings))
    error = np.max(np.abs(a - expected)) / np.max(np.abs(expected))
    rows.append((settings.absolute_residual, np.max(np.abs(J @ a + gamma)), error))
    print(f"{mu:.0e}   {settings.iter:6d}      {rows[-1][0]:12.4f}       {rows[-1][1]:.1e}        {error:.1e}")
shown = all(reported > 1e-3 and true < 1e-10 and error < 1e-10 for reported, true, error in rows)
sys.exit(0 if shown else 1)
