"""Bodies between two joints in a row: mass on the axis of a hinge may belong to either body that the hinge joins.

A body that turns about an axis has the same motion as the body that carries the axis as far as the points on the axis
go: masses there, and a rod along the axis, have the same kinetic energy on either side of the hinge. A slide joins
bodies of one orientation: moments of inertia have the same kinetic energy on either side, masses have not. So a piece
without mass between two joints takes over shares of both neighbours, and the motion of the mechanism stays the same to
rounding; the reactions of the two joints are those of the new shares.
"""

from __future__ import annotations

import numpy as np

from consilience.engine.native import NativeJoint
from consilience.engine.native.parts import inertia_of_several
from consilience.errors import InvalidInput
from consilience.mechanism import Array, check_inertia

Share = tuple[float, Array, Array]
"""Mass, centre of mass, and inertia about that centre, in axes of the drawing."""

FRACTIONS = (0.2, 0.05, 0.01, 0.002)
"""Parts of a neighbour that are taken over, tried in turn until what remains is a rigid body."""

ROUND = 1e-6
"""Least principal moment of the new body, relative to the largest."""


def between(first: NativeJoint, second: NativeJoint, base: Share | None, end: Share) -> tuple[Share, ...] | None:
    """Return the shares of base, new body and end, or None if the neighbours have nothing to give.

    Parameters
    ----------
    first, second : NativeJoint
        Joints from base to new body, and from new body to end.
    base : tuple or None
        Share of the body before; None for the ground, of which any mass may be taken.
    end : tuple
    """
    for fraction in FRACTIONS:
        of_end = _movable(second, end, fraction)
        of_base = _movable(first, base or end, fraction) if base or first.kind == "R" else (0.0, end[1], 0.0 * end[2])
        if of_end is None or of_base is None:
            return None
        middle = inertia_of_several([of_base, of_end])
        rest = _without(end, of_end)
        before = _without(base, of_base) if base else None
        if middle[0] > 0.0 and _is_round(middle) and _is_body(rest) and (before is None or _is_body(before)):
            return before or end, middle, rest
    return None


def _movable(motion: NativeJoint, share: Share, fraction: float) -> Share | None:
    """Part of a share that may lie on either side of a joint; None for joints other than hinges and slides."""
    mass, com, inertia = share
    if motion.kind == "P":
        return 0.0, com, fraction * inertia
    if motion.kind != "R":
        return None
    u = motion.axis
    foot = motion.at + u * (u @ (com - motion.at))
    return fraction * mass, foot, fraction * float(np.linalg.eigvalsh(inertia)[0]) * (np.eye(3) - np.outer(u, u))


def _without(share: Share, part: Share) -> Share:
    """Share that remains where a part is taken away."""
    (mass, com, inertia), (taken, at, tensor) = share, part
    left = mass - taken
    center = (mass * com - taken * at) / left
    return left, center, inertia + mass * _steiner(com - center) - tensor - taken * _steiner(at - center)


def _steiner(d: Array) -> Array:
    return np.asarray(d @ d * np.eye(3) - np.outer(d, d))


def _is_body(share: Share) -> bool:
    try:
        check_inertia(0.5 * (share[2] + share[2].T), "")
    except InvalidInput:
        return False
    return share[0] > 0.0


def _is_round(share: Share) -> bool:
    moments = np.linalg.eigvalsh(share[2])
    return bool(moments[0] > ROUND * moments[-1]) and _is_body(share)
