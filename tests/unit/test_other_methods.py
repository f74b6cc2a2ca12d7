"""An engine's methods at an instant in the light of one another: solver, extrapolation and tuning are no model."""

from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Case
from consilience.compare import Quantity, Verdict
from consilience.compare.judge import REFERENCE, judge_case, question_judge
from consilience.compare.other_methods import lost_by_solver, reconsidered
from consilience.compare.result import compare_by_bars
from consilience.engine import InstantAnswer, Method, Profile, Question, Route, Run, Status
from consilience.mechanism import Initial
from consilience.report.record import Record
from consilience.report.summary import matrix
from consilience.suite import QUICK
from situations import MECHANISM, SHAPE, SIZE, TRUE, motion

CASE = Case("c", "c.toml", "one state", MECHANISM, Initial(), 1.0, 0.1, 8, 1, 1)


def instant(route, difference, bar=1e-11, name="accelerations", engine="e", **method):
    """Return the comparison of one method at an instant by one quantity."""
    how = Method(f"{route}, {method}", route, **method)
    return compare_by_bars("c", engine, Question.INSTANT, how, (Quantity(name, difference, bar, 6),))


TERMS = instant(Route.HARNESS_SOLVE, 1e-14)
DEFAULTS = {"profile": Profile.DEFAULT}


@pytest.mark.parametrize(
    ("route", "difference", "bar", "verdict", "words"),
    [
        (Route.TUNED, 9e-10, 1e-11, Verdict.UNRESOLVED, "14.0 digits: its solver"),
        (Route.EXTRAPOLATED, 9e-5, 1e-8, Verdict.UNRESOLVED, "14.0 digits: its extrapolation"),
        (Route.EXTRAPOLATED, 1.1e-4, 1e-8, Verdict.MODEL, "above the bar"),
        (Route.TUNED, 1.1e-9, 1e-11, Verdict.MODEL, "above the bar"),
        (Route.TUNED, 9e-6, 1e-8, Verdict.UNRESOLVED, "14.0 digits: its solver"),  # a condition of 1e3 squared: 1e-5
        (Route.TUNED, 1.1e-5, 1e-8, Verdict.MODEL, "above the bar"),
        (Route.TUNED, 9e-12, 1e-11, Verdict.AGREES, "within the bar"),
    ],
)
def test_few_digits_are_the_solvers_where_the_terms_agree(route, difference, bar, verdict, words):
    one = instant(route, difference, bar)
    (found, terms) = reconsidered([one, TERMS])
    assert (found.verdict, terms) == (verdict, TERMS)
    assert words in found.why
    assert found.rule == ("solver" if verdict is Verdict.UNRESOLVED else "")


@pytest.mark.parametrize(
    "others",
    [[], [replace(TERMS, engine="another")], [instant(Route.HARNESS_SOLVE, 1e-10)], [instant(Route.NATIVE, 1e-14)]],
    ids=["alone", "terms of another engine", "terms that differ", "another solver"],
)
def test_without_its_own_terms_a_missed_bar_is_the_model(others):
    assert reconsidered([instant(Route.TUNED, 5e-11), *others])[0].verdict is Verdict.MODEL


def inexact(route=Route.NATIVE, **method):
    """Return an instant at which a solver loses 5e-8 in ill-conditioned equations."""
    return reconsidered([instant(route, 5e-8, 1e-9, **method), TERMS])[0]


@pytest.mark.parametrize(
    ("before", "lost"),
    [
        (inexact(), 5e-8),
        (replace(inexact(), engine="another"), 0.0),
        (inexact(**DEFAULTS), 0.0),
        (inexact(Route.EXTRAPOLATED), 0.0),
        (instant(Route.NATIVE, 5e-8, 1e-9), 0.0),
        (instant(Route.NATIVE, 5e-8, 1e-7), 5e-8),
        (instant(Route.NATIVE, 9e-12, 1e-7), 0.0),
        (instant(Route.HARNESS_SOLVE, 5e-8, 1e-7), 0.0),
    ],
    ids=[
        *("its solver", "of another engine", "at the defaults", "its extrapolation", "its model"),
        *("its solver within the bar", "its solver, no worse than rounding", "other terms"),
    ],
)
def test_what_a_solver_loses_is_that_of_the_engine_with_the_same_settings(before, lost):
    assert lost_by_solver([before, TERMS], "e", Profile.MATCHED) == lost


