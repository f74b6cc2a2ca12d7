"""Pinocchio: `aba` loses digits exponentially along chains of ball joints; along chains of hinges it does not.

Accelerations of a chain of equal bodies, skew frames, no torque, by `aba`, and by the mass matrix of `crba` and the
bias of `nle`. Rounding may grow with the condition of the mass matrix, eps cond(M); `aba` is a million times beyond.

Second route: `rnea` of both answers. It gives the torque back (zero) for those of the mass matrix and not for `aba`'s.
"""

import sys

import numpy as np
import pinocchio as pin

EPS = np.finfo(float).eps


def chain(joint, count):
    """Bodies of 1.5 kg, each on the one before."""
    rng = np.random.default_rng(1)
    model, parent = pin.Model(), 0
    for n in range(count):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.4, size=3))
        parent = model.addJoint(parent, joint(), place, f"j{n}")
        inertia = pin.Inertia(1.5, rng.normal(scale=0.1, size=3), np.diag([0.2, 0.25, 0.3]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    return model


def errors(model):
    """Difference of `aba` to the mass matrix, eps cond(M), and torques that `rnea` gives back for both."""
    data, rng = model.createData(), np.random.default_rng(2)
    q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    v, tau = rng.normal(size=model.nv), np.zeros(model.nv)
    a = pin.aba(model, data, q, v, tau).copy()
    M = np.triu(pin.crba(model, data, q))
    M = M + np.triu(M, 1).T
    b = np.linalg.solve(M, tau - pin.nle(model, data, q, v))
    torques = [np.abs(pin.rnea(model, data, q, v, x)).max() for x in (a, b)]
    return np.abs(a - b).max() / np.abs(b).max(), EPS * np.linalg.cond(M), *torques


pin.seed(1)
print(f"pin {pin.__version__}")
found = {}
for name, joint in (("hinges", pin.JointModelRZ), ("balls", pin.JointModelSpherical)):
    for count in (10, 20, 30, 40, 50):
        off, expected, by_aba, by_mass = found[name, count] = errors(chain(joint, count))
        print(
            f"{count} {name}: aba off by {off:.1e}, expected {expected:.0e}; rnea gives {by_aba:.0e}, {by_mass:.0e} N m"
        )
off, expected, by_aba, by_mass = found["balls", 50]
shows = off > 1e3 * expected and by_aba > 1e3 * by_mass
fine = found["hinges", 50][0] < found["hinges", 50][1]
print("aba loses digits along balls" if shows and fine else "aba keeps its digits")
sys.exit(0 if shows and fine else 1)
