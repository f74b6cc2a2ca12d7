"""The store keeps answers: an interrupted suite loses only the jobs in flight, and no job is repeated."""

import logging
import re
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from consilience.case import Case
from consilience.cli.terminal import log_to_stderr
from consilience.engine import EngineInfo, Method, Question, Route, Run, Status
from consilience.engine.worker.client import Request, replayable_job
from consilience.engine.worker.server import replay
from consilience.mechanism import Initial, Mechanism
from consilience.suite import Resources, Store, run_suite
from consilience.suite import store as store_module
from consilience.suite.engine_runs import EngineCase
from consilience.suite.store import FILE, StoredAnswer, StoreError
from mechanisms import chain, states_of

pytestmark = pytest.mark.usefixtures("answers_kept")

INFO = EngineInfo("mujoco", "4.0.0", "1")


def small_case(name, *kinds, seed):
    mechanism = replace(chain(*kinds, seed=seed), name=name)
    start = Initial(rates={"j0": {"angle": 1.5}})
    spans = {"duration": 0.2, "sample": 0.05, "digits": 8, "instants": 3, "seed": 1}
    return Case(name=name, file=f"{name}.toml", title=name, mechanism=mechanism, initial=start, **spans)


@pytest.fixture(scope="module")
def cases():
    return [small_case("first", "revolute", "spherical", seed=71), small_case("second", "revolute", seed=72)]


@contextmanager
def counted():
    """Jobs that a worker is given, in order, and their outcomes."""
    jobs = []
    perform = EngineCase._perform

    def noted(self, run, request):
        done = perform(self, run, request)
        what = (run.question, run.method.name, run.level, run.method.softness, run.step)
        jobs.append((run.engine, run.case, *what, replayable_job(run.engine, request), done.status))
        return done

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EngineCase, "_perform", noted)
        yield jobs


@pytest.fixture
def performed():
    with counted() as jobs:
        yield jobs


@pytest.fixture(scope="module")
def whole(cases, tmp_path_factory, answers_kept):
    """Results of a suite, the number of its jobs, and the folder of its store."""
    folder = tmp_path_factory.mktemp("whole")
    with counted() as jobs:
        return run_suite(cases, ["honest"], store=Store(folder)), len(jobs), folder


def told(results):
    """The parts of the results from which a report is made."""
    return [repr(run) for run in results.runs], [repr(c) for c in results.comparisons]


def test_a_second_run_asks_nothing_and_says_the_same(cases, whole, performed):
    first, asked, folder = whole
    assert asked > 20
    again = run_suite(cases, ["honest"], store=Store(folder))
    assert performed == []
    with np.printoptions(floatmode="unique", threshold=10**6):
        assert told(again) == told(first)


def test_a_run_that_is_interrupted_goes_on_where_it_was(cases, whole, tmp_path, performed):
    uncut, expected, _ = whole

    def interrupt(engine, case):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_suite(cases, ["honest"], resources=Resources(jobs=1), progress=interrupt, store=Store(tmp_path / "cut"))
    before, answered = len(performed), [job[-1] for job in performed].count(Status.ANSWERED)
    assert 0 < answered < expected
    resumed = run_suite(cases, ["honest"], store=Store(tmp_path / "cut"))
    # displaced motions share name, level and step, and differ only in their initial state
    assert len(performed) - before <= expected - answered + 1
    for found, told_whole in zip(resumed.runs, uncut.runs, strict=True):
        assert (found.engine, found.case, found.status) == (told_whole.engine, told_whole.case, Status.ANSWERED)
        for name, value in vars(told_whole.answer).items():
            if isinstance(value, np.ndarray):
                assert np.array_equal(getattr(found.answer, name), value)


def test_failures_are_asked_again(cases, tmp_path, performed):
    for _ in range(2):
        results = run_suite(cases[:1], ["aborts"], [Question.INSTANT], store=Store(tmp_path))
        assert [run.status for run in results.runs if run.engine == "aborts"] == [Status.FAILED]
    assert [job[0] for job in performed].count("aborts") == 2


def test_fresh_forgets(cases, tmp_path, performed):
    for fresh in (False, True):
        run_suite(cases[:1], [], [Question.INSTANT], store=Store(tmp_path, fresh=fresh))
    assert len(performed) == 2 * len(set(performed))


def request(seed=71, **changes):
    mechanism = chain("revolute", "spherical", seed=seed)
    method = Method("RK4", Route.NATIVE, 4, (4, 8), settings={"tolerance": 1e-9})
    states = states_of(mechanism, 2)
    asked = Request(mechanism, Question.TRAJECTORY, method, states, np.linspace(0.0, 1.0, 11), 0.01)
    return replace(asked, **changes)


