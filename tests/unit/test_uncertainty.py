"""Ladders of levels, bands, horizon and coverage, for known errors and known motions."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from consilience.audit.coverage import Skipped, Trial, coverage, exit_code, factor_of, ladder_trials, table
from consilience.case import Case, load_case
from consilience.compare.horizon import PERTURBATION, growth, judged_samples
from consilience.compare.motion import OBSERVABLES, Scales, difference_over_time
from consilience.compare.uncertainty import band, estimates, finest_order, needs_another_level, settled
from consilience.engine import Method, Question, Route
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import Plan
from consilience.mechanism import (
    Initial,
    closing_rows,
    constraint_jacobian,
    constraint_rates,
    constraint_residual,
    displaced_states,
    initial_state,
    refuse_overlap,
    strikes,
)
from consilience.reference import simulate
from consilience.suite.engine_runs import EngineCase
from mechanisms import LOOPS, TREES, states_of
from situations import MECHANISM, SHAPE, SIZE, TIMES, TRUE, motion

EPS = np.finfo(float).eps


def ladder(error, steps):
    return [motion(SIZE * SHAPE * error(h)) for h in steps]


def how(order, **levels):
    return Method("m", Route.NATIVE, order, **levels)


# ---------------------------------------------------------------- bands

ERRORS = {
    "order 1": (1, lambda h: 0.3 * h),
    "order 1 and 2": (1, lambda h: 0.3 * h - 5.0 * h**2),
    "order 2": (2, lambda h: 5.0 * h**2),
    "order 2 and 3": (2, lambda h: 5.0 * h**2 + 100.0 * h**3),
    "order 4": (4, lambda h: 1e3 * h**4),
    "order 4 and 6": (4, lambda h: 1e3 * h**4 + 1e6 * h**6),
    "order 1 for 2": (2, lambda h: 0.1 * h),
    "order 1.5 for 2": (2, lambda h: 0.1 * h**1.5),
    "order 3 for 2": (2, lambda h: 50.0 * h**3),
}


@pytest.mark.parametrize("name", ERRORS)
def test_the_band_holds_the_true_error_and_is_not_wide(name):
    order, error = ERRORS[name]
    steps = (0.02, 0.01, 0.005)
    answers = ladder(error, steps)
    scales = Scales.of(MECHANISM, TRUE)
    found = estimates(answers, how(order, substeps=(1, 2, 4)), steps, scales)
    assert [e.name for e in found] == list(OBSERVABLES)
    by_name = {e.name: e for e in found}
    true = np.max(OBSERVABLES["position"](answers[-1], TRUE, scales))
    assert true <= by_name["position"].band <= 20.0 * true
    assert by_name["orientation"].change < 1e-7  # the errors displace and do not rotate
    assert by_name["orientation"].order is None


@pytest.mark.parametrize(
    ("order", "declared", "expected"),
    [
        (2.0, 2, 1.25 / 3.0),  # at the declared order: Roache's safety factor 1.25
        (2.3, 2, 1.25 / 3.0),  # the observed order counts up to the declared one
        (1.6, 2, 1.25 / (2.0**1.6 - 1.0)),
        (1.4, 2, 3.0 / (2.0**1.4 - 1.0)),  # far from the declared order: safety factor 3, observed order
        (0.1, 2, 3.0 / (2.0**0.5 - 1.0)),  # the order counts from a half on
        (5.0, 2, 3.0 / 3.0),  # and up to the declared one
        (None, 2, 3.0 / 3.0),
    ],
)
def test_factor_and_order_of_a_band(order, declared, expected):
    assert band(1.0, order, declared, 2.0, 0.0) == pytest.approx(expected, rel=1e-14)
    assert band(0.0, order, declared, 2.0, 1000.0) == pytest.approx(1000.0 * EPS, rel=1e-14)


def test_a_ladder_of_tolerances_has_order_one_in_them():
    steps = (1e-5, 1e-6, 1e-7)
    answers = ladder(lambda tolerance: 30.0 * tolerance, steps)
    (position, *_) = estimates(answers, how(None, tolerances=steps), steps, Scales.of(MECHANISM, TRUE))
    assert position.order == pytest.approx(1.0, abs=1e-3)
    assert position.band == pytest.approx(1.25 * position.change / 9.0, rel=1e-6)


def test_without_a_ladder_there_is_no_estimate():
    scales = Scales.of(MECHANISM, TRUE)
    assert estimates([TRUE], how(2, substeps=(1,)), (0.1,), scales) == ()
    assert estimates([TRUE, TRUE], how(None, substeps=(1, 2)), (0.1, 0.05), scales) == ()


@pytest.mark.parametrize(
    ("order", "error", "more"),
    [
        (2, lambda h: 5.0 * h**2, False),
        (4, lambda h: 0.1 * h, True),
        (2, lambda h: 0.5 * np.tanh(3e3 * h**2), True),
        (2, lambda h: 1e-14 * h, False),  # rounding: finer levels would show no order
    ],
)
def test_levels_are_added_until_the_order_settles(order, error, more):
    steps = (0.02, 0.01, 0.005)
    assert needs_another_level(ladder(error, steps), how(order, substeps=(1, 2, 4)), steps) is more


def test_orders_are_read_from_the_finest_pair_that_rounding_does_not_hide():
    assert finest_order([4e-6, 1e-6, 1e-13], 2.0) == pytest.approx(2.0)
    assert finest_order([1e-13, 1e-14], 2.0) is None
    assert finest_order([1e-3, 1e-6], 10.0) == pytest.approx(3.0)
    with np.errstate(all="raise"):
        assert finest_order([1e-3, np.inf], 2.0) == -np.inf  # the finer motion diverges
    assert settled(1.5, 2)
    assert not settled(1.4, 2)
    assert not settled(None, 2)


def test_motions_that_blew_up_warn_of_nothing():
    """Their squares overflow."""
    levels = [motion(x) for x in (1e200, 1e170, 1e160)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert needs_another_level(levels, how(2, substeps=(10, 20, 40)), (0.02, 0.01, 0.005))


# ---------------------------------------------------------------- horizon


@pytest.mark.parametrize(
    "mechanism", [TREES["branched"], LOOPS["four_bar"], LOOPS["loop_universal"]], ids=lambda m: m.name
)
def test_displaced_states_are_near_and_consistent(mechanism):
    start = states_of(mechanism, 1)[0]
    for state in displaced_states(mechanism, start, PERTURBATION, 3, seed=1):
        distance = max(np.max(np.abs(state.p_WB - start.p_WB)), np.max(np.abs(state.quat_WB - start.quat_WB)))
        assert 1e-3 * PERTURBATION < distance < 3.0 * PERTURBATION
        assert np.max(np.abs(constraint_residual(mechanism, state, 0.0))) < 1e-13
        velocity = np.hstack([state.v_WB_W, state.w_WB_W]).ravel()
        slip = constraint_jacobian(mechanism, state) @ velocity - constraint_rates(mechanism, 0.0)
        assert np.max(np.abs(slip), initial=0.0) < 1e-12 * max(1.0, np.max(np.abs(velocity)))


@pytest.mark.parametrize("name", ["ball_rolls", "tripod", "pulled_boxes", "trough_slides"])
def test_displaced_states_leave_closed_what_is_closed(name):
    """An overlap of 1e-9 m is none of a start, and the motion from there has no answer."""
    case = load_case(name)
    for state in displaced_states(case.mechanism, case.initial_state, PERTURBATION, 3, seed=1):
        assert np.max(np.abs(state.p_WB - case.initial_state.p_WB)) > 1e-3 * PERTURBATION
        refuse_overlap(case.mechanism, state)
        assert len(closing_rows(case.mechanism, state)) == len(closing_rows(case.mechanism, case.initial_state)) > 0
        assert not strikes(case.mechanism, state)


def test_growth_is_that_of_an_inverted_pendulum():
    """A physical pendulum near its upper equilibrium departs as cosh(k t), k^2 = m g l / J."""
    mechanism = TREES["single_revolute"]
    (body,), (joint,) = mechanism.bodies, mechanism.joints
    arm = body.com - joint.M.p
    axis = joint.M.R[:, 2]
    across = arm - (arm @ axis) * axis
    inertia = axis @ body.inertia @ axis + body.mass * across @ across
    start = initial_state(mechanism)
    # gravity against the arm of the drawing: the drawing is the upper equilibrium
    up = across / np.linalg.norm(across)
    R = body.drawing.R
    upright = replace(mechanism, gravity=-9.81 * (R @ up), joint_springs=(), springs=(), loads=())
    rate = np.sqrt(body.mass * 9.81 * np.linalg.norm(across) / inertia)
    times = np.linspace(0.0, 2.0 / rate, 21)
    (displaced,) = displaced_states(upright, start, PERTURBATION, 1, seed=2)
    still = replace(displaced, v_WB_W=0 * displaced.v_WB_W, w_WB_W=0 * displaced.w_WB_W)
    growing = growth(upright, simulate(upright, start, times), [simulate(upright, still, times)])
    np.testing.assert_allclose(growing, np.cosh(rate * times), rtol=1e-5)


def test_growth_keeps_its_largest_value_and_is_one_where_nothing_can_be_displaced():
    wave = motion(PERTURBATION * SIZE * np.cos(3 * TIMES))
    found = growth(MECHANISM, TRUE, [wave])
    assert np.all(np.diff(found) >= 0.0)
    assert found[-1] == pytest.approx(1.0, rel=1e-6)
    np.testing.assert_array_equal(growth(MECHANISM, TRUE, [TRUE]), 1.0)
    np.testing.assert_array_equal(growth(MECHANISM, TRUE, []), 1.0)


@pytest.mark.parametrize("digits", [4, 8, 12])
def test_samples_are_judged_up_to_the_digits_asked(digits):
    growing = np.exp(20.0 * TIMES)
    first, sure = np.flatnonzero(EPS * growing >= 10.0**-digits), np.zeros(len(TIMES))
    assert judged_samples(growing, sure, digits) == (first[0] if len(first) else len(TIMES))
    assert judged_samples(np.ones(5), sure[:5], digits) == 5
    assert judged_samples(np.full(5, np.nan), sure[:5], digits) == 0


def test_the_uncertainty_of_the_reference_ends_judgement_only_where_the_motion_amplifies_it():
    spread = np.array([0.0, 1e-9, 1e-7, 1e-6])
    assert judged_samples(np.array([1.0, 10.0, 1e4, 1e5]), spread, 8) == 2
    assert judged_samples(np.array([1.0, 2.0, 3.0, 4.0]), spread, 8) == 4  # uncertainty without growth ends nothing


def test_growth_goes_on_at_its_rate_where_differences_are_not_small_any_more():
    """Growth is extrapolated as exp(8 t) once differences reach the size of the motion and saturate."""
    true_growth = np.exp(8.0 * TIMES)
    wave = motion(np.minimum(1e-8 * true_growth, 0.3) * SIZE)
    found = growth(MECHANISM, TRUE, [wave])
    np.testing.assert_allclose(found, true_growth, rtol=1e-2)


def test_the_difference_of_motions_does_not_see_the_sign_of_quaternions():
    flipped = replace(TRUE, quat_WB=-TRUE.quat_WB)
    assert np.max(difference_over_time(flipped, TRUE, SIZE)) < 1e-7


# ---------------------------------------------------------------- coverage


def trial(error, wide, engine="e"):
    return Trial("c", engine, "m", "position", error, wide, 2.0)


def test_coverage_is_the_part_that_holds_and_the_median_width():
    found = [trial(1.0, 2.0), trial(1.0, 4.0), trial(1.0, 0.5), trial(1.0, 8.0)]
    assert coverage(found) == (0.75, 3.0)
    assert exit_code(found) == 1
    assert exit_code([trial(1.0, 2.0)] * 19 + [trial(1.0, 0.5)]) == 0
    assert exit_code([trial(1.0, 50.0)] * 3) == 1  # every band holds, but all are too wide to be useful
    assert exit_code([Skipped("c", "e", "m", "no ladder of steps")]) == 3


class KnownErrors:
    """A worker whose motions err by a function of the step."""

    engine = "e"

    def __init__(self, error):
        self.error = error

    def ask(self, request):
        return Reply(motion(SIZE * SHAPE * self.error(request.step)), returned=True)


STALLED = {  # declared order, error of a step in s, and what becomes of the position, at 10, 5 and 2.5 ms
    "clean": (2, lambda h: 0.3 * h**2, True),
    "rounding": (2, lambda h: 1e-12 * h, "is rounding"),
    "worse with smaller steps": (1, lambda h: 1e-9 / h, "smaller steps lead nowhere, so that no run tells the error"),
    "levels that all miss the same": (2, lambda h: min(h, 2e-3), False),
    "the same of order four": (4, lambda h: 1e-3 + (h / 0.1) ** 4 if h > 2e-3 else 0.0, False),
}


@pytest.mark.parametrize("name", STALLED)
def test_a_band_does_not_hold_only_where_finer_runs_tell_the_error(name):
    """An error of order two is a sixteenth at a quarter of the step; a constant one shows at smaller steps alone."""
    order, error, expected = STALLED[name]
    worker, method, steps = KnownErrors(error), how(order, substeps=(10, 20, 40)), [0.01, 0.005, 0.0025]
    case, plan = Case("c", "c.toml", "a body", MECHANISM, Initial(), 2.0, 0.05, 6, 1, 1), Plan({}, {}, {})
    runs = list(EngineCase(worker, case, plan).ladder(Question.TRAJECTORY, method, steps))
    found = next(ladder_trials(worker, case, plan, method, runs[:3]))
    if isinstance(expected, str):
        assert isinstance(found, Skipped)
        assert found.reason.startswith("position: ")
        assert found.reason.endswith(expected)
    else:
        assert isinstance(found, Trial)
        assert found.covered == expected


def test_finer_runs_leave_a_sixteenth_of_the_error():
    assert [factor_of(order, 0.1) for order in (1, 2, 3, 4, 6)] == [16, 4, 4, 2, 2]
    assert factor_of(1, 1.0) == 8  # in 8 s
    assert factor_of(1, 100.0) == 4


def test_the_table_lists_what_does_not_hold_and_what_was_skipped():
    text = table([trial(1.0, 2.0), trial(3.0, 1.0, "f"), Skipped("c", "g", "", "cannot")])
    assert "| e | m | 1 | 100.0 % | 2 |" in text
    assert "| all |  | 2 | 50.0 % | 1.2 |" in text
    assert "| c | f | m | position | 2.00 | 3.00e+00 | 1.00e+00 |" in text
    assert "- c, g, all methods: cannot" in text
    assert "all |" not in table([Skipped("c", "g", "", "cannot")])
