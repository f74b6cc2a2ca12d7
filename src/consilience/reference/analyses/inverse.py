"""Inverse dynamics of trees: the efforts in the joints that make a given motion, and the reactions with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import (
    GROUND,
    JOINT_KINDS,
    Array,
    Joint,
    Mechanism,
    State,
    constraint_gamma,
    constraint_jacobian,
    cross,
    joint_frames,
    reaction_map,
    row_gamma,
    row_jacobian,
)
from consilience.reference.analyses.statics import Values, applied_forces, solver_velocities
from consilience.reference.bodies.arrays import flatten
from consilience.reference.bodies.mass_metric import mass_matrix

_TRANSLATIONS = {"distance": "Z", "x": "X", "y": "Y"}
_CONSISTENT = 1e-9
"""Violation of ``Q a = gamma`` up to which given body accelerations count as possible, relative."""

JointAccelerations = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class InverseDynamics:
    """Efforts and reactions that go with given accelerations.

    Attributes
    ----------
    efforts : dict of joint name to dict of coordinate name to float
        Force along (N) or torque about (N m) the axis of each joint coordinate, on the successor, its opposite on
        the predecessor; in addition to springs, dampers and loads of the mechanism.
    force_F, torque_F : ndarray, shape (n_j, 3), N and N m
        Reactions of the joints on their successors, at the origins of M, in axes of F; without the efforts.
    """

    efforts: dict[str, dict[str, float]]
    force_F: Array
    torque_F: Array


def inverse_dynamics(
    mechanism: Mechanism, state: State, accelerations: JointAccelerations | Array, t: float = 0.0
) -> InverseDynamics:
    """Efforts about and along the free joint axes that give a tree the accelerations asked for.

    Parameters
    ----------
    mechanism : Mechanism
        A tree whose joints all have scalar coordinates (revolute, prismatic, cylindrical, universal, planar, rigid).
    state : State
        Consistent state.
    accelerations : mapping of joint name to mapping of coordinate name to float, or ndarray, shape (n_b, 6)
        Second time derivatives of all joint coordinates (m/s^2, rad/s^2); or those of all bodies, ``a_WB_W`` of the
        origin and ``alpha_WB_W``, in world axes, which must be possible under the joints.
    t : float, s
        Time of actuators, histories of loads and targets of controllers, whose integrals are zero.

    Returns
    -------
    InverseDynamics

    Raises
    ------
    InvalidInput
        A loop, a joint without scalar coordinates, missing or unknown coordinates, accelerations the joints forbid.

    Notes
    -----
    The rows of the joints and of their coordinates together are square and regular in a tree. With S these rows, the
    multipliers and efforts are the solution of ``S^T (lam, tau) = M a - f`` [EXU; C4 section 4.1.1].
    """
    free = _coordinates(mechanism)
    rows, drift = _coordinate_rows(mechanism, state, free)
    Q, gamma = constraint_jacobian(mechanism, state), constraint_gamma(mechanism, state)
    S = np.vstack([Q, rows])
    if isinstance(accelerations, Mapping):
        asked = _asked(free, accelerations)
        a = np.linalg.solve(S, np.concatenate([gamma, asked - drift]))
    else:
        a = _possible(mechanism, Q, gamma, accelerations)
    unknowns = np.linalg.solve(S.T, missing_forces(mechanism, state, a, t))
    lam, tau = unknowns[: len(Q)], unknowns[len(Q) :]
    efforts: dict[str, dict[str, float]] = {}
    for (joint, coordinate), effort in zip(free, tau, strict=True):
        efforts.setdefault(joint.name, {})[coordinate] = float(effort)
    wrenches, start = np.zeros((len(mechanism.joints), 6)), 0
    for n, joint in enumerate(mechanism.joints):
        end = start + len(joint.rows)
        wrenches[n] = reaction_map(mechanism, state, joint) @ lam[start:end]
        start = end
    return InverseDynamics(efforts, wrenches[:, :3], wrenches[:, 3:])


def _coordinates(mechanism: Mechanism) -> list[tuple[Joint, str]]:
    """All joint coordinates of a tree of joints with scalar ones."""
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
    free = []
    for joint in mechanism.joints:
        names = JOINT_KINDS[joint.kind].coordinates
        if len(names) != 6 - len(joint.rows):
            raise InvalidInput(
                f"joint '{joint.name}'", f"a {joint.kind} joint has no scalar coordinates", "Use joints with axes."
            )
        free += [(joint, name) for name in names]
    return free


def _coordinate_rows(mechanism: Mechanism, state: State, free: list[tuple[Joint, str]]) -> tuple[Array, Array]:
    """Rows R (d, 6 n_b) and drift (d,) with ``q'' = R a + drift``; forces of unit efforts are the columns of R^T."""
    rows, drift = np.zeros((len(free), 6 * len(mechanism.bodies))), np.zeros(len(free))
    for n, (joint, coordinate) in enumerate(free):
        f = joint_frames(mechanism, state, joint)
        if coordinate in _TRANSLATIONS:
            pair = row_jacobian(f, _TRANSLATIONS[coordinate])
            drift[n] = -row_gamma(f, _TRANSLATIONS[coordinate])
        else:
            # the second angle of a universal joint is about x of M, every other about z of F
            axis = f.W[:, 0] if coordinate == "angle2" else f.U[:, 2]
            pair = np.concatenate([np.zeros(3), -axis, np.zeros(3), axis])
            drift[n] = float(axis @ cross(f.w_j, f.w_i))  # the axis turns with one side or the other: it is the same
        for body, columns in ((joint.predecessor, pair[:6]), (joint.successor, pair[6:])):
            if body != GROUND:
                i = mechanism.body_index[body]
                rows[n, 6 * i : 6 * i + 6] = columns
    return rows, drift


def _asked(free: list[tuple[Joint, str]], accelerations: JointAccelerations) -> Array:
    known = {(joint.name, coordinate) for joint, coordinate in free}
    given = {(name, coordinate) for name, by in accelerations.items() for coordinate in by}
    for name, coordinate in sorted(known ^ given):
        what = "there is no such coordinate" if (name, coordinate) in given else "it is missing"
        raise InvalidInput(f"accelerations: '{coordinate}' of joint '{name}'", what, "Give every coordinate once.")
    return np.array([float(accelerations[joint.name][coordinate]) for joint, coordinate in free])


def _possible(mechanism: Mechanism, Q: Array, gamma: Array, accelerations: Array) -> Array:
    shape = (len(mechanism.bodies), 6)
    a = np.asarray(accelerations, dtype=float)
    if a.shape != shape:
        raise InvalidInput("accelerations", f"shape {a.shape}", f"Give a_WB_W and alpha_WB_W side by side, {shape}.")
    error = float(np.max(np.abs(Q @ a.ravel() - gamma), initial=0.0))
    if not error <= _CONSISTENT * max(1.0, float(np.max(np.abs(a)))):
        raise InvalidInput("accelerations", f"they violate the joints by {error:.3g}", "Give possible accelerations.")
    return a.ravel()


def missing_forces(mechanism: Mechanism, state: State, a: Array, t: float = 0.0, near: Values | None = None) -> Array:
    """``M a - f`` about the bodies' origins, world axes, shape (6 n_b,): what reactions and efforts must give.

    Forces are those of `statics.applied_forces`, at the time t and with angles counted from `near`.
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
