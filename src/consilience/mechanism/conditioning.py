"""How far the equations of motion of a mechanism magnify rounding at a state, however they are solved.

An engine may choose how it solves them, and rounding does not tell a wrong engine from a right one. Three condition
numbers stand for what engines do:

    N^T M N a' = N^T f  in free directions N: the largest eigenvalue of M over the least of N^T M N, because forces on
                        heavy bodies that do not move leak, by the rounding of N, into light ones that do
    H q'' = tau         in joint coordinates: H the inertia of the tree of `elementary_tree`, whose links without mass
                        have coordinates of their own, near singular where a chain of joints is in its singular pose
    A lam = b           for the constraint forces first: A = Q M^-1 Q^T, near singular where constraints nearly depend
                        on one another (a linkage at its dead point)

The error of a solution is some eps times the condition number of its matrix; of H and A in unit-diagonal form, whatever
the units of the coordinates [J. Demmel 1989; N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002,
theorem 10.6]. That of A is the square of what a method pays that does not form it.
"""

from __future__ import annotations

import numpy as np

from consilience.mechanism.constraints import RANK_TOLERANCE, constraint_jacobian, free_directions
from consilience.mechanism.elementary_tree import Coordinate, Link, Tree, coordinates, to_elementary_tree
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.observables import centres_of_mass, world_inertias
from consilience.mechanism.spatial import Array, elementary_rotation, rotation_from_quaternion, skew

_FREEDOM = {"R": 1, "P": 1, "S": 3, "F": 6, "W": 0}


def worst_condition(mechanism: Mechanism, state: State) -> float:
    """Largest of the condition numbers of the module's text.

    A mechanism with a screw is no tree of elementary joints: its joint coordinates are left out.
    """
    found = [free_condition(mechanism, state), delassus_condition(mechanism, state)]
    if not any(joint.kind == "screw" for joint in mechanism.joints):
        found.append(joint_space_condition(mechanism, state))
    return max(found)


def _roots(mechanism: Mechanism, state: State) -> list[Array]:
    """Root B (6, 6) of the mass matrix of every body about its origin, ``M = B^T B``."""
    arms = centres_of_mass(mechanism, state)[0] - state.p_WB
    roots = []
    for body, arm, inertia in zip(mechanism.bodies, arms, world_inertias(mechanism, state), strict=True):
        m = np.sqrt(body.mass)
        roots.append(np.block([[m * np.eye(3), -m * skew(arm)], [np.zeros((3, 3)), np.linalg.cholesky(inertia).T]]))
    return roots


def free_condition(mechanism: Mechanism, state: State) -> float:
    """Largest eigenvalue of the mass matrix over the least in orthonormal free directions; 1 where nothing can move."""
    roots = _roots(mechanism, state)
    N = free_directions(mechanism, state)
    if not N.shape[1]:
        return 1.0
    moving = np.vstack([B @ N[6 * i : 6 * i + 6] for i, B in enumerate(roots)])
    least = np.linalg.svd(moving, compute_uv=False)[-1]
    return float((max(np.linalg.norm(B, 2) for B in roots) / least) ** 2)


def joint_space_condition(mechanism: Mechanism, state: State) -> float:
    """Condition number of the inertia matrix H of the tree of elementary joints, scaled to a unit diagonal."""
    tree = to_elementary_tree(mechanism)
    width = sum(_FREEDOM[link.elementary] for link in tree.links)
    if width == 0:
        return 1.0
    H = np.zeros((width, width))
    for link, (R, J) in zip(tree.links, _placed(tree, coordinates(mechanism, tree, state), width), strict=True):
        if link.mass:
            Jv, Jw = J[:3] - skew(R @ link.com) @ J[3:], J[3:]
            H += link.mass * Jv.T @ Jv + Jw.T @ (R @ link.inertia @ R.T) @ Jw
    scale = 1.0 / np.sqrt(np.diag(H))
    eigenvalues = np.linalg.eigvalsh(scale[:, None] * H * scale)
    return float(eigenvalues[-1] / max(eigenvalues[0], np.finfo(float).tiny))


def _placed(tree: Tree, motion: list[Coordinate], width: int) -> list[tuple[Array, Array]]:
    """Axes of every link, and the Jacobian (6, width) of its origin's velocity and its angular velocity."""
    placed: list[tuple[Array, Array, Array]] = []
    column = 0
    for link, q in zip(tree.links, motion, strict=True):
        p, R, J = placed[link.parent] if link.parent >= 0 else (np.zeros(3), np.eye(3), np.zeros((6, width)))
        arm, R, own = _joint(link, q, R)
        J = np.vstack([J[:3] - skew(arm) @ J[3:], J[3:]])
        J[:, column : column + own.shape[1]] += own
        column += own.shape[1]
        placed.append((p + arm, R, J))
    return [(R, J) for _, R, J in placed]


def _joint(link: Link, q: Coordinate, R_parent: Array) -> tuple[Array, Array, Array]:
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


def delassus_condition(mechanism: Mechanism, state: State) -> float:
    """Condition number of ``A = Q M^-1 Q^T`` in unit-diagonal form, dependent rows left out; 1 without constraints.

    From the singular values of ``M^-1/2 Q^T``, so that A is not formed.
    """
    Q = constraint_jacobian(mechanism, state)
    if len(Q) == 0:
        return 1.0
    roots = _roots(mechanism, state)
    Y = np.hstack([np.linalg.solve(B.T, Q[:, 6 * i : 6 * i + 6].T).T for i, B in enumerate(roots)])
    singular = np.linalg.svd(Y / np.linalg.norm(Y, axis=1, keepdims=True), compute_uv=False)
    singular = singular[singular > RANK_TOLERANCE * singular[0]]
    return float((singular[0] / singular[-1]) ** 2)
