"""Branches of a mechanism that meet at a singular pose, and their mobility."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.errors import CannotAssemble
from consilience.mechanism.assembly import assemble_positions
from consilience.mechanism.constraints import constraint_jacobian, velocity_sizes
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.singular import free_displacements, is_singular, move
from consilience.mechanism.spatial import Array, quaternion_product

_AWAY = 1e-2
"""Displacement to poses nearby: far above where Newton's method ends, and small against the bend of branches."""

_TRIALS = 12
"""Random displacements, by which branches are found."""

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six")


@dataclass(frozen=True)
class SingularPose:
    """Mobility at a singular pose and on the branches that meet there.

    Attributes
    ----------
    freedom : int
        Directions that the rows allow at the pose.
    branches : tuple of int
        Mobility of each branch that was found; empty where the mechanism can move at the pose alone, and locks.
    """

    freedom: int
    branches: tuple[int, ...]

    def __str__(self) -> str:
        """Return the mobilities in words."""
        if not self.branches:
            return f"mobility {self.freedom} at the pose alone: it locks"
        found = []
        for mobility in sorted(set(self.branches), reverse=True):
            count = self.branches.count(mobility)
            number = _NUMBERS[count] if count < len(_NUMBERS) else str(count)
            found.append(f"{mobility} on {'one branch' if count == 1 else f'each of {number} branches'}")
        return f"mobility {self.freedom} at the pose, {' and '.join(found)}"


def singular_pose(mechanism: Mechanism, state: State, t: float = 0.0) -> SingularPose | None:
    """Return the mobility at a singular pose and nearby; None if the pose is regular.

    Branches are found by assembly from random displacements, and told apart by their free directions.

    Parameters
    ----------
    mechanism, state, t
        As in `is_singular`.
    """
    if not is_singular(mechanism, state, t):
        return None
    free, rng = _free(mechanism, state, t), np.random.default_rng(0)
    branches: list[Array] = []
    for _ in range(_TRIALS):
        c = rng.normal(size=free.shape[1])
        step = _AWAY * (free @ c) / np.linalg.norm(c)
        try:
            near = assemble_positions(mechanism, move(state, step * velocity_sizes(mechanism)), t=t)
        except CannotAssemble:
            continue
        if _distance(mechanism, state, near) < 0.1 * _AWAY:
            continue  # back at the pose itself
        there = _free(mechanism, near, t)
        if not any(_same(there, known) for known in branches):
            branches.append(there)
    return SingularPose(free.shape[1], tuple(there.shape[1] for there in branches))


def _free(mechanism: Mechanism, state: State, t: float) -> Array:
    rows = constraint_jacobian(mechanism, state, t=t)[: mechanism.holonomic_count]
    return free_displacements(mechanism, state, rows)[0]


def _distance(mechanism: Mechanism, start: State, end: State) -> float:
    """Return the distance of two poses that are close, in unit displacements."""
    turned = quaternion_product(end.quat_WB, start.quat_WB * [1.0, -1.0, -1.0, -1.0])
    both = np.hstack([end.p_WB - start.p_WB, 2.0 * np.sign(turned[:, :1]) * turned[:, 1:]])
    return float(np.linalg.norm(both.ravel() / velocity_sizes(mechanism)))


def _same(one: Array, other: Array) -> bool:
    """Tell whether two bases, of poses on both sides of a singular one, span nearly the same directions."""
    if one.shape[1] != other.shape[1]:
        return False
    return bool(np.linalg.svd(one.T @ other, compute_uv=False)[-1] > 1.0 - 5.0 * _AWAY)
