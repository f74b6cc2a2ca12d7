"""Headings of discs that slide, from step to step: they follow the slip, or are kept while it goes along a line.

Slip across a heading decays at the rate ``mu N / |u|`` over an inertia: it is stiff, and stiffer the slower the slip.
Along a line there is no such slip, and a heading that is kept asks for no short steps. What starts to slide starts
along a line. Where it then turns while friction is far stronger than what is left to accelerate it, steps are implicit.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from consilience.errors import NumericalFailure
from consilience.mechanism import Array
from consilience.reference.contact.equations import ContactEquations
from consilience.reference.contact.problem import in_words
from consilience.reference.contact.quiet_steps import SLOW, STARTING, STILL, STOPPING, STRAIGHT
from consilience.reference.contact.stepper import Stepper

STOPPED = 1e-9
"""Slip across the heading with which a contact stops, over the same."""

_STIFF = 100.0  # acceleration by friction over that of the slip, from which steps are implicit
_STABLE = 4.0  # decay of slip across its heading in a step, from which explicit steps are short by that alone
_FIRST = 0.05  # part of a step that is repeated where a line is left: slip along a curve asks for shorter ones
_NEAR, _MOST = 4e-6, 5000
"""Time, over the longest step, and number of steps within it, from which on slips turn without end."""

_AWAY = 0.5  # cosine of the angle to its slip from which on a heading has to follow; at zero it would point back


class SlipHeadings:
    """Headings of a motion; the slip below which each is kept is `ContactEquations.held`, infinite along a line."""

    def __init__(self, equations: ContactEquations) -> None:
        self._equations, self._friction = equations, equations.layout.friction
        self._began: dict[int, float] = {}  # slips at the start of the step
        self.leaving: set[int] = set()  # what leaves its line there
        self._since, self._taken = -np.inf, 0  # time and number of steps from which on steps are counted
        self._rising: set[int] = set()  # what has started to slide and is slower yet than what stops

    def begin(self, started: Collection[int], speed: float) -> None:
        """Begin with modes in which some friction sets start to slide; `speed` is that of the mechanism, m/s."""
        self._equations.held[:] = STOPPING * speed
        self._equations.held[list(started)] = np.inf
        self._rising = set(started)

    def _slips(self, stepper: Stepper) -> list[tuple[int, Array]]:
        """Return the friction sets that slide in a plane on a disc, with their slips, shape (2,)."""
        if not any(h is not None and len(h) == 2 for h in stepper.modes.heading):
            return []
        rows = self._equations.move(stepper.t, stepper.y, stepper.turns)
        return [
            (j, rows.u[list(one.rows)])
            for j, (one, h) in enumerate(zip(self._friction, stepper.modes.heading, strict=True))
            if h is not None and len(h) == 2 and one.facets == 0
        ]

    def turn(self, stepper: Stepper, most: float, speed: float) -> None:
        """Let headings follow the slips at the end of the last step; those of a line are kept.

        Slips are small beside `speed`, and may be stiff beside `most`, the speed of the mechanism so far, m/s.

        Raises
        ------
        NumericalFailure
            Time hardly passes: slips turn without end.
        """
        heading, slips, held = list(stepper.modes.heading), self._slips(stepper), self._equations.held
        self._refuse_crawl(stepper, [self._friction[j].name for j, _ in slips])
        for j, slip in slips:
            size, h = float(np.linalg.norm(slip)), self._equations.heading(j)
            heading[j], self._began[j] = h, size
            if j in self.leaving:
                held[j] = STOPPING * speed
            if size > STOPPED * speed:
                self._rising.discard(j)
            if size > max(held[j], STILL * speed):
                straight = _across(slip, h) <= STRAIGHT * size and j not in self.leaving
                straight &= not stepper.fresh or size <= SLOW * speed  # in modes that begin no slip has turned yet
                held[j] = np.inf if straight else STOPPING * speed
                heading[j] = slip / size if j in self.leaving else direction(slip, h, float(held[j]))
        if slips:
            stepper.turn(tuple(heading))
        self.leaving.clear()
        stepper.slow = self._stiff_slip(stepper, most)

    def _refuse_crawl(self, stepper: Stepper, names: list[str]) -> None:
        """Refuse slips that turn in so many steps that the motion would not end."""
        t, taken = stepper.t, stepper.counters["steps"]
        if not names or t > self._since + _NEAR * stepper.longest:
            self._since, self._taken = t, taken
        elif taken - self._taken > _MOST:
            raise NumericalFailure(
                f"{in_words(names)}, t = {t:.12g} s: slips turn and stop in {_MOST} steps while time hardly passes, as "
                "where contacts of one body come to rest under compliance; end the motion before, or let fewer of them "
                "have friction"
            )

    def turned(self, stepper: Stepper, speed: float) -> bool:
        """Return whether slip has turned away from its heading by the end of the last step."""
        for j, slip in self._slips(stepper):
            size, held = float(np.linalg.norm(slip)), float(self._equations.held[j])
            if size > max(held, STOPPED * speed) and slip @ self._equations.heading(j) < _AWAY * size:
                return True
        return False

    def leaves_line(self, stepper: Stepper, speed: float) -> float | None:
        """Return the time at which to end the last step instead, as a slip has left its line within it; or None.

        What has started to slide leaves its line at `STARTING`, any other at once.
        """
        held, back, freed = self._equations.held, None, False
        for j, slip in self._slips(stepper):
            size, least = float(np.linalg.norm(slip)), STARTING * speed
            off = _across(slip, self._equations.heading(j)) > max(stepper.straight * size, STILL * speed)
            if held[j] < np.inf or not off or size <= 2.0 * least:
                continue
            if self._began.get(j, 0.0) < least:
                self.leaving.add(j)
                t = stepper.started + (stepper.t - stepper.started) * float(np.sqrt(least / size))
            else:
                held[j], t = STOPPING * speed, stepper.started + _FIRST * (stepper.t - stepper.started)
                freed = True
            back = t if back is None else min(back, t)
        if freed:
            stepper.turn(stepper.modes.heading)
        return back

    def _stiff_slip(self, stepper: Stepper, speed: float) -> float:
        """Return the slowest slip that may turn and accelerates far less than friction alone would make it, or zero."""
        slow = {
            j: float(np.linalg.norm(slip))
            for j, slip in self._slips(stepper)
            if np.isfinite(self._equations.held[j]) and float(np.linalg.norm(slip)) < SLOW * speed
        }
        if not slow:
            return 0.0
        response, force = stepper.respond(stepper.t, stepper.y), stepper.forces()
        a = response.accelerations(force)
        rows = {j: list(self._friction[j].rows) for j in slow}
        made = {j: float(np.linalg.norm(response.K[at] @ (response.K[at].T @ force[at]))) for j, at in rows.items()}
        least = {j: _STIFF * float(np.linalg.norm(a[at])) for j, at in rows.items()}
        if self.several(stepper) and stepper.t > stepper.started:  # errors of short steps accelerate what hardly slips
            least = {j: min(least[j], _STABLE * slow[j] / (stepper.t - stepper.started)) for j in rows}
        stiff = [j for j in rows if made[j] > least[j]]
        return min((slow[j] for j in stiff), default=0.0)

    def several(self, stepper: Stepper) -> bool:
        """Return whether several friction sets on discs act."""
        modes = zip(self._friction, stepper.modes.friction, strict=True)
        return sum(one.is_disc and mode is not None for one, mode in modes) > 1

    def slow(self, stepper: Stepper, speed: float) -> list[int]:
        """Return the friction sets whose slip makes the motion stiff, if it is to turn."""
        return [j for j, slip in self._slips(stepper) if float(np.linalg.norm(slip)) < SLOW * speed]

    def starting(self, stepper: Stepper, speed: float) -> bool:
        """Return whether something slides more slowly than what stops."""
        return any(float(np.linalg.norm(slip)) <= STOPPED * speed for _, slip in self._slips(stepper))

    def halted(self, stepper: Stepper, speed: float) -> int | None:
        """Return a friction set that has slipped to a halt along a curve."""
        slow = [
            (j, slip)
            for j, slip in self._slips(stepper)
            if j not in self._rising and max(float(np.linalg.norm(slip)), self._equations.held[j]) < STOPPED * speed
        ]
        if not slow:
            return None
        response, force = stepper.respond(stepper.t, stepper.y), stepper.forces()
        a = response.accelerations(force)
        every = [row for j in self._equations.acting for row in self._friction[j].rows]
        h = STOPPED * speed / max(float(np.max(np.abs(one[every]))) for one in (response.free, a))
        for j, slip in slow:  # of several, what others move lasts though it is slow: it has to stop in a small step
            slows = -float(slip @ a[list(self._friction[j].rows)])
            if slows > (float(slip @ slip) / h if self.several(stepper) else 0.0):
                return j
        return None


def _across(slip: Array, heading: Array) -> float:
    """Return the speed of a slip across a heading, shapes (2,)."""
    return abs(float(heading[0] * slip[1] - heading[1] * slip[0]))


def direction(slip: Array, heading: Array, held: float) -> Array:
    """Return the direction of sliding, shape (2,), continued through zero speed: the side of `heading` is kept.

    Below the speed `held`, m/s, it is the heading: of zero speed rounding would decide.
    """
    speed = float(np.hypot(slip[0], slip[1]))
    if speed <= held:
        return heading
    return np.asarray(slip / (speed if slip @ heading >= 0.0 else -speed))
