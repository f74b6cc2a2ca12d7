"""Response of a mechanism to forces on the rows of its contacts, stops and dry friction, at one state (`equations`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from consilience.mechanism import Array
from consilience.reference.contact.joint_friction import JointReaction

HELD = 1e-12  # response of a row that joints hold, over that without joints: it and its acceleration are rounding


@dataclass(frozen=True, eq=False)
class Response:
    """Free accelerations and the response to forces on rows at one state.

    Attributes
    ----------
    z : ndarray, shape (6 n_b,)
        ``L^T a_0``.
    K : ndarray, shape (m, 6 n_b)
    free : ndarray, shape (m,)
    load : ndarray, shape (6 n_b, m)
        ``L^-1 J^T``.
    given : ndarray, shape (m,)
        Forces on rows that the state gives; `free` contains their effect.
    reactions : dict of int to JointReaction
        Reactions that bound friction sets, linear in the forces of all rows.
    pull : float
        ``|L^-1 f|``: what is small beside it is rounding, where joints carry all forces.
    """

    z: Array
    K: Array
    free: Array
    load: Array
    given: Array
    reactions: dict[int, JointReaction]
    pull: float

    def accelerations(self, force: Array) -> Array:
        """Return the accelerations of the rows under forces on them, both of shape (m,); forces include `given`."""
        acceleration: Array = self.free + self.K @ (self.K.T @ (force - self.given))
        return acceleration


class ObservedRows(NamedTuple):
    """Gaps, rates and forces of rows at n states, and the offsets of friction sets."""

    gap: Array  # (n, n_p + n_l) as of `RowMotion`
    u: Array  # (n, m)
    force: Array  # (n, m)
    offset: Array  # (n, n_f)


class SampledRows(NamedTuple):
    """States at n times, projected, with the rows of contacts and joints there and the forces on those of contacts."""

    times: Array  # (n,)
    states: Array  # (n, ...) packed
    turns: Array  # (n, n_q) near those of the states
    gap: Array  # (n, n_p + n_l) as of `RowMotion`
    u: Array  # (n, m)
    force: Array  # (n, m)
    offset: Array  # (n, n_f)
    bias: Array  # (n, m)
    J: Array  # (n, m, 6 n_b)
    applied: Array  # (n, 6 n_b) forces and torques on the bodies
    Q: Array  # (n, q, 6 n_b) of the joints, and their gamma, violations and rates nu, each (n, q)
    gamma: Array
    value: Array
    rate: Array
    rank: Array  # (n, 1) upper limit of the rank of Q
