"""Numbers of contact objects, which follow the step of a motion.

Stiffness, damping and the zone of friction follow the step h, so that contacts become rigid and friction Coulomb's as h
vanishes. With the inverse inertia A that a contact sees together with all others, at the start, or where it turns out
too small, the largest in any direction of the normals:

=======================  ======================================================================================
closed, no restitution   stiffness ``1 / (h^2 A)`` in motions that are extrapolated, else ``50 / (h s A)``, s the
                         sample interval, for overlaps in proportion to h; damping `DAMPING`, else `CREEPING`
others                   stiffness `BOUNCE`, extrapolated or of stops with e = 0 ``(RESOLVED/h)^2``, over A;
                         damping `OVERDAMPED` if e = 0
friction                 zone ``h sum(mu N G)``, G the tangential inverse inertias, N bounds of normal forces; the
                         largest of what two bodies keep closed
=======================  ======================================================================================

A contact that rests under a load at the start has no restitution either, which Exudyn divides by a speed of impact.
A damped contact pulls as it opens, until its overlap has gone: what that changes vanishes with the damping over the
stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from consilience.engine import CannotRepresent
from consilience.mechanism import TOUCHING, Array, Mechanism, State, characteristic_length
from consilience_exudyn.contact_instant import AT_REST, contact_accelerations
from consilience_exudyn.contact_rows import TouchRow, contact_row, mobility
from consilience_exudyn.contacts import Penalty, parts_of
from consilience_exudyn.maximal import build
from consilience_exudyn.terms import Terms

BOUNCE = 4e6
"""Stiffness of contacts that hit, over the inertia, 1/s^2: half a period is 1.6 ms."""

OVERDAMPED = 10.0
"""Damping of contacts that hit without restitution, over the root of the stiffness: they rebound with one per cent."""

RIGID, LINEAR = 1.0, 50.0
"""Stiffness of contacts that stay closed, over the inertia, times h^2, which makes accelerations of rounding over h^2,
or times step and sample interval, where overlaps are in proportion to the step.
"""

DAMPING, CREEPING = 0.8, 4.0
"""Damping of contacts that stay closed, over the root of the stiffness, in motions that are extrapolated and in others:
above the critical one of twice the root of the inertias' ratio, a contact that loses its load at once keeps no speed.
"""

RATE = 1.5
"""Largest rate of a damper, times the step: the inertia of a tree changes as it moves."""

RESOLVED = 0.2
"""Largest frequency of a contact that hits, times the step."""

_HITS = 5.0
"""Largest force of a contact that is closed at the start, over the largest of all there, by which nothing hits it."""

_OPENS = 1e-6
"""Acceleration of a closed gap, over the largest acceleration, above which it opens."""

_CLEAR = 1e-12
"""Gap in m of a contact without load at the start, which by rounding would act in the first step, or not."""

_DEEP = 4.0
"""Radius of a point's sphere over the overlap under the bound of the normal force."""

_ROUND, _ROUNDER = 0.1, 1.0
"""Radius of a point's sphere beyond that, over the step, m/s, in motions and in those that are extrapolated: normals
have the rounding of places over the radius, which the limit multiplies; a body that tilts rolls on it.
"""

LEAST_ZONE = 1e-12
"""Zone of contacts without friction or load, m/s."""


@dataclass(frozen=True, eq=False)
class Step:
    """What the numbers of contacts follow.

    Attributes
    ----------
    step : float, s
    rigid : float, 1/s^2
        Stiffness of contacts that stay closed, over the inertia.
    softness : float or None
        Of contacts that hit; None in motions that are extrapolated, whose numbers all follow the step alike.
    room : float, m
        That a motion needs on planes.
    """

    step: float
    rigid: float
    softness: float | None
    room: float

    @property
    def hardest(self) -> float:
        """Stiffness of stops without restitution, which have no friction, over the inertia, 1/s^2."""
        return (RESOLVED / self.step) ** 2

    @property
    def stiffness(self) -> float:
        """Stiffness of contacts that hit, and of stops with restitution, over the inertia, 1/s^2."""
        return min(BOUNCE / self.softness**2 if self.softness else np.inf, self.hardest)

    @property
    def round(self) -> float:
        """Radius of a point's sphere beyond its overlaps, m."""
        return self.step * (_ROUNDER if self.softness is None else _ROUND)

    @property
    def damping_of_closed(self) -> float:
        """Damping of contacts that stay closed, over the inertia, 1/s."""
        if self.softness is None:
            return DAMPING * self.rigid**0.5
        return min(CREEPING * self.rigid**0.5, RATE / self.step)

    def damping(self, stiffness: float) -> float:
        """Return the damping of what hits without restitution, over the inertia, 1/s."""
        return min(OVERDAMPED * stiffness**0.5, RATE / self.step)


