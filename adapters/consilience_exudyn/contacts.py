"""Contacts, stops and dry friction as Exudyn's objects, which exert forces by penalty.

Every elementary contact is an object of its own: two spheres, or a sphere on a triangle about the point that it touches
first. Gaps are rounded as the triangle's corners are: it is no larger than a motion needs. Only declared pairs collide.
A sphere is larger by the overlap under the force at the start, so that it presses at a gap of zero. Exudyn takes the
slip at the bottom of the overlap, which is the point that touches, and the lever of the force to its middle: levers are
too long by half of the overlap. A point is a sphere that reaches to it, its centre inside the body: Exudyn lets a
sphere through that is deeper than its radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.mechanism import (
    GROUND,
    Array,
    ElementaryContact,
    Mechanism,
    PointPlane,
    SphereSphere,
    State,
    contact_parts,
    nearest_points,
    rotation_with_z_axis,
)
from consilience_exudyn.constraints import Mark
from consilience_exudyn.library import exu, items

CONTACT_FEATURES = (
    "sphere on plane contact, point on plane contact, sphere on sphere contact, box on plane contact, "
    "capsule on plane contact, moving plane contact, contact friction, contact restitution, stop, stop restitution, "
    "dry friction"
)
"""Features of contacts, stops and dry friction that the adapter translates."""

REASONS = {
    "disc on plane contact": "Exudyn has contacts of spheres and triangles, not of rims",
    "rebound threshold": "Exudyn's restitution has no speed below which nothing rebounds",
    "static friction": "friction of Exudyn's contacts has one coefficient, and is zero at rest",
    "pyramid cone": "friction of Exudyn's contacts is on a circle",
    "box cone": "friction of Exudyn's contacts is on a circle",
    "associated cone": "friction of Exudyn's contacts does not lift",
    "Moreau impact": "Exudyn's impacts take time, and friction follows the slip within them",
    "Poisson impact": "Exudyn's impact models have a coefficient of velocities",
    "torsional friction": "Exudyn's contacts exert no moments",
    "rolling friction": "Exudyn's contacts exert no moments",
    "compliant contact": "the adapter gives all contacts the stiffness that leads to rigid ones",
    "dry friction of a reaction": "the bound of Exudyn's friction is a constant",
}
"""Features of contacts, stops and dry friction that Exudyn cannot represent, and why."""


@dataclass(frozen=True)
class Penalty:
    """Numbers of a contact object.

    Attributes
    ----------
    stiffness : float, N/m
    damping : float, N s/m
    zone : float, m/s
        Slip below which friction is proportional to it.
    overlap : float, m
        Overlap at a gap of zero.
    radius : float, m
        Radius of a point.
    room : float, m
        Radius of the circle in the triangle that is a plane.
    restitution : float
        Above zero by the model of Gonthier and others, whatever the mass; zero: stiffness and damping alone.
    """

    stiffness: float
    damping: float
    zone: float
    overlap: float = 0.0
    radius: float = 0.0
    room: float = 1.0
    restitution: float = 0.0


AT_INSTANT = Penalty(stiffness=0.0, damping=0.0, zone=1e-12, overlap=1e-3, radius=1e-2)
"""Contact at an instant: without a force until its stiffness is set."""

OVERLAPS = {False: (2e-3, 2), True: (1e-3, 5)}
"""Largest overlap at an instant in m, and the number of overlaps, each half of the one before, by whether two spheres
touch: on a plane the error of a force is in proportion to the overlap; two spheres have the slip in its middle, too."""


def is_unilateral(mechanism: Mechanism) -> bool:
    """Whether a mechanism has contacts, stops or dry friction."""
    return bool(mechanism.contacts or mechanism.stops or mechanism.dry_frictions)


def parts_of(mechanism: Mechanism) -> list[tuple[int, ElementaryContact]]:
    """Return all elementary contacts, with the numbers of the contacts to which they belong."""
    return [(n, part) for n, contact in enumerate(mechanism.contacts) for part in contact_parts(contact)]


def add_contact(
    system: Any, mechanism: Mechanism, state: State, part: ElementaryContact, penalty: Penalty, mark: Mark
) -> Any:
    """Add an elementary contact, and return the number of its object.

    Parameters
    ----------
    system : exudyn.MainSystem
        Not yet assembled.
    mechanism : Mechanism
    state : State
        At the start: the centre of a point's sphere is along the normal there.
    part : ElementaryContact
    penalty : Penalty
    mark : callable
        Adds a rigid marker (`constraints.Mark`).
    """
    nearest = nearest_points(mechanism, state, part)
    center, radius = part.center, part.radius + penalty.overlap
    if isinstance(part, PointPlane):
        _, R = _frame(mechanism, state, part.body)
        center = center + penalty.radius * (R.T @ nearest.normal)
        radius += penalty.radius
    law = {
        "nodeNumber": system.AddNode(
            items.NodeGenericData(numberOfDataCoordinates=4, initialCoordinates=[1.0, 0.0, 0.0, 0.0])
        ),
        "dynamicFriction": part.friction,
        "frictionProportionalZone": penalty.zone,
        "contactStiffness": penalty.stiffness,
        "contactDamping": penalty.damping,
        **_impact(penalty.restitution),
    }
    one = np.eye(3)
    first = mark(part.body, center, one)
    if isinstance(part, SphereSphere):
        both = [first, mark(part.partner, part.partner_center, one)]
        radii = [radius, part.partner_radius]
        return system.AddObject(items.ObjectContactSphereSphere(markerNumbers=both, spheresRadii=radii, **law))
    p, R = _frame(mechanism, state, part.partner)
    both = [first, mark(part.partner, R.T @ (nearest.on_partner - p), rotation_with_z_axis(part.normal))]
    room, across = penalty.room, np.sqrt(3.0) * penalty.room
    corners = exu.Vector3DList([[-room, -across, 0.0], [2.0 * room, 0.0, 0.0], [-room, across, 0.0]])
    return system.AddObject(
        items.ObjectContactSphereTriangle(
            markerNumbers=both, sphereRadius=radius, trianglePoints=corners, includeEdges=0, **law
        )
    )


def _frame(mechanism: Mechanism, state: State, body: str) -> tuple[Array, Array]:
    """Position and rotation of a body or of the ground."""
    if body == GROUND:
        return np.zeros(3), np.eye(3)
    i = mechanism.body_index[body]
    return state.p_WB[i], state.R_WB[i]


def set_overlap(system: Any, contact: Any, part: ElementaryContact, penalty: Penalty, overlap: float) -> None:
    """Change the overlap at a gap of zero of an object.

    Parameters
    ----------
    system : exudyn.MainSystem
    contact : exudyn.ObjectIndex
    part : ElementaryContact
    penalty : Penalty
    overlap : float, m
    """
    radius = part.radius + overlap + (penalty.radius if isinstance(part, PointPlane) else 0.0)
    if isinstance(part, SphereSphere):
        system.SetObjectParameter(contact, "spheresRadii", [radius, part.partner_radius])
    else:
        system.SetObjectParameter(contact, "sphereRadius", radius)


def _impact(restitution: float) -> dict[str, Any]:
    return {"restitutionCoefficient": restitution, "impactModel": 2} if restitution > 0.0 else {"impactModel": 0}


@dataclass(frozen=True)
class Limit:
    """A limit of a joint coordinate: ``side (q - value) >= 0``."""

    joint: str
    coordinate: str
    value: float
    side: float
    restitution: float


def limits_of(mechanism: Mechanism) -> Iterator[Limit]:
    """Return the limits of all stops."""
    for stop in mechanism.stops:
        for value, side in ((stop.lower, 1.0), (stop.upper, -1.0)):
            if value is not None:
                yield Limit(stop.joint, stop.coordinate, value, side, stop.restitution)


def add_limit(system: Any, penalty: Penalty, ends: tuple[Any, Any], sign: float, limit: Limit) -> None:
    """Add a limit of a coordinate as contact of two coordinates.

    Parameters
    ----------
    system : exudyn.MainSystem
        Not yet assembled.
    penalty : Penalty
    ends : tuple of exudyn.MarkerIndex
        Coordinate at rest, and the coordinate of the joint.
    sign : float
        -1 where the coordinate is that of the joint backwards.
    limit : Limit
    """
    side = limit.side * sign
    gap = [1.0, 0.0] if limit.restitution > 0.0 else [1.0]
    system.AddObject(
        items.ObjectContactCoordinate(
            markerNumbers=list(ends if side > 0.0 else ends[::-1]),
            nodeNumber=system.AddNode(items.NodeGenericData(numberOfDataCoordinates=len(gap), initialCoordinates=gap)),
            contactStiffness=penalty.stiffness,
            contactDamping=penalty.damping,
            offset=limit.side * limit.value,
            **_impact(limit.restitution),
        )
    )


def add_dry_friction(system: Any, bound: float, zone: float, ends: tuple[Any, Any]) -> None:
    """Add dry friction of a coordinate, proportional to its rate below `zone`."""
    system.AddObject(
        items.ObjectConnectorCoordinateSpringDamperExt(
            markerNumbers=list(ends), dynamicFrictionForce=bound, frictionProportionalZone=zone
        )
    )
