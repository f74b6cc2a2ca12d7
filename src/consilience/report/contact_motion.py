"""Contacts along a motion: points, forces and modes at the frames of a replay, and phases between changes of a mode."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from consilience.engine import CONTACT_MODES, EVENT_KINDS, TrajectoryAnswer, determinate_impulses
from consilience.mechanism import (
    Array,
    Contact,
    DryFriction,
    Mechanism,
    State,
    Stop,
    contact_pairs,
    contact_parts,
    joint_rates,
    nearest_points,
    relative_motion,
)

CLOSED = 1e-6
"""Largest gap of a part that shares the point of a force, over the largest distance between parts' gaps."""

AT_REST = 1e-6
"""Largest rate of a joint coordinate at rest, over its largest rate along the motion."""

_MODE_AFTER = {"closes": "closed", "opens": "separated", "slips": "sliding", "sticks": "sticking"}
_MODE_AFTER |= {"bounces end": "closed"}
"""Mode of a stop or of a dry friction after an event; an impact leaves it open, or is one that closes."""

_MODE_BEFORE = {"closes": "separated", "bounces end": "separated", "opens": "closed"}
_MODE_BEFORE |= {"slips": "sticking", "sticks": "sliding"}
"""Mode before an event, as far as events tell; a slip that reverses slips anew."""


def contacts_at_frames(mechanism: Mechanism, answer: TrajectoryAnswer, samples: Array) -> list[dict[str, Any]]:
    """Compute nearest points, gaps, mean forces and modes of all contacts at samples, as `replayschema.ReplayContact`.

    A force is the impulse on `body` since the frame before over the time since then: it exists across impacts. Its
    point is the mean of the nearest points of the parts that touch. Nothing without contacts, impulses or modes.

    Where equilibrium leaves a force open (`engine.determinate_impulses`), the force is one of many; what is known
    then is at most the sum over all contacts of the two bodies.
    """
    impulse, modes = answer.contact_impulse, answer.contact_mode
    if impulse is None or modes is None or not mechanism.contacts or len(samples) < 2:
        return []
    states = [answer.state(k) for k in samples]
    spans = np.diff(answer.time[samples])
    force = _between(np.add, impulse, samples) / spans[:, None, None]
    signs = contact_pairs(mechanism.contacts)
    pair, known = np.argmax(np.abs(signs), axis=0), determinate_impulses(mechanism, answer)
    own, joint = (_between(np.logical_and, part.all(axis=2), samples) for part in (known.contacts, known.pairs))
    force, own, joint = (np.concatenate([part[:1], part]) for part in (force, own, joint))  # the first: of the next one
    sums = np.einsum("pc,kci->kpi", signs, force)
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


def _between(join: np.ufunc, values: Any, samples: Array) -> Array:
    """Return what values of intervals, (n_t, ...), make together between one frame and the next, shape (n - 1, ...)."""
    return np.array([join.reduce(values[a + 1 : b + 1], axis=0) for a, b in pairwise(samples)])


def _plain(values: Any) -> list[Any]:
    """Round to five digits."""
    shape = np.shape(values)
    found = np.array([float(f"{x:.5g}") for x in np.ravel(values)]) + 0.0
    plain: list[Any] = found.reshape(shape).tolist()
    return plain


def phases(mechanism: Mechanism, answer: TrajectoryAnswer) -> list[dict[str, Any]]:
    """List the phases of contacts, stops and dry frictions, and the times of impacts, as `replayschema.ReplayPhases`.

    The modes of contacts are those at samples, and between two samples those that events tell; without events they
    change at the later sample. Those of stops and dry frictions are told by events alone.
    """
    found = []
    for c, contact in enumerate(mechanism.contacts):
        events = _events(answer, c)
        pieces = [] if answer.contact_mode is None else _sampled(answer.time, answer.contact_mode[:, c], events)
        found.append(_phases(contact.name, [contact.body, contact.partner], "", pieces, events))
    in_joints: list[Stop | DryFriction] = [*mechanism.stops, *mechanism.dry_frictions]
    for k, element in enumerate(in_joints):
        events = _events(answer, len(mechanism.contacts) + k)
        pieces = _told(mechanism, answer, element, events) if events else []
        found.append(_phases(element.name, [], element.joint, pieces, events))
    return [one for one in found if one["pieces"]]


