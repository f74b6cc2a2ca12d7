"""Pinocchio: joints that are not added depth first give a wrong mass matrix, silently.

A tree of four joints with the parents 0, 1, 1, 2, breadth first. Expected mass matrix, column by column: rnea with a
unit acceleration less rnea with none. Second route: the kinetic energy, which Pinocchio sums body by body, is
1/2 v^T M v. The same tree added depth first is right, and aba is right in both.
"""

import sys

import numpy as np
import pinocchio as pin

JOINTS = (pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelRX())
PARENT = (None, 0, 0, 1)  # in the numbering of the bodies, not of Pinocchio
INERTIAS = [pin.Inertia(1.0 + i, np.array([0.1, 0.2, 0.3]), 0.1 * np.eye(3)) for i in range(4)]


def measure(order):
    """Errors of crba, computeMinverse and aba, and that of the kinetic energy by crba; the answer of `check`."""
    model, index = pin.Model(), {}
    for body in order:
        parent = 0 if PARENT[body] is None else index[PARENT[body]]
        placement = pin.SE3(np.eye(3), np.array([0.3, 0.1 * body, 0.2]))
        index[body] = model.addJoint(parent, JOINTS[body], placement, str(body))
        model.appendBodyToJoint(index[body], INERTIAS[body], pin.SE3.Identity())
    data = model.createData()
    rows = [model.idx_vs[index[body]] for body in range(4)]
    q, v, tau = np.zeros((3, 4))
    q[rows], v[rows], tau[rows] = np.random.default_rng(1).normal(size=(3, 4))
    zero = np.zeros(4)
    rest = pin.rnea(model, data, q, zero, zero).copy()
    expected = np.array([pin.rnea(model, data, q, zero, unit) - rest for unit in np.eye(4)]).T
    M = pin.crba(model, data, q).copy()
    inverse = pin.computeMinverse(model, data, q).copy()
    a = pin.aba(model, data, q, v, tau).copy()
    energy = pin.computeKineticEnergy(model, data, q, v)
    return {
        "crba": np.max(np.abs(M - expected)),
        "computeMinverse": np.max(np.abs(inverse - np.linalg.inv(expected))),
        "energy, 1/2 v^T M v": abs(0.5 * v @ M @ v - energy),
        "aba": np.max(np.abs(pin.rnea(model, data, q, v, a) - tau)),
    }, model.check(data)


breadth, breadth_check = measure((0, 1, 2, 3))
depth, depth_check = measure((0, 1, 3, 2))
print(f"pin {pin.__version__}: error, expected 0")
print(f"{'':22s} breadth first   depth first")
for name, error in breadth.items():
    print(f"{name:22s} {error:10.1e}      {depth[name]:10.1e}")
print(f"{'Model.check':22s} {breadth_check!s:>10s}      {depth_check!s:>10s}")
wrong = all(error > 0.01 for name, error in breadth.items() if name != "aba")
shown = wrong and breadth["aba"] < 1e-12 and max(depth.values()) < 1e-12 and depth_check and not breadth_check
sys.exit(0 if shown else 1)
