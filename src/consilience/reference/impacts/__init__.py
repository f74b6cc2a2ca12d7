"""Impacts between rigid bodies: contact geometry, the simultaneous-impact equation, motion with impacts [MASS].

`simulate_with_impacts` integrates a mechanism with contacts under restitution and friction; `solve_impact` solves one
instant. `consilience.reference.impacts.impact` states the impact law and its extensions of the source.
"""

from consilience.mechanism import Contact, PointPlane, SpherePlane, SphereSphere
from consilience.reference.impacts.geometry import ContactMotion, contact_motion
from consilience.reference.impacts.impact import Impact, solve_impact
from consilience.reference.impacts.simulation import simulate_with_impacts

__all__ = [
    "Contact",
    "ContactMotion",
    "Impact",
    "PointPlane",
    "SpherePlane",
    "SphereSphere",
    "contact_motion",
    "simulate_with_impacts",
    "solve_impact",
]