_Event = tuple[float, str]
_Piece = tuple[float, float, str]


def _events(answer: TrajectoryAnswer, index: int) -> list[_Event]:
    """List times and kinds of the events of one contact, stop or dry friction."""
    if answer.event_time is None or answer.event_contact is None or answer.event_kind is None:
        return []
    own = answer.event_contact == index
    kinds = [EVENT_KINDS[kind] for kind in answer.event_kind[own]]
    return list(zip(answer.event_time[own].tolist(), kinds, strict=True))


def _sampled(time: Array, modes: Array, events: list[_Event]) -> list[_Piece]:
    """Return the pieces of a contact."""
    names = [CONTACT_MODES[mode] for mode in modes]
    passed = np.searchsorted([t for t, _ in events], time, side="right")
    changes = [(float(time[0]), names[0])]
    for k, (before, after) in enumerate(pairwise(names)):
        own = _changes(events[passed[k] : passed[k + 1]], before, after)
        if own or before != after:
            changes += [*own[:-1], (own[-1][0] if own else float(time[k + 1]), after)]
    return _pieces(changes, float(time[-1]))


def _changes(events: list[_Event], mode: str, last: str) -> list[_Event]:
    """Return times and modes after the events between two samples, from the modes at both."""
    found = []
    for k, (t, kind) in enumerate(events):
        later = [one for _, one in events[k + 1 :]]
        if kind == "impact" and (mode != "separated" or "impact" in later[:1]):
            continue  # it leaves the mode, or is one of several
        mode = _MODE_AFTER.get(kind, "closed")
        if mode == "closed":  # it slides or sticks: what follows tells
            mode = next((_MODE_BEFORE[one] for one in later if one != "impact"), last)
        found.append((t, mode))
    return found


def _told(
    mechanism: Mechanism, answer: TrajectoryAnswer, element: Stop | DryFriction, events: list[_Event]
) -> list[_Piece]:
    """Return the pieces of a stop or a dry friction: an impact closes that it stays closed after."""
    start, end = float(answer.time[0]), float(answer.time[-1])
    known = [*events[1:], (end, "")]
    telling = []
    for (t, kind), (then, following) in zip(events, known, strict=True):
        stays = not following and not _moves(mechanism, answer, element, t, end)
        closes = kind == "impact" and t < then and (following == "opens" or stays)
        if kind in _MODE_AFTER or closes:
            telling.append((t, _MODE_AFTER.get(kind, "closed"), _MODE_BEFORE.get(kind, "separated")))
    first = telling[0][2] if telling else "separated"
    if first == "sticking" and _moves(mechanism, answer, element, start, telling[0][0]):
        first = "sliding"
    return _pieces([(start, first), *((t, mode) for t, mode, _ in telling)], end)


def _moves(
    mechanism: Mechanism, answer: TrajectoryAnswer, element: Stop | DryFriction, start: float, end: float
) -> bool:
    """Whether the coordinate of a stop or a dry friction moves at a sample between two times."""
    joint = next(one for one in mechanism.joints if one.name == element.joint)
    motions = [relative_motion(mechanism, answer.state(k), joint) for k in range(len(answer.time))]
    rates = np.abs([float(joint_rates(joint, motion)[element.coordinate]) for motion in motions])
    inside = (start < answer.time) & (answer.time < end)
    return bool(np.any(rates[inside] > AT_REST * np.max(rates)))


def _pieces(changes: list[_Event], end: float) -> list[_Piece]:
    """Return the pieces between times at which a mode begins; one that lasts no time, or goes on, is none."""
    pieces: list[_Piece] = []
    for (a, mode), (b, _) in pairwise([*changes, (end, "")]):
        if pieces and pieces[-1][2] == mode:
            pieces[-1] = (pieces[-1][0], b, mode)
        elif a < b or not pieces:
            pieces.append((a, b, mode))
    return pieces


def _phases(name: str, bodies: list[str], joint: str, pieces: list[_Piece], events: list[_Event]) -> dict[str, Any]:
    impacts = sorted({t for t, kind in events if kind == "impact"})
    return {"name": name, "bodies": bodies, "joint": joint, "pieces": [list(p) for p in pieces], "impacts": impacts}
