"""Taylor's method for planar mechanisms: coefficients, steps, and motions against other integrators."""

import numpy as np
import pytest

from consilience.case import load_case
from consilience.errors import InvalidInput, NumericalFailure
from consilience.mechanism import constraint_jacobian, constraint_rates, constraint_residual
from consilience.reference import simulate
from consilience.reference.bodies.canonical import canonical_motion
from consilience.reference.steppers.driver import MotionRequest, counts_of, run
from consilience.reference.tree.records import LARGEST_ORDER
from consilience.reference.tree.solver import _prepare
from consilience.reference.tree.state import pack_state
from consilience.reference.tree.taylor import LOWEST_ORDER, order_for
from consilience.reference.tree.taylor_rows import LINE, LOCK, PIN
from flat import PLANAR
from mechanisms import states_of

SERIES = ("pendulum", "slide", "chain", "backward", "branched", "closed_on_ground", "two_loops")
SERIES += ("closed_revolute", "closed_prismatic", "closed_point_on_line")


LENGTHS = {1: 0.0025, 2: 0.005, 3: 0.01, 5: 0.02, 8: 0.05}
"""By order: length of a step, in units of the fastest rate, at which a few digits are correct."""


def one_step(mechanism, state, h, order):
    """Return the velocities of all bodies after one step by a series of the given order."""
    prepared = _prepare(mechanism, False)
    working = prepared.working("taylor")
    z = pack_state(prepared.links, prepared.packing, state)
    motion, tolerance = np.empty((2, *working.system.tree.y.shape)), np.exp(1.9 - order)
    assert order_for(tolerance) == order
    assert not run(working.integration, MotionRequest(z, np.array([0.0, h]), tolerance, np.inf), motion, False)
    assert counts_of(working.integration.motion.run)["steps"] == 1
    _, _, v, w = canonical_motion(prepared.links.com, motion)
    return np.hstack([v[-1], w[-1]])


@pytest.mark.parametrize("order", LENGTHS)
@pytest.mark.parametrize("name", SERIES)
def test_the_error_of_a_step_has_the_order_of_the_series_plus_one(name, order):
    """Against Gauss collocation in space: the error of velocities goes with h^(order + 1), or better by chance."""
    mechanism = PLANAR[name]
    (state,) = states_of(mechanism, 1)
    rate = max(1.0, np.max(np.abs(state.w_WB_W)), np.max(np.abs(state.v_WB_W)))
    lengths = np.array([1.0, 0.5]) * LENGTHS[order] / rate
    truth = simulate(mechanism, state, np.append(0.0, lengths[::-1]), 1e-14, "relative", "gauss")
    exact = np.concatenate([truth.v_WB_W, truth.w_WB_W], axis=2)[:0:-1]
    errors = [np.max(np.abs(one_step(mechanism, state, h, order) - e)) for h, e in zip(lengths, exact, strict=True)]
    rounding = 3e-13 * rate
    assert errors[1] <= max(rounding, errors[0] * 0.5 ** (order + 0.3))


def test_loops_are_closed_by_rows_of_every_kind():
    kinds = {
        name: set(_prepare(PLANAR[name], False).working("taylor").integration.held[1].rows.kind) for name in SERIES
    }
    assert kinds["closed_revolute"] == {PIN}
    assert kinds["closed_prismatic"] == {LINE, LOCK}
    assert kinds["closed_point_on_line"] == {LINE}


@pytest.mark.parametrize("tolerance", 10.0 ** -np.arange(3, 14.1, 0.5))
def test_a_motion_from_rest_is_as_accurate_as_asked(tolerance):
    """From rest every second coefficient is zero, and others may be small at any order."""
    case = load_case("chrono_double_pendulum")
    asked = case.mechanism, case.initial_state, np.linspace(0.0, 2.0, 3)
    found, fine = simulate(*asked, tolerance, "relative", "taylor"), simulate(*asked, 1e-14, "relative", "dop853")
    assert np.max(np.abs(found.p_WB - fine.p_WB)) < max(1e-13, tolerance)


@pytest.mark.parametrize(
    "name",
    [
        "physical_pendulum-rotating",
        "double_pendulum",
        "four_bar",
        "slider_crank",
        "collinear_four_bar",
        "five_bar_platform",
    ],
)
def test_motions_are_those_of_another_method(name):
    case = load_case(name)
    asked = case.mechanism, case.initial_state, np.linspace(0.0, 5.0, 11)
    found, other = (simulate(*asked, 1e-12, "relative", by) for by in (None, "dop853"))
    assert found.counters["steps"] < other.counters["steps"] / 1.4
    for field in ("p_WB", "v_WB_W", "w_WB_W"):
        scale = max(1.0, np.max(np.abs(getattr(other, field))))
        assert np.max(np.abs(getattr(found, field) - getattr(other, field))) < 2e-10 * scale


