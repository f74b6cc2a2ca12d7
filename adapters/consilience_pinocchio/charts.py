"""Charts of rods (`consilience.engine.rods`) in Pinocchio's coordinates, at a state and during an integration."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from consilience.engine import ROD_MARGIN, rod_turn, rods_of, suited_rods, turned_rods
from consilience.mechanism import Array, State
from consilience_pinocchio.translate import Translation, translate


def suited(translation: Translation, state: State) -> Translation:
    """Return a translation whose rods are far from singular at `state`: the given one, or one with turned frames."""
    mechanism = suited_rods(translation.mechanism, state)
    return translation if mechanism is translation.mechanism else translate(mechanism)


class ChartWatch:
    """Charts of the rods of a translation during an integration."""

    def __init__(self, translation: Translation) -> None:
        self._translation = translation
        joints, seats = translation.model.joints, translation.seats
        rods = rods_of(translation.mechanism, translation.tree)
        self._chains = {first: [joints[seat.joint] for seat in seats[first : first + 3]] for first in rods}

    @property
    def needed(self) -> bool:
        """Whether there are rods."""
        return bool(self._chains)

    def left(self, q: Array) -> bool:
        """Whether a rod is too near to its singular pose."""
        return any(abs(np.cos(q[second.idx_q])) < ROD_MARGIN for _, second, _ in self._chains.values())

    def change(self, q: Array, v: Array) -> tuple[Translation, Array, Array]:
        """Turn the start frames of all rods until the rods lie along z, and transform q and v."""
        turns: dict[int, Array] = {}
        q, v = q.copy(), v.copy()
        for number, (first, second, ball) in self._chains.items():
            angles, rates = [first.idx_q, second.idx_q], [first.idx_v, second.idx_v]
            turns[number], w_rod = rod_turn(q[angles], v[rates])
            xyzw = q[ball.idx_q : ball.idx_q + 4]
            R = pin.Quaternion(xyzw / np.linalg.norm(xyzw)).toRotationMatrix()
            v[ball.idx_v : ball.idx_v + 3] += w_rod[2] * R[2]
            q[angles], v[rates] = 0.0, w_rod[:2]
        return translate(turned_rods(self._translation.mechanism, self._translation.tree, turns)), q, v
