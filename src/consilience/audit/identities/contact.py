"""Identities of contact at instants: no pull, the friction cone, friction against slip, gap times force is zero.

f = N n + T is the force of a contact on its body, n the unit normal from partner to body, u the velocity of the
material point of the body relative to that of the partner [Acary and Brogliato 2008, chapter 3]. Forces are sums over
the parts of a contact; those of a box or a capsule have one normal.

Bars are those of contact forces in verdicts (`compare.instant`), of the largest force of the neutral equations without
contact: a wrong engine does not widen its own bar.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from consilience.audit.identities.equations import EPS, largest
from consilience.audit.identities.result import NotApplicableError, Residual, relative, worst
from consilience.audit.identities.subject import IdentitySubject
from consilience.compare.instant import CONTACT, EXACT_ROUTES
from consilience.compare.instants import BARS, Bars
from consilience.engine import Route
from consilience.mechanism import (
    Array,
    Cone,
    Contact,
    Mechanism,
    NearestPoints,
    State,
    contact_parts,
    contact_tangents,
    contact_velocity,
    move,
    nearest_points,
)

CLOSED = 1e-9
"""Largest gap of a closed contact in characteristic lengths; largest speed of what rests over that of the state."""


def bars_of(route: Route) -> Bars:
    """Return the bars of accelerations and forces where contacts push."""
    return BARS.get(route, Bars()) if route in EXACT_ROUTES else CONTACT


def gauge(cone: Cone, components: Array) -> Array:
    """Return the least ``mu N`` that allows friction forces, given by components along t1 and t2, shape (..., 2)."""
    if cone.kind == "circle":
        return np.asarray(np.linalg.norm(components, axis=-1))
    corners = cone.vertices
    edges = np.roll(corners, -1, axis=0) - corners
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    return np.asarray(np.max(components @ outward.T / np.sum(outward * corners, axis=1), axis=-1))


@dataclass(frozen=True, eq=False)
class ContactAtState:
    """A contact at a state: its parts, their nearest points and relative velocities."""

    mechanism: Mechanism
    state: State
    contact: Contact

    @cached_property
    def near(self) -> list[NearestPoints]:
        """Nearest points of each part."""
        return [nearest_points(self.mechanism, self.state, part) for part in contact_parts(self.contact)]

    @cached_property
    def velocities(self) -> Array:
        """Relative velocity of each part, shape (parts, 3), m/s."""
        return np.array([contact_velocity(self.mechanism, self.state, self.contact, near) for near in self.near])

    @property
    def normal(self) -> Array:
        """Normal that all parts share."""
        return self.near[0].normal

    @property
    def gap(self) -> float:
        """Smallest gap of the parts, m."""
        return min(near.gap for near in self.near)

    def friction(self, force: Array) -> Array:
        """Return the components of a force along the tangents of the cone, shape (2,)."""
        t1, t2 = contact_tangents(self.mechanism, self.state, contact_parts(self.contact)[0])
        return np.array([t1 @ force, t2 @ force])


def most_friction(contact: Contact) -> float:
    """Return the larger of the coefficients of sliding and sticking."""
    return contact.friction if contact.static_friction is None else contact.static_friction


def _contacts(subject: IdentitySubject) -> Iterator[tuple[str, ContactAtState, Array, float, float]]:
    """List label, contact, force of the engine, size of forces and speed of every contact at every state."""
    forces = subject.answer.contact_force
    if not subject.mechanism.contacts:
        raise NotApplicableError("there are no contacts")
    if forces is None:
        raise NotApplicableError("the method gives no forces of contacts")
    gravity = float(np.linalg.norm(subject.mechanism.gravity))
    for n, (state, eq) in enumerate(zip(subject.states, subject.equations, strict=True)):
        for c, contact in enumerate(subject.mechanism.contacts):
            here = ContactAtState(subject.mechanism, state, contact)
            speed = max(eq.speed, float(np.sqrt(gravity * eq.length)))
            yield f"state {n}, {contact.name}", here, forces[n, c], largest(eq.solution.terms) or 1.0, speed


def no_pull(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that no contact pulls: ``N >= 0``."""
    bar = bars_of(subject.route).reaction
    for what, here, force, size, _ in _contacts(subject):
        yield relative(max(0.0, -float(here.normal @ force)), bar * size, size, what)


