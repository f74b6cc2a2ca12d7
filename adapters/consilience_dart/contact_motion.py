"""Motions with contacts by `World.step`, with the samples of the contacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from consilience.engine import TrajectoryAnswer, motion_of_halved
from consilience.mechanism import Array, continuous_in_time
from consilience_dart.state import read
from consilience_dart.stepping import ERROR_REDUCTION_TRAJECTORY, Stepper


def move(stepping: Stepper, times: Array, substeps: int) -> TrajectoryAnswer:
    """Integrate by `World.step` on a uniform grid.

    Parameters
    ----------
    stepping : Stepper
        At the initial state.
    times : ndarray, shape (n_t,), s
    substeps : int
        Steps for each sample interval.
    """
    touching = stepping.touching
    assert touching is not None
    stepping.world.setTimeStep((times[1] - times[0]) / substeps)
    stepping.time, stepping.reduction = float(times[0]), ERROR_REDUCTION_TRAJECTORY
    samples, first = [], touching.modes

    def record() -> None:
        contacts = touching.gaps(), touching.impulse, touching.modes, np.array(touching.loss)
        samples.append((*read(stepping.model), *contacts))
        touching.impulse = np.zeros_like(touching.impulse)

    record()
    for n, time in enumerate(times[1:]):
        stepping.step(1)
        first = first if n else touching.modes
        stepping.step(substeps - 1)
        stepping.time = float(time)
        record()
    p, quat, v, w, gaps, impulses, modes, loss = (np.array(column) for column in zip(*samples, strict=True))
    modes[0] = first
    joints = stepping.model.mechanism.stops or stepping.model.mechanism.dry_frictions
    return TrajectoryAnswer(
        np.asarray(times),
        p,
        continuous_in_time(quat),
        v,
        w,
        {"steps": substeps * (len(times) - 1), "failed solutions of friction": touching.failed()},
        contact_gap=gaps,
        contact_impulse=impulses,
        contact_mode=modes,
        contact_loss=None if joints else loss,
    )


def extrapolated(build: Callable[[], Stepper], times: Array, substeps: int) -> TrajectoryAnswer:
    """Return the limit of the steps h, h/2 and h/4; steppers at the initial state come from a function."""
    return motion_of_halved([move(replace(build(), mended=True), times, part * substeps) for part in (1, 2, 4)])
