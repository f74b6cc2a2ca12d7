"""Joint kinematics from poses and velocities: residuals, Jacobian rows, gamma and joint coordinates.

Plain NumPy, on body *origins* and world angular velocities, for whoever looks at a mechanism from outside: assembly,
the observers, and adapters of engines that bring no closed-loop solver. The reference solver has compiled rows of
its own about the *centres of mass*; the two are tested against each other.

Row formulas: formulations section 4, from ``(X, Y, Z) = U^T d``, ``L = |d|``, ``D_kl = u_k . w_l`` [MASS (9)-(12)].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import GROUND, JOINT_KINDS, Frame, Joint, Mechanism, State
from consilience.spatial import Array, cross, quaternion_from_rotation, rotation_from_quaternion

RANK_TOLERANCE = 1e-8
"""Singular values below this fraction of the largest count as zero: constraint rows off the manifold by a drift d
show their dependence only to d, and true ranks of sound mechanisms stay far above it."""


@dataclass(frozen=True, eq=False)
class JointFrames:
    """Frames F and M of one joint in the world, with the arms from the body origins.

    Attributes
    ----------
    U, W : ndarray, shape (3, 3)
        Axes of F and of M as columns, in world components.
    s_i, s_j : ndarray, shape (3,), m
        From the origin of the predecessor (successor) to the origin of F (M), in world axes.
    d : ndarray, shape (3,), m
        From the origin of F to the origin of M, in world axes.
    v_i, w_i, v_j, w_j : ndarray, shape (3,)
        Velocities of the two bodies.
    """

    U: Array
    W: Array
    s_i: Array
    s_j: Array
    d: Array
    v_i: Array
    w_i: Array
    v_j: Array
    w_j: Array

    @property
    def d_dot(self) -> Array:
        """Velocity of the origin of M relative to that of F, in world axes."""
        return self.v_j + cross(self.w_j, self.s_j) - self.v_i - cross(self.w_i, self.s_i)

    @property
    def centripetal(self) -> Array:
        """Part of the relative acceleration of the origins that is quadratic in the angular velocities."""
        w_i, w_j = self.w_i, self.w_j
        return cross(w_j, cross(w_j, self.s_j)) - cross(w_i, cross(w_i, self.s_i))


def _side(mechanism: Mechanism, state: State, body: str, frame: Frame) -> tuple[Array, Array, Array, Array, Array]:
    if body == GROUND:
        return frame.R, frame.p, frame.p, np.zeros(3), np.zeros(3)
    i = mechanism.body_index[body]
    R_WB = rotation_from_quaternion(state.quat_WB[i])
    s = R_WB @ frame.p
    return R_WB @ frame.R, s, state.p_WB[i] + s, state.v_WB_W[i], state.w_WB_W[i]


def joint_frames(mechanism: Mechanism, state: State, joint: Joint) -> JointFrames:
    """Place the frames of `joint` in the world."""
    U, s_i, p_F, v_i, w_i = _side(mechanism, state, joint.predecessor, joint.F)
    W, s_j, p_M, v_j, w_j = _side(mechanism, state, joint.successor, joint.M)
    return JointFrames(U, W, s_i, s_j, p_M - p_F, v_i, w_i, v_j, w_j)


def row_value(frames: JointFrames, row: str) -> float:
    """Value of a basic constraint function."""
    if row in "XYZ":
        return float(frames.U[:, "XYZ".index(row)] @ frames.d)
    if row == "L":
        return float(np.linalg.norm(frames.d))
    return float(frames.U[:, int(row[1]) - 1] @ frames.W[:, int(row[2]) - 1])


def row_jacobian(frames: JointFrames, row: str) -> Array:
    """Coefficients of ``(v_i, w_i, v_j, w_j)`` in the rate of a basic constraint, shape (12,)."""
    if row[0] == "D":
        normal = cross(frames.U[:, int(row[1]) - 1], frames.W[:, int(row[2]) - 1])
        return np.concatenate([np.zeros(3), normal, np.zeros(3), -normal])
    if row == "L":
        e = frames.d / np.linalg.norm(frames.d)
        return np.concatenate([-e, -cross(frames.s_i, e), e, cross(frames.s_j, e)])
    u = frames.U[:, "XYZ".index(row)]
    return np.concatenate([-u, -cross(frames.s_i + frames.d, u), u, cross(frames.s_j, u)])


def row_gamma(frames: JointFrames, row: str) -> float:
    """Right-hand side of the acceleration equation ``Q a = gamma`` of a basic constraint held constant."""
    w_i, w_j, d_dot = frames.w_i, frames.w_j, frames.d_dot
    if row[0] == "D":
        u, w = frames.U[:, int(row[1]) - 1], frames.W[:, int(row[2]) - 1]
        u_dot, w_dot = cross(w_i, u), cross(w_j, w)
        return -float(cross(w_i, u_dot) @ w + 2 * u_dot @ w_dot + u @ cross(w_j, w_dot))
    if row == "L":
        L = np.linalg.norm(frames.d)
        e = frames.d / L
        return -float((d_dot @ d_dot - (e @ d_dot) ** 2) / L + e @ frames.centripetal)
    u = frames.U[:, "XYZ".index(row)]
    u_dot = cross(w_i, u)
    return -float(cross(w_i, u_dot) @ frames.d + 2 * u_dot @ d_dot + u @ frames.centripetal)


def row_target(joint: Joint, row: str) -> float:
    """Value at which the joint holds the row: the rod its length, every other row zero."""
    return joint.length if row == "L" else 0.0


def _place(mechanism: Mechanism, joint: Joint, pairs: Array, width: int) -> Array:
    """Scatter the (rows, 12) coefficients of one joint into (rows, 6 n_b) columns [v, w] per body."""
    Q = np.zeros((len(pairs), width))
    for body, columns in ((joint.predecessor, pairs[:, :6]), (joint.successor, pairs[:, 6:])):
        if body != GROUND:
            i = mechanism.body_index[body]
            Q[:, 6 * i : 6 * i + 6] = columns
    return Q


def constraint_residual(mechanism: Mechanism, state: State) -> Array:
    """Violation g of every joint row, in the order of joints and rows, shape (q,) in m or dimensionless."""
    values = []
    for joint in mechanism.joints:
        frames = joint_frames(mechanism, state, joint)
        values += [row_value(frames, row) - row_target(joint, row) for row in joint.rows]
    return np.array(values)


def constraint_jacobian(mechanism: Mechanism, state: State, joints: tuple[Joint, ...] | None = None) -> Array:
    """Jacobian Q of the joint rows with respect to ``(v_WB_W, w_WB_W)`` of each body, shape (q, 6 n_b)."""
    width = 6 * len(mechanism.bodies)
    blocks = [np.zeros((0, width))]
    for joint in mechanism.joints if joints is None else joints:
        if joint.rows:
            frames = joint_frames(mechanism, state, joint)
            pairs = np.array([row_jacobian(frames, row) for row in joint.rows])
            blocks.append(_place(mechanism, joint, pairs, width))
    return np.vstack(blocks)


def constraint_gamma(mechanism: Mechanism, state: State, joints: tuple[Joint, ...] | None = None) -> Array:
    """Right-hand side gamma of ``Q a = gamma``, accelerations of the body origins, shape (q,)."""
    values = []
    for joint in mechanism.joints if joints is None else joints:
        frames = joint_frames(mechanism, state, joint)
        values += [row_gamma(frames, row) for row in joint.rows]
    return np.array(values)


def free_directions(mechanism: Mechanism, state: State) -> Array:
    """Orthonormal basis of the null space of Q: motions the joints allow, shape (6 n_b, freedom)."""
    Q = constraint_jacobian(mechanism, state)
    if len(Q) == 0:
        return np.eye(Q.shape[1])
    _, singular, Vt = np.linalg.svd(Q)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    return np.ascontiguousarray(Vt[rank:].T)


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """Motion of M relative to F, in axes of F.

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
    """Pose and twist of frame M relative to frame F of a joint."""
    f = joint_frames(mechanism, state, joint)
    return RelativeMotion(
        p=f.U.T @ f.d,
        R=f.U.T @ f.W,
        v=f.U.T @ (f.d_dot - cross(f.w_i, f.d)),
        w=f.U.T @ (f.w_j - f.w_i),
    )


