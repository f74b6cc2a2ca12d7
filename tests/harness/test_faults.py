"""A failing engine gives one failed run with its evidence; the suite goes on, and the harness is unharmed."""

import re
from dataclasses import replace

import pytest

from consilience.case import Case
from consilience.compare import Verdict
from consilience.engine import Question, Status, installed
from consilience.mechanism import Initial
from consilience.suite import EngineFailure, Resources, run_suite, simulate_case
from harness.processes import MARK, marked
from mechanisms import chain
from pace import slowness

pytestmark = pytest.mark.usefixtures("answers_kept")

MEMORY = 1536 * 2**20
"""Of an engine in bytes: what the honest ones need, and what is soon eaten."""

INSTANT, TRAJECTORY = Question.INSTANT, Question.TRAJECTORY

# engine: the question at which it fails for the case `first`, and a pattern of the evidence in the reason
FAULTS = {
    "aborts": (INSTANT, "the worker died: signal SIGABRT"),
    "is_killed": (INSTANT, "the worker died: signal SIGKILL"),
    "segfaults": (INSTANT, "the worker died: signal SIGSEGV"),
    "exits": (INSTANT, "the worker died: exit code 3"),
    "gives_lambda": (INSTANT, "the answer cannot be sent: it holds a function"),
    "honestly_writes_garbage": (INSTANT, "garbage on the wire"),
    "honestly_closes_its_pipe": (INSTANT, "the worker closed its connection and lived on"),
    "honestly_leaves_a_child": (INSTANT, "it left a process behind that goes on"),
    "honestly_floods": (INSTANT, "it printed more than 64 MiB"),
    "honestly_eats_memory": (INSTANT, r"out of memory: \d+ MiB, the limit is 1536 MiB"),
    "honestly_half_a_frame_and_dies": (INSTANT, r"the worker died: signal SIGABRT, after 4000 of \d+ bytes"),
    "honestly_leaves_a_child_and_dies": (INSTANT, "the worker died: signal SIGABRT"),
    "honestly_wrong_job": (INSTANT, "it answered job 123456, not job"),
    "silent": (INSTANT, "no method"),
    "stepless": (TRAJECTORY, "level"),
}
# the same for the methods of the engine `liar`
LIES = {
    "raises": (INSTANT, "RuntimeError: the Jacobian is singular at body 2"),
    "gives_nan": (INSTANT, "a_WB_W has 1 values that are not finite"),
    "gives_none": (INSTANT, "the answer is a NoneType, not a InstantAnswer"),
    "gives_text": (INSTANT, "the answer is a str, not a InstantAnswer"),
    "gives_strings": (INSTANT, "kinetic holds <U3, not numbers"),
    "gives_wrong_shape": (INSTANT, r"alpha_WB_W has shape \(3, 2, 2\), not \(3, 2, 3\)"),
    "gives_nothing": (INSTANT, r"a_WB_W has shape \(0,\), not \(3, 2, 3\)"),
    "stops_early": (TRAJECTORY, r"time has shape \(4,\), not \(5,\)"),
    "gives_long_quaternions": (TRAJECTORY, "quat_WB"),
}
# faults that could break more than one run: each is asked in a suite of its own
UNRULY = {
    "raises_two_parts": (INSTANT, "7: no licence"),
    "gives_ragged": (INSTANT, "force_F"),
    "gives_zero_quaternions": (TRAJECTORY, "quat_WB"),
}
MISSING = {
    "broken_import": "ImportError: libengine.so.3: cannot open shared object file",
    "no_such_class": "AttributeError",
    "cannot_start": "OSError: no licence server",
    "anonymous": "str",
    "starts_a_crash": "while it started, the worker died: signal SIGABRT",
}


def small_case(name, *kinds, seed):
    mechanism = replace(chain(*kinds, seed=seed), name=name)
    start = Initial(rates={"j0": {"angle": 1.5}})
    spans = {"duration": 0.2, "sample": 0.05, "digits": 8, "instants": 3, "seed": 1}
    return Case(name=name, file=f"{name}.toml", title=name, mechanism=mechanism, initial=start, **spans)