@pytest.mark.parametrize(
    ("before", "rule"),
    [
        ([inexact()], "inexact solver"),
        ([instant(Route.NATIVE, 5e-8, 1e-7), TERMS], "inexact solver"),
        ([instant(Route.NATIVE, 5e-8, 1e-7), instant(Route.HARNESS_SOLVE, 2e-8, 1e-7)], "elsewhere"),
        ([inexact(**DEFAULTS)], "elsewhere"),
        ([], "elsewhere"),
    ],
    ids=["its solver", "its solver within the bar", "its terms as well", "at the defaults", "nothing"],
)
def test_a_motion_that_keeps_what_the_solver_loses_blames_no_model(before, rule):
    """A plateau of 1e-7 beside errors of order four, where a solver loses 5e-8 at instants."""
    steps = (0.02, 0.01, 0.005)
    method = Method("m", Route.HARNESS_INTEGRATOR, 4, (10, 20, 40))
    errors = [SIZE * SHAPE * (1e-7 + h**4) for h in steps]
    levels = [
        Run("c", "e", Question.TRAJECTORY, method, n, h, Status.ANSWERED, motion(error))
        for n, (h, error) in enumerate(zip(steps, errors, strict=True))
    ]
    truth = Run(
        "c", REFERENCE, Question.TRAJECTORY, Method("r", Route.REFERENCE), 0, None, Status.ANSWERED, answer=TRUE
    )
    judge = question_judge(CASE, [truth], Question.TRAJECTORY, before)
    assert judge.compare(levels, ()).rule == rule


def test_a_quick_run_asks_at_states_by_all_methods():
    """Otherwise the solver of a headline method is taken for the model."""
    methods = (headline := Method("solver", Route.TUNED), Method("terms", Route.HARNESS_SOLVE))
    assert QUICK.some(methods, "e", Question.INSTANT) == methods
    assert QUICK.some(methods, "e", Question.TRAJECTORY) == (headline,)
    assert len(QUICK.some(2 * methods, REFERENCE, Question.INSTANT)) == QUICK.reference_methods


def test_masses_and_energies_are_no_matter_of_a_solver():
    assert reconsidered([instant(Route.TUNED, 5e-12, 1e-12, name="kinetic energy"), TERMS])[0].verdict is Verdict.MODEL


@pytest.mark.parametrize(
    ("mine", "defaults", "verdict"),
    [(1e-2, 9e-7, Verdict.UNRESOLVED), (1e-2, 2e-3, Verdict.AGREES), (1e-12, 1e-14, Verdict.AGREES)],
    ids=["worse in a wide bar", "not much worse", "worse, by rounding"],
)
def test_tuning_that_makes_an_engine_worse_is_none(mine, defaults, verdict):
    own = instant(Route.NATIVE, defaults, **DEFAULTS)
    found = reconsidered([instant(Route.TUNED, mine, max(1e-11, 2.0 * mine)), own])[0]
    assert (found.verdict, found.rule) == (verdict, "tuning" if verdict is Verdict.UNRESOLVED else "")


@pytest.mark.parametrize(("engine", "verdict"), [(REFERENCE, Verdict.AGREES), ("e", Verdict.MODEL)])
def test_two_formulations_of_the_reference_may_both_be_off_by_a_bar(engine, verdict):
    """1.5e-11 where the bar of well-conditioned equations is 1e-11."""
    rng = np.random.default_rng(3)
    vectors = [rng.normal(size=(1, 1, 3)) for _ in range(4)]
    truth = InstantAnswer(*vectors, kinetic=np.ones(1), potential=np.ones(1))
    off = replace(truth, a_WB_W=truth.a_WB_W + 1.5e-11 * np.max(np.abs(np.concatenate(vectors[:2]))))
    runs = [
        Run("c", name, Question.INSTANT, Method(how, Route.REFERENCE), 0, None, Status.ANSWERED, answer=answer)
        for name, how, answer in ((REFERENCE, "first", truth), (engine, "second", off))
    ]
    assert [c.verdict for c in judge_case(CASE, runs)] == [verdict]


def test_the_matrix_shows_a_reference_that_differs_from_itself():
    record = Record(
        header={"engines": ["reference", "e"]}, cases=[{"name": "c"}], runs=[], comparisons=[], cells=[], footer={}
    )
    agrees = {"case": "c", "engine": "reference", "question": "instant", "profile": "matched"}
    agrees |= {"verdict": "agrees", "digits": 12.0}
    assert matrix(replace(record, comparisons=[agrees]))[0] == ["e"]
    differs = agrees | {"verdict": "differs: model", "digits": 3.0}
    assert matrix(replace(record, comparisons=[agrees, differs])) == (
        ["reference", "e"],
        [("c", ["\u2260 3.0", "not asked"])],
    )