@dataclass(frozen=True, eq=False)
class Seen:
    """An elementary contact at the start.

    Attributes
    ----------
    row : TouchRow
    A : float
        Bound of the inverse inertia along the normal, all contacts together.
    G : ndarray
        Inverse inertias across the normal by which all contacts move this one.
    normal : float, N
        Normal force at the start.
    speed : float, m/s
        Bound of the closing speed of the first impact; zero for a closed contact that rests or has no restitution.
    load : float, N
        Normal force that a contact which opens may have before; zero for others. Its bound does not follow the step, so
        that its zone does.
    waits : bool
        Whether it is closed and at rest without a load, and shall rebound when it is hit.
    """

    row: TouchRow
    A: float
    G: Array
    normal: float
    speed: float
    load: float
    waits: bool

    def bound(self, at: Step) -> float:
        """Return the first bound of the normal force."""
        return self.load or max(self.normal, self.speed * np.sqrt(at.stiffness) / self.A)

    def penalty(self, at: Step, bound: float) -> Penalty:
        """Return the numbers of the contact object for a bound of the normal force."""
        part = self.row.part
        if self.speed > 0.0:
            stiffness = at.stiffness / self.A
            damping = 0.0 if part.restitution else at.damping(at.stiffness) / self.A
        else:
            stiffness, damping = at.rigid / self.A, at.damping_of_closed / self.A
        zone = at.step * float(np.sum(self.G)) * part.friction * bound
        overlap = self.normal / stiffness or -_CLEAR
        deep = _DEEP * max(overlap, bound / stiffness) + at.round
        restitution = part.restitution if self.speed > 0.0 else 0.0
        return Penalty(stiffness, damping, zone, overlap, deep, at.room, restitution)


def penalties_of(seen: Sequence[Seen], bounds: Sequence[float], at: Step) -> list[Penalty]:
    """Return the numbers of all contacts: the largest radius of points, and one zone for what two bodies keep closed.

    A point without load goes as deep as those with it. Where corners of a box start to slip, those with a smaller zone
    would reach it first and leave the others a load that they brake for h log(1/h), which no power of the step removes.
    The rate at which friction within the zone ends slips is at most the largest sum by rows of what couples them: each
    contact adds by its own normal force, so that corners without load widen no zone.
    """
    found = [one.penalty(at, bound) for one, bound in zip(seen, bounds, strict=True)]
    deepest = max((one.radius for one in found), default=0.0)
    pairs = [(one.row.part.body, one.row.part.partner) if one.speed == 0.0 else None for one in seen]
    friction = [one.row.part.friction * b if one.speed == 0.0 else 0.0 for one, b in zip(seen, bounds, strict=True)]
    zones = {
        pair: at.step * max(float(one.G @ friction) for one, own in zip(seen, pairs, strict=True) if own == pair)
        for pair in set(pairs) - {None}
    }
    return [
        replace(one, radius=deepest, zone=max(zones.get(pair, one.zone), LEAST_ZONE))
        for one, pair in zip(found, pairs, strict=True)
    ]


def late_hits(seen: Sequence[Seen], largest: Array) -> list[tuple[Seen, float]]:
    """Return what is closed at the start, and hits later, with its force: or its numbers were unstable."""
    least = _HITS * max(max((one.normal for one in seen), default=0.0), 1e-9)
    return [(one, float(force)) for one, force in zip(seen, largest, strict=True) if one.speed == 0.0 and force > least]


