"""Methods for motions with contacts, stops and dry friction."""

from __future__ import annotations

from typing import Any

from consilience.engine import Method, Route
from consilience.mechanism import Mechanism
from consilience_exudyn.contact_motion import BOUNCE, OVERDAMPED, RELAXATION
from consilience_exudyn.library import CONTACT_SETTINGS

STEPS, BOUNCING_STEPS, EXTRAPOLATED_STEPS = (50, 100, 200), (500, 1000, 2000), (5, 10, 20)
HALVINGS = 4
"""Number of motions of an extrapolated one, each with half the step of the one before; its order."""

_CIRCLE = "circle; rigid and Coulomb's in the limit of small steps"


def contact_methods(mechanism: Mechanism) -> tuple[Method, ...]:
    """Return the methods for a motion with contacts, stops or dry friction, the headline method first."""
    bounces = any(element.restitution > 0.0 for element in (*mechanism.contacts, *mechanism.stops))
    settings: dict[str, Any] = {**CONTACT_SETTINGS, "solution.sensors.writePeriod": "the step"}
    settings |= _numbers(mechanism)
    law = _CIRCLE if mechanism.contacts else ""
    steps = BOUNCING_STEPS if bounces or mechanism.stops else STEPS
    motion = Method("ExplicitRungeKutta44", Route.TUNED, 1, steps, settings=settings, softness=1.0, contact_law=law)
    if bounces or not mechanism.contacts:
        return (motion,)
    finer = Method(
        "ExplicitRungeKutta44, extrapolated in step and stiffness",
        Route.EXTRAPOLATED,
        HALVINGS,
        EXTRAPOLATED_STEPS,
        settings=settings,
        contact_law=law,
    )
    return (motion, finer)


def _numbers(mechanism: Mechanism) -> dict[str, Any]:
    """Describe the numbers of the objects."""
    hit = f"{BOUNCE:g} 1/s^2 over the inverse inertia for what hits"
    found = {}
    if mechanism.contacts or mechanism.stops:
        found["contactStiffness"] = f"{hit}; else the damping over {RELAXATION:g} sample intervals"
        found["contactDamping"] = f"0.6/h over the inverse inertia; {OVERDAMPED:g} roots of the stiffness for what hits"
        found["impactModel"] = "2 with restitution"
    if mechanism.contacts or mechanism.dry_frictions:
        found["frictionProportionalZone"] = "h times the largest friction over the inertia"
    return found
