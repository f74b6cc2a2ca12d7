"""Contacts, stops and dry friction at a state: rows in Pinocchio's velocities, the sets of their forces, the solution.

A step of the length h from v with the free velocity ``v_f = v + h a_f`` ends at ``v+ = v_f + h M^-1 J^T f``. All rows
are over h, so that f are forces, and rows of constraints are ``J a = gamma``. Normal rows, and those of stops, hold

- ``u+ >= -gap / h``, u the rate of the gap: the shapes meet at the end of the step (a contact that lasts, or e = 0);
- ``u+ >= -e u-`` at an impact: Newton's law. A closing speed is an impact if the free acceleration of the gap does not
  make it in `RESTING` steps. An impact with e > 0 is in that step whose middle is nearest to it; one with e = 0 would
  be shared by two steps, and is told, so that the step can be divided there.

[Moreau, in: Nonsmooth Mechanics and Applications, CISM 302, 1988; Acary, Brogliato, Numerical Methods for Nonsmooth
Dynamical Systems, 2008, chapter 10]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot

import numpy as np
import pinocchio as pin

from consilience.mechanism import Array, Mechanism, elementary_contacts
from consilience_pinocchio.cones import ONE_SIDED, Anchor, Circle, ConeSolver, ForceSet, Interval
from consilience_pinocchio.dynamics import all_rows
from consilience_pinocchio.efforts import Axis, axis
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.touching import Nearest, Side, Touch
from consilience_pinocchio.translate import Translation

RESTING = 2.0

REACH = 2.0
"""Motion of a gap in a step that is reckoned with, over what its rates and the largest acceleration give."""

CLOSED = 1e-9
"""Gap in m or rad up to which a contact or a stop is closed, whatever its rates; at an instant its rate, too."""

HELD = 1e-13
"""Row of a gap, over those of its contact, up to which joints hold the gap whatever forces act: it has none."""

AT_REST = 1e-9
"""Slip, or rate of a coordinate, in m/s or rad/s up to which it is at rest."""

SEPARATED, SLIDING, STICKING = range(3)


def touches(mechanism: Mechanism) -> bool:
    """Whether a mechanism has contacts, stops or dry friction."""
    return bool(mechanism.contacts or mechanism.stops or mechanism.dry_frictions)


@dataclass(frozen=True, eq=False)
class Start:
    """Start of a step.

    Attributes
    ----------
    q, v : ndarray, shape (nq,) and (nv,)
    a : ndarray, shape (nv,)
        Accelerations without constraints, contacts, stops and dry friction.
    t, h : float, s
    whole : float, s
        Step of which this one may be a part: overlaps are removed over a whole step.
    """

    q: Array
    v: Array
    a: Array
    t: float
    h: float
    whole: float

    @cached_property
    def free(self) -> Array:
        """Velocity at the end of the step without forces."""
        return np.asarray(self.v + self.h * self.a)

    @cached_property
    def _fastest(self) -> float:
        """Largest change of a velocity in the step without forces."""
        return self.h * float(np.abs(self.a).max())

    def needed(self, gap: float, along: Array, restitution: float) -> float | None:
        """Return what is added to the free rate of a gap, over h, in its condition; None if the gap is out of reach.

        Other contacts press bodies together that would not approach without forces: what is near is in the solution.

        Parameters
        ----------
        gap : float
        along : ndarray, shape (nv,)
            Row of its rate.
        restitution : float
        """
        u, free = float(along.dot(self.v)), float(along.dot(self.free))
        if restitution > 0.0 and self.strikes(along):
            return None if gap + 0.5 * self.h * u > 0.0 else restitution * u / self.h
        reach = REACH * self.h * (abs(u) + abs(free) + self._fastest)
        return None if gap > max(reach, CLOSED) else gap / (self.h * (self.h if gap > 0.0 else self.whole))

    def strikes(self, along: Array) -> bool:
        """Whether the closing speed of a gap, whose rate has the row `along`, is that of an impact."""
        u = float(along.dot(self.v))
        return u < -RESTING * abs(float(along.dot(self.free)) - u)

    def contact(self, number: int, touch: Touch, nearest: Nearest, needed: float) -> Array:
        """Return the accelerations in the rows of a contact without its forces, shape (3,)."""
        rates = nearest.J.dot(self.free) / self.h
        rates[2] += needed
        return np.asarray(rates)

    def joint(self, along: Array) -> float:
        """Return the acceleration of a coordinate without the force of its stop or friction."""
        return float(along @ self.free) / self.h


@dataclass(frozen=True)
class _Limit:
    """One end of a stop: the gap is ``sense * (q - bound)``, q the coordinate of the mechanism."""

    place: Axis
    sense: float
    bound: float
    restitution: float

    def gap(self, q: Array) -> float:
        return self.sense * (self.place.sign * float(q[self.place.idx_q]) - self.bound)

    def row(self, count: int) -> Array:
        """Return the row (count,) of the rate of the gap."""
        along = np.zeros(count)
        along[self.place.idx_v] = self.sense * self.place.sign
        return along


@dataclass(frozen=True, eq=False)
class Pressed:
    """Solution at a state.

    Attributes
    ----------
    a : ndarray, shape (nv,)
        Accelerations with all forces; over a step ``(v+ - v) / h``.
    multipliers : ndarray
        Of the welds and of the elements' rows, as `all_rows` orders them, then zeros.
    forces, modes : ndarray, shape (n_c, 3) and (n_c,)
        Forces on the bodies of the elementary contacts in N, world axes; 0 separated, 1 sliding, 2 sticking.
    efforts : ndarray, shape (nv,)
        Of stops and dry friction.
    power : float, W
        Of contacts, stops and dry friction, at the mean of the velocities before and after.
    touched : dict
        Nearest points of the contacts that touch, by number.
    ends : ndarray, shape (n, 3)
        Accelerations in the rows of these contacts with all forces, and with what `Start` adds.
    dry_ends : ndarray
        The same in the rows of dry friction.
    hits : frozenset of int
        Open contacts without restitution that an impact closes within the step; stops count on from the contacts.
    """

    a: Array
    multipliers: Array
    forces: Array
    modes: Array
    efforts: Array
    power: float
    touched: dict[int, Nearest]
    ends: Array
    dry_ends: Array
    hits: frozenset[int]


class _Rows:
    """Rows J (n, nv), accelerations in them without their forces (n,), and the sets of the forces.

    Of what strikes, as `Pressed.hits` counts it, `striking` has the normal rows.
    """

    def __init__(self) -> None:
        self.striking: dict[int, int] = {}
        self._count = 0
        self.J: list[Array] = []
        self.y: list[Array] = []
        self.sets: list[ForceSet] = []

    def add(self, J: Array, y: Array, *sets: ForceSet) -> None:
        self.J.append(J)
        self.y.append(y)
        self.sets += sets
        self._count += len(y)

    def __len__(self) -> int:
        return self._count


class Unilateral:
    """Contacts, stops and dry friction of a mechanism.

    Attributes
    ----------
    touches : list of Touch
        One for each of the mechanism's elementary contacts.
    solver : ConeSolver
    broken : frozenset of int
        Contacts that have broken away, and slide though they may still be at rest.
    held : frozenset of int
        Contacts that had their static coefficient in the last solution.
    barred : frozenset of int
        Contacts and stops that do not act, as `Pressed.hits` counts them.
    """

    def __init__(self, translation: Translation, elements: Elements) -> None:
        mechanism, contacts = translation.mechanism, elementary_contacts(translation.mechanism)
        self._translation, self._elements = translation, elements
        names = sorted({name for contact in contacts for name in (contact.body, contact.partner)})
        sides = {name: Side(translation, name) for name in names}
        self._sides = tuple(sides.values())
        self.touches = [Touch(contact, sides[contact.body], sides[contact.partner]) for contact in contacts]
        self._limits = [
            _Limit(axis(translation, stop.joint, stop.coordinate), sense, bound, stop.restitution)
            for stop in mechanism.stops
            for sense, bound in ((1.0, stop.lower), (-1.0, stop.upper))
            if bound is not None
        ]
        self._dry = [(axis(translation, d.joint, d.coordinate), float(d.bound or 0.0)) for d in mechanism.dry_frictions]
        self.broken = self.held = self.barred = frozenset[int]()
        self.solver = ConeSolver(any(contact.associated for contact in mechanism.contacts))

    def gaps(self) -> Array:
        """Return the gaps of the elementary contacts in m at Pinocchio's current placements."""
        for side in self._sides:
            side.place()
        return np.array([touch.gap() for touch in self.touches])

    def approaching(self, which: frozenset[int], q: Array, v: Array) -> list[tuple[float, float]]:
        """Return gaps of contacts and stops, as `Pressed.hits` counts them, with their rates.

        Pinocchio's data must hold the kinematics of q.
        """
        found, count = [], len(self.touches)
        for side in self._sides:
            side.update()
        for n in which:
            if n < count:
                nearest = self.touches[n].nearest()
                found.append((nearest.gap, float(nearest.J[2].dot(v))))
            else:
                limit = self._limits[n - count]
                found.append((limit.gap(q), float(limit.row(len(v)).dot(v))))
        return found

    def dry_rates(self, v: Array) -> Array:
        """Return the rates of the coordinates with dry friction, Pinocchio's, in rad/s or m/s."""
        return np.array([v[place.idx_v] for place, _ in self._dry])

    def press(self, start: Start) -> Pressed:
        """Solve for the forces: of constraints, contacts, stops, dry friction.

        The data keep the kinematics, with zero accelerations.
        """
        J, gamma = all_rows(self._translation, self._elements, start.q, start.v, start.t)
        for side in self._sides:
            side.update()
        rows = _Rows()
        if empty := -len(J) % 3:  # anchors have three rows
            J, gamma = np.vstack([J, np.zeros((empty, len(start.v)))]), np.concatenate([gamma, np.zeros(empty)])
        rows.add(J, J @ start.a - gamma, *[Anchor()] * (len(J) // 3))
        touched = self._add_contacts(rows, start)
        self._add_joints(rows, start)
        return self._solved(rows, start, touched)

    def _add_contacts(self, rows: _Rows, start: Start) -> dict[int, Nearest]:
        """Add the rows of the contacts that touch; return their nearest points."""
        touched, held = {}, set()
        for n, touch in enumerate(self.touches):
            nearest, law = touch.nearest(), touch.law
            needed = start.needed(nearest.gap, nearest.J[2], law.restitution)
            if needed is None or n in self.barred:
                continue
            y = start.contact(n, touch, nearest, needed)
            if hypot(*nearest.J[2]) <= HELD * np.linalg.norm(nearest.J) and abs(y[2]) * start.h**2 <= CLOSED:
                continue
            touched[n] = nearest
            mu, own = law.friction, law.static_friction is not None and n not in self.broken
            if own and hypot(*(nearest.J[:2] @ start.v)) <= AT_REST:
                mu = float(law.static_friction or 0.0)
                held.add(n)
            if nearest.gap > CLOSED and law.restitution == 0.0 and start.strikes(nearest.J[2]):
                rows.striking[n] = len(rows) + 2
            rows.add(nearest.J, y, Circle(mu))
        self.held = frozenset(held)
        return touched

    def _add_joints(self, rows: _Rows, start: Start) -> None:
        """Add the rows of stops that touch, and of dry friction."""
        for n, limit in enumerate(self._limits, len(self.touches)):
            along, gap = limit.row(len(start.v)), limit.gap(start.q)
            needed = start.needed(gap, along, limit.restitution)
            if needed is None or n in self.barred:
                continue
            if gap > CLOSED and limit.restitution == 0.0 and start.strikes(along):
                rows.striking[n] = len(rows)
            rows.add(along[None], np.array([along @ start.free / start.h + needed]), ONE_SIDED)
        for place, bound in self._dry:
            along = np.zeros(len(start.v))
            along[place.idx_v] = 1.0
            rows.add(along[None], np.array([start.joint(along)]), Interval(-bound, bound))

    def _solved(self, rows: _Rows, start: Start, touched: dict[int, Nearest]) -> Pressed:
        J, y, held = np.concatenate(rows.J), np.concatenate(rows.y), len(rows.J[0])
        by_mass = J.dot(pin.computeMinverse(self._translation.model, self._translation.data, start.q))
        G = by_mass.dot(J.T)
        f = self.solver.forces(G, y, rows.sets)
        a = start.a + f.dot(by_mass)
        end = start.v + start.h * a
        count, joints = len(self.touches), held + 3 * len(touched)
        forces, modes = np.zeros((count, 3)), np.zeros(count, dtype=int)
        slips = J[held:joints].dot(end).reshape(-1, 3).tolist()
        for (n, nearest), of, slip in zip(touched.items(), f[held:joints].reshape(-1, 3), slips, strict=True):
            forces[n], modes[n] = of.dot(nearest.axes), _mode(of[2], slip)
        power, ends = float(f[held:].dot(J[held:].dot(0.5 * (start.v + end)))), G.dot(f) + y
        dry = len(y) - len(self._dry)
        return Pressed(
            *(a, f[:held], forces, modes, f[joints:].dot(J[joints:]), power),
            *(touched, ends[held:joints].reshape(-1, 3), ends[dry:]),
            hits=frozenset(n for n, row in rows.striking.items() if f[row] > 0.0),
        )


def _mode(pressing: float, slip: list[float]) -> int:
    if pressing <= 0.0:
        return SEPARATED
    return SLIDING if hypot(slip[0], slip[1]) > AT_REST else STICKING
