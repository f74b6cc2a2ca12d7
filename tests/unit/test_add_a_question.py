"""A new question needs one module and one row: the example of docs/add-a-question.md in worker, store and report."""

import re
from contextlib import closing

import numpy as np
import pytest

from consilience.case import load_case
from consilience.cli.options import chosen_questions
from consilience.compare import Verdict
from consilience.engine import EngineInfo, Question, Status, defects, questions
from consilience.engine.worker import codec
from consilience.engine.worker.client import InProcessEngine, Request, Worker
from consilience.engine.worker.messages import RecentlySent, job
from consilience.engine.worker.requests import AnswerSet, offer
from consilience.engine.worker.server import Server, _Bytes, read_frames
from consilience.report.record import read_record
from consilience.suite import Store, ask_case
from hostile.pages import opened
from mechanisms import states_of
from pages import ROOT, blocks

PAGE = ROOT / "docs" / "add-a-question.md"
CASE = load_case("double_pendulum")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Run the Python blocks of the page in a temporary folder, yield the names they define, and restore the tables."""
    rows, answers = dict(questions._ROWS), dict(questions.ANSWERS)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        names, printed = {"__name__": "page"}, []
        for block in blocks(PAGE):
            if block.language == "python":
                names["print"] = printed.append
                exec(compile("\n" * block.line + block.text, block.page, "exec"), names)
        yield names | {"printed": printed, "folder": names["Path"].cwd() / "momentum-report"}
    for table, kept in ((questions._ROWS, rows), (questions.ANSWERS, answers)):
        table.clear()
        table.update(kept)


def words(line):
    """Return the line without quantities that are rounding: differences below 1e-14 and their names."""
    return re.sub(r"(linear|angular) momentum: difference [\d.]+e-1[4-9]", "momentum: difference", line)


def test_the_page_prints_what_it_says(page):
    (expected,) = [block.text.splitlines() for block in blocks(PAGE) if block.language == "text"]
    assert [words(line) for line in page["printed"]] == [words(line) for line in expected]


def test_the_question_is_in_the_table(page):
    momentum = page["MOMENTUM"]
    assert list(Question)[-1] is momentum
    assert Question("momentum") is momentum
    assert chosen_questions(["momentum"]) == [momentum]
    assert (momentum.at_states, momentum.over_time, momentum.at_levels) == (True, False, False)
    assert momentum.sample_count(7, 100) == 7


def test_engines_are_told_apart(page):
    verdicts = {c.engine: c.verdict for c in page["comparisons"]}
    assert verdicts == {"toy": Verdict.AGREES, "hasty": Verdict.MODEL, "without": Verdict.UNSUPPORTED}
    assert {c.question for c in page["comparisons"]} == {page["MOMENTUM"]}
    assert next(c for c in page["comparisons"] if c.engine == "toy").digits > 12.0


def test_the_job_and_the_answer_travel(page):
    """A worker gets parameters and arrays to the last bit, and the caller gets the answer to the last bit."""
    question, states, point = page["MOMENTUM"], states_of(CASE.mechanism, 3), np.array([0.1, 0.2, 0.3])
    engine, method = page["Toy"](), page["Toy"]().methods(CASE.mechanism, None)[0]
    (mechanism, first), (key, second) = RecentlySent().need(CASE.mechanism), RecentlySent().need(method)
    server = Server()
    server.engine = engine
    for about in (point, 2.0 * point):
        request = Request(CASE.mechanism, question, method, states, parameters={"point": about})
        sent = first + second + job(request, mechanism, key, 7)
        *_, reply = [server.handle(message) for message in read_frames(_Bytes(sent))]
        (message,) = read_frames(_Bytes(reply))
        assert message.header.entries["reason"] == ""
        answer = codec.value_of(message.header, message.arrays)
        true = engine.momentum(CASE.mechanism, states, about, method)
        assert type(answer) is page["MomentumAnswer"]
        np.testing.assert_array_equal(answer.linear, true.linear)
        np.testing.assert_array_equal(answer.angular, true.angular)


def test_a_survey_asks_the_question_by_all_methods(page):
    request = Request(CASE.mechanism, states=CASE.states, survey=(page["MOMENTUM"],), parameters={"point": np.zeros(3)})
    answers = InProcessEngine("toy", page["Toy"]()).ask(request).value
    assert isinstance(answers, AnswerSet)
    assert [type(said.answer) for said in answers.said] == [page["MomentumAnswer"]]


def test_the_answer_is_kept_by_its_parameters(page, tmp_path):
    toy, info = InProcessEngine("toy", page["Toy"]()), EngineInfo("toy", "1.0", "1.0")
    with closing(Store(tmp_path)) as store:
        (first,) = ask_case(toy, CASE, [page["MOMENTUM"]], store=store, info=info)
        toy._engine.momentum = None  # a second question to the engine would now fail
        (again,) = ask_case(toy, CASE, [page["MOMENTUM"]], store=store, info=info)
        keys = {
            store.key(info, Request(CASE.mechanism, page["MOMENTUM"], parameters={"point": np.full(3, x)}))
            for x in (0.0, 1.0)
        }
    np.testing.assert_array_equal(again.answer.angular, first.answer.angular)
    assert len(keys) == 2


def test_an_answer_of_the_wrong_form_is_told(page):
    good = page["Toy"]().momentum(CASE.mechanism, CASE.states, np.zeros(3), None)
    count = len(CASE.states)
    assert not defects(good, page["MOMENTUM"], CASE.mechanism, count)
    assert defects(good, page["MOMENTUM"], CASE.mechanism, count + 1)
    assert defects(good, Question.INSTANT, CASE.mechanism, count)
    bad = type(good)(good.linear, None)
    assert defects(bad, page["MOMENTUM"], CASE.mechanism, count) == ["angular holds object, not numbers"]


def test_a_worker_that_does_not_know_the_question_is_unsupported(page):
    with Worker("reference") as worker:
        (run,) = ask_case(worker, CASE, [page["MOMENTUM"]])
    assert run.status is Status.UNSUPPORTED
    assert "does not know the question" in run.reason


def test_an_adapter_is_never_asked_a_question_it_has_no_method_for(page):
    class Old(page["ReferenceEngine"]):
        def unsupported(self, mechanism, question):
            return {Question.MODEL: (), Question.INSTANT: (), Question.TRAJECTORY: ()}[question]

    refused, methods = offer(Old(), CASE.mechanism, page["MOMENTUM"])
    assert "momentum" in refused[0].feature
    assert not methods
    plan = InProcessEngine("old", Old()).ask(Request(CASE.mechanism)).value
    assert plan.methods.keys() == {Question.MODEL, Question.INSTANT, Question.TRAJECTORY}


def test_the_report_shows_the_question(page):
    record = read_record(page["folder"])
    assert record.header["questions"] == ["momentum"]
    text = (page["folder"] / "report.html").read_text(encoding="utf-8")
    text += "".join(opened(text).values())
    for shown in ("linear and angular momentum at given states", "angular momentum", "spatial inertias"):
        assert shown in text, shown


def test_a_size_that_the_engine_chooses_is_one_wherever_it_stands(monkeypatch):
    for table in (questions._ROWS, questions.ANSWERS):
        monkeypatch.setitem(table, "events", None)
    answer = type("Events", (), {"__annotations__": {}})
    row = {"time": ("events",), "impulse": ("events", "joints", 3)}
    asked = Question.add("events", description="", arguments=("times",), answer=answer, shapes=row, judge="")
    found = answer()
    found.time, found.impulse = np.zeros(4), np.zeros((4, len(CASE.mechanism.joints), 3))
    assert not defects(found, asked, CASE.mechanism, 9)
    found.impulse = found.impulse[:3]
    assert defects(found, asked, CASE.mechanism, 9)
    questions.ANSWERS.pop("Events")
