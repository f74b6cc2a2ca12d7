"""Methods of mechanisms with contacts, stops or dry friction, and the law of contact that each solves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from consilience.engine import Method, Profile, Question, Route, Unsupported
from consilience.mechanism import GROUND, Array, Cone, ContactLaw, Mechanism
from consilience_dart.contact_instant import FINE, SOLVERS, STEP
from consilience_dart.contacts import FRICTION
from consilience_dart.stepping import ERROR_REDUCTION_TRAJECTORY
from consilience_dart.translation import unstepped

CONTACT_FEATURES = (
    "sphere on plane contact, point on plane contact, sphere on sphere contact, box on plane contact, "
    "capsule on plane contact, moving plane contact, contact restitution, contact friction, stop, dry friction"
)

THRESHOLD, CAP = 0.1, 100.0
"""Speeds of rebound in m/s, or in units of the settings: DART gives none up to the first, and no more than the second;
there is no setter."""

REASONS = {
    "disc on plane contact": "DART finds no contact of a cylinder's rim with a plane",
    "pyramid cone": "DART has circles and boxes",
    "box cone": "the axes of DART's box follow from the normal and the world",
    "associated cone": "the adapter asks DART's solver of friction for Coulomb's law alone",
    "static friction": "DART has one coefficient",
    "Poisson impact": "DART has Moreau's law",
    "Moreau impact": f"DART rebounds above {THRESHOLD:g} m/s alone, in the units of its settings",
    "torsional friction": "DART has no torsional friction",
    "rolling friction": "DART has no rolling friction",
    "compliant contact": "DART's contacts are rigid",
    "rebound threshold": f"DART has its own, of {THRESHOLD:g} m/s in the units of its settings",
    "stop restitution": "DART's joint limits do not bounce",
    "dry friction of a reaction": "DART's Coulomb friction of joints has a constant bound",
}

CONES = "World.step with NsgsFrictionSolver"
EXTRAPOLATED = f"{CONES}, extrapolated"
BOX = "World.step, defaults"
INSTANT = "World.step, second step, to zero step"

_IMPACT = (
    f"Moreau's impacts with Newton's restitution, none up to a rebound of {THRESHOLD:g} m/s, at most {CAP:g} m/s, "
    "in units of the settings where they have units"
)
_SETTINGS: dict[str, Any] = {
    "DeactivationOptions.enabled": False,
    "BoxedLcpSolver": "; else ".join(
        f"{name}, {bound} {most}, tolerance {least:g}" for name, bound, most, least in FRICTION
    ),
    "splitImpulse": True,
}
_Z, _AXES = np.array([0.0, 0.0, 1.0]), np.eye(3)


def touches(mechanism: Mechanism) -> bool:
    """Whether a mechanism has contacts, stops or dry friction."""
    return bool(mechanism.contacts or mechanism.stops or mechanism.dry_frictions)


def refused(mechanism: Mechanism) -> tuple[Unsupported, ...]:
    """Return the constraints that `World.step` lacks, beside contacts, stops or dry friction."""
    if not touches(mechanism):
        return ()
    reason = "World.step, which alone has contacts, stops and dry friction, has no such constraint"
    return tuple(Unsupported(f"{what} '{name}'", reason) for what, name in unstepped(mechanism).items())


def _box_axis(normal: Array) -> Array:
    """First axis of DART's box: the normal times the world's z; the world's x where the normal is along z."""
    axis = np.cross(normal, _Z)
    return axis / np.linalg.norm(axis) if float(np.linalg.norm(axis)) > 1e-6 else _AXES[0]


def impact_law(mechanism: Mechanism) -> ContactLaw | None:
    """Return DART's law of impacts and threshold of rebounds, as a law of all contacts; None without both."""
    matters = any(contact.restitution > 0.0 or contact.friction > 0.0 for contact in mechanism.contacts)
    return ContactLaw(rebound_threshold=THRESHOLD, impact_law="moreau") if matters else None


def default_law(mechanism: Mechanism) -> ContactLaw | None:
    """Return DART's box and threshold as a law of all contacts; None where no one tangent gives it for all of them."""
    rubbing: list[Any] = [contact for contact in mechanism.contacts if contact.friction > 0.0]
    if not rubbing:
        return impact_law(mechanism)
    if any(c.partner != GROUND or not hasattr(c, "normal") for c in rubbing):
        return None
    cone = Cone("box", tangent=tuple(float(x) for x in _box_axis(rubbing[0].normal)))  # type: ignore[arg-type]
    for contact in rubbing:
        wanted = _box_axis(contact.normal)
        across = wanted - (wanted @ np.array(cone.tangent)) * np.array(cone.tangent)
        if float(np.linalg.norm(across)) > 1e-9:
            return None
    return replace(impact_law(mechanism) or ContactLaw(), cone=cone)


def unilateral_methods(mechanism: Mechanism, question: Question, loops: bool) -> tuple[Method, ...]:
    """Return the methods of a mechanism with contacts, stops or dry friction, the headline method first.

    Parameters
    ----------
    mechanism : Mechanism
    question : Question
        ``instant`` or ``trajectory``.
    loops : bool
        Whether welds hold loops.
    """
    rows = {"errorReductionParameter": 0.0 if question is Question.INSTANT else ERROR_REDUCTION_TRAJECTORY}
    settings = _SETTINGS | (rows if loops else {})
    circle = f"circle; {_IMPACT}" if mechanism.contacts else ""
    if question is Question.INSTANT:
        steps = f"{STEP:g} s or less, halved twice, extrapolated to 0"
        solvers = " or ".join(name for name, _, _ in SOLVERS)
        settings = settings | {"step": steps, "BoxedLcpSolver": solvers}
        settings |= {f"{name}.{bound}": most for name, bound, most in SOLVERS}
        settings |= {f"{name}.tolerance": FINE for name, _, _ in SOLVERS}
        return (Method(INSTANT, Route.EXTRAPOLATED, settings=settings, contact_law=circle),)
    box = f"box along normal x world z, or along x and y of the world where the normal is z; {_IMPACT}"
    law = impact_law(mechanism)
    cones = Method(CONES, Route.TUNED, 1, (10, 20, 40), settings=settings, contact_law=circle, law=law)
    extrapolated = replace(
        cones,
        name=EXTRAPOLATED,
        route=Route.EXTRAPOLATED,
        order=3,
        substeps=(4, 8, 16),
        settings=settings
        | {
            "rotations below 1e-3 rad": "less t^3/6, which DART's exponential map adds",
            "spheres that press": "larger by the gap that a step leaves, until they do not press",
        },
    )
    defaults = Method(
        BOX,
        Route.NATIVE,
        1,
        (50, 100),
        profile=Profile.DEFAULT,
        contact_law=box if mechanism.contacts else "",
        law=default_law(mechanism),
    )
    bounces = any(contact.restitution > 0.0 for contact in mechanism.contacts)
    return (cones, defaults) if bounces else (cones, extrapolated, defaults)  # what bounces has no order
