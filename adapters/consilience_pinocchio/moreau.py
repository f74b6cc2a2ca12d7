"""Motions with contacts, stops and dry friction: Pinocchio's contact solver with the harness's stepping.

One step: free velocity by Pinocchio's accelerations, forces by `Unilateral.press`, then ``q+ = q (+) h v+``. Order 1.
Extrapolated, each sample is the limit of the steps h, h/2 and h/4 (Richardson), of order 3 while no mode changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from consilience.engine import TrajectoryAnswer, joined_mode, motion_of_halved, over_parts, steps_per_sample
from consilience.mechanism import Array, continuous_in_time
from consilience_pinocchio.dynamics import articulated_body
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.observe import poses
from consilience_pinocchio.translate import Translation
from consilience_pinocchio.unilateral import SEPARATED, SLIDING, Pressed, Start, Unilateral

HALVINGS, SHORTEST = 30, 1e-4
"""Halvings that find when a contact breaks away, and the shortest part of a step: gaps are divided by its length."""

_CORRECTIONS, _SAME = 12, 1e-12
"""Corrections of the time of an impact within a step, and the last of them over the step."""


@dataclass(frozen=True, eq=False)
class _Now:
    """State of a motion.

    Attributes
    ----------
    q, v : ndarray, shape (nq,) and (nv,)
    integrals : ndarray
        Of controllers.
    impulse : ndarray, shape (n_c, 3), N s
        Of the elementary contacts since the last sample.
    loss : float, J
    modes : ndarray, shape (n_c,)
        In the last step.
    broken : frozenset of int
        Contacts that have broken away and slide.
    """

    q: Array
    v: Array
    integrals: Array
    impulse: Array
    loss: float
    modes: Array
    broken: frozenset[int] = frozenset()


def _new(hits: frozenset[int], now: _Now) -> frozenset[int]:
    """Return the hits of what did not press before: a sphere that rolls leaves its partner by the square of a step."""
    return frozenset(n for n in hits if n >= len(now.modes) or now.modes[n] == SEPARATED)


class Stepping:
    """A motion by steps, and its samples so far.

    A contact with a static coefficient slides from the instant at which it does not suffice, where a step is divided:
    the force of friction jumps, so that steps which begin to slide late, each by another part, would have no order.

    Parameters
    ----------
    translation : Translation
    q, v : ndarray, shape (nq,) and (nv,)
    t, h : float, s
    """

    def __init__(self, translation: Translation, q: Array, v: Array, t: float, h: float) -> None:
        self._translation, self._elements = translation, Elements(translation)
        self.unilateral = Unilateral(translation, self._elements)
        self._free = articulated_body(translation, self._elements)
        self._h, count = h, len(self.unilateral.touches)
        integrals = np.zeros(self._elements.efforts.control_count)
        now = _Now(q, v, integrals, np.zeros((count, 3)), 0.0, np.zeros(count, dtype=int))
        self._now, self._pressed = self._slid(now, t, h)
        hits = [n in self._pressed.hits for n in range(count)]
        self._now = replace(self._now, modes=np.where(hits, SEPARATED, self._pressed.modes))
        self.samples: list[tuple[Array, ...]] = []

    def _press(self, now: _Now, t: float, h: float) -> tuple[Pressed, frozenset[int]]:
        """Solve for the forces of a step of the length h; return also the contacts that break away in it."""
        self.unilateral.broken = now.broken
        a = self._free(now.q, now.v, t, now.integrals)
        pressed = self.unilateral.press(Start(now.q, now.v, a, t, h, self._h))
        return pressed, frozenset(n for n in self.unilateral.held if pressed.modes[n] == SLIDING)

    def _slid(self, now: _Now, t: float, h: float) -> tuple[_Now, Pressed]:
        """Let contacts slide from now on that break away in a step, and those that do where others slide; press."""
        while True:
            pressed, breaking = self._press(now, t, h)
            if not breaking:
                return now, pressed
            now = replace(now, broken=now.broken | breaking)

    def _moved(self, now: _Now, pressed: Pressed, t: float, h: float) -> _Now:
        """Return the state at the end of a step."""
        rates, v = self._elements.efforts.control_errors(now.q, t), now.v + h * pressed.a
        return _Now(
            np.asarray(pin.integrate(self._translation.model, now.q, h * v)),
            v,
            now.integrals + h * rates,
            now.impulse + h * pressed.forces,
            now.loss - h * pressed.power,
            pressed.modes,
            frozenset(n for n in now.broken if pressed.modes[n] == SLIDING),
        )

    def step(self, t: float) -> None:
        """Take one step from the time t."""
        start, pressed, part = self._past_hits(t)
        end, since = t + self._h, t + self._h - part
        now = self._moved(start, pressed, since, part)
        pressed, breaking = self._press(now, end, self._h)
        if breaking:
            now, pressed = self._slid(self._breaking_away(start, since, part), end, self._h)
        self._now, self._pressed = now, pressed

    def _past_hits(self, t: float) -> tuple[_Now, Pressed, float]:
        """Pass the impacts within a step; return the state at the last of them, its forces, and the rest of the step.

        What hits and does not rebound has its whole impulse in the rest of the step: two steps that share an impulse,
        by chance, follow a path in which a slip may stop or turn, and end elsewhere than Moreau's law.
        """
        now, pressed, end, h = self._now, self._pressed, t + self._h, self._h
        while hits := _new(pressed.hits, now):
            part, pressed = self._until(now, hits, end - h, h)
            if h - part < SHORTEST * self._h:
                break
            now, h = self._moved(now, pressed, end - h, part), h - part
            now, pressed = self._slid(now, end - h, h)
        return now, pressed, h

    def _until(self, start: _Now, hits: frozenset[int], t: float, h: float) -> tuple[float, Pressed]:
        """Return the time to the first of some impacts by Newton's method, at most h, and the forces until then.

        Others may come first where none of these act.
        """
        part, now = 0.0, start
        pin.computeJointJacobians(self._translation.model, self._translation.data, now.q)
        for _ in range(_CORRECTIONS):
            near = self.unilateral.approaching(hits, now.q, now.v)
            last, part = part, min([h, *(part - gap / rate for gap, rate in near if rate < 0.0)])
            self.unilateral.barred = hits
            pressed, _ = self._press(start, t, part)
            self.unilateral.barred = frozenset()
            earlier = _new(pressed.hits, start)
            if abs(part - last) <= _SAME * h and not earlier:
                break
            hits |= earlier
            now = self._moved(start, pressed, t, part)
            pin.computeJointJacobians(self._translation.model, self._translation.data, now.q)
        return part, pressed

    def _breaking_away(self, start: _Now, t: float, h: float) -> _Now:
        """Return the end of a step from a state, in which contacts break away and slide from then on."""

        def after(part: float) -> tuple[_Now, frozenset[int]]:
            now = self._moved(start, self._press(start, t, part * h)[0], t, part * h)
            return now, self._press(now, t + part * h, self._h)[1]

        least, part = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (least + part)
            least, part = (least, middle) if after(middle)[1] else (middle, part)
        part = max(part, SHORTEST) if part < 1.0 - SHORTEST else 1.0
        now, breaking = after(part)
        if part == 1.0:
            return now
        now = replace(now, broken=now.broken | breaking)
        t, rest = t + part * h, (1.0 - part) * h
        return self._moved(*self._slid(now, t, rest), t, rest)

    def record(self) -> None:
        """Sample the state, with the modes of the step before it."""
        now = self._now
        pin.forwardKinematics(self._translation.model, self._translation.data, now.q, now.v)
        contacts = self.unilateral.gaps(), now.impulse, now.modes, np.array(now.loss)
        self.samples.append((*poses(self._translation), *contacts))
        self._now = replace(now, impulse=np.zeros_like(now.impulse))


def move(translation: Translation, q: Array, v: Array, times: Array, step: float) -> TrajectoryAnswer:
    """Step from ``times[0]`` and sample on a uniform grid.

    Parameters
    ----------
    translation : Translation
    q, v : ndarray, shape (nq,) and (nv,)
        Initial configuration and velocity.
    times : ndarray, shape (n_t,), s
    step : float, s
        Step, which divides the interval of `times`.
    """
    every = steps_per_sample(times, step)
    h, count = float(times[1] - times[0]) / every, every * (len(times) - 1)
    stepping = Stepping(translation, q, v, float(times[0]), h)
    stepping.record()
    for n in range(count):
        stepping.step(float(times[0]) + n * h)
        if (n + 1) % every == 0:
            stepping.record()
    p, quat, v_W, w, gaps, impulses, modes, loss = (np.array(column) for column in zip(*stepping.samples, strict=True))
    mechanism = translation.mechanism
    return TrajectoryAnswer(
        np.array(times),
        p,
        continuous_in_time(quat),
        v_W,
        w,
        {"steps": count, "iterations": stepping.unilateral.solver.iterations},
        contact_gap=over_parts(mechanism, gaps, lambda of: np.min(of, axis=1)),
        contact_impulse=over_parts(mechanism, impulses, lambda of: np.sum(of, axis=1)),
        contact_mode=over_parts(mechanism, modes, joined_mode),
        contact_loss=loss,
    )


def extrapolated(translation: Translation, q: Array, v: Array, times: Array, step: float) -> TrajectoryAnswer:
    """Return the limit of the steps h, h/2 and h/4.

    Parameters
    ----------
    translation, q, v, times, step : see `move`
    """
    return motion_of_halved([move(translation, q, v, times, step / part) for part in (1, 2, 4)])
