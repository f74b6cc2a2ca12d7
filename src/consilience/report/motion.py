"""Motions small enough for a page: the reference as poses, every engine as its difference to them.

What differs by 1e-9 must still be there when a reader exaggerates it: differences have a scale of their own. Sixteen
bits are what a drawing can show; the record has the motions in full beside it.
"""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import Array, continuous_in_time, quaternion_product

FRAMES = 61
"""Frames of a replay at most."""

TURN = 1.0
"""Largest turn of a body between frames, rad: what turns faster is shown for a shorter time."""

FULL, FINE = 32767, 2047
"""Steps of the poses and of the differences to either side of zero."""

Encoded = dict[str, Any]


def chosen_samples(answer: TrajectoryAnswer) -> Array:
    """Samples that are shown: evenly spread over the motion, or the first of it where bodies turn too fast for that."""
    count = len(answer.time)
    spread = max(1, -(-(count - 1) // (FRAMES - 1)))
    while spread > 1 and _turn(answer.quat_WB[::spread]) > TURN:
        spread -= 1
    return np.arange(0, count, spread)[:FRAMES]


def _turn(quats: Array) -> float:
    """Largest angle from one sample to the next, rad."""
    cosine = np.abs(np.sum(quats[1:] * quats[:-1], axis=-1))
    return float(np.max(2.0 * np.arccos(np.minimum(cosine, 1.0)), initial=0.0))


def encoded_poses(answer: TrajectoryAnswer, samples: Array) -> Encoded:
    """Poses as 16-bit numbers: positions between their extremes, quaternions without a change of sign on the way."""
    p, quats = answer.p_WB[samples], continuous_in_time(answer.quat_WB[samples])
    middle = (p.max(axis=(0, 1)) + p.min(axis=(0, 1))) / 2.0
    size = float(np.max(np.abs(p - middle))) or 1.0
    return {
        "middle": [float(x) for x in middle],
        "size": size,
        "p": packed((p - middle) / size, FULL),
        "quat": packed(quats, FULL),
    }


def encoded_difference(answer: TrajectoryAnswer, reference: TrajectoryAnswer, samples: Array) -> Encoded:
    """Difference to the reference: of positions (m), of turns (vectors in world axes, rad), each with its scale."""
    away = answer.p_WB[samples] - reference.p_WB[samples]
    back = reference.quat_WB[samples] * [1.0, -1.0, -1.0, -1.0]
    turn = _rotation_vectors(quaternion_product(answer.quat_WB[samples], back))
    sizes = [float(np.max(np.abs(v), initial=0.0)) for v in (away, turn)]
    return {
        "away": sizes[0],
        "turn": sizes[1],
        "p": packed(away / (sizes[0] or 1.0), FINE),
        "r": packed(turn / (sizes[1] or 1.0), FINE),
    }


def _rotation_vectors(quats: Array) -> Array:
    """Rotation vectors, rad, of unit quaternions, shape (..., 4): the shorter way round."""
    q = np.where(quats[..., :1] < 0.0, -quats, quats)
    half = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    scale = np.divide(2.0 * np.arctan2(half, q[..., :1]), half, out=np.full_like(half, 2.0), where=half > 0.0)
    return scale * q[..., 1:]


def packed(values: Array, steps: int) -> str:
    """Numbers in [-1, 1], shape (frames, bodies, n), as base64 of their changes from frame to frame in 16 bits."""
    whole = np.rint(values * steps).astype(np.int16)
    changes = np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1]))  # modulo 2^16, as the page adds them up
    return b64encode(np.moveaxis(changes, 0, -1).astype("<i2").tobytes()).decode()