def heavier(mechanism: Mechanism) -> Mechanism:
    body = mechanism.bodies[0]
    return replace(mechanism, bodies=(replace(body, mass=np.nextafter(body.mass, 2.0)), *mechanism.bodies[1:]))


OTHER = {
    "mass, by one rounding": lambda r: (INFO, replace(r, mechanism=heavier(r.mechanism))),
    "states": lambda r: (INFO, replace(r, states=r.states[:1])),
    "times": lambda r: (INFO, replace(r, times=np.linspace(0.0, 1.0, 21))),
    "step": lambda r: (INFO, replace(r, step=0.005)),
    "question": lambda r: (INFO, replace(r, question=Question.INSTANT)),
    "setting": lambda r: (INFO, replace(r, method=replace(r.method, settings={"tolerance": 1e-8}))),
    "softness": lambda r: (INFO, replace(r, method=replace(r.method, softness=2.0))),
    "version": lambda r: (replace(INFO, version="3.3.7"), r),
    "adapter": lambda r: (replace(INFO, adapter="2"), r),
    "engine": lambda r: (replace(INFO, name="dart"), r),
}


@pytest.mark.parametrize("other", OTHER.values(), ids=OTHER.keys())
def test_a_key_is_that_of_the_content(tmp_path, other):
    store = Store(tmp_path)
    key = store.key(INFO, request())
    assert store.key(INFO, request()) == key  # a new object with the same numbers
    assert store.key(*other(request())) != key


def test_a_key_holds_the_sources_of_the_adapter_however_the_engine_writes_its_name(tmp_path, monkeypatch):
    digested = []
    monkeypatch.setattr(store_module, "_sources", lambda package: digested.append(package) or package)
    Store(tmp_path).key(replace(INFO, name="MuJoCo"), request())
    assert "consilience_mujoco" in digested


def test_what_is_kept_comes_back_bit_by_bit(whole, tmp_path):
    store = Store(tmp_path)
    for n, run in enumerate(whole[0].runs):
        assert isinstance(run, Run)
        store.keep(str(n), StoredAnswer(run.answer, run.cpu, run.log))
        found = store.find(str(n))
        assert (type(found.answer), found.cpu, found.log) == (type(run.answer), run.cpu, run.log)
        for name, value in vars(run.answer).items():
            other = getattr(found.answer, name)
            assert np.array_equal(other, value) if isinstance(value, np.ndarray) else other == value, name


def test_a_file_that_is_no_database_is_named(tmp_path):
    (tmp_path / FILE).write_text("no database" * 100)
    with pytest.raises(StoreError, match=r"answers\.sqlite: file is not a database.*remove it"):
        Store(tmp_path)


def test_a_job_that_failed_is_written_down_and_can_be_done_again(cases, tmp_path):
    results = run_suite(cases[:1], ["liar"], [Question.INSTANT], store=Store(tmp_path))
    found = {run.method.name: run for run in results.runs if run.status is Status.FAILED}
    assert len(found) > 5
    for run in found.values():
        command, file = run.log.splitlines()[-1].rsplit(" ", 1)
        assert command == "to do it again: python -m consilience.engine.worker"
        assert (tmp_path / file).is_file()
    jobs = {name: (tmp_path / run.log.rsplit(" ", 1)[1]).read_bytes() for name, run in found.items()}
    assert replay(jobs["raises"]) == "RuntimeError: the Jacobian is singular at body 2"
    assert "nan" in replay(jobs["gives_nan"])


def test_a_verbose_run_says_who_does_what_on_a_line_each(cases, tmp_path, capsys):
    log_to_stderr()
    try:
        run_suite(cases[:1], ["aborts"], [Question.INSTANT], store=Store(tmp_path))
    finally:
        logging.getLogger("consilience").handlers = []
        logging.getLogger("consilience").setLevel(logging.NOTSET)
    told = capsys.readouterr().err.splitlines()
    for pattern in (
        r"aborts: started as process \d+ in \d+\.\d\d s$",
        r"aborts: takes first$",
        r"aborts: first, instant, descriptor: failed after \d+\.\d{3} s: the worker died: signal SIGABRT$",
        r"reference: first, instant, .*: \d+\.\d{3} s, of them \d+\.\d{3} s CPU time of the engine$",
        r"first: judged$",
    ):
        assert [line for line in told if re.search(pattern, line)], pattern
    assert all(re.match(r"\d\d:\d\d:\d\d\.\d{3} ", line) for line in told)