@pytest.fixture(scope="module")
def cases():
    return [
        small_case("first", "revolute", "spherical", seed=71),
        small_case("second", "revolute", "universal", seed=72),
    ]


@pytest.fixture(scope="module")
def results(cases):
    """One suite over many engines: no engine may spoil the runs of another or leave a process behind."""
    names = ["honest", *FAULTS, "liar", *MISSING, "selective", "cannot_plan", "chatters"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(MARK, "faults")
        found = run_suite(cases, names, resources=Resources(3, 600.0, MEMORY))  # the first job compiles kernels
    assert not marked("faults")
    return found


def verdict(results, engine, case, question, method=None):
    """The only comparison of engine, case and question; of several methods, name one."""
    key = (engine, case, question)
    (found,) = [c for c in results.comparisons if (c.engine, c.case, c.question) == key and method in (None, c.method)]
    return found


def test_the_miniature_engines_are_found_by_their_entry_points():
    assert {*FAULTS, *UNRULY, *MISSING, "liar", "honest", "hangs", "reference"} <= set(installed())


@pytest.mark.parametrize("question", list(Question))
@pytest.mark.parametrize("case", ["first", "second"])
@pytest.mark.parametrize("engine", ["honest", *FAULTS, "selective", "chatters"])
def test_everything_but_the_fault_is_answered_and_agrees(results, engine, case, question):
    at_fault = {**{name: q for name, (q, _) in FAULTS.items()}, "selective": INSTANT}.get(engine)
    if case == "first" and question is at_fault:
        assert verdict(results, engine, case, question).verdict in (Verdict.FAILED, Verdict.UNSUPPORTED)
    else:
        found = verdict(results, engine, case, question)
        assert found.verdict is Verdict.AGREES, found.why


def assert_failed_with_evidence(results, engine, question, evidence, method=None):
    key = (engine, "first", question)
    runs = [
        r for r in results.runs if (r.engine, r.case, r.question) == key and (method is None or r.method.name == method)
    ]
    assert runs, "the question has vanished from the record"
    assert {r.status for r in runs} == {Status.FAILED}
    assert {r.answer for r in runs} == {None}
    assert all(re.search(evidence, r.reason) for r in runs), runs[0].reason
    assert re.search(evidence, verdict(results, engine, "first", question, method).why)


@pytest.mark.parametrize("engine", FAULTS)
def test_a_fault_is_a_failed_run_with_the_evidence(results, engine):
    assert_failed_with_evidence(results, engine, *FAULTS[engine])


@pytest.mark.parametrize("method", LIES)
def test_a_malformed_answer_is_a_failed_run_with_the_evidence(results, method):
    assert_failed_with_evidence(results, "liar", *LIES[method], method)


@pytest.mark.parametrize("method", ["descriptor", "honest after all"])
@pytest.mark.parametrize("question", list(Question))
@pytest.mark.parametrize("case", ["first", "second"])
def test_other_methods_of_an_engine_do_not_suffer_from_a_malformed_answer(results, case, question, method):
    assert verdict(results, "liar", case, question, method).verdict is Verdict.AGREES


@pytest.mark.parametrize("engine", UNRULY)
def test_an_unruly_answer_is_a_failed_run_and_the_suite_goes_on(cases, engine):
    results = run_suite(cases, [engine], [INSTANT, TRAJECTORY])
    question, evidence = UNRULY[engine]
    assert_failed_with_evidence(results, engine, question, evidence)
    other = TRAJECTORY if question is INSTANT else INSTANT
    for case, asked in (("first", other), ("second", INSTANT), ("second", TRAJECTORY)):
        assert verdict(results, engine, case, asked).verdict is Verdict.AGREES


@pytest.mark.parametrize("engine", MISSING)
def test_an_engine_that_does_not_start_is_missing_with_the_reason(results, engine):
    assert MISSING[engine] in results.missing[engine]
    assert engine not in results.engines
    assert not [r for r in results.runs if r.engine == engine]


def test_nothing_else_is_missing(results):
    assert set(results.missing) == set(MISSING)


def test_an_engine_that_trips_over_a_mechanism_fails_at_its_questions_only(results):
    for question in Question:
        first, second = (verdict(results, "cannot_plan", case, question) for case in ("first", "second"))
        assert (first.verdict, first.why) == (Verdict.FAILED, "KeyError: 'spherical'")
        assert second.verdict is Verdict.AGREES


def test_what_an_engine_declares_unsupported_is_not_asked(results):
    found = verdict(results, "selective", "first", INSTANT)
    assert found.verdict is Verdict.UNSUPPORTED
    assert found.why == "joint 'j1': this engine knows no spherical joints"
    (run,) = [r for r in results.runs if (r.engine, r.case, r.question) == ("selective", "first", INSTANT)]
    assert run.status is Status.UNSUPPORTED
    assert run.answer is None


def test_a_state_that_an_engine_cannot_represent_is_unsupported_with_the_reason(results):
    found = verdict(results, "liar", "first", INSTANT, "cannot_represent")
    assert (found.verdict, found.why) == (Verdict.UNSUPPORTED, "state 1: this engine knows no such state")


def test_last_words_of_a_dying_engine_are_kept(results):
    (run,) = [r for r in results.runs if (r.engine, r.case, r.question) == ("aborts", "first", INSTANT)]
    assert "corrupted double-linked list" in run.log


def test_garbage_on_both_channels_harms_nothing_and_its_end_is_kept(results):
    (run,) = [r for r in results.runs if (r.engine, r.case, r.question) == ("chatters", "first", INSTANT)]
    assert run.status is Status.ANSWERED
    for said in ("from C\n", "from Python\n", "on the error channel, last\n"):  # C keeps its words until it is flushed
        assert said in run.log[-60:]
    assert len(run.log) <= 4000
    (after,) = [r for r in results.runs if (r.engine, r.case, r.question) == ("chatters", "second", INSTANT)]
    assert after.log == ""


def test_an_engine_prints_nothing_into_the_terminal_of_the_caller(cases, capfd):
    run_suite(cases[:1], ["chatters"], [INSTANT])
    assert capfd.readouterr() == ("", "")


def test_a_hang_is_stopped_at_the_limit_and_the_next_question_answered(cases):
    """The engine ignores SIGTERM; the limit allows for a slow start and is short enough to wait for."""
    limit = 6.0 * slowness()
    results = run_suite(cases[:1], ["hangs"], [Question.INSTANT, Question.TRAJECTORY], Resources(limit=limit))
    found = verdict(results, "hangs", "first", INSTANT)
    assert found.verdict is Verdict.FAILED
    assert found.why == f"no answer within {limit:g} s; the worker was stopped"
    assert verdict(results, "hangs", "first", TRAJECTORY).verdict is Verdict.AGREES


def test_a_suite_without_a_reference_answer_is_unresolved(cases, monkeypatch):
    """`reference` is shadowed by an engine that dies: without a reference answer no engine may agree."""
    monkeypatch.setattr("consilience.suite.suite.REFERENCE", "aborts")
    results = run_suite(cases[:1], ["honest"], [INSTANT])
    assert verdict(results, "aborts", "first", INSTANT).verdict is Verdict.FAILED
    found = verdict(results, "honest", "first", INSTANT)
    assert (found.verdict, found.why) == (Verdict.UNRESOLVED, "the reference did not answer")


@pytest.mark.parametrize(
    ("engine", "message"),
    [
        ("cannot_plan", "engine 'cannot_plan', case 'first': failed: KeyError"),
        ("broken_import", "engine 'broken_import', case 'first': failed: ImportError"),
        ("stepless", r"engine 'stepless'.*level"),
    ],
)
def test_simulating_with_an_engine_that_fails_names_engine_case_and_reason(cases, engine, message):
    with pytest.raises(EngineFailure, match=message):
        simulate_case(cases[0], engine, 60.0)
