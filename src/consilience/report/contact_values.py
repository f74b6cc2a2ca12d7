"""What a motion tells of contacts, stops and dry friction, with names and words in place of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from consilience.engine import CONTACT_MODES, EVENT_KINDS, TrajectoryAnswer, determinate_impulses
from consilience.mechanism import Array, Mechanism, contact_pairs

QUANTITIES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "contact_gap": ((), "m", "smallest gap of the parts of the contact"),
    "contact_impulse": (("x", "y", "z"), "N s", "impulse on the contact's body since the sample before, world axes"),
    "contact_mode": ((), "", "separated, sliding or sticking"),
    "contact_impulse_open": (("x", "y", "z"), "", "whether the impulse is one choice of many"),
    "contact_sum_open": (("x", "y", "z"), "", "whether the sum over all contacts of the two bodies is, too"),
}
"""Quantities of each contact over time: components, unit, label."""

LOSSES = {
    "contact_loss": ("J", "energy lost in contacts, stops and dry friction since the start"),
    "contact_loss_open": ("", "whether the energy lost is one choice of many"),
}
"""Quantities of all contacts over time: unit, label."""


@dataclass(frozen=True, eq=False)
class OpenForces:
    """What is open of the impulses and losses of a motion: one choice of many, as joints or drives may take a share.

    Attributes
    ----------
    contacts : ndarray of bool, shape (n_t, n_c, 3)
        Components of the impulses.
    sums : ndarray of bool, shape (n_t, n_c, 3)
        Components of the sum of the impulses of all contacts of the same two bodies.
    loss : ndarray of bool, shape (n_t,)
        Energy lost since the start.
    """

    contacts: NDArray[np.bool_]
    sums: NDArray[np.bool_]
    loss: NDArray[np.bool_]


@lru_cache(maxsize=1)  # contacts, losses and words of one motion ask in turn
def open_forces(mechanism: Mechanism, answer: TrajectoryAnswer) -> OpenForces:
    """Tell which impulses of contacts, sums of them, and losses equilibrium leaves open (`determinate_impulses`)."""
    known = determinate_impulses(mechanism, answer)
    pair = np.argmax(np.abs(contact_pairs(mechanism.contacts)), axis=0) if mechanism.contacts else []
    return OpenForces(~known.contacts, ~known.pairs[:, pair], ~known.loss)


def open_in_words(mechanism: Mechanism, answer: TrajectoryAnswer) -> list[str]:
    """Say in a sentence which quantities of contacts equilibrium leaves open along a motion; none where none is."""
    found, told = open_forces(mechanism, answer), list[str]()
    if answer.contact_impulse is not None:
        for what, values in (("contact_impulse", found.contacts), ("its sum over two bodies", found.sums)):
            names = [
                c.name for c, some in zip(mechanism.contacts, np.asarray(values.any(axis=(0, 2))), strict=True) if some
            ]
            told += [f"{what} of {', '.join(names)}"] if names else []
    told += ["contact_loss"] if answer.contact_loss is not None and found.loss.any() else []
    why = "joints, drives or other contacts share the load, and each value is one choice of many"
    return [f"open at some samples: {'; '.join(told)} ({why})"] if told else []


def contact_values(mechanism: Mechanism, answer: TrajectoryAnswer) -> dict[str, Array]:
    """Return the quantities of `QUANTITIES` that a motion gives, each (n_t, n_c, ...); modes are words."""
    given = {name: getattr(answer, name, None) for name in QUANTITIES}
    if given["contact_impulse"] is not None:
        undetermined = open_forces(mechanism, answer)
        given |= {"contact_impulse_open": undetermined.contacts, "contact_sum_open": undetermined.sums}
    found = {name: np.asarray(value) for name, value in given.items() if value is not None and np.shape(value)[1]}
    if "contact_mode" in found:
        found["contact_mode"] = np.array(CONTACT_MODES)[found["contact_mode"]]
    return found


def loss_over_time(mechanism: Mechanism, answer: TrajectoryAnswer) -> dict[str, Array]:
    """Return the quantities of `LOSSES`, each (n_t,); nothing where the motion does not give the energy lost."""
    if answer.contact_loss is None:
        return {}
    return dict(zip(LOSSES, (np.asarray(answer.contact_loss), open_forces(mechanism, answer).loss), strict=True))


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
