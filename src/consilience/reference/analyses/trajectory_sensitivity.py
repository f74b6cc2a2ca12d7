"""Sensitivity of a motion by variational equations, integrated with the motion.

    y' = f(y, p),    s' = f_y s + f_p,    s(0) = dy(0)/dp,

y: packed state of the reference solver, one s for every parameter p. ``f_y s`` and ``f_p`` are directional derivatives
of the compiled f by central differences of fourth order. The tolerance bounds the error; it does not depend on a step
in p, unlike differences of whole trajectories.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DOP853

from consilience.case import Case
from consilience.errors import NumericalFailure
from consilience.mechanism import Angles, Array, Mechanism, State, constraint_residual, move, quaternion_product
from consilience.reference.analyses.parameters import T, parameter, with_parameter
from consilience.reference.analyses.sensitivity import parameter_scale, ridders
from consilience.reference.analyses.touching import refuse_laws
from consilience.reference.bodies.arrays import ANGLE, Model, P, flatten, pack, unpack, workspace
from consilience.reference.bodies.canonical import sample_times
from consilience.reference.bodies.forces import count_turns
from consilience.reference.bodies.projection import project
from consilience.reference.formulations import compiled_choice

_STEP = 1e-3
"""Step of the differences, in scales: truncation is its fourth power, rounding is divided by it."""
_OFFSETS = (1.0, -1.0, 2.0, -2.0)
_WEIGHTS = (8.0 / 12.0, -8.0 / 12.0, -1.0 / 12.0, 1.0 / 12.0)


@dataclass(frozen=True, eq=False)
class TrajectorySensitivity:
    """Derivatives of a motion with respect to k parameters, at n_t times.

    Attributes
    ----------
    paths : tuple of str
    times : ndarray, shape (n_t,), s
    p_WB, turn_W, v_WB_W, w_WB_W : ndarray, shape (k, n_t, n_b, 3)
        Derivatives of the origins (m), the orientations (as rotation vectors, world axes, rad) and the velocities
        (m/s, rad/s), each over the unit of the parameter.
    drift : ndarray, shape (k, n_t)
        Largest violation of the differentiated constraints ``Q s + g_p = 0``, a measure of the error.
    """

    paths: tuple[str, ...]
    times: Array
    p_WB: Array
    turn_W: Array
    v_WB_W: Array
    w_WB_W: Array
    drift: Array


@dataclass(frozen=True, eq=False)
class _VariedParameter:
    """Parameter with its step h, and mechanisms and models at the four offsets."""

    h: float
    mechanisms: tuple[Mechanism, ...]
    models: tuple[Model, ...]


def _mechanism(subject: Mechanism | Case) -> Mechanism:
    return subject if isinstance(subject, Mechanism) else subject.mechanism


def trajectory_sensitivity(
    subject: T, start: Callable[[T], State], times: ArrayLike, paths: Sequence[str], tolerance: float = 1e-11
) -> TrajectorySensitivity:
    """Differentiate the motion of a mechanism with respect to parameters.

    Parameters
    ----------
    subject : Mechanism or Case
    start : function of the subject to State
        Consistent state at ``times[0]``, for example `consilience.mechanism.initial_state`.
    times : array_like, shape (n_t,), s
        Increasing.
    paths : sequence of str
        See `consilience.reference.analyses.parameters`.
    tolerance : float
        Bound on the scaled local error of a step, for motion and derivatives.

    Returns
    -------
    TrajectorySensitivity

    Raises
    ------
    InvalidInput
        Unknown paths, times that do not increase, contacts, stops or dry friction.
    NumericalFailure
        If the integration fails.
    """
    t = sample_times(times)
    mechanism = _mechanism(subject)
    differences = "Use sensitivity: differences of a result of consilience.simulate."
    refuse_laws(mechanism, "the system of variational equations", differences)
    parameters = [_prepared(subject, path) for path in paths]
    y0 = pack(mechanism, start(subject))
    first = [y0, *(_initial(subject, start, path, y0) for path in paths)]
    flow = _Flow(flatten(mechanism), parameters)
    flow.count_turns(y0)
    u, found = np.array(first), []
    scales = np.array([1.0, *(_STEP / p.h for p in parameters)])
    for n, end in enumerate(t):
        if n:
            u = flow.advance(t[n - 1], u, end, tolerance, scales)
        angles = flow.counted_angles(mechanism)
        found.append([_canonical(mechanism, p, end, angles, u[0], s) for p, s in zip(parameters, u[1:], strict=True)])
    shape = (len(t), len(paths), 4, len(mechanism.bodies), 3)
    parts = np.array([[part[0] for part in row] for row in found]).reshape(shape)
    drift = np.array([[part[1] for part in row] for row in found]).reshape(shape[:2])
    p_WB, turn, v, w = parts.transpose(2, 1, 0, 3, 4)
    return TrajectorySensitivity(tuple(paths), t, p_WB, turn, v, w, drift.T)


def _prepared(subject: T, path: str) -> _VariedParameter:
    h, at = _STEP * parameter_scale(subject, path), parameter(subject, path)
    mechanisms = tuple(_mechanism(with_parameter(subject, path, at + c * h)) for c in _OFFSETS)
    return _VariedParameter(h, mechanisms, tuple(flatten(m) for m in mechanisms))


def _initial(subject: T, start: Callable[[T], State], path: str, y0: Array) -> Array:
    """Return dy(0)/dp, including the assembly of the start."""
    at = parameter(subject, path)

    def packed(h: float) -> Array:
        changed = with_parameter(subject, path, at + h)
        y = pack(_mechanism(changed), start(changed))
        y[:, P] *= np.sign(np.sum(y[:, P] * y0[:, P], axis=1))[:, None]
        return y

    return ridders(packed, 10.0 * _STEP * parameter_scale(subject, path), f"parameter '{path}'")[0]


class _Flow:
    """Differential equation of the motion and its derivatives, u of shape (1 + k, n_b + n_e, 13)."""

    def __init__(self, model: Model, parameters: Sequence[_VariedParameter]) -> None:
        self.model, self.parameters = model, parameters
        self.ws, self.turns = workspace(model), np.zeros(len(model.coordinate))
        self.a = np.empty(6 * len(model.mass))

    def count_turns(self, y: Array) -> None:
        """Count full turns at y."""
        count_turns(self.model, y, self.ws, self.turns)

    def counted_angles(self, mechanism: Mechanism) -> Angles:
        """Return the angles that elements read, counted over full turns, by joint name."""
        numbered = zip(self.model.coordinate, self.turns, strict=True)
        return {mechanism.joints[joint].name: float(value) for (joint, kind), value in numbered if kind == ANGLE}

    def rate(self, model: Model, t: float, y: Array) -> Array:
        """Evaluate ``f(y, p)`` with the model of p."""
        dy = np.empty_like(y)
        compiled_choice.derivative(
            compiled_choice.FORMULATIONS["descriptor"], model, t, y, self.turns, self.ws, self.a, dy
        )
        return dy

    def derivative(self, t: float, u: Array) -> Array:
        """Return the rates of the state u[0] and of its sensitivities u[1:], shape of u."""
        y, rates = u[0], [self.rate(self.model, t, u[0])]
        for varied, s in zip(self.parameters, u[1:], strict=True):
            size = float(np.max(np.abs(s)))
            rate = np.zeros_like(y)
            if size > 0.0:
                eps = _STEP / size
                for c, weight in zip(_OFFSETS, _WEIGHTS, strict=True):
                    rate += weight / eps * self.rate(self.model, t, y + c * eps * s)
            for model, weight in zip(varied.models, _WEIGHTS, strict=True):
                rate += weight / varied.h * self.rate(model, t, y)
            rates.append(rate)
        return np.array(rates)

    def advance(self, t: float, u: Array, end: float, tolerance: float, scales: Array) -> Array:
        """Integrate from t to the sample time `end` and project the state.

        Parameters
        ----------
        t, end : float, s
        u : ndarray, shape (1 + k, n_b + n_e, 13)
        tolerance : float
        scales : ndarray, shape (1 + k,)
            Scales of the absolute tolerances of state and sensitivities.
        """
        atol = np.broadcast_to(tolerance * scales[:, None, None], u.shape).ravel()
        solver = DOP853(
            lambda t, x: self.derivative(t, x.reshape(u.shape)).ravel(), t, u.ravel(), end, rtol=tolerance, atol=atol
        )
        while solver.status == "running":
            solver.step()
            if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
                raise NumericalFailure(f"sensitivity, tolerance {tolerance:g}: the integration stops at {solver.t:g} s")
            self.count_turns(solver.y.reshape(u.shape)[0])
        ended: Array = solver.y.reshape(u.shape).copy()
        y = np.ascontiguousarray(ended[0])
        project(self.model, end, y, self.turns, self.ws)
        ended[0] = y
        return ended


def _canonical(
    mechanism: Mechanism, varied: _VariedParameter, t: float, angles: Angles, y: Array, s: Array
) -> tuple[Array, float]:
    """Return derivatives of origins, orientations and velocities, (4, n_b, 3), and their constraint violation.

    Parameters
    ----------
    mechanism : Mechanism
    varied : _VariedParameter
    t : float, s
    angles : mapping of joint name to float, rad
        Angles that couplings read, over full turns.
    y, s : ndarray, shape (n_b + n_e, 13)
        Packed state and its derivative with respect to the parameter.
    """
    n_b = len(mechanism.bodies)
    p, quat, v, w = (np.zeros((n_b, width)) for width in (3, 4, 3, 3))
    h = varied.h * min(1.0, _STEP / max(varied.h * float(np.max(np.abs(s))), 1e-300))
    # total derivative: along s at the step h, plus along p at the step of the parameter
    for c, weight, other in zip(_OFFSETS, _WEIGHTS, varied.mechanisms, strict=True):
        for part, step in ((unpack(mechanism, y + c * h * s), h), (unpack(other, y), varied.h)):
            p, quat, v, w = (total + weight / step * value for total, value in zip((p, quat, v, w), part, strict=True))
    conjugate = y[:n_b, P] * np.array([1.0, -1.0, -1.0, -1.0])
    turn = 2.0 * quaternion_product(quat, conjugate)[:, 1:]
    return np.array([p, turn, v, w]), _violation(mechanism, varied, t, angles, y, np.hstack([p, turn]))


def _violation(
    mechanism: Mechanism, varied: _VariedParameter, t: float, angles: Angles, y: Array, step: Array
) -> float:
    """Return the largest row of ``|Q s + g_p|`` by differences along the displacement `step` and the parameter.

    Parameters
    ----------
    mechanism, varied, t, angles, y
        As in `_canonical`.
    step : ndarray, shape (n_b, 6), m and rad
        Derivatives of origins and orientations, world axes.
    """
    p, quat, v, w = unpack(mechanism, y)
    state = State(p, quat / np.linalg.norm(quat, axis=1)[:, None], v, w)
    g = np.zeros(mechanism.holonomic_count)
    for c, weight, other in zip(_OFFSETS, _WEIGHTS, varied.mechanisms, strict=True):
        moved = move(state, c * varied.h * step.ravel())
        g += weight / varied.h * constraint_residual(other, moved, t, angles)
    return float(np.max(np.abs(g), initial=0.0))
