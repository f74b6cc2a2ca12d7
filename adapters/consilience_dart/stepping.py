"""DART's own time stepping: `World.step`, semi-implicit Euler with constraints at velocity level.

A constraint of position error phi holds ``J v = -reduction phi / h``. Force mixing, a part of the diagonal of
``J M^-1 J^T``, softens the constraint. The errors of both depend on the question:

- at an instant, the first step from a consistent state holds ``J v = 0`` and drifts to ``phi = h^2 (dJ/dt v) / 2``;
  in the limit of small steps the second step then has ``J a = -(1 + reduction / 2) dJ/dt v``;
- along a trajectory, the drift of h^2 in each step settles at a phi in proportion to ``1 / reduction``;
- force mixing adds an error of the accelerations that is linear in the mixing and independent of the step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import dartpy
import numpy as np

from consilience.mechanism import Array, Mechanism, State
from consilience_dart.contacts import Touching
from consilience_dart.drives import command_steps
from consilience_dart.limits import set_limits
from consilience_dart.loads import Forces
from consilience_dart.small_turns import mend_rotations
from consilience_dart.state import Coordinates, from_state, read, send
from consilience_dart.translation import Model, build

ERROR_REDUCTION_INSTANT = 0.0
"""Any other value, such as DART's default of 0.01, adds a part of the position error to the acceleration."""

ERROR_REDUCTION_TRAJECTORY = 0.5
"""Fraction of the position error removed in a step. With the default of 0.01 welds drift over a hundred steps, which
spoils the order (1.0 becomes 1.1 to 1.8) and locks overconstrained loops. Values from 0.1 to 1 give the same motion."""

ERROR_REDUCTION_DEFAULT = 0.01

CONSTRAINT_FORCE_MIXING = 1e-9
"""DART's default, and the smallest value that DART accepts."""

MIXINGS = ((1, 8.0 / 3.0), (2, -2.0), (4, 1.0 / 3.0))
"""Factors on the force mixing, with the weights of the extrapolation to zero mixing.

Three of them, because near singular poses the error is quadratic in the mixing."""

LARGEST_STEP = 5e-3
HALVINGS = 15
"""The smallest step is far below the time constants of stiff dampers, which `World.step` treats implicitly."""

CONVERGED = 1e-9
"""Relative change of an extrapolated value below which smaller steps are tried only while they change it less."""

LARGEST_ROTATION = 5e-4
"""Rotation of a body in two steps, rad. Below about 1e-3 rad DART's exponential map is a truncated series: smooth in
the step, so that extrapolation removes the error. Steps on both sides of the threshold cannot be extrapolated."""

LARGEST_TURN = 1e-3
"""Rotation of a link in a step, rad. Near the singular pose of a rod's two angles massless links turn tens of times
faster than bodies, and the error of the extrapolation grows with the fourth power of their rotation in a step."""


@dataclass(eq=False)
class Stepper:
    """World with one skeleton, ready to step.

    Attributes
    ----------
    model : Model
    world : dartpy World
    forces : Forces
    time : float, s
    reduction : float
        Part of the position error of a drive that a step removes.
    touching : Touching or None
        Contacts; None if the mechanism has none.
    mended : bool
        Take from small rotations what DART's truncated exponential map adds, and keep in touch what presses.
    ahead : ndarray, shape (n,), or None
        Velocities over the step that a restart adds.
    """

    model: Model
    world: Any
    forces: Forces
    time: float = 0.0
    reduction: float = 0.0
    touching: Touching | None = None
    mended: bool = False
    ahead: Array | None = None

    def restart(self, c: Coordinates, time: float, step: float) -> None:
        """Set state, time and step, and the integrals of controllers to zero."""
        send(self.model, c)
        if self.ahead is not None:
            self.model.skeleton.setVelocities(c.v + step * self.ahead)
        self.world.setTimeStep(step)
        self.time = time
        self.forces.integrals[:] = 0.0
        if self.touching:
            self.touching.restart()

    def _advance(self, prepare: Callable[[], None] = lambda: None) -> None:
        """Take a step; `prepare` sets loads and commands, which DART forgets after a step."""
        skeleton = self.model.skeleton
        before, velocities = skeleton.getPositions(), skeleton.getVelocities()
        prepare()
        self.world.step()
        for _ in self.touching.repetitions() if self.touching else ():
            skeleton.setPositions(before)
            skeleton.setVelocities(velocities)
            prepare()
            self.world.step()
        if self.mended:
            mend_rotations(self.model, before)
        if self.touching:
            self.touching.add(self.world.getTimeStep())
            if self.mended:
                self.touching.keep_pressing()

    def step(self, count: int) -> None:
        """Take `count` steps, with external forces and integrands of the beginning of each step."""
        if not self.forces and not self.model.mechanism.drives:
            for _ in range(count):
                self._advance()
            return
        h, start = self.world.getTimeStep(), self.time

        def prepare() -> None:
            self.forces.apply(self.time)
            command_steps(self.model, self.time, h, self.reduction)

        for n in range(count):
            errors = self.forces.errors(self.time)
            self._advance(prepare)
            self.forces.integrals += h * errors
            self.time = start + (n + 1) * h


