"""Trajectories by Exudyn's integrators: one run of SolveDynamic, sampled by sensors that store internally."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from consilience.engine import TrajectoryAnswer, require_stable, steps_per_sample
from consilience.mechanism import RANK_TOLERANCE, Array, Mechanism, State, continuous_in_time, quaternion_from_rotation
from consilience_exudyn.kinematic_tree import KinematicTree
from consilience_exudyn.library import SETTINGS, exu, simulation_settings
from consilience_exudyn.maximal import Axes, Maximal, build, full_axes
from consilience_exudyn.redundancy import equations, independent_axes, left_out, smallest_singular_value
from consilience_exudyn.terms import Terms

WEAK = 0.2
"""Fraction of the least singular value at the start below which other equations are kept."""

ATTEMPTS = 4
"""Motions with other kept equations."""

_ON_GRID = 1e-9
"""Largest rounding error of the time of a sample, as a fraction of the sample interval."""


@dataclass(frozen=True)
class Integration:
    """Integrator of Exudyn's, with its settings by Exudyn's names."""

    solver: str
    settings: Mapping[str, Any]


RUNGE_KUTTA = Integration("RK44", SETTINGS)


def solve(system: Any, integration: Integration, times: Array, step: float, write_period: float | None = None) -> int:
    """Run SolveDynamic from the initial values over a grid of times; return the number of steps.

    Parameters
    ----------
    system : exudyn.MainSystem
    integration : Integration
    times : ndarray, shape (n_t,), s
        Samples, equidistant.
    step : float, s
    write_period : float, s, optional
        Period at which sensors store; default: that of the samples.

    Raises
    ------
    RuntimeError
        Newton's iteration fails, a matrix is singular, or the run stops before the end.
    """
    interval = float(times[1] - times[0])
    steps = (len(times) - 1) * steps_per_sample(times, step)
    settings = simulation_settings(integration.settings)
    settings.solution.sensors.writePeriod = interval if write_period is None else write_period
    settings.timeIntegration.startTime = float(times[0])
    settings.timeIntegration.endTime = float(times[-1])
    settings.timeIntegration.numberOfSteps = steps
    try:
        finished = system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, integration.solver))
    except exu.SolverError as error:  # the text of Exudyn may lack any reason
        raise RuntimeError(f"{integration.solver} with {steps} steps to {times[-1]} s: {error}") from error
    if not finished:
        raise RuntimeError(f"{integration.solver} with {steps} steps stopped before {times[-1]} s")
    return steps


def stored(system: Any, sensor: Any, times: Array) -> Array:
    """Return the values of a sensor on the grid `times`, shape (n_t, width).

    Raises
    ------
    RuntimeError
        Exudyn sampled at other times.
    """
    data = np.array(system.GetSensorStoredData(sensor))
    if len(data) != len(times):
        raise RuntimeError(f"a sensor holds {len(data)} samples, the last at {data[-1, 0]:g} s, for {len(times)} asked")
    late = np.flatnonzero(np.abs(data[:, 0] - times) > _ON_GRID * (times[1] - times[0]))
    if len(late):
        at, asked = data[late[0], 0], times[late[0]]
        raise RuntimeError(
            f"{len(late)} of {len(times)} samples miss their times, the first is at {at:.6g} s, not {asked:.6g} s: "
            "where Newton's method fails Exudyn goes on in shorter steps (adaptiveStep), which do not end on samples"
        )
    return np.asarray(data[:, 1:])


def maximal_answer(
    model: Maximal, held: Sequence[Axes], integration: Integration, times: Array, step: float
) -> TrajectoryAnswer:
    """Integrate in redundant coordinates.

    Quaternions are divided by their norm, which index-2 solvers hold only to their discretisation error.

    Parameters
    ----------
    model : Maximal
    held : sequence of Axes
        Constrained axes with which the model was built.
    integration : Integration
    times : ndarray, shape (n_t,), s
    step : float, s
    """
    steps = solve(model.system, integration, times, step)
    series = [[stored(model.system, sensor, times) for sensor in three] for three in model.sensors]
    q = np.stack([coordinates for coordinates, _, _ in series], axis=1)
    quat, norms = _unit_quaternions(q)
    answer = TrajectoryAnswer(
        time=times.copy(),
        p_WB=q[:, :, :3],
        quat_WB=continuous_in_time(quat),
        v_WB_W=np.stack([v for _, v, _ in series], axis=1),
        w_WB_W=np.stack([w for _, _, w in series], axis=1),
        counters={"steps": steps, "largest_quaternion_norm_error": float(np.max(np.abs(norms - 1.0)))},
    )
    if tuple(held) != full_axes(model.mechanism):
        refuse_lost_rank(model, held, answer)
    return answer


def _unit_quaternions(q: Array) -> tuple[Array, Array]:
    """Return quaternions divided by their norms, and the norms, of coordinates of bodies, shape (..., 7)."""
    quat = q[..., 3:] + np.array([1.0, 0.0, 0.0, 0.0])
    norms = np.linalg.norm(quat, axis=-1)
    return quat / norms[..., None], norms


def well_conditioned_answer(
    mechanism: Mechanism, state: State, held: tuple[Axes, ...], integration: Integration, times: Array, step: float
) -> TrajectoryAnswer:
    """Integrate in redundant coordinates; leave out other dependent axes where the kept ones weaken along the motion.

    The counters name the axes that were left out in place of those given.

    Parameters
    ----------
    mechanism, state
    held : tuple of Axes
        Constrained axes to begin with.
    integration, times, step
        As in `maximal_answer`.

    Raises
    ------
    RuntimeError
        Exudyn fails, and no other choice of axes is better conditioned at the states that were reached.
    """
    first, known = held, list[State]()
    for attempt in range(ATTEMPTS):
        model = build(mechanism, state, held)
        try:
            found: TrajectoryAnswer | RuntimeError = maximal_answer(model, held, integration, times, step)
        except RuntimeError as error:
            found = error
        weak = _weak_states(model, held)
        known += weak
        better = independent_axes(mechanism, known) if weak and attempt < ATTEMPTS - 1 else held
        if better == held:
            break
        held = better
    if isinstance(found, RuntimeError):
        raise found
    if held == first:
        return found
    named = {f"'{name}': left out {axes}": 1 for name, axes in left_out(mechanism, held).items()}
    return replace(found, counters={**found.counters, **named})


def _weak_states(model: Maximal, held: Sequence[Axes]) -> list[State]:
    """Start, middle and end of the motion to the first sample at which the kept equations are nearly dependent."""
    if tuple(held) == full_axes(model.mechanism):
        return []
    series = [np.array(model.system.GetSensorStoredData(three[0]))[:, 1:] for three in model.sensors]
    terms, at_rest = Terms(model), np.zeros((len(series), 3))
    states, first = list[State](), 1.0
    for row in np.stack(series, axis=1):
        states.append(State(row[:, :3], _unit_quaternions(row)[0], at_rest, at_rest))
        value = smallest_singular_value(terms.constraint_jacobian(states[-1]), equations(held))
        first = value if len(states) == 1 else first
        if value < WEAK * first:
            return [states[0], states[len(states) // 2], states[-1]]
    return []


def refuse_lost_rank(model: Maximal, held: Sequence[Axes], answer: TrajectoryAnswer) -> None:
    """Refuse an answer if the kept equations are dependent at a sample: some constraint is then not held.

    Raises
    ------
    RuntimeError
        The equations are dependent; the error names the time and the axes that were left out.
    """
    terms = Terms(model)
    for n, time in enumerate(answer.time):
        state = State(answer.p_WB[n], answer.quat_WB[n], answer.v_WB_W[n], answer.w_WB_W[n])
        if smallest_singular_value(terms.constraint_jacobian(state), equations(held)) < RANK_TOLERANCE:
            rest = left_out(model.mechanism, held)
            raise RuntimeError(f"at {time} s the constraint equations kept without {rest} are dependent")


def tree_answer(model: KinematicTree, times: Array, step: float) -> TrajectoryAnswer:
    """Integrate in minimal coordinates by the explicit Runge-Kutta method of order four."""
    steps = solve(model.system, RUNGE_KUTTA, times, step)
    series = [[stored(model.system, sensor, times) for sensor in four] for four in model.sensors]
    p, R, v, w = (np.stack([body[n] for body in series], axis=1) for n in range(4))
    require_stable(p, step)
    R_WB = R.reshape(*R.shape[:2], 3, 3) @ model.R_LB
    return TrajectoryAnswer(
        time=times.copy(),
        p_WB=p,
        quat_WB=continuous_in_time(quaternion_from_rotation(R_WB)),
        v_WB_W=v,
        w_WB_W=w,
        counters={"steps": steps},
    )
