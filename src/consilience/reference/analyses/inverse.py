"""Inverse dynamics of trees: joint efforts and reactions of given accelerations.

S^T (lam, tau) = M a - f,    S: rows of the joints and of their coordinates                [EXU; C4 section 4.1.1]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import (
    JOINT_KINDS,
    Array,
    Joint,
    Mechanism,
    State,
    constraint_gamma,
    constraint_jacobian,
    cross,
)
from consilience.reference.analyses.joint_rows import all_coordinates, coordinate_rows
from consilience.reference.analyses.statics import JointValues, applied_forces, solver_velocities
from consilience.reference.analyses.touching import refuse_touching
from consilience.reference.bodies.arrays import flatten
from consilience.reference.bodies.canonical import joint_wrenches
from consilience.reference.bodies.mass_metric import mass_matrix

_CONSISTENT = 1e-9
"""Largest relative violation of ``Q a = gamma`` by given body accelerations."""

JointAccelerations = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class InverseDynamics:
    """Efforts and reactions of given accelerations.

    Attributes
    ----------
    efforts : dict of joint name to dict of coordinate name to float
        Force along (N) or torque about (N m) the axis of each joint coordinate on the successor, its opposite on the
        predecessor, in addition to springs, dampers and loads.
    force_F, torque_F : ndarray, shape (n_j, 3), N and N m
        Joint reactions on the successors, at the origins of M, axes of F, without the efforts.
    """

    efforts: dict[str, dict[str, float]]
    force_F: Array
    torque_F: Array


def inverse_dynamics(
    mechanism: Mechanism, state: State, accelerations: JointAccelerations | Array, t: float = 0.0
) -> InverseDynamics:
    """Compute the efforts along and about the joint axes that give a tree the required accelerations.

    Parameters
    ----------
    mechanism : Mechanism
        A tree whose joints all have scalar coordinates (revolute, prismatic, cylindrical, universal, planar, rigid).
    state : State
        Consistent state.
    accelerations : mapping of joint name to mapping of coordinate name to float, or ndarray, shape (n_b, 6)
        Second derivatives of all joint coordinates (m/s^2, rad/s^2); or ``a_WB_W`` of the body origins and
        ``alpha_WB_W``, world axes, consistent with the joints.
    t : float, s
        Time of actuators, histories of loads and targets of controllers, whose integrals are zero.

    Returns
    -------
    InverseDynamics

    Raises
    ------
    InvalidInput
        A loop, a joint without scalar coordinates, missing or unknown coordinates, accelerations the joints forbid, or
        contacts, stops or dry friction that act.

    Notes
    -----
    For a tree S is square and regular; one solution gives multipliers and efforts.
    """
    free = _coordinates(mechanism)
    refuse_touching(mechanism, state)
    rows, drift = coordinate_rows(mechanism, state, free)
    Q, gamma = constraint_jacobian(mechanism, state), constraint_gamma(mechanism, state)
    S = np.vstack([Q, rows])
    if isinstance(accelerations, Mapping):
        required = _required(free, accelerations)
        a = np.linalg.solve(S, np.concatenate([gamma, required - drift]))
    else:
        a = _possible(mechanism, Q, gamma, accelerations)
    unknowns = np.linalg.solve(S.T, missing_forces(mechanism, state, a, t))
    lam, tau = unknowns[: len(Q)], unknowns[len(Q) :]
    efforts: dict[str, dict[str, float]] = {}
    for (joint, coordinate), effort in zip(free, tau, strict=True):
        efforts.setdefault(joint.name, {})[coordinate] = float(effort)
    wrenches = joint_wrenches(mechanism, state, lam)
    return InverseDynamics(efforts, wrenches[:, :3], wrenches[:, 3:])


def _coordinates(mechanism: Mechanism) -> list[tuple[Joint, str]]:
    """Return all joint coordinates of a tree; refuse loops and joints without scalar coordinates."""
    if len(mechanism.joints) != len(mechanism.bodies):
        raise InvalidInput(
            f"mechanism '{mechanism.name}'",
            "the joints form a loop, whose efforts are not determined by the motion",
            "Give a tree: as many joints as bodies.",
        )
    if mechanism.constraint_count() > sum(len(joint.rows) for joint in mechanism.joints):
        raise InvalidInput(
            f"mechanism '{mechanism.name}'",
            "drives, couplings or rolling contacts prescribe part of the motion already",
            "Give joints alone, and the accelerations of their coordinates.",
        )
    for joint in mechanism.joints:
        if len(JOINT_KINDS[joint.kind].coordinates) != 6 - len(joint.rows):
            what = f"a {joint.kind} joint has no scalar coordinates"
            raise InvalidInput(f"joint '{joint.name}'", what, "Use joints with axes.")
    return all_coordinates(mechanism)


def _required(free: list[tuple[Joint, str]], accelerations: JointAccelerations) -> Array:
    """Return the required accelerations in the order of the coordinates; each must be given once."""
    known = {(joint.name, coordinate) for joint, coordinate in free}
    given = {(name, coordinate) for name, by in accelerations.items() for coordinate in by}
    for name, coordinate in sorted(known ^ given):
        what = "there is no such coordinate" if (name, coordinate) in given else "it is missing"
        raise InvalidInput(f"accelerations: '{coordinate}' of joint '{name}'", what, "Give every coordinate once.")
    return np.array([float(accelerations[joint.name][coordinate]) for joint, coordinate in free])


def _possible(mechanism: Mechanism, Q: Array, gamma: Array, accelerations: Array) -> Array:
    """Return body accelerations, shape (6 n_b,); refuse those that violate the joints."""
    shape = (len(mechanism.bodies), 6)
    a = np.asarray(accelerations, dtype=float)
    if a.shape != shape:
        raise InvalidInput("accelerations", f"shape {a.shape}", f"Give a_WB_W and alpha_WB_W side by side, {shape}.")
    error = float(np.max(np.abs(Q @ a.ravel() - gamma), initial=0.0))
    if not error <= _CONSISTENT * max(1.0, float(np.max(np.abs(a)))):
        raise InvalidInput("accelerations", f"they violate the joints by {error:.3g}", "Give possible accelerations.")
    return a.ravel()


def missing_forces(
    mechanism: Mechanism, state: State, a: Array, t: float = 0.0, near: JointValues | None = None
) -> Array:
    """Return ``M a - f`` about the body origins, world axes, shape (6 n_b,): the sum of reactions and efforts.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    a : ndarray, shape (6 n_b,)
        a_WB_W and alpha_WB_W of all bodies (m/s^2, rad/s^2).
    t : float, s
    near : mapping of joint to mapping of coordinate to value, optional
        Full turns of angles are counted from these values.
    """
    T = solver_velocities(mechanism, state)
    R_WB = state.R_WB
    centripetal = np.zeros((len(mechanism.bodies), 6))
    for i, body in enumerate(mechanism.bodies):
        w = state.w_WB_W[i]
        centripetal[i, :3] = cross(w, cross(w, R_WB[i] @ body.com))
    of_solver = T @ a + centripetal.ravel()
    missing: Array = T.T @ (mass_matrix(flatten(mechanism)) @ of_solver - applied_forces(mechanism, state, t, near))
    return missing