def set_softness(reduction: float, mixing: float) -> None:
    """Set DART's error reduction and force mixing, which all constraints of the process share."""
    dartpy.constraint.WeldJointConstraint.setErrorReductionParameter(reduction)
    dartpy.constraint.WeldJointConstraint.setConstraintForceMixing(mixing)


def stepper(mechanism: Mechanism, start: State, sleeping: bool = False, cones: bool = True) -> Stepper:
    """Build a world at a consistent state, in whose poses the welds of split bodies are anchored.

    Parameters
    ----------
    mechanism : Mechanism
    start : State
    sleeping : bool
        DART may put slow bodies to sleep, which is its default.
    cones : bool
        Solve for friction on circular cones; DART's default is a box.
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
    set_limits(model)
    unilateral = mechanism.contacts or mechanism.stops or mechanism.dry_frictions
    touching = Touching(model, world, cones) if unilateral else None
    return Stepper(model, world, Forces(model), touching=touching)


def native_trajectory(stepping: Stepper, times: Array, substeps: int) -> tuple[list[Array], int]:
    """Integrate by `World.step`; return positions, quaternions, velocities, angular velocities, and the step count."""
    stepping.world.setTimeStep((times[1] - times[0]) / substeps)
    stepping.time, stepping.reduction = float(times[0]), ERROR_REDUCTION_TRAJECTORY
    samples = [read(stepping.model)]
    for time in times[1:]:
        stepping.step(substeps)
        stepping.time = float(time)
        samples.append(read(stepping.model))
    return [np.array(column) for column in zip(*samples, strict=True)], substeps * (len(times) - 1)


def _difference_quotient(stepping: Stepper, c: Coordinates, step: float) -> Array:
    """``(v2 - v1) / h`` of two steps: the first step projects the velocities and ignores ``Jdot v``."""
    stepping.restart(c, 0.0, step)
    stepping.step(1)
    before = np.array(stepping.model.skeleton.getVelocities())
    stepping.step(1)
    return np.asarray((stepping.model.skeleton.getVelocities() - before) / step)


def _to_zero_step(stepping: Stepper, c: Coordinates, step: float) -> Array:
    """Extrapolate the difference quotient polynomially to step zero, and return the entry that changes least.

    In Neville's scheme steps that are too large for a stiff damper, and steps so small that rounding counts, change
    the entries [Ridders, Adv. Eng. Software 4 (1982) 75].
    """
    best, change, before = np.zeros(0), np.inf, list[Array]()
    for n in range(HALVINGS + 1):
        row, least = [_difference_quotient(stepping, c, step / 2.0**n)], change
        for width, last in enumerate(before, 1):
            row.append(row[-1] + (row[-1] - last) / (2.0**width - 1.0))
            new = max(np.max(np.abs(row[-1] - other)) for other in (row[-2], last))
            if new < change:
                best, change = row[-1], new
        if change == least and change < CONVERGED * np.max(np.abs(best), initial=0.0):
            break
        before = row
    return best


def _largest_step(model: Model, state: State) -> float:
    """Largest step of the extrapolation in s, for the present state of the skeleton."""
    of_bodies = float(np.max(np.abs(state.w_WB_W)))
    of_links = max(float(np.max(np.abs(node.getAngularVelocity()))) for node in model.nodes)
    rates = max(2.0 * of_bodies / LARGEST_ROTATION, of_links / LARGEST_TURN)
    return LARGEST_STEP / max(1.0, LARGEST_STEP * rates)


def zero_step_accelerations(stepping: Stepper, c: Coordinates, state: State) -> Array:
    """Compute generalised accelerations by the difference quotient, extrapolated to zero step.

    The skeleton is left at the state, with these accelerations.
    """
    send(stepping.model, c)
    a = _to_zero_step(stepping, c, _largest_step(stepping.model, state))
    send(stepping.model, c)
    stepping.model.skeleton.setAccelerations(a)
    return a


def extrapolated_accelerations(stepping: Stepper, c: Coordinates, state: State) -> Array:
    """Compute generalised accelerations by DART's constraint solver, extrapolated to zero step and zero force mixing.

    The skeleton is left at the state, with these accelerations.
    """
    a = np.zeros(stepping.model.skeleton.getNumDofs())
    for factor, weight in MIXINGS:
        set_softness(ERROR_REDUCTION_INSTANT, factor * CONSTRAINT_FORCE_MIXING)
        a += weight * zero_step_accelerations(stepping, c, state)
    stepping.model.skeleton.setAccelerations(a)
    return a
