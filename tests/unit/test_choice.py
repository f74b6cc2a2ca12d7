"""Which engine for which work: classes by tags, medians and the figure of a record of invented runs."""

import pytest

from consilience.compare import Verdict
from consilience.report.choice import choice_figure, choice_view, class_of
from consilience.report.view import page
from consilience.report.wording import DASH
from records import comparison, record_of


@pytest.fixture
def ran():
    return record_of(
        [
            comparison("one", "alpha", "trajectory", Verdict.MODEL, horizon=1.0),
            comparison("one", "beta_1", "trajectory", Verdict.DISCRETISATION),
            comparison("one", "beta_1", "trajectory", profile="default", method="stock"),
            comparison("two", "alpha", "instant"),
        ]
    )


@pytest.mark.parametrize(
    ("first", "second", "feature"),
    [
        ("contact 'floor': no contacts", "contact 'wall': no contacts", "contact: no contacts"),
        (
            "contact 'a', which hits with 3.49e+03 N: 2 rows",
            "contact 'b', which hits with 17 N: 2 rows",
            "contact, which hits with \N{HORIZONTAL ELLIPSIS} N: 2 rows",
        ),
    ],
)
def test_elements_that_are_refused_for_one_reason_are_one_feature(first, second, feature):
    refused = [
        comparison(case, "alpha", "model", Verdict.UNSUPPORTED, why=why)
        for case, why in (("one", first), ("two", second))
    ]
    record = record_of(refused, engines=("alpha",))
    (row,) = choice_view(record, page(record).engines).missing
    assert (row.reason, row.count) == (feature, 2)


@pytest.mark.parametrize(
    ("tags", "name"),
    [(["loop", "stiff"], "stiff"), (["loop", "contact"], "contact"), (["loop"], "loop"), (["chain"], "tree")],
)
def test_a_case_has_the_first_class_of_its_tags(tags, name):
    assert class_of({"tags": tags}) == name


def test_rows_and_markers_are_the_best_motion_of_each_engine(ran):
    """CPU time is that of the finest level over the duration; digits are those of the record."""
    rows = {row.engine: row for row in choice_view(ran, page(ran).engines).rows}
    case = next(one for one in ran.cases if one["name"] == "one")
    for engine in ("alpha", "beta_1"):
        (motion,) = [c for c in ran.motions("one") if c["engine"] == engine and c["profile"] == "matched"]
        (trace,) = [t for t in choice_figure(ran)["data"] if t["name"] == engine]
        assert trace["y"] == [pytest.approx(motion["digits"], abs=0.01)]
        assert trace["x"] == [pytest.approx(motion["levels"][-1]["cpu"] / case["duration"], rel=1e-2)]
        assert rows[engine].values[:2] == ("1", f"{motion['digits']:.1f}")
    assert rows["alpha"].values[3] == DASH
    # at the first step, which is the engine's own, the motion is off by 1e-4
    assert rows["beta_1"].values[3] == "4.0"
