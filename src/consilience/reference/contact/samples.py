"""Record of a motion with contacts: samples of states, gaps, impulses, modes and losses; events between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from consilience.engine import EVENT_KINDS, TrajectoryAnswer
from consilience.mechanism import Array, continuous_in_time
from consilience.reference.bodies.arrays import unpack
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.response import SampledRows
from consilience.reference.contact.row_modes import RowModes

SEPARATED, SLIDING, STICKING = 0, 1, 2
"""Modes of a site; of several parts one that slides decides."""


@dataclass(frozen=True, eq=False)
class ContactEvent:
    """Event of a contact, stop or dry friction.

    Attributes
    ----------
    time : float, s
    kind : str
        One of `EVENT_KINDS`.
    site : int
        Index into contacts, then stops, then dry frictions.
    name : str
        What it is, such as ``contact 'heel'``.
    """

    time: float
    kind: str
    site: int
    name: str


def site_modes(layout: RowLayout, modes: RowModes) -> Array:
    """Return the mode of each site, shape (n_sites,): a contact of no friction slides, a stop sticks."""
    found = np.full(len(layout.sites), SEPARATED)
    stops = len(layout.names) - len(layout.limits)
    held = np.zeros(len(layout.names), dtype=bool)
    for one, mode in zip(layout.friction, modes.friction, strict=True):
        if mode is not None and len(mode.held) == len(one.rows):
            held[list(one.rows)] = True
    closed = [n for n, shut in zip(layout.normals, modes.closed, strict=True) if shut]
    closed += [3 * k for k, pressed in zip(layout.springs, modes.pressed, strict=True) if pressed]
    for n in closed:
        sticks = n >= stops or bool(held[n + 1] and held[n + 2])
        _mark(found, int(layout.site[n]), STICKING if sticks else SLIDING)
    for one, dry, mode in zip(layout.friction, layout.dry, modes.friction, strict=True):
        if dry is not None and mode is not None:
            _mark(found, int(layout.site[one.rows[0]]), STICKING if len(mode.held) else SLIDING)
    return found


def _mark(found: Array, site: int, mode: int) -> None:
    found[site] = mode if found[site] == SEPARATED else min(mode, found[site])


class Samples:
    """Samples and events of one motion, with the units of its impulses and losses, shape (2,).

    Attributes
    ----------
    events : list of ContactEvent
    """

    def __init__(self, layout: RowLayout, units: Array) -> None:
        self._layout, self._units = layout, units
        self.events: list[ContactEvent] = []
        self._modes = np.zeros(0)  # of the sites, now
        springs = [layout.parts[k].compliance.stiffness for k in layout.springs]
        self._stiffness, self._owner = np.array(springs), layout.site[3 * np.arange(len(layout.parts))]
        self._found: list[tuple[Array, ...]] = []  # states, gaps, impulses, modes and losses of each step
        self._spent: list[tuple[Array, ...]] = []  # states, turns, and losses with what springs of contacts store

    def record(self, modes: RowModes, rows: SampledRows, sums: Array) -> None:
        """Record samples with what is summed over time (`Stepper.sample`), shape (n, `RowLayout.sums`)."""
        layout, count = self._layout, len(rows.times)
        contacts, parts = len(layout.mechanism.contacts), len(layout.parts)
        gaps = np.full((contacts, count), np.inf)
        np.minimum.at(gaps, self._owner, rows.gap[:, :parts].T)
        stored = 0.5 * rows.gap[:, list(layout.springs)] ** 2 @ (self._stiffness * modes.pressed)
        impulse, loss = self._units
        impulses, losses = impulse * sums[:, : 3 * contacts].reshape(count, -1, 3), loss * sums[:, -1] - stored
        shown = self._modes[None, :contacts].repeat(count, axis=0)
        self._found.append((rows.states, gaps.T, impulses, shown, losses))
        self._spent.append((rows.states, rows.turns, losses + stored))

    def add(self, time: float, kind: str, site: int) -> None:
        """Add an event."""
        self.events.append(ContactEvent(time, kind, site, self._layout.sites[site]))

    def change_modes(self, time: float, modes: RowModes, hit: set[int], stopped: frozenset[int]) -> None:
        """Add the events that impacts of normals, modes until now and from now on, and slips that reverse tell."""
        layout, after = self._layout, site_modes(self._layout, modes)
        before, self._modes = self._modes if len(self._modes) else after, after
        reversed_ = {int(layout.site[layout.friction[j].rows[0]]) for j in stopped}
        struck = dict.fromkeys(int(layout.site[layout.normals[n]]) for n in sorted(hit))
        for site in struck:
            self.add(time, "impact", site)
        for site, (old, new) in enumerate(zip(before, after, strict=True)):
            turned = site in reversed_ and old == new == SLIDING
            if (old == new and not turned) or (site in struck and old == SEPARATED):
                continue
            kind = {SEPARATED: "opens", SLIDING: "slips", STICKING: "sticks"}[int(new)]
            self.add(time, "closes" if old == SEPARATED else kind, site)

    def in_order(self) -> list[ContactEvent]:
        """Return the events in order of time: the end of bounces is known before it comes."""
        return sorted(self.events, key=lambda event: event.time)

    def spent(self) -> tuple[Array, ...]:
        """Return packed states, joint coordinates near them, and losses with what springs of contacts store."""
        return tuple(np.concatenate(part) for part in zip(*self._spent, strict=True))

    def answer(self, times: Array, counters: dict[str, int | float]) -> TrajectoryAnswer:
        """Return the answer of all samples."""
        states, gaps, impulses, modes, losses = (np.concatenate(part) for part in zip(*self._found, strict=True))
        p, quat, v, w = unpack(self._layout.smooth, states)
        events = self.in_order()
        return TrajectoryAnswer(
            times,
            p,
            continuous_in_time(quat),
            v,
            w,
            counters,
            contact_gap=gaps,
            contact_impulse=np.diff(impulses, axis=0, prepend=impulses[:1]),
            contact_mode=modes,
            contact_loss=losses - losses[0],
            event_time=np.array([event.time for event in events]),
            event_contact=np.array([event.site for event in events], dtype=np.int64),
            event_kind=np.array([EVENT_KINDS.index(event.kind) for event in events], dtype=np.int64),
        )
