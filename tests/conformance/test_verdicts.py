"""Verdicts of the suite on real engines, where documentation and order of the engine imply the verdict."""

from dataclasses import replace

import pytest

from consilience.case import load_case
from consilience.compare import Verdict
from consilience.engine import Profile, Question
from consilience.suite import Resources, run_suite

pytestmark = pytest.mark.slow

AGREES, STEPS, SOFT = Verdict.AGREES, Verdict.DISCRETISATION, Verdict.REGULARISATION

# engine, question, method: verdict, and the order that implies it. Loops are welds in MuJoCo, soft by its
# documentation ("Solver parameters"); in DART error reduction closes them, and steps are semi-implicit Euler steps
EXPECTED = {
    ("mujoco", Question.INSTANT, "mj_forward"): (AGREES, None),
    ("mujoco", Question.INSTANT, "mj_forward, defaults"): (SOFT, None),
    ("mujoco", Question.TRAJECTORY, "RK4"): (AGREES, 4),
    ("mujoco", Question.TRAJECTORY, "Euler, defaults"): (SOFT, None),
    ("dart", Question.INSTANT, "World.step with weld constraints, defaults, to zero step"): (SOFT, None),
    ("dart", Question.TRAJECTORY, "World.step"): (STEPS, 1),
    ("exudyn", Question.TRAJECTORY, "TrapezoidalIndex2"): (STEPS, 2),
    ("exudyn", Question.TRAJECTORY, "GeneralizedAlpha"): (STEPS, 2),
    ("exudyn", Question.TRAJECTORY, "GeneralizedAlpha, defaults"): (STEPS, 2),
}


@pytest.fixture(scope="module")
def comparisons():
    case = replace(load_case("four_bar"), duration=1.0, instants=3)
    results = run_suite([case], ["mujoco", "dart", "exudyn"], resources=Resources(limit=400.0))
    assert not results.missing
    return {(c.engine, c.question, c.method): c for c in results.comparisons}


@pytest.mark.parametrize("key", EXPECTED, ids=" ".join)
def test_the_verdict_is_the_one_foretold(comparisons, key):
    verdict, order = EXPECTED[key]
    found = comparisons[key]
    assert found.verdict is verdict, found.why
    if order is not None:
        assert found.declared_order == order
        assert found.self_order == pytest.approx(order, abs=0.15)
    if verdict is SOFT:
        assert found.rule == "softness"
        assert found.profile is Profile.DEFAULT


def test_stock_loops_come_apart_and_tuned_ones_do_not(comparisons):
    """Welds of impedance 0.9 yield under the loads of the linkage; joint gaps in m."""
    stock = comparisons["mujoco", Question.TRAJECTORY, "Euler, defaults"].levels[-1]
    tuned = comparisons["mujoco", Question.TRAJECTORY, "RK4"].levels[-1]
    assert stock.residual > 1e-4
    assert tuned.residual < 1e-9
    assert stock.largest > 1e-4
    assert tuned.largest < 1e-8
