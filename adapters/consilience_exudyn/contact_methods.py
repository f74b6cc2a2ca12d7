"""Methods for motions with contacts, stops and dry friction."""

from __future__ import annotations

from typing import Any

from consilience.engine import Method, Route
from consilience.mechanism import TOUCHING, ContactLaw, Mechanism, characteristic_length, contact_gap, drawing_state
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


def _may_hit_rough(mechanism: Mechanism) -> bool:
    """Whether a contact with friction is open in the drawing.

    Of what hits the zone of friction is in proportion to the step times the root of the stiffness. It vanishes at a
    given stiffness in steps far shorter than the impact, not where the stiffness follows the step.
    """
    state, slack = drawing_state(mechanism), TOUCHING * characteristic_length(mechanism)
    return any(c.friction > 0.0 and contact_gap(mechanism, state, c) > slack for c in mechanism.contacts)


def impact_law(mechanism: Mechanism) -> ContactLaw | None:
    """Return the law of impacts without rebound: friction opposes the slip of each instant, along Routh's path."""
    return ContactLaw(impact_law="poisson") if any(c.friction > 0.0 for c in mechanism.contacts) else None


def contact_methods(mechanism: Mechanism) -> tuple[Method, ...]:
    """Return the methods for a motion with contacts, stops or dry friction, the headline method first."""
    bounces = any(element.restitution > 0.0 for element in (*mechanism.contacts, *mechanism.stops))
    law = _CIRCLE if mechanism.contacts else ""
    rough = _may_hit_rough(mechanism)
    steps = BOUNCING_STEPS if bounces or mechanism.stops or rough else STEPS
    linear, creeping = f"{LINEAR:g}/(h s A), s the sample interval", f"{CREEPING:g}, or {RATE:g}/(h A) if less"
    settings = _settings(mechanism, f"{BOUNCE:g}/A 1/s^2", linear, creeping)
    path = None if bounces else impact_law(mechanism)
    law += "; impacts along Routh's path" if path else ""
    motion = Method(
        "ExplicitRungeKutta44", Route.TUNED, 1, steps, settings=settings, softness=1.0, contact_law=law, law=path
    )
    if bounces or rough or not mechanism.contacts:
        return (motion,)
    finer = Method(
        "ExplicitRungeKutta44, extrapolated in step and stiffness",
        Route.EXTRAPOLATED,
        HALVINGS,
        EXTRAPOLATED_STEPS,
        settings=_settings(mechanism, f"{RESOLVED**2:g}/(h^2 A)", f"{RIGID:g}/(h^2 A)", f"{DAMPING:g}"),
        contact_law=law,
        law=path,
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
