"""Pinocchio: RigidConstraintModel.desired_contact_acceleration does nothing.

A free body, its frame held to the world by a constraint of six rows, at rest, without forces. Asked for an acceleration
of the contact, constraintDynamics should give the body just that, for the constraint fixes all six components. Set in
the model, "Desired contact spatial acceleration", it gives zero. Second route: the same value in
RigidConstraintData.contact_acceleration_desired is followed exactly; and the force for it is M a, by rnea.
"""

import sys

import numpy as np
import pinocchio as pin

model = pin.Model()
joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
model.appendBodyToJoint(joint, pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.eye(3)), pin.SE3.Identity())
model.gravity = pin.Motion.Zero()
data = model.createData()
models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
models.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, joint, pin.SE3.Identity(), pin.LOCAL))
datas.append(models[0].createData())
pin.initConstraintDynamics(model, data, models, datas)
q, zero = pin.neutral(model), np.zeros(model.nv)
asked = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def accelerations():
    """Accelerations and the contact force."""
    settings = pin.ProximalSettings(1e-14, 1e-10, 100)
    found = np.array(pin.constraintDynamics(model, data, q, zero, zero, models, datas, settings))
    return found, np.array(datas[0].contact_force.vector)


print(f"pin {pin.__version__}: accelerations, asked for {asked}")
models[0].desired_contact_acceleration = pin.Motion(asked)
in_model, _ = accelerations()
print("set in the model", np.round(in_model, 12) + 0.0)
datas[0].contact_acceleration_desired = pin.Motion(asked)
in_data, force = accelerations()
print("set in the data ", np.round(in_data, 12))
needed = np.array(pin.rnea(model, model.createData(), q, zero, asked))
print("force           ", np.round(force, 9))
print("force by rnea   ", np.round(needed, 9))
shown = np.max(np.abs(in_model)) < 1e-12 and np.max(np.abs(in_data - asked)) < 1e-10
shown = shown and np.max(np.abs(force - needed)) < 1e-8
print("what the model asks for is ignored" if shown else "what the model asks for is followed")
sys.exit(0 if shown else 1)
