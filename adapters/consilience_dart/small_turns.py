"""Small rotations of a step, from which is taken what DART's truncated exponential map adds.

Rotations are lists of numbers here: arrays of three and four are several times slower, and every step has them.
"""

from __future__ import annotations

from math import atan2, cos, hypot, sin, tau

from consilience.mechanism import Array
from consilience_dart.state import SMALL_ANGLE, rotations
from consilience_dart.translation import Model

TRUNCATED = 1e-3
"""Rotation in rad below which DART's exponential map is a truncated series."""

Numbers = list[float]


def _quaternion(phi: Numbers) -> Numbers:
    angle = hypot(*phi)
    factor = sin(angle / 2.0) / angle if angle else 0.5
    return [cos(angle / 2.0), factor * phi[0], factor * phi[1], factor * phi[2]]


def _product(p: Numbers, q: Numbers) -> Numbers:
    a, b, c, d = p
    w, x, y, z = q
    return [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]


def _rotation_vector(quat: Numbers) -> Numbers:
    w, *axis = quat if quat[0] >= 0.0 else [-x for x in quat]
    sine = hypot(*axis)
    factor = 2.0 * atan2(sine, w) / sine if sine else 2.0
    return [factor * x for x in axis]


def mend_rotations(model: Model, before: Array) -> None:
    """Turn ball and free joints back by the excess of a small rotation t in a step, which is ``t^3 / 6``.

    Rotation vectors are left as `rotation_vector` of the state has them, those of small angles the other way round.

    Parameters
    ----------
    model : Model
        After the step.
    before : ndarray, shape (n,)
        DART's positions before the step.
    """
    turning = rotations(model)
    if not turning:
        return
    old, new = before.tolist(), model.skeleton.getPositions()
    after = new.tolist()
    for i, _ in turning:
        w, x, y, z = _quaternion(old[i : i + 3])
        quat = _quaternion(after[i : i + 3])
        turn = _rotation_vector(_product(quat, [w, -x, -y, -z]))
        size = hypot(*turn)
        if size < TRUNCATED:
            quat = _product(_quaternion([-(size**2) / 6.0 * t for t in turn]), quat)
        phi = _rotation_vector(quat)
        angle = hypot(*phi)
        if 0.0 < angle < SMALL_ANGLE:
            phi = [(1.0 - tau / angle) * p for p in phi]
        new[i : i + 3] = phi
    model.skeleton.setPositions(new)
