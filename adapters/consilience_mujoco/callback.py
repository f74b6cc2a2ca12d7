"""Callback of MuJoCo at every stage of a step: controls of actuators, and missing terms of constraint rows.

`mjcb_control` is called after positions, velocities and constraint rows, before actuators and solver, with the time of
the stage. The callback is global to the process; it is set around calls of MuJoCo, and only where a model needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from consilience.mechanism import Array
from consilience_mujoco.messages import EngineWarningError
from consilience_mujoco.translate import Translation

_CLEAR = 1e-3
"""Fraction of the largest singular value above which a singular value is no effect of drift: the row is independent."""


def first_rows(data: Any, equalities: Array) -> Array:
    """Return the rows of equalities that have one row each.

    Raises
    ------
    EngineWarningError
        MuJoCo has left out an equality, because nothing that it holds can move.
    """
    ids = data.efc_id[: data.ne]
    rows: Array = np.searchsorted(ids, equalities)
    if np.any(rows >= len(ids)) or np.any(ids[np.minimum(rows, len(ids) - 1)] != equalities):
        raise EngineWarningError("MuJoCo made no row of a constraint: what it holds cannot move")
    return rows


def _controls(translation: Translation) -> Callable[[Any], None]:
    model = translation.model
    signals = [(model.actuator(s.name).id, s.value) for s in translation.signals]

    def write(data: Any) -> None:
        t, length, velocity = float(data.time), data.actuator_length.tolist(), data.actuator_velocity.tolist()
        for actuator, value in signals:
            data.ctrl[actuator] = value(t, length[actuator], velocity[actuator])

    return write


class _Places:
    """Rows of equalities, searched again only when the number of rows changes."""

    def __init__(self, equalities: Sequence[int]) -> None:
        self._equalities = np.array(equalities)
        self._count = -1
        self._rows: Array = np.zeros(0, dtype=int)

    def __call__(self, data: Any) -> Array:
        if data.ne != self._count:
            self._rows, self._count = first_rows(data, self._equalities), data.ne
        return self._rows


def _joint_rows(translation: Translation) -> Callable[[Any], None]:
    nv, held = translation.model.nv, translation.rows.joints
    places = _Places([row.equality for row in held])
    written = [(n, row.driver[1]) for n, row in enumerate(held) if row.driver is not None and row.written]

    def write(data: Any) -> None:
        """Write right-hand sides of rows on joints, and coefficients of driving joints that vary."""
        rows, found = places(data), [row.evaluate(data) for row in held]
        gains = data.efc_KBIP[rows].tolist()
        data.efc_aref[rows] = [
            gamma - B * rate - K * d * residual
            for (residual, rate, gamma, _), (K, B, d, _) in zip(found, gains, strict=True)
        ]
        if written:
            J = data.efc_J
            for n, dof in written:
                J[rows[n] * nv + dof] = found[n][3]

    return write


def _guide_rows(translation: Translation) -> Callable[[Any], None]:
    model, nv = translation.model, translation.model.nv
    guides = [(guide, _Places(guide.equalities)) for guide in translation.rows.guides]

    def write(data: Any) -> None:
        """Write Jacobian and right-hand sides of rows on guided bodies."""
        for guide, places in guides:
            J, residual, rate, gamma = guide.rows(model, data)
            rows = places(data)
            K, B, d, _ = data.efc_KBIP[rows].T
            data.efc_J[: data.nefc * nv].reshape(-1, nv)[rows] = J
            data.efc_aref[rows] = gamma - B * rate - K * d * residual

    return write


def _limited(rank: int, nv: int) -> Callable[[Any], None]:
    """Reduce the rows to a rank by their singular value decomposition.

    A spatial loop may have dependent rows. On the constraint manifold they are consistent; off the manifold, at the
    stages of a step, they are inconsistent, and hard rows give unbounded forces. Reduced to their rank on the manifold
    the rows are a smooth function of the state, and on the manifold they do not change.
    """

    def write(data: Any) -> None:
        """Replace all rows and right-hand sides by their projections on the largest singular values."""
        count = data.ne
        J, aref = data.efc_J[: count * nv].reshape(-1, nv), data.efc_aref[:count]
        if not np.isfinite(np.vdot(J, J)):
            raise EngineWarningError("rows of constraints are not finite. The simulation is unstable.")
        U, s, Vt = np.linalg.svd(J, full_matrices=False)
        kept = max(rank, int(np.count_nonzero(s > _CLEAR * s[0])))
        U = U[:, :kept]
        J[:] = (U * s[:kept]) @ Vt[:kept]
        aref[:] = U @ (U.T @ aref)

    return write


@contextmanager
def answering(
    translation: Translation, rank: int | None = None, last: Callable[[Any], None] | None = None
) -> Iterator[None]:
    """Set MuJoCo's callback for a model within the block.

    Parameters
    ----------
    translation : Translation
    rank : int, optional
        Rank to which dependent rows of equalities are reduced.
    last : callable, optional
        Function that writes more into the data, after all others.
    """
    parts = [
        make(translation)
        for make, needed in (
            (_controls, translation.signals),
            (_joint_rows, translation.rows.joints),
            (_guide_rows, translation.rows.guides),
        )
        if needed
    ]
    if rank is not None:
        parts.append(_limited(rank, translation.model.nv))
    if last is not None:
        parts.append(last)

    def control(_: Any, data: Any) -> None:
        for write in parts:
            write(data)

    try:
        if parts:
            mujoco.set_mjcb_control(control)
        yield
    finally:
        if parts:
            mujoco.set_mjcb_control(None)
