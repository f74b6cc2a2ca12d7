"""Trajectories: Pinocchio's accelerations under the harness's integrator, for Pinocchio integrates nothing itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from consilience.harness import runge_kutta_4
from consilience.run import TrajectoryAnswer
from consilience.spatial import Array, continuous_in_time
from consilience_pinocchio.charts import ChartWatch
from consilience_pinocchio.dynamics import PROXIMAL, articulated_body, constraint_dynamics
from consilience_pinocchio.forces import Forces
from consilience_pinocchio.observe import poses
from consilience_pinocchio.translate import Translation


def _derivative(translation: Translation, forces: Forces) -> Callable[[Array], Array]:
    """Rate of ``y = (q, v)``.

    The rate of q is ``tangentMap(q) v``, a smooth function of the vector q, so that a Runge-Kutta method keeps its
    order; applying it to `pinocchio.integrate` stage by stage falls to order 2 on quaternions. Quaternions are
    normalised for the evaluation, and not in y.
    """
    model = translation.model
    loops = bool(translation.welds)
    accelerations = (
        constraint_dynamics(translation, forces, PROXIMAL) if loops else articulated_body(translation, forces)
    )
    nq = model.nq

    def one_axis_joints_only(y: Array) -> Array:
        v = y[nq:]
        return np.concatenate([v, accelerations(y[:nq], v)])

    def derivative(y: Array) -> Array:
        q, v = pin.normalize(model, y[:nq]), y[nq:]
        return np.concatenate([pin.tangentMap(model, q) @ v, accelerations(q, v)])

    return one_axis_joints_only if nq == model.nv else derivative


class _Motion:
    """An integration under way: the translation in use, y in its coordinates, and the samples so far."""

    def __init__(self, translation: Translation, forces: Forces, q: Array, v: Array) -> None:
        self.samples: list[tuple[Array, Array, Array, Array]] = []
        self.y = np.concatenate([q, v])
        self.changes = 0
        self._adopt(translation, forces)

    def _adopt(self, translation: Translation, forces: Forces) -> None:
        self.translation, self.watch = translation, ChartWatch(translation)
        self.derivative = _derivative(translation, forces)

    def split(self, y: Array) -> tuple[Array, Array]:
        nq = self.translation.model.nq
        return y[:nq], y[nq:]

    def record(self, y: Array) -> None:
        model, data = self.translation.model, self.translation.data
        q, v = self.split(y)
        pin.forwardKinematics(model, data, pin.normalize(model, q), v)
        self.samples.append(poses(self.translation))

    def change_chart_if_left(self) -> None:
        """Turn the start frames of rods whose chart is no longer good, and express the state anew."""
        q, v = self.split(self.y)
        if self.watch.left(q):
            translation, q, v = self.watch.change(q, v)
            self._adopt(translation, Forces(translation))
            self.y = np.concatenate([q, v])
            self.changes += 1


def _ignore(y: Array) -> None:
    """Record nothing: these steps end between samples."""


def integrate(
    translation: Translation, forces: Forces, q: Array, v: Array, times: Array, step: float
) -> TrajectoryAnswer:
    """Integrate from ``times[0]`` and sample on the uniform grid `times`, whose interval `step` divides."""
    motion = _Motion(translation, forces, q, v)
    interval = times[1] - times[0]
    every = round(interval / step)
    intervals, h = len(times) - 1, interval / every
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
