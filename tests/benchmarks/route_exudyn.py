"""Routes by Exudyn: explicit methods on kinematic trees; implicit ones, extrapolated, on bodies with constraints."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from routes import TOLERANCES, Route, extrapolated, steps

from consilience.case import Case
from consilience.engine import Question
from consilience.mechanism import Array
from consilience_exudyn.engine import ExudynEngine
from consilience_exudyn.kinematic_tree import build_tree, is_one_axis_tree, set_initial
from consilience_exudyn.library import SETTINGS, exu, simulation_settings
from consilience_exudyn.maximal import build
from consilience_exudyn.redundancy import independent_axes
from consilience_exudyn.trajectory import Integration, solve, stored

EXPLICIT = {"RK44": (4,), "RK67": (6,)}
IMPLICIT = {"TrapezoidalIndex2": (2, 4, 6), "GeneralizedAlpha": (2, 3, 4)}
"""Orders of the error that extrapolation takes out one by one; the trapezoidal rule is symmetric."""

COUNTS = {1: (1, 2), 2: (1, 2, 4), 3: (1, 2, 3, 4)}
LARGEST_STEPS = 10
"""Steps in a second at least, of Exudyn's step size control."""

CRAWLS = 1e-12
"""Below this tolerance Exudyn's control goes on at its smallest step without end."""

SMALLEST_STEP = 1e-6
"""s, of the same control: with its own, 1e-8, it may take an hour for a second of a stiff motion."""


def _fixed(case: Case, system: Any, sensors: list[Any], integration: Integration) -> Route:
    """Route with constant steps over all samples; positions are read from the sensors at the end."""

    def run(count: int) -> Array:
        solve(system, integration, case.times, case.sample / count)
        return np.stack([stored(system, sensor, case.times)[:, :3] for sensor in sensors], axis=1)

    return Route("Exudyn", integration.solver, True, steps(case), run, lambda motion: motion)


def _adaptive(case: Case, model: Any) -> Route:
    """Route by DOPRI5 with Exudyn's step control, from sample to sample."""
    system, data = model.system, model.system.systemData
    initial, current = exu.ConfigurationType.Initial, exu.ConfigurationType.Current
    sensors = [four[0] for four in model.sensors]

    def run(tolerance: float) -> Array:
        set_initial(model, case.initial_state)
        settings = simulation_settings(SETTINGS)
        settings.solution.sensors.active = False
        scheme = settings.timeIntegration
        scheme.relativeTolerance = scheme.absoluteTolerance = tolerance
        scheme.numberOfSteps = max(1, round(LARGEST_STEPS * case.sample))
        scheme.minimumStepSize = SMALLEST_STEP
        motion = [case.initial_state.p_WB]
        for start, end in pairwise(case.times):
            scheme.startTime, scheme.endTime = float(start), float(end)
            if not system.SolveDynamic(settings, solverType=exu.DynamicSolverType.DOPRI5):
                raise RuntimeError(f"DOPRI5 stopped before {end} s")
            data.SetODE2Coordinates(data.GetODE2Coordinates(configuration=current), configuration=initial)
            data.SetODE2Coordinates_t(data.GetODE2Coordinates_t(configuration=current), configuration=initial)
            motion.append(np.array([system.GetSensorValues(sensor, configuration=current) for sensor in sensors]))
        set_initial(model, case.initial_state)
        return np.array(motion)

    levels = [tolerance for tolerance in TOLERANCES if tolerance >= CRAWLS]
    return Route("Exudyn", "DOPRI5", True, levels, run, lambda motion: motion)


def _tree(case: Case) -> Iterator[Route]:
    model = build_tree(case.mechanism, case.initial_state, ("Position",))
    for solver, orders in EXPLICIT.items():
        plain = _fixed(case, model.system, [four[0] for four in model.sensors], Integration(solver, SETTINGS))
        yield plain
        yield extrapolated(plain, COUNTS[1], orders)
    yield _adaptive(case, model)


def _maximal(case: Case) -> Iterator[Route]:
    model = build(case.mechanism, case.initial_state, independent_axes(case.mechanism))
    for solver, orders in IMPLICIT.items():
        plain = _fixed(case, model.system, [three[0] for three in model.sensors], Integration(solver, SETTINGS))
        yield plain
        for n, counts in COUNTS.items():
            yield extrapolated(plain, counts, orders[:n])


def routes(case: Case) -> Iterator[Route]:
    """Return the routes of a case."""
    if ExudynEngine().unsupported(case.mechanism, Question.TRAJECTORY) or case.mechanism.controls:
        return
    if is_one_axis_tree(case.mechanism):
        yield from _tree(case)
    yield from _maximal(case)
