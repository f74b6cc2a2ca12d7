"""Charts of rods (`consilience.engine.rods`) in MuJoCo's coordinates, changed between steps of a motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from consilience.engine import ROD_MARGIN, rod_turn, rods_of, turned_rods
from consilience.mechanism import Array, rotation_from_quaternion
from consilience_mujoco.callback import answering
from consilience_mujoco.messages import warnings_raise
from consilience_mujoco.methods import GAINS, WEIGHTS
from consilience_mujoco.translate import Translation, translate

_Places = dict[int, tuple[list[int], list[int], int, int]]
"""Places in `qpos` and `qvel` of the two angles of each rod, and of its ball, by the first link."""


def _places(translation: Translation) -> _Places:
    model, found = translation.model, _Places()
    for first in rods_of(translation.mechanism, translation.tree):
        one, two, ball = translation.link_joint[first : first + 3]
        q, v = model.jnt_qposadr, model.jnt_dofadr
        found[first] = [int(q[one]), int(q[two])], [int(v[one]), int(v[two])], int(q[ball]), int(v[ball])
    return found


def advance(
    translation: Translation, steps: int, rank: int | None, at_step: Callable[[Translation], None] | None = None
) -> Translation:
    """Take steps of a motion; where a rod comes near to its singular pose, go on in another translation.

    Parameters
    ----------
    translation : Translation
        With the settings of a method and the time step, its data at the present state.
    steps : int
    rank : int, optional
        As in `answering`.
    at_step : callable, optional
        Called after every step.

    Returns
    -------
    Translation
        The given one, or one with the start frames of rods turned, its data at the new state.
    """
    places = _places(translation)
    taken = 0
    while taken < steps:
        with warnings_raise(), answering(translation, rank):
            taken += _steps_in_chart(translation, places, steps - taken, at_step)
        if _left(translation, places):
            translation = _turned(translation, places)
    return translation


def _left(translation: Translation, places: _Places) -> bool:
    """Whether a rod is too near to its singular pose."""
    return any(abs(np.cos(translation.data.qpos[q[1]])) < ROD_MARGIN for q, *_ in places.values())


def _steps_in_chart(
    translation: Translation, places: _Places, steps: int, at_step: Callable[[Translation], None] | None
) -> int:
    """Take steps up to a number, until a rod comes near to its singular pose; return how many were taken."""
    model, data = translation.model, translation.data
    if not places and at_step is None:
        mujoco.mj_step(model, data, steps)
        return steps
    for taken in range(1, steps + 1):
        mujoco.mj_step(model, data)
        if at_step is not None:
            at_step(translation)
        if _left(translation, places):
            return taken
    return steps


def _turned(translation: Translation, places: _Places) -> Translation:
    """Translation with all rods along z of their start frames, its data at the same state, time and activations."""
    old: Any = translation.data
    qpos, qvel = np.array(old.qpos), np.array(old.qvel)
    turns: dict[int, Array] = {}
    for first, (angles, rates, ball, spin) in places.items():
        turns[first], w_rod = rod_turn(qpos[angles], qvel[rates])
        qvel[spin : spin + 3] += w_rod[2] * rotation_from_quaternion(qpos[ball : ball + 4])[2]
        qpos[angles], qvel[rates] = 0.0, w_rod[:2]
    fresh = translate(turned_rods(translation.mechanism, translation.tree, turns))
    model = fresh.model
    model.opt = translation.model.opt
    for name in (*GAINS, *WEIGHTS):
        getattr(model, name)[:] = getattr(translation.model, name)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.act[:], data.time = qpos, qvel, old.act, old.time
    return replace(fresh, data=data)
