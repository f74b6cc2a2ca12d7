"""Which impulses of contacts, and which losses, equilibrium determines along a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from consilience.engine.answers import CONTACT_MODES, TrajectoryAnswer
from consilience.mechanism import Mechanism, determinate_forces, determinate_power

SEPARATED = CONTACT_MODES.index("separated")


class DeterminateImpulses(NamedTuple):
    """Components that equilibrium determines, at both ends of each interval and at the events within it.

    Attributes
    ----------
    contacts : ndarray of bool, shape (n_t, n_c, 3)
        Of the impulse of each contact since the sample before, world axes.
    pairs : ndarray of bool, shape (n_t, n_p, 3)
        Of the sums of impulses between bodies, in the order of `mechanism.contact_pairs`.
    loss : ndarray of bool, shape (n_t,)
        Whether the energy lost since the start is determined: not where drives may give more for contacts to take.
    """

    contacts: NDArray[np.bool_]
    pairs: NDArray[np.bool_]
    loss: NDArray[np.bool_]


def determinate_impulses(mechanism: Mechanism, answer: TrajectoryAnswer) -> DeterminateImpulses:
    """Tell which impulses of contacts, and which losses, equilibrium determines.

    What closes and opens again between two samples is known by events alone. What touched at the instant of an event
    counts as closed there with all that is closed at one of the two samples.
    """
    closed, hits = _closed(mechanism, answer), _hits(mechanism, answer)
    found = []
    for k in range(len(answer.time)):
        sets = {closed[k]} | {hit | closed[k] | closed[max(k - 1, 0)] for hit in hits[k]}
        state, t = answer.state(k), float(answer.time[k])
        told = [determinate_forces(mechanism, state, touched) for touched in sets]
        sure = all(determinate_power(mechanism, state, t, touched) for touched in sets)
        found.append([np.all([one.contacts for one in told], 0), np.all([one.pairs for one in told], 0), sure])
    contacts, pairs, power = (np.array(values, dtype=bool) for values in zip(*found, strict=True))
    for known in (contacts, pairs):
        known[1:] &= known[:-1].copy()
    loss: NDArray[np.bool_] = np.logical_and.accumulate(power)
    for known in (contacts, pairs, loss):
        known[0] = True  # nothing has passed: zero
    return DeterminateImpulses(contacts, pairs, loss)


def _closed(mechanism: Mechanism, answer: TrajectoryAnswer) -> list[frozenset[str]]:
    """Return the contacts that are not separated at each sample, as far as the motion tells."""
    if answer.contact_mode is None:
        return [frozenset()] * len(answer.time)
    names = [contact.name for contact in mechanism.contacts]
    return [
        frozenset(name for name, mode in zip(names, modes, strict=True) if mode != SEPARATED)
        for modes in answer.contact_mode
    ]


def _hits(mechanism: Mechanism, answer: TrajectoryAnswer) -> list[set[frozenset[str]]]:
    """Return the contacts and stops with an event at each instant since the sample before."""
    found: list[set[frozenset[str]]] = [set() for _ in answer.time]
    if answer.event_time is None or answer.event_contact is None:
        return found
    names = [one.name for one in (*mechanism.contacts, *mechanism.stops, *mechanism.dry_frictions)]
    times, places = np.asarray(answer.event_time), np.asarray(answer.event_contact)
    for t in np.unique(times):
        k = min(int(np.searchsorted(answer.time, t)), len(found) - 1)
        found[k].add(frozenset(names[c] for c in places[times == t]))
    return found
