"""Energy, momentum and mass properties from poses and velocities: the same code for every engine.

An engine's own account of its energies is an answer to be compared; what is plotted and judged over a trajectory is
recomputed here from the motion alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from consilience.mechanism.constraints import (
    RANK_TOLERANCE,
    RelativeMotion,
    constraint_jacobian,
    free_directions,
    joint_coordinates,
    joint_frames,
    joint_rates,
    relative_motion,
    row_jacobian,
)
from consilience.mechanism.model import GROUND, Joint, JointSpring, Mechanism, Spring, State
from consilience.mechanism.spatial import Array, cross, skew

_REACH_TOLERANCE = 1e-6
"""A null vector of unit length that moves a component by less than this does not reach it: far above the rounding of
the null space (1e-14 over the rank gap), far below the order one of a component it does reach."""


def centres_of_mass(mechanism: Mechanism, state: State) -> tuple[Array, Array]:
    """Positions and velocities of the bodies' centres of mass, each shape (n_b, 3), world axes."""
    R = state.R_WB
    arms = np.einsum("bij,bj->bi", R, np.array([b.com for b in mechanism.bodies]))
    return state.p_WB + arms, state.v_WB_W + np.cross(state.w_WB_W, arms)


def world_inertias(mechanism: Mechanism, state: State) -> Array:
    """Inertia tensors about the bodies' centres of mass in world axes, ``A I' A^T``, shape (n_b, 3, 3)."""
    R = state.R_WB
    return R @ np.array([b.inertia for b in mechanism.bodies]) @ np.swapaxes(R, 1, 2)


def mass_properties(mechanism: Mechanism, state: State) -> tuple[float, Array, Array]:
    """Total mass, centre of mass (3,) in the world, and inertia (3, 3) about it in world axes."""
    masses = np.array([b.mass for b in mechanism.bodies])
    r, _ = centres_of_mass(mechanism, state)
    total = float(masses.sum())
    com = masses @ r / total
    c = r - com
    shifted = np.einsum("b,bij->ij", masses, np.eye(3) * np.sum(c * c, 1)[:, None, None] - c[:, :, None] * c[:, None])
    return total, com, world_inertias(mechanism, state).sum(axis=0) + shifted


def kinetic_energy(mechanism: Mechanism, state: State) -> float:
    """``T = sum 1/2 m v.v + 1/2 w.I w`` in J."""
    masses = np.array([b.mass for b in mechanism.bodies])
    _, v = centres_of_mass(mechanism, state)
    w = state.w_WB_W
    spin = np.einsum("bi,bij,bj", w, world_inertias(mechanism, state), w)
    return float(0.5 * masses @ np.sum(v * v, axis=1) + 0.5 * spin)


def body_point(mechanism: Mechanism, state: State, body: str, point: Array) -> tuple[Array, Array]:
    """World position and velocity of a point given in body axes; the ground is at rest at the world origin."""
    if body == GROUND:
        return point, np.zeros(3)
    i = mechanism.body_index[body]
    arm = state.R_WB[i] @ point
    return state.p_WB[i] + arm, state.v_WB_W[i] + np.cross(state.w_WB_W[i], arm)


def joint_spring_motion(mechanism: Mechanism, state: State, joint: str, coordinate: str) -> tuple[float, float]:
    """Coordinate (angle in (-pi, pi]) and rate of a sprung joint."""
    target = mechanism.joints[mechanism.joint_index[joint]]
    motion: RelativeMotion = relative_motion(mechanism, state, target)
    return (
        float(joint_coordinates(target, motion)[coordinate]),
        float(joint_rates(target, motion)[coordinate]),
    )


def potential_energy(mechanism: Mechanism, state: State, turns: Array | None = None) -> float:
    """Potential energy in J of gravity (zero at the world origin) and of springs.

    Parameters
    ----------
    turns : ndarray, shape (n_joint_springs,), optional
        Full turns to add to the angles of the joint springs. Without it angles are in (-pi, pi].
    """
    masses = np.array([b.mass for b in mechanism.bodies])
    r, _ = centres_of_mass(mechanism, state)
    energy = -float(masses @ (r @ mechanism.gravity))
    for spring in mechanism.springs:
        p_i, _ = body_point(mechanism, state, spring.predecessor, spring.point_predecessor)
        p_j, _ = body_point(mechanism, state, spring.successor, spring.point_successor)
        energy += 0.5 * spring.stiffness * (float(np.linalg.norm(p_j - p_i)) - spring.free_length) ** 2
    for n, joint_spring in enumerate(mechanism.joint_springs):
        q, _ = joint_spring_motion(mechanism, state, joint_spring.joint, joint_spring.coordinate)
        q += 2 * np.pi * (0.0 if turns is None else turns[n])
        energy += 0.5 * joint_spring.stiffness * (q - joint_spring.rest) ** 2
    return energy


def load_potential(mechanism: Mechanism, state: State) -> float:
    """Potential energy in J of the constant forces fixed in the world, zero at the world origin.

    Forces fixed in a body and torques have no potential: what they do is work from outside.
    """
    return -sum(
        float(load.vector @ body_point(mechanism, state, load.body, load.point)[0])
        for load in mechanism.loads
        if load.kind == "force" and load.frame == "world"
    )


