"""Contacts, stops and dry friction, whose forces the equations of analyses do not have: refused where they act."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from consilience.errors import InvalidInput
from consilience.mechanism import Mechanism, State, acting, overlaps
from consilience.reference.analyses.placing import CoordinateValues
from consilience.reference.bodies.smooth_equations import first_contact


def refuse_touching(mechanism: Mechanism, state: State, values: Mapping[str, Mapping[str, Any]] | None = None) -> None:
    """Refuse a state at which a contact is closed, a stop reached or passed, or dry friction has a bound.

    Parameters
    ----------
    mechanism, state, values
        As in `acting`.

    Raises
    ------
    InvalidInput
    """
    for name, what in acting(mechanism, state, values):
        remedy = "Give a state that nothing touches, or simulate_with_contacts, which has these forces."
        raise InvalidInput(name, f"{what}, and the equations of this analysis have no force of it", remedy)


def refuse_laws(mechanism: Mechanism, equations: str, remedy: str) -> None:
    """Refuse a mechanism with contacts, stops or dry friction, of which some equations have none.

    Raises
    ------
    InvalidInput
    """
    for refusal in first_contact(mechanism):
        what = f"{equations} has no contact, stop or friction that sticks"
        raise InvalidInput(refusal.feature, what, remedy)


def refuse_passing(
    mechanism: Mechanism, state: State, where: str, remedy: str, values: CoordinateValues | None = None
) -> None:
    """Refuse a pose that was found where rigid shapes overlap, or a joint is beyond a stop.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    where, remedy : str
        Which pose it is, and what to do if the contact or stop stays in the mechanism, for the message.
    values : mapping of joint coordinate to value, optional
        Joint coordinates with their full turns; default: angles are within half a turn of zero.

    Raises
    ------
    InvalidInput
    """
    named: dict[str, dict[str, Any]] = {}
    for (joint, coordinate), value in (values or {}).items():
        named.setdefault(joint.name, {})[coordinate] = value
    for name, what in overlaps(mechanism, state, named or None):
        raise InvalidInput(name, f"{what} {where}", f"{remedy}, or leave it out of the mechanism.")
