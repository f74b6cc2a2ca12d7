"""The table of verdicts of the contact group, and the comparison of a report with it."""

from types import SimpleNamespace

from consilience.case import load_cases
from consilience.compare.rules import RULES
from contact_verdicts import AGREES, differences, expected

CAUSES = {rule.name for rule in RULES} | {"unsupported", "failed"}


def test_every_motion_of_the_table_is_of_a_case_and_has_a_reason_where_it_does_not_agree():
    table = expected()
    for one in table:
        assert one.cause in CAUSES, one
        assert one.reason or one.cause in AGREES, one
    files = {case.rsplit("-", 1)[0] if "-" in case else case for case in {one.case for one in table}}
    assert {case.name for name in files for case in load_cases(name)} == {one.case for one in table}


def test_a_report_that_differs_from_the_table_is_told():
    (one, *_) = table = [e for e in expected() if e.case == "ball_rolls"]

    def line(e, rule):
        return {
            "question": "trajectory",
            "case": e.case,
            "engine": e.engine,
            "method": e.method,
            "verdict": "agrees",
            "rule": rule,
            "why": "because",
        }

    record = SimpleNamespace(comparisons=[line(e, e.cause) for e in table], cases=[{"name": "ball_rolls"}])
    assert list(differences(record, table)) == []
    record.comparisons[0] = line(one, "elsewhere")
    assert list(differences(record, table)) == [
        f"ball_rolls on {one.engine}, {one.method}: {one.cause} -> elsewhere (because)"
    ]
    del record.comparisons[0]
    assert list(differences(record, table)) == [f"ball_rolls on {one.engine}, {one.method}: {one.cause} -> no motion"]
