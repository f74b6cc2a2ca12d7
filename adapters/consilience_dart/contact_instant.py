"""Accelerations at an instant with closed contacts, stops and dry friction, by two steps of `World.step`.

The first step has the force mixing of contacts, 1e-5 of the acceleration; the second makes up for it. The difference
quotient of the second is extrapolated to zero step. DART's rows are those of the start of a step and lack the rates of
their directions: where these count, as at a turning corner, the second step takes the contact for open or for an
impact, and there is no answer.
"""

from __future__ import annotations

import numpy as np

from consilience.engine import CannotRepresent, limit_of_halved
from consilience.mechanism import Array, State, contact_gap, contact_parts, nearest_points
from consilience_dart.contacts import Touching
from consilience_dart.state import Coordinates, read, send
from consilience_dart.stepping import Stepper, zero_step_accelerations
from consilience_dart.translation import Model

CLOSED = 1e-9
"""Gap in m, and its rate, up to which a contact is closed."""

STEP, DRIVEN = 1e-3, 1.25e-4
"""Longest step in s, and that of a mechanism with drives, whose accelerations change in a step. Shorter ones are spoilt
by rounding and by overlaps."""

TURN, FRICTION = 1e-2, 30.0
"""Part by which friction may change a slip in a step, at this acceleration in m/s^2 or a larger one of a first step."""

UNTURNED = 1e-6
"""Largest acceleration of a closed gap at constant rates of the coordinates, in m/s^2."""


MOST_ITERATIONS, FINE = 20000, 1e-12
"""Of the solver of friction: 100 iterations, its default, are too few for the first steps of a box that tips, and
1000 for a ball that rolls in a trough."""


def _slowest(model: Model, touching: Touching, state: State) -> float:
    """Return the least slip, or rate with dry friction, that is not zero, in m/s or rad/s; infinite if all are.

    Raises
    ------
    ArithmeticError
        A closed contact closes further.
    """
    rates = [abs(model.axes[d.joint, d.coordinate].rate) for d in touching.mechanism.dry_frictions]
    slowest = min((rate for rate in rates if rate > CLOSED), default=np.inf)
    for n, contact in enumerate(touching.mechanism.contacts):
        for part in contact_parts(contact):
            nearest = nearest_points(touching.mechanism, state, part)
            if nearest.gap > CLOSED:
                continue
            slip = touching.slip(n, nearest.on_body)
            rate = float(nearest.normal @ slip)
            if rate < -CLOSED:
                raise ArithmeticError(f"contact '{part.name}' closes at {-rate:.3g} m/s: an impact, no acceleration")
            speed = float(np.linalg.norm(slip - rate * nearest.normal))
            slowest = speed if CLOSED < speed < slowest else slowest
    return slowest


def _refuse_turning(stepping: Stepper, c: Coordinates) -> None:
    """Refuse a closed contact whose gap accelerates at constant rates of the coordinates."""
    mechanism, gaps = stepping.model.mechanism, []
    parts = [part for contact in mechanism.contacts for part in contact_parts(contact)]
    for time in (-STEP, 0.0, STEP):
        send(stepping.model, c)
        stepping.model.skeleton.integratePositions(time)
        state = State(*read(stepping.model))
        gaps.append([contact_gap(mechanism, state, part) for part in parts])
    before, now, after = np.array(gaps)
    rates = np.abs(before - 2.0 * now + after) / STEP**2
    for part, gap, rate in zip(parts, now, rates, strict=True):
        if gap <= CLOSED and rate > UNTURNED:
            what = f"its gap accelerates by {rate:.3g} m/s^2 as the bodies turn, which DART's rows lack"
            raise CannotRepresent(f"contact '{part.name}'", what)


def _require_same_contacts(touching: Touching, forces: list[Array]) -> None:
    """Refuse steps of which some miss a contact that others find: their limit is that of neither."""
    acting = np.any(forces, axis=2)
    for n in np.flatnonzero(np.any(acting, axis=0) & ~np.all(acting, axis=0)):
        name = touching.mechanism.contacts[n].name
        raise ArithmeticError(f"contact '{name}' acts in some of the halved steps and not in others")


def settle(stepping: Stepper, c: Coordinates, state: State) -> Array:
    """Compute generalised accelerations, and the forces of the contacts (n_c, 3) on their bodies, world axes.

    The skeleton is left at the state, with these accelerations.

    Raises
    ------
    CannotRepresent
        A contact at a turning corner.
    ArithmeticError
        DART has no acceleration: an impact, or friction without a solution.
    """
    touching = stepping.touching
    assert touching is not None
    joints = touching.mechanism.stops or touching.mechanism.dry_frictions
    if not joints and np.min(touching.gaps()) > CLOSED:
        zero_step_accelerations(stepping, c, state)
        return np.zeros((len(touching.mechanism.contacts), 3))
    touching.iterate(MOST_ITERATIONS, FINE)
    _refuse_turning(stepping, c)
    stepping.restart(c, 0.0, STEP)
    slowest = _slowest(stepping.model, touching, state)
    stepping.step(1)
    longest = DRIVEN if touching.mechanism.drives else STEP
    h = min(longest, TURN * slowest / max(FRICTION, touching.slip_rate))
    quotients, forces = [], []
    for part in (1, 2, 4):
        stepping.restart(c, 0.0, h / part)
        stepping.step(1)
        before = np.array(stepping.model.skeleton.getVelocities())
        stepping.step(1)
        quotients.append((stepping.model.skeleton.getVelocities() - before) / (h / part))
        forces.append(touching.forces)
    if touching.failed():
        raise ArithmeticError("FbfFrictionSolver fails at this state")
    _require_same_contacts(touching, forces)
    send(stepping.model, c)
    stepping.model.skeleton.setAccelerations(limit_of_halved(quotients))
    return limit_of_halved(forces)
