"""Energy of a motion with contacts: what it has lost at a sample is what contacts, stops and dry frictions have lost.

Laws of contact can hold at all samples of a motion that has lost energy between them. Where all else is conservative,

    T + V + loss = constant,

with the potential energy V of gravity, springs and constant forces. Loss is integrated from the forces of rows and
their rates, and the energy comes from the states.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.errors import NumericalFailure
from consilience.mechanism import (
    Array,
    Mechanism,
    kinetic_energies,
    load_potentials,
    potential_energies,
    rotation_from_quaternion,
)
from consilience.mechanism.observables import SampledMotion
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.samples import Samples

PER_STEP = 30.0
"""Energy that a step may make or lose, over the tolerance and the size of the energies.

A step leaves coordinates, speeds and the loss open by the tolerance: with the energies that go with them, by less than
one in all shipped cases and random mechanisms.
"""

LEAST = 1e-9
"""The same of a whole motion, over the size of the energies: above what rounding and projections do."""

ROUNDING = 1e-12
"""The same, over the potential energy: its zero may be far away."""


def is_conservative(mechanism: Mechanism) -> bool:
    """Return whether all but contacts, stops and dry frictions keeps energy, and has it in its potential energy."""
    return not (
        mechanism.drives
        or mechanism.controls
        or mechanism.frictions
        or any(x.damping or x.actuator is not None for x in mechanism.springs)
        or any(x.damping or any(x.higher[2:]) or x.actuator is not None for x in mechanism.joint_springs)
        or any(x.kind != "force" or x.frame != "world" or x.history is not None for x in mechanism.loads)
    )


def refuse_lost_energy(
    equations: ContactEquations, answer: TrajectoryAnswer, samples: Samples, speed: float, tolerance: float
) -> None:
    """Refuse a motion that gains or loses energy apart from that which contacts, stops and dry frictions lose.

    Parameters
    ----------
    equations : ContactEquations
    answer : TrajectoryAnswer
    samples : Samples
        Of the same motion.
    speed : float, m/s
        Largest speed of the motion.
    tolerance : float
        Bound on the scaled local error of a step.

    Raises
    ------
    NumericalFailure
        With the first time, and the amount.
    """
    mechanism = equations.layout.mechanism
    if not is_conservative(mechanism):
        return
    states, turns, spent = samples.spent()
    motion = SampledMotion(answer.p_WB, rotation_from_quaternion(answer.quat_WB), answer.v_WB_W, answer.w_WB_W)
    kinetic = kinetic_energies(mechanism, motion)
    potential = potential_energies(mechanism, motion, _of_springs(equations, states, turns))
    potential += load_potentials(mechanism, motion)
    change = kinetic + potential + spent
    change -= change[0]
    size = float(np.max(kinetic) + np.ptp(potential) + np.sum(equations.model.mass) * speed**2)
    bar = size * (LEAST + PER_STEP * tolerance * answer.counters["steps"]) + ROUNDING * np.max(np.abs(potential))
    beyond = np.flatnonzero(~(np.abs(change) <= bar))
    if len(beyond):
        k = beyond[0]
        raise NumericalFailure(
            f"energy, t = {answer.time[k]:.12g} s: it has changed by {change[k]:.6g} J since the start, "
            f"besides what contacts, stops and dry frictions have lost; {bar:.1g} J would be errors of steps"
        )


def _of_springs(equations: ContactEquations, states: Array, turns: Array) -> Array:
    """Return the coordinates of the joint springs, full turns counted, shape (n_joint_springs, n)."""
    springs = len(equations.layout.mechanism.joint_springs)
    found = turns.copy()
    for y, q in zip(states, found, strict=True) if springs else ():
        equations.follow(y, q)
    return np.asarray(found[:, equations.model.joint_spring["coordinate"][:springs]].T)
