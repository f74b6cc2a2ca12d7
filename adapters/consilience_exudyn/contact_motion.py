"""Motions with contacts, stops and dry friction by Exudyn's explicit Runge-Kutta method of order four.

Explicit integrators take no constraints: bodies are free, or links of a kinematic tree. Stiffness, damping and the zone
of friction follow the step h, so that contacts become rigid and friction Coulomb's as h vanishes. With the inverse
inertia A that a contact sees together with all others:

=======================  ======================================================================================
closed, no restitution   stiffness ``1 / (h^2 A)`` in motions that are extrapolated, else ``50 / (h s A)``, s the
                         sample interval, for overlaps in proportion to h; damping `DAMPING`, else `CREEPING`
others                   stiffness `BOUNCE`, extrapolated or of stops with e = 0 ``(RESOLVED/h)^2``, over A;
                         damping `OVERDAMPED` if e = 0
friction                 zone ``h mu N G``, G the tangential inverse inertia, N a bound of the normal force; the largest
                         of what two bodies keep closed
=======================  ======================================================================================

A damped contact pulls as it opens, until its overlap has gone: what that changes vanishes with the damping over the
stiffness. Below its zone friction is stiff, beyond N the method unstable: the motion is repeated with a larger bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from consilience.engine import CannotRepresent, TrajectoryAnswer, require_stable, steps_per_sample
from consilience.mechanism import (
    TOUCHING,
    Array,
    Mechanism,
    State,
    characteristic_length,
    continuous_in_time,
    quaternion_from_rotation,
)
from consilience_exudyn.contact_instant import AT_REST, contact_accelerations
from consilience_exudyn.contact_rows import TouchRow, contact_row, coordinate_row, mobility
from consilience_exudyn.contact_samples import room_ahead, room_taken, with_contacts
from consilience_exudyn.contacts import Penalty, add_contact, add_dry_friction, add_limit, limits_of, parts_of
from consilience_exudyn.free_bodies import KEEP, add_free_bodies
from consilience_exudyn.kinematic_tree import Coordinates, build_tree, is_one_axis_tree
from consilience_exudyn.library import CONTACT_SETTINGS, exu, items
from consilience_exudyn.maximal import build
from consilience_exudyn.terms import Terms
from consilience_exudyn.trajectory import Integration, solve, stored

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

_STABLE = 2.0
"""Normal force over its bound up to which friction below the zone is stable."""

RATE = 1.5
"""Largest rate of a damper, times the step: the inertia of a tree changes as it moves."""

_REVERSES = 0.5
"""Rate of dry friction below its zone, times the step: what reverses within one step errs by the step's phase."""

RESOLVED = 0.2
"""Largest frequency of a contact that hits, times the step."""

_HITS = 5.0
"""Largest force of a contact that is closed at the start, over the largest of all there, by which nothing hits it."""

_OPENS = 1e-6
"""Acceleration of a closed gap, over the largest acceleration, above which it opens."""

_ATTEMPTS = 6
"""Motions with larger bounds of normal forces."""

_CLEAR = 1e-12
"""Gap in m of a contact without load at the start, which by rounding would act in the first step, or not."""

_DEEP = 4.0
"""Radius of a point's sphere over the overlap under the bound of the normal force."""

_ROUND = 0.1
"""Radius of a point's sphere beyond that, over the step, m/s: normals have the rounding of places over the radius,
which would grow with the inverse square of the step.
"""

_RUNGE_KUTTA = Integration("RK44", CONTACT_SETTINGS)


@dataclass(frozen=True, eq=False)
class _Step:
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
    def damping_of_closed(self) -> float:
        """Damping of contacts that stay closed, over the inertia, 1/s."""
        if self.softness is None:
            return DAMPING * self.rigid**0.5
        return min(CREEPING * self.rigid**0.5, RATE / self.step)

    def damping(self, stiffness: float) -> float:
        """Return the damping of what hits without restitution, over the inertia, 1/s."""
        return min(OVERDAMPED * stiffness**0.5, RATE / self.step)


@dataclass(frozen=True, eq=False)
class _Seen:
    """An elementary contact at the start.

    Attributes
    ----------
    row : TouchRow
    A, G : float
        Bounds of the inverse inertias along and across the normal, all contacts together.
    normal : float, N
        Normal force at the start.
    speed : float, m/s
        Bound of the closing speed of the first impact; zero for a closed contact without restitution.
    load : float, N
        Normal force that a contact which opens may have before; zero for others. Its bound does not follow the step, so
        that its zone does.
    """

    row: TouchRow
    A: float
    G: float
    normal: float
    speed: float
    load: float

    def bound(self, at: _Step) -> float:
        """Return the first bound of the normal force."""
        return self.load or max(self.normal, self.speed * np.sqrt(at.stiffness) / self.A)

    def penalty(self, at: _Step, bound: float) -> Penalty:
        """Return the numbers of the contact object for a bound of the normal force."""
        part = self.row.part
        if self.speed > 0.0:
            stiffness = at.stiffness / self.A
            damping = 0.0 if part.restitution else at.damping(at.stiffness) / self.A
        else:
            stiffness, damping = at.rigid / self.A, at.damping_of_closed / self.A
        zone = at.step * self.G * part.friction * bound
        overlap = self.normal / stiffness or -_CLEAR
        deep = _DEEP * max(overlap, bound / stiffness) + _ROUND * at.step
        return Penalty(stiffness, damping, max(zone, 1e-12), overlap, deep, at.room, part.restitution)


