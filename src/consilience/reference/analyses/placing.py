"""Constraint rows and assembly with couplings over full turns, for analyses along a motion.

A pose determines an angle up to full turns, on which a coupling ``q = f(q_driver)`` depends. Full turns are counted
from given values of the joint coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice

import numpy as np

from consilience.errors import InvalidInput
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    assemble_positions,
    characteristic_length,
    constraint_gamma,
    constraint_jacobian,
)
from consilience.mechanism.assembly import (
    CONVERGED,
    MAX_ITERATIONS,
    HeldCoordinates,
    largest_residual,
    newton_iterates,
    refuse_flipped,
    row_lengths,
    row_names,
)
from consilience.mechanism.unassembled import stays_violated
from consilience.reference.analyses.joint_rows import JointCoordinate

CoordinateValues = Mapping[JointCoordinate, Array]


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

    before, rows = np.inf, row_lengths(mechanism, wanted)
    for found in islice(newton_iterates(mechanism, guess, wanted, angles=angles), MAX_ITERATIONS):
        state, residual, error = found.state, found.residual, largest_residual(found.residual)
        if before < CONVERGED and error >= before:
            break
        before = error
    if error > 10.0 * CONVERGED * max(1.0, largest_residual(state.p_WB) / characteristic_length(mechanism)):
        names = row_names(mechanism, wanted, velocities=False)
        raise stays_violated(mechanism, names, residual, rows, MAX_ITERATIONS, "drive")
    refuse_flipped(mechanism, state)
    return state
