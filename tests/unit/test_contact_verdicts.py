"""The table of what each engine must be found to do in the contact group, and the comparison of a report with it."""

from types import SimpleNamespace

import pytest

from consilience.case import shipped_cases
from consilience.compare import Verdict
from consilience.compare.rules import RULES
from consilience.engine import Question, load_engine
from contact_verdicts import ANSWERS, differences, held_open, rows

ENGINES = ("dart", "exudyn", "mujoco", "pinocchio")
TABLE = list(rows())
CASES = {case.name: case for case in shipped_cases() if "contact" in case.tags}


@pytest.mark.parametrize("engine", ENGINES)
def test_every_method_about_a_case_has_one_row_and_what_cannot_be_stated_is_unsupported(engine):
    engine_, about = load_engine(engine), [row for row in TABLE if row.engine == engine]
    for name, case in CASES.items():
        own = [row for row in about if row.case == name]
        if engine_.unsupported(case.mechanism, Question.TRAJECTORY):
            assert [(row.profile, row.answer) for row in own] == [("matched", "unsupported")], name
            continue
        for method in engine_.methods(case.mechanism, Question.TRAJECTORY):
            fitting = [row for row in own if row.profile == method.profile and row.method in ("", method.name)]
            assert len(fitting) == 1, (name, method.name)


def test_rows_are_of_cases_and_have_answers_causes_and_methods_that_exist():
    causes, verdicts = {rule.name for rule in RULES}, {str(verdict) for verdict in Verdict}
    assert {row.case for row in TABLE} == set(CASES)
    assert {verdict for fitting in ANSWERS.values() for verdict in fitting} <= verdicts
    for row in TABLE:
        assert row.answer in ANSWERS, row
        assert row.cause in ("", *causes), row
        assert row.why, row
    assert {case for case, *_ in held_open()} <= set(CASES)


def test_a_report_that_differs_from_the_table_is_told():
    table = [row for row in TABLE if row.case == "rod_hits_floor-backward" and row.engine == "pinocchio"]

    def told(verdict, rule):
        comparison = {
            **{"question": "trajectory", "case": "rod_hits_floor-backward", "engine": "pinocchio"},
            **{"profile": "matched", "method": "any", "verdict": verdict, "rule": rule, "why": "because"},
        }
        return list(differences(SimpleNamespace(comparisons=[comparison]), table))

    assert told("differs: model", "impact law") == []
    assert "other, impact law, found differs: model, elsewhere (because)" in told("differs: model", "elsewhere")[0]
    assert "found agrees, agreement" in told("agrees", "agreement")[0]
