"""Every engine on the cases with a full oracle: motions, and the order of each integrator.

`test_library` asks `model` and `instant` of every case.
"""

import functools

import pytest

from consilience.case import load_case
from consilience.compare import ReferenceMotion, Verdict, compare_trajectory, spread_over_time
from consilience.engine import Profile, Question, Run, Status
from consilience.reference import simulate
from oracles.shipped import TRAJECTORIES

CASES = {name: load_case(name) for name in TRAJECTORIES if name != "simple_pendulum-small"}
"""Without the small motion of the pendulum whose large one is there."""

ORDER_WINDOW = 0.15
SPAN = 2.0
"""Length of the motions, s: orders show by then."""


def times_of(name):
    case = CASES[name]
    return case.times[: round(SPAN / case.sample) + 1]


@functools.cache
def reference_motion(name):
    case = CASES[name]
    runs = [
        simulate(case.mechanism, case.initial_state, times_of(name), tolerance, formulation)
        for tolerance, formulation in ((1e-13, "descriptor"), (1e-12, "descriptor"), (1e-12, "null_space"))
    ]
    return ReferenceMotion(runs[0], spread_over_time(case.mechanism, runs), case.digits)


def matched(engine, case, question):
    """Methods of the matched profile; default settings are tested in `test_profiles`."""
    found = [m for m in engine.methods(case.mechanism, question) if m.profile is Profile.MATCHED]
    assert found
    return found


def test_every_engine_takes_these_cases(engine):
    for case in CASES.values():
        assert all(engine.unsupported(case.mechanism, question) == () for question in Question), case.name


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_trajectory_leads_to_the_reference_with_the_declared_order(engine, name):
    case = CASES[name]
    for method in matched(engine, case, Question.TRAJECTORY):
        steps = [case.sample / n for n in method.substeps] or list(method.tolerances)
        answers = [engine.trajectory(case.mechanism, case.initial_state, times_of(name), method, h) for h in steps]
        runs = [
            Run(name, "engine", Question.TRAJECTORY, method, level, step, Status.ANSWERED, answer)
            for level, (step, answer) in enumerate(zip(steps, answers, strict=True))
        ]
        comparison = compare_trajectory(case.mechanism, runs, reference_motion(name))
        assert comparison.verdict in (Verdict.AGREES, Verdict.DISCRETISATION), (method.name, comparison.why)
        if method.order is not None:
            assert comparison.order == pytest.approx(method.order, abs=ORDER_WINDOW), method.name
