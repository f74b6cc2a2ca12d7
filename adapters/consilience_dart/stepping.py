"""DART's own time stepping: `World.step`, semi-implicit Euler with constraints at velocity level.

A constraint of position error phi holds ``J v = -reduction phi / h``, with force mixing, a part of the diagonal of
``J M^-1 J^T``, that lets it yield. What the two leave behind depends on the question:

- at an instant, the first step from a consistent state holds ``J v = 0`` and drifts to ``phi = h^2 (dJ/dt v) / 2``;
  in the limit of small steps the second one then has ``J a = -(1 + reduction / 2) dJ/dt v``;
- along a trajectory the drift of h^2 a step settles at a phi in proportion to ``1 / reduction``;
- the mixing adds an error in the accelerations that no step removes, linear in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import dartpy
import numpy as np

from consilience.mechanism import Array, Mechanism, State
from consilience_dart.drives import command_steps
from consilience_dart.dynamics import apply_forces
from consilience_dart.loads import Forces, appliers
from consilience_dart.state import Coordinates, from_state, read, send
from consilience_dart.translation import Model, build

ERROR_REDUCTION_INSTANT = 0.0
"""Any other value, DART's default of 0.01 included, mixes the position error into the acceleration."""

ERROR_REDUCTION_TRAJECTORY = 0.5
"""Fraction of the position error removed in a step. The default of 0.01 lets welds drift over a hundred steps, which
spoils the order (1.0 becomes 1.1 to 1.8) and locks overconstrained loops; 0.1 to 1 give one and the same motion."""

ERROR_REDUCTION_DEFAULT = 0.01

CONSTRAINT_FORCE_MIXING = 1e-9
"""DART's default, and the least it accepts."""

MIXINGS = ((1, 8.0 / 3.0), (2, -2.0), (4, 1.0 / 3.0))
"""Factors on the force mixing, and weights that extrapolate to none: near singular poses its error is quadratic."""

STEP_SIZES = (1, 2, 4, 8)
LARGEST_STEP = 1e-4
LARGEST_ROTATION = 5e-4
"""Rotation per step in rad: below about 1e-3 DART's exponential map is one truncated series, which is smooth in the
step, so that extrapolation removes its error; across the threshold it is not."""

LARGEST_TURN = 1e-3
"""The same for any link, massless ones too: near the singular pose of a rod's two angles these turn tens of times
faster than any body, and what extrapolation leaves grows with the fourth power of their turn in a step."""


@dataclass(eq=False)
class Stepper:
    """A world with one skeleton in it, ready to step.

    Attributes
    ----------
    time : float, s
    reduction : float
        Part of the position error of a drive that is removed in a step.
    """

    model: Model
    world: Any
    appliers: Forces
    time: float = 0.0
    reduction: float = 0.0

    def restart(self, c: Coordinates, time: float, step: float) -> None:
        """Set state, time and step; the controllers forget."""
        send(self.model, c)
        self.world.setTimeStep(step)
        self.time = time
        self.appliers.integrals[:] = 0.0

    def step(self, count: int) -> None:
        """Take `count` steps; external forces and integrands are those of the beginning of each step."""
        if not self.appliers and not self.model.mechanism.drives:
            for _ in range(count):
                self.world.step()
            return
        h, start = self.world.getTimeStep(), self.time
        for n in range(count):
            apply_forces(self.model, self.appliers, self.time)
            command_steps(self.model, self.time, h, self.reduction)
            errors = self.appliers.errors(self.time)
            self.world.step()
            self.appliers.integrals += h * errors
            self.time = start + (n + 1) * h


def set_softness(reduction: float, mixing: float) -> None:
    """Set DART's error reduction and force mixing: one pair of numbers for all constraints of the process."""
    dartpy.constraint.WeldJointConstraint.setErrorReductionParameter(reduction)
    dartpy.constraint.WeldJointConstraint.setConstraintForceMixing(mixing)


