"""Trajectories: Pinocchio's accelerations under the harness's integrator, for Pinocchio integrates nothing itself."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from consilience.harness import runge_kutta_4
from consilience.run import TrajectoryAnswer
from consilience.spatial import Array, continuous_in_time
from consilience_pinocchio.dynamics import articulated_body, constraint_dynamics
from consilience_pinocchio.forces import Forces
from consilience_pinocchio.observe import poses
from consilience_pinocchio.translate import Translation


def integrate(
    translation: Translation, forces: Forces, q0: Array, v0: Array, times: Array, step: float
) -> TrajectoryAnswer:
    """Integrate ``y = (q, v)`` from ``times[0]`` and sample it on `times`.

    The rate of q is ``tangentMap(q) v``, a smooth function of the vector q, so that the method keeps its order:
    applying it to `pinocchio.integrate` stage by stage falls to order 2 on quaternions. Quaternions are normalised
    before each evaluation, and not in y.
    """
    model, data = translation.model, translation.data
    solver = constraint_dynamics if translation.welds else articulated_body
    accelerations = solver(translation, forces)
    nq = model.nq

    def derivative(y: Array) -> Array:
        v = y[nq:]
        if nq == model.nv:  # one-axis joints only
            return np.concatenate([v, accelerations(y[:nq], v)])
        q = pin.normalize(model, y[:nq])
        return np.concatenate([pin.tangentMap(model, q) @ v, accelerations(q, v)])

    interval = times[1] - times[0]
    every = round(interval / step)
    steps = every * (len(times) - 1)
    samples: list[Array] = []
    runge_kutta_4(derivative, np.concatenate([q0, v0]), interval / every, steps, samples.append, every)
    rows = []
    for y in samples:
        pin.forwardKinematics(model, data, pin.normalize(model, y[:nq]), y[nq:])
        rows.append(poses(translation))
    p, quat, v, w = (np.array(column) for column in zip(*rows, strict=True))
    counters: dict[str, int | float] = {"steps": steps, "accelerations": 4 * steps}
    return TrajectoryAnswer(np.array(times), p, continuous_in_time(quat), v, w, counters)
