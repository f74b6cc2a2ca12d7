"""Samples of contacts from those of their parts, and motions extrapolated in the step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from consilience.engine.answers import CONTACT_MODES, TrajectoryAnswer
from consilience.mechanism import Array, Mechanism, contact_parts

_SEPARATED, _SLIDING, _STICKING = range(len(CONTACT_MODES))


def over_parts(mechanism: Mechanism, values: Array, join: Callable[[Array], Array]) -> Array:
    """Return values (n_t, contacts, ...) of the contacts from those of their parts, (n_t, parts, ...).

    Parameters
    ----------
    mechanism : Mechanism
    values : ndarray
        In the order of `elementary_contacts`.
    join : callable
        Maps values (n_t, parts of one contact, ...) to (n_t, ...).
    """
    ends = np.cumsum([0, *(len(contact_parts(contact)) for contact in mechanism.contacts)])
    columns = [join(values[:, start:end]) for start, end in pairwise(ends)]
    return np.stack(columns, axis=1) if columns else values


def joined_mode(modes: Array) -> Array:
    """Return the mode (n_t,) of a contact from those of its parts: of several closed parts one that slides decides."""
    slides, sticks = np.any(modes == _SLIDING, axis=1), np.any(modes == _STICKING, axis=1)
    return np.where(slides, _SLIDING, np.where(sticks, _STICKING, _SEPARATED))


def limit_of_halved(values: Sequence[Array]) -> Array:
    """Return the limit of values for h, h/2, h/4, ..., of as high an order as there are values [Richardson 1911]."""
    column = [np.asarray(value) for value in values]
    for power in range(1, len(column)):
        column = [fine + (fine - rough) / (2.0**power - 1.0) for rough, fine in pairwise(column)]
    return column[0]


def motion_of_halved(runs: Sequence[TrajectoryAnswer]) -> TrajectoryAnswer:
    """Return the limit of motions by the steps h, h/2, h/4, ...; modes are those of the finest step."""
    counters = {name: sum(run.counters[name] for run in runs) for name in runs[0].counters}

    def limit(name: str) -> Array:
        return limit_of_halved([getattr(run, name) for run in runs])

    quat = limit("quat_WB")
    given = [name for name in ("contact_gap", "contact_impulse", "contact_loss") if getattr(runs[0], name) is not None]
    contacts = {name: limit(name) for name in given}
    return TrajectoryAnswer(
        runs[0].time,
        limit("p_WB"),
        quat / np.linalg.norm(quat, axis=-1, keepdims=True),
        limit("v_WB_W"),
        limit("w_WB_W"),
        counters,
        **contacts,
        contact_mode=runs[-1].contact_mode,
    )
