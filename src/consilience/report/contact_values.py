"""What a motion tells of contacts, stops and dry friction, with names and words in place of numbers."""

from __future__ import annotations

import numpy as np

from consilience.engine import CONTACT_MODES, EVENT_KINDS, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism

QUANTITIES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "contact_gap": ((), "m", "smallest gap of the parts of the contact"),
    "contact_impulse": (("x", "y", "z"), "N s", "impulse on the contact's body since the sample before, world axes"),
    "contact_mode": ((), "", "separated, sliding or sticking"),
}
"""Quantities of each contact over time: components, unit, label."""

LOSS = ("contact_loss", "J", "energy lost in contacts, stops and dry friction since the start")


def contact_values(answer: TrajectoryAnswer) -> dict[str, Array]:
    """Return the quantities of `QUANTITIES` that a motion gives, each (n_t, n_c, ...); modes are words."""
    given = {name: getattr(answer, name) for name in QUANTITIES}
    found = {name: np.asarray(value) for name, value in given.items() if value is not None and np.shape(value)[1]}
    if "contact_mode" in found:
        found["contact_mode"] = np.array(CONTACT_MODES)[found["contact_mode"]]
    return found


def loss_over_time(answer: TrajectoryAnswer) -> dict[str, Array]:
    """Return the energy lost since the start, shape (n_t,), by its name; nothing where the motion does not give it."""
    return {} if answer.contact_loss is None else {LOSS[0]: np.asarray(answer.contact_loss)}


def event_values(mechanism: Mechanism, answer: TrajectoryAnswer) -> dict[str, Array]:
    """Return times, elements and kinds of the events that a motion gives, each (n_e,); nothing where it gives none."""
    if answer.event_time is None or answer.event_contact is None or answer.event_kind is None:
        return {}
    elements = [*mechanism.contacts, *mechanism.stops, *mechanism.dry_frictions]
    names = np.array([one.name for one in elements], dtype=str)
    kinds = np.array(EVENT_KINDS)[answer.event_kind]
    return {
        "event_time": np.asarray(answer.event_time),
        "event_element": names[answer.event_contact],
        "event_kind": kinds,
    }
