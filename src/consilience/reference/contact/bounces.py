"""Bounces that accumulate: infinitely many impacts of one contact in a finite time.

Where the last approach speeds of a contact fall by its coefficient e, `_TIMES` times, to `_RATIO`, and the next flight
is lower than `_HEIGHT` of the mechanism, the impact after that flight is the last, with e = 0. All further impulses
fall into it and into the force of the closed contact: together ``(1 + e) u / (1 - e)`` of the mass that the contact
feels, u the speed of the last approach. The series itself ends ``2 e u / (|g''| (1 - e))`` later.
"""

from __future__ import annotations

import numpy as np

from consilience.reference.contact.lasting import LastingContact
from consilience.reference.contact.layout import RowLayout

_TIMES = 3
_RATIO = 0.05
_HEIGHT = 1e-10


class Bounces:
    """Impacts of each normal since it was last closed."""

    def __init__(self, layout: RowLayout, length: float) -> None:
        self._layout, self._length = layout, length
        self._approach: dict[int, list[float]] = {n: [] for n in range(len(layout.normals))}
        self._last: dict[int, float] = {}  # normals in their last flight, with the acceleration that pulls them back

    def add(self, n: int, speed: float) -> None:
        """Add an impact of normal n with its speed of approach."""
        self._approach[n].append(speed)

    def last(self, n: int, speed: float) -> float | None:
        """Return how long after this impact of normal n its bounces end; None where it is not the last."""
        if n not in self._last:
            return None
        e = float(self._layout.restitution[n])
        return 2.0 * e * speed / (self._last.pop(n) * (1.0 - e))

    def note(self, found: LastingContact) -> None:
        """Note the normals whose next flight is the last, and forget the bounces of closed ones."""
        for n, history in self._approach.items():
            e = float(self._layout.restitution[n])
            if found.modes.closed[n]:
                history.clear()
            if len(history) <= _TIMES or not 0.0 < e < 1.0:
                continue
            ratios = np.array(history[-_TIMES:]) / np.array(history[-_TIMES - 1 : -1])
            pull = -float(found.acceleration[self._layout.normals[n]])
            low = (e * history[-1]) ** 2 < 2.0 * pull * _HEIGHT * self._length
            if pull > 0.0 and low and np.all(np.abs(ratios - e) <= _RATIO * e):
                self._last[n] = pull