def refuse_late_hits(hits: Sequence[tuple[Seen, float]]) -> None:
    """Refuse a contact with friction or restitution that rests at the start, and is hit later."""
    for one, force in hits:
        what = f"contact '{one.row.part.name}', closed at the start, hits later with {force:.3g} N"
        if one.row.part.friction > 0.0:
            raise CannotRepresent(what, "the zone in which its friction is proportional would not vanish with the step")
        if one.row.part.restitution > 0.0:
            raise CannotRepresent(what, "Exudyn's restitution begins with the speed of an impact, and it rests at none")


def refuse_chain(seen: Sequence[Seen]) -> None:
    """Refuse contacts that rest without a load and shall rebound together: by their dampers one is as rigid as joined.

    Raises
    ------
    CannotRepresent
    """
    waiting = [one.row.part.name for one in seen if one.waits]
    if len(waiting) > 1:
        what = f"contacts '{waiting[0]}' and '{waiting[1]}', at rest until they are hit"
        raise CannotRepresent(what, "Exudyn's damper of a rebound has no bound where an impact begins without a speed")


def contacts_at_start(mechanism: Mechanism, state: State, turning: bool = False) -> list[Seen]:
    """Return all elementary contacts as they are at the start; `turning`: with the largest A as the bodies turn."""
    rows = [contact_row(mechanism, state, part, number) for number, part in parts_of(mechanism)]
    if not rows:
        return []
    W, slack = mobility(mechanism, state), TOUCHING * characteristic_length(mechanism)
    pushed = [row.J if turning else (row.normal @ row.J)[None] for row in rows]
    A = _coupled(W, pushed).sum(axis=1)
    G = _coupled(W, [row.J - np.outer(row.normal, row.normal @ row.J) for row in rows])
    forces, opens = _at_start(mechanism, state, rows)
    found, pull = [], float(np.linalg.norm(mechanism.gravity))
    for row, a, g, normal, open_ in zip(rows, A, G, forces, opens, strict=True):
        rests = normal > 0.0 and row.gap <= slack and row.rate >= -AT_REST
        hits = row.gap > slack or open_ or (row.part.restitution > 0.0 and not rests)
        speed = float(np.linalg.norm(row.u) + np.sqrt(2.0 * pull * max(row.gap, 0.0))) if hits else 0.0
        load = max(forces) if open_ and row.gap <= slack and row.part.restitution == 0.0 else 0.0
        waits = row.part.restitution > 0.0 and not rests and row.gap <= slack and abs(row.rate) <= AT_REST
        found.append(Seen(row, float(a), g, normal, max(speed, 1e-3) if hits else 0.0, load, waits))
    return found


def _coupled(W: Array, rows: Sequence[Array]) -> Array:
    """Return the largest inverse inertias by which all contacts, with rows (k, 6 n_b), move each, shape (n, n)."""
    return np.array([[float(np.linalg.norm(one @ W @ two.T, 2)) for two in rows] for one in rows])


def _at_start(mechanism: Mechanism, state: State, rows: Sequence[TouchRow]) -> tuple[list[float], list[bool]]:
    """Normal forces at the start, and which of the gaps open there.

    Where something starts to slide they are those without friction; at an impact all share the weight.
    """
    smooth = replace(mechanism, contacts=tuple(replace(c, friction=0.0) for c in mechanism.contacts))
    for one in (mechanism, smooth):
        try:
            terms = Terms(build(one, state))
            a, _, parts = contact_accelerations(terms, state, terms.equations(state))
            break
        except (CannotRepresent, RuntimeError):
            pass
    else:
        weight = sum(body.mass for body in mechanism.bodies) * float(np.linalg.norm(mechanism.gravity))
        return [weight / len(rows)] * len(rows), [False] * len(rows)
    least = _OPENS * max(1.0, float(np.max(np.abs(a))))
    opens = [row.rate > AT_REST or row.normal @ (row.J @ a + row.gamma) + row.n_dot @ row.u > least for row in rows]
    return [max(0.0, float(row.normal @ force)) for row, force in zip(rows, parts, strict=True)], opens
