"""Routes by MuJoCo: its RK4, plain and extrapolated, and its accelerations with integrators of high order."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import mujoco
import numpy as np
from routes import HIGH_ORDER, TOLERANCES, Integrator, Route, extrapolated, steps

from consilience.case import Case
from consilience.engine import Question
from consilience.mechanism import Array
from consilience_mujoco.callback import answering
from consilience_mujoco.engine import MujocoEngine
from consilience_mujoco.evaluate import constraint_rank
from consilience_mujoco.messages import warnings_raise
from consilience_mujoco.methods import configured
from consilience_mujoco.states import set_state
from consilience_mujoco.translate import Translation, translate


def _quaternions(model) -> list[tuple[int, int]]:
    """Return the indices in qpos and qvel of each quaternion and of its angular velocity, in body axes."""
    first = {mujoco.mjtJoint.mjJNT_BALL: 0, mujoco.mjtJoint.mjJNT_FREE: 3}
    return [
        (int(model.jnt_qposadr[j]) + first[kind], int(model.jnt_dofadr[j]) + first[kind])
        for j, kind in enumerate(model.jnt_type)
        if kind in first
    ]


class Motion:
    """A compiled model at the start of a case.

    Parameters
    ----------
    cut : bool
        Reduce dependent constraint rows to their rank, by a callback in Python at every stage, as the adapter does.
        Planar loops need no reduction: their dependent rows are zero.
    """

    def __init__(self, case: Case, translation: Translation, cut: bool) -> None:
        self.translation, self.rank, self.times = translation, None, case.times
        model, data = translation.model, translation.data
        set_state(translation, case.initial_state)
        self.q, self.v = data.qpos.copy(), data.qvel.copy()
        if model.neq and cut:
            with warnings_raise(), answering(translation):
                mujoco.mj_forward(model, data)
            rank, rows = constraint_rank(translation)
            self.rank = rank if rank < rows else None

    def steps(self, count: int) -> Array:
        """Integrate with MuJoCo's integrator, `count` steps for each sample interval in one call."""
        model, data = self.translation.model, self.translation.data
        model.opt.timestep = self.times[1] / count
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = self.q, self.v
        motion = [self.q]
        with warnings_raise(), answering(self.translation, self.rank):
            for t in self.times[:-1]:
                data.time = t
                mujoco.mj_step(model, data, count)
                motion.append(data.qpos.copy())
        return np.array(motion)

    def high_order(self, integrator: Integrator, tolerance: float) -> Array:
        """Integrate the accelerations of `mj_forward` by a method of high order."""
        model, data = self.translation.model, self.translation.data
        nq, turning = model.nq, _quaternions(model)
        plain = np.array([k for k in range(nq) if not any(q <= k < q + 4 for q, _ in turning)], dtype=int)
        rates = np.array([k for k in range(model.nv) if not any(v <= k < v + 3 for _, v in turning)], dtype=int)
        rate, quat, qpos, qvel, qacc = np.empty(nq + model.nv), np.empty(4), data.qpos, data.qvel, data.qacc
        forward = mujoco.mj_forward

        def derivative(t: float, y: Array) -> Array:
            data.time = t
            qpos[:], qvel[:] = y[:nq], y[nq:]
            forward(model, data)
            rate[plain], rate[nq:] = qvel[rates], qacc
            for q, v in turning:
                mujoco.mju_derivQuat(quat, qpos[q : q + 4], qvel[v : v + 3])
                rate[q : q + 4] = quat
            return rate

        mujoco.mj_resetData(model, data)
        with warnings_raise(), answering(self.translation, self.rank):
            return integrator(derivative, np.concatenate([self.q, self.v]), self.times, tolerance)[:, :nq]

    def positions(self, motion: Array) -> Array:
        """Return the origins of the bodies."""
        t, found = self.translation, []
        for q in motion:
            t.data.qpos[:] = q
            mujoco.mj_kinematics(t.model, t.data)
            found.append(t.data.site_xpos[t.body_site].copy())
        return np.array(found)


def routes(case: Case) -> Iterator[Route]:
    """Return the routes of a case."""
    engine = MujocoEngine()
    if engine.unsupported(case.mechanism, Question.TRAJECTORY) or case.mechanism.controls:
        return
    method = engine.methods(case.mechanism, Question.TRAJECTORY)[0]
    translation = configured(translate(case.mechanism), method)
    motions = [Motion(case, translation, cut=False)]
    cut = Motion(case, translation, cut=True)
    if cut.rank is not None:
        motions.append(cut)
    for motion in motions:
        how = "" if motion.rank is None else ", rows cut"
        rk4 = Route("MuJoCo", f"RK4{how}", True, steps(case), motion.steps, motion.positions)
        yield rk4
        yield extrapolated(rk4, (1, 2), (4,))
        yield extrapolated(rk4, (2, 3, 4), (4, 5))
        yield extrapolated(rk4, (2, 3, 4, 6), (4, 5, 6))
        for name, integrator in HIGH_ORDER.items():
            run = partial(motion.high_order, integrator)
            yield Route("MuJoCo", f"mj_forward{how} + {name}", False, TOLERANCES, run, motion.positions)
