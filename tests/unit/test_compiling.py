"""A first run compiles in two processes: one answers, the other compiles the kernels of motions."""

from contextlib import contextmanager
from threading import Event

import pytest

from consilience.case import load_case
from consilience.engine import Question, load_engine
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import perform
from consilience.suite import suite, warm_up


def test_kernels_count_as_compiled_with_those_of_motions_or_without_a_compiler(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not warm_up.compiled()
    (tmp_path / "relative").mkdir()
    (tmp_path / "relative" / "inertia.push-100.py311.nbi").touch()
    assert not warm_up.compiled()
    (tmp_path / "relative" / "integrate.integrate-317.py311.nbi").touch()
    assert warm_up.compiled()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "another"))
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert warm_up.compiled()


def test_the_second_process_is_asked_for_all_compiled_motions_of_the_first_formulation(monkeypatch):
    asked, all_asked = [], Event()

    class Recorder:
        def __init__(self, engine, limit, memory):
            self.engine = load_engine(engine)

        def ask(self, request):
            asked.append(request)
            value = perform(self.engine, request)
            if len(asked) == 6:
                all_asked.set()
            return Reply(value, True)

        def stop(self):
            asked.append("stopped")

    monkeypatch.setattr(warm_up, "Worker", Recorder)
    with warm_up.compiled_beside([load_case("double_pendulum"), load_case("four_bar")], 60.0, 2**30):
        assert all_asked.wait(120.0)
    assert asked.pop() == "stopped"
    motions = [request for request in asked if request.question is Question.TRAJECTORY]
    assert [(one.mechanism.name, one.method.name) for one in motions] == [
        (name, method) for name in ("four_bar", "double_pendulum") for method in ("relative", "relative, Gauss")
    ]
    assert all(len(one.times) == 1 for one in motions)


@pytest.mark.parametrize(("jobs", "warm", "beside"), [(2, False, 1), (2, True, 0), (1, False, 0)])
def test_a_suite_compiles_beside_only_where_it_has_two_processes_and_no_kernels(monkeypatch, jobs, warm, beside):
    entered = []

    @contextmanager
    def recorded(cases, limit, memory):
        entered.append([case.name for case in cases])
        yield

    monkeypatch.setattr(suite, "compiled", lambda: warm)
    monkeypatch.setattr(suite, "compiled_beside", recorded)
    cases = [load_case("simple_pendulum-small").with_span(0.1, None)]
    results = suite.run_suite(cases, ["reference", "mujoco"], jobs=jobs)
    assert entered == [["simple_pendulum-small"]] * beside
    assert not results.missing
