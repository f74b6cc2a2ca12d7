"""Methods for motions with contacts, stops and dry friction."""

from __future__ import annotations

from typing import Any

from consilience.engine import Method, Route
from consilience.mechanism import Mechanism
from consilience_exudyn.contact_numbers import BOUNCE, CREEPING, DAMPING, LINEAR, OVERDAMPED, RATE, RESOLVED, RIGID
from consilience_exudyn.kinematic_tree import HELD, is_one_axis_tree
from consilience_exudyn.library import CONTACT_SETTINGS

STEPS, BOUNCING_STEPS, EXTRAPOLATED_STEPS = (50, 100, 200), (500, 1000, 2000), (20, 40, 80)
HALVINGS = 4
"""Number of motions of an extrapolated one, each with half the step of the one before; its order."""

_CIRCLE = "circle; rigid and Coulomb's in the limit of small steps"


def immovable(mechanism: Mechanism) -> str:
    """Return what Exudyn's explicit integrators do not take, as words; empty if they take all.

    They take bodies that are all free, or a tree of one-axis joints, without constraints.
    """
    if held := sorted(HELD & mechanism.features.keys()):
        return " and ".join(held)
    free = all(joint.kind == "free" for joint in mechanism.joints)
    return "" if free or is_one_axis_tree(mechanism) else "joints that are neither all free nor a tree of axes"


def contact_methods(mechanism: Mechanism) -> tuple[Method, ...]:
    """Return the methods for a motion with contacts, stops or dry friction, the headline method first."""
    bounces = any(element.restitution > 0.0 for element in (*mechanism.contacts, *mechanism.stops))
    law = _CIRCLE if mechanism.contacts else ""
    steps = BOUNCING_STEPS if bounces or mechanism.stops else STEPS
    linear, creeping = f"{LINEAR:g}/(h s A), s the sample interval", f"{CREEPING:g}, or {RATE:g}/(h A) if less"
    settings = _settings(mechanism, f"{BOUNCE:g}/A 1/s^2", linear, creeping)
    motion = Method("ExplicitRungeKutta44", Route.TUNED, 1, steps, settings=settings, softness=1.0, contact_law=law)
    if bounces or not mechanism.contacts:
        return (motion,)
    finer = Method(
        "ExplicitRungeKutta44, extrapolated in step and stiffness",
        Route.EXTRAPOLATED,
        HALVINGS,
        EXTRAPOLATED_STEPS,
        settings=_settings(mechanism, f"{RESOLVED**2:g}/(h^2 A)", f"{RIGID:g}/(h^2 A)", f"{DAMPING:g}"),
        contact_law=law,
    )
    return (motion, finer)


def _settings(mechanism: Mechanism, hits: str, closed: str, damped: str) -> dict[str, Any]:
    """Describe the settings, with the stiffness of contacts that hit, and numbers of those that stay closed."""
    found: dict[str, Any] = {**CONTACT_SETTINGS, "solution.sensors.writePeriod": "the step"}
    if mechanism.contacts or mechanism.stops:
        found["contactStiffness"] = f"{hits} for what hits; else {closed}, A the inverse inertia"
        if any(not stop.restitution for stop in mechanism.stops):
            found["contactStiffness"] += f"; {RESOLVED**2:g}/(h^2 A) of stops without restitution"
        found["contactDamping"] = f"{OVERDAMPED:g} roots of stiffness over A for what hits; else {damped}"
        found["impactModel"] = "2 with restitution"
    if mechanism.contacts or mechanism.dry_frictions:
        found["frictionProportionalZone"] = (
            "h times the largest sum of frictions over the inertia, of all that two bodies keep closed"
        )
    return found