@dataclass(frozen=True, eq=False)
class _Run:
    """Assembled system: sensors of each body (position, rotation, velocity, angular velocity) and of each contact."""

    container: Any
    system: Any
    sensors: Sequence[Sequence[Any]]
    R_LB: Array
    forces: Sequence[Any]


def contact_motion(
    mechanism: Mechanism, state: State, times: Array, step: float, softness: float | None = None
) -> TrajectoryAnswer:
    """Integrate a motion with contacts, stops and dry friction.

    Parameters
    ----------
    mechanism, state, times, step, softness : see `_Step`

    Raises
    ------
    CannotRepresent
        A contact with friction that is closed at the start hits later; or as `with_contacts`.
    RuntimeError
        Exudyn fails, or normal forces exceed every bound.
    """
    rigid = RIGID / step**2
    if softness is not None:
        rigid = min(rigid, LINEAR / (step * float(times[1] - times[0])))
    room = room_ahead(mechanism, state, float(times[-1] - times[0]))
    return _bounded_motion(mechanism, state, times, _Step(step, rigid, softness, room), ())[0]


def halved_motions(mechanism: Mechanism, state: State, times: Array, step: float, count: int) -> list[TrajectoryAnswer]:
    """Integrate a motion by halved steps, to be extrapolated: all numbers follow the step alike.

    The first motion, the shortest to compute, tells the room that all need, and the bounds of the normal forces: bounds
    that each finds by itself, where friction below its zone was unstable, are by chance.

    Parameters
    ----------
    mechanism, state, times, step : see `contact_motion`
    count : int
        Number of motions.
    """
    room = room_ahead(mechanism, state, float(times[-1] - times[0]))
    motion, bounds = _bounded_motion(mechanism, state, times, _Step(step, RIGID / step**2, None, room), ())
    room, motions = room_taken(mechanism, motion), [motion]
    for n in range(1, count):
        h = step / 2.0**n
        motion, bounds = _bounded_motion(mechanism, state, times, _Step(h, RIGID / h**2, None, room), bounds)
        motions.append(motion)
    return motions


def _bounded_motion(
    mechanism: Mechanism, state: State, times: Array, at: _Step, least: Sequence[float]
) -> tuple[TrajectoryAnswer, list[float]]:
    """Return a motion and the bounds of its normal forces, which are no less than `least`, if that is known."""
    seen = _contacts_at_start(mechanism, state)
    bounds = [max(one.bound(at), known) for one, known in zip(seen, least or [0.0] * len(seen), strict=True)]
    for _ in range(_ATTEMPTS):
        penalties = _alike(seen, [one.penalty(at, bound) for one, bound in zip(seen, bounds, strict=True)])
        run = _assemble(mechanism, state, at, penalties)
        try:
            answer, forces = _integrate(mechanism, run, times, at.step)
        except FloatingPointError:  # friction below its zone is unstable far above its bound
            bounds = [2.0 * bound for bound in bounds]
            continue
        largest = np.max(np.linalg.norm(forces, axis=2), axis=0, initial=0.0)
        if np.all(largest <= _STABLE * np.array(bounds)):
            return with_contacts(mechanism, answer, forces, penalties, 1.0 / (at.step * np.sqrt(at.stiffness))), bounds
        _refuse_late_hit(seen, largest)
        bounds = [max(b, 1.2 * f) for b, f in zip(bounds, largest, strict=True)]
    raise RuntimeError(
        f"forces exceed {max(bounds):.3g} N, or the motion diverges: steps of {at.step:g} s are too long"
    )


def _alike(seen: Sequence[_Seen], penalties: Sequence[Penalty]) -> list[Penalty]:
    """Return numbers with the largest radius of points for all, and the largest zone for what two bodies keep closed.

    A point without load goes as deep as those with it. Where corners of a box start to slip, those with a smaller zone
    would reach it first and leave the others a load that they brake for h log(1/h), which no power of the step removes.
    """
    deepest = max((one.radius for one in penalties), default=0.0)
    pairs = [(one.row.part.body, one.row.part.partner) if one.speed == 0.0 else None for one in seen]
    zones = {
        pair: max(one.zone for one, own in zip(penalties, pairs, strict=True) if own == pair)
        for pair in set(pairs) - {None}
    }
    return [
        replace(one, radius=deepest, zone=zones.get(pair, one.zone)) for one, pair in zip(penalties, pairs, strict=True)
    ]


def _refuse_late_hit(seen: Sequence[_Seen], largest: Array) -> None:
    """Refuse a contact with friction that is closed at the start, and is hit later."""
    loaded = max((one.normal for one in seen), default=0.0)
    for one, force in zip(seen, largest, strict=True):
        if one.speed == 0.0 and one.row.part.friction > 0.0 and force > _HITS * max(loaded, 1e-9):
            raise CannotRepresent(
                f"contact '{one.row.part.name}', closed at the start, hits later with {force:.3g} N",
                "the zone in which its friction is proportional would not vanish with the step",
            )


