"""Condition numbers: how far the equations of motion of a mechanism magnify rounding at a state.

Lengths are counted in the mechanism's characteristic length: condition numbers do not depend on units.

Rounding does not tell a wrong engine from a right one, and an engine may choose how it solves the equations. With the
mass matrix M of all bodies and the constraint Jacobian Q, five condition numbers stand for what engines do:

    N^T M N a' = N^T f  in orthonormal free directions N (`mass_matrix_condition`); or the largest eigenvalue of M over
                        the least of N^T M N (`free_condition`), because forces on heavy bodies that cannot move leak,
                        by the rounding of N, into light bodies that can
    H q'' = tau         in joint coordinates, H the inertia of the elementary tree (`joint_space_condition`): links
                        without mass have coordinates of their own, near singular where a chain of joints is
    A lam = b           for the constraint forces first, A = Q M^-1 Q^T (`reaction_condition`, and in unit-diagonal form
                        with the rows of closed contacts, reached stops and dry friction at rest, `delassus_condition`):
                        near singular where constraints nearly depend on one another, such as those of a linkage at its
                        dead point, or a contact that its joints all but hold

The error of a solution is some eps times the condition number of its matrix; for H and A in unit-diagonal form,
whatever the units of the coordinates [J. Demmel 1989; N. J. Higham, Accuracy and Stability of Numerical Algorithms,
2002, theorem 10.6]. A method that does not form A has the square root of the condition number of A.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism.constraints import RANK_TOLERANCE, null_space, scaled_jacobian, velocity_sizes
from consilience.mechanism.contact_determinacy import closed_rows
from consilience.mechanism.elementary_tree import Coordinate, Link, Tree, coordinates, to_elementary_tree
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.observables import centres_of_mass, world_inertias
from consilience.mechanism.spatial import Array, elementary_rotation, rotation_from_quaternion, skew

_FREEDOM = {"R": 1, "P": 1, "S": 3, "F": 6, "W": 0}


def worst_condition(mechanism: Mechanism, state: State) -> float:
    """Return the largest of `free_condition`, `delassus_condition` and `joint_space_condition`.

    A mechanism with a screw is no tree of elementary joints: its `joint_space_condition` is left out.
    """
    found = [free_condition(mechanism, state), delassus_condition(mechanism, state)]
    if not any(joint.kind == "screw" for joint in mechanism.joints):
        found.append(joint_space_condition(mechanism, state))
    return max(found)


def _mass_roots(mechanism: Mechanism, state: State) -> list[Array]:
    """Root B (6, 6) of the mass matrix of every body about its origin, ``M = B^T B``."""
    sizes = velocity_sizes(mechanism)[:6]
    arms = centres_of_mass(mechanism, state)[0] - state.p_WB
    roots = []
    for body, arm, inertia in zip(mechanism.bodies, arms, world_inertias(mechanism, state), strict=True):
        m = np.sqrt(body.mass)
        root = np.block([[m * np.eye(3), -m * skew(arm)], [np.zeros((3, 3)), np.linalg.cholesky(inertia).T]])
        roots.append(root * sizes)
    return roots


def _free_singular_values(mechanism: Mechanism, state: State) -> tuple[Array, list[Array]]:
    """Singular values of B N, the roots of the eigenvalues of ``N^T M N``, falling; and the roots B of all bodies."""
    roots = _mass_roots(mechanism, state)
    N = null_space(scaled_jacobian(mechanism, state))
    moving = np.vstack([B @ N[6 * i : 6 * i + 6] for i, B in enumerate(roots)])
    return np.linalg.svd(moving, compute_uv=False), roots


def free_condition(mechanism: Mechanism, state: State) -> float:
    """Return the largest eigenvalue of M over the least of ``N^T M N``; 1 where nothing can move."""
    singular, roots = _free_singular_values(mechanism, state)
    if not len(singular):
        return 1.0
    return float((max(np.linalg.norm(B, 2) for B in roots) / singular[-1]) ** 2)


def mass_matrix_condition(mechanism: Mechanism, state: State) -> float:
    """Return the condition number of ``N^T M N``; 1 where nothing can move.

    Rounding errors of any method that inverts the mass matrix grow with this number.
    """
    singular, _ = _free_singular_values(mechanism, state)
    return float((singular[0] / singular[-1]) ** 2) if len(singular) else 1.0


def joint_space_condition(mechanism: Mechanism, state: State) -> float:
    """Return the condition number of the inertia matrix H of the elementary tree, scaled to a unit diagonal."""
    tree = to_elementary_tree(mechanism)
    width = sum(_FREEDOM[link.elementary] for link in tree.links)
    if width == 0:
        return 1.0
    H = np.zeros((width, width))
    for link, (R, J) in zip(tree.links, _link_jacobians(tree, coordinates(mechanism, tree, state), width), strict=True):
        if link.mass:
            Jv, Jw = J[:3] - skew(R @ link.com) @ J[3:], J[3:]
            H += link.mass * Jv.T @ Jv + Jw.T @ (R @ link.inertia @ R.T) @ Jw
    scale = 1.0 / np.sqrt(np.diag(H))
    eigenvalues = np.linalg.eigvalsh(scale[:, None] * H * scale)
    return float(eigenvalues[-1] / max(eigenvalues[0], np.finfo(float).tiny))


def _link_jacobians(tree: Tree, motion: list[Coordinate], width: int) -> list[tuple[Array, Array]]:
    """Axes of every link, and the Jacobian (6, width) of its origin's velocity and its angular velocity."""
    placed: list[tuple[Array, Array, Array]] = []
    column = 0
    for link, q in zip(tree.links, motion, strict=True):
        p, R, J = placed[link.parent] if link.parent >= 0 else (np.zeros(3), np.eye(3), np.zeros((6, width)))
        arm, R, own = _across_joint(link, q, R)
        J = np.vstack([J[:3] - skew(arm) @ J[3:], J[3:]])
        J[:, column : column + own.shape[1]] += own
        column += own.shape[1]
        placed.append((p + arm, R, J))
    return [(R, J) for _, R, J in placed]


