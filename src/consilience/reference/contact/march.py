"""March of a motion through steps in which nothing happens: what the compiled `quiet_steps` are to look at."""

from __future__ import annotations

from typing import Any

import numpy as np

from consilience.mechanism import Array
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.events import ARMED, CLEAR, Watch
from consilience.reference.contact.pairs import DISC
from consilience.reference.contact.quiet_steps import (
    GAP,
    INTERVALS,
    MARCH,
    MARGIN,
    NORMAL,
    SLIP,
    WATCHED,
    MarchArrays,
    march,
)
from consilience.reference.contact.response import SampledRows
from consilience.reference.contact.row_modes import RowModes
from consilience.reference.kernel.operation import BoundOperation
from consilience.reference.steppers.explicit import ExplicitArrays
from consilience.reference.steppers.motion import Kernel

_KINDS = {"gap": GAP, "normal": NORMAL, "margin": MARGIN, "slip": SLIP}

_NODES, _ROOM = INTERVALS // 4 + 2, 100_000
"""Room for the nodes of a step, and for what is written of the samples of a march, in numbers."""


class QuietSteps:
    """Steps of one motion in which nothing happens.

    Attributes
    ----------
    now : ndarray, shape (1,) of MARCH
    able : bool
        Whether all event functions of the present modes are compiled.
    """

    def __init__(
        self,
        equations: ContactEquations,
        explicit: ExplicitArrays,
        stepper: Kernel,
        times: Array,
        sizes: tuple[float, ...],
    ) -> None:
        """Prepare a motion with samples at times.

        `sizes` are length, span, longest step, `Stepper.straight` and `Rims.least`.
        """
        system, layout, size = equations.system, equations.layout, explicit.K.shape[1]
        gaps, m = len(system.rows.gap), len(system.rows.u)
        packed = size - layout.sums
        self._equations, self.able, self.now = equations, False, np.zeros(1, MARCH)
        now = self.now[0]
        now["length"], now["span"], now["longest"], now["straight"], now["flat"] = sizes
        now["bodies"], now["packed"] = len(equations.model.mass), packed
        self._watched = np.zeros(len(layout.normals) + 2 * len(layout.friction), WATCHED)
        room = min(len(times), max(1, _ROOM // equations.width))
        self._states, self._sums = np.zeros((room, 1 + packed + len(system.turns))), np.zeros((room, layout.sums))
        self._found = np.zeros((room, equations.width))
        buffers = np.zeros(m), np.zeros(_NODES * (1 + packed)), np.zeros(_NODES * (gaps + 2 * m))
        discs = layout.pairs[layout.pairs["kind"] == DISC]
        found = times.copy(), self._states, self._sums, self._found  # contiguous, as kernels are compiled for
        record = explicit, stepper, system.rows, system.modes, system.turns, self._watched, discs, *buffers, *found
        self._march = BoundOperation(march, MarchArrays(self.now, *record))

    def watch(self, watches: list[Watch], modes: RowModes) -> None:
        """Look at the event functions of modes that begin."""
        listed = [(w, *one) for w, watch in enumerate(watches) for one in self._parts(watch, modes)]
        now, known = self.now[0], all(watch.kind in _KINDS for _, watch, _ in listed)
        self._of = np.array([w for w, *_ in listed], dtype=int)
        self.able = known and not self._equations.reacting
        now["watched"], now["loaded"] = len(listed), 0
        for record, (_, watch, least) in zip(self._watched, listed if self.able else (), strict=False):
            record["kind"], record["least"], record["ready"] = _KINDS[watch.kind], least, ARMED * watch.scale
            record["disc"], record["row"], record["load"] = -1, -1, -1
            self._take(record, watch, modes)

    def _parts(self, watch: Watch, modes: RowModes) -> list[tuple[Watch, float]]:
        """Return event functions with the values above which nothing happens: of a group those of all its bounds."""
        if watch.kind != "group":
            return [(watch, 0.0)]
        normals = [Watch("normal", n, watch.scale) for n in np.flatnonzero(modes.closed).tolist()]
        held = [j for j, mode in enumerate(modes.friction) if mode is not None and len(mode.held)]
        return [(one, CLEAR * watch.scale) for one in (*normals, *(Watch("margin", j, watch.scale) for j in held))]

    def _take(self, record: Any, watch: Watch, modes: RowModes) -> None:
        """Write what an event function reads."""
        equations, layout, k = self._equations, self._equations.layout, watch.index
        if watch.kind == "gap":
            record["row"] = layout.gaps[k], layout.normals[k]
        elif watch.kind == "normal":
            record["row"][0] = layout.normals[k]
        else:
            law, heading = layout.friction[k], modes.heading[k]
            self.able &= law.is_disc or len(law.rows) == 1
            record["row"][: len(law.rows)], record["static"] = law.rows, law.static
            record["offset"], record["load"] = equations.offsets[k], -1 if law.load is None else law.load
            if watch.kind == "slip" and heading is not None:
                record["heading"][: len(heading)] = heading
                record["disc"] = equations.acting.index(k) if law.is_disc else -1
                self.now["loaded"] |= law.load is not None

    def arm(self, armed: Array) -> None:
        """Take over which event functions count, shape (n_w,): `march` overwrites it."""
        self._armed = armed
        self._watched["armed"][: len(self._of)] = armed[self._of]

    def march(self, t: float, Y: Array, turns: Array, recorded: int) -> float:
        """Take steps from a state with impulses and loss; overwrite it and the turns, and return the time.

        Samples are those from the number `recorded` on.
        """
        self.now["first"] = self.now["recorded"] = recorded
        reached = self._march(0, t, Y, turns)
        self._armed[self._of] = self._watched["armed"][: len(self._of)]  # a group as each of its bounds
        return reached

    def sampled(self) -> tuple[SampledRows, Array]:
        """Return the samples of the last march, and what is summed over time (`Stepper.sample`)."""
        count = int(self.now["recorded"][0] - self.now["first"][0])
        rows = self._equations.sampled_rows(self._states[:count].copy(), self._found[:count].copy())
        return rows, self._sums[:count].copy()
