"""Drives as DART's own acceleration actuators: a joint that takes its acceleration and gives the force it needs.

`translation.build` makes these of the driven joints.
"""

from __future__ import annotations

import numpy as np

from consilience_dart.translation import Model

TURN = 2.0 * np.pi


def command_accelerations(model: Model, t: float) -> None:
    """Command ``f''(t)`` for forward dynamics."""
    for drive in model.mechanism.drives:
        axis = model.axes[drive.joint, drive.coordinate]
        axis.joint.setCommand(0, axis.sign * float(drive.motion.at(t)[2]))


def command_steps(model: Model, t: float, step: float, reduction: float) -> None:
    """Command what takes a step from t to the rate of the drive at its end, and removes part of the position error.

    ``v+ = f'(t + h) + reduction (f(t) - q) / h``, as DART's constraints do it. Turns are not counted by a drive, only
    kept: the error is the one within half a turn.
    """
    for drive in model.mechanism.drives:
        axis = model.axes[drive.joint, drive.coordinate]
        error = float(drive.motion.at(t)[0]) - axis.value
        if axis.turns:
            error -= TURN * round(error / TURN)
        rate = float(drive.motion.at(t + step)[1]) + reduction * error / step
        axis.joint.setCommand(0, axis.sign * (rate - axis.rate) / step)