def _contacts_at_start(mechanism: Mechanism, state: State) -> list[_Seen]:
    """Return all elementary contacts as they are at the start."""
    rows = [contact_row(mechanism, state, part, number) for number, part in parts_of(mechanism)]
    if not rows:
        return []
    W, slack = mobility(mechanism, state), TOUCHING * characteristic_length(mechanism)
    normals = np.array([row.normal @ row.J for row in rows])
    A = np.abs(normals @ W @ normals.T).sum(axis=1)
    tangents = [row.J - np.outer(row.normal, row.normal @ row.J) for row in rows]
    G = [sum(float(np.linalg.norm(one @ W @ two.T, 2)) for two in tangents) for one in tangents]
    forces, opens = _at_start(mechanism, state, rows)
    found, pull = [], float(np.linalg.norm(mechanism.gravity))
    for row, a, g, normal, open_ in zip(rows, A, G, forces, opens, strict=True):
        hits = row.gap > slack or row.part.restitution > 0.0 or open_
        speed = float(np.linalg.norm(row.u) + np.sqrt(2.0 * pull * max(row.gap, 0.0))) if hits else 0.0
        load = max(forces) if open_ and row.gap <= slack and row.part.restitution == 0.0 else 0.0
        found.append(_Seen(row, float(a), g, normal, max(speed, 1e-3) if hits else 0.0, load))
    return found


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


def _assemble(mechanism: Mechanism, state: State, at: _Step, penalties: Sequence[Penalty]) -> _Run:
    objects: list[Any] = []

    def touching(system: Any, mark: Any, coordinates: Coordinates | None) -> None:
        for (_, part), penalty in zip(parts_of(mechanism), penalties, strict=True):
            objects.append(add_contact(system, mechanism, state, part, penalty, mark))
        if coordinates is not None:
            _add_joint_elements(system, mechanism, state, at, coordinates)
        sensors.extend(
            system.AddSensor(
                items.SensorObject(objectNumber=index, outputVariableType=exu.OutputVariableType.Force, **KEEP)
            )
            for index in objects
        )

    sensors: list[Any] = []
    if is_one_axis_tree(mechanism):
        tree = build_tree(mechanism, state, touching=touching)
        return _Run(tree.container, tree.system, tree.sensors, tree.R_LB, sensors)
    container = exu.SystemContainer()
    system = container.AddSystem()
    bodies, R_NB = add_free_bodies(system, mechanism, state, touching)
    return _Run(container, system, bodies, R_NB, sensors)


def _add_joint_elements(system: Any, mechanism: Mechanism, state: State, at: _Step, coordinates: Coordinates) -> None:
    """Add the stops and the dry friction of a tree."""
    W = mobility(mechanism, state)

    def inertia(joint: str, coordinate: str) -> float:
        row, _ = coordinate_row(mechanism, state, joint, coordinate)
        return float(row @ W @ row)

    for limit in limits_of(mechanism):
        A = inertia(limit.joint, limit.coordinate)
        stiffness, damping = (at.stiffness, 0.0) if limit.restitution else (at.hardest, at.damping(at.hardest))
        ends, sign = coordinates(limit.joint, limit.coordinate)
        add_limit(system, Penalty(stiffness / A, damping / A, 0.0), ends, sign, limit)
    for dry in mechanism.dry_frictions:
        ends, _ = coordinates(dry.joint, dry.coordinate)
        bound = float(dry.bound or 0.0)
        zone = at.step * inertia(dry.joint, dry.coordinate) * bound / _REVERSES
        add_dry_friction(system, bound, zone, ends)


def _integrate(mechanism: Mechanism, run: _Run, times: Array, step: float) -> tuple[TrajectoryAnswer, Array]:
    """Integrate; return the motion, and the force of each elementary contact at every step, shape (steps + 1, n, 3)."""
    count = steps_per_sample(times, step)
    every = np.linspace(times[0], times[-1], count * (len(times) - 1) + 1)
    steps = solve(run.system, _RUNGE_KUTTA, times, step, step)
    series = [[stored(run.system, sensor, every)[::count] for sensor in four] for four in run.sensors]
    p, R, v, w = (np.stack([body[n] for body in series], axis=1) for n in range(4))
    require_stable(p, step)
    R_WB = R.reshape(*R.shape[:2], 3, 3) @ run.R_LB
    answer = TrajectoryAnswer(
        time=times.copy(),
        p_WB=p,
        quat_WB=continuous_in_time(quaternion_from_rotation(R_WB)),
        v_WB_W=v,
        w_WB_W=w,
        counters={"steps": steps},
    )
    forces = np.array([stored(run.system, sensor, every) for sensor in run.forces]).reshape(-1, len(every), 3)
    forces[:, 0] = forces[:, 1]  # before the first step Exudyn's contacts have no force
    return answer, forces.swapaxes(0, 1)
