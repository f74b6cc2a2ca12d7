"""Workers under attack: one failed reply with its evidence, an answer to the next job, and no process left behind."""

import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
import uuid
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from consilience.engine import EngineInfo, InstantAnswer, Method, Question, Route
from consilience.engine.worker.client import Request, Worker
from consilience.engine.worker.messages import REMEMBERED
from harness.processes import MARK
from harness.processes import marked as marked_by
from mechanisms import chain, states_of
from pace import slowness, soon

LIMIT = 2.0
"""Of a job that never ends, in s; the others have time."""

MEMORY = 400 * 2**20
METHOD = Method("zero", Route.NATIVE)

# engine: pattern of the evidence in the reason
ATTACKS = {
    "loops": "^no answer within {limit} s; the worker was stopped$",
    "loops_in_c": "^no answer within {limit} s; the worker was stopped$",
    "eats_memory": r"^out of memory: \d+ MiB, the limit is 400 MiB$",
    "asks_for_too_much": "^MemoryError: Unable to allocate 512. TiB",
    "floods": "^it printed more than 64 MiB$",
    "writes_garbage": "^garbage on the wire: b'Segmentation fault",
    "writes_text_frame": "^garbage on the wire: .* is no reply$",
    "half_a_frame_and_dies": r"^the worker died: signal SIGABRT, after 4000 of \d{4} bytes of an answer$",
    "half_a_frame_and_hangs": r"the worker was stopped, after 4000 of \d{4} bytes of an answer$",
    "announces_too_much": r"^a frame of 4294967295 \+ 1152921504606846976 bytes; at most",
    "other_version": "^it speaks version 99 of the protocol, not 3$",
    "wrong_job": "^it answered job 123456, not job 3$",
    "answers_twice": "^it answered job 4, not job 3$",
    "closes_its_pipe": "^the worker closed its connection and lived on$",
    "leaves_a_child": "^it left a process behind that goes on$",
    "leaves_a_child_elsewhere": "^it left a process behind that goes on$",
    "leaves_a_daemon": "^it left a process behind that goes on$",
    "leaves_a_child_and_dies": "^the worker died: signal SIGABRT$",
    "nests": "^RecursionError",
}
HANGS = {"loops", "loops_in_c", "half_a_frame_and_hangs"}
SURVIVES = {"asks_for_too_much", "nests"}
"""What is an exception in the worker and no reason to replace it."""


@pytest.fixture
def marked(monkeypatch):
    """PIDs of the living processes that descend from this test."""
    mark = uuid.uuid4().hex
    monkeypatch.setenv(MARK, mark)
    return lambda: marked_by(mark)


def mechanism_of(name, seed=3):
    return replace(chain("revolute", "spherical", seed=seed), name=name)


def instant_of(mechanism, method=METHOD):
    return Request(mechanism, Question.INSTANT, method, states_of(mechanism, 2))


FIRST, OTHER = mechanism_of("first"), mechanism_of("other", 4)


def gone(find):
    """Whether no process is left, now or soon: the system reaps ended processes with a delay."""
    return soon(lambda: not find())


@pytest.mark.parametrize("engine", ATTACKS)
def test_an_attack_is_a_failed_reply_and_the_next_job_is_answered(engine, marked):
    limit = LIMIT * slowness() if engine in HANGS else 60.0
    with Worker(engine, limit, MEMORY) as worker:
        before = worker.ask(instant_of(OTHER))
        first = marked()
        bad = worker.ask(instant_of(FIRST))
        assert engine in SURVIVES or gone(lambda: [pid for pid in marked() if pid in first])
        after = worker.ask(instant_of(OTHER))
        assert (marked() == first) is (engine in SURVIVES)
        assert len(marked()) == 1
    assert before.returned, before.reason
    assert len(first) == 1
    assert not bad.returned
    assert bad.value is None
    assert re.search(ATTACKS[engine].replace("{limit}", f"{limit:g}"), bad.reason), bad.reason
    assert isinstance(after.value, InstantAnswer), after.reason
    assert gone(marked)


