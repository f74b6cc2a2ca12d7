"""Accelerations and reactions in dense maximal coordinates, in plain NumPy: slow, short, independent of the solver.

Newton-Euler equations of each body about its *origin*, constraint rows from `mechanism.constraints`, one least-squares
solution.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import null_space

from consilience.mechanism import (
    GROUND,
    Mechanism,
    State,
    body_point,
    constraint_gamma,
    constraint_jacobian,
    cross,
    joint_frames,
    joint_spring_motion,
    rotation_from_quaternion,
    row_jacobian,
    skew,
    world_inertias,
)


def applied_wrenches(mechanism: Mechanism, state: State, t: float = 0.0) -> np.ndarray:
    """Applied force and torque about the origin of each body, world axes, shape (n_b, 6); gravity included.

    Integrals of controllers are zero.
    """
    R = rotation_from_quaternion(state.quat_WB)
    wrench = np.zeros((len(mechanism.bodies), 6))

    def push(body, force, point_W, torque=(0.0, 0.0, 0.0)):
        if body != GROUND:
            i = mechanism.body_index[body]
            wrench[i, :3] += force
            wrench[i, 3:] += np.asarray(torque) + cross(point_W - state.p_WB[i], force)

    for i, body in enumerate(mechanism.bodies):
        push(body.name, body.mass * mechanism.gravity, state.p_WB[i] + R[i] @ body.com)
    for s in mechanism.springs:
        (p_i, v_i), (p_j, v_j) = (
            body_point(mechanism, state, s.predecessor, s.point_predecessor),
            body_point(mechanism, state, s.successor, s.point_successor),
        )
        length = np.linalg.norm(p_j - p_i)
        e = (p_j - p_i) / length
        actuator = s.actuator.at(t)[0] if s.actuator else 0.0
        force = (s.stiffness * (length - s.free_length) + s.damping * e @ (v_j - v_i) - actuator) * e
        push(s.predecessor, force, p_i)
        push(s.successor, -force, p_j)
    for name, coordinate, effort in joint_efforts(mechanism, state, t):
        joint = mechanism.joints[mechanism.joint_index[name]]
        along = effort * joint_frames(mechanism, state, joint).U[:, 2]
        point, _ = body_point(mechanism, state, joint.successor, joint.M.p)
        force, torque = (along, np.zeros(3)) if coordinate == "distance" else (np.zeros(3), along)
        push(joint.successor, force, point, torque)
        push(joint.predecessor, -force, point, -torque)
    for load in mechanism.loads:
        i = mechanism.body_index[load.body]
        vector = load.vector if load.frame == "world" else R[i] @ load.vector
        vector = vector * (load.history.at(t)[0] if load.history else 1.0)
        point = body_point(mechanism, state, load.body, load.point)[0]
        if load.kind == "force":
            push(load.body, vector, point)
        else:
            push(load.body, np.zeros(3), point, vector)
    return wrench


def joint_efforts(mechanism: Mechanism, state: State, t: float):
    """Joint, coordinate and effort on the successor, for every spring, friction element and controller on a joint."""
    for s in mechanism.joint_springs:
        q, rate = joint_spring_motion(mechanism, state, s.joint, s.coordinate)
        actuator = s.actuator.at(t)[0] if s.actuator else 0.0
        x, (k1, k2), (c1, c2) = (
            q - s.rest,
            *((*given, 0.0, 0.0)[:2] for given in (s.higher_stiffness, s.higher_damping)),
        )
        spring = s.stiffness * x + k1 * x**2 + k2 * x**3
        damper = s.damping * rate + np.sign(rate) * c1 * rate**2 + c2 * rate**3
        yield s.joint, s.coordinate, actuator - spring - damper
    for f in mechanism.frictions:
        _, rate = joint_spring_motion(mechanism, state, f.joint, f.coordinate)
        yield f.joint, f.coordinate, -f.viscous * rate - f.coulomb * np.tanh(rate / f.speed)
    for c in mechanism.controls:
        q, rate = joint_spring_motion(mechanism, state, c.joint, c.coordinate)
        target, target_rate, _ = c.target.at(t)
        yield c.joint, c.coordinate, c.proportional * (target - q) + c.derivative * (target_rate - rate)


def equations(
    mechanism: Mechanism, state: State, t: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return M, f, Q, gamma of ``M a = f + Q^T lam``, ``Q a = gamma``; a = (a_WB_W, alpha_WB_W) of all bodies."""
    n = len(mechanism.bodies)
    R = rotation_from_quaternion(state.quat_WB)
    inertias = world_inertias(mechanism, state)
    M, f = np.zeros((6 * n, 6 * n)), applied_wrenches(mechanism, state, t).ravel()
    for i, body in enumerate(mechanism.bodies):
        c, w = R[i] @ body.com, state.w_WB_W[i]
        C = skew(c)
        I_origin = inertias[i] - body.mass * C @ C
        first, last = slice(6 * i, 6 * i + 3), slice(6 * i + 3, 6 * i + 6)
        M[first, first], M[last, last] = body.mass * np.eye(3), I_origin
        M[first, last], M[last, first] = -body.mass * C, body.mass * C
        f[first] -= body.mass * cross(w, cross(w, c))
        f[last] -= cross(w, I_origin @ w)
    return M, f, constraint_jacobian(mechanism, state, t=t), constraint_gamma(mechanism, state, t=t)


def accelerations(mechanism: Mechanism, state: State, t: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations (a_WB_W, alpha_WB_W) of each body, shape (n_b, 6), and the multipliers of all rows."""
    M, f, Q, gamma = equations(mechanism, state, t)
    inverse = np.linalg.inv(M)
    lam = np.linalg.lstsq(Q @ inverse @ Q.T, gamma - Q @ inverse @ f, rcond=1e-9)[0] if len(Q) else np.zeros(0)
    return (inverse @ (f + Q.T @ lam)).reshape(-1, 6), lam


def free_accelerations(mechanism: Mechanism, state: State, t: float = 0.0) -> np.ndarray:
    """Return accelerations of each body, shape (n_b, 6), without multipliers: ``N^T M a = N^T f``, N^T N = 1, Q N = 0.

    Forces of constraints, which light bodies magnify, do not enter: rounding grows with the condition of N^T M N alone.
    """
    M, f, Q, gamma = equations(mechanism, state, t)
    a = np.linalg.lstsq(Q, gamma, rcond=1e-9)[0]
    N = null_space(Q, rcond=1e-9)
    return (a + N @ np.linalg.solve(N.T @ M @ N, N.T @ (f - M @ a))).reshape(-1, 6)


@lru_cache(maxsize=4096)  # tests ask again at the states of `mechanisms.states_of`, for each engine and formulation
def solve(mechanism: Mechanism, state: State, t: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a_WB_W, alpha_WB_W, force_F, torque_F at a consistent state; least-norm multipliers where not unique."""
    a, lam = accelerations(mechanism, state, t)
    forces, torques, start = [], [], 0
    for joint in mechanism.joints:
        frames = joint_frames(mechanism, state, joint)
        rows = lam[start : start + len(joint.rows)]
        start += len(joint.rows)
        on_successor = sum(
            (m * row_jacobian(frames, r)[6:] for m, r in zip(rows, joint.rows, strict=True)), np.zeros(6)
        )
        force, torque = on_successor[:3], on_successor[3:] - cross(frames.s_j, on_successor[:3])
        forces.append(frames.U.T @ force)
        torques.append(frames.U.T @ torque)
    found = a[:, :3], a[:, 3:], np.array(forces), np.array(torques)
    for array in found:
        array.flags.writeable = False
    return found
