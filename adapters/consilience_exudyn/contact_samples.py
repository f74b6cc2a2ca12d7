"""Gaps, impulses and modes of contacts at the samples of a motion, and the room that it takes on planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from consilience.engine import CannotRepresent, TrajectoryAnswer, joined_mode, over_parts
from consilience.mechanism import (
    GROUND,
    Array,
    Mechanism,
    State,
    characteristic_length,
    kinetic_energy,
    nearest_points,
    potential_energy,
)
from consilience_exudyn.contact_rows import contact_row
from consilience_exudyn.contacts import Penalty, parts_of

_IMPACT = 4.0 * np.pi
"""Longest impact in radians of its spring: four half periods, as what is hit may be heavier than it seemed."""

_GAIN = 0.1
"""Energy that a motion may gain by its errors, over that of its start and what gravity and springs give."""

_OPENING = 1.98
"""Angle between forces that slide in opposite directions, over the half angle of the friction cone; exactly 2."""


def room_ahead(mechanism: Mechanism, state: State, duration: float) -> float:
    """Longest way on a plane in m, at the velocities of the start and twice the acceleration of gravity."""
    size = characteristic_length(mechanism)
    fastest = np.max(np.abs(state.v_WB_W)) + size * np.max(np.abs(state.w_WB_W))
    return float(size + duration * (fastest + duration * np.linalg.norm(mechanism.gravity)))


def room_taken(mechanism: Mechanism, answer: TrajectoryAnswer) -> float:
    """Way on planes in a motion, m, and a quarter more: overlaps have the rounding of their triangle's corners."""
    ways = {GROUND: 0.0}
    for name, n in mechanism.body_index.items():
        ways[name] = float(np.max(np.linalg.norm(answer.p_WB[:, n] - answer.p_WB[0, n], axis=1)))
    apart = max((ways[c.body] + ways[c.partner] for c in mechanism.contacts), default=0.0)
    return 1.25 * (2.0 * characteristic_length(mechanism) + apart)


def gaps_of(mechanism: Mechanism, answer: TrajectoryAnswer) -> Array:
    """Gaps of all elementary contacts at all samples, shape (n_t, n), m."""
    states = [answer.state(n) for n in range(len(answer.time))]
    parts = parts_of(mechanism)
    gaps = [nearest_points(mechanism, state, part).gap for state in states for _, part in parts]
    return np.array(gaps).reshape(len(states), len(parts))


def refuse_fall(mechanism: Mechanism, gaps: Array, penalties: Sequence[Penalty]) -> None:
    """Refuse a motion in which the sphere of a contact is deeper than its radius at a sample.

    Raises
    ------
    CannotRepresent
    """
    for deepest, (_, part), penalty in zip(gaps.min(axis=0, initial=0.0), parts_of(mechanism), penalties, strict=True):
        if deepest < -(part.radius or penalty.radius):
            raise CannotRepresent(
                f"contact '{part.name}', which hits harder than expected at the start",
                "Exudyn lets a sphere through that is deeper than its radius",
            )


def refuse_gain(mechanism: Mechanism, answer: TrajectoryAnswer) -> None:
    """Refuse a motion that gains energy where nothing can give any.

    Raises
    ------
    RuntimeError
    """
    m = mechanism
    actuators = [s.actuator for s in m.springs] + [s.actuator for s in m.joint_springs]
    if m.loads or m.drives or m.controls or any(actuators):
        return
    states = [answer.state(n) for n in range(len(answer.time))]
    kinetic, potential = (np.array([of(m, s) for s in states]) for of in (kinetic_energy, potential_energy))
    gain = np.max(kinetic + potential) - kinetic[0] - potential[0]
    if gain > _GAIN * (kinetic[0] + np.ptp(potential)):
        raise RuntimeError(f"the motion gains {gain:.3g} J from nothing: the steps are too long")


def refuse_reversal(mechanism: Mechanism, forces: Array, longest: int) -> None:
    """Refuse a motion in which friction at its bound changes sides within an impact of at most `longest` steps.

    Forces that slide in opposite directions are apart by the opening of the friction cone.

    Raises
    ------
    CannotRepresent
    """
    for n, (_, part) in enumerate(parts_of(mechanism)):
        if not (part.friction > 0.0 and part.restitution > 0.0):
            continue
        sizes = np.linalg.norm(forces[:, n], axis=1)
        ends = np.flatnonzero(np.diff(np.concatenate([[0], sizes > 0.0, [0]])))
        for first, last in ends.reshape(-1, 2):
            along = forces[first:last, n] / sizes[first:last, None]
            if last - first <= longest and np.min(along @ along[0]) < np.cos(_OPENING * np.arctan(part.friction)):
                raise CannotRepresent(
                    f"contact '{part.name}', whose slip reverses within an impact",
                    "friction follows the slip, and the rebound is then that of Exudyn's damper, not Newton's",
                )


def with_contacts(
    mechanism: Mechanism, answer: TrajectoryAnswer, forces: Array, penalties: Sequence[Penalty], radian: float
) -> TrajectoryAnswer:
    """Return a motion with gaps, impulses and modes of contacts.

    Parameters
    ----------
    mechanism : Mechanism
    answer : TrajectoryAnswer
    forces : ndarray, shape (steps + 1, n, 3), N
        At all steps.
    penalties : sequence of Penalty
    radian : float
        Root of the inertia over the stiffness of what hits, in steps.

    Raises
    ------
    CannotRepresent
        A sphere is deeper than its radius, or a slip reverses within an impact.
    """
    if not mechanism.contacts:
        return answer
    gaps = gaps_of(mechanism, answer)
    refuse_fall(mechanism, gaps, penalties)
    refuse_reversal(mechanism, forces, int(_IMPACT * radian))
    states = [answer.state(n) for n in range(len(answer.time))]
    count = (len(forces) - 1) // (len(states) - 1)
    step = (answer.time[1] - answer.time[0]) / count
    trapezoids = 0.5 * step * (forces[1:] + forces[:-1])
    impulses = trapezoids.reshape(-1, count, *forces.shape[1:]).sum(axis=1)
    impulses = np.concatenate([np.zeros((1, *forces.shape[1:])), impulses])
    modes = [_modes(mechanism, state, now, penalties) for state, now in zip(states, forces[::count], strict=True)]
    return replace(
        answer,
        contact_gap=over_parts(mechanism, gaps, lambda parts: np.asarray(parts.min(axis=1))),
        contact_impulse=over_parts(mechanism, impulses, lambda parts: np.asarray(parts.sum(axis=1))),
        contact_mode=over_parts(mechanism, np.array(modes), joined_mode),
    )


def _modes(mechanism: Mechanism, state: State, forces: Array, penalties: Sequence[Penalty]) -> Array:
    """Modes of elementary contacts: one that slips by more than its zone slides."""
    modes = np.zeros(len(forces), dtype=int)
    for n, ((number, part), penalty) in enumerate(zip(parts_of(mechanism), penalties, strict=True)):
        if np.any(forces[n]):
            slip = np.linalg.norm(contact_row(mechanism, state, part, number).slip)
            modes[n] = 1 if slip >= penalty.zone else 2
    return modes
