"""Trajectories by Pinocchio's accelerations and the harness's integrator; Pinocchio has no integrator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from consilience.engine import TrajectoryAnswer, runge_kutta_4, steps_per_sample
from consilience.mechanism import Array, continuous_in_time
from consilience_pinocchio.charts import ChartWatch
from consilience_pinocchio.contacts import Contacts, hold_all
from consilience_pinocchio.dynamics import (
    PROXIMAL,
    Accelerations,
    articulated_body,
    constraint_dynamics,
    forward_dynamics,
)
from consilience_pinocchio.elements import Elements
from consilience_pinocchio.observe import poses
from consilience_pinocchio.translate import Translation


def _accelerations(translation: Translation, elements: Elements) -> Accelerations:
    if not hold_all(translation):
        return forward_dynamics(translation, elements, PROXIMAL)
    if translation.welds or elements.rows.count:
        return constraint_dynamics(Contacts(translation, elements), elements, PROXIMAL)
    return articulated_body(translation, elements)


def _derivative(translation: Translation, elements: Elements, end: float) -> Callable[[Array], Array]:
    """Return the rate of ``y = (q, v, t, integrals of the controllers)`` as a function.

    The rate of q is ``tangentMap(q) v``, a smooth function of the vector q, so that a Runge-Kutta method keeps its
    order; stages by `pinocchio.integrate` reduce the order to 2 on quaternions. Quaternions are normalised for the
    evaluation, and not in y. The time is a component of y, so that each stage has its own time. The time is limited to
    `end`, because rounding may carry it beyond the end of a table.
    """
    model, efforts = translation.model, elements.efforts
    accelerations = _accelerations(translation, elements)
    nq, nt = model.nq, model.nq + model.nv
    only_time = np.ones(1)

    def rest(q: Array, t: float) -> Array:
        """Rates of the time and of the integrals of the controllers."""
        return np.concatenate([only_time, efforts.control_errors(q, t)]) if efforts.control_count else only_time

    def one_axis_joints_only(y: Array) -> Array:
        q, v, t = y[:nq], y[nq:nt], min(float(y[nt]), end)
        return np.concatenate([v, accelerations(q, v, t, y[nt + 1 :]), rest(q, t)])

    def derivative(y: Array) -> Array:
        q, v, t = pin.normalize(model, y[:nq]), y[nq:nt], min(float(y[nt]), end)
        return np.concatenate([pin.tangentMap(model, q) @ v, accelerations(q, v, t, y[nt + 1 :]), rest(q, t)])

    return one_axis_joints_only if nq == model.nv else derivative


class _Motion:
    """State of an integration: the translation in use, y in its coordinates, and the samples so far.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    q, v : ndarray, shape (nq,) and (nv,)
        Initial configuration and velocity.
    times : ndarray, shape (n_t,), s
    """

    def __init__(self, translation: Translation, elements: Elements, q: Array, v: Array, times: Array) -> None:
        self.samples: list[tuple[Array, Array, Array, Array]] = []
        self.y = np.concatenate([q, v, times[:1], np.zeros(elements.efforts.control_count)])
        self.end = float(times[-1])
        self.changes = 0
        self._adopt(translation, elements)

    def _adopt(self, translation: Translation, elements: Elements) -> None:
        self.translation, self.watch = translation, ChartWatch(translation)
        self.derivative = _derivative(translation, elements, self.end)

    def split(self, y: Array) -> tuple[Array, Array, Array]:
        """Split y into q, v and the rest."""
        nq, nt = self.translation.model.nq, self.translation.model.nq + self.translation.model.nv
        return y[:nq], y[nq:nt], y[nt:]

    def record(self, y: Array) -> None:
        model, data = self.translation.model, self.translation.data
        q, v, _ = self.split(y)
        pin.forwardKinematics(model, data, pin.normalize(model, q), v)
        self.samples.append(poses(self.translation))

    def change_chart_if_left(self) -> None:
        """Turn the start frames of rods near their singular poses, and transform the state."""
        q, v, rest = self.split(self.y)
        if self.watch.left(q):
            translation, q, v = self.watch.change(q, v)
            self._adopt(translation, Elements(translation))
            self.y = np.concatenate([q, v, rest])
            self.changes += 1


def _ignore(y: Array) -> None:
    """Record nothing at steps that end between samples."""


def integrate(
    translation: Translation, elements: Elements, q: Array, v: Array, times: Array, step: float
) -> TrajectoryAnswer:
    """Integrate from ``times[0]`` and sample on a uniform grid.

    Parameters
    ----------
    translation : Translation
    elements : Elements
    q, v : ndarray, shape (nq,) and (nv,)
        Initial configuration and velocity.
    times : ndarray, shape (n_t,), s
    step : float, s
        Step, which divides the interval of `times`.
    """
    motion = _Motion(translation, elements, q, v, np.asarray(times))
    every = steps_per_sample(times, step)
    intervals, h = len(times) - 1, (times[1] - times[0]) / every
    if motion.watch.needed:
        motion.record(motion.y)
        for n in range(1, every * intervals + 1):
            motion.y = runge_kutta_4(motion.derivative, motion.y, h, 1, _ignore, 1)
            motion.change_chart_if_left()
            if n % every == 0:
                motion.record(motion.y)
    else:
        runge_kutta_4(motion.derivative, motion.y, h, every * intervals, motion.record, every)
    p, quat, v, w = (np.array(column) for column in zip(*motion.samples, strict=True))
    steps = every * intervals
    counters: dict[str, int | float] = {"steps": steps, "accelerations": 4 * steps, "chart changes": motion.changes}
    return TrajectoryAnswer(np.array(times), p, continuous_in_time(quat), v, w, counters)
