"""Origin of any case: Newton-Euler in maximal coordinates (`truth`), by SciPy's DOP853, projected on the constraints.

Each simulated second costs seconds, so that values from this origin are asked early in the motion. Turns are not
counted, and integrals of controllers are not computed.
"""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

import truth
from consilience.case import read_motion, read_start
from consilience.engine import InstantAnswer, TrajectoryAnswer
from consilience.mechanism import State, constraint_jacobian, constraint_rates, constraint_residual, quaternion_product

TOLERANCE = 1e-11


def _unpack(y, n):
    p, quat, v, w = np.split(y, [3 * n, 7 * n, 10 * n])
    quat = quat.reshape(n, 4)
    return State(p.reshape(n, 3), quat / np.linalg.norm(quat, axis=1)[:, None], v.reshape(n, 3), w.reshape(n, 3))


def _pack(state):
    return np.concatenate([x.ravel() for x in (state.p_WB, state.quat_WB, state.v_WB_W, state.w_WB_W)])


def _quaternion_rates(quat, w_W):
    return 0.5 * quaternion_product(np.hstack([np.zeros((len(quat), 1)), w_W]), quat)


def _derivative(t, y, mechanism):
    state = _unpack(y, len(mechanism.bodies))
    a, _ = truth.accelerations(mechanism, state, t)
    rates = _quaternion_rates(state.quat_WB, state.w_WB_W)
    return np.concatenate([state.v_WB_W.ravel(), rates.ravel(), a[:, :3].ravel(), a[:, 3:].ravel()])


def _on_constraints(mechanism, state, t):
    """Nearest state on the constraints: Newton's method with the pseudo-inverse; few steps, as drift is small."""
    n = len(mechanism.bodies)
    holonomic = mechanism.holonomic_count
    p, quat = state.p_WB.copy(), state.quat_WB.copy()
    for _ in range(3):
        now = State(p, quat, state.v_WB_W, state.w_WB_W)
        Q = constraint_jacobian(mechanism, now, t=t)
        step = np.linalg.lstsq(Q[:holonomic], -constraint_residual(mechanism, now, t), rcond=1e-9)[0].reshape(n, 6)
        p = p + step[:, :3]
        quat = quat + _quaternion_rates(quat, step[:, 3:])
        quat /= np.linalg.norm(quat, axis=1)[:, None]
    now = State(p, quat, state.v_WB_W, state.w_WB_W)
    Q = constraint_jacobian(mechanism, now, t=t)
    u = np.hstack([now.v_WB_W, now.w_WB_W]).ravel()
    u = u + np.linalg.lstsq(Q, constraint_rates(mechanism, t) - Q @ u, rcond=1e-9)[0]
    u = u.reshape(n, 6)
    return State(p, quat, u[:, :3], u[:, 3:])


def motion_of(case, times, tolerance=TOLERANCE):
    """Motion of a case from its initial state at the given times, the first of which is zero."""
    mechanism, state = case.mechanism, case.initial_state
    n = len(mechanism.bodies)
    states = [state]
    for start, end in pairwise(times):
        done = solve_ivp(
            _derivative, (start, end), _pack(states[-1]), "DOP853", rtol=tolerance, atol=tolerance, args=(mechanism,)
        )
        states.append(_on_constraints(mechanism, _unpack(done.y[:, -1], n), end))
    arrays = [np.array([getattr(s, name) for s in states]) for name in ("p_WB", "quat_WB", "v_WB_W", "w_WB_W")]
    return TrajectoryAnswer(np.array(times), *arrays)


_MOTIONS = {}


def values(case, published):
    """Expected values of a case, in the order of `published`."""
    mechanism = case.mechanism
    times = tuple(sorted({0.0, *(known.time for known in published)}))
    if (case.name, times) not in _MOTIONS:
        _MOTIONS[case.name, times] = motion_of(case, times)
    motion = _MOTIONS[case.name, times]
    a, alpha, force, torque = (x[None] for x in truth.solve(mechanism, case.initial_state))
    start = InstantAnswer(a, alpha, force, torque, np.zeros(1), np.zeros(1))
    return np.array(
        [
            read_start(mechanism, known, start)[known.component]
            if known.at_start
            else read_motion(mechanism, known, motion)
            for known in published
        ]
    )