def joint_coordinates(kind: str, motion: RelativeMotion) -> dict[str, Array]:
    """Joint coordinates of M relative to F, by the names of `JOINT_KINDS`; angles in (-pi, pi].

    Universal: ``R = Rz(angle1) Rx(angle2)``; orientation: quaternion, scalar first.
    """
    R, p = motion.R, motion.p
    values = {
        "angle": np.arctan2(R[1, 0], R[0, 0]),
        "distance": p[2],
        "x": p[0],
        "y": p[1],
        "angle1": np.arctan2(R[1, 0], R[0, 0]),
        "angle2": np.arctan2(R[2, 1], R[2, 2]),
        "position": p,
    }
    names = JOINT_KINDS[kind].coordinates
    found = {n: np.asarray(values[n]) for n in names if n != "orientation"}
    if "orientation" in names:
        found["orientation"] = quaternion_from_rotation(R)
    return found


def joint_rates(kind: str, motion: RelativeMotion) -> dict[str, Array]:
    """Rates of the joint coordinates; of an orientation: the angular velocity of M relative to F, in axes of F."""
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
    return {n: np.asarray(values[n]) for n in JOINT_KINDS[kind].coordinates}


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
    force_W, torque_W : ndarray, shape (3,), N and N m
        Wrench in world axes, the torque about `point_W`.
    point_W : ndarray, shape (3,), m
    on_predecessor : bool
        The wrench is what the joint exerts on the predecessor; action and reaction turn it round.

    Returns
    -------
    force_F, torque_F : ndarray, shape (3,)
    """
    U, _, p_F, _, _ = _side(mechanism, state, joint.predecessor, joint.F)
    p_M = p_F + joint_frames(mechanism, state, joint).d
    sign = -1.0 if on_predecessor else 1.0
    torque_at_M = torque_W + cross(point_W - p_M, force_W)
    return sign * (U.T @ force_W), sign * (U.T @ torque_at_M)
