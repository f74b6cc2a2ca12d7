"""Kinematic analysis: motion prescribed by drives of as many joint coordinates as there are degrees of freedom.

With Q the rows of joints and couplings and R the rows of the driven coordinates (`joint_rows`), at every instant

    g(x) = 0,  q(x) = q_d(t),        Q v = 0,  R v = q_d',        Q a = gamma,  R a = q_d'' - drift,

positions by Newton's method, velocities and accelerations by one linear system each [INTRO; MASS, "inverse dynamics
problems, algebraic equations"; C4 section 4.1.1]. Forces, with ``S = (Q; R)``:

    S^T (lam, tau) = M a - f,

reactions lam and drive efforts tau. With redundant rows lam is of least norm; tau is unique.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from consilience.errors import CannotAssemble, ConsilienceError, InvalidInput
from consilience.mechanism import (
    Array,
    Mechanism,
    State,
    characteristic_length,
    free_directions,
    move,
    rotation_angle_between,
)
from consilience.reference.analyses.inverse import missing_forces
from consilience.reference.analyses.joint_rows import (
    JointCoordinate,
    all_coordinates,
    coordinate_rows,
    coordinate_values,
    least_squares,
    named_coordinate,
    unturned,
    width,
    with_velocities,
)
from consilience.reference.analyses.placing import CoordinateValues, acceleration_rows, place, require_holonomic
from consilience.reference.analyses.statics import step_size
from consilience.reference.analyses.touching import refuse_passing, refuse_touching
from consilience.reference.bodies.canonical import joint_wrenches, sample_times

DriveFunction = Callable[[float], tuple[ArrayLike, ArrayLike, ArrayLike] | Array]
"""Value, rate and acceleration of a joint coordinate at a time: floats (m, rad), three numbers for a position (axes of
F), for an orientation a unit quaternion, angular velocity and angular acceleration of M relative to F in axes of F."""

Drives = Mapping[tuple[str, str], DriveFunction]
"""Drives by the names of joint and coordinate."""

_TRUST = 0.1
"""Largest correction of a predicted pose on the same branch, rad and lengths of the mechanism."""
_SINGULAR = 1e-6
"""Margin below which drives do not determine the motion; at a dead centre poses have the root of rounding errors."""
_SMALLEST_STEP = 2.0**-20
"""Fraction of a sampling interval at which halving stops."""


class SingularDrive(ConsilienceError):
    """A pose where the drives do not determine the motion (a dead centre), or beyond which no pose exists."""


@dataclass(frozen=True, eq=False)
class KinematicMotion:
    """Motion prescribed by drives, at n_t times.

    Attributes
    ----------
    times : ndarray, shape (n_t,), s
    drives : tuple of (joint, coordinate)
        Names of the driven coordinates, those of the mechanism's own drives first.
    states : tuple of State
    a_WB_W, alpha_WB_W : ndarray, shape (n_t, n_b, 3)
        Accelerations of the bodies' origins (m/s^2) and angular accelerations (rad/s^2), world axes.
    coordinates : dict of joint name to dict of coordinate name to ndarray, shape (n_t,) or (n_t, 3 or 4)
        All joint coordinates. Angles are counted over full turns from the value of the drive, others from within half
        a turn of zero; quaternions are continuous.
    margin : ndarray, shape (n_t,)
        Smallest over largest singular value of ``(Q; R)`` without the redundant rows: zero at a dead centre.
    """

    times: Array
    drives: tuple[tuple[str, str], ...]
    states: tuple[State, ...]
    a_WB_W: Array
    alpha_WB_W: Array
    coordinates: dict[str, dict[str, Array]]
    margin: Array


@dataclass(frozen=True, eq=False)
class DrivenDynamics:
    """Drive efforts and reactions along a prescribed motion.

    Attributes
    ----------
    efforts : dict of joint name to dict of coordinate name to ndarray, shape (n_t,) or (n_t, 3)
        Force along (N) or torque about (N m) each driven coordinate on the successor, its opposite on the predecessor,
        in addition to springs, dampers and loads; of a position or orientation in axes of F.
    couplings : dict of coupling name to ndarray, shape (n_t,)
        Efforts of the couplings in the coupled coordinates, on the successors.
    force_F, torque_F : ndarray, shape (n_t, n_j, 3), N and N m
        Joint reactions on the successors at the origins of M, axes of F, without the efforts; undetermined components
        of least norm (`consilience.mechanism.determinate_reactions`).
    """

    efforts: dict[str, dict[str, Array]]
    couplings: dict[str, Array]
    force_F: Array
    torque_F: Array


class _DrivenMechanism(NamedTuple):
    """Mechanism without drives, and the functions that drive its joint coordinates."""

    mechanism: Mechanism
    functions: dict[JointCoordinate, DriveFunction]


class _Prescribed(NamedTuple):
    """Driven coordinates at a time: values by coordinate, rates and accelerations in the order of the rows."""

    t: float
    values: dict[JointCoordinate, Array]
    rates: Array
    accelerations: Array


class _Sample(NamedTuple):
    """State, accelerations (6 n_b,), coordinates and margin at one time."""

    t: float
    state: State
    a: Array
    values: dict[JointCoordinate, Array]
    margin: float


def kinematic_motion(mechanism: Mechanism, drives: Drives, times: ArrayLike, guess: State) -> KinematicMotion:
    """Compute positions, velocities and accelerations of all bodies for prescribed joint coordinates.

    Parameters
    ----------
    mechanism : Mechanism
        Tree or loops, also with redundant rows, drives and couplings.
    drives : mapping of (joint, coordinate) to function of time
        Drives in addition to those of the mechanism, in all as many as there are degrees of freedom (see
        `DriveFunction`). Rates and accelerations must be the derivatives of the values.
    times : array_like, shape (n_t,), s
        Increasing.
    guess : State
        Initial pose of the assembly at ``times[0]``, which chooses the branch. Velocities are ignored.

    Returns
    -------
    KinematicMotion

    Raises
    ------
    InvalidInput
        Unknown coordinates, a wrong number of drives, values of a wrong shape, rolling bodies and skates; a pose in
        which rigid shapes overlap or a joint is beyond a stop, with its time.
    CannotAssemble
        If the first pose cannot be assembled.
    SingularDrive
        At a dead centre or a pose out of reach; with the time and the drive.

    Notes
    -----
    Each pose is predicted from the last velocities and accelerations and corrected by Newton's method. If the
    correction exceeds 0.1 rad or lengths of the mechanism, the time step is halved: the branch does not depend on the
    sampling. A change point of a flat linkage is passed on the smooth branch if no sample lies on it.
    """
    t = sample_times(times)
    functions = _functions(mechanism, drives)
    by_coordinate = {named_coordinate(mechanism, *name, "drives"): function for name, function in functions.items()}
    driven = _DrivenMechanism(replace(mechanism, drives=()), by_coordinate)
    sample = _first(driven, float(t[0]), guess)
    samples = [sample]
    for end in t[1:]:
        step = end - sample.t
        shortest = _SMALLEST_STEP * step
        while sample.t < end:
            step = min(step, end - sample.t)
            ahead = _next(driven, sample, end if step == end - sample.t else sample.t + step)
            if ahead is not None:
                sample, step = ahead, 2.0 * step
                continue
            step *= 0.5
            if step < shortest:
                raise _stuck(driven, sample)
        samples.append(sample)
    return _gathered(samples, tuple(functions))


def _functions(mechanism: Mechanism, drives: Drives) -> dict[tuple[str, str], DriveFunction]:
    """Return all drives, those of the mechanism first."""
    why = "it holds velocities: positions depend on the way, and not on the drives alone"
    require_holonomic(mechanism, why, "Integrate the motion: drives hold there, too.")
    functions: dict[tuple[str, str], DriveFunction] = {}
    own = [((drive.joint, drive.coordinate), drive.motion.at) for drive in mechanism.drives]
    for name, function in (*own, *drives.items()):
        if name in functions:
            raise InvalidInput(f"drives: joint '{name[0]}', {name[1]}", "it is driven twice", "Drive it once.")
        functions[name] = function
    return functions


def _gathered(samples: Sequence[_Sample], names: tuple[tuple[str, str], ...]) -> KinematicMotion:
    coordinates: dict[str, dict[str, Array]] = {}
    for joint, name in samples[0].values:
        coordinates.setdefault(joint.name, {})[name] = np.array([s.values[joint, name] for s in samples])
    a = np.array([s.a.reshape(-1, 6) for s in samples])
    return KinematicMotion(
        np.array([s.t for s in samples]),
        names,
        tuple(s.state for s in samples),
        a[..., :3],
        a[..., 3:],
        coordinates,
        np.array([s.margin for s in samples]),
    )


def _prescribed(driven: _DrivenMechanism, t: float) -> _Prescribed:
    """Evaluate the drives."""
    values, rates, accelerations = {}, [np.zeros(0)], [np.zeros(0)]
    for (joint, name), function in driven.functions.items():
        given = [np.asarray(part, dtype=float) for part in function(t)]
        n = width(name)
        shapes = [(4,) if name == "orientation" else (3,), (3,), (3,)] if n == 3 else [()] * 3
        if [part.shape for part in given] != shapes or not all(np.all(np.isfinite(part)) for part in given):
            raise InvalidInput(
                f"drive of joint '{joint.name}', {name}, at {t:.6g} s",
                "it is not a value, a rate and an acceleration",
                f"Return three finite arrays of shapes {shapes}.",
            )
        values[joint, name] = given[0]
        rates.append(np.atleast_1d(given[1]))
        accelerations.append(np.atleast_1d(given[2]))
    return _Prescribed(t, values, np.concatenate(rates), np.concatenate(accelerations))


def _first(driven: _DrivenMechanism, t: float, guess: State) -> _Sample:
    """Assemble the first pose, and check the number of drives."""
    mechanism, given = driven.mechanism, _prescribed(driven, t)
    near = {**unturned(all_coordinates(mechanism)), **given.values}
    try:
        state = place(mechanism, guess, given.values, near)
    except CannotAssemble:
        _check_count(mechanism, place(mechanism, guess, {}, near), len(given.rates))
        raise
    _check_count(mechanism, state, len(given.rates))
    return _solved(driven, given, state, near)


def _check_count(mechanism: Mechanism, state: State, rows: int) -> None:
    """Refuse a number of driven rows that differs from the degrees of freedom."""
    freedom = free_directions(mechanism, state).shape[1]
    if rows != freedom:
        raise InvalidInput(
            f"mechanism '{mechanism.name}': drives",
            f"{rows} rows are driven, degrees of freedom are {freedom}",
            "Drive as many independent joint coordinates as there are degrees of freedom (a position or an "
            "orientation counts three).",
        )


def _next(driven: _DrivenMechanism, sample: _Sample, t: float) -> _Sample | None:
    """Return the sample at a later time on the same branch, or None if the step is too long."""
    mechanism, given = driven.mechanism, _prescribed(driven, t)
    state, h = sample.state, t - sample.t
    v = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
    step = h * v + 0.5 * h * h * sample.a
    if step_size(step, characteristic_length(mechanism)) > 1.0:  # full turns would be ambiguous
        return None
    predicted = move(state, step)
    try:
        placed = place(mechanism, predicted, given.values, coordinate_values(mechanism, predicted, sample.values))
    except CannotAssemble:
        return None
    if _distance(mechanism, predicted, placed) > _TRUST:
        return None
    return _solved(driven, given, placed, sample.values)


def _solved(driven: _DrivenMechanism, given: _Prescribed, placed: State, near: CoordinateValues) -> _Sample:
    """Solve for velocities and accelerations at an assembled pose."""
    mechanism, coordinates = driven.mechanism, list(driven.functions)
    counted = coordinate_values(mechanism, placed, near)
    refuse_passing(mechanism, placed, f"at {given.t:.6g} s", "Drive it elsewhere", counted)
    Q, _ = acceleration_rows(mechanism, placed, counted)
    rows, _ = coordinate_rows(mechanism, placed, coordinates)
    S = np.vstack([Q, rows])
    singular = np.linalg.svd(S, compute_uv=False)
    margin = float(singular[-1] / singular[0]) if len(S) >= S.shape[1] else 0.0
    if margin < _SINGULAR:
        raise SingularDrive(f"{_weakest(driven, given.t, Q, rows)}: a dead centre, or drives that depend on others")
    state = with_velocities(placed, least_squares(S, np.concatenate([np.zeros(len(Q)), given.rates])))
    _, drift = coordinate_rows(mechanism, state, coordinates)
    _, gamma = acceleration_rows(mechanism, state, counted)
    a = least_squares(S, np.concatenate([gamma, given.accelerations - drift]))
    return _Sample(given.t, state, a, counted, margin)


def _distance(mechanism: Mechanism, one: State, other: State) -> float:
    """Return the largest translation (lengths of the mechanism) or rotation (rad) of a body between two poses."""
    translation = float(np.max(np.abs(other.p_WB - one.p_WB))) / characteristic_length(mechanism)
    return max(translation, float(np.max(rotation_angle_between(one.quat_WB, other.quat_WB))))


def _weakest(driven: _DrivenMechanism, t: float, Q: Array, rows: Array) -> str:
    """Describe the drive that determines the motion least, and the body that it leaves free."""
    mechanism = driven.mechanism
    _, singular, Vt = np.linalg.svd(Q) if len(Q) else (None, np.zeros(0), np.eye(Q.shape[1]))
    N = Vt[int(np.sum(singular > _SINGULAR * np.max(singular, initial=0.0))) :].T
    U, _, Vt = np.linalg.svd(rows @ N)
    owners = [coordinate for coordinate in driven.functions for _ in range(width(coordinate[1]))]
    joint, name = owners[int(np.argmax(np.abs(U[:, -1])))]
    body = mechanism.bodies[int(np.argmax(np.abs(N @ Vt[-1]))) // 6].name
    return (
        f"mechanism '{mechanism.name}', {t:.6g} s: the drive of joint '{joint.name}', {name}, does not determine the "
        f"motion of body '{body}'"
    )


def _stuck(driven: _DrivenMechanism, sample: _Sample) -> SingularDrive:
    Q, _ = acceleration_rows(driven.mechanism, sample.state, sample.values)
    rows, _ = coordinate_rows(driven.mechanism, sample.state, list(driven.functions))
    where = _weakest(driven, sample.t, Q, rows)
    return SingularDrive(
        f"{where} beyond this pose: a dead centre lies ahead (margin {sample.margin:.3g}), or a pose out of reach"
    )


def driven_dynamics(mechanism: Mechanism, motion: KinematicMotion) -> DrivenDynamics:
    """Compute drive efforts and joint reactions along a prescribed motion: inverse dynamics of trees and loops.

    Parameters
    ----------
    mechanism : Mechanism
    motion : KinematicMotion
        Motion of the same mechanism (see `kinematic_motion`).

    Returns
    -------
    DrivenDynamics

    Raises
    ------
    InvalidInput
        A controller with an integral, which is unknown at single instants; contacts, stops or dry friction that act.

    Notes
    -----
    ``S^T (lam, tau) = M a - f`` [EXU; C4 section 4.1.1], f at the times of `motion`, full turns counted as in
    `motion`. Loops and passive joints are allowed, unlike in `inverse_dynamics`.
    """
    for control in mechanism.controls:
        if control.integral:
            what = "its integral is not known from the motion at some instants"
            raise InvalidInput(f"control '{control.name}'", what, "Leave the integral out, or simulate.")
    mechanism = replace(mechanism, drives=())
    driven = [named_coordinate(mechanism, *name, "drives") for name in motion.drives]
    joint_rows = sum(len(joint.rows) for joint in mechanism.joints)
    efforts, couplings, wrenches = [], [], []
    for k, (t, state) in enumerate(zip(motion.times, motion.states, strict=True)):
        values = {name: {c: series[k] for c, series in by.items()} for name, by in motion.coordinates.items()}
        refuse_touching(mechanism, state, values)
        Q, _ = acceleration_rows(mechanism, state, {(j, c): values[j.name][c] for j, c in all_coordinates(mechanism)})
        rows, _ = coordinate_rows(mechanism, state, driven)
        a = np.hstack([motion.a_WB_W[k], motion.alpha_WB_W[k]]).ravel()
        missing = missing_forces(mechanism, state, a, float(t), values)
        unknowns = least_squares(np.vstack([Q, rows]).T, missing)
        efforts.append(unknowns[len(Q) :])
        couplings.append(unknowns[joint_rows : len(Q)])
        wrenches.append(joint_wrenches(mechanism, state, unknowns))
    of_couplings = dict(zip([c.name for c in mechanism.couplings], np.array(couplings).T, strict=True))
    wrench = np.array(wrenches)
    return DrivenDynamics(_by_joint(driven, np.array(efforts)), of_couplings, wrench[..., :3], wrench[..., 3:])


def _by_joint(driven: Sequence[JointCoordinate], tau: Array) -> dict[str, dict[str, Array]]:
    """Return drive efforts, shape (n_t, rows), by the names of joint and coordinate."""
    by_joint: dict[str, dict[str, Array]] = {}
    start = 0
    for joint, name in driven:
        part = tau[:, start : start + width(name)]
        by_joint.setdefault(joint.name, {})[name] = part if width(name) == 3 else part[:, 0]
        start += width(name)
    return by_joint