def test_jobs_that_wait_behind_an_attack_are_answered():
    with Worker("leaves_a_child_and_dies") as worker:
        futures = [worker.submit(instant_of(m)) for m in (OTHER, FIRST, OTHER, FIRST, OTHER)]
        replies = [worker.reply(future) for future in futures]
    assert [reply.returned for reply in replies] == [True, False, True, False, True]


def test_a_crash_while_the_engine_starts_is_the_reason(marked):
    with Worker("starts_a_crash") as worker:
        reply = worker.ask(Request())
        assert gone(marked)
    assert reply.reason == "while it started, the worker died: signal SIGABRT"
    assert "Fatal Python error: Aborted" in reply.log


def test_where_a_job_hangs_is_in_its_log():
    with Worker("loops_in_c", LIMIT * slowness()) as worker:
        reply = worker.ask(instant_of(FIRST))
    assert "Stack (most recent call first)" in reply.log
    assert "wild_engines.py" in reply.log


def test_where_a_job_crashed_is_in_its_log():
    with Worker("leaves_a_child_and_dies") as worker:
        reply = worker.ask(instant_of(FIRST))
    assert "in _child_and_crash" in reply.log


def test_a_failed_job_can_be_done_again_from_its_bytes(tmp_path, marked):
    with Worker("half_a_frame_and_dies") as worker:
        reply = worker.ask(instant_of(FIRST))
        assert worker.ask(instant_of(OTHER)).job == b""
    file = tmp_path / "job.frames"
    file.write_bytes(reply.job)
    command = [sys.executable, "-c", REPLAY, str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert "AssertionError: no socket is open" in done.stdout  # the attack repeated, in a process without a socket


REPLAY = textwrap.dedent(
    f"""
    import sys
    sys.path[:0] = {[p for p in sys.path if p]!r} + [{str(Path(__file__).parent / "plugins")!r}]
    from pathlib import Path
    from consilience.engine.worker.server import replay
    print(replay(Path(sys.argv[1]).read_bytes()))
    """
)


def test_an_engine_that_closes_its_output_is_answered_for():
    with Worker("closes_standard_output") as worker:
        assert worker.ask(instant_of(FIRST)).returned
        assert worker.ask(instant_of(OTHER)).returned


# ---------------------------------------------------------------- mechanisms are sent once


def distinct(worker, mechanism):
    """Number of mechanisms of this name that the engine has been given."""
    reply = worker.ask(Request(mechanism, Question.MODEL, METHOD, states_of(mechanism, 1)))
    return reply.value.freedom


def test_a_mechanism_is_sent_once():
    """Mechanisms are compared by content: a second, equal mechanism is not sent."""
    with Worker("zero") as worker:
        assert [distinct(worker, OTHER) for _ in range(3)] == [1, 1, 1]
        assert distinct(worker, mechanism_of("other", 4)) == 1
        assert distinct(worker, mechanism_of("other", 5)) == 2


def test_mechanisms_are_forgotten_when_there_are_too_many_and_after_a_crash():
    with Worker("leaves_a_child_and_dies") as worker:
        assert distinct(worker, OTHER) == 1
        for seed in range(REMEMBERED):
            distinct(worker, mechanism_of(f"m{seed}", seed))
        assert distinct(worker, OTHER) == 2
        worker.ask(instant_of(FIRST))
        assert distinct(worker, OTHER) == 1


def test_an_engine_cannot_write_into_the_mechanism_it_is_lent():
    with Worker("scribbles") as worker:
        reply = worker.ask(instant_of(OTHER))
    assert reply.reason == "ValueError: assignment destination is read-only"


# ---------------------------------------------------------------- end of workers


def test_an_idle_worker_that_is_killed_is_replaced(marked):
    with Worker("zero") as worker:
        assert worker.ask(instant_of(OTHER)).returned
        (pid,) = marked()
        psutil.Process(pid).kill()
        assert gone(marked)
        assert worker.ask(instant_of(OTHER)).returned


def test_a_cancelled_worker_answers_no_more_and_leaves_nothing(marked):
    with Worker("loops", 600.0) as worker:
        worker.ask(Request())
        futures = [worker.submit(instant_of(FIRST)), worker.submit(instant_of(OTHER))]
        threading.Timer(0.3, worker.cancel).start()
        replies = [worker.reply(future) for future in futures]
        late = worker.submit(instant_of(OTHER))
        assert soon(late.done)
        replies.append(worker.reply(late))
        stopping = threading.Thread(target=worker.stop)
        stopping.start()
        assert soon(lambda: not stopping.is_alive())
    assert {reply.reason for reply in replies} == {"stopped before it answered"}
    assert gone(marked)


def test_stopping_twice_or_before_the_start_is_harmless(marked):
    worker = Worker("zero")
    worker.stop()
    worker.stop()
    assert not worker.ask(Request()).returned
    assert not marked()


RUNNER = textwrap.dedent(
    """
    import signal
    import sys
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the shell runs tests in the background
    sys.path[:0] = {path!r}
    from test_workers import FIRST, instant_of
    from consilience.engine.worker.client import Request, Worker

    if __name__ == "__main__":
        workers = [Worker(name, 600.0) for name in ("loops", "loops_in_c", "zero", "leaves_a_child")]
        for worker in workers:
            assert worker.ask(Request()).returned
        futures = [worker.submit(instant_of(FIRST)) for worker in workers[:2]]
        print("ready", flush=True)
        futures[0].result()
    """
)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_die_with_the_runner(end, marked, tmp_path):
    """A killed runner cannot stop its workers; one worker is in native code that holds the GIL."""
    here = str(Path(__file__).parent)
    script = tmp_path / "runner.py"
    script.write_text(RUNNER.format(path=[here, f"{here}/plugins", *(p for p in sys.path if p)]))
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as runner:
        assert runner.stdout.readline() == b"ready\n", runner.stderr.read().decode()
        assert len(marked()) == 5
        runner.send_signal(end)
        runner.wait(60.0 * slowness())  # on a busy machine the interpreter itself takes seconds to end
        assert gone(marked)


def test_information_is_what_the_engine_says():
    with Worker("zero") as worker:
        assert worker.ask(Request()).value == EngineInfo("zero", "1.0", "1.0")


COMMANDS = {
    "run": ["run", "double_pendulum", "-e", "stuck"],
    "check": ["check", "double_pendulum", "-e", "stuck"],
    "validate": ["validate", "double_pendulum", "-e", "stuck"],
    "fuzz": ["fuzz", "-n", "2", "-e", "stuck"],
    "simulate": ["simulate", "double_pendulum", "-e", "stuck", "-o", "motion.json"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_ctrl_c_ends_a_command_within_two_seconds_and_leaves_nothing(command, marked, tmp_path, monkeypatch):
    """Ctrl-C arrives while the engine blocks; the reference may be at work as well."""
    stuck = tmp_path / "stuck"
    monkeypatch.setenv("CONSILIENCE_TEST_STUCK", str(stuck))
    path = [str(Path(__file__).parent / "plugins"), *(p for p in sys.path if p)]
    # a shell that runs tests in the background lets them and their children ignore Ctrl-C
    listening = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{listening}; sys.path[:0] = {path!r}; from consilience.cli.main import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", program, *COMMANDS[command]],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
    ) as runner:
        until = time.monotonic() + 240.0
        while not stuck.exists():
            assert runner.poll() is None, runner.stderr.read().decode()
            assert time.monotonic() < until
            time.sleep(0.05)
        assert len(marked()) > 1
        runner.send_signal(signal.SIGINT)
        assert soon(lambda: runner.poll() is not None)
    assert gone(marked)
    assert runner.returncode != 0
