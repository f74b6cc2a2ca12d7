"""Motions encoded for a page: poses of the reference, and differences of the engines to these poses.

Differences have a scale of their own, so that a reader can enlarge a difference of 1e-9. Sixteen bits suffice for a
drawing; the report folder holds the motions at full precision.
"""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import numpy as np

from consilience.engine import TrajectoryAnswer
from consilience.mechanism import Array, continuous_in_time, quaternion_product

FRAMES = 61
"""Largest number of frames of a replay."""

TURN = 1.0
"""Largest turn of a body between frames, rad; a replay of faster bodies is shorter."""

FULL, FINE = 32767, 2047
"""Quantisation steps on either side of zero, of poses and of differences."""

Encoded = dict[str, Any]


def chosen_samples(answer: TrajectoryAnswer) -> Array:
    """Choose samples: evenly spread over the motion, or its first samples if bodies turn too fast."""
    count = len(answer.time)
    spread = max(1, -(-(count - 1) // (FRAMES - 1)))
    while spread > 1 and largest_turn(answer.quat_WB[::spread]) > TURN:
        spread -= 1
    return np.arange(0, count, spread)[:FRAMES]


def largest_turn(quats: Array) -> float:
    """Return the largest angle from one sample to the next, rad."""
    cosine = np.abs(np.sum(quats[1:] * quats[:-1], axis=-1))
    return float(np.max(2.0 * np.arccos(np.minimum(cosine, 1.0)), initial=0.0))


def encoded_poses(answer: TrajectoryAnswer, samples: Array) -> Encoded:
    """Encode poses in 16 bits: positions between their extremes, quaternions continuous in time."""
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
    """Encode differences to the reference: positions, m, and rotation vectors, rad, world axes, each with its scale."""
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
    """Convert unit quaternions, shape (..., 4), to rotation vectors of at most pi, rad."""
    q = np.where(quats[..., :1] < 0.0, -quats, quats)
    half = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    scale = np.divide(2.0 * np.arctan2(half, q[..., :1]), half, out=np.full_like(half, 2.0), where=half > 0.0)
    return scale * q[..., 1:]


def packed(values: Array, steps: int) -> str:
    """Encode numbers in [-1, 1], shape (frames, bodies, n), as base64 of 16-bit changes from frame to frame."""
    whole = np.rint(values * steps).astype(np.int16)
    changes = np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1]))  # modulo 2^16, as the sums in the page
    return b64encode(np.moveaxis(changes, 0, -1).astype("<i2").tobytes()).decode()
