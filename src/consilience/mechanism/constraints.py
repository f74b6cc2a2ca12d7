"""Constraint equations of a mechanism, its free directions, and the coordinates of its joints, in plain NumPy.

    g(p, R, t) = 0,   Q v = nu,   Q a = gamma

The unknowns are ``v = (v_WB_W, w_WB_W)`` and ``a = (a_WB_W, alpha_WB_W)`` of each body in turn, six columns a body:
velocity and acceleration of the body's *origin*, angular velocity and acceleration, all in axes of the world. Rows of
lengths are in m, of angles in rad, of direction cosines without unit.

Order of the rows: joints (`joint_rows`), drives, couplings, contacts of rolling bodies (`element_rows`); then the
non-holonomic rows, which have no value: slip of rolling bodies, skates. Redundant rows are kept.

Assembly, observables and adapters of engines without a closed-loop solver use these rows. The reference solver has
compiled rows of its own, which are tested against these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism.element_rows import Angles, ElementRow, holonomic_rows, non_holonomic_rows
from consilience.mechanism.joint_rows import (
    full_turns,
    joint_frames,
    row_gamma,
    row_jacobians,
    row_target,
    row_value,
    scatter,
    side,
)
from consilience.mechanism.joints import JOINT_KINDS
from consilience.mechanism.model import Joint, Mechanism, State
from consilience.mechanism.spatial import Array, cross, quaternion_from_rotation
from consilience.mechanism.units import characteristic_length

RANK_TOLERANCE = 1e-8
"""Singular values below this fraction of the largest count as zero: constraint rows off the manifold by a drift d
show their dependence only to d, and true ranks of sound mechanisms stay far above it."""


def _elements(mechanism: Mechanism, state: State, t: float, angles: Angles | None) -> list[ElementRow]:
    return holonomic_rows(mechanism, state, t, angles or {}) + non_holonomic_rows(mechanism, state)


def constraint_residual(mechanism: Mechanism, state: State, t: float = 0.0, angles: Angles | None = None) -> Array:
    """Return the violation g of every holonomic row, shape (holonomic_count,), in m, rad or dimensionless.

    A state has no count of turns: `angles` (see `count_turns`) are the previous angles of joints that drive a coupling.
    """
    values = []
    for joint in mechanism.joints:
        if joint.rows:
            frames = joint_frames(mechanism, state, joint)
            values += [row_value(frames, row) - row_target(joint, row) for row in joint.rows]
    values += [row.value for row in holonomic_rows(mechanism, state, t, angles or {})]
    return np.array(values)


def constraint_jacobian(
    mechanism: Mechanism,
    state: State,
    joints: tuple[Joint, ...] | None = None,
    t: float = 0.0,
    angles: Angles | None = None,
) -> Array:
    """Return the constraint Jacobian Q, shape (q, 6 n_b).

    Parameters
    ----------
    joints : tuple of Joint, optional
        Rows of these joints alone; default: all rows.
    t : float, s
        Time at which drives are evaluated.
    angles : mapping of joint name to float, rad, optional
        See `constraint_residual`.
    """
    blocks = [np.zeros((0, 6 * len(mechanism.bodies)))]
    for joint in mechanism.joints if joints is None else joints:
        if joint.rows:
            frames = joint_frames(mechanism, state, joint)
            blocks.append(scatter(mechanism, joint, row_jacobians(frames, joint.rows)))
    if joints is None:
        blocks += [row.Q[None] for row in _elements(mechanism, state, t, angles)]
    return np.vstack(blocks)


def constraint_rates(mechanism: Mechanism, t: float = 0.0) -> Array:
    """Return the right-hand side nu of ``Q v = nu``: rates of the drives, zero for every other row, shape (q,)."""
    rates = np.zeros(mechanism.constraint_count())
    first = sum(len(joint.rows) for joint in mechanism.joints)
    for n, drive in enumerate(mechanism.drives):
        rates[first + n] = drive.motion.at(t)[1]
    return rates


def constraint_gamma(
    mechanism: Mechanism,
    state: State,
    joints: tuple[Joint, ...] | None = None,
    t: float = 0.0,
    angles: Angles | None = None,
) -> Array:
    """Return the right-hand side gamma of ``Q a = gamma``, shape (q,).

    Parameters
    ----------
    joints, t, angles
        See `constraint_jacobian`.
    """
    values = []
    for joint in mechanism.joints if joints is None else joints:
        frames = joint_frames(mechanism, state, joint)
        values += [row_gamma(frames, row) for row in joint.rows]
    if joints is None:
        values += [row.gamma for row in _elements(mechanism, state, t, angles)]
    return np.array(values)


def row_sizes(mechanism: Mechanism) -> Array:
    """Return the size of each constraint row, shape (q,): the characteristic length for rows in m, one for others."""
    lengths = [row[0] != "D" for joint in mechanism.joints for row in joint.rows]
    lengths += [drive.coordinate == "distance" for drive in mechanism.drives]
    lengths += [coupling.coordinate == "distance" for coupling in mechanism.couplings]
    lengths += [True] * (mechanism.constraint_count() - len(lengths))  # contact and slip of rolling bodies, skates
    return np.where(lengths, characteristic_length(mechanism), 1.0)


def velocity_sizes(mechanism: Mechanism) -> Array:
    """Return the size of each component of all body velocities, shape (6 n_b,): characteristic length, and one."""
    return np.tile(np.repeat([characteristic_length(mechanism), 1.0], 3), len(mechanism.bodies))


def scaled_jacobian(mechanism: Mechanism, state: State, t: float = 0.0) -> Array:
    """Return the constraint Jacobian with lengths counted in characteristic lengths, shape (q, 6 n_b).

    Its rank does not depend on the unit of length.
    """
    return constraint_jacobian(mechanism, state, t=t) * velocity_sizes(mechanism) / row_sizes(mechanism)[:, None]


def free_directions(mechanism: Mechanism, state: State, holonomic: bool = False, t: float = 0.0) -> Array:
    """Return an orthonormal basis of the velocities that the constraints allow, shape (6 n_b, freedom).

    With `holonomic`, a basis of the allowed displacements: non-holonomic rows constrain velocities, not positions.
    """
    Q = scaled_jacobian(mechanism, state, t)
    basis = null_space(Q[: mechanism.holonomic_count] if holonomic else Q)
    return np.linalg.qr(velocity_sizes(mechanism)[:, None] * basis)[0]


def null_space(A: Array) -> Array:
    """Return an orthonormal basis of the null space of a matrix (m, n) as columns, shape (n, n - rank)."""
    if 0 in A.shape:
        return np.eye(A.shape[1])
    _, singular, Vt = np.linalg.svd(A)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    return np.ascontiguousarray(Vt[rank:].T)


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """Motion of frame M relative to frame F, in axes of F.

    Attributes
    ----------
    p : ndarray, shape (3,), m
    R : ndarray, shape (3, 3)
    v : ndarray, shape (3,), m/s
        Rate of `p` seen from F.
    w : ndarray, shape (3,), rad/s
        Angular velocity of M relative to F.
    """

    p: Array
    R: Array
    v: Array
    w: Array


def relative_motion(mechanism: Mechanism, state: State, joint: Joint) -> RelativeMotion:
    """Return pose and twist of frame M relative to frame F of a joint."""
    f = joint_frames(mechanism, state, joint)
    return RelativeMotion(f.U.T @ f.d, f.U.T @ f.W, f.U.T @ (f.d_dot - cross(f.w_i, f.d)), f.U.T @ (f.w_j - f.w_i))


def joint_coordinates(joint: Joint, motion: RelativeMotion) -> dict[str, Array]:
    """Return the joint coordinates of M relative to F by the names of `JOINT_KINDS`.

    Angles are in (-pi, pi], but that of a screw counts the turns of the displacement.

    Universal: ``R = Rz(angle1) Rx(angle2)``; orientation: quaternion, scalar first.
    """
    R, p = motion.R, motion.p
    angle = float(np.arctan2(R[1, 0], R[0, 0]))
    values = {
        "angle": full_turns(angle, 2 * np.pi * p[2] / joint.pitch) if joint.pitch else angle,
        "distance": p[2],
        "x": p[0],
        "y": p[1],
        "angle1": np.arctan2(R[1, 0], R[0, 0]),
        "angle2": np.arctan2(R[2, 1], R[2, 2]),
        "position": p,
    }
    names = JOINT_KINDS[joint.kind].coordinates
    found = {n: np.asarray(values[n]) for n in names if n != "orientation"}
    if "orientation" in names:
        found["orientation"] = quaternion_from_rotation(R)
    return found


def joint_rates(joint: Joint, motion: RelativeMotion) -> dict[str, Array]:
    """Return the rates of the joint coordinates; of an orientation, the angular velocity of M relative to F in F."""
    R, v, w = motion.R, motion.v, motion.w
    values = {
        "angle": w[2],
        "distance": v[2],
        "x": v[0],
        "y": v[1],
        "angle1": w[2],  # w = angle1' z_F + angle2' x_M, and x_M has no z component
        "angle2": R[:, 0] @ w,
        "position": v,
        "orientation": w,
    }
    return {n: np.asarray(values[n]) for n in JOINT_KINDS[joint.kind].coordinates}


def reaction_in_F(
    mechanism: Mechanism,
    state: State,
    joint: Joint,
    force_W: Array,
    torque_W: Array,
    point_W: Array,
    on_predecessor: bool = False,
) -> tuple[Array, Array]:
    """Bring a joint wrench into the one convention: on the successor, at the origin of M, in axes of F.

    Parameters
    ----------
    joint : Joint
    force_W, torque_W : ndarray, shape (3,), N and N m
        Wrench in world axes, the torque about `point_W`.
    point_W : ndarray, shape (3,), m
    on_predecessor : bool
        The wrench is exerted on the predecessor: its sign is reversed.

    Returns
    -------
    force_F, torque_F : ndarray, shape (3,)
    """
    U, _, p_F, _, _ = side(mechanism, state, joint.predecessor, joint.F)
    p_M = p_F + joint_frames(mechanism, state, joint).d
    sign = -1.0 if on_predecessor else 1.0
    torque_at_M = torque_W + cross(point_W - p_M, force_W)
    return sign * (U.T @ force_W), sign * (U.T @ torque_at_M)
