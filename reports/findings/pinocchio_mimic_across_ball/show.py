"""Pinocchio: crba is wrong where a joint of several degrees of freedom lies between a mimic joint and its primary.

A hinge, another joint, a hinge that mimics the first. The mass matrix is G' M G, with M of the model without the mimic.
With a slider in between it is right; with a ball, a planar joint or a translation the terms between the primary and
the joint in between are wrong, in both conventions and differently. Second route: the columns of rnea on the same
model, and the kinetic energy of the model without the mimic at the velocities that the gears give.
"""

import sys

import numpy as np
import pinocchio as pin

RATIO = -2.0
MIDDLE = {
    "slider": pin.JointModelPX,
    "hinge": pin.JointModelRX,
    "ball": pin.JointModelSpherical,
    "planar": pin.JointModelPlanar,
    "translation": pin.JointModelTranslation,
}


def compare(middle):
    """Errors of crba in both conventions, of the columns of rnea, and of the energy of the first by crba."""
    model, joint = pin.Model(), 0
    for n, kind in enumerate((pin.JointModelRZ, middle, pin.JointModelRZ)):
        joint = model.addJoint(joint, kind(), pin.SE3(np.eye(3), np.array([1.0, 0.2 * n, 0.1])), f"j{n}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.3, 0.1, 0.2]), np.eye(3)), pin.SE3.Identity())
    geared = pin.transformJointIntoMimic(model, 1, 3, RATIO, 0.0)
    q = pin.integrate(model, pin.neutral(model), np.linspace(0.1, 0.6, model.nv))
    q[-1] = RATIO * q[0]
    G = np.vstack([np.eye(model.nv - 1), RATIO * np.eye(model.nv - 1)[0]])
    expected = G.T @ np.array(pin.crba(model, model.createData(), q)) @ G
    found = [
        np.array(pin.crba(geared, geared.createData(), q[:-1], convention))
        for convention in (pin.Convention.LOCAL, pin.Convention.WORLD)
    ]
    data, zero = geared.createData(), np.zeros(geared.nv)
    bias = np.array(pin.rnea(geared, data, q[:-1], zero, zero))
    columns = [np.array(pin.rnea(geared, data, q[:-1], zero, e)) - bias for e in np.eye(geared.nv)]
    v = np.cos(1.0 + np.arange(geared.nv))
    energy = pin.computeKineticEnergy(model, model.createData(), q, G @ v)
    errors = [np.max(np.abs(M - expected)) for M in (*found, np.array(columns).T)]
    return *errors, abs(0.5 * v @ expected @ v - energy), abs(0.5 * v @ found[0] @ v - energy)


print(f"pin {pin.__version__}: errors of the mass matrix; of the kinetic energy, J")
print("in between    crba local  crba world  rnea        energy: expected  crba local")
results = {name: compare(middle) for name, middle in MIDDLE.items()}
for name, row in results.items():
    print(f"{name:12s}  " + "     ".join(f"{value:.1e}" for value in row))
right, wrong = [results[n] for n in ("slider", "hinge")], [results[n] for n in ("ball", "planar", "translation")]
shown = max(max(row) for row in right) < 1e-12 and min(min(row[:2]) for row in wrong) > 0.1
shown = shown and max(max(row[2:4]) for row in wrong) < 1e-12 and min(row[4] for row in wrong) > 0.01
print("a joint of several degrees of freedom in between spoils crba" if shown else "crba is right")
sys.exit(0 if shown else 1)
