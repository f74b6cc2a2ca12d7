"""Initial states: what a user gives, checked, and the consistent state that is nearest to it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from consilience.errors import InvalidInput, require
from consilience.mechanism.assembly import (
    HeldCoordinates,
    Initial,
    assemble_positions,
    assemble_velocities,
    drawing_state,
    held_coordinates,
)
from consilience.mechanism.bodies import Frame
from consilience.mechanism.model import GROUND, Mechanism, State
from consilience.mechanism.spatial import fixed_array


class Start(NamedTuple):
    """Initial conditions, checked: the guess, and what is held."""

    guess: State
    coordinates: HeldCoordinates
    rates: HeldCoordinates


def checked_start(mechanism: Mechanism, initial: Initial | None, drawing: State | None = None) -> Start:
    """Return the guess and the held coordinates and rates of initial conditions.

    Parameters
    ----------
    mechanism : Mechanism
    initial : Initial or None
        Default: the drawing, at rest.
    drawing : State, optional
        `drawing_state` of the mechanism, if it is known.

    Raises
    ------
    InvalidInput
    """
    initial = Initial() if initial is None else initial
    require(initial, Initial, "initial", "Give Initial(coordinates={'pin': {'angle': 0.5}}).")
    for name, pose in initial.poses.items():
        require(pose, Frame, f"initial.poses: body '{name}'", "Give Frame(p, R), the pose in the world.")
    for name in (*initial.poses, *initial.velocities):
        if name not in mechanism.body_index or name == GROUND:
            known = ", ".join(b.name for b in mechanism.bodies)
            raise InvalidInput("initial.bodies", f"there is no body '{name}'", f"Bodies are: {known}.")
    coordinates = held_coordinates(mechanism, initial.coordinates, "joints")
    rates = held_coordinates(mechanism, initial.rates, "rates")
    if drawing is not None and not initial.poses and not initial.velocities:
        return Start(drawing, coordinates, rates)
    guess = drawing_state(mechanism, initial.poses)
    v, w = np.zeros_like(guess.v_WB_W), np.zeros_like(guess.w_WB_W)
    for name, both in initial.velocities.items():
        hint = " It is v_WB_W, then w_WB_W."
        v[mechanism.body_index[name]], w[mechanism.body_index[name]] = fixed_array(
            np.array(both, dtype=object), (2, 3), f"initial.velocities: body '{name}'", hint
        )
    return Start(State(guess.p_WB, guess.quat_WB, v, w), coordinates, rates)


def assemble(mechanism: Mechanism, start: Start, t: float) -> State:
    """Return the consistent state that is nearest to the guess of a start at the time t, in s.

    Raises
    ------
    CannotAssemble
    """
    placed = assemble_positions(mechanism, start.guess, start.coordinates, t)
    return assemble_velocities(mechanism, placed, start.rates, t)


def assembled(mechanism: Mechanism, state: State, t: float) -> State:
    """Return the consistent state that is nearest to a state at the time t, in s.

    Raises
    ------
    CannotAssemble
    """
    return assemble_velocities(mechanism, assemble_positions(mechanism, state, t=t), t=t)


def initial_state(mechanism: Mechanism, initial: Initial | None = None, t: float = 0.0) -> State:
    """Return the consistent state of a mechanism at the time t, in s, for given initial conditions.

    Raises
    ------
    InvalidInput, CannotAssemble
    """
    return assemble(mechanism, checked_start(mechanism, initial), t)
