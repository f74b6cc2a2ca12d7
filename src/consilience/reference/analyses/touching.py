"""Contacts, stops and dry friction, whose forces the equations of analyses do not have: refused where they act."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from consilience.errors import InvalidInput
from consilience.mechanism import (
    TOUCHING,
    Mechanism,
    State,
    Stop,
    characteristic_length,
    contact_gap,
    joint_spring_motion,
)


def refuse_touching(mechanism: Mechanism, state: State, values: Mapping[str, Mapping[str, Any]] | None = None) -> None:
    """Refuse a state at which a contact is closed, a stop reached or passed, or dry friction has a bound.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    values : mapping of joint to mapping of coordinate to value, optional
        Joint coordinates with their full turns; default: angles are within half a turn of zero.

    Raises
    ------
    InvalidInput
    """
    for name, what in _acting(mechanism, state, values):
        remedy = "Give a state that nothing touches, or simulate_with_contacts, which has these forces."
        raise InvalidInput(name, f"{what}, and the equations of this analysis have no force of it", remedy)


def _acting(
    mechanism: Mechanism, state: State, values: Mapping[str, Mapping[str, Any]] | None
) -> Iterator[tuple[str, str]]:
    """Yield what can act at a state, each with the reason."""
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
