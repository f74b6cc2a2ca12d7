"""Compiled equations of contacts, `derivative.serve`, as Python asks them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np

from consilience.mechanism import Array
from consilience.reference.bodies.arrays import workspace
from consilience.reference.contact.derivative import (
    CARRY,
    COLUMNS,
    EVALUATE,
    FOLLOW,
    MOVE,
    ContactSystem,
    room_for_modes,
    serve,
)
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.pairs import RowMotion, row_motion
from consilience.reference.contact.response import SampledRows
from consilience.reference.kernel.mechanism_record import record_of
from consilience.reference.kernel.operation import BoundOperation
from consilience.reference.steppers.motion import END_STEP, Kernel

_NOTHING = np.zeros(0)
"""What a request neither reads nor writes."""


class CompiledEquations:
    """Arrays of the compiled equations of a mechanism, and requests to them.

    Attributes
    ----------
    layout : RowLayout
    system : ContactSystem
    kernel : Kernel
        `derivative.serve`, for steppers.
    rows : RowMotion
        Of the last state.
    rank : ndarray of int, shape (1,)
        Upper limit of the rank of the joint rows.
    offsets : ndarray, shape (n_f,)
        Constant part of the bound of each friction set at the last state.
    turns : ndarray, shape (n_q,)
        Joint coordinates from which full turns are counted.
    sums : ndarray, shape (2,)
        Units of impulses, N s, and of losses, J, in states that steppers integrate.
    width : int
        Number of what is written of a sample.
    """

    def __init__(self, layout: RowLayout) -> None:
        self.layout, self.model = layout, layout.model
        m, self._ws = len(layout.names), workspace(self.model)
        (q, n), self.sums = self._ws.Q.shape, np.full(2, np.sum(self.model.mass))
        self.rows: RowMotion = record_of(row_motion(len(layout.parts), len(layout.limits), m, n // 6))
        self.rank, self.turns = np.array([q]), np.zeros(len(self.model.coordinate))
        self.offsets = np.array([one.offset for one in layout.friction])
        self._modes = record_of(room_for_modes(layout, self.rank))
        record = self.model, layout.pairs.copy(), layout.limits, self.rows, self._ws, self._modes, self.turns, self.sums
        self.system = ContactSystem(*record)
        self._serve = BoundOperation(serve, self.system)
        self.kernel = Kernel(*self._serve.addresses)
        self._ends = tuple(accumulate([len(self.rows.gap), m, m, m, m * n, n, q * n, q, q, q, 1]))
        self.width = self._ends[-1]

    def count_sums_by(self, speed: float) -> None:
        """Count impulses and losses in units of all bodies' momentum and energy, ``m v`` and ``m v^2``, at a speed."""
        self.sums[:] = np.sum(self.model.mass) * speed ** np.array([1, 2])

    def _ask(self, request: int, t: float, y: Array, turns: Array, out: Array = _NOTHING) -> float:
        """Ask the compiled equations at a packed state."""
        self.turns[:] = turns
        return self._serve(request, t, y.reshape(-1), out)

    def move(self, t: float, y: Array, turns: Array) -> RowMotion:
        """Evaluate the rows at a packed state."""
        self._ask(MOVE, t, y, turns)
        return self.rows

    def carry_tangents(self, t: float, y: Array, turns: Array) -> None:
        """Let tangents that no law reads go on from those at a packed state (`pairs.carry_tangents`)."""
        self._ask(CARRY, t, y, turns)

    def joint_rows(self, t: float, y: Array, turns: Array) -> tuple[Array, Array, Array]:
        """Return Q, the violations and the rates nu of the joints' rows at a packed state."""
        self._ask(EVALUATE, t, y, turns)
        return self._ws.Q, self._ws.value, self._ws.rate

    def follow(self, y: Array, turns: Array) -> None:
        """Replace the joint coordinates that are read, shape (n_q,), by their values at a packed state."""
        self._ask(FOLLOW, 0.0, y, turns)
        turns[:] = self.turns

    def project(self, t: float, Y: Array, turns: Array, halted: Sequence[int] = ()) -> None:
        """Project a state onto what lasts and rows that have halted (`derivative.serve`), and follow its turns."""
        self._modes.halted[:] = 0
        self._modes.halted[list(halted)] = 1
        self._ask(END_STEP, t, Y, turns)
        turns[:] = self.turns

    def columns(self) -> tuple[Array, Array]:
        """Return S and E of the modes taken over, at the last state, shape (m, r) and (r, m); see `problem`."""
        both = np.zeros((2, self._modes.acting[0] + int(np.sum(self._modes.holds)), len(self.layout.names)))
        self._serve(COLUMNS, 0.0, _NOTHING, both.reshape(-1))
        return both[0].T, both[1]

    def sampled_rows(self, z: Array, found: Array) -> SampledRows:
        """Return samples from times, packed states and turns, (n, ...), and from what `derivative.SAMPLE` writes."""
        gap, u, force, bias, J, applied, Q, *joint = (found[:, a:b] for a, b in pairwise((0, *self._ends)))
        turns = z.shape[1] - len(self.turns)
        rows = J.reshape(len(z), *self.rows.J.shape), applied, Q.reshape(len(z), *self._ws.Q.shape), *joint
        states, offset = z[:, 1:turns].reshape(len(z), -1, 13), self.offsets[None].repeat(len(z), axis=0)
        return SampledRows(z[:, 0], states, z[:, turns:], gap, u, force, offset, bias, *rows)

    def march(self, turns: Array) -> None:
        """Begin steps of compiled equations alone, near joint coordinates, shape (n_q,)."""
        self.turns[:] = turns
        self._modes.halted[:] = 0
