"""Random mechanisms with contacts, stops and dry friction: the same seed gives the same mechanism and start.

The bodies and joints are those of `random_mechanism`, trees and loops. Each contact has a plane or a sphere of its own,
placed so that shapes touch in the drawing or are a little apart; normals lean against gravity, so that contacts last.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from consilience.audit.random_mechanisms import Recipe, random_mechanism
from consilience.mechanism import (
    AXIS_COORDINATES,
    GROUND,
    Array,
    BoxPlane,
    CapsulePlane,
    Compliance,
    Cone,
    Contact,
    DiscPlane,
    DryFriction,
    Frame,
    Mechanism,
    PointPlane,
    SpherePlane,
    SphereSphere,
    State,
    Stop,
    assemble_velocities,
    contact_gap,
    drawing_state,
    joint_spring_motion,
)

MOST_CONTACTS = 8

_RECIPE = Recipe(plain=True, linkages=0.15)


def random_contacts(seed: int) -> tuple[Mechanism, State]:
    """Return the random mechanism of a seed, of 1 to 4 bodies with 1 to 8 elementary contacts, and its start."""
    rng = np.random.default_rng([seed, 35])
    bare = random_mechanism(seed, int(rng.integers(1, 5)), _RECIPE)
    at_rest, contacts, left = drawing_state(bare), list[Contact](), int(rng.integers(1, MOST_CONTACTS + 1))
    while left > 0:
        contact, parts = _contact(bare, at_rest, f"contact_{len(contacts)}", left, rng)
        contacts.append(contact)
        left -= parts
    stops, dry = _in_joints(bare, at_rest, rng)
    mechanism = replace(bare, name=f"contacts_{seed}", contacts=tuple(contacts), stops=stops, dry_frictions=dry)
    speed = 0.0 if rng.random() < 0.3 else 1.0
    moving = replace(at_rest, **{v: speed * rng.normal(size=at_rest.p_WB.shape) for v in ("v_WB_W", "w_WB_W")})
    return mechanism, assemble_velocities(mechanism, moving)


def _law(rng: np.random.Generator, parts: int) -> dict[str, Any]:
    """Return a law at random; a compliance, and friction moments, for single contacts alone."""
    law: dict[str, Any] = {"restitution": float(rng.choice([0.0, 0.0, 0.5]))}
    if rng.random() < 0.8:
        law["friction"] = float(rng.uniform(0.05, 0.6))
        kind = str(rng.choice(["circle", "circle", "circle", "pyramid", "box"]))
        law["cone"] = Cone(kind, int(rng.integers(3, 9)) if kind == "pyramid" else 4)  # type: ignore[arg-type]
    if parts == 1 and rng.random() < 0.15:
        law["torsional"], law["rolling"] = (float(x) for x in rng.uniform(0.0, 0.02, size=2))
    if parts == 1 and rng.random() < 0.1:
        law |= {"restitution": 0.0, "compliance": Compliance(float(rng.uniform(500, 3000)), float(rng.uniform(0, 20)))}
    return law


def _contact(mechanism: Mechanism, state: State, name: str, most: int, rng: np.random.Generator) -> tuple[Contact, int]:
    """Return a contact of at most some parts that touches in the drawing or is a little apart, and its parts."""
    names = [b.name for b in mechanism.bodies]
    body = str(rng.choice(names))
    partner = str(rng.choice([n for n in [GROUND, GROUND, *names] if n != body]))
    pose = dict(zip(names, (Frame(p, R) for p, R in zip(state.p_WB, state.R_WB, strict=True)), strict=True))
    pose[GROUND] = Frame(np.zeros(3), np.eye(3))
    own, other = pose[body], pose[partner]
    kinds = ["sphere", "point", "disc", "spheres", *(["capsule"] if most >= 2 else []), *(["box"] if most >= 8 else [])]
    kind = str(rng.choice(kinds))
    law = _law(rng, {"capsule": 2, "box": 8}.get(kind, 1))
    apart = 0.0 if rng.random() < 0.6 else float(rng.uniform(0.005, 0.05))
    up = _against(mechanism.gravity, rng)
    center = rng.normal(scale=0.25, size=3)
    radius = float(rng.uniform(0.05, 0.2))
    if kind == "spheres":
        place = own.p + own.R @ center - (apart + radius + 0.15) * up
        return SphereSphere(name, body, center, radius, partner, other.R.T @ (place - other.p), 0.15, **law), 1
    plane = (partner, other.R.T @ (own.p + own.R @ center - other.p), other.R.T @ up)
    shape: Contact
    if kind == "point":
        shape = PointPlane(name, body, center, *plane, **law)
    elif kind == "disc":
        shape = DiscPlane(name, body, center, own.R.T @ _across(up, rng), radius, *plane, **law)
    elif kind == "capsule":
        shape = CapsulePlane(name, body, center, center + own.R.T @ _flat(up, rng), radius, *plane, **law)
    elif kind == "box":
        shape = BoxPlane(
            name, body, center, rng.uniform(0.05, 0.3, size=3), *plane, orientation=own.R.T @ _frame(up, rng), **law
        )
    else:
        shape = SpherePlane(name, body, center, radius, *plane, **law)
    raised = contact_gap(mechanism, state, shape) - apart
    return replace(shape, point=shape.point + raised * shape.normal), {"capsule": 2, "box": 8}.get(kind, 1)


def _against(gravity: Array, rng: np.random.Generator) -> Array:
    """Return a direction that leans against gravity."""
    up = -gravity / np.linalg.norm(gravity) + rng.normal(scale=0.3, size=3)
    return np.asarray(up / np.linalg.norm(up))


def _across(up: Array, rng: np.random.Generator) -> Array:
    """Return the axis of a disc that leans, far from lying flat."""
    return np.asarray(_frame(up, rng)[:, 0] + rng.uniform(-0.5, 0.5) * up)


def _flat(up: Array, rng: np.random.Generator) -> Array:
    """Return the length of a capsule that lies on its plane, in one case of two; else it leans."""
    return np.asarray(0.4 * _frame(up, rng)[:, 0] + (0.0 if rng.random() < 0.5 else 0.1) * up)


def _frame(up: Array, rng: np.random.Generator) -> Array:
    """Return a rotation matrix with the third column up."""
    x = np.cross(rng.normal(size=3), up)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(up, x), up])


def _in_joints(
    mechanism: Mechanism, state: State, rng: np.random.Generator
) -> tuple[tuple[Stop, ...], tuple[DryFriction, ...]]:
    """Return stops and dry frictions with constant bounds of some joint coordinates."""
    stops, dry = list[Stop](), list[DryFriction]()
    for joint, coordinate in _coordinates(mechanism):
        q = joint_spring_motion(mechanism, state, joint, coordinate)[0]
        if rng.random() < 0.25:
            restitution = float(rng.choice([0.0, 0.5]))
            stops.append(Stop(f"stop_{joint}", joint, coordinate, q - rng.uniform(0.0, 0.2), q + 0.3, restitution))
        if rng.random() < 0.25:
            dry.append(DryFriction(f"dry_{joint}", joint, coordinate, float(rng.uniform(0.2, 3.0))))
    return tuple(stops), tuple(dry)


def _coordinates(mechanism: Mechanism) -> Iterator[tuple[str, str]]:
    for joint in mechanism.joints:
        for coordinate in AXIS_COORDINATES.get(joint.kind, ())[:1]:
            yield joint.name, coordinate