def friction_cone(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that friction is within the cone of the stated law: ``T`` in ``mu N D``."""
    bar = bars_of(subject.route).reaction
    for what, here, force, size, _ in _contacts(subject):
        pressed = max(0.0, float(here.normal @ force))
        beyond = gauge(here.contact.cone, here.friction(force)) - most_friction(here.contact) * pressed
        yield relative(max(0.0, float(beyond)), bar * size, size, what)


def friction_against_slip(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that friction takes power from slip, and in Coulomb's circle ``T = -mu N u_t / |u_t|``.

    Where parts slip with different velocities their sum tells nothing.
    """
    bar, found = bars_of(subject.route).reaction, False
    for what, here, force, size, speed in _contacts(subject):
        slip = here.velocities - np.outer(here.velocities @ here.normal, here.normal)
        rate = float(np.linalg.norm(slip[0]))
        if rate <= CLOSED * speed or here.gap > CLOSED * subject.equations[0].length:
            continue
        if largest(slip - slip[0]) > CLOSED * speed:
            continue
        found, along, pressed = True, slip[0] / rate, float(here.normal @ force)
        friction = force - pressed * here.normal
        left = max(0.0, float(friction @ along))
        if here.contact.cone.kind == "circle":
            left = float(np.linalg.norm(friction + here.contact.friction * pressed * along))
        yield relative(left, bar * size, size, what)
    if not found:
        raise NotApplicableError("no closed contact slips with one velocity")


def complementarity(subject: IdentitySubject) -> Iterator[Residual]:
    """Check that nothing pushes across a gap, and where nothing approaches, ``g'' >= 0`` and ``N g'' = 0``.

    ``g''`` is the central difference of ``u_n`` along the engine's accelerations, of the fourth order.
    """
    bars = bars_of(subject.route)
    if any(c.compliance is not None for c in subject.mechanism.contacts):
        raise NotApplicableError("a compliant contact overlaps while it pushes")
    for k, (what, here, force, size, speed) in enumerate(_contacts(subject)):
        n, length = k // len(subject.mechanism.contacts), subject.equations[0].length
        pushing = abs(float(here.normal @ force))
        if here.gap > CLOSED * length:
            yield relative(pushing, bars.reaction * size, size, f"{what}, apart")
            continue
        if np.any(here.velocities @ here.normal < -CLOSED * max(speed, EPS)) or here.contact.associated:
            continue
        away = _gap_accelerations(subject, n, here)
        unit = largest(subject.equations[n].solution.x) or 1.0
        share = min(1.0, pushing / size) if size else 0.0
        least = float(np.min(away))
        found = [relative(max(0.0, -least), bars.acceleration * unit, unit, f"{what}, g''")]
        found.append(relative(share * max(0.0, least), bars.acceleration * unit, unit, f"{what}, N g''"))
        yield worst(found)


def _gap_accelerations(subject: IdentitySubject, n: int, here: ContactAtState) -> Array:
    """Return ``g''`` of the closed parts along the engine's accelerations, m/s^2."""
    s, a, alpha = here.state, subject.answer.a_WB_W[n], subject.answer.alpha_WB_W[n]
    eq = subject.equations[n]
    fastest = max(eq.speed, float(np.sqrt(eq.length * largest(subject.accelerations(n))))) / eq.length or 1.0
    h = EPS**0.2 / fastest

    def speeds(t: float) -> Array:
        ahead = move(s, np.hstack([t * s.v_WB_W + 0.5 * t**2 * a, t * s.w_WB_W + 0.5 * t**2 * alpha]).ravel())
        moving = State(ahead.p_WB, ahead.quat_WB, s.v_WB_W + t * a, s.w_WB_W + t * alpha)
        there = ContactAtState(here.mechanism, moving, here.contact)
        return np.array([u @ near.normal for u, near in zip(there.velocities, there.near, strict=True)])

    u = [speeds(k * h) for k in (-2, -1, 1, 2)]
    closed = np.array([near.gap for near in here.near]) <= CLOSED * eq.length
    return np.asarray((8.0 * (u[2] - u[1]) - (u[3] - u[0])) / (12.0 * h))[closed]
