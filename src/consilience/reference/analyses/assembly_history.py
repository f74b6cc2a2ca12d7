"""Assembly with emphasised coordinates and the history of Newton's method: residual, step and worst row.

    x <- x + s (Q; R)^+ -(g; q - q_d)

with the rows R of the emphasised coordinates, held at q_d [MASS, "kinematical assembling"], as in
`consilience.mechanism.assemble_positions`. Near the solution convergence is quadratic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import CannotAssemble
from consilience.mechanism import Mechanism, State, characteristic_length
from consilience.mechanism.assembly import (
    CONVERGED,
    MAX_ITERATIONS,
    held_coordinates,
    largest_residual,
    newton_iterates,
    refuse_flipped,
    row_lengths,
    row_names,
)


@dataclass(frozen=True)
class Iteration:
    """One iterate of an assembly.

    Attributes
    ----------
    number : int
        0 for the guess.
    residual : float
        Euclidean norm of all rows (m, rad or dimensionless).
    largest : float
        Largest row, by magnitude.
    worst : str
        Name of that row.
    step : float
        Largest component (m and rad) of the Newton step to this iterate before shortening; 0 for the guess.
    scale : float
        Fraction of the step taken: below 1 if the step exceeded a characteristic length or a radian.
    """

    number: int
    residual: float
    largest: float
    worst: str
    step: float
    scale: float


@dataclass(frozen=True, eq=False)
class Assembly:
    """Assembled state and history of the iteration.

    Attributes
    ----------
    state : State
        Last iterate, consistent unless `failure` is set. Velocities are those of the guess.
    history : tuple of Iteration
    failure : CannotAssemble or None
        Why the mechanism could not be assembled.
    """

    state: State
    history: tuple[Iteration, ...]
    failure: CannotAssemble | None


def assemble_with_history(
    mechanism: Mechanism, guess: State, emphasised: Mapping[str, Mapping[str, ArrayLike]] | None = None
) -> Assembly:
    """Assemble as `consilience.mechanism.assemble_positions`, and record the history.

    Parameters
    ----------
    mechanism : Mechanism
    guess : State
        For example `consilience.mechanism.drawing_state`.
    emphasised : mapping of joint name to mapping of coordinate name to value
        Joint coordinates to hold (m, rad, quaternions); all bodies move as little as possible.

    Returns
    -------
    Assembly
        Also if the iteration did not converge.

    Raises
    ------
    InvalidInput
        Unknown joints or coordinates.
    """
    held = held_coordinates(mechanism, emphasised or {}, "emphasised")
    names = row_names(mechanism, held, velocities=False)
    history: list[Iteration] = []
    rows, before = row_lengths(mechanism, held), np.inf
    for found in islice(newton_iterates(mechanism, guess, held), MAX_ITERATIONS + 1):
        error = largest_residual(found.residual)
        if before < CONVERGED and error >= before:
            break
        state, before, residual = found.state, error, found.residual * rows
        worst = int(np.argmax(np.abs(residual))) if names else 0
        norm, name = float(np.linalg.norm(residual)), names[worst] if names else "none"
        history.append(Iteration(len(history), norm, largest_residual(residual), name, found.step, found.scale))
    return Assembly(state, tuple(history), _failure(mechanism, state, before, history[-1]))


def _failure(mechanism: Mechanism, state: State, error: float, last: Iteration) -> CannotAssemble | None:
    """Return why the last iterate is no assembled state, if so.

    Parameters
    ----------
    mechanism : Mechanism
    state : State
    error : float
        Largest row, in units of its size.
    last : Iteration
    """
    if error > CONVERGED * max(1.0, largest_residual(state.p_WB) / characteristic_length(mechanism)):
        return CannotAssemble(
            f"mechanism '{mechanism.name}': {last.worst}",
            f"it stays violated by {last.largest:.3g} after {last.number} iterations",
            "Draw the mechanism closer to an assembled pose, or hold fewer or other joint coordinates.",
        )
    try:
        refuse_flipped(mechanism, state)
    except CannotAssemble as failure:
        return failure
    return None
