"""Differences between computed and published values."""

import numpy as np

from consilience.mechanism import quaternion_from_rotation, rotation_angle_between

BAR = 1e-10


def table(rows):
    """Times (n_t,) and the other columns (n_t, n) of rows that start with a time."""
    rows = np.array(rows, dtype=float)
    return rows[:, 0], rows[:, 1:]


def far(found, expected):
    """Largest difference, relative to the largest expected magnitude or to 1, whichever is larger."""
    return np.max(np.abs(np.asarray(found) - expected)) / max(1.0, np.max(np.abs(expected)))


def turned(found, expected):
    """Difference of angles modulo a full turn."""
    return (np.asarray(found) - expected + np.pi) % (2 * np.pi) - np.pi


def apart(R, quats):
    """Largest rotation angle between rotation matrices and quaternions."""
    return np.max(rotation_angle_between(quaternion_from_rotation(R), quats))
