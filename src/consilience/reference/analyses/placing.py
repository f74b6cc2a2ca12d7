"""Constraint rows and assembly with couplings over full turns, for analyses along a motion.

A pose determines an angle up to full turns, on which a coupling ``q = f(q_driver)`` depends. Full turns are counted
from given values of the joint coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping

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
    holonomic_rows,
    joint_frames,
    move,
    row_target,
    row_value,
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


def _angles(values: CoordinateValues) -> dict[str, float]:
    """Return the angles of the values by joint name."""
    return {joint.name: float(value) for (joint, name), value in values.items() if name == "angle"}


def require_holonomic(mechanism: Mechanism, why: str, remedy: str) -> None:
    """Refuse rolling bodies and skates, whose rows are non-holonomic."""
    for what, elements in (("rolling", mechanism.rollings), ("skate", mechanism.skates)):
        if elements:
            raise InvalidInput(f"{what} '{elements[0].name}'", why, remedy)


def acceleration_rows(mechanism: Mechanism, state: State, near: CoordinateValues) -> tuple[Array, Array]:
    """Return Q, shape (q, 6 n_b), and gamma, shape (q,), of all holonomic rows of a mechanism without drives.

    Angles that couplings read are within half a turn of `near`.
    """
    elements = holonomic_rows(mechanism, state, 0.0, _angles(near))
    Q = [constraint_jacobian(mechanism, state, mechanism.joints), *(row.Q[None] for row in elements)]
    gamma = np.append(constraint_gamma(mechanism, state, mechanism.joints), [row.gamma for row in elements])
    return np.vstack(Q), gamma


def _joint_residual(mechanism: Mechanism, state: State) -> Array:
    """Return the violation of all joint rows."""
    frames = ((joint, joint_frames(mechanism, state, joint)) for joint in mechanism.joints)
    return np.array([row_value(f, row) - row_target(joint, row) for joint, f in frames for row in joint.rows])


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
    state, error = guess, np.inf
    for _ in range(MAX_ITERATIONS):
        elements = holonomic_rows(mechanism, state, 0.0, _angles(near))
        joints = _joint_residual(mechanism, state)
        parts = [held_error(mechanism, state, *one) for one in wanted]
        residual = np.concatenate([joints, [row.value for row in elements], *parts])
        if largest_residual(residual) == 0.0 or (error < CONVERGED and largest_residual(residual) >= error):
            break
        error = largest_residual(residual)
        rows = [scatter(mechanism, j, held_rows(mechanism, state, j, c)) for j, c, _ in wanted]
        Q = [constraint_jacobian(mechanism, state, mechanism.joints), *(row.Q[None] for row in elements)]
        jacobian = np.vstack([*Q, *rows])
        step = np.linalg.lstsq(jacobian, -residual, rcond=RANK_TOLERANCE)[0]
        state = move(state, step * min(1.0, 1.0 / max(largest_residual(step), 1e-300)))
    if largest_residual(residual) > 10.0 * CONVERGED * max(1.0, largest_residual(state.p_WB)):
        worst = int(np.argmax(np.abs(residual)))
        raise CannotAssemble(
            f"mechanism '{mechanism.name}': {row_names(mechanism, wanted, velocities=False)[worst]}",
            f"it stays violated by {abs(residual[worst]):.3g} after {MAX_ITERATIONS} iterations",
            "Draw the mechanism closer to an assembled pose, or drive fewer or other joint coordinates.",
        )
    refuse_flipped(mechanism, state)
    return state
