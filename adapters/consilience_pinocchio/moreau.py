"""Motions with contacts, stops and dry friction: Pinocchio's contact solver with the harness's stepping.

One step: free velocity by Pinocchio's accelerations, forces by `Unilateral.press`, then ``q+ = q (+) h v+``. Order 1.
Extrapolated, each sample is the limit of the steps h, h/2 and h/4 (Richardson), of order 3 while no mode changes.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from consilience.engine import TrajectoryAnswer, joined_mode, motion_of_halved, over_parts, steps_per_sample
from consilience.mechanism import Array, continuous_in_time
from consilience_pinocchio.dynamics import articulated_body
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.observe import poses
from consilience_pinocchio.translate import Translation
from consilience_pinocchio.unilateral import Pressed, Start, Unilateral


class Stepping:
    """State of a motion by steps, its samples so far, and sums since the last sample.

    Parameters
    ----------
    translation : Translation
    q, v : ndarray, shape (nq,) and (nv,)
    h : float, s
    """

    def __init__(self, translation: Translation, q: Array, v: Array, h: float) -> None:
        self._translation, self._elements = translation, Elements(translation)
        self.unilateral = Unilateral(translation, self._elements)
        self._free = articulated_body(translation, self._elements)
        self._q, self._v, self._h = q, v, h
        self._integrals = np.zeros(self._elements.efforts.control_count)
        self._impulse = np.zeros((len(self.unilateral.touches), 3))
        self._loss = 0.0
        self.samples: list[tuple[Array, ...]] = []

    def press(self, t: float) -> Pressed:
        """Solve for the forces of a step from the present state."""
        a = self._free(self._q, self._v, t, self._integrals)
        return self.unilateral.press(Start(self._q, self._v, a, t, self._h))

    def step(self, t: float) -> Pressed:
        """Take one step from the time t."""
        rates, pressed, h = self._elements.efforts.control_errors(self._q, t), self.press(t), self._h
        self._v = self._v + h * pressed.a
        self._q = np.asarray(pin.integrate(self._translation.model, self._q, h * self._v))
        self._integrals = self._integrals + h * rates
        self._impulse += h * pressed.forces
        self._loss -= h * pressed.power
        return pressed

    def record(self, modes: Array) -> None:
        """Sample the state, with the modes of the step before it."""
        pin.forwardKinematics(self._translation.model, self._translation.data, self._q, self._v)
        contacts = self.unilateral.gaps(), self._impulse, modes, np.array(self._loss)
        self.samples.append((*poses(self._translation), *contacts))
        self._impulse = np.zeros_like(self._impulse)


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
    stepping = Stepping(translation, q, v, h)
    stepping.record(stepping.press(float(times[0])).modes)
    for n in range(count):
        modes = stepping.step(float(times[0]) + n * h).modes
        if (n + 1) % every == 0:
            stepping.record(modes)
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