def characteristic_length(mechanism: Mechanism) -> float:
    """Longest rod, or arm from a body's origin to its centre of mass or a joint frame, m; 1 if there is none."""
    arms = [b.com for b in mechanism.bodies]
    arms += [j.F.p for j in mechanism.joints if j.predecessor != GROUND]
    arms += [j.M.p for j in mechanism.joints if j.successor != GROUND]
    lengths = [float(np.linalg.norm(a)) for a in arms] + [j.length for j in mechanism.joints]
    return max(lengths) or 1.0


def is_conservative(mechanism: Mechanism) -> bool:
    """Whether kinetic plus potential energy is constant: no dampers, torques, body-fixed forces, drives, impacts."""
    elastic: list[Spring | JointSpring] = [*mechanism.springs, *mechanism.joint_springs]
    damped = bool(mechanism.frictions) or any(s.damping != 0 for s in elastic)
    driven = any(not (x.kind == "force" and x.frame == "world" and x.history is None) for x in mechanism.loads)
    powered = bool(mechanism.drives or mechanism.controls or mechanism.contacts) or any(
        s.actuator is not None for s in elastic
    )
    return not damped and not driven and not powered


def linear_momentum(mechanism: Mechanism, state: State) -> Array:
    """``sum m v`` in kg m/s, shape (3,)."""
    _, v = centres_of_mass(mechanism, state)
    return np.array([b.mass for b in mechanism.bodies]) @ v


def angular_momentum(mechanism: Mechanism, state: State) -> Array:
    """Angular momentum about the world origin in kg m^2/s, shape (3,)."""
    masses = np.array([b.mass for b in mechanism.bodies])
    r, v = centres_of_mass(mechanism, state)
    spin = np.einsum("bij,bj->i", world_inertias(mechanism, state), state.w_WB_W)
    return np.cross(r, masses[:, None] * v).sum(axis=0) + spin


def reaction_map(mechanism: Mechanism, state: State, joint: Joint) -> Array:
    """Wrench on the successor per multiplier: force and torque at the origin of M, axes of F, shape (6, rows)."""
    frames = joint_frames(mechanism, state, joint)
    columns = []
    for row in joint.rows:
        coefficients = row_jacobian(frames, row)[6:]
        force = coefficients[:3]
        torque = coefficients[3:] - cross(frames.s_j, force)
        columns.append(np.concatenate([frames.U.T @ force, frames.U.T @ torque]))
    return np.array(columns).T.reshape(6, len(joint.rows))


def determinate_reactions(mechanism: Mechanism, state: State) -> NDArray[np.bool_]:
    """Which reaction components equilibrium determines, shape (n_j, 6): force then torque, axes of F.

    Multipliers are unique up to the null space of ``Q^T``; a component is determined only if that null space does
    not reach it [C4 section 4.2.3, EXU]. The others are the solver's choice and must never be compared.
    """
    Q = constraint_jacobian(mechanism, state)
    if len(Q) == 0:
        return np.ones((len(mechanism.joints), 6), dtype=bool)
    U, singular, _ = np.linalg.svd(Q)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    free = U[:, rank:]
    determined, start = [], 0
    for joint in mechanism.joints:
        rows = slice(start, start + len(joint.rows))
        start = rows.stop
        characteristic_length = np.linalg.norm(reaction_map(mechanism, state, joint) @ free[rows], axis=1)
        determined.append(characteristic_length < _REACH_TOLERANCE)
    return np.array(determined)


def mass_matrix(mechanism: Mechanism, state: State) -> Array:
    """Mass matrix of all bodies about their origins, block diagonal, world axes, shape (6 n_b, 6 n_b)."""
    n = len(mechanism.bodies)
    M = np.zeros((6 * n, 6 * n))
    arms = centres_of_mass(mechanism, state)[0] - state.p_WB
    for i, (body, inertia) in enumerate(zip(mechanism.bodies, world_inertias(mechanism, state), strict=True)):
        S = body.mass * skew(arms[i])
        block = [[body.mass * np.eye(3), -S], [S, inertia - S @ skew(arms[i])]]
        M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.block(block)
    return M


def mass_matrix_condition(mechanism: Mechanism, state: State) -> float:
    """Condition number of the mass matrix in orthonormal free directions; 1 where nothing can move.

    Rounding errors of any method that inverts the mass matrix grow with it.
    """
    N = free_directions(mechanism, state)
    return float(np.linalg.cond(N.T @ mass_matrix(mechanism, state) @ N)) if N.shape[1] else 1.0


def reaction_condition(mechanism: Mechanism, state: State) -> float:
    """Condition number of ``Q M^-1 Q^T``, which maps multipliers to accelerations, on its rank; 1 without constraints.

    Rounding errors of reactions grow with it: the multipliers solve ``Q M^-1 Q^T lam = gamma - Q M^-1 f``.
    """
    Q = constraint_jacobian(mechanism, state)
    if len(Q) == 0:
        return 1.0
    L = np.linalg.cholesky(mass_matrix(mechanism, state))
    singular = np.linalg.svd(np.linalg.solve(L, Q.T), compute_uv=False)
    regular = singular[singular > RANK_TOLERANCE * singular[0]]
    return float((regular[0] / regular[-1]) ** 2)
