"""From what the solver computes at centres of mass to canonical observables."""

from __future__ import annotations

import numpy as np

from consilience.mechanism import Mechanism, State
from consilience.observe import reaction_map
from consilience.spatial import Array, rotation_from_quaternion


def at_origins(mechanism: Mechanism, y: Array, a: Array) -> tuple[Array, Array]:
    """Accelerations of the body origins and angular accelerations, world axes, from those of the solver.

    Parameters
    ----------
    y : ndarray, shape (n_b + n_e, 13)
    a : ndarray, shape (6 n_b,)
        (dv/dt, dw'/dt) of all bodies.
    """
    y = y[: len(mechanism.bodies)]
    A = rotation_from_quaternion(y[:, 3:7])
    a = a.reshape(-1, 6)
    alpha = np.einsum("bij,bj->bi", A, a[:, 3:])
    w = np.einsum("bij,bj->bi", A, y[:, 10:13])
    c = np.einsum("bij,bj->bi", A, np.array([b.com for b in mechanism.bodies]))
    return a[:, :3] - np.cross(alpha, c) - np.cross(w, np.cross(w, c)), alpha


def joint_wrenches(mechanism: Mechanism, state: State, lam: Array) -> Array:
    """Joint wrenches of multipliers: on the successor, at the origin of M, axes of F, shape (n_j, 6).

    Rows of drives, couplings and contacts stand behind those of the joints and are no part of their reactions.
    """
    wrenches, start = [], 0
    for joint in mechanism.joints:
        rows = slice(start, start + len(joint.rows))
        start = rows.stop
        wrenches.append(reaction_map(mechanism, state, joint) @ lam[rows])
    return np.array(wrenches)
