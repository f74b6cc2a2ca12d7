"""Conversion of solver quantities, at centres of mass, to canonical ones, at body origins; checks of sample times."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import InvalidInput
from consilience.mechanism import Array, Mechanism, State, float_array, reaction_map, rotation_from_quaternion
from consilience.reference.kernel.compiled import kernel
from consilience.reference.kernel.vectors import cross, load, rotate, store, sub


def sample_times(times: ArrayLike) -> Array:
    """Return the sample times as floats; refuse what are no numbers, not finite or do not increase.

    Raises
    ------
    InvalidInput
    """
    remedy = "Give finite, increasing sample times in s."
    found = float_array(times, "times", remedy)
    if found.ndim != 1:
        raise InvalidInput("times", f"they have shape {found.shape}", remedy)
    if not _increase(found):
        raise InvalidInput("times", "they do not increase", remedy)
    return found


@kernel
def _increase(times: Array) -> bool:
    """Return whether there are times, finite and increasing; in NumPy this takes as long as a short motion."""
    last = -np.inf
    for n in range(times.shape[0]):
        if not last < times[n]:
            return False
        last = times[n]
    return -np.inf < last < np.inf


def at_origins(mechanism: Mechanism, y: Array, a: Array) -> tuple[Array, Array]:
    """Convert accelerations (dv/dt, dw'/dt), shape (6 n_b,), at y to a_WB_W and alpha_WB_W, each shape (n_b, 3)."""
    y = y[: len(mechanism.bodies)]
    A = rotation_from_quaternion(y[:, 3:7])
    a = a.reshape(-1, 6)
    alpha = np.einsum("bij,bj->bi", A, a[:, 3:])
    w = np.einsum("bij,bj->bi", A, y[:, 10:13])
    c = np.einsum("bij,bj->bi", A, np.array([b.com for b in mechanism.bodies]))
    return a[:, :3] - np.cross(alpha, c) - np.cross(w, np.cross(w, c)), alpha


def joint_wrenches(mechanism: Mechanism, state: State, lam: Array) -> Array:
    """Convert multipliers to joint reactions: on the successor, at the origin of M, axes of F, shape (n_j, 6).

    Multipliers of drives, couplings and contacts follow those of the joints and are not part of the reactions.
    """
    wrenches, start = [], 0
    for joint in mechanism.joints:
        rows = slice(start, start + len(joint.rows))
        start = rows.stop
        wrenches.append(reaction_map(mechanism, state, joint) @ lam[rows])
    return np.array(wrenches).reshape(-1, 6)


def canonical_motion(com: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Convert a motion y, shape (n_t, n_b + n_e, 13), to p_WB, quat_WB, v_WB_W, w_WB_W, quaternions continuous in time.

    com: centres of mass in body frames, shape (n_b, 3), m. The compiled equivalent of `unpack`.
    """
    shape = (len(y), len(com))
    p, quat, v, w = np.empty((*shape, 3)), np.empty((*shape, 4)), np.empty((*shape, 3)), np.empty((*shape, 3))
    _canonical(com, y, np.empty((3, 3)), p, quat, v, w)
    return p, quat, v, w


@kernel
def _canonical(com: Array, y: Array, A: Array, p: Array, quat: Array, v: Array, w: Array) -> None:
    """Write the canonical motion of packed states; the compiled equivalent of `unpack` [MASS (2)].

    Parameters
    ----------
    com : ndarray, shape (n_b, 3), m
        Centres of mass in body axes.
    y : ndarray, shape (n_t, n_b + n_e, 13)
    A : ndarray, shape (3, 3)
        Work array for the rotation matrix of one body.
    p, quat, v, w : ndarray, shape (n_t, n_b, 3 or 4)
        Overwritten.
    """
    for b in range(com.shape[0]):
        for n in range(y.shape[0]):
            e0, e1, e2, e3 = y[n, b, 3], y[n, b, 4], y[n, b, 5], y[n, b, 6]
            A[0, 0] = e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3
            A[1, 1] = e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3
            A[2, 2] = e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3
            A[0, 1], A[1, 0] = 2 * (e1 * e2 - e0 * e3), 2 * (e1 * e2 + e0 * e3)
            A[0, 2], A[2, 0] = 2 * (e1 * e3 + e0 * e2), 2 * (e1 * e3 - e0 * e2)
            A[1, 2], A[2, 1] = 2 * (e2 * e3 - e0 * e1), 2 * (e2 * e3 + e0 * e1)
            c, spin = rotate(A, load(com[b])), rotate(A, load(y[n, b, 10:13]))
            store(p[n, b], sub(load(y[n, b, 0:3]), c), 1.0)
            store(v[n, b], sub(load(y[n, b, 7:10]), cross(spin, c)), 1.0)
            store(w[n, b], spin, 1.0)
            near = e0 if n == 0 else 0.0
            if n > 0:
                for k in range(4):
                    near += quat[n - 1, b, k] * y[n, b, 3 + k]
            for k in range(4):
                quat[n, b, k] = -y[n, b, 3 + k] if near < 0.0 else y[n, b, 3 + k]
