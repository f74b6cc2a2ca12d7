"""Refusal of states that are not consistent, and of motions that do not satisfy their rows: see `residual`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State, row_names
from consilience.reference.bodies.arrays import ROWS, Model, Workspace, flatten, pack
from consilience.reference.bodies.residual import (
    CONSISTENT,
    POSITION,
    RATIO,
    SOLVABLE,
    SPEED,
    TURNS,
    CheckedRows,
    SolvableRows,
    checked_rows,
    first_violation,
    unsolved,
)


def _row_name(mechanism: Mechanism, model: Model, row: int) -> str:
    """Return the name of a row of a model, which may have a part of the joint rows of the mechanism."""
    joint_rows = len(model.row_kind)
    if row >= joint_rows:
        others = row_names(mechanism, [], velocities=True)[sum(len(j.rows) for j in mechanism.joints) :]
        return others[row - joint_rows]
    joint = mechanism.joints[int(np.searchsorted(model.first_row, row, side="right")) - 1]
    return f"joint '{joint.name}', constraint {ROWS[model.row_kind[row]]}"


def refuse_inconsistent(mechanism: Mechanism, model: Model, found: Array, t: float) -> None:
    """Refuse a given state for its largest ratio of residual to size.

    Raises
    ------
    InvalidInput
        With the row and its residual.
    """
    _, row, level, size = found[:SPEED]
    what = "is violated" if level == POSITION else "has a wrong rate,"
    raise InvalidInput(
        f"state of mechanism '{mechanism.name}'",
        f"at t = {t:g} s {_row_name(mechanism, model, int(row))} {what} by {size:.3g}",
        "Give a consistent state: consilience.initial_state, or `simulate` with assemble=True, assembles one.",
    )


def check_given(mechanism: Mechanism, model: Model, times: Array, y: Array) -> None:
    """Refuse a packed state y at ``times[0]`` that is not consistent.

    Raises
    ------
    InvalidInput
    """
    found, A = np.zeros(TURNS + 2 * len(model.coupling)), np.empty((len(model.mass), 3, 3))
    if first_violation(checked_rows(model), times[:1], y[None], A, CONSISTENT, found) >= 0:
        refuse_inconsistent(mechanism, model, found, times[0])


@lru_cache(maxsize=8)  # one mechanism at many states
def _rows_of(mechanism: Mechanism) -> tuple[Model, CheckedRows]:
    model = flatten(mechanism)
    return model, checked_rows(model)


def check_states(mechanism: Mechanism, states: Sequence[State], t: float) -> None:
    """Refuse states that are not consistent at the time t, as `check_given`.

    Raises
    ------
    InvalidInput
    """
    model, rows = _rows_of(mechanism)
    found, A = np.zeros(TURNS + 2 * len(model.coupling)), np.empty((len(model.mass), 3, 3))
    packed = np.array([pack(mechanism, state) for state in states])
    if len(packed) and first_violation(rows, np.full(len(packed), t), packed, A, CONSISTENT, found) >= 0:
        refuse_inconsistent(mechanism, model, found, t)


def check_motion(
    mechanism: Mechanism, rows: CheckedRows, model: Model, times: Array, states: Array, tolerance: float, label: str
) -> None:
    """Refuse a motion with a sample at which rows are violated beyond the tolerance (and beyond `CONSISTENT`).

    Parameters
    ----------
    mechanism : Mechanism
    rows : CheckedRows
        Record array of `model`.
    model : Model
        Of the mechanism, with all rows or with those to check.
    times : ndarray, shape (n_t,), s
    states : ndarray, shape (n_t, n_b + n_e, 13)
        Packed states.
    tolerance : float
    label : str
        How the motion was computed.

    Raises
    ------
    NumericalFailure
        With the time, the row, and its residual over its size.
    """
    found, A = np.zeros(TURNS + 2 * len(model.coupling)), np.empty((len(model.mass), 3, 3))
    n = first_violation(rows, times, states, A, max(tolerance, CONSISTENT), found)
    if n < 0:
        return
    ratio, row, level, _ = found[:SPEED]  # a residual would count units of a motion, see `motion_units`
    what = "" if level == POSITION else "the rate of "
    raise NumericalFailure(
        f"{label}: at t = {times[n]:.6g} s {what}{_row_name(mechanism, model, int(row))} stays wrong by {ratio:.3g} "
        "of its size: the constraints contradict each other there, or the mechanism locks"
    )


def check_solvable(mechanism: Mechanism, solvable: SolvableRows, t: float, y: Array) -> None:
    """Refuse a consistent packed state y at which no accelerations satisfy all rows, ``Q a = gamma``.

    Dependent rows may agree at a pose and contradict each other behind it: a mechanism can move at the pose alone, or
    drives contradict each other.

    Raises
    ------
    NumericalFailure
        With the row.
    """
    model, rows, ws = solvable
    found = np.zeros(TURNS)
    unsolved(rows, t, y, np.zeros(len(model.coordinate)), ws, found)
    if found[RATIO] > SOLVABLE:
        raise NumericalFailure(
            f"mechanism '{mechanism.name}': at t = {t:g} s no accelerations satisfy at once "
            f"{_contradiction(mechanism, model.length, ws)}: it can move at this pose alone and locks, its velocities "
            "lead along no motion, or drives contradict each other"
        )


def _contradiction(mechanism: Mechanism, length: float, ws: Workspace) -> str:
    """Return the joints and elements with rows in the part of gamma that no accelerations reach, drives first."""
    Q = ws.Q * np.tile(np.repeat([length, 1.0], 3), len(mechanism.bodies))
    norms = np.linalg.norm(Q, axis=1)
    U, singular, _ = np.linalg.svd(Q / norms[:, None])
    unreached = U[:, int(np.sum(singular > RANK_TOLERANCE * singular[0])) :]
    left = np.abs(unreached @ (unreached.T @ (ws.gamma / norms)))
    names = [name.partition(",")[0] for name in row_names(mechanism, [], velocities=True)]
    found = dict.fromkeys(name for name, part in zip(names, left, strict=True) if part > 1e-3 * np.max(left))
    return ", ".join(sorted(found, key=lambda name: not name.startswith("drive")))
