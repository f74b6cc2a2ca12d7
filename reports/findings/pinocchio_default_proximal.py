"""Pinocchio: constraintDynamics with default proximal settings gives NaN, without an error, for redundant loops.

A planar four-bar whose last link is welded to the ground frame it meets: six rows of rank three. The accelerations are
unique; proximal settings other than the default (mu > 0, several iterations) give them.
"""

import sys

import numpy as np
import pinocchio as pin

rng = np.random.default_rng(1)
turn = pin.exp3(np.array([0.3, -0.7, 0.4]))  # a plane in no special position


def four_bar(angle):
    """Crank at `angle`; links 0.5, 1.2, 0.9, ground 1.1; closed by a weld of the rocker's end to its ground pivot."""
    crank, coupler, rocker, ground = 0.5, 1.2, 0.9, 1.1
    b = crank * np.array([np.cos(angle), np.sin(angle)])
    d = np.array([ground, 0.0]) - b
    length = np.hypot(*d)
    turn_to_d = np.arctan2(d[1], d[0])
    inner = np.arccos((coupler**2 + length**2 - rocker**2) / (2 * coupler * length))
    q2 = turn_to_d + inner
    c = b + coupler * np.array([np.cos(q2), np.sin(q2)])
    q3 = np.arctan2(-c[1], ground - c[0])
    return np.array([angle, q2 - angle, q3 - q2, -q3])


model = pin.Model()
model.gravity = pin.Motion(turn @ np.array([0.0, -9.81, 0.0]), np.zeros(3))
parent, placement = 0, pin.SE3(turn, np.zeros(3))
for name, length in (("crank", 0.5), ("coupler", 1.2), ("rocker", 0.9), ("base", 0.0)):
    parent = model.addJoint(parent, pin.JointModelRZ(), placement, name)
    inertia = pin.Inertia(1.0, np.array([length / 2, 0, 0]), np.diag([0.01, 0.1, 0.1]))
    model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    placement = pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
pivot = pin.SE3(turn, turn @ np.array([1.1, 0.0, 0.0]))
weld = pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, parent, pin.SE3.Identity(), 0, pivot, pin.LOCAL)
models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
models.append(weld)
datas.append(weld.createData())
data = model.createData()
pin.initConstraintDynamics(model, data, models, datas)


def accelerations(q, settings):
    """Joint accelerations at rest."""
    zero = np.zeros(model.nv)
    return np.array(pin.constraintDynamics(model, data, q, zero, zero, models, datas, settings))


angles = np.linspace(0.3, 2.5, 200)
default = [accelerations(four_bar(a), pin.ProximalSettings()) for a in angles]
proximal = [accelerations(four_bar(a), pin.ProximalSettings(1e-14, 1e-6, 20)) for a in angles]
bad = sum(not np.all(np.isfinite(a)) for a in default)
worst = max(np.max(np.abs(a - b)) for a, b in zip(default, proximal, strict=True) if np.all(np.isfinite(a)))
print(f"pin {pin.__version__}: {bad} of {len(angles)} poses give NaN with the default settings, none with mu = 1e-6:")
print(f"all finite there: {np.all(np.isfinite(proximal))}; where both are finite they differ by at most {worst:.1e}")
sys.exit(0 if bad and np.all(np.isfinite(proximal)) else 1)
