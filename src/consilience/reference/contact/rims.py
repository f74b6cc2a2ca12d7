"""Discs that come parallel to their planes: there the lowest point of the rim is open, and the law of contact with it.

With the axis a of a disc and the normal n of its plane, the part ``m = a - (n . a) n`` has the length ``sin(tilt)``
and points to the lowest point of the rim, or away from it. As a disc comes flat, m passes through zero and the lowest
point jumps across the disc. What follows is an impact along the rim, for which a contact at one point has no law; the
velocities projected onto the new lowest point would lose energy that no impact has told.
"""

from __future__ import annotations

import numpy as np
import scipy

from consilience.errors import NumericalFailure
from consilience.mechanism import TOUCHING, Array, cross, rotation_from_quaternion
from consilience.reference.contact.events import nodes_of
from consilience.reference.contact.layout import RowLayout
from consilience.reference.contact.pairs import DISC
from consilience.reference.contact.row_modes import RowModes
from consilience.reference.contact.stepper import Stepper


class Rims:
    """Rims of the discs of a motion.

    The integration leaves an orientation open by its tolerance, and so the direction of the lowest point of a rim by
    the tolerance over the tilt. A rim that touches counts as flat from the tilt at which half of the digits asked for
    are left of that direction: the square root of the tolerance. Above it, a disc that tilts at the rate q moves its
    lowest point across within the time ``tilt/q``: steps are shortened until it turns by less than a right angle from
    node to node, as a longer step would not see it move. In flight the rim has no force, and is flat only below
    `TOUCHING`, the tilt that a start is refused for.

    Attributes
    ----------
    least : float
        Sine of the tilt of a rim that is flat as it touches.
    """

    def __init__(self, layout: RowLayout, span: float, tolerance: float) -> None:
        self.least, self._span, self._layout = max(TOUCHING, float(np.sqrt(tolerance))), span, layout
        self._discs = np.flatnonzero(layout.pairs["kind"] == DISC).tolist()

    def keep_clear(self, stepper: Stepper) -> None:
        """Shorten the last step until rims that touch are flat at its end at most, and turn slowly from node to node.

        Raises
        ------
        NumericalFailure
            Where a lowest point turns faster than the time resolves.
        """
        for k in self._discs:
            while self._touches(stepper.modes, k):
                nodes, m, size = self._nodes(stepper, k)
                flat = np.flatnonzero(size <= self.least)
                jumps = np.flatnonzero(np.sum(m[1:] * m[:-1], axis=1) <= 0.0)
                if not len(jumps) and (not len(flat) or flat[0] == len(nodes) - 1):
                    break
                if len(flat) and not np.any(jumps < flat[0]):
                    end = float(nodes[flat[0]])
                else:
                    end = float(nodes[jumps[0]]) if jumps[0] else 0.5 * float(nodes[0] + nodes[1])
                if not stepper.started < end < stepper.t:
                    raise self._flat(k, stepper.started, float(size[0]))
                stepper.go_back_to(end, lambda: False)

    def refuse_flat(self, stepper: Stepper) -> None:
        """Refuse a last step in which a disc is parallel to its plane.

        Raises
        ------
        NumericalFailure
        """
        for k in self._discs if stepper.started < stepper.t else ():
            nodes, m, size = self._nodes(stepper, k)
            if self._touches(stepper.modes, k):
                flat = np.flatnonzero(size <= self.least)
                if len(flat):
                    raise self._flat(k, self._when_flat(stepper, k, float(nodes[flat[0]])), self.least)
                continue
            found = list(zip(nodes.tolist(), size.tolist(), strict=True))
            jumps = np.flatnonzero(np.sum(m[1:] * m[:-1], axis=1) < 0.0)
            found += [self._nearest(stepper, k, nodes[j : j + 2]) for j in jumps]
            for t, tilt in found:
                if tilt <= TOUCHING:
                    raise self._flat(k, t, TOUCHING)

    def _nodes(self, stepper: Stepper, k: int) -> tuple[Array, Array, Array]:
        """Return the times of the nodes of the last step, m of disc k there, and its lengths."""
        nodes = nodes_of(stepper.started, stepper.t, self._span)
        m = self._leans(nodes, stepper, k)
        return nodes, m, np.linalg.norm(m, axis=1)

    def _nearest(self, stepper: Stepper, k: int, ends: Array) -> tuple[float, float]:
        """Return when disc k is nearest to flat between two times, and the sine of its tilt there."""
        (t0, t1), (m0, m1) = ends, self._leans(ends, stepper, k)
        along = (m1 - m0) / np.linalg.norm(m1 - m0)

        def passed(t: float) -> float:
            return float(self._leans(np.array([t]), stepper, k)[0] @ along)

        t = float(scipy.optimize.brentq(passed, t0, t1, xtol=1e-300))
        return t, float(np.linalg.norm(self._leans(np.array([t]), stepper, k)))

    def _touches(self, modes: RowModes, k: int) -> bool:
        """Return whether pair k is closed or pressed."""
        layout = self._layout
        if k in layout.springs:
            return bool(modes.pressed[layout.springs.index(k)])
        return bool(modes.closed[layout.normals.index(3 * k)])

    def _leans(self, times: Array, stepper: Stepper, k: int) -> Array:
        """Return the part of the axis of disc k in its plane at times within the last step, axes of the plane's body.

        Shape (n, 3).
        """
        pair, states = self._layout.pairs[k], stepper.between(times)
        axis = _turning(states, int(pair["body"])) @ pair["axis"]
        axis = np.einsum("nji,nj->ni", _turning(states, int(pair["partner"])), axis)
        return np.asarray(axis - np.outer(axis @ pair["normal"], pair["normal"]))

    def _when_flat(self, stepper: Stepper, k: int, t: float) -> float:
        """Return when m of disc k is nearest to zero as it goes on in a straight line from a time in the last step."""
        pair, y, spin = self._layout.pairs[k], stepper.between(np.array([t]))[0], np.zeros(3)
        for body, sign in ((int(pair["body"]), 1.0), (int(pair["partner"]), -1.0)):
            if body >= 0:
                spin += sign * (_turning(y[None], body)[0] @ y[body, 10:13])
        back = _turning(y[None], int(pair["partner"]))[0].T
        m, axis = self._leans(np.array([t]), stepper, k)[0], _turning(y[None], int(pair["body"]))[0] @ pair["axis"]
        rate = back @ cross(spin, axis)
        rate -= (rate @ pair["normal"]) * pair["normal"]
        return t - float(m @ rate / (rate @ rate)) if np.any(rate) else t

    def _flat(self, k: int, t: float, tilt: float) -> NumericalFailure:
        """Return what tells that disc k comes flat at a time, to within a tilt."""
        return NumericalFailure(
            f"contact '{self._layout.parts[k].name}', t = {t:.12g} s: the disc comes parallel to its plane, to within "
            f"{tilt:.2g} rad: which point of its rim is the lowest is open there, and what follows is no contact at "
            "one point"
        )


def _turning(states: Array, body: int) -> Array:
    """Return the rotation matrices of a body at packed states, shape (n, 3, 3); of the ground they are ones."""
    if body < 0:
        return np.broadcast_to(np.eye(3), (len(states), 3, 3))
    quat = states[:, body, 3:7]
    return rotation_from_quaternion(quat / np.linalg.norm(quat, axis=1, keepdims=True))
