"""Accelerations at an instant with closed contacts, stops and dry friction, with the forces that belong to them.

Rows are those of a step in the limit of short h. There a slip s is ``s / h`` in the rows, without bound, and friction
is along it. In its place is a finite acceleration along s, larger than all others, and the acceleration across s of the
last solution is taken away, until it does not change: then friction is exactly along s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from consilience.mechanism import Array, contact_parts
from consilience_pinocchio.cones import ENOUGH_AT_INSTANT
from consilience_pinocchio.dynamics import Solution, articulated_body, collected, multiplier_wrenches
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.touching import Nearest, Touch
from consilience_pinocchio.translate import Translation
from consilience_pinocchio.unilateral import AT_REST, CLOSED, Pressed, Start, Unilateral

FAST = 30.0
"""Acceleration that stands for a slip over a short step, relative to the largest other one."""

UNCHANGED, NOISE = 1e-14, 1e-9
"""Change of these accelerations, relative to `FAST` ones, at which they are the last, at once or if it grows again."""

MOST_SOLUTIONS = 40


@dataclass(frozen=True, eq=False)
class _Instant(Start):
    """Instant, as the start of a step of the length 1.

    Attributes
    ----------
    slide : float, m/s^2
        Stands for a slip, or the rate of a coordinate, over a short step.
    across : dict
        Accelerations (2,) to take away in the tangential rows of contacts, by number.
    """

    slide: float
    across: dict[int, Array]

    def needed(self, gap: float, along: Array, restitution: float) -> float | None:
        """Return minus the rate of a closed gap, None for an open one or one that opens."""
        u = float(along @ self.v)
        if gap > CLOSED or u > CLOSED:
            return None
        if u < -CLOSED:
            raise ArithmeticError(f"a closed gap closes at {-u:.3g}: an impact, which has no accelerations")
        return -u

    def contact(self, number: int, touch: Touch, nearest: Nearest, needed: float) -> Array:
        """Return the accelerations in the rows of a contact without its forces, shape (3,)."""
        rates = nearest.J @ self.a + touch.bias(nearest)
        rates[:2] += self.slide * _direction(nearest, self.v) - self.across.get(number, np.zeros(2))
        return np.asarray(rates)

    def joint(self, along: Array) -> float:
        """Return the acceleration of a coordinate without its friction."""
        rate = float(along @ self.v)
        return float(along @ self.a) + (self.slide * float(np.sign(rate)) if abs(rate) > AT_REST else 0.0)


def _direction(nearest: Nearest, v: Array) -> Array:
    """Return the unit vector (2,) of the slip in the tangents, zero at rest."""
    slip = nearest.J[:2] @ v
    speed = float(np.linalg.norm(slip))
    return slip / speed if speed > AT_REST else np.zeros(2)


def _solve(unilateral: Unilateral, q: Array, v: Array, a: Array) -> Pressed:
    """Solve until friction is along the slip of all contacts that slide.

    Raises
    ------
    ArithmeticError
        It does not get there.
    """
    slide, across = FAST * max(1.0, float(np.max(np.abs(a), initial=0.0))), dict[int, Array]()
    unilateral.solver.enough, last = ENOUGH_AT_INSTANT, np.inf
    for _ in range(MOST_SOLUTIONS):
        found = unilateral.press(_Instant(q, v, a, 0.0, 1.0, 1.0, slide, across))
        rates = unilateral.dry_rates(v)
        slow = bool(np.any((np.abs(rates) > AT_REST) & (found.dry_ends * np.sign(rates) < 0.5 * slide)))
        change = 0.0
        for (n, nearest), end in zip(found.touched.items(), found.ends, strict=True):
            along = _direction(nearest, v)
            if not np.any(along):
                continue
            slow |= bool(along @ end[:2] < 0.5 * slide)
            before = across.get(n, np.zeros(2))
            rate = end[:2] - slide * along + before
            across[n] = rate - along * (along @ rate)
            change = max(change, float(np.max(np.abs(across[n] - before))))
        if slow:
            slide, last = 10.0 * slide, np.inf
        elif change <= UNCHANGED * slide or (change >= last and change <= NOISE * slide):
            return found
        else:
            last = change
    raise ArithmeticError(f"friction does not settle along the slip: it changes by {change:.1e} m/s^2")


def settle(translation: Translation, elements: Elements, q: Array, v: Array) -> tuple[Solution, Array]:
    """Solve for the accelerations at time zero by Pinocchio's contact solver.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    q, v : ndarray, shape (nq,) and (nv,)

    Returns
    -------
    Solution
    ndarray, shape (n_c, 3), N
        Forces of the declared contacts on their bodies, world axes.
    """
    unilateral = Unilateral(translation, elements)
    free = articulated_body(translation, elements)(q, v, 0.0, np.zeros(elements.efforts.control_count))
    pressed = _solve(unilateral, q, v, free)
    welded = 6 * len(translation.welds)
    lam = pressed.multipliers[: welded + elements.rows.count]
    pin.forwardKinematics(translation.model, translation.data, q)
    weld_wrenches = multiplier_wrenches(translation, lam)
    solution = collected(translation, elements, (q, v, pressed.a), weld_wrenches, lam[welded:])
    for n, nearest in pressed.touched.items():
        touch = unilateral.touches[n]
        for side, sign in ((touch.body, 1.0), (touch.partner, -1.0)):
            solution.wrenches[side.link] += side.wrench(nearest.point, sign * pressed.forces[n])
    sizes = [len(contact_parts(contact)) for contact in translation.mechanism.contacts]
    forces = np.zeros((len(sizes), 3))
    np.add.at(forces, np.repeat(np.arange(len(sizes)), sizes), pressed.forces)
    return replace(solution, tau=solution.tau + pressed.efforts), forces
