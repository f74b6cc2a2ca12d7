"""Every engine on the cases with a full oracle: bars of `model` and `instant`, order of each integrator."""

import functools

import pytest

from consilience.case import load_case
from consilience.compare import (
    ReferenceMotion,
    Verdict,
    compare_instant,
    compare_model,
    compare_trajectory,
    spread_over_time,
)
from consilience.compare.instant import Instants
from consilience.engine import Profile, Question, Run, Status, load_engine
from consilience.reference import accelerations, simulate
from oracles.shipped import TRAJECTORIES

CASES = {name: load_case(name) for name in TRAJECTORIES}
ORDER_WINDOW = 0.15


@functools.cache
def reference_model(name):
    case, reference = CASES[name], load_engine("reference")
    (method,) = reference.methods(case.mechanism, Question.MODEL)
    return reference.model(case.mechanism, case.initial_state, method)


@functools.cache
def reference_instant(name):
    case = CASES[name]
    return accelerations(case.mechanism, case.states), Instants.of(case.mechanism, case.states)


@functools.cache
def reference_motion(name):
    case = CASES[name]
    runs = [
        simulate(case.mechanism, case.initial_state, case.times, tolerance, formulation)
        for tolerance, formulation in ((1e-13, "descriptor"), (1e-12, "descriptor"), (1e-12, "null_space"))
    ]
    return ReferenceMotion(runs[0], spread_over_time(case.mechanism, runs), case.digits)


def matched(engine, case, question):
    """Methods of the matched profile; default settings are tested in `test_profiles`."""
    found = [m for m in engine.methods(case.mechanism, question) if m.profile is Profile.MATCHED]
    assert found
    return found


@pytest.mark.parametrize("name", CASES)
def test_model_agrees(engine, name):
    case = CASES[name]
    assert engine.unsupported(case.mechanism, Question.MODEL) == ()
    for method in engine.methods(case.mechanism, Question.MODEL):
        answer = engine.model(case.mechanism, case.initial_state, method)
        comparison = compare_model(name, "engine", method, answer, reference_model(name), 1.0)
        assert comparison.verdict is Verdict.AGREES, comparison.why


@pytest.mark.parametrize("name", CASES)
def test_instant_agrees_by_every_method(engine, name):
    case = CASES[name]
    assert engine.unsupported(case.mechanism, Question.INSTANT) == ()
    for method in matched(engine, case, Question.INSTANT):
        answer = engine.instant(case.mechanism, case.states, method)
        comparison = compare_instant(name, "engine", method, answer, *reference_instant(name))
        assert comparison.verdict is Verdict.AGREES, (method.name, comparison.why)


@pytest.mark.parametrize("name", CASES)
def test_trajectory_leads_to_the_reference_with_the_declared_order(engine, name):
    case = CASES[name]
    assert engine.unsupported(case.mechanism, Question.TRAJECTORY) == ()
    for method in matched(engine, case, Question.TRAJECTORY):
        steps = [case.sample / n for n in method.substeps] or list(method.tolerances)
        answers = [engine.trajectory(case.mechanism, case.initial_state, case.times, method, h) for h in steps]
        runs = [
            Run(name, "engine", Question.TRAJECTORY, method, level, step, Status.ANSWERED, answer)
            for level, (step, answer) in enumerate(zip(steps, answers, strict=True))
        ]
        comparison = compare_trajectory(case.mechanism, runs, reference_motion(name))
        assert comparison.verdict in (Verdict.AGREES, Verdict.DISCRETISATION), (method.name, comparison.why)
        if method.order is not None:
            assert comparison.order == pytest.approx(method.order, abs=ORDER_WINDOW), method.name
