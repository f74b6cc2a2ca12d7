"""Contacts, stops and dry friction, which smooth equations of motion do not have: refused by name."""

from __future__ import annotations

from consilience.engine.answers import Unsupported
from consilience.errors import InvalidInput
from consilience.mechanism import Mechanism

_SMOOTH = "a formulation has smooth equations of motion, without contact, stops and friction that sticks"


def first_contact(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Return the first contact, stop or dry friction of a mechanism, with the reason; empty if there is none."""
    names = [f"contact '{c.name}'" for c in mechanism.contacts] + [f"stop '{s.name}'" for s in mechanism.stops]
    names += [f"dry friction '{d.name}'" for d in mechanism.dry_frictions]
    return tuple(Unsupported(name, _SMOOTH) for name in names[:1])


def refuse_contacts(mechanism: Mechanism) -> None:
    """Refuse a mechanism with contacts, stops or dry friction: a formulation has smooth equations of motion.

    Raises
    ------
    InvalidInput
    """
    for refusal in first_contact(mechanism):
        what = "Use simulate_with_contacts or contact_instant of consilience.reference.contact."
        raise InvalidInput(refusal.feature, refusal.reason, what)
