"""Contact: geometry, modes, forces and impulses at one instant, motion with contacts, friction and stops.

`simulate_with_contacts` integrates a mechanism with its contacts, stops and dry frictions; `solve_impact` solves one
impact. `consilience.reference.contact.impact` states the impact law and its extensions of the source.
"""

from consilience.mechanism import Contact
from consilience.reference.contact.geometry import ContactMotion, contact_motion
from consilience.reference.contact.impact import Impact, solve_impact
from consilience.reference.contact.instant import contact_instant
from consilience.reference.contact.motions import simulate_with_contacts, simulate_with_impacts
from consilience.reference.contact.regularised import simulate_regularised
from consilience.reference.contact.samples import ContactEvent

__all__ = [
    "Contact",
    "ContactEvent",
    "ContactMotion",
    "Impact",
    "contact_instant",
    "contact_motion",
    "simulate_regularised",
    "simulate_with_contacts",
    "simulate_with_impacts",
    "solve_impact",
]