def test_samples_cost_no_steps_and_are_closed():
    case = load_case("four_bar")
    few, many = (
        simulate(case.mechanism, case.initial_state, np.linspace(0.0, 2.0, n), 1e-9, "relative", "taylor")
        for n in (2, 401)
    )
    assert few.counters == many.counters
    for state in map(many.state, range(0, 401, 7)):
        rates = constraint_jacobian(case.mechanism, state) @ np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
        assert np.max(np.abs(constraint_residual(case.mechanism, state))) < 2e-14
        assert np.max(np.abs(rates - constraint_rates(case.mechanism))) < 1e-13


def test_order_grows_with_the_digits():
    """Orders that all cost the same cost least, p tolerance^(-1/p) in all, next to p = -log(tolerance)."""
    orders = np.arange(1, LARGEST_ORDER + 1)
    for digits in range(3, 15):
        cheapest = orders[np.argmin(orders * 10.0 ** (digits / orders))]
        assert cheapest <= order_for(10.0**-digits) <= cheapest + 2


@pytest.mark.parametrize(("name", "end"), [("single_prismatic", 2.0), ("double_pendulum", 1e-3)])
def test_a_series_ends_at_the_lowest_order_that_reaches_the_end(name, end):
    """A fall is a polynomial; a swing of a millisecond needs few terms, too."""
    case = load_case(name)
    asked = case.mechanism, case.initial_state, np.linspace(0.0, end, 5)
    found, fine = simulate(*asked, 1e-12, "relative", "taylor"), simulate(*asked, 1e-14, "relative", "gauss")
    assert (found.counters["steps"], found.counters["evaluations"]) == (1, LOWEST_ORDER)
    for field in ("p_WB", "v_WB_W", "w_WB_W"):
        np.testing.assert_allclose(getattr(found, field), getattr(fine, field), rtol=0, atol=1e-13)


def test_another_integrator_takes_motions_through_poses_that_lose_rank():
    case = load_case("parallelogram")
    asked = case.mechanism, case.initial_state, np.linspace(0.0, 1.0, 5), 1e-12, "relative"
    usual, other = simulate(*asked), simulate(*asked, "tp86")
    np.testing.assert_array_equal(usual.p_WB, other.p_WB)
    with pytest.raises(NumericalFailure, match=r"taylor.*lose rank"):
        simulate(*asked, "taylor")


def test_an_abandoned_motion_does_not_change_the_next():
    """Work arrays are reused: the motions before and after an abandoned one are equal to the last bit."""
    case = load_case("parallelogram")
    asked = case.mechanism, case.initial_state, np.linspace(0.0, 1.0, 5)
    before, left, after, again = (simulate(*asked, tol, "relative") for tol in (1e-10, 1e-12, 1e-10, 1e-12))
    for observable in ("p_WB", "w_WB_W"):
        np.testing.assert_array_equal(getattr(before, observable), getattr(after, observable))
        np.testing.assert_array_equal(getattr(left, observable), getattr(again, observable))


@pytest.mark.parametrize("name", ["spatial_slider_crank", "acrobot", "four_bar_driven", "rolling_disc"])
def test_a_mechanism_without_series_is_refused(name):
    case = load_case(name)
    with pytest.raises(InvalidInput, match=r"taylor cannot follow .* planes by gravity alone"):
        simulate(case.mechanism, case.initial_state, np.array([0.0, 1.0]), 1e-9, "relative", "taylor")


def test_a_motion_that_is_not_finite_is_no_answer():
    case = load_case("double_pendulum")
    state = case.initial_state
    state = type(state)(state.p_WB, state.quat_WB, state.v_WB_W, 1e200 * np.ones_like(state.w_WB_W))
    with pytest.raises(NumericalFailure, match=r"taylor.*not finite"):
        simulate(case.mechanism, state, np.array([0.0, 1.0]), 1e-9, "relative")


def test_a_series_that_ends_is_one_step():
    """A body that slides down a plane has a series of three terms."""
    case = load_case("adams_prismatic_02")
    motion = simulate(case.mechanism, case.initial_state, np.linspace(0.0, 5.0, 11), 1e-12, "relative")
    assert motion.counters["steps"] == 1