def stepper(mechanism: Mechanism, start: State, sleeping: bool = False) -> Stepper:
    """Build a world at a consistent state, whose poses give the welds of split bodies their anchors.

    Parameters
    ----------
    sleeping : bool
        Whether slow bodies may be put to sleep, as is DART's default.
    """
    model = build(mechanism)
    world = dartpy.simulation.World()
    world.addSkeleton(model.skeleton)
    world.setGravity(mechanism.gravity)  # after addSkeleton, which overwrites the skeleton's with the world's
    options = world.getDeactivationOptions()  # a copy
    options.mEnabled = sleeping
    world.setDeactivationOptions(options)
    send(model, from_state(model, start))
    for weld in model.tree.welds:
        constraint = dartpy.constraint.WeldJointConstraint(model.nodes[weld.original], model.nodes[weld.copy])
        world.getConstraintSolver().addConstraint(constraint)
    return Stepper(model, world, appliers(model))


def native_trajectory(stepping: Stepper, times: Array, substeps: int) -> tuple[list[Array], int]:
    """Positions, quaternions, velocities and angular velocities at `times` by `World.step`, and the steps taken."""
    stepping.world.setTimeStep((times[1] - times[0]) / substeps)
    stepping.time, stepping.reduction = float(times[0]), ERROR_REDUCTION_TRAJECTORY
    samples = [read(stepping.model)]
    for time in times[1:]:
        stepping.step(substeps)
        stepping.time = float(time)
        samples.append(read(stepping.model))
    return [np.array(column) for column in zip(*samples, strict=True)], substeps * (len(times) - 1)


def _difference_quotient(stepping: Stepper, c: Coordinates, step: float) -> Array:
    """``(v2 - v1) / h``: the first step only brings the velocities into line and knows nothing of ``Jdot v``."""
    stepping.restart(c, 0.0, step)
    stepping.step(1)
    before = np.array(stepping.model.skeleton.getVelocities())
    stepping.step(1)
    return np.asarray((stepping.model.skeleton.getVelocities() - before) / step)


def _to_zero_step(stepping: Stepper, c: Coordinates, step: float) -> Array:
    """Extrapolate the difference quotient polynomially to step zero (Richardson; Neville's scheme)."""
    column = [_difference_quotient(stepping, c, step / n) for n in STEP_SIZES]
    for width in range(1, len(column)):
        column = [
            column[k + 1] + (column[k + 1] - column[k]) / (STEP_SIZES[k + width] / STEP_SIZES[k] - 1.0)
            for k in range(len(column) - 1)
        ]
    return column[0]


def _largest_step(model: Model, state: State) -> float:
    """Step in s that extrapolation starts from, for the state that the skeleton is in."""
    of_bodies = float(np.max(np.abs(state.w_WB_W)))
    of_links = max(float(np.max(np.abs(node.getAngularVelocity()))) for node in model.nodes)
    rates = max(2.0 * of_bodies / LARGEST_ROTATION, of_links / LARGEST_TURN)
    return LARGEST_STEP / max(1.0, LARGEST_STEP * rates)


def zero_step_accelerations(stepping: Stepper, c: Coordinates, state: State) -> Array:
    """Generalised accelerations by the difference quotient, extrapolated to zero step.

    The skeleton is left at the state, with these accelerations.
    """
    send(stepping.model, c)
    a = _to_zero_step(stepping, c, _largest_step(stepping.model, state))
    send(stepping.model, c)
    stepping.model.skeleton.setAccelerations(a)
    return a


def extrapolated_accelerations(stepping: Stepper, c: Coordinates, state: State) -> Array:
    """Generalised accelerations from DART's constraint solver, extrapolated to zero step and zero force mixing.

    The skeleton is left at the state, with these accelerations.
    """
    a = np.zeros(stepping.model.skeleton.getNumDofs())
    for factor, weight in MIXINGS:
        set_softness(ERROR_REDUCTION_INSTANT, factor * CONSTRAINT_FORCE_MIXING)
        a += weight * zero_step_accelerations(stepping, c, state)
    stepping.model.skeleton.setAccelerations(a)
    return a
