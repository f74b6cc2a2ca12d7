"""Degrees of freedom: Kutzbach's count, rank of the constraints, undetermined reactions [EXU]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.mechanism import (
    RANK_TOLERANCE,
    Array,
    Joint,
    Mechanism,
    State,
    determinate_forces,
    free_directions,
    joint_frames,
    null_space,
    row_jacobian,
    skew,
)


@dataclass(frozen=True)
class Freedom:
    """Degrees of freedom of p bodies with q constraint rows at one state.

    Attributes
    ----------
    kutzbach : int
        ``6 p - q``; too small, even negative, where rows are redundant.
    planar : int or None
        ``3 p - q_planar``, counted in the plane of the motion; None unless every joint keeps one common plane.
    rank : int
        Rank of the constraint Jacobian Q.
    freedom : int
        Degrees of freedom, ``6 p - rank Q``.
    redundant : int
        Rows that depend on the others, ``q - rank Q``.
    undetermined : tuple of str
        Joints with at least one reaction component that equilibrium does not determine.
    """

    kutzbach: int
    planar: int | None
    rank: int
    freedom: int
    redundant: int
    undetermined: tuple[str, ...]


def count_freedom(mechanism: Mechanism, state: State) -> Freedom:
    """Count degrees of freedom and redundant constraints [EXU (2), (3)].

    Parameters
    ----------
    mechanism : Mechanism
    state : State
        Consistent state; at a singular pose (a dead centre) the rank is lower.

    Returns
    -------
    Freedom

    Raises
    ------
    LinAlgError
        If the singular value decomposition of the Jacobian fails.
    """
    width, rows = 6 * len(mechanism.bodies), mechanism.constraint_count()
    freedom = free_directions(mechanism, state).shape[1]
    determined = determinate_forces(mechanism, state).reactions
    return Freedom(
        kutzbach=width - rows,
        planar=_planar_count(mechanism, state),
        rank=width - freedom,
        freedom=freedom,
        redundant=rows - width + freedom,
        undetermined=tuple(j.name for j, known in zip(mechanism.joints, determined, strict=True) if not np.all(known)),
    )


def _relative_freedom(mechanism: Mechanism, state: State, joint: Joint) -> tuple[Array, Array]:
    """Return the free velocities of the successor's origin and angular velocities, world axes, each (freedom, 3)."""
    frames = joint_frames(mechanism, state, joint)
    rows = np.array([row_jacobian(frames, row)[6:] for row in joint.rows]).reshape(-1, 6)
    basis = null_space(rows).T
    return basis[:, :3], basis[:, 3:]


def _planar_count(mechanism: Mechanism, state: State) -> int | None:
    """Return ``3 p - q_planar`` if a normal is parallel to all free rotations and orthogonal to all free translations.

    The reference point is arbitrary: rotation about the normal moves every point orthogonally to it.
    """
    conditions = [np.zeros((3, 3))]
    for joint in mechanism.joints:
        linear, angular = _relative_freedom(mechanism, state, joint)
        conditions += [linear, *(skew(w) for w in angular)]
    smallest = np.linalg.svd(np.vstack(conditions), compute_uv=False)[-1]
    if smallest > RANK_TOLERANCE:
        return None
    return 3 * len(mechanism.bodies) - sum(3 - (6 - len(joint.rows)) for joint in mechanism.joints)
