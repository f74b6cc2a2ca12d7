"""Energy, momentum, mass properties and determined reactions of a mechanism from its motion alone.

For every engine, energies over a trajectory are computed here, from poses and velocities. The energies that an engine
itself states at an instant are an answer, and are compared with these.

All vectors are in axes of the world W. A body's velocity ``v_WB_W`` is that of its origin B, in m/s; the velocity of
its centre of mass c at the arm ``s = R_WB com`` is ``v + w x s``. SI units throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from consilience.mechanism.constraints import (
    joint_coordinates,
    joint_rates,
    null_space,
    relative_motion,
    row_sizes,
    scaled_jacobian,
)
from consilience.mechanism.joint_rows import joint_frames, row_jacobians
from consilience.mechanism.model import GROUND, Joint, Mechanism, State
from consilience.mechanism.spatial import Array, crosses, skew
from consilience.mechanism.units import characteristic_length

DETERMINED_TOLERANCE = 1e-6
"""Largest reaction, in the null space of ``Q^T``, of a component that counts as determined: far above the rounding of a
null space (1e-14 over the gap of the rank), far below 1, the size of a component that the null space reaches."""


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Poses and velocities of all bodies at several instants: arrays of a `State` with leading axes.

    Attributes
    ----------
    p_WB, v_WB_W, w_WB_W : ndarray, shape (..., n_b, 3), m, m/s and rad/s
        Origins, their velocities, and angular velocities, in world axes.
    R_WB : ndarray, shape (..., n_b, 3, 3)
        Rotation matrices.
    """

    p_WB: Array
    R_WB: Array
    v_WB_W: Array
    w_WB_W: Array


BodyMotion = State | SampledMotion
"""Motion of all bodies at one instant or at several; results have the leading axes of the motion."""


def _masses(mechanism: Mechanism) -> Array:
    return np.array([b.mass for b in mechanism.bodies])


def centres_of_mass(mechanism: Mechanism, motion: BodyMotion) -> tuple[Array, Array]:
    """Return positions and velocities of the bodies' centres of mass, each shape (..., n_b, 3), world axes."""
    arms = np.einsum("...bij,bj->...bi", motion.R_WB, np.array([b.com for b in mechanism.bodies]))
    return motion.p_WB + arms, motion.v_WB_W + crosses(motion.w_WB_W, arms)


def world_inertias(mechanism: Mechanism, motion: BodyMotion) -> Array:
    """Return inertia tensors about the centres of mass in world axes, ``R I R^T``, shape (..., n_b, 3, 3)."""
    R = motion.R_WB
    return R @ np.array([b.inertia for b in mechanism.bodies]) @ np.swapaxes(R, -1, -2)


def mass_properties(mechanism: Mechanism, state: State) -> tuple[float, Array, Array]:
    """Return total mass, common centre of mass (3,) and inertia (3, 3) about that centre, in world axes."""
    masses = _masses(mechanism)
    r, _ = centres_of_mass(mechanism, state)
    total = float(masses.sum())
    com = masses @ r / total
    c = r - com
    shifted = np.einsum("b,bij->ij", masses, np.eye(3) * np.sum(c * c, 1)[:, None, None] - c[:, :, None] * c[:, None])
    return total, com, world_inertias(mechanism, state).sum(axis=0) + shifted


def body_point(mechanism: Mechanism, motion: BodyMotion, body: str, point: Array) -> tuple[Array, Array]:
    """Return world position and velocity, shape (..., 3), of a point (3,) given in body axes from the body's origin.

    The ground is at rest, its origin at that of the world.
    """
    if body == GROUND:
        return point, np.zeros(3)
    i = mechanism.body_index[body]
    arm = motion.R_WB[..., i, :, :] @ point
    return motion.p_WB[..., i, :] + arm, motion.v_WB_W[..., i, :] + crosses(motion.w_WB_W[..., i, :], arm)


def joint_spring_motion(mechanism: Mechanism, state: State, joint: str, coordinate: str) -> tuple[float, float]:
    """Return a joint coordinate, an angle in (-pi, pi], and its rate."""
    target = mechanism.joints[mechanism.joint_index[joint]]
    motion = relative_motion(mechanism, state, target)
    return float(joint_coordinates(target, motion)[coordinate]), float(joint_rates(target, motion)[coordinate])


def with_full_turns(angle: Array, rate: Array, time: Array) -> Array:
    """Return an angle over time with full turns counted from the first sample on, shape (..., n_t).

    From one sample to the next the angle is taken nearest to the one that the mean of both rates leads to: of a wheel
    that turns by more than half a turn between two samples the least way would be the wrong one.

    Parameters
    ----------
    angle, rate : ndarray, shape (..., n_t), rad and rad/s
    time : ndarray, shape (n_t,), s
    """
    ahead = 0.5 * (rate[..., 1:] + rate[..., :-1]) * np.diff(time)
    hidden = 2.0 * np.pi * np.round((ahead - np.diff(angle)) / (2.0 * np.pi))
    return np.asarray(angle + np.concatenate([np.zeros_like(angle[..., :1]), np.cumsum(hidden, axis=-1)], axis=-1))


