"""Inverse kinematics: pose of a mechanism with a point, or a frame, of one body at a target.

In the free directions N of the joints (``Q N = 0``) the task velocity is ``(p', w) = J y'``. With the task error e and
the displacement d from the current pose to the guess, a step is

    y = J^T (J J^T + mu^2 1)^-1 e,                    until e = 0 (Levenberg, Marquardt),
    y = J^+ e + s (1 - J^+ J) N^T d,                   until (1 - J^+ J) N^T d = 0,

each followed by assembly. Translations are divided by the length of the mechanism. The second line leads to the pose
closest to the guess among all poses that meet the task: ``(1 - J^+ J) N^T d`` is the gradient of the sum over all
bodies of squared translations of the origins (over the length) and squared rotation angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import CannotAssemble, ConsilienceError, InvalidInput
from consilience.mechanism import (
    GROUND,
    Array,
    Mechanism,
    State,
    assemble_positions,
    body_point,
    characteristic_length,
    constraint_jacobian,
    move,
    null_space,
    skew,
)
from consilience.reference.analyses.joint_rows import turn_between
from consilience.reference.analyses.statics import at_rest
from consilience.reference.analyses.touching import refuse_passing

_ACCURATE = 1e-12
"""Task error, rad and lengths of the mechanism, at the level of rounding."""
_STEPS = 100
_STARTS = 3
"""Attempts, all but the first from a perturbed guess: at a singular pose J may not point to a target within reach."""
_SHAKES, _SHAKE = 4, 0.3
_LONGEST = 0.5
_DAMPING = 1e-3
_STATIONARY = 1e-7
"""Gradient of the task error, over the error, at a local minimum."""
_CLOSEST = 1e-9
"""Gradient of the distance to the guess at its minimum."""


class Unreachable(ConsilienceError):
    """No pose meets the target; the message tells the remaining distance."""


@dataclass(frozen=True, eq=False)
class _PoseTask:
    """Task: a point of a body at p, the orientation of the body quat (or None); lengths are divided by `length`."""

    mechanism: Mechanism
    body: str
    point: Array
    p: Array
    quat: Array | None
    length: float


@dataclass(frozen=True, eq=False)
class _TaskPose:
    """Pose with scaled free directions N, task Jacobian J and task error e."""

    state: State
    N: Array
    J: Array
    e: Array

    @property
    def error(self) -> float:
        return float(np.linalg.norm(self.e))


def inverse_kinematics(
    mechanism: Mechanism,
    body: str,
    point: ArrayLike,
    target: ArrayLike,
    guess: State,
    orientation: ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> State:
    """Find a pose in which a point of a body is at a target.

    Parameters
    ----------
    mechanism : Mechanism
        Tree or loops.
    body : str
    point : array_like, shape (3,), m
        In body axes, from the body's origin.
    target : array_like, shape (3,), m
        Target of the point, world axes.
    guess : State
        Initial pose, which chooses the branch (elbow up or down). Velocities are ignored.
    orientation : array_like, shape (4,), optional
        Required unit quaternion ``quat_WB`` of the body; any orientation if not given.
    tolerance : float
        Largest task error, rad and lengths of the mechanism.

    Returns
    -------
    State
        Assembled, at rest; redundant freedoms change least from the guess (see the module).

    Raises
    ------
    InvalidInput
        Unknown body, arrays of wrong shape, or a pose in which rigid shapes overlap or a joint is beyond a stop.
    Unreachable
        With the remaining distance and angle of the closest pose found.
    CannotAssemble
        If the guess cannot be assembled.
    """
    if body not in mechanism.body_index or body == GROUND:
        known = ", ".join(b.name for b in mechanism.bodies)
        raise InvalidInput("inverse kinematics", f"there is no body '{body}'", f"Bodies are: {known}.")
    quat = None if orientation is None else _vector(orientation, 4, "orientation")
    if quat is not None and abs(float(np.linalg.norm(quat)) - 1.0) > 1e-9:
        raise InvalidInput("inverse kinematics: orientation", "the quaternion is not unit", "Normalise it.")
    at, to = _vector(point, 3, "point"), _vector(target, 3, "target")
    task = _PoseTask(mechanism, body, at, to, quat, characteristic_length(mechanism))
    start = assemble_positions(mechanism, guess)
    rng = np.random.default_rng(0)
    best = _pose(task, start)
    for attempt in range(_STARTS):
        first = _pose(task, start) if attempt == 0 else _perturbed(task, start, rng)
        found = _meet(task, first)
        best = found if found.error < best.error or attempt == 0 else best
        if best.error <= tolerance:
            pose = at_rest(_closest(task, best, start, tolerance))
            remedy = "Give another guess, which chooses the branch"
            refuse_passing(mechanism, pose, "in the pose that meets the target", remedy)
            return pose
    raise Unreachable(_remaining(task, best))


def _vector(value: ArrayLike, n: int, name: str) -> Array:
    a = np.asarray(value, dtype=float)
    if a.shape != (n,) or not np.all(np.isfinite(a)):
        raise InvalidInput(f"inverse kinematics: {name}", f"shape {a.shape}", f"Give {n} finite numbers.")
    return a


def _scales(task: _PoseTask) -> Array:
    """Return the scales of displacements (m, rad), shape (6 n_b,)."""
    return np.tile([task.length] * 3 + [1.0] * 3, len(task.mechanism.bodies))


def _pose(task: _PoseTask, state: State) -> _TaskPose:
    mechanism, i = task.mechanism, task.mechanism.body_index[task.body]
    scales = _scales(task)
    N = np.asfortranarray(null_space(constraint_jacobian(mechanism, state) * scales))
    p, _ = body_point(mechanism, state, task.body, task.point)
    of_body = (scales[:, None] * N)[6 * i : 6 * i + 6]
    rows = [(of_body[:3] - skew(p - state.p_WB[i]) @ of_body[3:]) / task.length]
    errors = [(task.p - p) / task.length]
    if task.quat is not None:
        rows.append(of_body[3:])
        errors.append(turn_between(state.quat_WB[i], task.quat))
    return _TaskPose(state, N, np.vstack(rows), np.concatenate(errors))


def _stepped(task: _PoseTask, pose: _TaskPose, y: Array) -> _TaskPose | None:
    """Return the pose after a step of at most half a radian along the free directions; None if not assembled."""
    step = pose.N @ y
    step *= min(1.0, _LONGEST / max(float(np.max(np.abs(step), initial=0.0)), 1e-300))
    try:
        return _pose(task, assemble_positions(task.mechanism, move(pose.state, _scales(task) * step)))
    except CannotAssemble:  # out of reach
        return None


def _perturbed(task: _PoseTask, start: State, rng: np.random.Generator) -> _TaskPose:
    """Return the guess after random steps along the free directions."""
    pose = _pose(task, start)
    for _ in range(_SHAKES):
        trial = _stepped(task, pose, np.asarray(rng.normal(scale=_SHAKE, size=pose.N.shape[1])))
        pose = trial or pose
    return pose


def _meet(task: _PoseTask, pose: _TaskPose) -> _TaskPose:
    """Minimise the task error by the Levenberg-Marquardt method."""
    mu = _DAMPING
    for _ in range(_STEPS):
        if pose.error < _ACCURATE or mu > 1e8 or np.linalg.norm(pose.J.T @ pose.e) < _STATIONARY * pose.error:
            break
        U, s, Vt = np.linalg.svd(pose.J, full_matrices=False)
        damping = mu * min(1.0, pose.error)  # vanishes with the error: Newton's method at the end
        factors = s / (s * s + damping * damping) if damping else np.zeros_like(s)
        trial = _stepped(task, pose, Vt.T @ (factors * (U.T @ pose.e)))
        if trial is not None and trial.error < pose.error:
            gained = 1.0 - trial.error / pose.error
            pose, mu = trial, mu * (0.2 if gained > 0.1 else 1.0)
            if gained < 1e-7:
                break
        else:
            mu *= 8.0
    return pose


def _displacement(task: _PoseTask, state: State, start: State) -> Array:
    """Return the scaled displacement of all bodies from a pose to the guess, shape (6 n_b,)."""
    turns = np.array([turn_between(a, b) for a, b in zip(state.quat_WB, start.quat_WB, strict=True)])
    return np.hstack([(start.p_WB - state.p_WB) / task.length, turns]).ravel()


def _closest(task: _PoseTask, pose: _TaskPose, start: State, tolerance: float) -> State:
    """Minimise the distance to the guess among the poses that meet the task."""
    d, size = _displacement(task, pose.state, start), 1.0
    for _ in range(_STEPS):
        inverse = np.linalg.pinv(pose.J, rcond=1e-6)
        pull = pose.N.T @ d
        pull = pull - inverse @ (pose.J @ pull)
        if float(np.linalg.norm(pull)) < _CLOSEST or size < 1e-6:
            break
        trial = _stepped(task, pose, size * pull)
        met = None if trial is None else _meet(task, trial)
        if met is not None and met.error <= tolerance:
            back = _displacement(task, met.state, start)
            if float(back @ back) < float(d @ d):
                pose, d, size = met, back, min(1.0, 2.0 * size)
                continue
        size *= 0.5
    return pose.state


def _remaining(task: _PoseTask, pose: _TaskPose) -> str:
    distance = task.length * float(np.linalg.norm(pose.e[:3]))
    angle = f" and {float(np.linalg.norm(pose.e[3:])):.6g} rad" if task.quat is not None else ""
    return (
        f"mechanism '{task.mechanism.name}': body '{task.body}' does not reach the target: {distance:.6g} m{angle} "
        "are left in the closest pose found. Move the target, or start closer to a pose that reaches it."
    )
