"""Motions with contacts, stops and dry friction by Exudyn's explicit Runge-Kutta method of order four.

Explicit integrators take no constraints: bodies are free, or links of a kinematic tree. The numbers of contacts follow
the step (`contact_numbers`). Below its zone friction is stiff, beyond a bound of the normal force the method unstable:
the motion is repeated with a larger bound. What seems to hit a contact that rests may be its damping, where the contact
sees less inertia as its body turns: the motion is repeated with numbers for any attitude first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from consilience.engine import TrajectoryAnswer, require_stable, steps_per_sample
from consilience.mechanism import Array, Mechanism, State, continuous_in_time, quaternion_from_rotation
from consilience_exudyn.contact_numbers import (
    LINEAR,
    RIGID,
    Step,
    contacts_at_start,
    late_hits,
    penalties_of,
    refuse_chain,
    refuse_late_hits,
)
from consilience_exudyn.contact_rows import coordinate_row, mobility
from consilience_exudyn.contact_samples import refuse_gain, room_ahead, room_taken, with_contacts
from consilience_exudyn.contacts import Penalty, add_contact, add_dry_friction, add_limit, limits_of, parts_of
from consilience_exudyn.free_bodies import KEEP, add_free_bodies
from consilience_exudyn.kinematic_tree import Coordinates, build_tree, is_one_axis_tree
from consilience_exudyn.library import CONTACT_SETTINGS, exu, items
from consilience_exudyn.trajectory import Integration, solve, stored

_STABLE = 2.0
"""Normal force over its bound up to which friction below the zone is stable."""

_REVERSES = 0.5
"""Rate of dry friction below its zone, times the step: what reverses within one step errs by the step's phase."""

_ATTEMPTS = 6
"""Motions with larger bounds of normal forces."""

_RUNGE_KUTTA = Integration("RK44", CONTACT_SETTINGS)


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
    mechanism, state, times, step, softness : see `Step`

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
    return _bounded_motion(mechanism, state, times, Step(step, rigid, softness, room), ())[0]


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
    motion, bounds = _bounded_motion(mechanism, state, times, Step(step, RIGID / step**2, None, room), ())
    room, motions = room_taken(mechanism, motion), [motion]
    for n in range(1, count):
        h = step / 2.0**n
        motion, bounds = _bounded_motion(mechanism, state, times, Step(h, RIGID / h**2, None, room), bounds)
        motions.append(motion)
    return motions


def _bounded_motion(
    mechanism: Mechanism, state: State, times: Array, at: Step, least: Sequence[float]
) -> tuple[TrajectoryAnswer, list[float]]:
    """Return a motion and the bounds of its normal forces, which are no less than `least`, if that is known."""
    seen, turning = contacts_at_start(mechanism, state), False
    refuse_chain(seen)
    bounds = [max(one.bound(at), known) for one, known in zip(seen, least or [0.0] * len(seen), strict=True)]
    for _ in range(_ATTEMPTS):
        penalties = penalties_of(seen, bounds, at)
        run = _assemble(mechanism, state, at, penalties)
        try:
            answer, forces = _integrate(mechanism, run, times, at.step)
        except FloatingPointError:  # friction below its zone is unstable far above its bound
            bounds = [2.0 * bound for bound in bounds]
            continue
        largest = np.max(np.linalg.norm(forces, axis=2), axis=0, initial=0.0)
        if np.all(largest <= _STABLE * np.array(bounds)):
            refuse_gain(mechanism, answer)
            return with_contacts(mechanism, answer, forces, penalties, 1.0 / (at.step * np.sqrt(at.stiffness))), bounds
        hits = late_hits(seen, largest)
        if hits and not turning:
            seen, turning = contacts_at_start(mechanism, state, turning=True), True
            continue
        refuse_late_hits(hits)
        bounds = [max(b, 1.2 * f) for b, f in zip(bounds, largest, strict=True)]
    raise RuntimeError(
        f"forces exceed {max(bounds):.3g} N, or the motion diverges: steps of {at.step:g} s are too long"
    )


def _assemble(mechanism: Mechanism, state: State, at: Step, penalties: Sequence[Penalty]) -> _Run:
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


def _add_joint_elements(system: Any, mechanism: Mechanism, state: State, at: Step, coordinates: Coordinates) -> None:
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