def kinetic_energies(mechanism: Mechanism, motion: BodyMotion) -> Array:
    """Return ``T = sum m v.v / 2 + w.I w / 2``, v of the centres of mass, shape (...), in J."""
    _, v = centres_of_mass(mechanism, motion)
    w = np.einsum("...bji,...bj->...bi", motion.R_WB, motion.w_WB_W)  # body axes
    inertias = np.array([b.inertia for b in mechanism.bodies])
    spin = np.einsum("...bi,bij,...bj->...", w, inertias, w)
    return np.asarray(0.5 * (np.sum(v * v, axis=-1) @ _masses(mechanism) + spin))


def kinetic_energy(mechanism: Mechanism, state: State) -> float:
    """Return the kinetic energy of a state in J."""
    return float(kinetic_energies(mechanism, state))


def potential_energies(mechanism: Mechanism, motion: BodyMotion, q: Array) -> Array:
    """Return the potential energy of gravity (zero at the world origin) and of all springs, shape (...), in J.

    Coordinates q of the joint springs have shape (n_joint_springs, ...).
    """
    r, _ = centres_of_mass(mechanism, motion)
    energy = np.asarray(-(r @ mechanism.gravity) @ _masses(mechanism))
    for spring in mechanism.springs:
        p_i, _ = body_point(mechanism, motion, spring.predecessor, spring.point_predecessor)
        p_j, _ = body_point(mechanism, motion, spring.successor, spring.point_successor)
        energy = energy + 0.5 * spring.stiffness * (np.linalg.norm(p_j - p_i, axis=-1) - spring.free_length) ** 2
    for joint_spring, q_joint in zip(mechanism.joint_springs, q, strict=True):
        energy = energy + joint_spring.potential(q_joint)
    return np.asarray(energy)


def joint_spring_coordinates(mechanism: Mechanism, state: State) -> Array:
    """Return the coordinates of all joint springs, angles in (-pi, pi], shape (n_joint_springs,)."""
    return np.array([joint_spring_motion(mechanism, state, s.joint, s.coordinate)[0] for s in mechanism.joint_springs])


def potential_energy(mechanism: Mechanism, state: State) -> float:
    """Return the potential energy of gravity and springs of a state in J; angles of springs are in (-pi, pi]."""
    return float(potential_energies(mechanism, state, joint_spring_coordinates(mechanism, state)))


def load_potentials(mechanism: Mechanism, motion: BodyMotion) -> Array:
    """Return the potential energy of forces fixed in the world, zero at the world origin, shape (...), in J.

    Forces fixed in a body and torques have no potential: their work is external.
    """
    energy = np.zeros(motion.p_WB.shape[:-2])
    for load in mechanism.loads:
        if load.kind == "force" and load.frame == "world":
            energy = energy - body_point(mechanism, motion, load.body, load.point)[0] @ load.vector
    return energy


def linear_momentum(mechanism: Mechanism, state: State) -> Array:
    """Return ``sum m v`` in kg m/s, shape (3,)."""
    return np.asarray(_masses(mechanism) @ centres_of_mass(mechanism, state)[1])


def angular_momentum(mechanism: Mechanism, state: State) -> Array:
    """Return the angular momentum about the world origin in kg m^2/s, shape (3,)."""
    r, v = centres_of_mass(mechanism, state)
    spin = np.einsum("bij,bj->i", world_inertias(mechanism, state), state.w_WB_W)
    return crosses(r, _masses(mechanism)[:, None] * v).sum(axis=0) + spin


def mass_matrix(mechanism: Mechanism, state: State) -> Array:
    """Return the block-diagonal mass matrix of all bodies about their origins, world axes, shape (6 n_b, 6 n_b)."""
    n = len(mechanism.bodies)
    M = np.zeros((6 * n, 6 * n))
    arms = centres_of_mass(mechanism, state)[0] - state.p_WB
    for i, (body, inertia) in enumerate(zip(mechanism.bodies, world_inertias(mechanism, state), strict=True)):
        S = body.mass * skew(arms[i])
        block = [[body.mass * np.eye(3), -S], [S, inertia - S @ skew(arms[i])]]
        M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.block(block)
    return M


def reaction_map(mechanism: Mechanism, state: State, joint: Joint) -> Array:
    """Return the wrench on the successor per multiplier: force and torque at the origin of M, axes of F, (6, rows)."""
    frames = joint_frames(mechanism, state, joint)
    coefficients = row_jacobians(frames, joint.rows)
    force = coefficients[:, 6:9]
    torque = coefficients[:, 9:] - crosses(frames.s_j, force)
    return np.concatenate([frames.U.T @ force.T, frames.U.T @ torque.T])


def determinate_reactions(mechanism: Mechanism, state: State) -> NDArray[np.bool_]:
    """Tell which reaction components equilibrium determines, shape (n_j, 6): force, then torque, axes of F.

    Multipliers are unique up to the null space of ``Q^T``. A component is determined if that null space does not
    reach the component [C4 section 4.2.3, EXU]; any other one is the solver's choice and must never be compared.
    """
    free = null_space(scaled_jacobian(mechanism, state).T) / row_sizes(mechanism)[:, None]
    arm = np.repeat([characteristic_length(mechanism), 1.0], 3)  # forces and torques as efforts of one size
    determined, start = [], 0
    for joint in mechanism.joints:
        rows = slice(start, start + len(joint.rows))
        start = rows.stop
        free_reactions = arm * np.linalg.norm(reaction_map(mechanism, state, joint) @ free[rows], axis=1)
        determined.append(free_reactions < DETERMINED_TOLERANCE)
    return np.array(determined)
