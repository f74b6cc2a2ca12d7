"""Constraint rows and assembly with couplings over full turns, for analyses along a motion.

A pose determines an angle up to full turns, on which a coupling ``q = f(q_driver)`` depends. Full turns are counted
from given values of the joint coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import NamedTuple

import numpy as np

from consilience.errors import CannotAssemble, InvalidInput
from consilience.mechanism import (
    RANK_TOLERANCE,
    Array,
    Mechanism,
    State,
    assemble_positions,
    constraint_gamma,
    constraint_jacobian,
    constraint_residual,
    move,
)
from consilience.mechanism.assembly import (
    CONVERGED,
    MAX_ITERATIONS,
    HeldCoordinates,
    held_error,
    held_rows,
    largest_residual,
    refuse_flipped,
    row_names,
)
from consilience.mechanism.joint_rows import scatter
from consilience.reference.analyses.joint_rows import JointCoordinate

CoordinateValues = Mapping[JointCoordinate, Array]


class NewtonIterate(NamedTuple):
    """Iterate of an assembly: pose, residual of all rows, and the step to the pose before it was shortened."""

    state: State
    residual: Array
    step: float  # largest component, m and rad
    scale: float  # fraction of the step taken


def newton_iterates(state: State, linear_system: Callable[[State], tuple[Array, Array]]) -> Iterator[NewtonIterate]:
    """Yield a guess and the iterates of Newton's method, by least-norm steps of at most a metre and a radian.

    Parameters
    ----------
    state : State
        Guess.
    linear_system : function of a state to residual, shape (q,), and Jacobian, shape (q, 6 n_b)
    """
    longest, scale = 0.0, 1.0
    while True:
        residual, jacobian = linear_system(state)
        yield NewtonIterate(state, residual, longest, scale)
        step = np.linalg.lstsq(jacobian, -residual, rcond=RANK_TOLERANCE)[0]
        longest = largest_residual(step)
        scale = min(1.0, 1.0 / max(longest, 1e-300))
        state = move(state, scale * step)


def _angles(values: CoordinateValues) -> dict[str, float]:
    """Return the angles of the values by joint name."""
    return {joint.name: float(value) for (joint, name), value in values.items() if name == "angle"}


def require_holonomic(mechanism: Mechanism, why: str, remedy: str) -> None:
    """Refuse rolling bodies and skates, whose rows are non-holonomic."""
    for what, elements in (("rolling", mechanism.rollings), ("skate", mechanism.skates)):
        if elements:
            raise InvalidInput(f"{what} '{elements[0].name}'", why, remedy)


def acceleration_rows(mechanism: Mechanism, state: State, near: CoordinateValues) -> tuple[Array, Array]:
    """Return Q, shape (q, 6 n_b), and gamma, shape (q,), of a mechanism without drives and non-holonomic rows.

    Angles that couplings read are within half a turn of `near`.
    """
    angles = _angles(near)
    return constraint_jacobian(mechanism, state, angles=angles), constraint_gamma(mechanism, state, angles=angles)


def place(mechanism: Mechanism, guess: State, held: CoordinateValues, near: CoordinateValues) -> State:
    """Assemble a mechanism without drives as `assemble_positions`, angles of couplings counted from `near`.

    Raises
    ------
    CannotAssemble
        With the constraint that stays violated.
    """
    wanted: HeldCoordinates = [(joint, coordinate, value) for (joint, coordinate), value in held.items()]
    if not mechanism.couplings:
        return assemble_positions(mechanism, guess, wanted)
    angles = _angles(near)

    def linear_system(state: State) -> tuple[Array, Array]:
        errors = [held_error(mechanism, state, *one) for one in wanted]
        rows = [scatter(mechanism, j, held_rows(mechanism, state, j, c)) for j, c, _ in wanted]
        residual = np.concatenate([constraint_residual(mechanism, state, angles=angles), *errors])
        return residual, np.vstack([constraint_jacobian(mechanism, state, angles=angles), *rows])

    before = np.inf
    for found in islice(newton_iterates(guess, linear_system), MAX_ITERATIONS):
        state, residual, error = found.state, found.residual, largest_residual(found.residual)
        if error == 0.0 or (before < CONVERGED and error >= before):
            break
        before = error
    if error > 10.0 * CONVERGED * max(1.0, largest_residual(state.p_WB)):
        worst = int(np.argmax(np.abs(residual)))
        raise CannotAssemble(
            f"mechanism '{mechanism.name}': {row_names(mechanism, wanted, velocities=False)[worst]}",
            f"it stays violated by {error:.3g} after {MAX_ITERATIONS} iterations",
            "Draw the mechanism closer to an assembled pose, or drive fewer or other joint coordinates.",
        )
    refuse_flipped(mechanism, state)
    return state
