"""Contacts along a motion: points, forces and modes at the frames of a replay, and phases between changes of a mode."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from consilience.engine import CONTACT_MODES, EVENT_KINDS, TrajectoryAnswer
from consilience.mechanism import (
    Array,
    Contact,
    DryFriction,
    Mechanism,
    State,
    Stop,
    contact_pairs,
    contact_parts,
    determinate_forces,
    nearest_points,
)

CLOSED = 1e-6
"""Largest gap of a part that shares the point of a force, over the largest distance between parts' gaps."""

_IMPACT = EVENT_KINDS.index("impact")
_MODE_AFTER = {
    "impact": "",
    "closes": "closed",
    "opens": "separated",
    "slips": "sliding",
    "sticks": "sticking",
    "bounces end": "closed",
}
"""Mode of a stop or of a dry friction after an event; an impact leaves it open."""

_MODE_BEFORE = {"closes": "separated", "bounces end": "separated", "opens": "closed"}
_MODE_BEFORE |= {"slips": "sticking", "sticks": "sliding"}
"""Its mode before the first event that tells one."""


def contacts_at_frames(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> list[dict[str, Any]]:
    """Compute nearest points, gaps, mean forces and modes of all contacts at samples, as `replayschema.ReplayContact`.

    A force is the impulse on `body` since the frame before over the time since then: it exists across impacts. Its
    point is the mean of the nearest points of the parts that touch. Nothing without contacts, impulses or modes.

    Where equilibrium leaves a force open, before or after the interval, the force is one of many; what is known then is
    at most the sum over all contacts of the two bodies.
    """
    impulse, modes = answer.contact_impulse, answer.contact_mode
    if impulse is None or modes is None or not mechanism.contacts or len(samples) < 2:
        return []
    states = [answer.state(k) for k in samples]
    ends, spans = pairwise(samples), np.diff(answer.time[samples])
    force = np.array([impulse[a + 1 : b + 1].sum(axis=0) / h for (a, b), h in zip(ends, spans, strict=True)])
    force = np.concatenate([force[:1], force])  # at the first frame nothing has passed: that of the next one
    signs = contact_pairs(mechanism.contacts)
    pair, sums = np.argmax(np.abs(signs), axis=0), np.einsum("pc,kci->kpi", signs, force)
    known = [determinate_forces(mechanism, state) for state in states]
    own = _on_both_sides(np.array([one.contacts for one in known]))
    joint = _on_both_sides(np.array([one.pairs for one in known]))
    return [
        {
            "name": contact.name,
            "body": _plain([one[0] for one in points]),
            "partner": _plain([one[1] for one in points]),
            "gap": _plain([one[2] for one in points]),
            "force": _plain(force[:, c]),
            "open": [not sure for sure in own[:, c].tolist()],
            "together": [
                _plain(signs[p, c] * total) if sure else None
                for p in [pair[c]]
                for sure, total in zip(joint[:, p], sums[:, p], strict=True)
            ],
            "mode": [CONTACT_MODES[m] for m in modes[samples, c]],
        }
        for c, contact in enumerate(mechanism.contacts)
        for points in [[_touching(mechanism, state, contact) for state in states]]
    ]


def _touching(mechanism: Mechanism, state: State, contact: Contact) -> tuple[Array, Array, float]:
    """Return the mean nearest points on body and partner of the parts with the smallest gap, and that gap, m."""
    near = [nearest_points(mechanism, state, part) for part in contact_parts(contact)]
    gaps = np.array([one.gap for one in near])
    own = np.flatnonzero(gaps <= gaps.min() + CLOSED * np.ptp(gaps))
    on_body, on_partner = (np.mean([getattr(near[k], side) for k in own], axis=0) for side in ("on_body", "on_partner"))
    return on_body, on_partner, float(gaps.min())


def _on_both_sides(known: Array) -> Array:
    """Return whether all components, (n_t, n, 3), are known at each frame and at the one before, shape (n_t, n)."""
    both = np.all(known, axis=2)
    both[1:] &= both[:-1]
    return np.asarray(both)


def _plain(values: Any) -> list[Any]:
    """Round to five digits."""
    shape = np.shape(values)
    found = np.array([float(f"{x:.5g}") for x in np.ravel(values)]) + 0.0
    plain: list[Any] = found.reshape(shape).tolist()
    return plain


def phases(mechanism: Mechanism, answer: TrajectoryAnswer) -> list[dict[str, Any]]:
    """List the phases of contacts, stops and dry frictions, and the times of impacts, as `replayschema.ReplayPhases`.

    The modes of contacts are those at samples, which change at the event between two samples, or without events at the
    later one; those of stops and dry frictions are told by events alone.
    """
    found = []
    for c, contact in enumerate(mechanism.contacts):
        events = _events(answer, c)
        pieces = [] if answer.contact_mode is None else _sampled(answer.time, answer.contact_mode[:, c], events)
        found.append(_phases(contact.name, [contact.body, contact.partner], "", pieces, events))
    in_joints: list[Stop | DryFriction] = [*mechanism.stops, *mechanism.dry_frictions]
    for k, element in enumerate(in_joints):
        events = _events(answer, len(mechanism.contacts) + k)
        found.append(_phases(element.name, [], element.joint, _told(answer.time, events), events))
    return [one for one in found if one["pieces"]]


_Event = tuple[float, int]
_Piece = tuple[float, float, str]


def _events(answer: TrajectoryAnswer, index: int) -> list[_Event]:
    """List times and kinds of the events of one contact, stop or dry friction."""
    if answer.event_time is None or answer.event_contact is None or answer.event_kind is None:
        return []
    own = answer.event_contact == index
    return list(zip(answer.event_time[own].tolist(), answer.event_kind[own].tolist(), strict=True))


def _sampled(time: Array, modes: Array, events: list[_Event]) -> list[_Piece]:
    changes = np.flatnonzero(np.diff(modes)) + 1
    times = [float(time[0])]
    for k in changes:
        between = [(kind != _IMPACT, t) for t, kind in events if time[k - 1] < t <= time[k]]
        times.append(max(between)[1] if between else float(time[k]))
    names = [CONTACT_MODES[modes[k]] for k in (0, *changes)]
    return [(a, b, mode) for (a, b), mode in zip(pairwise([*times, float(time[-1])]), names, strict=True)]


def _told(time: Array, events: list[_Event]) -> list[_Piece]:
    """Return the pieces that events tell; with impacts alone one piece apart, without events none."""
    named = [(t, EVENT_KINDS[kind]) for t, kind in events]
    telling = [(t, kind) for t, kind in named if _MODE_AFTER[kind]]
    if not named:
        return []
    modes = [_MODE_BEFORE[telling[0][1]] if telling else "separated", *(_MODE_AFTER[kind] for _, kind in telling)]
    times = [float(time[0]), *(t for t, _ in telling), float(time[-1])]
    pieces = list[_Piece]()
    for (a, b), mode in zip(pairwise(times), modes, strict=True):
        if pieces and pieces[-1][2] == mode:
            pieces[-1] = (pieces[-1][0], b, mode)
        else:
            pieces.append((a, b, mode))
    return pieces


def _phases(name: str, bodies: list[str], joint: str, pieces: list[_Piece], events: list[_Event]) -> dict[str, Any]:
    impacts = sorted({t for t, kind in events if kind == _IMPACT})
    return {"name": name, "bodies": bodies, "joint": joint, "pieces": [list(p) for p in pieces], "impacts": impacts}
