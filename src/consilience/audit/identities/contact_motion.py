"""Identities of contact along a motion: overlap, normal power, impulses within the cone, energy.

Residuals of the finest levels are extrapolated to step zero as those of constraints are, with order one, which is what
impacts leave of any integrator [Acary and Brogliato 2008, chapter 8]: a residual that smaller steps cure is none. Nor
is one that vanishes with the softness of an engine's contacts: the finest level is asked again, twice as soft.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from consilience.audit.identities.asking import Asker
from consilience.audit.identities.contact import ContactAtState, gauge, most_friction
from consilience.audit.identities.equations import Equations, largest
from consilience.audit.identities.motion import SAFETY, limit_of_levels
from consilience.audit.identities.result import NotApplicableError, Residual, UnansweredError
from consilience.engine import CONTACT_MODES, Method, TrajectoryAnswer, determinate_impulses
from consilience.mechanism import GROUND, Array, Mechanism, SphereSphere, State, kinetic_energy, potential_energy

ROUNDING = 1e-9
"""Residual of motions, relative to their size, that counts as rounding: events are located to 1e-11 of it."""

_SEPARATED = CONTACT_MODES.index("separated")

_Levels = Callable[[Mechanism, TrajectoryAnswer], Array]


def _contact_samples(mechanism: Mechanism, answer: TrajectoryAnswer) -> list[list[ContactAtState]]:
    """Return every contact at every sample."""
    states = [answer.state(k) for k in range(len(answer.time))]
    return [[ContactAtState(mechanism, state, contact) for contact in mechanism.contacts] for state in states]


def _mass(mechanism: Mechanism) -> float:
    return sum(body.mass for body in mechanism.bodies)


def _fall(mechanism: Mechanism, answer: TrajectoryAnswer) -> float:
    """Return the speed that the applied forces of the start give all mass together in a sample interval, m/s."""
    forces = Equations(mechanism, answer.state(0)).size_b.reshape(-1, 6)[:, 0]
    return float(np.sum(forces) * (answer.time[1] - answer.time[0])) / _mass(mechanism)


def _speed(mechanism: Mechanism, answer: TrajectoryAnswer) -> float:
    """Return the largest speed, or `_fall` where it is larger, as of what rests: its speeds are rounding."""
    largest = max(Equations(mechanism, answer.state(k)).speed for k in range(len(answer.time)))
    return max(largest, _fall(mechanism, answer)) or 1.0


def overlap(mechanism: Mechanism, answer: TrajectoryAnswer) -> Array:
    """Return how far shapes overlap at samples, in characteristic lengths, by the poses: ``g >= 0``."""
    _require_rigid(mechanism)
    length = Equations(mechanism, answer.state(0)).length
    gaps = np.array([[here.gap for here in row] for row in _contact_samples(mechanism, answer)])
    return np.maximum(0.0, -gaps) / length


def normal_power(mechanism: Mechanism, answer: TrajectoryAnswer) -> Array:
    """Return ``u_n`` of contacts that last, over `_speed`: normal forces take no power there.

    A contact lasts at a sample where it is closed at the samples beside it as well.
    """
    _require_rigid(mechanism)
    modes = _given(answer.contact_mode, "modes")
    closed = modes != _SEPARATED
    lasting = closed.copy()
    lasting[1:-1] &= closed[:-2] & closed[2:]
    lasting[[0, -1]] = False
    found = np.zeros(modes.shape)
    samples = _contact_samples(mechanism, answer)
    for k, c in zip(*np.nonzero(lasting), strict=True):
        here = samples[k][c]
        near = min(range(len(here.near)), key=lambda part, here=here: here.near[part].gap)  # type: ignore[misc]
        found[k, c] = abs(here.velocities[near] @ here.near[near].normal)
    return found / _speed(mechanism, answer)


def impulse_cone(mechanism: Mechanism, answer: TrajectoryAnswer) -> Array:
    """Return by how much impulses since the sample before pull or exceed the cone, over that of the weight.

    The cone is convex: where its normal is at rest, sums of forces and impulses are within it. Forces that equilibrium
    leaves open tell nothing.
    """
    impulses, dt = _given(answer.contact_impulse, "impulses"), float(answer.time[1] - answer.time[0])
    fixed = [c for c, k in enumerate(mechanism.contacts) if not isinstance(k, SphereSphere) and k.partner == GROUND]
    if not fixed:
        raise NotApplicableError("no contact has a normal at rest")
    start = [ContactAtState(mechanism, answer.state(0), mechanism.contacts[c]) for c in fixed]
    size = float(np.max(Equations(mechanism, answer.state(0)).solution.terms)) * dt
    told = np.asarray(determinate_impulses(mechanism, answer).contacts.all(axis=2))
    if not np.any(told[1:, fixed]):
        raise NotApplicableError("equilibrium leaves the forces of all contacts open")
    found = []
    for c, here in zip(fixed, start, strict=True):
        N = impulses[:, c] @ here.normal
        beyond = gauge(here.contact.cone, np.array([here.friction(p) for p in impulses[:, c]]))
        beyond = beyond - most_friction(here.contact) * np.maximum(N, 0.0)
        found += [told[:, c] * np.maximum(0.0, values) for values in (-N, beyond)]
    return np.array(found) / (size or 1.0)


def energy_growth(mechanism: Mechanism, answer: TrajectoryAnswer) -> Array:
    """Return by how much the energy grows from sample to sample, over the largest kinetic energy and its changes.

    Of what rests, over the kinetic energy of `_fall`.
    """
    m = mechanism
    acting = [drive.name for drive in m.drives] + [control.name for control in m.controls]
    acting += [x.name for x in m.loads if x.kind != "force" or x.frame != "world" or x.history is not None]
    acting += [x.name for x in m.springs if x.actuator is not None]
    acting += [x.name for x in m.joint_springs if x.actuator is not None]
    acting += [x.name for x in m.contacts if x.compliance is not None]
    if acting:
        raise NotApplicableError(f"'{acting[0]}' may do work, or keep energy that is not counted")
    states = [answer.state(k) for k in range(len(answer.time))]
    kinetic, potential = (np.array([energy(m, s) for s in states]) for energy in (kinetic_energy, potential_energy))
    least = _mass(mechanism) * _fall(mechanism, answer) ** 2 / 2.0
    size = max(float(np.max(kinetic) + np.ptp(potential)), least) or 1.0
    return np.maximum(0.0, np.diff(kinetic + potential)) / size


def _given(values: Array | None, what: str) -> Array:
    if values is None:
        raise NotApplicableError(f"the method gives no {what} of contacts")
    return values


def _require_rigid(mechanism: Mechanism) -> None:
    if not mechanism.contacts:
        raise NotApplicableError("there are no contacts")
    if any(c.compliance is not None for c in mechanism.contacts):
        raise NotApplicableError("a compliant contact overlaps while it pushes")


MOTION_RESIDUALS: dict[str, _Levels] = {
    "no overlap": overlap,
    "no power of the normal force": normal_power,
    "impulses within the cone": impulse_cone,
    "energy never grows": energy_growth,
}


def measure_contact_motion(
    asker: Asker, mechanism: Mechanism, start: State, times: Array, method: Method
) -> list[Residual | NotApplicableError | UnansweredError]:
    """Integrate at the finest levels and return the residual of each of `MOTION_RESIDUALS`, or why there is none.

    Parameters are those of `motion.measure_drift`.
    """
    sample = float(times[1] - times[0])
    steps = ([sample / n for n in method.substeps] or list(method.tolerances))[-3:]  # the finest, coarse to fine
    answers = [asker.trajectory(mechanism, start, times, method, step) for step in steps]
    if method.softness is not None:
        softer = replace(method, softness=2.0 * method.softness)
        answers.append(asker.trajectory(mechanism, start, times, softer, steps[-1]))
    return [_limit(measure, mechanism, answers, steps) for measure in MOTION_RESIDUALS.values()]


def _limit(
    measure: _Levels, mechanism: Mechanism, answers: Sequence[TrajectoryAnswer], steps: Sequence[float]
) -> Residual | NotApplicableError:
    """Extrapolate to step zero; `answers` are those of the steps, and a softer one at the finest where there is any."""
    try:
        found = [measure(mechanism, answer) for answer in answers]
    except NotApplicableError as reason:
        return reason
    levels, guard = found[: len(steps)], ROUNDING
    for softer in found[len(steps) :]:
        shift = softer - levels[-1]
        levels, guard = [level - shift for level in levels], guard + SAFETY[1] * largest(shift)
    # an event comes anywhere within a step: the spread of the levels tells their error, not a ratio of differences
    spread = max((largest(fine - rough) for rough, fine in pairwise(levels)), default=0.0)
    return limit_of_levels(levels, steps, 1, guard + SAFETY[1] * spread)
