"""Contacts, stops and dry friction that act at a state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from consilience.mechanism.contact_geometry import TOUCHING, contact_gap
from consilience.mechanism.model import Mechanism, State
from consilience.mechanism.observables import joint_spring_motion
from consilience.mechanism.stops import Stop
from consilience.mechanism.units import characteristic_length


def acting(
    mechanism: Mechanism, state: State, values: Mapping[str, Mapping[str, Any]] | None = None
) -> Iterator[tuple[str, str]]:
    """Yield the name of each closed contact, reached or passed stop and dry friction with a bound, and the reason.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    values : mapping of joint to mapping of coordinate to value, optional
        Joint coordinates with their full turns; default: angles are within half a turn of zero.
    """
    slack = TOUCHING * characteristic_length(mechanism)
    for contact in mechanism.contacts:
        gap = contact_gap(mechanism, state, contact)
        if gap <= slack:
            yield f"contact '{contact.name}'", f"it touches: its gap is {gap:.3g} m"
    for stop in mechanism.stops:
        if values is None:
            q, _ = joint_spring_motion(mechanism, state, stop.joint, stop.coordinate)
        else:
            q = float(values[stop.joint][stop.coordinate])
        if _room(stop, q) <= (slack if stop.coordinate == "distance" else TOUCHING):
            yield f"stop '{stop.name}'", f"it is reached: {stop.coordinate} of '{stop.joint}' is {q:.6g}"
    for dry in mechanism.dry_frictions:
        if dry.bound or dry.coefficient:
            yield f"dry friction '{dry.name}'", "it can hold"


def _room(stop: Stop, q: float) -> float:
    """Return how far a coordinate is within the limits of a stop, negative beyond them."""
    return min(beyond * (limit - q) for limit, beyond in ((stop.lower, -1.0), (stop.upper, 1.0)) if limit is not None)