def _across_joint(link: Link, q: Coordinate, R_parent: Array) -> tuple[Array, Array, Array]:
    """Arm from the parent's origin, axes of the link, and its own columns of the Jacobian, in the world."""
    R = R_parent @ link.placement.R
    arm = R_parent @ link.placement.p
    zero = np.zeros((3, 3))
    slide, turn = np.vstack([R, zero]), np.vstack([zero, R])
    if link.elementary == "R":
        return arm, R @ elementary_rotation(2, q.q), turn[:, 2:]
    if link.elementary == "P":
        return arm + R[:, 2] * q.q, R, slide[:, 2:]
    if link.elementary == "W":
        return arm, R, np.zeros((6, 0))
    assert q.quat is not None
    own = turn if q.p is None else np.hstack([slide, turn])
    return arm if q.p is None else arm + R @ q.p, R @ rotation_from_quaternion(q.quat), own


def _constraint_condition(mechanism: Mechanism, state: State, Q: Array, unit_diagonal: bool) -> float:
    """Condition number of ``A = Q M^-1 Q^T`` on its rank, from the singular values of ``M^-1/2 Q^T``."""
    if len(Q) == 0:
        return 1.0
    roots = _mass_roots(mechanism, state)
    Y = np.hstack([np.linalg.solve(B.T, Q[:, 6 * i : 6 * i + 6].T).T for i, B in enumerate(roots)])
    singular = np.linalg.svd(Y / np.linalg.norm(Y, axis=1, keepdims=True) if unit_diagonal else Y, compute_uv=False)
    singular = singular[singular > RANK_TOLERANCE * singular[0]]
    return float((singular[0] / singular[-1]) ** 2)


def delassus_condition(mechanism: Mechanism, state: State) -> float:
    """Return the condition number of ``A = Q M^-1 Q^T`` in unit-diagonal form, on its rank; 1 without constraints.

    Q has the rows of joints, closed contacts, reached stops and dry friction at rest.
    """
    Q = np.vstack([scaled_jacobian(mechanism, state), closed_rows(mechanism, state)[0]])
    return _constraint_condition(mechanism, state, Q, unit_diagonal=True)


def reaction_condition(mechanism: Mechanism, state: State) -> float:
    """Return the condition number of ``A = Q M^-1 Q^T``, on its rank; 1 without constraints.

    Rounding errors of reactions grow with this number: the multipliers solve ``A lam = gamma - Q M^-1 f``.
    """
    return _constraint_condition(mechanism, state, scaled_jacobian(mechanism, state), unit_diagonal=False)
