"""The headline of a record: model first, then motions by the best method, then the cells to look at."""

from consilience.compare import Verdict
from consilience.report.headline import headline, look_first
from records import comparison, record_of


def test_a_worse_integrator_beside_a_good_one_changes_neither_the_model_nor_the_motions():
    record = record_of(
        [
            comparison("crane", "alpha", "instant"),
            comparison("crane", "alpha", "trajectory", Verdict.DISCRETISATION, method="Euler", digits=2.0),
            comparison("crane", "alpha", "trajectory", digits=9.0),
            comparison("crane", "beta_1", "instant"),
            comparison("crane", "beta_1", "trajectory", Verdict.DISCRETISATION, digits=3.0),
            comparison("crane", "beta_1", "trajectory", route="engine accelerations with the harness's integrator"),
        ]
    )
    assert headline(record) == (
        "2 of 2 cells agree at model and instant",
        (
            "1 of 2 motions reaches the digits asked, by the engine's own integrator or else the harness's; "
            "1 needs smaller steps, not another model"
        ),
    )
    assert look_first(record) == ()


def test_what_an_engine_refuses_is_not_counted_and_does_not_hide_what_it_answers():
    record = record_of(
        [
            comparison("crane", "alpha", "model"),
            comparison("crane", "alpha", "instant", Verdict.UNSUPPORTED),
            comparison("crane", "beta_1", "model", Verdict.UNSUPPORTED),
            comparison("crane", "reference", "model", Verdict.MODEL),
        ],
        missing={"gone": "ImportError"},
    )
    assert headline(record) == (
        "1 of 1 cell agrees at model and instant; 1 holds something the engine cannot represent",
        "1 engine not available: gone",
    )


def test_each_cell_to_look_at_is_one_line_with_its_first_cause_the_gravest_first():
    record = record_of(
        [
            comparison("arm", "alpha", "instant", Verdict.UNRESOLVED, why="nothing to\n compare"),
            comparison("crane", "alpha", "instant", Verdict.MODEL, why="accelerations: difference 2e-08"),
            comparison("crane", "alpha", "trajectory", Verdict.MODEL, rule="elsewhere"),
            comparison("crane", "beta_1", "trajectory", Verdict.MODEL, profile="default"),
            comparison("arm", "beta_1", "trajectory", Verdict.FAILED, why="signal SIGSEGV", method=""),
        ]
    )
    assert [cell.line for cell in look_first(record)] == [
        "! arm, beta_1: No usable answer (trajectory: signal SIGSEGV)",
        (
            "≠ crane, alpha: Other accelerations, reactions or energies than the case's "
            "(instant, solve: accelerations: difference 2e-08)"
        ),
        "? arm, alpha: There is nothing to judge by (instant, solve: nothing to compare)",
    ]


def test_a_worse_method_that_leads_to_another_model_is_told_beside_the_best():
    record = record_of(
        [
            comparison("crane", "alpha", "trajectory", Verdict.MODEL, method="Euler", digits=2.0),
            comparison("crane", "alpha", "trajectory", digits=9.0),
            comparison("crane", "beta_1", "trajectory", Verdict.MODEL, digits=1.0),
        ]
    )
    reached, beside = headline(record)
    assert reached.startswith("1 of 2 motions reaches")
    assert reached.endswith("; 1 differs in the model")
    assert beside == "1 motion differs in the model by another method"
