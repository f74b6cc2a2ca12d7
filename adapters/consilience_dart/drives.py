"""Drives as DART's acceleration actuators, which take the acceleration of a joint and return its force.

`translation.build` makes the driven joints such actuators.
"""

from __future__ import annotations

import numpy as np

from consilience_dart.translation import Model

TURN = 2.0 * np.pi


def command_accelerations(model: Model, t: float) -> None:
    """Command the acceleration ``f''(t)`` of each drive for forward dynamics."""
    for drive in model.mechanism.drives:
        axis = model.axes[drive.joint, drive.coordinate]
        axis.joint.setCommand(0, axis.sign * float(drive.motion.at(t)[2]))


def command_steps(model: Model, t: float, step: float, reduction: float) -> None:
    """Command the accelerations by which a step ends at the rate of the drive, less a part of the position error.

    ``v+ = f'(t + h) + reduction (f(t) - q) / h``, as in DART's constraints. The position error of an angle is taken
    within half a turn.

    Parameters
    ----------
    model : Model
    t : float, s
        Beginning of the step.
    step : float, s
    reduction : float
        Part of the position error that the step removes.
    """
    for drive in model.mechanism.drives:
        axis = model.axes[drive.joint, drive.coordinate]
        error = float(drive.motion.at(t)[0]) - axis.value
        if axis.turns:
            error -= TURN * round(error / TURN)
        rate = float(drive.motion.at(t + step)[1]) + reduction * error / step
        axis.joint.setCommand(0, axis.sign * (rate - axis.rate) / step)
